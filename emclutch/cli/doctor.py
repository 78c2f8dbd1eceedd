"""`emclutch doctor`: what of the program's needs this machine has."""

from __future__ import annotations

import os
import shutil
import sys
from importlib import import_module, metadata
from pathlib import Path

from emclutch import __version__
from emclutch.results.report.report import Report, Shown, Table

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


def examine() -> tuple[Report, bool]:
    """Findings, and whether all that is needed is there."""
    rows, good = [("emclutch", __version__, "ok"), ("python", sys.version.split()[0], "ok")], True
    for name, module in NEEDED.items():
        try:
            import_module(module)
            rows.append((name, metadata.version(name), "ok"))
        except (ImportError, OSError) as error:  # OSError: a shared library that gmsh loads is missing
            good = False
            rows.append((name, "-", str(error)))
    for name, extra, use in OPTIONAL:
        try:
            rows.append((name, metadata.version(name), f"ok: {use}"))
        except metadata.PackageNotFoundError:
            rows.append((name, "-", f"optional, extra {extra}: {use}"))
    rows += [
        ("cores", str(os.cpu_count()), "ok"),
        ("threads of the kernels", str(most_threads() if good else "-"), "ok" if good else "not known"),
        ("memory", _gigabytes(_memory()), "ok"),
        ("free disk here", _gigabytes(shutil.disk_usage(".").free), "ok"),
        ("this folder", str(Path.cwd()), "ok" if os.access(".", os.W_OK) else "read-only: use --out"),
    ]
    report = Report("What this machine has", data={name: [found, state] for name, found, state in rows})
    return report.add("Packages and machine", Table(rows, ("", "found", "")), Shown.TERMINAL), good


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
