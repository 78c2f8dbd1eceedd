"""Speeds of both shafts against time, measured ones laid over; torque against the motor's speed. One run or several."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from emclutch.results.columns import DISC_SPEED, ROTOR_SPEED, TIME, TORQUE_DISC
from emclutch.results.errors import OutputError
from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    LINES,
    draw_measured,
    finish_axis,
    mark_lock_up,
    new_figure,
    save_picture,
)
from emclutch.results.quantity import RPM
from emclutch.results.text import time_unit

OUTPUTS = ("#0b5fa5", "#2a8c3f", "#8a1c7c", "#b5179e", "#0a7d7d", "#7f6000")
MIN_EXPLAINED = 0.5  # of the torque's variance: a parabola that explains less is not drawn
MIN_SLIP = 0.05  # of the motor's speed: below it the shot begins to hold
VARIES = 1e-3  # of the fastest speed: a free shaft that is held by dry friction chatters


def speeds_vary(history: Any) -> bool:
    """True if a history has both shafts and the speed of one of them changes."""
    if ROTOR_SPEED not in history or DISC_SPEED not in history:
        return False
    speeds = [_column(history, name) for name in (ROTOR_SPEED, DISC_SPEED)]
    fastest = max(float(np.max(np.abs(speed), initial=0.0)) for speed in speeds)
    return any(bool(len(speed)) and float(np.ptp(speed)) > VARIES * fastest for speed in speeds)


def speed_picture(
    path: str | Path,
    runs: Mapping[str, Any],
    *,
    measured: Mapping[str, np.ndarray] | None = None,
    title: str | None = None,
    locked: float | None = None,
) -> Path:
    """Draw the speeds of motor (rotor) and output (disc) against time, in rpm.

    Parameters
    ----------
    path : PNG to write.
    runs : name -> history with the columns `time` [s], `rotor_speed` and `disc_speed` [rad/s]; the name is left out
        of the legend where there is one run only. Motors that turn alike are drawn once.
    measured : name -> (n, 2) time [s] and speed [rpm], or (n, 3) with errors, as `read_measured` returns them.
    locked : time [s] from which on the shafts are locked; it is marked.
    """
    figure, (axis,) = new_figure(10.5, 5.0, title)
    longest = max((float(np.max(_column(one, TIME), initial=0.0)) for one in runs.values()), default=0.0)
    unit, factor = time_unit(longest)
    motors: list[tuple[np.ndarray, np.ndarray]] = []
    styles = _styles(list(runs))
    for name, history in runs.items():
        time, motor, output = (_column(history, column) for column in (TIME, ROTOR_SPEED, DISC_SPEED))
        of = f", {name}" if len(runs) > 1 else ""
        if not any(_alike(other, (time, motor)) for other in motors):
            same = sum(_alike((_column(h, TIME), _column(h, ROTOR_SPEED)), (time, motor)) for h in runs.values())
            label, line = "motor" if same == len(runs) else f"motor{of}", ("--", ":", "-.")[len(motors) % 3]
            axis.plot(factor * time, RPM * motor, color=BODY_COLOURS["rotor"], lw=1.4, ls=line, label=label)
            motors.append((time, motor))
        color, line = styles[name]
        axis.plot(factor * time, RPM * output, color=color, lw=1.6, label=f"output{of}", ls=line)
    draw_measured(axis, measured, per_x=factor, joined=False)
    mark_lock_up(axis, factor, locked)
    finish_axis(axis, f"time [{unit}]", "speed [rpm]")
    return save_picture(figure, path)


def _styles(names: list[str]) -> dict[str, tuple[str, str]]:
    """Colour and line of each run; one colour for a point that was run by DEM (full line) and by DVI (dashed)."""
    methods = ("method dem", "method dvi")
    points = [", ".join(part for part in name.split(", ") if part not in methods) for name in names]
    order = list(dict.fromkeys(points))
    if len(order) == len(names):
        return {
            name: (OUTPUTS[k % len(OUTPUTS)], LINES[k // len(OUTPUTS) % len(LINES)]) for k, name in enumerate(names)
        }
    return {
        name: (OUTPUTS[order.index(point) % len(OUTPUTS)], "--" if "method dvi" in name.split(", ") else "-")
        for name, point in zip(names, points, strict=True)
    }


def torque_speed_picture(path: str | Path, runs: Mapping[str, Any], *, title: str | None = None) -> Path:
    """Draw the torque on the output against the motor's speed while they slip, and the nearest parabola K omega^2.

    Once locked the clutch carries the load, whatever it could: those windows are left out. The parabola is that of the
    windows in which the output stands, or nearly; a turning output meets the shot at another speed. Its R^2 is in the
    legend; below `MIN_EXPLAINED` there is no parabola to speak of.

    Parameters
    ----------
    path : PNG to write.
    runs : name -> history with the columns `rotor_speed`, `disc_speed` [rad/s] and `torque_disc` [N m] (window means).
    """
    figure, (axis,) = new_figure(10.5, 5.0, title)
    for number, (name, history) in enumerate(runs.items()):
        motor, output = _column(history, ROTOR_SPEED), _column(history, DISC_SPEED)
        speed, torque = np.abs(motor), _column(history, TORQUE_DISC)
        slips = np.abs(motor - output) > MIN_SLIP * speed
        stands = slips & (np.abs(output) <= MIN_SLIP * speed)
        colour, of = OUTPUTS[number % len(OUTPUTS)], f"{name}: " if len(runs) > 1 else ""
        axis.plot(RPM * speed[stands], torque[stands], ls="", marker=".", ms=3.5, alpha=0.6, color=colour)
        moving = slips & ~stands
        axis.plot(RPM * speed[moving], torque[moving], ls="", marker="o", ms=3.0, mfc="none", mew=0.6, alpha=0.6,
                  color=colour, label=f"{of}the output turns" if moving.any() else None)  # fmt: skip
        factor = quadratic_factor(speed[stands], torque[stands])
        explained = None if factor is None else explained_share(factor, speed[stands], torque[stands])
        if factor is not None and explained is not None and explained >= MIN_EXPLAINED:
            along = np.linspace(0.0, float(speed[slips].max()), 101)
            at_1000 = factor * (1000.0 / RPM) ** 2
            axis.plot(RPM * along, factor * along**2, color=colour, lw=1.6,
                      label=f"{of}{at_1000:.3g} N m · (rpm/1000)², R² = {explained:.2f}")  # fmt: skip
    finish_axis(axis, "speed of the motor [rpm]", "torque on the output [N m]")
    return save_picture(figure, path)


def quadratic_factor(speed: np.ndarray, torque: np.ndarray) -> float | None:
    """K [N m s^2] of the parabola K omega^2 nearest to the torques; None where nothing turns."""
    square = np.square(np.asarray(speed, dtype=np.float64))
    return float(square @ torque / (square @ square)) if np.any(square) else None


def explained_share(factor: float, speed: np.ndarray, torque: np.ndarray) -> float | None:
    """R^2 of the parabola: the fraction of the torques' variance that it explains; None of one torque."""
    total = float(np.sum((torque - np.mean(torque)) ** 2))
    left = float(np.sum((torque - factor * np.square(speed)) ** 2))
    return 1.0 - left / total if total > 0.0 else None


def _column(history: Any, name: str) -> np.ndarray:
    if name not in history:
        raise OutputError(f"the history has no {name}: the scene has no such shaft")
    return np.asarray(history[name], dtype=np.float64)


def _alike(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> bool:
    """True if two courses agree to 1 % of the larger one's peak, at the times of the first."""
    scale = max(np.max(np.abs(one[1]), initial=0.0), np.max(np.abs(other[1]), initial=0.0))
    if not len(one[0]) or not len(other[0]):
        return False
    within = one[0] <= other[0][-1]
    return bool(np.all(np.abs(np.interp(one[0], *other) - one[1])[within] <= 0.01 * scale))
