"""Rounds of scene A, ours and LAMMPS', each a process of its own that loads the same start state and says what it took.

LAMMPS may live in another environment than ours, whose interpreter is then named by EMCLUTCH_LAMMPS_PYTHON.
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


def ways_of_two_threads() -> tuple[str, ...]:
    """In which ways LAMMPS can use two cores here: "omp", and "mpi" where there is an mpiexec."""
    return ("omp", "mpi") if shutil.which(str(Path(PEER).parent / "mpiexec")) else ("omp",)


def ours(state: Path, threads: int, steps: int, windows: int) -> dict:
    """Our answer (`scene_a.measure`) after `windows` of `steps` from the state in a file."""
    command = [sys.executable, str(HERE / "scene_a.py"), str(state), "--steps", str(steps), "--windows", str(windows)]
    return json.loads(_answer(command, threads).splitlines()[-1])


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


def _answer(command: list[str], threads: int) -> str:
    """What a round says, its threads set by the environment."""
    environment = {
        **os.environ,
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
