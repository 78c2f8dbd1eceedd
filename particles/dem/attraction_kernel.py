"""Compiled pull of a tabulated attraction (`particles.dem.attraction`), from the true gap of every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geometry.inner_functions import inner
from geometry.lane_functions import logarithm
from geometry.lane_tables import bilinear, linear
from geometry.lanes import as_lanes, larger, where, whole_part

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
def pulls_at(held, gap, column, amplitude, across_amplitude):
    """Pulls [N] of eight slots at gaps [radii]: linear in ln gap and in the column, 0 beyond the grid."""
    values = held.values
    place = larger((logarithm(larger(gap, held.smallest_gap)) - held.gap_start) * held.per_gap_step, 0.0)
    # also of what is not a number
    last_row, last_column = values.shape[0] - 2.0, values.shape[1] - 2.0
    row = whole_part(where(place < last_row, place, last_row))
    first = whole_part(where(column < last_column, column, last_column))
    x, y = place - as_lanes(row), column - as_lanes(first)
    pull = amplitude * bilinear(values, row, x, first, y) + across_amplitude * linear(held.across, row, x)
    return where(gap < held.last_gap, pull, 0.0)
