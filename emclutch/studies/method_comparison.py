"""DEM against DVI: what the same scene gives by both, for studies over ``contact.method``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from emclutch.results import Estimate, Result
from emclutch.results.columns import DISC_SPEED, MISSED_STEPS, ROTOR_SPEED, STEPS, TIME, TORQUE_DISC
from emclutch.results.fits import NORMAL
from emclutch.results.text import format_duration, format_mean, format_percent

METHOD = "contact.method"
WANTED = 0.05
"""Half width of a torque's 95 % interval, relative, for which the processor time of both methods is estimated."""


def compare_methods(points: Sequence[tuple[Mapping[str, Any], Result]]) -> list[dict[str, Any]]:
    """A row for every point of a study that was run by both methods.

    Parameters
    ----------
    points
        The values that make a point, "contact.method" among them, and its result.

    Returns
    -------
    list of dict
        The other values; of each method the steady torque on the output [N m] with its standard error, the ends of its
        95 % interval and whether it is converged, as every run says it, step [s], wall-clock time [s], processor time
        [s] and that to ± 5 % [s] (None where the error is unknown), largest overlap, lock-up time [s]; the torque's
        difference relative to DEM and over both standard errors (None where one is unknown); the largest difference of
        the output's speeds over the motor's largest; the fraction of the DVI's steps that missed their tolerance.
    """
    found: dict[str, dict[str, tuple[dict[str, Any], Result]]] = {}
    for values, result in points:
        others = {key: value for key, value in values.items() if key != METHOD}
        found.setdefault(repr(others), {})[values[METHOD]] = others, result
    return [
        _row(pair["dem"][0], pair["dem"][1], pair["dvi"][1]) for pair in found.values() if {"dem", "dvi"} <= set(pair)
    ]


def _row(others: dict[str, Any], dem: Result, dvi: Result) -> dict[str, Any]:
    row: dict[str, Any] = dict(others)
    for name, result in (("dem", dem), ("dvi", dvi)):
        summary, history = result.summary, result.history
        if TORQUE_DISC in history:
            torque = result.torque
            row[f"torque_{name}"], row[f"torque_error_{name}"] = torque.mean, torque.standard_error
            low, high = torque.interval() if torque.known else (None, None)
            row[f"torque_low_{name}"], row[f"torque_high_{name}"] = low, high
            row[f"torque_converged_{name}"] = torque.converged
        row[f"step_{name}"] = summary["dt"]
        row[f"seconds_{name}"] = summary["seconds"]["whole_run"]
        row[f"processor_{name}"] = processor = summary["seconds"].get("processor")
        merit = result.torque.figure_of_merit(processor) if TORQUE_DISC in history and processor else None
        row[f"processor_to_5_percent_{name}"] = None if merit is None else (NORMAL / WANTED) ** 2 / merit
        row[f"largest_overlap_{name}"] = summary["max_overlap"]
        if "lock_up_time" in summary:
            row[f"lock_up_time_{name}"] = summary["lock_up_time"]
    if {"torque_dem", "torque_dvi"} <= row.keys():
        row |= _torques_apart(dem.torque, dvi.torque)
    if DISC_SPEED in dem.history and DISC_SPEED in dvi.history:
        row["speed_difference"] = _speeds_apart(dem.history, dvi.history)
    steps = int(dvi.history[STEPS].sum())
    row["missed_steps_dvi"] = float(dvi.history[MISSED_STEPS].sum()) / max(steps, 1)
    return row


def _torques_apart(dem: Estimate, dvi: Estimate) -> dict[str, float | None]:
    """Difference of two torques, relative to DEM and over both standard errors; None where a number is unknown."""
    apart: dict[str, float | None] = {"torque_difference": None, "torque_difference_bars": None}
    if dem.mean is None or dvi.mean is None:
        return apart
    difference = dvi.mean - dem.mean
    if dem.mean != 0.0:
        apart["torque_difference"] = difference / abs(dem.mean)
    if dem.standard_error is not None and dvi.standard_error is not None:
        bar = math.hypot(dem.standard_error, dvi.standard_error)
        apart["torque_difference_bars"] = abs(difference) / bar if bar > 0.0 else None
    return apart


def _speeds_apart(dem: Any, dvi: Any) -> float | None:
    """Largest difference of the output's speed over the motor's largest speed (over its own where none is known)."""
    times = dem[TIME].to_numpy()
    times = times[times <= dvi[TIME].iloc[-1]]
    apart = [np.interp(times, history[TIME], history[DISC_SPEED]) for history in (dem, dvi)]
    column = ROTOR_SPEED if ROTOR_SPEED in dem else DISC_SPEED
    scale = float(np.abs(dem[column]).max())
    return float(np.abs(apart[0] - apart[1]).max() / scale) if scale > 0.0 else None


def comparison_lines(rows: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> list[str]:
    """The rows in words; ``keys``: the study's other values."""
    lines = []
    for row in rows:
        parts = []
        if {"torque_dem", "torque_dvi"} <= row.keys():
            parts.append("torque " + ", ".join(_format_torque(row, method) for method in ("dvi", "dem")))
            if row["torque_difference"] is not None:
                bars = row["torque_difference_bars"]
                over = "" if bars is None else f", {bars:.2g} standard errors"
                parts[-1] += f" ({100.0 * row['torque_difference']:+.2g} %{over})"
        if "lock_up_time_dem" in row:
            times = [row[f"lock_up_time_{name}"] for name in ("dvi", "dem")]
            dvi, dem = ("not at all" if t is None else f"at {t:.4g} s" for t in times)
            parts.append("neither locks" if times == [None, None] else f"locks {dvi} by DVI, {dem} by DEM")
        if row.get("speed_difference"):
            apart = max(100.0 * row["speed_difference"], 0.01)
            parts.append(f"output speeds at most {apart:.2g} % of the motor's apart")
        parts.append(f"{row['seconds_dvi']:.3g} s of wall-clock time against {row['seconds_dem']:.3g} s")
        spent = [row[f"processor_to_5_percent_{name}"] for name in ("dvi", "dem")]
        if None not in spent:
            dvi, dem = (format_duration(one) for one in spent)
            parts.append(f"for ± {format_percent(WANTED)} about {dvi} of processor time against {dem}")
        if row["missed_steps_dvi"]:
            parts.append(f"{100.0 * row['missed_steps_dvi']:.2g} % of the steps by DVI missed their tolerance")
        place = ", ".join(f"{key} = {row[key]}" for key in keys)
        lines.append(f"{place}: " * bool(place) + "; ".join(parts))
    return lines


def _format_torque(row: Mapping[str, Any], method: str) -> str:
    """A method's torque with its 95 % interval, and that it is not converged where it is not."""
    torque, low, high = (row[f"{name}_{method}"] for name in ("torque", "torque_low", "torque_high"))
    doubt = "" if row[f"torque_converged_{method}"] else ", not converged"
    return f"{format_mean(torque, None if low is None else (low, high))} by {method.upper()}{doubt}"
