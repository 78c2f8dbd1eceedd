"""A number that changes with the source of the compiled code.

Numba's cache of a kernel notices that the kernel's own file has changed, not that a function of another file has. A
kernel that is made inside a function which holds this stamp has it in its cache key; so kernels may be spread over
small files, one concept each.
"""

from __future__ import annotations

import zlib
from functools import cache
from pathlib import Path

_FOLDERS = ("dem", "dvi", "laws", "walls")  # everything that the steps are made of


@cache
def kernel_stamp() -> int:
    """CRC-32 of the source files of laws, walls and steps."""
    stamp = 0
    for folder in _FOLDERS:
        for path in sorted((Path(__file__).parent / folder).glob("*.py")):
            stamp = zlib.crc32(path.read_bytes(), stamp)
    return stamp
