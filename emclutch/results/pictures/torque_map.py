"""Pictures of a torque map: curves with their 95 % bands and the range of unknown powder, or contours."""

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
    falling : ndarray (n,)
        Torque of falling currents in steel with hysteresis [N m]; nan without one.
    """

    label: str
    x: np.ndarray
    torque: np.ndarray
    is_guess: np.ndarray
    unknown: np.ndarray
    falling: np.ndarray

    def draw(self, axis: Axes, colour: str, style: str, band: str | None, guess: str | None) -> None:
        """Draw line, points and bands, with labels of the band and of the points that are a guess."""
        mean, low, high = self.torque.T
        known = ~self.is_guess
        if np.isfinite(self.unknown).any():
            axis.fill_between(self.x, *self.unknown.T, color=colour, alpha=0.10, lw=0.0,
                              label="friction and fill unknown: 90 % range")  # fmt: skip
        if known.any():
            axis.fill_between(self.x, low, high, where=known, color=colour, alpha=0.25, lw=0.0, label=band)
            axis.plot(self.x[known], mean[known], "o", ms=4.0, color=colour)
        axis.plot(self.x, mean, color=colour, ls=style, lw=1.4, label=self.label)
        if np.isfinite(self.falling).any():
            axis.plot(self.x, self.falling, color=colour, ls=(0, (1, 1)), lw=1.4,
                      label="falling current" if band else None)  # fmt: skip
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
    axis.set(xlabel=label, ylabel="torque [N m]" if measured else "expected torque [N m]")
    axis.grid(alpha=0.25)
    if logarithmic:
        make_logarithmic(axis)
    else:
        axis.set_ylim(bottom=0.0)
    legend_below(axis, 2)
    return save_picture(figure, path)


def torque_contour_picture(
    path: str | Path,
    values: Sequence[np.ndarray],
    torque: np.ndarray,
    is_guess: np.ndarray,
    labels: Sequence[str],
    *,
    logarithmic: Sequence[bool] = (False, False),
    title: str | None = None,
) -> Path:
    """Draw contours of the torque over two quantities.

    Parameters
    ----------
    path : PNG to write.
    values : of x (n,) and y (m,), ascending, as they are shown.
    torque : (m, n) [N m]; nan where none is known, which is left blank.
    is_guess : (m, n) of bool; hatched between the points.
    labels : of x and y, with their units.
    logarithmic : whether x and y are; with one of them the torque is too.
    title : of the figure.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, MaxNLocator

    figure, (axis,) = new_figure(7.0, 5.2, title)
    known = torque[np.isfinite(torque)]
    in_factors = any(logarithmic) and known.min() > 0.0
    locator = LogLocator(subs=(1.0, 2.0, 5.0)) if in_factors else MaxNLocator(11)
    levels = locator.tick_values(float(known.min()), float(known.max()))
    masked = np.ma.masked_invalid(torque)
    filled = axis.contourf(*values, masked, levels, norm=LogNorm() if in_factors else None, cmap="viridis")
    figure.colorbar(filled, ax=axis, label="expected torque [N m]", format=lambda value, _: f"{value:g}")
    if ((levels > known.min()) & (levels < known.max())).any():
        lines = axis.contour(*values, masked, levels, colors="white", linewidths=0.9)
        axis.clabel(lines, fmt=lambda level: f"{level:g} N m", fontsize=8)
    if is_guess.any():
        axis.contourf(*values, is_guess.astype(float), (0.5, 1.5), colors="none", hatches=("///",))
        axis.fill_between([], [], facecolor="none", edgecolor="black", lw=0.0, hatch="///",
                          label="a guess within its limits (map.csv)")  # fmt: skip
    x, y = (grid[np.isfinite(torque)] for grid in np.meshgrid(*values))
    axis.plot(x, y, ".", ms=2.5, color="black", label="computed points")
    axis.set(xlabel=labels[0], ylabel=labels[1])
    for scale, is_log in zip((axis.set_xscale, axis.set_yscale), logarithmic, strict=True):
        if is_log:
            scale("log")
    legend_below(axis, 2)
    return save_picture(figure, path)
