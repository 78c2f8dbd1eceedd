"""Rounds of scene A, ours and LAMMPS', each a process of its own that loads the same start state and says what it took.

LAMMPS may live in another environment than ours, whose interpreter is then named by EMCLUTCH_LAMMPS_PYTHON;
geometry/kernels/README.md says how to build it for the processor at hand.
"""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
PEER = os.environ.get("EMCLUTCH_LAMMPS_PYTHON", sys.executable)


@functools.cache
def lammps_version() -> int | None:
    """Version of the LAMMPS that is found where it is looked for; None where it cannot be opened."""
    program = "import lammps_peer; p = lammps_peer.open_lammps(0); print(p.version()); p.close()"
    said = subprocess.run([PEER, "-c", program], cwd=HERE, capture_output=True, text=True, check=False)
    return int(said.stdout.split()[-1]) if said.returncode == 0 else None


@functools.cache
def lammps_build() -> str:
    """What the LAMMPS that is found was built for: the wheel of PyPI has SSE2 alone, no wide registers, no FMA."""
    program = (
        "import lammps, importlib.metadata as m\n"
        "files = m.distribution('lammps').files or []\n"
        "print(any(f.name.startswith('liblammps') or 'lammps.libs' in str(f) for f in files))"
    )
    said = subprocess.run([PEER, "-c", program], cwd=HERE, capture_output=True, text=True, check=False)
    return "wheel, SSE2" if said.returncode == 0 and said.stdout.split()[-1:] == ["True"] else "own build"


def ways_of_two_threads() -> tuple[str, ...]:
    """In which ways LAMMPS can use two cores here: "omp", and "mpi" where there is an mpiexec."""
    return ("omp", "mpi") if shutil.which(str(Path(PEER).parent / "mpiexec")) else ("omp",)


def ours(state: Path, threads: int, steps: int, windows: int, *, avx2: bool = False) -> dict:
    """Our answer (`scene_a.measure`) after `windows` of `steps` from the state in a file.

    With `avx2` kernels are compiled for a processor with AVX2 and FMA, into a cache of their own.
    """
    command = [sys.executable, str(HERE / "scene_a.py"), str(state), "--steps", str(steps), "--windows", str(windows)]
    limited = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(state.parent / "avx2")}
    return json.loads(_answer(command, threads, limited if avx2 else {}).splitlines()[-1])


def theirs(scene: Path, threads: int, steps: int, windows: int, way: str, end: Path | None = None) -> dict:
    """LAMMPS' answer on the scene in a file; ``way``: plain (one process), omp, or mpi (a process a thread)."""
    command = [PEER, str(HERE / "lammps_peer.py"), str(scene), "--steps", str(steps), "--windows", str(windows)]
    if way == "omp":
        command += ["--threads", str(threads)]
    if way == "mpi":
        command = [str(Path(PEER).parent / "mpiexec"), "-n", str(threads), *command]
    if end is not None:
        command += ["--end", str(end)]
    if way == "mpi":
        said = scene.with_suffix(".answer")
        _answer([*command, "--answer", str(said)], 1)
        return json.loads(said.read_text())
    return json.loads(_answer(command, threads if way == "omp" else 1).splitlines()[-1])


def _answer(command: list[str], threads: int, settings: dict[str, str] | None = None) -> str:
    """What a round says, its threads and other settings given by the environment."""
    environment = {
        **os.environ,
        **(settings or {}),
        "NUMBA_NUM_THREADS": str(threads),
        "OMP_NUM_THREADS": str(threads),
        "PYTHONPATH": os.pathsep.join(path for path in [*sys.path, str(HERE.parents[1])] if path),
    }
    if command[0] != sys.executable:
        del environment["PYTHONPATH"]  # another environment finds its own packages
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout.strip()
