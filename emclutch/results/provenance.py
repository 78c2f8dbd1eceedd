"""Provenance of a result: versions, commit, seed, mesh, threads and machine."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = (
    "emclutch numpy scipy numba scikit-fem gmsh meshio h5py pydantic pint typer rich pandas matplotlib pyvista vtk"
).split()


def provenance(
    *,
    seed: int | None = None,
    mesh_hash: str | None = None,
    threads: int | None = None,
    threading_layer: str | None = None,
    input_files: dict[str, dict[str, str]] | None = None,
    grains_from: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return all that a reader needs to repeat a run; what cannot be found out is None.

    Parameters
    ----------
    seed : of the random numbers.
    mesh_hash : sha256 of the field's mesh.
    threads, threading_layer : as used by the kernels; None asks numba's settings, if numba is loaded.
    input_files : key of the scene -> path and sha256 of the file that it names.
    grains_from : folder, time and sha256 of the run whose grains this one began with, in place of a packing.
    """
    numba = sys.modules.get("numba")  # a run without compiled kernels need not load it for this
    if numba is not None:
        threads = numba.get_num_threads() if threads is None else threads
        threading_layer = threading_layer or str(numba.config.THREADING_LAYER)
    return {
        "written": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "command": sys.argv,
        "versions": {name: _version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "commit": _commit(),
        "seed": seed,
        "mesh_hash": mesh_hash,
        "input_files": input_files,
        "grains_from": grains_from,
        "threads": threads,
        "threading_layer": threading_layer,
        "machine": {
            "cpu": cpu_model(),
            "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
            "memory_bytes": _memory_bytes(),
            "platform": platform.platform(),
        },
    }


@cache  # a study asks once a run, and finding them takes 30 ms
def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Return the commit of the checkout that these sources are tracked in, with «-modified» where they differ."""
    here = Path(__file__).resolve()

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(here.parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout.strip()

    try:
        # Installed below a user's own repository the sources are not tracked: its commit says nothing.
        git("ls-files", "--error-unmatch", here.name)
        commit = git("rev-parse", "HEAD")
        top = git("rev-parse", "--show-toplevel")
        changed = git("-C", top, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return None
    return commit + ("-modified" if changed else "")


def cpu_model() -> str | None:
    """Return the name of the processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or None


def _memory_bytes() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None
