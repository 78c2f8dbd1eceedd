"""Device functions: called by kernels alone, linked into them as LLVM IR, without machine code of their own.

Numba compiles every function to machine code with wrappers for calls from Python and C, although a caller links its
LLVM IR. `device_function` omits the wrappers, and `_install` the machine code and the optimisation of the IR by itself:
the kernel that links it optimises it once. The results do not change; geometry/kernels/README.md has the
compile times.

The body of a parallel loop and the two wrappers that numba builds around it are such functions too: only the kernel
that contains the loop calls them. Numba optimises each by itself and makes machine code of it, so that all that a loop
calls is compiled four times.

A kernel refers to the environment of each function that it links (needed to raise errors) by a symbol; that symbol is
the only content of the module that is generated for a device function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.cpu import CPUContext
from numba.core.targetconfig import ConfigStack

from geometry.kernels.numba_version import require_tested_version

# jit options of `numba.extending.overload` for device functions
INLINE: Any = {"forceinline": True, "no_cfunc_wrapper": True, "_nrt": False}


def device_function(*, without_refcounts: bool = False, **options: Any) -> Callable[[Callable], Any]:
    """`numba.njit` for a function that kernels call and Python does not.

    It is linked into them and has no cache, no wrappers and no machine code: calling it from Python, or passing it to
    C, is an error (numba raises a SystemError or crashes).

    Parameters
    ----------
    without_refcounts : bool
        As with `njit_without_refcounts`.
    **options
        Of `numba.njit`.
    """
    made = njit_without_refcounts if without_refcounts else numba.njit
    return made(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)  # type: ignore[call-overload]


def njit_without_refcounts(**options: Any) -> Callable[[Callable], Any]:
    """`numba.njit` for a function without reference counting: its caller owns the arrays.

    Where a function is called in a loop and takes arrays out of tuples, counting references costs more than the work.
    It can allocate nothing (numba refuses), and must return no array.
    """
    return numba.njit(_nrt=False, **options)  # type: ignore[call-overload]


LOOP_BODY = "__numba_parfor_gufunc"  # beginning of the name of a parallel loop's body


def _leave_to_caller(library: Any) -> None:
    """Make `CodeLibrary.finalize` link its parts alone: without optimisation, and without machine code."""

    def finish() -> None:
        library._finalize_dynamic_globals()
        library._verify_declare_only_symbols()
        library._finalized = True

    library._finalize_final_module = finish
    library._optimize_final_module = lambda: None


def _install() -> None:
    """Replace `CPUContext.get_executable` and `JITCodeLibrary.add_linking_library`; once a process."""
    executable, add_linking_library = CPUContext.get_executable, JITCodeLibrary.add_linking_library

    def get_executable(self, library, fndesc, env):
        flags = ConfigStack.top_or_none()
        without_code = flags is not None and flags.no_cpython_wrapper and flags.no_cfunc_wrapper
        without_code = without_code or library.name.startswith(LOOP_BODY)
        if without_code and not library._finalized:
            _leave_to_caller(library)
            library._ensure_finalized()
            name = self.get_env_name(fndesc)
            module = llvm.parse_assembly(f'@"{name}" = common global i8* null\n')
            module.name = f"environment of {fndesc.qualname}"
            module.triple, module.data_layout = library._final_module.triple, library._final_module.data_layout
            library.codegen._add_module(module)
        return executable(self, library, fndesc, env)

    def link(self, library):
        if not library._finalized:  # its code has not been requested: a wrapper, or a part of numba's own functions
            _leave_to_caller(library)
        add_linking_library(self, library)

    CPUContext.get_executable = get_executable  # type: ignore[method-assign]
    JITCodeLibrary.add_linking_library = link  # type: ignore[method-assign]


require_tested_version(numba.__version__)
_install()
