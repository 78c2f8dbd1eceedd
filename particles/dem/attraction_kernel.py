"""Compiled pull of a tabulated attraction (`particles.dem.attraction`), from the true gap of every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geometry.inner_functions import inner
from geometry.lane_functions import logarithm
from geometry.lanes import larger

# columns of a slot's drive
COLUMN, AMPLITUDE, ACROSS = range(3)


class HeldAttraction(NamedTuple):
    """What the step reads: the table, the drive of each slot of the present list, and places to gather pulls.

    ``drawn`` (n, 4) [N] and ``cross`` (x, 4) [N], the last column empty, are for pulls what columns 6 to 8 of
    `GrainState.velocity_force` and `Chunks.reaction` are for contact forces: apart from these, because their work is
    booked apart.
    """

    gap_start: float  # ln of the first gap [radii]
    per_gap_step: float  # 1/step of ln gap
    smallest_gap: float  # radii
    last_gap: float  # radii
    values: np.ndarray  # (ng, nh)
    across: np.ndarray  # (ng,)
    pair: np.ndarray  # (p, 3) column, amplitude [N], amplitude of `across` [N]
    wall: np.ndarray  # (s, 2) column, amplitude [N]
    drawn: np.ndarray
    cross: np.ndarray


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def place_of_gap(held, gap):
    """Where a gap [radii] lies among the rows of the table, with fraction. Of a number and of lanes."""
    return larger((logarithm(larger(gap, held.smallest_gap)) - held.gap_start) * held.per_gap_step, 0.0)


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pull_at(held, gap, place, column, amplitude, across_amplitude):
    """Pull [N] at a gap [radii] in the `place_of_gap`: linear in ln gap and in the column, 0 beyond the grid."""
    j = min(np.int64(column), held.values.shape[1] - 2)
    y = column - j
    i = max(min(np.int64(place), held.values.shape[0] - 2), 0)  # also of what is not a number
    x = place - i
    low = held.values[i, j] + y * (held.values[i, j + 1] - held.values[i, j])
    high = held.values[i + 1, j] + y * (held.values[i + 1, j + 1] - held.values[i + 1, j])
    side = held.across[i] + x * (held.across[i + 1] - held.across[i])
    pull = amplitude * (low + x * (high - low)) + across_amplitude * side
    return pull if gap < held.last_gap else 0.0
