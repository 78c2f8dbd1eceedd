"""Torques against time, of one run with what drove them, or of several over one another."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import (
    CURRENT,
    DISC_SPEED,
    GAP_FLUX_DENSITY,
    ROTOR_SPEED,
    TIME,
    TORQUE_DISC,
    speed_of,
    torque_on,
)
from emclutch.results.errors import OutputError
from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    COLOURS,
    LINES,
    finish_axis,
    mark_lock_up,
    new_figure,
    save_picture,
)
from emclutch.results.quantity import RPM
from emclutch.results.statistics import Estimate
from emclutch.results.text import format_torque, time_unit

if TYPE_CHECKING:
    from emclutch.results.result import Result


def torque_picture(
    path: str | Path,
    history: Any,
    estimate: Estimate | None = None,
    others: Any = (),
    *,
    best: Estimate | None = None,
    title: str | None = None,
    times: str = "",
    locked: float | None = None,
) -> Path:
    """Draw the torques on the bodies, and current and speeds where they vary.

    Parameters
    ----------
    path : PNG to write.
    history : table with the columns of `emclutch.results.COLUMNS` (pandas, or a dictionary of arrays).
    estimate : of the disc's torque; its steady part is shaded and its mean drawn with its 95 % interval; an unknown one
        is said, and no band is drawn. Not drawn where it is not converged because current or speed change.
    others : histories of the other replicas: their torque on the disc is drawn thin, as the mean is of all of them.
    best : of the disc's torque, corrected for the error of the numerical settings; drawn where it is another one.
    times : rise times in words, written above the panel.
    locked : time [s] from which on the shafts are locked; it is marked.
    """
    time = np.asarray(history[TIME], dtype=np.float64)
    unit_of_time, time_factor = time_unit(np.max(time, initial=0.0))
    time = time_factor * time
    drives = [name for name in (CURRENT, ROTOR_SPEED, DISC_SPEED) if name in history and varies(history[name])]
    rows = 2 if drives else 1
    height, ratios = 4.6 + 2.0 * (rows - 1), [2.4, 1.0][:rows]
    figure, axes = new_figure(9.0, height + 0.6, title, rows=rows, sharex=True, height_ratios=ratios)
    axis = axes[0]
    shown = [body for body in BODY_COLOURS if torque_on(body) in history]
    unit, factor = torque_unit([np.asarray(history[torque_on(body)], dtype=np.float64) for body in shown])
    for body in shown:
        torque = factor * np.asarray(history[torque_on(body)], dtype=np.float64)
        if body == "housing" and not torque.any():
            continue
        axis.plot(time, torque, color=BODY_COLOURS[body], lw=1.0, label=f"on the {body}")
        if (by_field := f"{torque_on(body)}_field") in history:
            part = factor * np.asarray(history[by_field], dtype=np.float64)
            axis.plot(time, part, color=BODY_COLOURS[body], lw=0.8, ls=":", label="of it by its slots' field")
    for number, other in enumerate(others):
        label = None if number else "on the disc, other replicas"
        torque = factor * np.asarray(other[TORQUE_DISC], dtype=np.float64)
        axis.plot(time_factor * np.asarray(other[TIME]), torque, color="#7fb2dd", lw=0.6, zorder=1, label=label)
    axis.axhline(0.0, color="black", lw=0.6)
    axis.set_title(times, loc="left", fontsize=9)
    is_transient = bool(drives) and estimate is not None and not estimate.is_steady
    if estimate is not None and estimate.mean is not None and estimate.start is not None and not is_transient:
        start = time_factor * estimate.start
        axis.axvspan(start, time[-1], color="#0b5fa5", alpha=0.07, lw=0, label="averaged part")
        mean = factor * estimate.mean
        if estimate.known:
            limits = axis.get_ylim()
            low, high = (factor * end for end in estimate.interval())
            axis.fill_between([start, time[-1]], low, high, color="#0b5fa5", alpha=0.25, lw=0, label="95 % interval")
            axis.set_ylim(limits)  # of few replicas it is wider than the picture
        label = f"disc, raw{f', {estimate.replicas} replicas' if estimate.replicas > 1 else ''}: "
        label += format_torque(estimate, unit, factor) + ("" if estimate.converged else ", not converged")
        axis.plot([start, time[-1]], [mean, mean], color="black", lw=1.4, ls="--", label=label, zorder=4)
        if best is not None and best.mean is not None and best != estimate:
            label = f"disc, best estimate: {format_torque(best, unit, factor)}"
            middle, half = 0.5 * (start + time[-1]), best.half_width()
            axis.errorbar(middle, factor * best.mean, None if half is None else factor * half, fmt="o", ms=5,
                          color="black", capsize=4, label=label, zorder=5)  # fmt: skip
        if not estimate.converged:
            reason = textwrap.fill(estimate.reason, 120)
            axis.set_title(reason, loc="left", fontsize=8, color="crimson", parse_math=False)
    mark_lock_up(axis, time_factor, locked)
    axis.set_ylabel(f"torque [{unit}]")
    axis.margins(x=0.0)
    handles, labels = axis.get_legend_handles_labels()
    if drives:
        more = _draw_drives(axes[1], time, history, drives)
        handles, labels = handles + more[0], labels + more[1]
    figure.legend(handles, labels, loc="outside lower left", ncols=2, frameon=False, fontsize=9)
    axes[-1].set_xlabel(f"time [{unit_of_time}]")
    return save_picture(figure, path)


def _draw_drives(axis: Any, time: np.ndarray, history: Any, drives: Sequence[str]) -> tuple[list[Any], list[str]]:
    """Draw current and speeds; the entries of the legend are returned."""
    speeds = [name for name in drives if name != CURRENT]
    if CURRENT in drives:
        axis.plot(time, np.asarray(history[CURRENT]), color="#8a1c7c", lw=1.2, label="current")
        axis.set_ylabel("current [A]")
    in_gap = CURRENT in drives and not speeds and GAP_FLUX_DENSITY in history
    right = axis.twinx() if CURRENT in drives and (speeds or in_gap) else axis
    if in_gap:
        right.plot(time, np.asarray(history[GAP_FLUX_DENSITY]), color="#2a8c3f", lw=1.2, label="|B| in the gap")
        right.set_ylabel("|B| under the poles [T]")
        right.set_ylim(bottom=0.0)
        if np.min(history[CURRENT]) >= 0.0:
            axis.set_ylim(bottom=0.0)
    for body in (body for body in BODY_COLOURS if speed_of(body) in speeds):
        right.plot(
            time,
            RPM * np.asarray(history[speed_of(body)]),
            color=BODY_COLOURS[body],
            lw=1.2,
            ls="-.",
            label=f"{body} speed",
        )
    if speeds:
        right.set_ylabel("speed [rpm]")
    right.margins(x=0.0)
    handles, labels = axis.get_legend_handles_labels()
    if right is not axis:
        more = right.get_legend_handles_labels()
        handles, labels = handles + more[0], labels + more[1]
    return handles, labels


def varies(values: Any) -> bool:
    """True if a column changes by more than round-off."""
    array = np.asarray(values, dtype=np.float64)
    return bool(array.size and np.ptp(array) > 1e-6 * np.max(np.abs(array)))


def torque_unit(torques: list[np.ndarray]) -> tuple[str, float]:
    """Unit with a prefix, and the factor from N m, in which the largest of some torques is a handy number."""
    largest = max((float(np.max(np.abs(t), initial=0.0)) for t in torques), default=0.0)
    if largest >= 0.1 or largest == 0.0:
        return "N m", 1.0
    return ("mN m", 1e3) if largest >= 1e-4 else ("µN m", 1e6)


def torque_overlay_picture(path: str | Path, runs: Mapping[str, Result], *, title: str | None = None) -> Path:
    """Draw the torque on the disc against time of several runs, and of each the mean over its steady part.

    Parameters
    ----------
    path : PNG to write.
    runs : name -> result. A run of several replicas is drawn by its first, thin; its mean and its band are of all. A
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
