"""Core-hours to +- 3 % everywhere: an adaptive curve beside a grid of twelve currents with four replicas each.

    python tests/benchmarks/adaptive_curve.py [--curves 20] [--scatter 0.03 0.06]

No run is made: torque and cost of a replica are those of `tests/studies/synthetic_curve.py`, whose curve is known, so
that the error of what comes out is known too. Both are judged by the same interval
(`emclutch.results.curve_interval`). A grid has no rule for when to end; it gets as many replicas as its own interval
needs for the aim, and no more than 32.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
from synthetic_curve import CURRENTS, core_hours, replica, torque

from emclutch.results.curve_interval import CurveInterval, curve_interval
from emclutch.studies.adaptive import AdaptiveCurve, MeasuredPlace

AIM = 0.03
GRID = np.linspace(0.2, 2.0, 12)


def adaptive(scatter: float, seed: int) -> tuple[float, int, CurveInterval]:
    """Core-hours, replicas and curve of one adaptive study."""
    random, places = np.random.default_rng(seed), np.repeat(CURRENTS, 32)
    curve, measured = AdaptiveCurve(places, AIM, len(places)), {}
    while batch := curve.next_batch(measured):
        for number in batch:
            place = float(places[number])
            measured[number] = MeasuredPlace(float(replica(place, scatter, random)), core_hours(place))
    return sum(one.cost for one in measured.values()), len(measured), curve.curve


def grid(scatter: float, seed: int, replicas: int) -> tuple[float, int, CurveInterval]:
    """The same of twelve currents in equal steps with so many replicas each."""
    x = np.repeat(GRID, replicas)
    found = curve_interval(x, replica(x, scatter, np.random.default_rng(seed)), CURRENTS)
    return float(core_hours(x).sum()), len(x), found


def grid_to_the_aim(scatter: float, seed: int) -> tuple[float, int, CurveInterval]:
    """The grid with as many replicas as its interval needs."""
    for replicas in (2, 3, 4, 6, 8, 12, 16, 24, 32):
        found = grid(scatter, seed, replicas)
        if (found[2].half_width <= np.log1p(AIM)).all():
            break
    return found


def row(name: str, scatter: float, found: list[tuple[float, int, CurveInterval]]) -> str:
    """Means over the studies; of the errors the 95th percentile of each study's largest."""
    hours, replicas = (np.array([one[place] for one in found]) for place in (0, 1))
    spread = f"{hours.min():.0f} to {hours.max():.0f}"
    off = np.array([np.abs(one[2].torque / torque(CURRENTS) - 1.0) for one in found])
    half = np.array([np.expm1(one[2].half_width) for one in found])
    return (
        f"| {100 * scatter:.0f} % | {name} | {replicas.mean():.0f} | {hours.mean():.0f} ({spread}) "
        f"| {100 * half.max(axis=1).mean():.1f} % | {100 * np.quantile(off.max(axis=1), 0.95):.1f} % "
        f"| {100 * (off < half).mean():.0f} % |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--curves", type=int, default=20)
    parser.add_argument("--scatter", type=float, nargs="+", default=[0.03, 0.06])
    given = parser.parse_args()
    print("| one replica | study | replicas | core-hours | interval, widest | error, largest (95 %) | places held |")
    print("|---|---|---|---|---|---|---|")
    for scatter in given.scatter:
        seeds = range(given.curves)
        kinds = {
            f"adaptive, to {100 * AIM:.0f} %": lambda seed: adaptive(scatter, seed),  # noqa: B023
            "grid 12 x 4": lambda seed: grid(scatter, seed, 4),  # noqa: B023
            f"grid 12 x n, to {100 * AIM:.0f} %": lambda seed: grid_to_the_aim(scatter, seed),  # noqa: B023
        }
        for name, kind in kinds.items():
            print(row(name, scatter, [kind(seed) for seed in seeds]), flush=True)


if __name__ == "__main__":
    main()
