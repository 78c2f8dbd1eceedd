"""What a step of the DEM costs: against the number of grains, and against what a scene asks for.

    python tests/benchmarks/dem_cost.py FOLDER [--most 1000000]

FOLDER holds settled_1000.npz, settled_10000.npz and settled_100000.npz (`scene_a.write_state`; made where they are
missing, the last one in some minutes). Beds above 100 000 grains are that bed side by side. Nanoseconds a grain and
step are processor time, the least of some windows of scene A: gravity turns, the bed rolls over, lists are rebuilt.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import scene_a

from geometry import Box
from particles import (
    DEM,
    Body,
    Cohesion,
    Elastic,
    Grains,
    HertzMindlin,
    LinearContact,
    RollingFriction,
    TwistingFriction,
    WaltonBraun,
)  # fmt: skip

STEP = 0.6 * scene_a.TIME_STEP  # every law below takes it
HERTZIAN = HertzMindlin.from_restitution(Elastic(1.8e6, 0.3), scene_a.RESTITUTION, scene_a.FRICTION)
PARTS: dict[str, dict] = {
    "linear": {},
    "linear, energy budget": {"energy_budget": True},
    "linear, rolling": {"rolling": RollingFriction(0.1)},
    "linear, rolling, energy budget": {"rolling": RollingFriction(0.1), "energy_budget": True},
    "linear, rolling and twisting": {"rolling": RollingFriction(0.1), "twisting": TwistingFriction(0.05)},
    "linear, cohesion": {"cohesion": Cohesion.constant(1e-5)},
    "linear, sizes differ by 1e-9": {"spread": 1e-9},
    "Hertz-Mindlin": {"law": HERTZIAN},
    "Walton-Braun": {"law": WaltonBraun.from_restitution(scene_a.STIFFNESS, scene_a.RESTITUTION, scene_a.FRICTION)},
}


def bed(folder: Path, n: int) -> tuple[np.ndarray, Box]:
    """Centres (n, 3) [m] of a settled bed, and its box."""
    one = min(n, 100_000)
    path = folder / f"settled_{one}.npz"
    if not path.exists():
        scene_a.write_state(path, one)
    with np.load(path) as file:
        where = file["position"]
    size, copies = np.array(scene_a.box(one).size), n // one
    along = [k for k in range(1, copies + 1) if copies % k == 0 and k * k <= copies][-1]
    shifts = [(i * size[0], j * size[1], 0.0) for i in range(along) for j in range(copies // along)]
    where = np.concatenate([where + shift for shift in shifts])
    full = size * [along, copies // along, 1.0]
    return where - [*(0.5 * (full[:2] - size[:2])), 0.0], Box(tuple(full))


def cost(
    folder: Path, n: int, law=None, spread: float = 0.0, energy_budget: bool = False, windows: int = 6, **parts
) -> tuple[float, float, float]:
    """(ns a grain and step, coordination, bytes a grain of the arrays that stay)."""
    where, box = bed(folder, n)
    radius = 0.5 * scene_a.DIAMETER * (1.0 + spread * np.random.default_rng(1).random(len(where)))
    law = law or LinearContact.from_restitution(scene_a.STIFFNESS, scene_a.RESTITUTION, scene_a.FRICTION)
    dem = DEM(
        Grains.create(where, radius, scene_a.DENSITY), box.walls(), [Body("housing")], law, dt=STEP,
        gravity=scene_a.gravity, overlap_limit=scene_a.OVERLAP_LIMIT, energy_budget=energy_budget, **parts,
    )  # fmt: skip
    dem.run(max(40, 2_000_000 // n))
    steps, least = max(20, 1_000_000 // n), np.inf
    for _ in range(windows):
        begin = time.process_time()
        totals = dem.run(steps)
        least = min(least, time.process_time() - begin)
    kept = sum(array.nbytes for array in dem.state().values())
    return least / steps / n * 1e9, 2.0 * totals.n_contacts / n, kept / n


def main() -> None:
    """Two tables."""
    parser = argparse.ArgumentParser(description="cost of a step of the DEM")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--most", type=int, default=1_000_000)
    given = parser.parse_args()
    print(f"{'grains':>9} {'ns':>7} {'Z':>6} {'B/grain':>8}")
    for n in (1000, 10_000, 100_000, 1_000_000):
        if n <= given.most:
            print("{:9d} {:7.1f} {:6.2f} {:8.0f}".format(n, *cost(given.folder, n)), flush=True)
    print(f"\n{'10 000 grains':32} {'ns':>7} {'Z':>6} {'B/grain':>8}")
    for name, parts in PARTS.items():
        print("{:32} {:7.1f} {:6.2f} {:8.0f}".format(name, *cost(given.folder, 10_000, **parts)), flush=True)


if __name__ == "__main__":
    main()
