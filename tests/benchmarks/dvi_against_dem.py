"""Springs or rigid grains: which is cheaper at which accuracy, on scene B (`scene_b`) in the box and in the drum.

**DEM**: the linear law at restitution 0.1 (0 itself would need an infinite dashpot; an impact keeps 1 % of its energy),
mu 0.3, without energy budget, 20 steps a contact. The step fixes the spring: k = pi^2 m/2/(20 dt)^2, 5.1e3 N/m at the
1e-4 s of the usual comparison, 2.0e6 N/m at 5e-6 s. **DVI**: exact Coulomb, restitution 0, a step h, and either 50
sweeps whatever they reach or a tolerance [m/s] (2 000 sweeps at most).

Single trajectories are chaotic, so what is compared are means over turns of gravity (0.316 s; the drum is cut into the
same pieces):

    kinetic  translation and spin, a grain [uJ]
    power    of gravity on the bed, a grain [mW]; in the drum torque times speed. It is what the contacts dissipate
    offset   of the centre of mass from the vessel's centre, along gravity [mm]: how the bed lies; soft grains sink

Every run starts from a bed poured and moved by DVI for a turn, drops a turn of its own and measures the next. A seed is
a bed; all rows have the same seeds and turns, and errors are differences seed by seed, because a narrow bed remembers
how it was poured: beds may differ by far more than methods do. The reference is the DEM of the shortest step. The bar
is one standard deviation of the mean difference: from the scatter of the differences over the seeds, or from that of
the turns within the seeds, whichever is more. An error below two bars is marked ~: nothing is known of it but that it
is small. Overlaps, largest of the run and mean over the contacts at the ends of turns, are in diameters. Cost is
processor time of one thread for a simulated second.

    python tests/benchmarks/dvi_against_dem.py --sizes 200 --save rows.json
    python tests/benchmarks/dvi_against_dem.py --sizes 1000 --turns 2 --save rows.json
    python tests/benchmarks/dvi_against_dem.py --sizes --save rows.json --picture picture.png  # all rows
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import scene_b

from particles import DEM, Body, Grains, LinearContact
from particles.dvi.dvi import DVI

MASS = np.pi / 6.0 * scene_b.DENSITY * scene_b.DIAMETER**3
RESTITUTION = 0.1
SAMPLE = 4e-3  # s; every step divides it
SAMPLES = 79  # a turn: 0.316 s of 0.3162 s
TURN = SAMPLES * SAMPLE
MAX_SWEEPS = 2000

DEM_STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6)
DVI_WAYS: tuple[tuple[float, float | None], ...] = (  # step, tolerance (None: 50 sweeps)
    (2e-3, None), (1e-3, None), (5e-4, None), (2.5e-4, None),
    (2e-3, 1e-3), (1e-3, 1e-3), (5e-4, 1e-3), (2.5e-4, 1e-3),
    (1e-3, 1e-4), (5e-4, 1e-4), (1e-3, 1e-5),
)  # fmt: skip
QUANTITIES = ("kinetic", "power", "offset")
UNITS = {"kinetic": "uJ a grain", "power": "mW a grain", "offset": "mm"}

Start = tuple[np.ndarray, np.ndarray, np.ndarray]


def stiffness(dt: float) -> float:
    """k [N/m] of a contact between two grains that lasts 20 steps."""
    return float(0.5 * MASS * (np.pi / (20.0 * dt)) ** 2)


def later_gravity(moments: np.ndarray) -> np.ndarray:
    """Gravity (k, 3) [m/s^2] in the box, a turn after the start."""
    return scene_b.gravity(moments + TURN)


def poured(n: int, vessel: str, seed: int) -> Start:
    """Positions, velocities and spins (n, 3) after a turn."""
    dvi = scene_b.VESSELS[vessel](n, scene_b.bed(n, seed), tolerance=1e-3, max_sweeps=MAX_SWEEPS)
    dvi.run(round(TURN / scene_b.TIME_STEP))
    return dvi.grains.position.copy(), dvi.grains.velocity.copy(), dvi.grains.angular_velocity.copy()


def by_dem(n: int, vessel: str, start: Start, dt: float) -> DEM:
    """The scene with springs."""
    grains = Grains.create(start[0], 0.5 * scene_b.DIAMETER, scene_b.DENSITY, velocity=start[1],
                           angular_velocity=start[2])  # fmt: skip
    law = LinearContact.from_restitution(stiffness(dt), RESTITUTION, scene_b.FRICTION)
    if vessel == "drum":
        walls, body = scene_b.drum(n)
        return DEM(grains, walls, [body], law, dt=dt, gravity=(0.0, -scene_b.GRAVITY, 0.0), energy_budget=False)
    return DEM(
        grains, scene_b.box(n).walls(), [Body("housing")], law, dt=dt, gravity=later_gravity, energy_budget=False
    )


def by_dvi(n: int, vessel: str, start: Start, h: float, tolerance: float | None) -> DVI:
    """The scene with rigid grains."""
    way = scene_b.WAYS["exact, 50 sweeps"] if tolerance is None else {"tolerance": tolerance, "max_sweeps": MAX_SWEEPS}
    dvi = scene_b.VESSELS[vessel](n, scene_b.bed(n), dt=h, **way)
    dvi.grains.position[:], dvi.grains.velocity[:], dvi.grains.angular_velocity[:] = start
    dvi.invalidate()
    if vessel == "box":
        dvi.gravity = later_gravity
    return dvi


def turn(scene: DEM | DVI, n: int, vessel: str) -> tuple[dict[str, float], dict[str, float]]:
    """The quantities of a turn, and what it cost and reached."""
    per = round(SAMPLE / scene.dt)
    begin = scene.time
    centre, kinetic, torque, spent = [scene.grains.position.mean(axis=0)], [], [], 0.0
    overlap = residual = sweeps = 0.0
    for _ in range(SAMPLES):
        began = time.process_time()
        totals = scene.run(per)
        spent += time.process_time() - began
        centre.append(scene.grains.position.mean(axis=0))
        kinetic.append(scene.grains.kinetic_energy() / n)
        overlap = max(overlap, totals.max_overlap)
        residual = max(residual, getattr(totals, "residual", 0.0))
        sweeps += getattr(totals, "sweeps", 0)
        torque.append(totals.torque_on("drum") if vessel == "drum" else 0.0)
    x, moments = np.array(centre), begin + SAMPLE * np.arange(SAMPLES + 1)
    if vessel == "drum":
        power = abs(float(np.mean(torque))) * scene_b.DRUM_SPEED / n
        along = -x[:, 1]
    else:
        pull = later_gravity(moments)
        x = x - 0.5 * (scene_b.box(n).lower + scene_b.box(n).upper)
        # m g . v over the turn, by parts: centres are smoother than velocities
        edge = pull[-1] @ x[-1] - pull[0] @ x[0]
        slope = 2.0 * np.pi * scene_b.TURNS_PER_SECOND * np.column_stack([-pull[:, 2], 0.0 * moments, pull[:, 0]])
        power = MASS / TURN * float(edge - np.trapezoid(np.sum(slope * x, axis=1), dx=SAMPLE))
        along = np.sum(pull * x, axis=1) / scene_b.GRAVITY
    mean = {"kinetic": 1e6 * float(np.mean(kinetic)), "power": 1e3 * power, "offset": 1e3 * float(np.mean(along))}
    depth = np.maximum(scene.contacts().overlap, 0.0) / scene_b.DIAMETER
    return mean, {
        "cost": spent / TURN, "spent": spent, "overlap": overlap, "mean_overlap": float(np.mean(depth)),
        "residual": residual, "sweeps": sweeps / (SAMPLES * per),
    }  # fmt: skip


def measure(make: Callable[[Start], DEM | DVI], n: int, vessel: str, starts: list[Start], turns: int) -> dict:
    """Means of each seed over ``turns`` turns, variance of the mean of all by turns, and what it cost."""
    means: list[list[list[float]]] = []
    notes = []
    for start in starts:
        scene = make(start)
        turn(scene, n, vessel)
        pairs = [turn(scene, n, vessel) for _ in range(turns)]
        means.append([[mean[q] for q in QUANTITIES] for mean, _ in pairs])
        notes += [note for _, note in pairs]
    values = np.array(means)
    return {
        "seeds": values.mean(axis=1).tolist(),
        "variance": (values.var(axis=1, ddof=1).mean(axis=0) / values[..., 0].size).tolist(),
        "cost": float(np.mean([note["cost"] for note in notes])),
        "overlap": max(note["overlap"] for note in notes),
        "mean_overlap": float(np.mean([note["mean_overlap"] for note in notes])),
        "residual": max(note["residual"] for note in notes),
        "sweeps": float(np.mean([note["sweeps"] for note in notes])),
    }


def settings(n: int) -> list[tuple[str, float, str, Callable]]:
    """Method, step, setting, and how to make the scene of each row; the largest bed leaves the dearest out."""
    few = n >= 1000
    rows: list[tuple[str, float, str, Callable]] = []
    for dt in DEM_STEPS[: -1 if few else None]:
        rows.append(("DEM", dt, f"k {stiffness(dt):.1e} N/m", lambda v, s, dt=dt: by_dem(n, v, s, dt)))
    for h, tolerance in DVI_WAYS:
        if few and (h not in (1e-3, 5e-4) or tolerance not in (None, 1e-3)):
            continue
        name = "50 sweeps" if tolerance is None else f"{tolerance:.0e} m/s"
        rows.append(("DVI", h, name, lambda v, s, h=h, t=tolerance: by_dvi(n, v, s, h, t)))
    return rows


def error(row: dict, reference: dict, quantity: str) -> tuple[float, float]:
    """Mean difference from the reference over the seeds and its bar, in chunks of the reference's mean."""
    k = QUANTITIES.index(quantity)
    ours, theirs = np.array(row["seeds"])[:, k], np.array(reference["seeds"])[:, k]
    by_turns = row["variance"][k] + reference["variance"][k]
    by_seeds = float(np.var(ours - theirs, ddof=1)) / len(ours)
    whole = abs(theirs.mean())
    return float((ours - theirs).mean() / whole), float(np.sqrt(max(by_turns, by_seeds)) / whole)


