"""`emclutch doctor`: what of the program's needs this machine has."""

from __future__ import annotations

import os
import shutil
import sys
from importlib import import_module, metadata
from pathlib import Path

from rich.table import Table

from emclutch import __version__

NEEDED = {
    "scikit-fem": "skfem",
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "gmsh": "gmsh",
    "h5py": "h5py",
    "pydantic": "pydantic",
    "pint": "pint",
    "pandas": "pandas",
    "matplotlib": "matplotlib",
    "pyvista": "pyvista",
}
"""Distributions and the modules that they bring."""

OPTIONAL = (
    ("cvxopt", "fast", "sparse factorisation 5 to 7 times as fast"),
    ("pyamg", "solid", "multigrid for the field in 3D"),
)
"""Distribution, the extra that it belongs to, what it is for."""


def examine() -> tuple[Table, bool]:
    """Findings, and whether all that is needed is there."""
    table, good = Table("", "found", ""), True
    table.add_row("emclutch", __version__, "ok")
    table.add_row("python", sys.version.split()[0], "ok")
    for name, module in NEEDED.items():
        try:
            import_module(module)
            table.add_row(name, metadata.version(name), "ok")
        except (ImportError, OSError) as error:  # OSError: a shared library that gmsh loads is missing
            good = False
            table.add_row(name, "-", str(error))
    for name, extra, use in OPTIONAL:
        try:
            table.add_row(name, metadata.version(name), f"ok: {use}")
        except metadata.PackageNotFoundError:
            table.add_row(name, "-", f"optional, extra {extra}: {use}")
    table.add_row("cores", str(os.cpu_count()), "ok")
    table.add_row("threads of the kernels", str(most_threads() if good else "-"), "ok" if good else "not known")
    table.add_row("memory", _gigabytes(_memory()), "ok")
    table.add_row("free disk here", _gigabytes(shutil.disk_usage(".").free), "ok")
    table.add_row("this folder", str(Path.cwd()), "ok" if os.access(".", os.W_OK) else "read-only: use --out")
    return table, good


def most_threads() -> int:
    """The largest number of threads that the compiled kernels take."""
    import numba

    return int(getattr(numba.config, "NUMBA_NUM_THREADS"))  # noqa: B009 (numba's stubs hide it)


def _memory() -> int | None:
    """Memory of the machine [bytes]; None where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError):
        return None


def _gigabytes(size: int | None) -> str:
    return "not known" if size is None else f"{size / 1e9:.0f} GB"
