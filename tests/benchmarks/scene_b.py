"""Scene B, the bed on which rigid-grain codes are compared: scene A times ten, in a box or in a drum.

n steel spheres of 10 mm (7850 kg/m^3), mu 0.3, no rebound, in a closed box L x L x 1.1 L with L^3 = bed at a solid
fraction of 0.58, under gravity that turns at 3.16 Hz (10 Hz/sqrt(10), the Froude number of scene A); or in a closed
drum of the same volume (as long as its radius) that turns at 60 rpm. Step 1 ms.

Project Chrono 10 on one core of the same kind of machine, PSOR, 50 iterations, no convergence test: 6.8, 18 and 37 ms a
step for 200, 500 and 1 000 spheres. It solves the convex law and tests no residual, so it answers to our rows
"convex, 50 sweeps" only; our exact rows solve another, harder problem.

    python tests/benchmarks/scene_b.py [--sizes 200 500 1000] [--steps 400] [--vessel box]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from geometry import Box
from geometry.walls import annulus, cylinder
from particles import Body, Grains, PrescribedSpeed, pack
from particles.dvi.dvi import DVI
from particles.dvi.rigid_contact import RigidContact

DIAMETER = 1e-2
DENSITY = 7850.0
FRICTION = 0.3
GRAVITY = 9.81
TURNS_PER_SECOND = 10.0 / np.sqrt(10.0)
BED_FRACTION = 0.58
TIME_STEP = 1e-3
DRUM_SPEED = 2.0 * np.pi  # rad/s: 60 rpm
CHRONO = {200: 6.8, 500: 18.0, 1000: 37.0}  # ms a step

WAYS: dict[str, dict] = {
    "convex, 50 sweeps": {"friction": "convex", "solver": "gauss_seidel", "tolerance": 1e-300, "max_sweeps": 50},
    "convex, PSOR, 50 sweeps": {"friction": "convex", "solver": "psor", "tolerance": 1e-300, "max_sweeps": 50},
    "exact, 50 sweeps": {"solver": "gauss_seidel", "tolerance": 1e-300, "max_sweeps": 50},
    "exact, 1e-3 m/s": {"solver": "accelerated", "tolerance": 1e-3, "max_sweeps": 2000},
    "exact, 1e-4 m/s": {"solver": "accelerated", "tolerance": 1e-4, "max_sweeps": 2000},
    "exact, 1e-6 m/s": {"solver": "accelerated", "tolerance": 1e-6, "max_sweeps": 2000},
}


def side(n: int) -> float:
    """L [m] of the bed of ``n`` grains."""
    return float((n * np.pi / 6.0 / BED_FRACTION) ** (1.0 / 3.0)) * DIAMETER


def gravity(moment: float) -> np.ndarray:
    """Acceleration [m/s^2] at ``moment`` [s] in the box."""
    angle = 2.0 * np.pi * TURNS_PER_SECOND * moment
    return GRAVITY * np.array([np.sin(angle), 0.0, -np.cos(angle)])


def bed(n: int, seed: int = 1) -> np.ndarray:
    """Loose start positions (n, 3) [m] in the box."""
    box = Box((side(n), side(n), 1.09 * side(n)))
    return pack(box, box.walls(), n, 0.5 * DIAMETER, seed=seed)


def in_box(n: int, start: np.ndarray, **way) -> tuple[DVI, Callable[[float], np.ndarray]]:
    """The box, and its gravity against time."""
    box = Box((side(n), side(n), 1.1 * side(n)))
    grains = Grains.create(start, 0.5 * DIAMETER, DENSITY)
    dvi = DVI(grains, box.walls(), [Body("housing")], RigidContact(FRICTION), dt=TIME_STEP, gravity=gravity(0.0), **way)
    return dvi, gravity


def in_drum(n: int, start: np.ndarray, **way) -> tuple[DVI, Callable[[float], np.ndarray]]:
    """A drum round the same bed, its axis z level, and its gravity (constant, along -y)."""
    half = 0.5 * side(n)
    radius = np.sqrt(2.0) * half + 0.6 * DIAMETER
    length = 2.2 * half + 0.2 * DIAMETER
    walls = [
        cylinder("shell", "drum", radius, 0.0, length),
        annulus("low", "drum", 0.0, 0.0, radius),
        annulus("high", "drum", length, 0.0, radius),
    ]
    where = start + np.array([0.0, 0.0, 0.1 * DIAMETER])
    grains = Grains.create(where, 0.5 * DIAMETER, DENSITY)
    drum = Body("drum", PrescribedSpeed.constant(DRUM_SPEED))
    down = np.array([0.0, -GRAVITY, 0.0])
    dvi = DVI(grains, walls, [drum], RigidContact(FRICTION), dt=TIME_STEP, gravity=down, **way)
    return dvi, lambda moment: down


def measure(n: int, vessel: str, way: dict, steps: int, warm_up: int) -> dict[str, float]:
    """Processor time [ms] a step and what the solver did, after ``warm_up`` steps."""
    start = bed(n)
    make = {"box": in_box, "drum": in_drum}[vessel]
    make(n, start, **way)[0].run(1)  # compiles, or loads what was compiled
    dvi, pull = make(n, start, **way)
    parts = []
    spent = 0.0
    for step in range(warm_up + steps):
        dvi.gravity = pull(dvi.time)
        began = time.process_time()
        totals = dvi.run(1)
        if step >= warm_up:
            spent += time.process_time() - began
            parts.append(totals)
    visits = sum(t.visits for t in parts)
    return {
        "ms": 1e3 * spent / steps,
        "ns": 1e9 * spent / max(visits, 1),
        "sweeps": float(np.mean([t.sweeps for t in parts])),
        "contacts": float(np.mean([t.n_contacts for t in parts])),
        "candidates": visits / max(sum(t.sweeps for t in parts), 1),
        "residual": float(np.median([t.residual for t in parts])),
        "worst": max(t.residual for t in parts),
        "missed": float(np.mean([t.missed_steps for t in parts])),
        "warm": float(np.mean([t.warm_hits for t in parts])),
        "overlap": max(t.max_overlap for t in parts),
        "kinetic": float(np.mean([t.books.kinetic_energy for t in parts])),
        "stabilisation": sum(t.stabilisation_work for t in parts),
    }


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description="scene B")
    parser.add_argument("--sizes", type=int, nargs="+", default=[200, 500, 1000])
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--warm-up", type=int, default=200)
    parser.add_argument("--vessel", choices=("box", "drum"), default="box")
    parser.add_argument("--ways", nargs="+", default=list(WAYS))
    given = parser.parse_args()
    print(
        f"scene B in the {given.vessel}: {given.steps} steps of 1 ms after {given.warm_up}; processor time, one thread"
    )
    print(
        f"{'grains':>6} {'way':24} {'ms/step':>8} {'Chrono':>7} {'ratio':>6} {'sweeps':>7} {'loaded':>7} {'visited':>8}"
        f" {'ns':>5} {'residual':>9} {'worst':>8} {'missed':>6} {'warm':>5} {'overlap':>8} {'kinetic J':>9}"
    )
    for n in given.sizes:
        for name in given.ways:
            m = measure(n, given.vessel, WAYS[name], given.steps, given.warm_up)
            peer = CHRONO.get(n, float("nan"))
            print(
                f"{n:6d} {name:24} {m['ms']:8.2f} {peer:7.1f} {peer / m['ms']:6.1f} {m['sweeps']:7.1f} "
                f"{m['contacts']:7.0f} {m['candidates']:8.0f} {m['ns']:5.1f} {m['residual']:9.1e}"
                f" {m['worst']:8.1e} {m['missed']:6.2f} {m['warm']:5.2f} {m['overlap']:8.1e} {m['kinetic']:9.2e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