def reference_of(rows: list[dict]) -> dict:
    """The DEM of the shortest step."""
    return min((row for row in rows if row["method"] == "DEM"), key=lambda row: row["step"])


def table(rows: list[dict]) -> None:
    """The rows of one bed, cheapest first, with errors in per cent."""
    best = reference_of(rows)
    beds = np.array(best["seeds"])
    values = ", ".join(
        f"{q} {mean:.3g} (beds differ by {spread:.2g}) {UNITS[q]}"
        for q, mean, spread in zip(QUANTITIES, beds.mean(axis=0), beds.std(axis=0, ddof=1), strict=True)
    )
    print(f"\n{best['vessel']}, {best['n']} grains; reference DEM {best['step']:.0e} s: {values}")
    print(
        f"{'method':6} {'step s':>7} {'setting':14} {'s/s':>7} {'sweeps':>6} {'residual':>8}"
        + "".join(f" {q + ' %':>17}" for q in QUANTITIES)
        + f" {'overlap':>8} {'mean':>8}"
    )
    for row in sorted(rows, key=lambda row: row["cost"]):
        cells = ""
        for quantity in QUANTITIES:
            off, bar = error(row, best, quantity)
            drowned = "~" if abs(off) < 2.0 * bar else " "
            cells += f" {'reference':>17}" if row is best else f" {100.0 * off:+8.1f} ± {100.0 * bar:4.1f} {drowned}"
        work = f"{row['sweeps']:6.0f} {row['residual']:8.0e}" if row["method"] == "DVI" else f"{'':15}"
        print(
            f"{row['method']:6} {row['step']:7.1e} {row['setting']:14} {row['cost']:7.2f} {work}"
            f"{cells} {row['overlap']:8.1e} {row['mean_overlap']:8.1e}"
        )


