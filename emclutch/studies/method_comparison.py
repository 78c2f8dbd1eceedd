"""DEM against DVI: what the same scene gives by both, for studies over ``contact.method``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from emclutch.results import Estimate, Result
from emclutch.results.columns import DISC_SPEED, MISSED_STEPS, ROTOR_SPEED, STEPS, TIME, TORQUE_DISC
from emclutch.results.fits import NORMAL

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
