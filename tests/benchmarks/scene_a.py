"""Scene A, the bed on which the speed of grain codes is compared, and our side of the comparison.

n spheres of 1 mm and 7850 kg/m^3 lie in a closed box L x L x 1.1 L with L^3 = bed at a solid fraction of 0.58. Gravity
turns at 10 Hz in the xz plane, so that the bed rolls over for ever. Linear law with tangential history: k_n = 100 N/m,
k_t = 2/7 k_n, restitution 0.5 (damping solved for a force that never pulls), gamma_t = gamma_n/2, mu = 0.3; dt is 1/25
of the contact time pi/sqrt(omega^2 - (gamma/2)^2) at the usual damping of e = 0.5.

A start state is a file of positions, velocities and spins. Springs start at zero for everybody, which is why a round
begins with some steps that are not timed.

    python tests/benchmarks/scene_a.py STATE.npz --steps 1000        # one round, answered as one line of JSON
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from geometry import Box
from particles import DEM, Body, ContactLaw, Grains, LinearContact, pack

DIAMETER = 1e-3
DENSITY = 7850.0
STIFFNESS = 100.0
RESTITUTION = 0.5
FRICTION = 0.3
GRAVITY = 9.81
TURNS_PER_SECOND = 10.0
BED_FRACTION = 0.58
TIME_STEP = 18.45e-6
OVERLAP_LIMIT = 0.3  # of the diameter: the bed of 100 000 lands on a spring that is as soft as asked
SETTLING = 0.08  # s at constant gravity, at a restitution of 0.1: poured grains come to rest


def side(n: int) -> float:
    """L [m] of the bed of ``n`` grains."""
    return float((n * np.pi / 6.0 / BED_FRACTION) ** (1.0 / 3.0)) * DIAMETER


def box(n: int) -> Box:
    """The closed box of ``n`` grains."""
    return Box((side(n), side(n), 1.1 * side(n)))


def contact() -> LinearContact:
    """The law of all contacts."""
    return LinearContact.from_restitution(STIFFNESS, RESTITUTION, FRICTION)


def gravity(moment: np.ndarray) -> np.ndarray:
    """Acceleration (k, 3) [m/s^2] at moments (k,) [s]."""
    angle = 2.0 * np.pi * TURNS_PER_SECOND * moment
    return GRAVITY * np.column_stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)])


def warm_up_steps(n: int) -> int:
    """Steps of a round before the clock starts: springs load, a small bed has rolled over, a large one has not."""
    return max(300, 10_000_000 // n)


def make(
    n: int,
    positions: np.ndarray,
    velocities: np.ndarray | None = None,
    spins: np.ndarray | None = None,
    law: ContactLaw | None = None,
) -> DEM:
    """Our simulation in the box of ``n`` grains, with grains at ``positions`` (any number, 3) [m].

    Without the energy budget, which no peer keeps.
    """
    grains = Grains.create(positions, 0.5 * DIAMETER, DENSITY, velocity=velocities, angular_velocity=spins)
    return DEM(grains, box(n).walls(), [Body("housing")], law or contact(), dt=TIME_STEP,
               gravity=(0.0, 0.0, -GRAVITY), overlap_limit=OVERLAP_LIMIT, energy_budget=False)  # fmt: skip


def advance(dem: DEM, n_steps: int, begin: float, turning: bool = True) -> float:
    """Run ``n_steps`` under gravity that turns from the moment ``begin`` [s]; returns the moment at the end."""
    since = begin - dem.time
    if turning:
        dem.gravity = lambda times: gravity(times + since)
    dem.run(n_steps)
    return begin + n_steps * TIME_STEP


def write_state(path: Path, n: int, seed: int = 1) -> None:
    """Pour ``n`` grains, let them settle at gravity that does not turn yet, and write the state in which they are."""
    bed = Box((side(n), side(n), 1.09 * side(n)))
    start = pack(bed, bed.walls(), n, 0.5 * DIAMETER, seed=seed)
    dem = make(n, start, law=LinearContact.from_restitution(STIFFNESS, 0.1, FRICTION))
    advance(dem, round(SETTLING / TIME_STEP), 0.0, turning=False)
    order = np.argsort(dem.grains.particle_id)
    np.savez(
        path,
        position=dem.grains.position[order],
        velocity=dem.grains.velocity[order],
        spin=dem.grains.angular_velocity[order],
        moment=0.0,
    )


def peer_scene(state: Path, n: int) -> dict[str, Any]:
    """Scene A in the parameters of LAMMPS: lengths [m], gamma [1/s] a unit of effective mass, skin in diameters."""
    law, mass, bed = contact(), np.pi / 6.0 * DENSITY * DIAMETER**3, box(n)
    rate = 2.0 * float(np.sqrt(law.stiffness_n / mass))  # of a wall; sqrt(2) more between two equal grains
    return {
        "state": str(state),
        "lower": bed.lower.tolist(),
        "upper": bed.upper.tolist(),
        "diameter": DIAMETER,
        "density": DENSITY,
        "k_n": law.stiffness_n,
        "k_t": law.stiffness_t,
        "gamma_n": law.damping_n * rate * float(np.sqrt(2.0)),
        "gamma_t": law.damping_t * rate * float(np.sqrt(2.0)),
        "wall_gamma_n": law.damping_n * rate,
        "wall_gamma_t": law.damping_t * rate,
        "friction": law.friction,
        "dt": TIME_STEP,
        "gravity": GRAVITY,
        "turns_per_second": TURNS_PER_SECOND,
        "limit_damping": True,
        "warm_up": warm_up_steps(n),
        "newton": "off",
        "skin": 0.25,
    }


def bed_numbers(n: int, partners: int, overlap: float, kinetic: float) -> dict[str, float]:
    """What tells whether two codes have simulated the same bed; every code hands in the same three sums."""
    return {
        "coordination": 2.0 * partners / n,
        "overlap": overlap / max(partners, 1) / DIAMETER,
        "kinetic": kinetic / n,
    }


def measure(state: Path, steps: int, windows: int) -> dict[str, Any]:
    """One round of ours: load, warm up, and time windows of ``steps``, one after the other."""
    with np.load(state) as start:
        position, velocity, spin, moment = (start[name] for name in ("position", "velocity", "spin", "moment"))
    n = len(position)
    advance(make(n, position, velocity, spin), 2, 0.0)  # compiles or loads what was compiled
    before = resident()
    dem = make(n, position, velocity, spin)
    now = advance(dem, warm_up_steps(n), float(moment))
    seconds, busy, lists = [], [], dem.list_version
    for _ in range(windows):
        began, used_before = time.perf_counter(), time.process_time()
        now = advance(dem, steps, now)
        seconds.append(time.perf_counter() - began)
        busy.append(time.process_time() - used_before)
    memory = (resident() - before) / n
    table = dem.contacts()
    pairs = table.j >= 0
    return {
        "seconds": seconds,
        "cpu_seconds": busy,
        "memory": memory,
        "steps_per_list": steps * windows / max(dem.list_version - lists, 1),
        **bed_numbers(n, int(pairs.sum()), float(table.overlap[pairs].sum()), dem.grains.kinetic_energy()),
    }


def resident() -> float:
    """Memory of this process [B]; 0 where the system does not tell."""
    statm = Path("/proc/self/statm")
    return 4096.0 * int(statm.read_text().split()[1]) if statm.exists() else 0.0


def main() -> None:
    """One round, as one line of JSON."""
    parser = argparse.ArgumentParser(description="one round of scene A")
    parser.add_argument("state", type=Path)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--windows", type=int, default=3)
    given = parser.parse_args()
    json.dump(measure(given.state, given.steps, given.windows), sys.stdout)


if __name__ == "__main__":
    main()