def draw(groups: dict[tuple[str, int], list[dict]], path: Path) -> None:
    """Errors and mean overlap against cost; an error that its bar drowns stands hollow at two bars: it is below."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(groups), 4, figsize=(13.0, 2.6 * len(groups)), layout="constrained", squeeze=False)
    kinds = {"DEM": ("#202020", "s"), "50 sweeps": ("#0b5fa5", "o"), "1e-03 m/s": ("#2a8c3f", "^"),
             "1e-04 m/s": ("#d9730d", "v"), "1e-05 m/s": ("#b02020", "D")}  # fmt: skip
    for line, ((vessel, n), rows) in zip(axes, groups.items(), strict=True):
        best = reference_of(rows)
        for kind, (colour, marker) in kinds.items():
            chosen = [r for r in rows if kind in (r["method"], r["setting"])]
            chosen.sort(key=lambda r: r["step"])
            for axis, quantity in zip(line, QUANTITIES, strict=False):
                for row in chosen:
                    if row is best:
                        continue
                    off, bar = error(row, best, quantity)
                    drowned = abs(off) < 2.0 * bar
                    axis.errorbar(row["cost"], 2.0 * bar if drowned else abs(off), 0.6 * bar if drowned else bar,
                                  color=colour, marker=marker, ms=5, mfc="white" if drowned else colour,
                                  elinewidth=0.7, uplims=drowned)  # fmt: skip
            label = kind if kind == "DEM" else f"DVI, {kind}"
            line[3].plot([r["cost"] for r in chosen], [max(r["mean_overlap"], 1e-8) for r in chosen], "-",
                         color=colour, marker=marker, ms=5, lw=0.6, label=label)  # fmt: skip
        for axis, name in zip(line, [f"error of {q}" for q in QUANTITIES] + ["mean overlap / d"], strict=True):
            axis.set_xscale("log")
            axis.set_yscale("log")
            if name.startswith("error"):
                axis.set_ylim(3e-3, 3.0)
            axis.set_xlim(0.2, 30.0)
            axis.set_title(f"{vessel}, {n} grains: {name}", loc="left", fontsize=9)
            axis.grid(alpha=0.25, which="both")
    for axis in axes[-1]:
        axis.set_xlabel("processor time [s a simulated second]")
    axes[0, 3].legend(frameon=False, fontsize=7)
    figure.savefig(path, dpi=130)


def main() -> None:
    """The tables, and the picture where a name for it is given."""
    parser = argparse.ArgumentParser(description="springs or rigid grains on scene B")
    parser.add_argument("--sizes", type=int, nargs="*", default=[200])
    parser.add_argument("--vessels", nargs="+", choices=tuple(scene_b.VESSELS), default=list(scene_b.VESSELS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--turns", type=int, default=3, help="of each seed")
    parser.add_argument("--save", type=Path, help="file of rows, added to")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    rows = json.loads(given.save.read_text()) if given.save and given.save.exists() else {}
    print(f"{platform.machine()}, {os.cpu_count()} cores; processor time of one thread")
    for vessel, n in ((vessel, n) for vessel in given.vessels for n in given.sizes):
        starts = [poured(n, vessel, seed) for seed in range(1, given.seeds + 1)]
        for method, step, setting, make in settings(n):
            make(vessel, starts[0]).run(1)  # compiles, or loads what was compiled
            found = measure(partial(make, vessel), n, vessel, starts, given.turns)
            rows[f"{vessel} {n} {method} {step:g} {setting}"] = {
                "vessel": vessel, "n": n, "method": method, "step": step, "setting": setting, **found
            }  # fmt: skip
            if given.save:
                given.save.write_text(json.dumps(rows, indent=1))
    groups: dict[tuple[str, int], list[dict]] = {}
    for row in rows.values():
        groups.setdefault((row["vessel"], row["n"]), []).append(row)
    for group in groups.values():
        table(group)
    if given.picture:
        draw(groups, given.picture)


if __name__ == "__main__":
    main()
