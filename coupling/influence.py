"""Influence of grains on each other at one instant: what the sweeps of `coupling.moment_kernels` multiply with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coupling.contact_table import ContactTable
from coupling.influence_kernels import PLACE, influences, near_pairs
from coupling.neighbour_rows import NeighbourRows


class Influence(NamedTuple):
    """What `coupling.influence_kernels` finds from places alone, and the applied field in near pairs."""

    block: np.ndarray  # (p + n, 3, 4) [1/m^3] and [1/m^2]
    image_potential: np.ndarray  # (n, w, 3) [1/m^2]
    near_start: np.ndarray  # (n + 1,) int64
    near_row: np.ndarray  # (k,) int64
    near_pair: np.ndarray  # (k, 7)


def find_influence(
    table: ContactTable,
    position: np.ndarray,
    radius: np.ndarray,
    applied: np.ndarray,
    slope: np.ndarray,
    rows: NeighbourRows,
    walls: np.ndarray,
    height: np.ndarray,
    *,
    reach: float,
    smear: bool,
    own: float,
    near: bool,
    smallest_gap: float,
    room: np.ndarray | None = None,
) -> Influence:
    """The influence of grains at ``position`` (n, 3) [m] on each other; ``own`` [1/m^3]: on itself, of the mean field.

    ``applied`` (n, 3) [A/m] and its ``slope`` (n, 4), see `coupling.mutual_moments.field_slope`, drive the near pairs.

    ``room`` (q, 3, 4) may be the `block` of an earlier one, which is written over where it is large enough: it is by
    far the largest array, 96 bytes a listed neighbour.
    """
    n, p = len(position), len(rows.other)
    block = np.empty((p + n + p // 8, 3, 4)) if room is None or len(room) < p + n else room
    image_potential, count = np.empty((n, len(walls), 3)), np.empty(n, dtype=np.int64)
    where = (rows.start, rows.other, rows.shift, rows.turn_cos, rows.turn_sin)
    influences(position, radius, *where, walls, height, reach, smear, own, block, image_potential, count)
    near_start = np.zeros(n + 1, dtype=np.int64)
    if near:
        np.cumsum(count, out=near_start[1:])
    row, pair = np.empty(near_start[-1], dtype=np.int64), np.empty((near_start[-1], PLACE + 1))
    if near:
        near_pairs(table, position, radius, applied, slope, *where, reach, smear, smallest_gap, near_start, row, pair)
    return Influence(block, image_potential, near_start, row, pair)
