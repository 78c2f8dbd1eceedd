"""Torques of several runs over one another, each with the 95 % band of its mean."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.columns import TIME, TORQUE_DISC
from emclutch.results.errors import OutputError
from emclutch.results.pictures.figure import COLOURS, LINES, finish_axis, new_figure, save_picture
from emclutch.results.pictures.torque import torque_unit
from emclutch.results.text import format_torque, time_unit

if TYPE_CHECKING:
    from emclutch.results.result import Result


def torque_overlay_picture(path: str | Path, runs: Mapping[str, Result], *, title: str | None = None) -> Path:
    """Draw the torque on the disc against time of several runs, and of each the mean over its steady part.

    Parameters
    ----------
    path : PNG to write.
    runs : name -> result. A run of several packings is drawn by its first, thin; its mean and its band are of all. A
        mean of unknown error is drawn without a band, and one that is not converged is said to be so.
    """
    torques = {name: _torque(result) for name, result in runs.items()}
    figure, (axis,) = new_figure(11.0, 5.0, title)
    unit, factor = torque_unit(list(torques.values()))
    times = {name: result.history[TIME].to_numpy() for name, result in runs.items()}
    unit_of_time, in_unit = time_unit(max((float(time[-1]) for time in times.values()), default=0.0))
    for number, (name, result) in enumerate(runs.items()):
        colour, line = COLOURS[number % len(COLOURS)], LINES[number // len(COLOURS) % len(LINES)]
        axis.plot(in_unit * times[name], factor * torques[name], color=colour, lw=0.7, ls=line, alpha=0.7)
        estimate = result.torque
        label = f"{name}: no mean"
        if estimate.mean is not None and estimate.start is not None:
            steady = [in_unit * estimate.start, in_unit * float(times[name][-1])]
            half = estimate.half_width()
            mean = factor * estimate.mean
            label = f"{name}: {format_torque(estimate, unit, factor)}"
            if half is not None:
                axis.fill_between(steady, mean - factor * half, mean + factor * half, color=colour, alpha=0.2, lw=0)
            label += "" if estimate.converged else ", not converged"
            axis.plot(steady, [mean, mean], color=colour, lw=2.0, ls=line, label=label)
        else:
            axis.plot([], [], color=colour, lw=2.0, ls=line, label=label)
    finish_axis(axis, f"time [{unit_of_time}]", f"torque on the disc [{unit}]")
    return save_picture(figure, path)


def _torque(result: Result) -> np.ndarray:
    if TORQUE_DISC not in result.history:
        raise OutputError(f"{result.folder.history} has no torque_disc: the scene has no disc")
    return result.history[TORQUE_DISC].to_numpy()
