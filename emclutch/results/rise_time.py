"""Rise times of current, gap field and torque: to 63 and 90 % of their final values.

The current's final value is known beforehand: V/R of the circuit, or the last value of its table. What the field goes
to is known only once the current is there: a saturated field is not proportional to it. The torque goes to what it is
on average in the last fifth; it fluctuates, so a mean over a fiftieth of the run is looked at, which belongs to the
middle of its windows. Current and field are those of the windows' ends, and of the last solve where they are held.
Catalogues give 1.7 to 4
times as long a time for the torque as for the current (63 %, powder brakes and clutches).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import CURRENT, GAP_FLUX_DENSITY, TIME, TORQUE_DISC
from emclutch.results.text import format_time

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas

SHARE = 1.0 - math.exp(-1.0)  # of the final value: one time constant of a linear coil
LATE = 0.9  # of the final value: when a switched clutch counts as on
NEAR_ZERO = 0.2  # of the final value: what is above it in the first window was not switched on
SETTLED = 0.05  # of the final value: then 63 % of the last value is reached within a tenth of the right time


def rise_times(
    history: pandas.DataFrame, final_current: float, *, begins_off: bool = False
) -> dict[str, float | str | None]:
    """Entries of a summary: `current_rise_time` and `gap_flux_density_rise_time` [s], None where there is none.

    A rise that has begun but is not over leaves its reason in an entry `..._rise_time_note`.

    Parameters
    ----------
    history : columns `time` [s], `current` [A], `gap_flux_density` [T]; windows begin at time 0.
    final_current : what the current goes to [A].
    begins_off : there is no current and no field at time 0, which has no row.
    """
    time, current = history[TIME].to_numpy(), history[CURRENT].abs().to_numpy()
    field, final = history[GAP_FLUX_DENSITY].abs().to_numpy(), abs(final_current)
    middle = time - 0.5 * np.diff(time, prepend=0.0)
    if begins_off:
        time, current, field = (np.append(0.0, values) for values in (time, current, field))
    found: dict[str, float | str | None] = {
        "current_rise_time": time_to_reach(time, current, final),
        "current_rise_time_90": time_to_reach(time, current, final, LATE),
        "gap_flux_density_rise_time": None,
        "gap_flux_density_rise_time_90": None,
    }
    if not _begins_low(current, final):
        return found
    if TORQUE_DISC in history:
        found |= _torque_rise(middle, history[TORQUE_DISC].abs().to_numpy())
    with_current, with_torque = found["current_rise_time"], found.get("torque_rise_time")
    if isinstance(with_current, float) and isinstance(with_torque, float):
        found["torque_lag"] = with_torque / with_current
    if found["current_rise_time"] is None:
        found["current_rise_time_note"] = (
            f"the current went up to {current.max():.3g} A of {final:.3g} A: run longer than {time[-1]:.3g} s"
        )
    if abs(current[-1] - final) > SETTLED * final:
        unsettled = f"the current is {current[-1]:.3g} A at the end and goes to {final:.3g} A"
    elif _still_moves(time, field):
        unsettled = "the field of the gap still changes"
    else:
        found["gap_flux_density_rise_time"] = time_to_reach(time, field, float(field[-1]))
        found["gap_flux_density_rise_time_90"] = time_to_reach(time, field, float(field[-1]), LATE)
        return found
    found["gap_flux_density_rise_time_note"] = f"{unsettled}: run longer than {time[-1]:.3g} s"
    return found


def _torque_rise(time: np.ndarray, torque: np.ndarray) -> dict[str, float | str | None]:
    """Times [s] of the torque, and what it goes to [N m], as far as it has come to rest."""
    found: dict[str, float | str | None] = {"torque_rise_time": None, "torque_rise_time_90": None}
    width = max(1, len(torque) // 50)
    smooth = np.convolve(torque, np.ones(width) / width, mode="valid")
    middle = np.convolve(time, np.ones(width) / width, mode="valid")
    last, before = torque[time > 0.8 * time[-1]], torque[(time > 0.6 * time[-1]) & (time <= 0.8 * time[-1])]
    if not len(before) or abs(last.mean() - before.mean()) > 2.0 * SETTLED * last.mean():
        found["torque_rise_time_note"] = f"the torque still changes: run longer than {time[-1]:.3g} s"
        return found
    found["torque_after_rise"] = float(last.mean())
    for name, share in (("torque_rise_time", SHARE), ("torque_rise_time_90", LATE)):
        found[name] = time_to_reach(middle, smooth, float(last.mean()), share)
    return found


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
            then = "it does not reach 90 %" if late is None else f"90 % after {format_time(late)}"
            lines.append(f"The {name} reaches 63 % of its final {final} after {format_time(early)}, {then}")
        elif note := summary.get(f"{name}_rise_time_note"):
            lines.append(f"The rise of the {name} is not over at the end of the run: {note.partition(':')[0]}")
    if (lag := summary.get("torque_lag")) is not None:
        lines[-1] += f"; {lag:.3g} times as long as the current for 63 %"
    return lines
