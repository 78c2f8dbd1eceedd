"""Influence of grains on each other at one instant: what the sweeps of `coupling.moment_kernels` multiply with."""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import GrainLawTable
from coupling.influence_kernels import PLACE, influences, near_pairs
from coupling.kernel_state import Influence, MagneticGrains, PairModel, Rows


def find_influence(
    table: GrainLawTable,
    model: PairModel,
    grains: MagneticGrains,
    rows: Rows,
    walls: np.ndarray,
    *,
    own: float,
    room: np.ndarray | None = None,
) -> Influence:
    """The influence of ``grains`` on each other; ``own`` [1/m^3]: on itself, of the mean field.

    Of the grains their places, the applied field and its slope, which drive the near pairs, are read.

    ``room`` (q, 3, 4) may be the `block` of an earlier one, which is written over where it is large enough: it is by
    far the largest array, 96 bytes a listed neighbour.
    """
    n, p = len(grains.position), len(rows.other)
    block = np.empty((p + n + p // 8, 3, 4)) if room is None or len(room) < p + n else room
    image_potential, count = np.empty((n, len(walls), 3)), np.empty(n, dtype=np.int64)
    influences(model, grains, rows, walls, own, block, image_potential, count)
    near_start = np.zeros(n + 1, dtype=np.int64)
    if model.near:
        np.cumsum(count, out=near_start[1:])
    row, pair = np.empty(near_start[-1], dtype=np.int64), np.empty((near_start[-1], PLACE + 1))
    if model.near:
        near_pairs(table, model, grains, rows, near_start, row, pair)
    return Influence(block, image_potential, near_start, row, pair)
