"""Rise times of current, gap field and torque: to 63 and 90 % of their final values.

The current's final value is known beforehand: V/R of the circuit, or the last value of its table. What the field goes
to is known only once the current is there: a saturated field is not proportional to it. Current and field are those of
the windows' ends, and of the last solve where they are held. Catalogues give 1.7 to 4 times as long a time for the
torque as for the current (63 %, powder brakes and clutches).

The torque fluctuates, and the first window above a level comes too early: by 2 to 20 % at 90 % of the final value. Its
curve is therefore the monotone least-squares fit to the moving mean of the replicas' mean torque. H. Mukerjee,
"Monotone nonparametric regression", Annals of Statistics 16 (1988) 741-750. The moving mean takes `SMOOTHING` of the
time between 40 and 90 %. The final value is the mean of the last fifth of the run.

The 95 % interval of a rise time lies between the times at which the curve is at the level minus and plus the half width
of (moving mean - fraction x final value), by Student's t. Two half widths are computed, and the wider one is used: from
the fluctuation of the torque after the rise with its correlation time, and from the scatter between the replicas. One
replica has the first one only. Measured coverage: tests/results/test_rise_time.py.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import CURRENT, GAP_FLUX_DENSITY, TIME, TORQUE_DISC
from emclutch.results.fits import Measured, student
from emclutch.results.statistics import MIN_SAMPLES, correlation_samples
from emclutch.results.text import format_time

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas

SHARE = 1.0 - math.exp(-1.0)  # of the final value: one time constant of a linear coil
LATE = 0.9  # of the final value: when a switched clutch counts as on
NEAR_ZERO = 0.2  # of the final value: what is above it in the first window was not switched on
SETTLED = 0.05  # of the final value: then 63 % of the last value is reached within a tenth of the right time
EARLY = 0.4  # of the final value
SMOOTHING = 1.0 / 3.0  # of the time between 40 and 90 %: delays the 63 % of an exponential rise by 1.5 %
FEWEST = 5  # windows: the last fifth of the run, and the one before, have one each
LONG_ENOUGH = 3.0
"""Least length of a run over its 90 % time. Then the mean of the last fifth of an exponential rise is 0.2 % below its
final value, and the 90 % time is not too small; a run of 5 time constants is 2.2 times as long, and loses 4 %."""


def rise_times(
    history: pandas.DataFrame,
    final_current: float,
    *,
    begins_off: bool = False,
    replicas: Sequence[pandas.DataFrame] = (),
) -> dict[str, Any]:
    """Entries of a summary: `current_rise_time` and `gap_flux_density_rise_time` [s], None where there is none.

    A rise that has begun but is not over leaves its reason in an entry `..._rise_time_note`. With a torque also
    `torque_rise_time` [s] and its 95 % interval `torque_rise_time_interval` [s], None where fewer than `MIN_SAMPLES`
    windows follow the rise; its upper end is None where it lies beyond the end of the run. `torque_rise_too_short` is
    true where the final torque is not reached, and `torque_rise_required_end` is the least `time.end` [s] then, else
    None.

    Parameters
    ----------
    history : columns `time` [s], `current` [A], `gap_flux_density` [T]; windows begin at time 0.
    final_current : what the current goes to [A].
    begins_off : there is no current and no field at time 0, which has no row.
    replicas : histories of the other replicas, of which the torques count.
    """
    time, current = history[TIME].to_numpy(), history[CURRENT].abs().to_numpy()
    field, final = history[GAP_FLUX_DENSITY].abs().to_numpy(), abs(final_current)
    if begins_off:
        time, current, field = (np.append(0.0, values) for values in (time, current, field))
    found: dict[str, Any] = {
        "current_rise_time": time_to_reach(time, current, final),
        "current_rise_time_90": time_to_reach(time, current, final, LATE),
        "gap_flux_density_rise_time": None,
        "gap_flux_density_rise_time_90": None,
    }
    if not _begins_low(current, final):
        return found
    if TORQUE_DISC in history:
        current_late = found["current_rise_time_90"] or _expected_late(float(time[-1]), float(current[-1]) / final)
        torques = _equal_windows([history, *(one for one in replicas if len(one))])
        found |= _torque_rise(*torques, current_late)
    with_current, with_torque = found["current_rise_time"], found.get("torque_rise_time")
    if isinstance(with_current, float) and isinstance(with_torque, float):
        found["torque_lag"] = with_torque / with_current
    if found["current_rise_time"] is None:
        found["current_rise_time_note"] = f"the current went up to {current.max():.3g} A of {final:.3g} A"
    if abs(current[-1] - final) > SETTLED * final:
        unsettled = f"the current is {current[-1]:.3g} A at the end and approaches {final:.3g} A"
    elif _still_moves(time, field):
        unsettled = "the field of the gap still changes"
    else:
        found["gap_flux_density_rise_time"] = time_to_reach(time, field, float(field[-1]))
        found["gap_flux_density_rise_time_90"] = time_to_reach(time, field, float(field[-1]), LATE)
        return found
    found["gap_flux_density_rise_time_note"] = unsettled
    return found


def _equal_windows(histories: Sequence[pandas.DataFrame]) -> tuple[float, np.ndarray]:
    """Return length [s] of equal windows from time 0 to the earliest end, and the torques over them (m, n) [N m].

    There are as many as the first history has until then, and `FEWEST` at the least.
    """
    end = min(float(one[TIME].iloc[-1]) for one in histories)
    edges = np.linspace(0.0, end, max(FEWEST, int(np.count_nonzero(histories[0][TIME] <= end))) + 1)
    rows = []
    for one in histories:
        time, torque = one[TIME].to_numpy(), one[TORQUE_DISC].to_numpy()
        integral = np.cumsum(torque * np.diff(time, prepend=0.0))
        rows.append(np.diff(np.interp(edges, np.append(0.0, time), np.append(0.0, integral))) / edges[1])
    return float(edges[1]), np.array(rows)


def _expected_late(end: float, share: float) -> float:
    """Return when a current is expected at 90 % of its final value [s], by an exponential through its share at the end.

    0 where the share is that of no such rise.
    """
    return end * math.log(1.0 - LATE) / math.log1p(-share) if 0.0 < share < LATE else 0.0


def _torque_rise(width: float, torque: np.ndarray, current_late: float) -> dict[str, Any]:
    """Return times [s] of the torque, and what it goes to [N m], as far as it has come to rest.

    Parameters
    ----------
    width : length of a window [s]; the first begins at time 0.
    torque : (m, n) of m replicas over n windows [N m].
    current_late : when the current reaches 90 % [s]; a torque that is not known to rest is not expected there before.
    """
    replicas, count = torque.shape
    end, middle = count * width, (np.arange(count) + 0.5) * width
    last, before = middle > 0.8 * end, (middle > 0.6 * end) & (middle <= 0.8 * end)
    torque = torque * np.sign(torque[:, last].mean())
    finals = torque[:, last].mean(axis=1)
    final = float(finals.mean())
    settled = before.any() and abs(final - torque[:, before].mean()) <= 2.0 * SETTLED * final
    rough = _monotone(torque.mean(axis=0))
    reached = _reached(middle, rough, LATE * final)
    late = end if reached is None else reached
    too_short = not settled or (_begins_low(rough, final) and end < LONG_ENOUGH * late)
    required = LONG_ENOUGH * max(late, current_late)
    found: dict[str, Any] = {
        "torque_rise_time": None,
        "torque_rise_time_interval": None,
        "torque_rise_time_90": None,
        "torque_rise_time_90_interval": None,
        "torque_rise_replicas": replicas,
        "torque_rise_too_short": too_short,
        "torque_rise_required_end": required if too_short else None,
    }
    if not settled:
        found["torque_rise_time_note"] = "the torque still changes"
        return found
    found["torque_after_rise"] = final
    length = max(width, SMOOTHING * (late - (_reached(middle, rough, EARLY * final) or 0.0)))
    curve = _monotone(_moving_mean(torque.mean(axis=0), length / width))
    if not _begins_low(curve, final):
        return found
    after = torque[:, middle > min(late, 0.8 * end)]
    for name, share in (("torque_rise_time", SHARE), ("torque_rise_time_90", LATE)):
        found[name] = time = _reached(middle, curve, share * final)
        if time is None or after.shape[1] < MIN_SAMPLES:
            continue
        near = np.abs(middle - time) <= max(0.5 * length, 0.51 * width)
        half = _half_width(after, length / width, share, int(last.sum()))
        if replicas > 1:
            half = max(half, Measured.of(torque[:, near].mean(axis=1) - share * finals).half_width())
        level = share * final
        found[f"{name}_interval"] = [_reached(middle, curve, level + sign * half) for sign in (-1.0, 1.0)]
    return found


def _half_width(after: np.ndarray, length: float, share: float, last: int) -> float:
    """Return the half width (95 %) of a mean over `length` windows minus a fraction of that over the `last` windows.

    From the torques after the rise (m, n), whose fluctuation is taken for that during the rise, and the mean of the
    replicas [N m].
    """
    correlated = correlation_samples(after)
    independent = max(1.25, after.shape[1] / correlated)  # samples of each replica; fewer say nothing of their variance
    variance = float(after.var(axis=1).mean()) * independent / (independent - 1.0)
    factor = min(1.0, correlated / length) + share**2 * min(1.0, correlated / last)
    return student(len(after) * (independent - 1.0)) * math.sqrt(variance * factor / len(after))


def _moving_mean(value: np.ndarray, length: float) -> np.ndarray:
    """Return means of (n,) over `length` windows about each, shorter and still symmetric at both ends."""
    edge = np.arange(value.size + 1.0)
    integral = np.append(0.0, np.cumsum(value))
    middle = edge[:-1] + 0.5
    half = np.minimum(0.5 * length, np.minimum(middle, value.size - middle))
    return (np.interp(middle + half, edge, integral) - np.interp(middle - half, edge, integral)) / (2.0 * half)


def _monotone(value: np.ndarray) -> np.ndarray:
    """Return the rising least-squares fit."""
    from scipy.optimize import isotonic_regression

    return isotonic_regression(value).x


def _reached(time: np.ndarray, curve: np.ndarray, level: float) -> float | None:
    """Return the time [s] at which a rising curve is at a level, 0 where it begins above it, None beyond its end."""
    return None if level > curve[-1] else float(np.interp(level, curve, time, left=0.0))


def time_to_reach(time: np.ndarray, value: np.ndarray, final: float, share: float = SHARE) -> float | None:
    """Time [s] at which a positive quantity that begins near zero first reaches a fraction, 63 %, of `final`.

    None if it does not reach it, or does not begin near zero.

    Parameters
    ----------
    time, value : (n,) [s] and in the unit of `final`; linear between, and from the first of values that are held.
    """
    reached = np.flatnonzero(value >= share * final)
    if not _begins_low(value, final) or len(reached) == 0:
        return None
    first = int(reached[0])  # not 0: the first value is near zero
    before = first - 1
    if value[first] - value[before] < SETTLED * final:  # a longer change than that was not held, but is a jump
        while before > 0 and value[before - 1] == value[before]:
            before -= 1
    return float(np.interp(share * final, value[[before, first]], time[[before, first]]))


def _begins_low(value: np.ndarray, final: float) -> bool:
    return final > 0.0 and len(value) > 0 and bool(value[0] <= NEAR_ZERO * final)


def _still_moves(time: np.ndarray, value: np.ndarray) -> bool:
    """True if the last tenth of the run changes a quantity by more than `SETTLED` of its value."""
    late = value[time >= 0.9 * time[-1]]
    return bool(np.ptp(late) > SETTLED * value[-1])


def in_words(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on the rise of current and torque of a summary; none where nothing was switched on."""
    if summary.get("current_rise_time") is None and not summary.get("current_rise_time_note"):
        return []
    lines = []
    for name, final in (
        ("current", f"{abs(summary.get('final_current') or 0.0):.4g} A"),
        ("torque", f"{summary.get('torque_after_rise') or 0.0:.3g} N m"),
    ):
        early, late = (summary.get(f"{name}_rise_time{suffix}") for suffix in ("", "_90"))
        if early is not None:
            half, most = (
                _interval_in_words(summary.get(f"{name}_rise_time{suffix}_interval")) for suffix in ("", "_90")
            )
            then = "not 90 %" if late is None else f"90 % at {format_time(late)}{most}"
            lines.append(f"{name.capitalize()}: 63 % of its final {final} at {format_time(early)}{half}, {then}")
        elif note := summary.get(f"{name}_rise_time_note"):
            is_told = name == "torque" and summary.get("torque_rise_too_short")
            more = f"run to {format_time(summary['torque_rise_required_end'])} or later" if is_told else "run longer"
            lines.append(f"The rise of the {name} is not over at the end of the run: {note}; {more}")
    if (lag := summary.get("torque_lag")) is not None:
        lines.append(f"The torque takes {lag:.3g} times as long as the current to 63 %")
    if summary.get("torque_rise_time_interval") and summary.get("torque_rise_replicas") == 1:
        lines.append(
            "One replica: the intervals of the torque's rise leave out the scatter between replicas "
            "(accuracy.replicas = 4 includes it)"
        )
    if summary.get("torque_rise_too_short") and not summary.get("torque_rise_time_note"):
        needed = format_time(summary["torque_rise_required_end"])
        lines.append(f"The run is too short for the torque to reach its final value: time.end = {needed} or later")
    return lines


def _interval_in_words(interval: Sequence[float | None] | None) -> str:
    """Return the 95 % interval of a rise time [s] in brackets; empty where it is unknown."""
    if not interval:
        return ""
    low, high = interval
    end = "beyond the end of the run" if high is None else format_time(high)
    return f" ({format_time(low or 0.0)} to {end})"
