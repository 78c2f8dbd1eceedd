"""Picture of what accuracy costs in time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.pictures.figure import MARKERS, label_panel, legend_below, new_figure, save_picture

if TYPE_CHECKING:
    from matplotlib.axis import Axis


def work_precision_picture(path: str | Path, table: Any, *, title: str | None = None) -> Path:
    """Draw error against wall-clock time on logarithmic axes, one panel a knob, one line a quantity.

    Parameters
    ----------
    path : PNG to write.
    table : columns `knob`, `quantity`, `setting`, `seconds` and relative `error`. Rows without an error
        (the reference itself) are left out; an error of exactly 0 is drawn at the panel's lower edge.
        With a column `noise` (relative, None where there is none, infinite where it is unknown) errors below it
        are drawn hollow.
    """
    knob, quantity = (np.asarray(table[name]).astype(str) for name in ("knob", "quantity"))
    setting = np.array([value if isinstance(value, str) else f"{value:g}" for value in table["setting"]])
    seconds, error = _column(table, "seconds"), _column(table, "error")
    noisy = np.abs(error) < _column(table, "noise") if "noise" in table else np.zeros(len(error), dtype=bool)
    knobs, quantities = list(dict.fromkeys(knob)), list(dict.fromkeys(quantity))
    figure, axes = new_figure(max(6.5, 5.2 * len(knobs)), 4.8, title, columns=max(1, len(knobs)), sharey=True)
    positive = error[np.isfinite(error) & (error > 0.0)]
    floor = 0.5 * float(positive.min()) if positive.size else 1e-12
    height = np.maximum(np.abs(error), floor)
    for axis, name in zip(axes, knobs, strict=False):
        for number, of in enumerate(quantities):
            rows = np.flatnonzero((knob == name) & (quantity == of) & np.isfinite(error) & (seconds > 0.0))
            if not rows.size:
                continue
            rows = rows[np.argsort(seconds[rows], kind="stable")]
            style = {"marker": MARKERS[number % len(MARKERS)], "color": f"C{number}", "ms": 6}
            axis.loglog(seconds[rows], height[rows], lw=1.2, label=of, **style)
            hollow = rows[noisy[rows]]
            axis.loglog(seconds[hollow], height[hollow], ls="", mfc="white", **style)
        first = np.flatnonzero((knob == name) & np.isfinite(error) & (seconds > 0.0))
        # Quantities of one setting may cost different times: each cluster is named at its topmost marker.
        for text, cost in dict.fromkeys(zip(setting[first], seconds[first], strict=True)):
            own = first[(setting[first] == text) & (seconds[first] == cost)]
            axis.annotate(
                text,
                (cost, height[own].max()),
                xytext=(0, 6),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color="#444444",
            )
        for goal in (0.1, 0.03, 0.01):
            axis.axhline(goal, color="#999999", lw=0.7, ls=":")
        axis.set_xlabel("wall-clock time [s]")
        label_panel(axis, f"{name} (setting next to the marker)")
        axis.grid(alpha=0.25, which="both")
        axis.margins(x=0.15, y=0.12)
        if first.size:
            _few_ticks(axis.xaxis, seconds[first])
            if noisy[first].any():
                label = "hollow: error below its noise, or noise unknown"
                axis.plot([], [], "o", color="#444444", mfc="white", ms=6, label=label)
            legend_below(axis, 2)
    if np.isfinite(error).any():
        _few_ticks(axes[0].yaxis, height[np.isfinite(error)])  # the panels share it
    axes[0].set_ylabel("relative error")
    return save_picture(figure, path)


def _few_ticks(axis: Axis, values: np.ndarray) -> None:
    """Plain numbers at as many ticks as have room: on less than a decade matplotlib labels all minor ticks."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    decades = float(np.log10(values.max() / values.min()))
    if decades < 0.7:
        axis.set_major_locator(MaxNLocator(4))
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 1.7 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _column(table: Any, name: str) -> np.ndarray:
    """Numbers of a column; None becomes nan, which is not drawn."""
    return np.array([np.nan if value is None else value for value in table[name]], dtype=np.float64)
