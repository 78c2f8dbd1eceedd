"""DEM against DVI: what the same scene gives by both, for studies over ``contact.method``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from emclutch.results import Result

METHOD = "contact.method"
BATCHES = 10


def compare_methods(points: Sequence[tuple[Mapping[str, Any], Result]]) -> list[dict[str, Any]]:
    """A row for every point of a study that was run by both methods.

    Parameters
    ----------
    points
        The values that make a point, "contact.method" among them, and its result.

    Returns
    -------
    list of dict
        The other values; of each method the mean torque on the output in the second half of the run [N m] with its
        standard error from ten batches, step [s], wall-clock time [s], largest overlap, lock-up time [s]; the torque's
        difference relative to DEM and over both error bars; the largest difference of the output's speeds over the
        motor's largest; the share of the DVI's steps that missed their tolerance.
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
        if "torque_disc" in history:
            row[f"torque_{name}"], row[f"torque_error_{name}"] = _second_half(history["torque_disc"].to_numpy())
        row[f"step_{name}"] = summary["dt"]
        row[f"seconds_{name}"] = summary["seconds"]["whole_run"]
        row[f"largest_overlap_{name}"] = summary["max_overlap"]
        if "lock_up_time" in summary:
            row[f"lock_up_time_{name}"] = summary["lock_up_time"]
    if "torque_dem" in row:
        difference = row["torque_dvi"] - row["torque_dem"]
        bar = float(np.hypot(row["torque_error_dem"], row["torque_error_dvi"]))
        row["torque_difference"] = difference / abs(row["torque_dem"]) if row["torque_dem"] != 0.0 else None
        row["torque_difference_bars"] = abs(difference) / bar if bar > 0.0 else None
    if "disc_speed" in dem.history and "disc_speed" in dvi.history:
        row["speed_difference"] = _speeds_apart(dem.history, dvi.history)
    steps = int(dvi.history["steps"].sum())
    row["missed_steps_dvi"] = float(dvi.history["missed_steps"].sum()) / max(steps, 1)
    return row


def _second_half(signal: np.ndarray) -> tuple[float, float]:
    """Mean and standard error of the second half, from batches; the windows of a run are of equal duration."""
    late = signal[len(signal) // 2 :]
    batches = [part.mean() for part in np.array_split(late, min(BATCHES, len(late)))]
    if len(batches) < 2:
        return float(late.mean()), float("nan")
    return float(late.mean()), float(np.std(batches, ddof=1) / np.sqrt(len(batches)))


def _speeds_apart(dem: Any, dvi: Any) -> float | None:
    """Largest difference of the output's speed over the motor's largest speed (over its own where none is known)."""
    times = dem["time"].to_numpy()
    times = times[times <= dvi["time"].iloc[-1]]
    apart = [np.interp(times, history["time"], history["disc_speed"]) for history in (dem, dvi)]
    column = "rotor_speed" if "rotor_speed" in dem else "disc_speed"
    scale = float(np.abs(dem[column]).max())
    return float(np.abs(apart[0] - apart[1]).max() / scale) if scale > 0.0 else None


def comparison_lines(rows: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> list[str]:
    """The rows in words; ``keys``: the study's other values."""
    lines = []
    for row in rows:
        parts = []
        if "torque_dem" in row:
            parts.append(
                f"torque {row['torque_dvi']:.4g} +- {row['torque_error_dvi']:.2g} N m by DVI, "
                f"{row['torque_dem']:.4g} +- {row['torque_error_dem']:.2g} by DEM"
            )
            if row["torque_difference"] is not None and row["torque_difference_bars"] is not None:
                bars = f"{row['torque_difference_bars']:.2g} error bars"
                parts[-1] += f" ({100.0 * row['torque_difference']:+.2g} %, {bars})"
        if "lock_up_time_dem" in row:
            times = [row[f"lock_up_time_{name}"] for name in ("dvi", "dem")]
            dvi, dem = ("not at all" if t is None else f"at {t:.4g} s" for t in times)
            parts.append("neither locks" if times == [None, None] else f"locks {dvi} by DVI, {dem} by DEM")
        if row.get("speed_difference"):
            parts.append(f"output speeds at most {100.0 * row['speed_difference']:.2g} % of the motor's apart")
        parts.append(f"{row['seconds_dvi']:.3g} s of wall-clock time against {row['seconds_dem']:.3g} s")
        if row["missed_steps_dvi"]:
            parts.append(f"{100.0 * row['missed_steps_dvi']:.2g} % of the steps by DVI missed their tolerance")
        place = ", ".join(f"{key} = {row[key]}" for key in keys)
        lines.append(f"{place}: " * bool(place) + "; ".join(parts))
    return lines
