"""Torque against the current of a slow ramp: rising and falling branches with their 95 % bands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.current_ramp import TABLE
from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    COLOURS,
    draw_measured,
    legend_below,
    new_figure,
    save_picture,
)
from emclutch.results.pictures.torque import torque_unit
from emclutch.results.pictures.torque_curves import torque_against_current_picture
from emclutch.results.torque_curves import row_of_run, torque_curves

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from emclutch.results.result import Result

RISING, FALLING, HELD = BODY_COLOURS["rotor"], BODY_COLOURS["disc"], "black"


def current_ramp_picture(
    path: str | Path,
    table: pandas.DataFrame,
    *,
    measured: Mapping[str, np.ndarray] | None = None,
    title: str | None = None,
) -> Path:
    """Draw the torque of each bin of each branch.

    Parameters
    ----------
    path : PNG to write.
    table : as of `emclutch.results.current_ramp.CurrentRamp.table`, or ``torque_vs_current.csv`` of a run.
    measured : name -> (n, 2) or (n, 3) current [A], torque and its error [N m], as `read_measured` returns them.
    """
    figure, (axis,) = new_figure(7.0, 4.8, title)
    unit, factor = torque_unit([table["torque"].to_numpy()])
    draw_ramp(axis, table, per_current=1.0, per_torque=factor)
    draw_measured(axis, measured, per_y=factor, joined=True)
    axis.axhline(0.0, color="black", lw=0.6)
    axis.grid(alpha=0.25)
    axis.set_xlabel("coil current [A]")
    axis.set_ylabel(f"torque on the disc [{unit}]")
    legend_below(axis, 2)
    return save_picture(figure, path)


def run_against_current_picture(
    path: str | Path,
    result: Result,
    *,
    measured: Mapping[str, np.ndarray] | None = None,
    title: str | None = None,
) -> Path:
    """Draw a run's torque against current: the branches of a ramp where it has them, else one point; see above."""
    table = result.folder.path / TABLE
    if table.is_file():
        import pandas

        return current_ramp_picture(path, pandas.read_csv(table), measured=measured, title=title)
    return torque_against_current_picture(
        path, torque_curves([row_of_run(result)], "current", []), measured=measured, title=title
    )


def draw_ramp(axis: Axes, table: pandas.DataFrame, *, per_current: float, per_torque: float) -> None:
    """Draw the branches of a ramp with their bands, the first of each course with a label."""
    labelled: set[str] = set()
    for number, (_, branch) in enumerate(table.groupby("branch", sort=True)):
        course = str(branch["course"].iloc[0])
        colour = {"rising": RISING, "falling": FALLING, "held": HELD}[course]
        if course in labelled:
            colour = COLOURS[number % len(COLOURS)] if course != "held" else colour
        x, torque = per_current * branch["current"].to_numpy(), per_torque * branch["torque"].to_numpy()
        low, high = (per_torque * branch[end].to_numpy(dtype=float) for end in ("low", "high"))
        label = f"{course}{', 95 % band' if np.isfinite(low).any() else ', error unknown'}"
        label = label if course not in labelled else "_nolegend_"
        labelled.add(course)
        if course == "held":
            known = np.isfinite(low)
            bars = np.where(known, high - torque, 0.0)
            axis.errorbar(x, torque, bars, fmt="s", ms=5, mfc="white", capsize=4, color=colour, label=label)
            continue
        axis.plot(x, torque, color=colour, lw=1.4, marker=".", ms=4, label=label)
        axis.fill_between(x, low, high, color=colour, alpha=0.2, lw=0.0)
