"""Kernels compiled by a child process: the test process reads their machine code from the cache.

The compiler leaves 300 MB behind for a step of grains that deform: the process that compiled it holds 420 MB, one that
reads it from the cache 195 MB. A test worker compiles about forty variants.
"""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

Counts = dict[str, dict[str, int]]
LINKED_NOWHERE = ("run_steps",)
"""Kernels that no other one calls: their LLVM code, which numba keeps for callers (7 MB a variant), is given up."""


def install(counts: Callable[[], Counts], merge: Callable[[Counts], None]) -> None:
    """Let `Dispatcher.compile` fork where a kernel is not in the cache; once a process, before the first compilation.

    Parameters
    ----------
    counts : callable
        Asked in the child after it has compiled: what is worth counting there.
    merge : callable
        Gets the child's answer in the process that asked.
    """
    compile_here = Dispatcher.compile
    state = {"child": not hasattr(os, "fork")}  # a child compiles whatever its kernel calls by itself

    def is_missing(kernel: Any, signature: Any) -> bool:
        cache = kernel._cache
        if isinstance(cache, NullCache) or not cache._enabled or not kernel._can_compile:
            return False
        if tuple(normalize_signature(signature)[0]) in kernel.overloads:
            return False
        kernel.targetctx.refresh()
        with cache._guard_against_spurious_io_errors():
            return cache._index_key(signature, kernel.targetctx.codegen()) not in cache._cache_file._load_index()
        return False

    def compile_in_child(kernel: Any, signature: Any) -> Any:
        if not state["child"]:
            with global_compiler_lock:  # held by another thread, the child would wait for it forever
                if is_missing(kernel, signature):
                    with tempfile.TemporaryDirectory() as folder:
                        answer = Path(folder) / "counts.json"
                        if (child := _fork()) == 0:
                            state["child"] = True
                            try:
                                compile_here(kernel, signature)
                                answer.write_text(json.dumps(counts()))
                            finally:
                                os._exit(0)
                        os.waitpid(child, 0)
                        if answer.is_file():  # else it failed, and fails below with its message
                            merge(json.loads(answer.read_text()))
        entry_point = compile_here(kernel, signature)
        if kernel.py_func.__name__ in LINKED_NOWHERE:
            for result in kernel.overloads.values():
                if (code := result.library._shared_module) is not None:
                    result.library._shared_module = None
                    code.close()
        return entry_point

    Dispatcher.compile = compile_in_child  # type: ignore[method-assign]


def _fork() -> int:
    """`os.fork`; the child runs the compiler alone, which needs no other thread (Python 3.12 warns of them)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()
