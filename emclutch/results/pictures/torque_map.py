"""Picture of a torque map: expected torques with their 95 % bands, and the range of unknown powder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.pictures.figure import (
    COLOURS,
    LINES,
    draw_measured,
    legend_below,
    make_logarithmic,
    new_figure,
    save_picture,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class BandedCurve:
    """A curve with its bands.

    Attributes
    ----------
    label : str
    x : ndarray (n,)
        As it is shown.
    torque : ndarray (n, 3)
        Mean, and both ends of the 95 % interval [N m].
    is_guess : ndarray (n,) of bool
    unknown : ndarray (n, 2)
        90 % range of unknown powder [N m]; nan where it is not known.
    """

    label: str
    x: np.ndarray
    torque: np.ndarray
    is_guess: np.ndarray
    unknown: np.ndarray

    def draw(self, axis: Axes, colour: str, style: str, band: str | None, guess: str | None) -> None:
        """Draw line, points and bands, with labels of the band and of the points that are a guess."""
        mean, low, high = self.torque.T
        known = ~self.is_guess
        if np.isfinite(self.unknown).any():
            axis.fill_between(self.x, *self.unknown.T, color=colour, alpha=0.10, lw=0.0,
                              label="friction and fill of the powder unknown: 90 % range")  # fmt: skip
        if known.any():
            axis.fill_between(self.x, low, high, where=known, color=colour, alpha=0.25, lw=0.0, label=band)
            axis.plot(self.x[known], mean[known], "o", ms=4.0, color=colour)
        axis.plot(self.x, mean, color=colour, ls=style, lw=1.4, label=self.label)
        if self.is_guess.any():
            x, at, *ends = np.column_stack([self.x, mean, low, high])[self.is_guess].T
            axis.errorbar(x, at, np.abs(np.array(ends) - at), fmt="o", ms=4.0, mfc="white", color=colour, lw=0.6,
                          capsize=2.0, label=guess)  # fmt: skip


def torque_map_picture(
    path: str | Path,
    curves: Sequence[BandedCurve],
    label: str,
    *,
    logarithmic: bool = False,
    measured: Mapping[str, np.ndarray] | None = None,
    per_x: float = 1.0,
    title: str | None = None,
) -> Path:
    """Draw torques over a quantity.

    Parameters
    ----------
    path : PNG to write.
    curves : one or several.
    label : of x, with its unit.
    logarithmic : whether both axes are.
    measured : name -> (n, 2) current [A] and torque [N m], or (n, 3) with errors, as `read_measured` returns them.
    per_x : x over the current in A.
    title : of the figure.
    """
    figure, (axis,) = new_figure(7.0, 5.2, title)
    first, guessing = (
        next((number for number, curve in enumerate(curves) if (curve.is_guess == wanted).any()), None)
        for wanted in (False, True)
    )
    for number, curve in enumerate(curves):
        style = LINES[number // len(COLOURS) % len(LINES)]
        curve.draw(axis, COLOURS[number % len(COLOURS)], style, "95 % interval" if number == first else None,
                   "a guess with its limits" if number == guessing else None)  # fmt: skip
    draw_measured(axis, measured, per_x=per_x, joined=True)
    axis.set(xlabel=label, ylabel="expected torque [N m]")
    axis.grid(alpha=0.25)
    if logarithmic:
        make_logarithmic(axis)
    else:
        axis.set_ylim(bottom=0.0)
    legend_below(axis, 2)
    return save_picture(figure, path)
