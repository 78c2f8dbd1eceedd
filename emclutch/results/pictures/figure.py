"""Shared by all pictures: figures with a title, legends that hide nothing, colours, circles, whole files on disk."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.atomic_file import replace_bytes
from emclutch.results.errors import OutputError
from emclutch.results.fits import NORMAL
from emclutch.results.text import format_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import EllipseCollection
    from matplotlib.figure import Figure

MM = 1e3
BODY_COLOURS = {"disc": "#0b5fa5", "rotor": "#c4540a", "housing": "#6a6a6a"}
OTHER_BODY = "#333333"
COLOURS = ("#0b5fa5", "#c4540a", "#2a8c3f", "#8a1c7c", "#7f6000", "#0a7d7d", "#b5179e", "#6a6a6a")
LINES = ("-", "--", "-.", ":")  # the next one when the colours are used up
MARKERS = "osD^v<>Ph*"
LETTERS = 11.5  # to the inch, at 11 points
STRONGEST = 98  # percentile of the forces that is drawn at full width: a few outliers would hide all others


def new_figure(
    width: float,
    height: float,
    title: str | None,
    *,
    rows: int = 1,
    columns: int = 1,
    layout: Any = "constrained",
    **ratios: Any,
) -> tuple[Figure, np.ndarray]:
    """Return a figure [in] with its title, which is one line, at the upper left, and its axes (rows * columns,).

    `layout` is matplotlib's: "compressed" for axes of equal aspect. What looks like a formula in the title is none.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout=layout)
    if title:
        shown = textwrap.fill(title, int(LETTERS * (width - 0.4)))  # in two where the figure is too narrow
        figure.suptitle(shown, x=0.01, ha="left", fontsize=11, parse_math=False)
    return figure, figure.subplots(rows, columns, squeeze=False, **ratios).ravel()


def save_picture(figure: Figure, path: str | Path) -> Path:
    """Write a figure in one step, in the format that the file's ending names, PNG without one.

    Raises
    ------
    OutputError
        The ending is that of no picture.
    """
    path = Path(path)
    content, kind = io.BytesIO(), path.suffix.removeprefix(".").lower() or "png"
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise OutputError(f"{path} ends in no picture's format; allowed: {', '.join(f'.{one}' for one in known)}")
    figure.savefig(content, format=kind)
    replace_bytes(path, content.getbuffer())
    return path


def make_logarithmic(axis: Axes) -> None:
    """Make the axes of a panel logarithmic, 0.2, 0.5, 1 in place of powers of ten; what is not above 0 is left out."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_xscale("log", nonpositive="mask")
    axis.set_yscale("log", nonpositive="mask")
    for one in (axis.xaxis, axis.yaxis):
        one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        one.set_major_formatter(lambda value, _: f"{value:g}")
        one.set_minor_formatter(NullFormatter())


def draw_measured(
    axis: Axes, measured: Mapping[str, np.ndarray] | None, *, per_x: float = 1.0, per_y: float = 1.0, joined: bool
) -> None:
    """Draw measured curves, as `read_measured` returns them, as markers with 95 % bars, x and y in the axis' units."""
    for number, (name, points) in enumerate((measured or {}).items()):
        every = 1 if joined else max(1, len(points) // 60)  # a curve of markers says nothing
        x, y, *error = points[::every].T
        bars = "\n(95 %: 1.96 standard errors)" if error else ""
        axis.plot(per_x * x, per_y * y, ls=":" if joined else "", lw=0.7, marker=MARKERS[number % len(MARKERS)], ms=4.5,
                  mfc="none", color="black", zorder=1.5, label=f"measured: {name}{bars}")  # fmt: skip
        if error:
            axis.errorbar(per_x * x, per_y * y, per_y * NORMAL * error[0], fmt="none", ecolor="black", elinewidth=0.7,
                          capsize=3)  # fmt: skip


def label_panel(axis: Axes, title: str) -> None:
    """Write what a panel shows above its left end."""
    axis.set_title(title, loc="left", fontsize=10)


def finish_axis(axis: Axes, x: str, y: str) -> None:
    """Name the axes of curves from edge to edge, and draw zero, a grid and the legend."""
    axis.set(xlabel=x, ylabel=y)
    axis.axhline(0.0, color="black", lw=0.6, zorder=1)
    axis.grid(alpha=0.25)
    axis.margins(x=0.0)
    legend_beside(axis)


def mark_lock_up(axis: Axes, per_second: float, locked: float | None) -> None:
    """Mark the time [s] from which on the shafts are locked, `lock_up_time` of a summary; nothing for None."""
    if locked is not None:
        label = f"locked at {format_time(locked)}: speeds stay\nwithin 1 % of the faster one"
        axis.axvline(per_second * locked, color="#7a0177", lw=1.2, ls=(0, (4, 2)), label=label)


def legend_beside(axis: Axes) -> None:
    """Draw a legend to the right of a panel, of what is drawn in it; nothing where nothing has a label."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)


def legend_below(axis: Axes, columns: int = 1) -> None:
    """Draw a legend below a panel and the name of its axis."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="upper left", bbox_to_anchor=(0.0, -0.14), frameon=False, fontsize=9, ncols=columns, borderaxespad=0.0
        )


def draw_circles(axis: Axes, x: np.ndarray, y: np.ndarray, radius: np.ndarray, **options: Any) -> EllipseCollection:
    """Draw grains true to scale at x, y (n,) [m] on axes in mm; `options` as of matplotlib's collections."""
    from matplotlib.collections import EllipseCollection

    d = 2.0 * MM * np.asarray(radius)
    offsets = MM * np.column_stack([x, y])
    circles = EllipseCollection(
        d, d, np.zeros_like(d), units="xy", offsets=offsets, offset_transform=axis.transData,
        **{"cmap": "cividis", "edgecolors": "black", "linewidths": 0.3, **options},
    )  # fmt: skip
    axis.add_collection(circles)
    return circles


def draw_chains(axis: Axes, start: np.ndarray, end: np.ndarray, force: np.ndarray) -> None:
    """Draw contacts from start to end (k, 2) [m] on axes in mm, as wide as their force (k,) [N]."""
    from matplotlib.collections import LineCollection

    force = np.abs(np.asarray(force, dtype=np.float64))
    width = 3.0 * np.minimum(force / (float(np.percentile(force, STRONGEST)) or 1.0), 1.0)
    ends = list(MM * np.stack([start, end], axis=1))
    axis.add_collection(LineCollection(ends, colors="crimson", linewidths=width, alpha=0.85))


def colour_limits(values: np.ndarray, percentile: float = 100.0) -> tuple[float, float]:
    """Return the ends of a range of colours, the upper one a percentile; of equal values, a range about them.

    Where that percentile is no more than the smallest value, as of grains that nearly all rest, it is the largest.
    """
    if not len(values):
        return 0.0, 1.0
    low, high = float(np.min(values)), float(np.percentile(values, percentile))
    high = high if low < high else float(np.max(values))
    return (low, high) if low < high else (low - 0.5, high + 0.5)
