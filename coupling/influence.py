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
    twin: np.ndarray | None = None,
) -> Influence:
    """The influence of ``grains`` on each other; ``own`` [1/m^3]: on itself, of the mean field.

    Of the grains their places, the applied field and its slope, which drive the near pairs, are read.

    ``room`` (q, 3, 4) may be the `block` of an earlier one, which is written over where it is large enough: it is by
    far the largest array, 96 bytes a listed neighbour. ``twin`` (p,) is where each entry's pair stands in the row of the
    other grain: what both see is found once. None: every entry for itself.
    """
    n, p = len(grains.position), len(rows.other)
    twin = np.full(p, -1, dtype=np.int32) if twin is None else twin
    block = np.empty((p + n + p // 8, 3, 4)) if room is None or len(room) < p + n else room
    image_potential, place = np.empty((n, len(walls), 3)), np.zeros(p + 1, dtype=np.int64)
    influences(model, grains, rows, twin, walls, own, block, image_potential, place[1:])
    if not model.near:
        return Influence(
            block, image_potential, np.zeros(n + 1, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty((0, PLACE + 1))
        )
    np.cumsum(place, out=place)
    row, pair = np.empty(place[-1], dtype=np.int64), np.empty((place[-1], PLACE + 1))
    near_pairs(table, model, grains, rows, twin, place, row, pair)
    return Influence(block, image_potential, place[rows.start], row, pair)
