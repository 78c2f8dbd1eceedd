"""Whether the drive of a clutch, its current or a speed, still changes where a steady torque is looked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.columns import CURRENT, DISC_SPEED, ROTOR_SPEED, TIME

if TYPE_CHECKING:
    import pandas

STEADY = 0.01
"""Change of a current or a speed, relative to its largest value, below which it is steady."""

_NAMES = {CURRENT: "current", ROTOR_SPEED: "speed of the rotor", DISC_SPEED: "speed of the disc"}


def changing_drive(history: pandas.DataFrame, start: float | None = None) -> str:
    """Say what of the drive changes from `start` [s] on, by default in the second half of a run; empty: nothing does.

    A longer run has no steadier torque then: it takes the drive further.
    """
    time = history[TIME].to_numpy()
    late = time >= (0.5 * time[-1] if start is None else start) if len(time) else slice(0)
    for column, name in _NAMES.items():
        if column not in history:
            continue
        values = history[column].to_numpy()[late]
        change = float(np.ptp(values)) if len(values) else 0.0
        largest = float(history[column].abs().max())
        if change > STEADY * largest:
            return f"the {name} changes by {100.0 * change / largest:.2g} % of its largest value in the averaged part"
    return ""
