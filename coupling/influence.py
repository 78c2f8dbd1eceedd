"""Influence of grains on each other at one instant: what the sweeps of `coupling.moment_kernels` multiply with."""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import GrainLawTable
from coupling.influence_kernels import PLACE, image_influences, near_pairs, pair_influences
from coupling.kernel_state import Influence, MagneticGrains, PairModel, Rows


def find_influence(
    table: GrainLawTable,
    model: PairModel,
    grains: MagneticGrains,
    rows: Rows,
    walls: np.ndarray,
    *,
    own: float,
    room: Influence | None = None,
    twin: np.ndarray | None = None,
) -> Influence:
    """The influence of ``grains`` on each other; ``own`` [1/m^3]: on itself, of the mean field.

    Of the grains their places, the applied field and its slope, which drive the near pairs, are read.

    ``room`` may be an earlier one, whose largest arrays are written over where they are large enough: to fetch them
    from the system anew takes as long as to fill them. ``twin`` (p,) is where each entry's pair stands in the row of
    the other grain: what both see is found once. None: every entry for itself.
    """
    n, p = len(grains.position), len(rows.other)
    twin = np.full(p, -1, dtype=np.int32) if twin is None else twin
    pair = _room_for(p, (6,), None if room is None else room.pair)
    near_place, image_place = np.zeros((2, p + 1), dtype=np.int64)
    pair_influences(model, grains, rows, twin, pair, near_place[1:], image_place[1:])
    np.cumsum(image_place, out=image_place)
    image_row = np.empty(image_place[-1], dtype=np.int64)
    image = _room_for(len(image_row), (3, 4), None if room is None else room.image)
    itself, own_image = np.empty((n, 3, 4)), np.empty((n, len(walls), 3))
    image_influences(model, grains, rows, twin, walls, own, image_place, image_row, image, itself, own_image)
    np.cumsum(near_place, out=near_place)
    k = near_place[-1]
    near_row, near_twin, near = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.int64), np.empty((k, PLACE + 1))
    near_pairs(table, model, grains, rows, twin, near_place, near_row, near_twin, near)
    return Influence(
        twin, pair, itself, image_place[rows.start], image_row, image, own_image, near_place[rows.start], near_row,
        near_twin, near,
    )  # fmt: skip


def _room_for(count: int, shape: tuple[int, ...], before: np.ndarray | None) -> np.ndarray:
    """``before`` where it has ``count`` rows, or a new array with an eighth more."""
    return before if before is not None and len(before) >= count else np.empty((count + count // 8, *shape))
