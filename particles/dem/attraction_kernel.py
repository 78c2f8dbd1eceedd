"""Compiled pull of a tabulated attraction (`particles.attraction`), from the true gap of every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import from_integers, maximum, select, to_integers
from geometry.kernels.simd_math import log
from geometry.kernels.simd_tables import interpolate_bilinear, interpolate_linear

# columns of a slot's drive
COLUMN, AMPLITUDE, ACROSS = range(3)


class LaggedAttraction(NamedTuple):
    """Input of the step: the table, the drive of each slot of the present list, and buffers of pulls.

    ``force`` (n, 4) [N] and ``reaction`` (x, 4) [N], the last column empty, are for pulls what columns 6 to 8 of
    `GrainState.velocity_force` and `Chunks.reaction` are for contact forces: apart from these, because their work is
    summed separately.
    """

    gap_start: float  # ln of the first gap [radii]
    per_gap_step: float  # 1/step of ln gap
    smallest_gap: float  # radii
    last_gap: float  # radii
    values: np.ndarray  # (ng, nh)
    across: np.ndarray  # (ng,)
    pair: np.ndarray  # (p, 3) column, amplitude [N], amplitude of `across` [N]
    wall: np.ndarray  # (s, 2) column, amplitude [N]
    force: np.ndarray
    reaction: np.ndarray


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pulls_at(lagged, gap, column, amplitude, across_amplitude):
    """Pulls [N] of eight slots at gaps [radii]: linear in ln gap and in the column, 0 beyond the grid."""
    values = lagged.values
    place = maximum((log(maximum(gap, lagged.smallest_gap)) - lagged.gap_start) * lagged.per_gap_step, 0.0)
    # also of what is not a number
    last_row, last_column = values.shape[0] - 2.0, values.shape[1] - 2.0
    row = to_integers(select(place < last_row, place, last_row))
    first = to_integers(select(column < last_column, column, last_column))
    x, y = place - from_integers(row), column - from_integers(first)
    pull = amplitude * interpolate_bilinear(values, row, x, first, y) + across_amplitude * interpolate_linear(
        lagged.across, row, x
    )
    return select(gap < lagged.last_gap, pull, 0.0)
