"""How long current and field of the gap take to come: the time to 63 % of the value that they go to.

The current's final value is known beforehand: V/R of the circuit, or the last value of its table. What the field goes
to is known only once the current is there: a saturated field is not proportional to it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas

SHARE = 1.0 - math.exp(-1.0)  # of the final value: one time constant of a linear coil
NEAR_ZERO = 0.2  # of the final value: what is above it in the first window was not switched on
SETTLED = 0.05  # of the final value: then 63 % of the last value is reached within a tenth of the right time


def rise_times(history: pandas.DataFrame, final_current: float) -> dict[str, float | str | None]:
    """Entries of a summary: `current_rise_time` and `gap_flux_density_rise_time` [s], None where there is none.

    A rise that has begun but is not over leaves its reason in an entry `..._rise_time_note`.

    Parameters
    ----------
    history : columns `time` [s], `current` [A], `gap_flux_density` [T]; windows begin at time 0.
    final_current : what the current goes to [A].
    """
    time, current = history["time"].to_numpy(), history["current"].abs().to_numpy()
    field, final = history["gap_flux_density"].abs().to_numpy(), abs(final_current)
    found: dict[str, float | str | None] = {
        "current_rise_time": time_to_reach(time, current, final),
        "gap_flux_density_rise_time": None,
    }
    if not _begins_low(current, final):
        return found
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
        return found
    found["gap_flux_density_rise_time_note"] = f"{unsettled}: run longer than {time[-1]:.3g} s"
    return found


def time_to_reach(time: np.ndarray, value: np.ndarray, final: float) -> float | None:
    """Time [s] at which a positive quantity that begins near zero first reaches 63 % of `final`.

    None if it does not reach it, or does not begin near zero.

    Parameters
    ----------
    time, value : (n,) [s] and in the unit of `final`; linear between.
    """
    reached = np.flatnonzero(value >= SHARE * final)
    if not _begins_low(value, final) or len(reached) == 0:
        return None
    first = int(reached[0])  # not 0: the first value is near zero
    return float(np.interp(SHARE * final, value[first - 1 : first + 1], time[first - 1 : first + 1]))


def _begins_low(value: np.ndarray, final: float) -> bool:
    return final > 0.0 and len(value) > 0 and bool(value[0] <= NEAR_ZERO * final)


def _still_moves(time: np.ndarray, value: np.ndarray) -> bool:
    """Whether the last tenth of the run changes a quantity by more than `SETTLED` of its value."""
    late = value[time >= 0.9 * time[-1]]
    return bool(np.ptp(late) > SETTLED * value[-1])
