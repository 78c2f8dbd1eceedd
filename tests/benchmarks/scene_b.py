"""Scene B, the bed on which rigid-grain codes are compared: scene A times ten, in a box or in a drum.

n steel spheres of 10 mm (7850 kg/m^3), mu 0.3, no rebound, in a closed box L x L x 1.1 L with L^3 = bed at a solid
fraction of 0.58, under gravity that turns at 3.16 Hz (10 Hz/sqrt(10), the Froude number of scene A); or in a closed
drum round that box (length 1.1 L, radius 0.71 L and 6 mm: half full) that turns at 60 rpm. Step 1 ms: "x real" is
simulated over processor time. At 60 rpm omega^2 R/g in the drum is 0.2 for 200 grains, 0.3 for 1 000, 0.6 for 10 000
and 1.3 for 100 000: the last bed is flung round.

A row begins from the state after the warm-up (made by 50 exact sweeps a step, the same for all rows) and after ten
steps of its own (three for 100 000 grains). It ends after a turn of gravity, or earlier when its processor time is
spent; "steps" then says how small a part of the turn it saw. Rows that take less than 10 s are run twice, and each
piece counts with its shorter time.

Project Chrono 10 on one core of the same kind of machine, PSOR, 50 iterations, no convergence test: 6.8, 18 and 37 ms a
step for 200, 500 and 1 000 spheres in the box. It solves the convex law and tests no residual, so it answers to our
rows "convex, 50 sweeps" only; our exact rows solve another, harder problem. Siconos' exact solver took seconds a step.

    python tests/benchmarks/scene_b.py --save rows.json
    python tests/benchmarks/scene_b.py --sizes 10000 --seconds 10 --save rows.json
    python tests/benchmarks/scene_b.py --sizes 100000 --warm-up 120 --seconds 20 --save rows.json   # 15 min
    python tests/benchmarks/scene_b.py --sizes --save rows.json --picture picture.png   # all rows so far
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from pathlib import Path

import numpy as np

from geometry import Box
from geometry.time_profile import TimeProfile
from geometry.walls import Wall, annulus, cylinder
from particles import Body, Grains, pack
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact
from particles.dvi.dvi_totals import DviTotals

DIAMETER = 1e-2
DENSITY = 7850.0
FRICTION = 0.3
GRAVITY = 9.81
TURNS_PER_SECOND = 10.0 / np.sqrt(10.0)
BED_FRACTION = 0.58
TIME_STEP = 1e-3
DRUM_SPEED = 2.0 * np.pi  # rad/s: 60 rpm
CHRONO = {200: 6.8, 500: 18.0, 1000: 37.0}  # ms a step in the box

# of steel spheres of 10 mm under their weight: Hertz' k = (6 E*^2 R* F)^(1/3), E* = 115 GPa, R* = 2.5 mm, F = m g
SPRINGS = ((2e6, 4e6 / 7.0), (2e6, 4e6 / 7.0))

WAYS: dict[str, dict] = {
    "convex, 50 sweeps": {"friction_cone": "convex", "solver": "gauss_seidel", "tolerance": 1e-300, "max_sweeps": 50},
    "exact, 50 sweeps": {"solver": "gauss_seidel", "tolerance": 1e-300, "max_sweeps": 50},
    "exact, 1e-3 m/s": {"solver": "accelerated", "tolerance": 1e-3, "max_sweeps": 2000},
    "exact, 1e-4 m/s": {"solver": "accelerated", "tolerance": 1e-4, "max_sweeps": 2000},
    "exact, 1e-6 m/s": {"solver": "accelerated", "tolerance": 1e-6, "max_sweeps": 2000},
    "springs, 1e-6 m/s": {"tolerance": 1e-6, "max_sweeps": 2000, "stiffness": SPRINGS},
}
# the most grains for which a row is made unless it is asked for by name
LARGEST = {"exact, 1e-4 m/s": 10_000, "exact, 1e-6 m/s": 1000}


def side(n: int) -> float:
    """L [m] of the bed of ``n`` grains."""
    return float((n * np.pi / 6.0 / BED_FRACTION) ** (1.0 / 3.0)) * DIAMETER


def gravity(moments: np.ndarray) -> np.ndarray:
    """Acceleration (k, 3) [m/s^2] in the box at moments (k,) [s]."""
    angle = 2.0 * np.pi * TURNS_PER_SECOND * moments
    return GRAVITY * np.column_stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)])


def box(n: int) -> Box:
    """The closed box of ``n`` grains."""
    return Box((side(n), side(n), 1.1 * side(n)))


def drum(n: int) -> tuple[list[Wall], Body]:
    """The closed drum of ``n`` grains, its axis z level, and the body that turns it."""
    half = 0.5 * side(n)
    radius = np.sqrt(2.0) * half + 0.6 * DIAMETER
    length = 2.2 * half + 0.2 * DIAMETER
    walls: list[Wall] = [
        cylinder("shell", "drum", radius, 0.0, length),
        annulus("low", "drum", 0.0, 0.0, radius),
        annulus("high", "drum", length, 0.0, radius),
    ]
    return walls, Body("drum", TimeProfile.constant(DRUM_SPEED))


def bed(n: int, seed: int = 1) -> np.ndarray:
    """Loose start positions (n, 3) [m] in the box."""
    room = Box((side(n), side(n), 1.09 * side(n)))
    return pack(room, room.walls(), n, 0.5 * DIAMETER, seed=seed)


def in_box(n: int, start: np.ndarray, **way) -> DVI:
    """The box under gravity that turns."""
    grains = Grains.create(start, 0.5 * DIAMETER, DENSITY)
    given: dict = {"dt": TIME_STEP, "gravity": gravity} | way
    return DVI(grains, box(n).walls(), [Body("housing")], DviContact(FRICTION), **given)


def in_drum(n: int, start: np.ndarray, **way) -> DVI:
    """The drum round the same bed."""
    walls, body = drum(n)
    grains = Grains.create(start + np.array([0.0, 0.0, 0.1 * DIAMETER]), 0.5 * DIAMETER, DENSITY)
    given: dict = {"dt": TIME_STEP, "gravity": (0.0, -GRAVITY, 0.0)} | way
    return DVI(grains, walls, [body], DviContact(FRICTION), **given)


VESSELS = {"box": in_box, "drum": in_drum}


def landed(n: int, vessel: str, warm_up: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Start positions (n, 3) [m], and the state after ``warm_up`` steps of 50 exact sweeps."""
    start = bed(n)
    dvi = VESSELS[vessel](n, start, **WAYS["exact, 50 sweeps"])
    dvi.run(warm_up)
    return start, dvi.state()


