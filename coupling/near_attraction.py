"""Attraction of near grains in their engine's own step: fields and moments of the last update, the gap of each step.

The lagged forces of an update contain every pair's near pull at the places of that update. Of the pairs in the list it
is subtracted and transferred as a drive (`particles.attraction`); the others, farther apart, stay constant.
When the list is rebuilt between two updates both are computed again, from the same places, images, fields and moments:
the engine sorts and turns them with its grains.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coupling.grain_law_table import GrainLawTable
from coupling.kernel_state import MagneticGrains, Rows
from coupling.mutual_moments import Magnetisation, MutualMoments
from coupling.near_drive_kernels import drive_pairs, drive_walls, subtract_pulls
from geometry import RevolvedWall
from particles import GrainMotion
from particles.attraction import Attraction
from particles.periodicity import images_of

NEAR_GAP = 0.3
"""Gap [radii] beyond which the pull changes slowly and may lag."""


class NearAttraction:
    """Transfers the near pull of `MutualMoments` to `DEM` or `DVI`.

    Parameters
    ----------
    solver : MutualMoments
        With near pairs.
    walls : sequence of walls
        Those of the engine, in its order.
    near_gap : float
        Gap [radii] up to which every pair follows its gap of each step. From `FARTHEST_GAP` on no pull lags,
        as the stress of a sheared box needs it.
    """

    def __init__(self, solver: MutualMoments, walls: Sequence, near_gap: float = NEAR_GAP) -> None:
        self.solver = solver
        magnetic = [isinstance(wall, RevolvedWall) and wall.magnetic for wall in walls]
        rows = np.cumsum(magnetic) - 1
        self._steel = np.where(magnetic, rows, -1).astype(np.int64).reshape(-1)
        table = solver.table
        self._across = _pull_across(table)
        self.attraction = Attraction(
            table.gap_start, table.gap_step, table.pull, self._across, solver.smallest_gap, self.drives, near_gap
        )

    def freeze(self, motion: GrainMotion, magnetisation: Magnetisation, total_force: np.ndarray) -> None:
        """Freeze the moments and fields of an update, and the sum of its forces `total_force` (n, 3) [N]."""
        own = self.attraction
        own.per_grain = {
            "position": np.array(motion.grains.position),
            "dipole": np.array(magnetisation.dipole),
            "applied": np.array(magnetisation.applied),
            # of three dimensions: no vectors to be turned
            "slope": np.array(magnetisation.slope)[:, :, None],
            "total_force": np.array(total_force),
            "potential": np.array(magnetisation.potential),
            "contrast": np.array(magnetisation.contrast)[:, :, None],
            "height": np.array(magnetisation.height)[:, :, None],
        }
        own.strain = 0.0 if motion.box is None else motion.box.strain
        own.renew()
        motion.attraction = own

    def drives(self, motion: GrainMotion) -> tuple[np.ndarray, np.ndarray]:
        """See `Attraction.drives`; sets the lagged forces to those of pairs outside the list."""
        of, solver, pairs, slots = self.attraction.per_grain, self.solver, motion.listed_pairs, motion.listed_walls
        images = images_of(None if motion.periodicity is None else motion.periodicity.at_strain(self.attraction.strain))
        none = len(images) // 2
        pair, lagged, wall = np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3)), np.zeros((len(slots.wall), 2))
        rest = of["total_force"].copy()
        image = np.full(pairs.count, none, dtype=np.uint8)
        if pairs.shift is not None:
            image += pairs.shift.astype(np.uint8)
        slope, height, contrast = (np.ascontiguousarray(of[k][:, :, 0]) for k in ("slope", "height", "contrast"))
        grains = MagneticGrains(
            of["position"], np.ascontiguousarray(motion.grains.radius), motion.grains.volume, of["dipole"], np.zeros(0),
            of["applied"], slope, np.zeros((0, 3)), of["potential"], contrast, height,
        )  # fmt: skip
        rows = Rows(pairs.start, pairs.other, image, images)
        drive_pairs(solver.table, self._across, solver.model, grains, rows, pair, lagged)
        subtract_pulls(rows, lagged, rest)
        if len(solver.walls):
            steel = np.where(slots.smooth, self._steel[slots.wall], -1)
            drive_walls(solver.table, solver.model, grains, slots.start, steel, solver.walls, wall, rest)
        motion.external_force = rest
        return pair, wall


def _pull_across(table: GrainLawTable) -> np.ndarray:
    """-d/dg of kappa/(2 + g)^3 at the nodes (n_gap,): pull across of equal spheres, over c_i c_j m_i.m_j/(4 pi a^4)."""
    gap = np.exp(table.gap_start + table.gap_step * np.arange(table.n_gap))
    kappa, slope = table.across[:, 0], table.across[:, 1] / (table.gap_step * gap)
    return 3.0 * kappa / (2.0 + gap) ** 4 - slope / (2.0 + gap) ** 3
