"""Functions that kernels call and Python does not: compiled into their callers, without machine code of their own.

Numba makes wrappers for calls from Python and from C for every function, and machine code of each, although a caller
takes in what was compiled halfway (LLVM's intermediate code). `inner` leaves out the wrappers, and `_install` the
machine code: a fifth of the time that a step of the grains takes to compile, and not a bit of the result. Nor is that
halfway code optimised by itself: the kernel that takes it in does so once (a sixth of the time).

A kernel finds the environment of each function that it has taken in, which holds what may be needed while an error is
raised, under a name; that name is all that is put among the machine code of an inner function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core.cpu import CPUContext
from numba.core.targetconfig import ConfigStack

from geometry.numba_version import require_tested_version

# how `numba.extending.overload` compiles a function that serves kernels only
INTO_CALLER: Any = {"forceinline": True, "no_cfunc_wrapper": True, "_nrt": False}


def inner(*, borrows: bool = False, **options: Any) -> Callable[[Callable], Any]:
    """`numba.njit` for a function that kernels call and Python does not.

    It is compiled into them, without a cache of its own, without wrappers and without machine code: calling it from
    Python, or handing it to C, is a defect (numba raises a SystemError or crashes).

    Parameters
    ----------
    borrows : bool
        As with `borrowing`.
    **options
        Of `numba.njit`.
    """
    made = borrowing if borrows else numba.njit
    return made(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)  # type: ignore[call-overload]


def borrowing(**options: Any) -> Callable[[Callable], Any]:
    """`numba.njit` for a function that counts no references to its arrays, which its caller holds.

    Where a function is called in a loop and takes arrays out of tuples, counting costs more than the work. It can
    allocate nothing (numba refuses), and must return no array.
    """
    return numba.njit(_nrt=False, **options)  # type: ignore[call-overload]


def _finish_without_code(library: Any) -> None:
    """The end of `CodeLibrary.finalize`, less adding the module to those that become machine code."""
    library._finalize_dynamic_globals()
    library._verify_declare_only_symbols()
    library._finalized = True


def _install() -> None:
    """Put it into numba's context for the processor; once a process."""
    executable = CPUContext.get_executable

    def get_executable(self, library, fndesc, env):
        flags = ConfigStack.top_or_none()
        is_inner = flags is not None and flags.no_cpython_wrapper and flags.no_cfunc_wrapper
        if is_inner and not library._finalized:
            library._finalize_final_module = lambda: _finish_without_code(library)
            library._optimize_final_module = lambda: None
            library._ensure_finalized()
            name = self.get_env_name(fndesc)
            module = llvm.parse_assembly(f'@"{name}" = common global i8* null\n')
            module.name = f"environment of {fndesc.qualname}"
            module.triple, module.data_layout = library._final_module.triple, library._final_module.data_layout
            library.codegen._add_module(module)
        return executable(self, library, fndesc, env)

    CPUContext.get_executable = get_executable  # type: ignore[method-assign]


require_tested_version(numba.__version__)
_install()