def measure(
    n: int, vessel: str, way: dict, start: np.ndarray, state: dict[str, np.ndarray], steps: int, seconds: float
) -> dict[str, float]:
    """Processor time [ms] a step and what the solver did, from ``state`` on for ``steps`` steps or ``seconds``."""
    piece = max(1, min(10, 10_000 // n))
    VESSELS[vessel](200, bed(200), **way).run(1)  # compiles, or loads what was compiled
    least: list[float] = []
    for _ in range(2):
        dvi = VESSELS[vessel](n, start, **way)
        dvi.restore(state)
        dvi.run(min(10, 300_000 // n))
        parts: list[DviTotals] = []
        spent: list[float] = []
        while len(parts) * piece < steps and sum(spent) < seconds:
            began = time.process_time()
            parts.append(dvi.run(piece))
            spent.append(time.process_time() - began)
        least = [min(pair) for pair in zip(least, spent, strict=False)] or spent
        if sum(spent) > 10.0:
            break
    parts = parts[: len(least)]
    done, visits, sweeps = len(parts) * piece, sum(t.visits for t in parts), sum(t.sweeps for t in parts)
    return {
        "steps": done,
        "ms": 1e3 * sum(least) / done,
        "ns": 1e9 * sum(least) / max(visits, 1),
        "sweeps": sweeps / done,
        "contacts": float(np.mean([t.n_contacts for t in parts])),
        "candidates": visits / max(sweeps, 1),
        "residual": float(np.median([t.residual for t in parts])),
        "worst": max(t.residual for t in parts),
        "missed": sum(t.missed_steps for t in parts) / done,
        "warm": float(np.mean([t.warm_hits for t in parts])),
        "overlap": max(t.max_overlap for t in parts),
    }


def draw(rows: dict[str, dict], path: Path) -> None:
    """Milliseconds and sweeps a step against the number of grains."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    colours = dict(zip(WAYS, ("#808080", "#c0a030", "#0b5fa5", "#2a8c3f", "#d9730d", "#b02020"), strict=True))
    figure, axes = plt.subplots(1, 2, figsize=(11.0, 4.8), layout="constrained")
    for way, colour in colours.items():
        for vessel, line in (("box", "-"), ("drum", "--")):
            table = sorted((r for r in rows.values() if (r["way"], r["vessel"]) == (way, vessel)), key=lambda r: r["n"])
            for axis, key in zip(axes, ("ms", "sweeps"), strict=True):
                axis.loglog([r["n"] for r in table], [r[key] for r in table], line, color=colour, marker="o", ms=4,
                            label=way if vessel == "box" else None)  # fmt: skip
    axes[0].loglog(list(CHRONO), list(CHRONO.values()), "k*", ms=9, ls="none", label="Chrono 10, PSOR, 50 iterations")
    axes[0].axhline(1e3 * TIME_STEP, color="#404040", lw=0.8, ls=":")
    axes[0].annotate("real time", (0.99, 1e3 * TIME_STEP), xycoords=("axes fraction", "data"), ha="right", va="bottom")
    axes[0].set_ylabel("processor time [ms a step of 1 ms]")
    axes[1].set_ylabel("sweeps a step")
    axes[0].set_title("scene B, one thread; box solid, drum dashed", loc="left", fontsize=10)
    axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    for axis in axes:
        axis.set_xlabel("grains")
        axis.grid(alpha=0.25, which="both")
    figure.savefig(path, dpi=150)


def main() -> None:
    """The table, and the picture where a name for it is given."""
    parser = argparse.ArgumentParser(description="scene B")
    parser.add_argument("--sizes", type=int, nargs="*", default=[200, 500, 1000])
    parser.add_argument("--steps", type=int, default=320, help="at most; a turn of gravity is 316")
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time, after which a row ends")
    parser.add_argument("--warm-up", type=int, default=200)
    parser.add_argument("--vessels", nargs="+", choices=tuple(VESSELS), default=list(VESSELS))
    parser.add_argument("--ways", nargs="+", choices=tuple(WAYS))
    parser.add_argument("--save", type=Path, help="file of rows, added to")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    rows = json.loads(given.save.read_text()) if given.save and given.save.exists() else {}
    print(f"{platform.machine()}, {os.cpu_count()} cores; processor time of one thread; step 1 ms")
    print(
        f"{'vessel':6} {'grains':>6} {'way':24} {'steps':>5} {'ms/step':>8} {'x real':>7} {'Chrono/':>7} {'sweeps':>7}"
        f" {'loaded':>7} {'visited':>8} {'ns':>5} {'residual':>9} {'worst':>8} {'missed':>6} {'warm':>5} {'overlap':>8}"
    )
    for vessel, n in ((vessel, n) for vessel in given.vessels for n in given.sizes):
        start, state = landed(n, vessel, given.warm_up)
        for way in given.ways or [w for w in WAYS if n <= LARGEST.get(w, n)]:
            m = measure(n, vessel, WAYS[way], start, state, given.steps, given.seconds)
            rows[f"{vessel} {n} {way}"] = {"vessel": vessel, "n": n, "way": way, "warm_up": given.warm_up, **m}
            print(line(rows[f"{vessel} {n} {way}"]), flush=True)
            if given.save:
                given.save.write_text(json.dumps(rows, indent=1))
    if not given.sizes:
        print("\n".join(line(row) for row in rows.values()))
    if given.picture:
        draw(rows, given.picture)


def line(m: dict) -> str:
    """A row of the table."""
    peer = CHRONO.get(m["n"], float("nan")) / m["ms"] if m["vessel"] == "box" else float("nan")
    return (
        f"{m['vessel']:6} {m['n']:6d} {m['way']:24} {m['steps']:5d} {m['ms']:8.2f} {1e3 * TIME_STEP / m['ms']:7.3f} "
        f"{peer:7.1f} {m['sweeps']:7.1f} {m['contacts']:7.0f} {m['candidates']:8.0f} {m['ns']:5.1f} "
        f"{m['residual']:9.1e} {m['worst']:8.1e} {m['missed']:6.2f} {m['warm']:5.2f} {m['overlap']:8.1e}"
    )


if __name__ == "__main__":
    main()
