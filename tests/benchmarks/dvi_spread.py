"""What the contact laws leave open: the torque of one step, solved from several starts, in a bed that shears.

Spheres of 8 to 10 mm (mu 0.4, no rebound) are sheared between a core that turns and a drum that has a prescribed speed
or is a free shaft. "open": they lie on the floor, with a free surface. "packed": the axis is level, and they fill most
of the ring between floor and lid. At each sampled step the same contact problem is solved from no impulses (cold), from
those of the step before (warm), and from these times random numbers from 0 to 2, contact by contact (perturbed).

Under the convex law velocities, and with them a free shaft's speed, are unique; under exact Coulomb friction neither
these nor the torque need be. Printed for each bed: the mean size of the torque on the drum; its spread over the starts
(largest less smallest, as a fraction of that size), mean, median and largest of the steps that met the tolerance from
every start, and how many of these spread by more than 1e-4; the spread of the least certain contact force, as a chunk
of the largest force; how many steps missed the tolerance from some start, and the largest natural map. Some minutes.

    python tests/benchmarks/dvi_spread.py [--sizes 60 120] [--steps 20] [--tolerance 1e-8]
"""

from __future__ import annotations

import argparse
from itertools import product

import numpy as np

from geometry.time_profile import TimeProfile
from geometry.walls import AnnularBox, annulus, cylinder
from particles import Body, FreeShaft, Grains, pack
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

RADIUS = 5e-3  # of the largest [m]
DENSITY = 7850.0
FRICTION = 0.4
GRAVITY = 9.81
TIME_STEP = 1e-3
CORE = 12e-3  # radii of core and drum [m]
CORE_SPEED = 20.0  # [rad/s]
STARTS = ("cold", "warm", "perturbed", "perturbed", "perturbed")
SETTLING = 300  # steps
PACKED = 0.4  # solid fraction of full-sized spheres


def bed(n: int, vessel: str, friction: str, free: bool, tolerance: float, seed: int = 1) -> DVI:
    """``n`` grains after `SETTLING` steps."""
    if vessel == "open":
        drum, high, down = float(np.sqrt(CORE**2 + 1.4 * n * RADIUS**2)), 14.0 * RADIUS, (0.0, 0.0, -GRAVITY)
    else:
        drum, down = 3.5 * CORE, (0.0, -GRAVITY, 0.0)
        high = n * 4.0 / 3.0 * RADIUS**3 / (drum**2 - CORE**2) / PACKED + RADIUS
    walls = [
        cylinder("core", "core", CORE, 0.0, high), cylinder("shell", "drum", drum, 0.0, high),
        annulus("low", "drum", 0.0, CORE, drum), annulus("high", "drum", high, CORE, drum),
    ]  # fmt: skip
    where = pack(AnnularBox(CORE, drum, 0.0, high), walls, n, RADIUS, seed=seed)
    grains = Grains.create(where, RADIUS * np.random.default_rng(seed).uniform(0.8, 1.0, n), DENSITY)
    # as heavy as the bed: it takes up speed slowly
    shaft = FreeShaft(float(grains.mass.sum()) * drum**2) if free else TimeProfile.constant(0.0)
    bodies = [Body("core", TimeProfile.constant(CORE_SPEED)), Body("drum", shaft)]
    dvi = DVI(grains, walls, bodies, DviContact(FRICTION), dt=TIME_STEP, gravity=down,
              friction_cone=friction, tolerance=1e-6, max_sweeps=5000)  # fmt: skip
    dvi.run(SETTLING)
    dvi.tolerance, dvi.max_sweeps = tolerance, 20_000
    return dvi


def forces(dvi: DVI) -> dict[tuple[int, int], np.ndarray]:
    """Contact forces [N] by the numbers of the grains; walls have negative numbers."""
    table, number = dvi.contacts(), dvi.grains.particle_id
    found = {}
    for i, j, wall, force in zip(table.i, table.j, table.wall, table.force, strict=True):
        a, b = int(number[i]), int(number[j]) if j >= 0 else -1 - int(wall)
        found[max(a, b), min(a, b)] = force if a > b else -force
    return found


def measure(n: int, vessel: str, friction: str, free: bool, steps: int, tolerance: float) -> dict[str, float]:
    """Spreads over the starts at ``steps`` steps, ten apart."""
    dvi = bed(n, vessel, friction, free, tolerance)
    rng = np.random.default_rng(0)
    torques, contacts, residuals, missed = [], [], [], []
    for _ in range(steps):
        begin = dvi.state()
        seen, loads, worst, misses = [], [], 0.0, 0
        for start in STARTS:
            state = dict(begin)
            for name in ("list_pair_impulse", "list_wall_impulse"):
                size = (len(state[name]), 1)
                state[name] = state[name] * {"cold": 0.0, "warm": 1.0}.get(start, rng.uniform(0.0, 2.0, size))
            dvi.restore(state)
            totals = dvi.run(1)
            seen.append(totals.torque_on("drum"))
            loads.append(forces(dvi))
            worst, misses = max(worst, totals.residual), max(misses, totals.missed_steps)
        largest = max(float(np.linalg.norm(f)) for load in loads for f in load.values())
        keys = sorted({key for load in loads for key in load})
        table = np.array([[load.get(key, np.zeros(3)) for key in keys] for load in loads])
        contacts.append(float(np.linalg.norm(np.ptp(table, axis=0), axis=1).max()) / largest)
        torques.append(seen)
        residuals.append(worst)
        missed.append(misses)
        dvi.restore(begin)
        dvi.run(10)
    torque, met = np.array(torques), ~np.array(missed, dtype=bool)
    size = float(np.mean(np.abs(torque)))
    spread = np.ptp(torque, axis=1)[met] / size if met.any() else np.array([np.nan])
    force = float(np.mean(np.array(contacts)[met])) if met.any() else np.nan
    return {
        "torque": size, "mean": float(spread.mean()), "median": float(np.median(spread)), "most": float(spread.max()),
        "open": float(np.mean(spread > 1e-4)), "force": force, "missed": float(np.mean(~met)),
        "residual": max(residuals),
    }  # fmt: skip


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description="spread of the torque of a step over the starts of the solver")
    parser.add_argument("--sizes", type=int, nargs="+", default=[60, 120])
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--tolerance", type=float, default=1e-8, help="[m/s]")
    given = parser.parse_args()
    print(f"{given.steps} steps, {len(STARTS)} starts each, tolerance {given.tolerance:g} m/s; spreads as shares")
    print(
        f"{'grains':>6} {'bed':6} {'law':8} {'drum':10} {'|T| mN m':>9} {'mean':>8} {'median':>8} {'largest':>8} "
        f"{'>1e-4':>6} {'force':>8} {'missed':>6} {'residual':>9}"
    )
    for n in given.sizes:
        for vessel, friction, free in product(("open", "packed"), ("coulomb", "convex"), (False, True)):
            m = measure(n, vessel, friction, free, given.steps, given.tolerance)
            print(
                f"{n:6d} {vessel:6} {friction:8} {'free' if free else 'prescribed':10} {1e3 * m['torque']:9.4f} "
                f"{m['mean']:8.1e} {m['median']:8.1e} {m['most']:8.1e} {m['open']:6.0%} {m['force']:8.1e} "
                f"{m['missed']:6.0%} {m['residual']:9.1e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
