"""Loop of cases/hysteresis.toml beside those of measured dry powder brakes: picture and table.

    emclutch run cases/hysteresis.toml --out on
    emclutch run cases/hysteresis.toml --out off --set effects.hysteresis=off
    python tests/benchmarks/brake_loop.py on off docs/brake_loop.png

All is over the largest current and the torque there. Widths are falling less rising torque, the area is the integral of
the width over the current.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas
from dry_brakes import brakes

from emclutch.results.pictures.current_ramp import draw_ramp
from emclutch.results.pictures.figure import draw_measured, legend_beside, new_figure, save_picture

SHARES = (0.2, 0.5, 0.8)


def branch(table: pandas.DataFrame, course: str) -> np.ndarray:
    """(n, 2) current and torque of a branch, by the current."""
    return table.loc[table["course"] == course, ["current", "torque"]].sort_values("current").to_numpy()


def rated(table: pandas.DataFrame) -> tuple[float, float]:
    """Largest current and the torque there, mean of both branches continued along a line."""
    current = float(table["current_high"].max())
    ends = [np.polyval(np.polyfit(*branch(table, course)[-3:].T, 1), current) for course in ("rising", "falling")]
    return current, float(np.mean(ends))


def numbers(rising: np.ndarray, falling: np.ndarray) -> list[float]:
    """Falling over rising at each of SHARES, width at each, and area, all over the rated point."""
    x = np.linspace(0.025, 0.975, 39)
    up, down = (np.interp(x, *one.T) for one in (rising, falling))
    at = [[float(np.interp(share, x, y)) for share in SHARES] for y in (up, down)]
    ratios, widths = np.divide(at[1], at[0]), np.subtract(at[1], at[0])
    return [*ratios, *widths, float(np.trapezoid(down - up, x))]


def rows(tables: dict[str, pandas.DataFrame]) -> str:
    """Table of ratios, widths and areas, of the brakes and of each run."""
    head = [f"{what} at {100 * share:.0f} %" for what in ("falling/rising", "width") for share in SHARES] + ["area"]
    lines = ["| | " + " | ".join(head) + " |", "|---" * (len(head) + 1) + "|"]
    measured = brakes()
    found = {name: numbers(*(measured[f"{name} {way}"] for way in ("rising", "falling"))) for name in ("B15", "B5Z")}
    for name, table in tables.items():
        found[name] = numbers(*(branch(table, course) / rated(table) for course in ("rising", "falling")))
    lines += [f"| {name} | " + " | ".join(f"{one:.3g}" for one in line) + " |" for name, line in found.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    on, off, picture = sys.argv[1:]
    tables = {
        "emclutch, steel with hysteresis": pandas.read_csv(Path(on) / "torque_vs_current.csv"),
        "emclutch, steel without hysteresis": pandas.read_csv(Path(off) / "torque_vs_current.csv"),
    }
    figure, axes = new_figure(13.0, 4.8, "Torque of cases/hysteresis.toml and of measured dry powder brakes", columns=2)
    for axis, (name, table) in zip(axes, tables.items(), strict=True):
        current, torque = rated(table)
        draw_ramp(axis, table, per_current=1.0 / current, per_torque=1.0 / torque)
        draw_measured(axis, {key: value for key, value in brakes().items() if "B5ZD" not in key}, joined=True)
        axis.set_title(name, loc="left", fontsize=10)
        axis.set(xlabel="current / largest current [1]", ylabel="torque / torque at the largest current [1]")
        axis.grid(alpha=0.25)
    legend_beside(axes[1])
    save_picture(figure, picture)
    print(rows(tables))
