"""A digest of the machine code of all kernels that this process has compiled or read from the cache.

The compiler's output depends on what else the same process has compiled before: code of one kernel from two caches may
round differently. Runs of one scene agree bit for bit where commit, packages, plan and this digest agree. It is made of
the sections of the cached object files that hold code and constants; names of symbols, which differ from one
compilation to the next, are not in it.
"""

from __future__ import annotations

import hashlib
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from geometry.kernels.stamp import PACKAGES

CODE = (b".text", b".ltext", b".rodata.cst")
"""Beginnings of the names of sections with code and numeric constants; other read-only data hold names."""

WITH_CONTENT = 1
"""SHT_PROGBITS, the type of sections whose bytes are in the file (Tool Interface Standard, ELF specification 1.2)."""


def machine_code_digest() -> str:
    """First 16 hexadecimal digits of a SHA-256 over all kernels, in the order of their names and types."""
    total = hashlib.sha256()
    for name, code in sorted(kernel_codes()):
        total.update(name.encode())
        total.update(hashlib.sha256(code).digest())
    return total.hexdigest()[:16]


def kernel_codes() -> Iterator[tuple[str, bytes]]:
    """Name with types, and code, of every kernel that this process uses and the cache holds."""
    for module, loaded in list(sys.modules.items()):
        if module.partition(".")[0] not in PACKAGES:
            continue
        for name, value in list(vars(loaded).items()):
            if not isinstance(value, Dispatcher) or value.py_func.__module__ != module:
                continue
            cache: Any = getattr(value, "_cache")  # noqa: B009 (numba's stubs hide it)
            context: Any = value.targetctx
            file = getattr(cache, "_cache_file", None)
            if file is None or not value.overloads:
                continue
            index, target = file._load_index(), context.codegen()
            for signature in value.overloads:
                data = index.get(cache._index_key(signature, target))
                if data is not None:
                    with suppress(FileNotFoundError):  # another process has replaced it
                        yield f"{module}.{name}{signature}", code_of(Path(file._data_path(data)).read_bytes())


def code_of(entry: bytes) -> bytes:
    """Code and constants of an entry of the cache, which holds an ELF object file of 64 bits; else all of its bytes."""
    start = entry.find(b"\x7fELF\x02\x01")
    if start < 0:
        return entry
    elf = memoryview(entry)[start:]
    table, size, count, names = *struct.unpack_from("<Q", elf, 0x28), *struct.unpack_from("<HHH", elf, 0x3A)
    sections = [struct.unpack_from("<IIQQQQ", elf, table + k * size) for k in range(count)]
    text = bytes(elf[sections[names][4] : sections[names][4] + sections[names][5]])
    return b"".join(
        bytes(elf[offset : offset + length])
        for name, kind, _, _, offset, length in sections
        if kind == WITH_CONTENT and text[name : text.index(b"\0", name)].startswith(CODE)
    )
