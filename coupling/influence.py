"""Influence matrices of grains on each other at one instant, for the sweeps of `coupling.moment_kernels`."""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import GrainLawTable
from coupling.influence_kernels import (
    N_NEAR,
    image_influences,
    near_pairs,
    pair_kinds,
    select_pairs,
)
from coupling.kernel_state import N_PAIR, Influence, MagneticGrains, PairModel, PairSubset, Rows
from coupling.pair_fields import OVER_4PI, self_field_factor, self_potential_factor
from coupling.row_kernels import IMAGED, NEAR
from geometry.kernels.simd import LANES


def find_influence(
    table: GrainLawTable,
    model: PairModel,
    grains: MagneticGrains,
    rows: Rows,
    walls: np.ndarray,
    *,
    room: Influence | None = None,
    twin: np.ndarray | None = None,
) -> Influence:
    """The influence of ``grains`` on each other: of them their places, the applied field and its slope are read.

    ``room`` may be an earlier one, whose largest arrays are written over where they are large enough: to fetch them
    from the system again takes as long as to fill them. ``twin`` (p,) is where each entry's pair stands in the row of
    the other grain: what both see is computed once. None: every entry for itself.
    """
    n, p = len(grains.position), len(rows.other)
    twin = np.full(p, -1, dtype=np.int32) if twin is None else twin
    kind = np.empty(p, dtype=np.uint8)
    pair_kinds(model, grains, rows, kind)
    imaged, near = (pair_subset(rows, twin, kind, bit) for bit in (IMAGED, NEAR))
    many = 4 if model.near else 3  # rows of a block
    image = reuse_or_allocate(len(imaged.entry) + 1, (many, 4), None if room is None else room.image)
    itself = np.zeros((n, many, 4))
    itself[:, range(3), range(3)] = self_field_factor(model.reach, model.smear)
    if model.near:
        itself[:, 3, 3] = OVER_4PI / grains.radius + self_potential_factor(model.reach, model.smear)
    image_influences(
        model, grains, rows, imaged, walls, image.reshape(-1, 4 * many), itself.reshape(-1, 4 * many)
    )
    near_pair = reuse_or_allocate(len(near.unique), (N_NEAR, LANES), None if room is None else room.near_pair)
    near_pairs(table, model, grains, rows, near, near_pair)
    return Influence(itself, *imaged, image, *near, near_pair)


def pair_subset(rows: Rows, twin: np.ndarray, kind: np.ndarray, bit: int) -> PairSubset:
    """Entries whose ``kind`` (p,) holds a bit."""
    p, start = len(kind), np.empty(len(rows.start), dtype=np.int64)
    place, entry, twin_there = np.empty(p, np.int32), np.empty(p + 1, np.int32), np.empty(p, np.int32)
    unique = np.empty((p // LANES + 1, N_PAIR, LANES), dtype=np.int32)
    k, m = select_pairs(rows, twin, kind, bit, place, start, entry, twin_there, unique)
    return PairSubset(start, entry[:k], twin_there[:k], unique[: (m + LANES - 1) // LANES], m)


def reuse_or_allocate(count: int, shape: tuple[int, ...], before: np.ndarray | None) -> np.ndarray:
    """``before`` where it has ``count`` rows, or a new array with an eighth more."""
    return before if before is not None and len(before) >= count else np.empty((count + count // 8, *shape))
