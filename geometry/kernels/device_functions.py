"""Device functions: called by kernels alone, linked into them as LLVM IR, without machine code of their own.

Numba compiles every function to machine code with wrappers for calls from Python and C, although a caller links its
LLVM IR. `device_function` omits the wrappers, and `_install` the machine code and the optimisation of the IR by itself:
the kernel that links it optimises it once. The results do not change; docs/explanation/compiled_kernels.md has the
compile times.

A kernel refers to the environment of each function that it links (needed to raise errors) by a symbol; that symbol is
the only content of the module that is generated for a device function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numba
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


def _finish_without_code(library: Any) -> None:
    """Finish `CodeLibrary.finalize` without adding the module to those that are compiled to machine code."""
    library._finalize_dynamic_globals()
    library._verify_declare_only_symbols()
    library._finalized = True


def _install() -> None:
    """Replace `CPUContext.get_executable`; once a process."""
    executable = CPUContext.get_executable

    def get_executable(self, library, fndesc, env):
        flags = ConfigStack.top_or_none()
        is_device_function = flags is not None and flags.no_cpython_wrapper and flags.no_cfunc_wrapper
        if is_device_function and not library._finalized:
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
