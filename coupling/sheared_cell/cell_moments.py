# mypy: ignore-errors
"""Moments of the grains of a sheared cell in a macroscopic field, and the forces that are held between two looks.

The field H is that of an even powder, given (the split of `coupling.pair_fields`): every grain feels it, the correction
of its neighbours within the split's width and its own contribution; nothing else. The sweeps are those of
`coupling.moment_kernels`. Images stand in their rows as ghosts that take moment, field, potential and the rest from
their owners between the two stages of a sweep.

While the cell is sheared the moments follow: each look at them begins with the last ones, and forces come from the
moments with which the fields were gathered, so that force and field belong together.
"""

from __future__ import annotations

import numpy as np

from coupling.finite_grains import NotFiniteGrains
from coupling.grain_law_table import GrainLawTable
from coupling.influence import find_influence, reuse_or_allocate
from coupling.kernel_state import Influence, MagneticGrains, PairModel
from coupling.moment_kernels import gather_fields, magnetise
from coupling.mutual_moments import FIRST_DAMPING, MIN_DAMPING
from coupling.pair_fields import self_field_factor
from coupling.sheared_cell.cell import CellPairs, SquareBox
from coupling.sheared_cell.held_forces import NEAR, HeldPairs, held_forces
from coupling.sheared_cell.near_pull import N_GRIP

NO_WALLS = np.zeros((0, 6))


class CellMoments:
    """Moments (n, 3) [A m^2] in the macroscopic ``field`` (3,) [A/m].

    Parameters
    ----------
    table : GrainLawTable
        Of the grains' law, see `coupling.grain_law_table.grain_table`.
    near : bool
        Model near_field; False: mutual.
    reach : float
        Width of the split [m].
    smallest_gap : float
        [radii].
    """

    def __init__(
        self,
        box: SquareBox,
        table: GrainLawTable,
        *,
        near: bool,
        reach: float,
        smallest_gap: float,
        field: np.ndarray,
        radius: float,
        count: int,
    ) -> None:
        self.box, self.table, self.near, self.reach = box, table, near, reach
        self.smallest_gap, self.radius, self.count = smallest_gap, radius, count
        self.model = PairModel(reach, True, near, smallest_gap)
        self.applied = np.asarray(field, dtype=float)
        self.volume = 4.0 / 3.0 * np.pi * radius**3
        self.moment = np.zeros((count, 3))
        self._room: Influence | None = None
        self._extra: np.ndarray | None = None
        self.residual = np.inf
        self.damping = FIRST_DAMPING
        self.held, self.stress = np.zeros((count, 3)), np.zeros((3, 3))
        self.grip = np.zeros((0, N_GRIP))

    def follow(self, pairs: CellPairs) -> None:
        """Take a new list of pairs."""
        self.pairs = pairs
        everyone = self.count + len(pairs.owner)
        self._whose = np.concatenate([np.arange(self.count), pairs.owner])
        self._ghost = pairs.ghost_image.astype(float)
        self._image = pairs.image.astype(float)
        self._radius, self._volume = np.full(everyone, self.radius), np.full(everyone, self.volume)
        self._applied, self._slope = np.tile(self.applied, (everyone, 1)), np.zeros((everyone, 4))
        self._field, self._new = np.zeros((everyone, 3)), np.zeros((everyone, 3))
        self._potential, self._fraction, self._contrast = np.zeros(everyone), np.zeros(everyone), np.zeros(everyone)
        self._squares = np.zeros((everyone, 2))
        self._height, self._own_image = np.empty((everyone, 0)), np.zeros((everyone, 0))

    def _near_slots(self, position: np.ndarray, offset: float, skin: float) -> np.ndarray:
        """Place of each pair among those closer than NEAR diameters and a skin [m]; -1 beyond."""
        p = self.pairs
        r = position[p.first] - position[p.second] - self.box.image_shift(self._image, offset)
        near = np.einsum("ij,ij->i", r, r) < (2.0 * NEAR * self.radius + skin) ** 2
        slot = np.full(len(near), -1, dtype=np.int32)
        slot[near] = np.arange(np.count_nonzero(near), dtype=np.int32)
        return slot

    def choose_near(self, position: np.ndarray, offset: float, skin: float) -> np.ndarray:
        """Choose the pairs whose attraction is followed (once a list); their numbers in the list."""
        self._slot = self._near_slots(position, offset, skin)
        chosen = np.flatnonzero(self._slot >= 0)
        self.grip = np.zeros((len(chosen), N_GRIP))
        return chosen

    def sweep(self, position: np.ndarray, offset: float) -> None:
        """One damped step of all moments; fields, potentials and shares then belong to the moments before it."""
        n, rows, whose = self.count, self.pairs.rows, self._whose
        shift = self.box.image_shift(self._ghost, offset)
        self._everywhere = np.concatenate([position, position[self.pairs.owner] + shift])
        self._used = self.moment[whose]
        near_by, grains = rows.arrays, self._grains(self._everywhere)
        own = self_field_factor(self.reach, True)
        known = find_influence(self.table, self.model, grains, near_by, NO_WALLS, own=own, room=self._room)
        self._room, self._extra = known, reuse_or_allocate(len(known.near_entry), (4,), self._extra)
        gather_fields(self.model, grains, near_by, known, self._field, self._potential, self._own_image)
        self._field[n:], self._potential[n:] = self._field[whose[n:]], self._potential[whose[n:]]
        magnetise(
            self.table, self.model, grains, near_by, NO_WALLS, known, self.damping, self._fraction, self._contrast,
            self._new, self._squares, self._extra,
        )  # fmt: skip
        missed, total = (float(x) for x in self._squares[:n].sum(axis=0))
        self.residual = 0.0 if total == 0.0 else float(np.sqrt(missed / total))  # a NaN stays one
        if not np.isfinite(self.residual):
            raise NotFiniteGrains("the moments of the grains are not finite: check field and positions")
        self.moment = self._new[:n].copy()

    def settle(self, position: np.ndarray, offset: float, tolerance: float, most_sweeps: int = 300) -> int:
        """Sweep until the residual is below ``tolerance``; the number of sweeps."""
        before = np.inf
        for number in range(1, most_sweeps + 1):
            self.sweep(position, offset)
            if self.residual <= tolerance:
                return number
            if number > 1 and self.residual > 0.98 * before:
                self.damping = max(0.7 * self.damping, MIN_DAMPING)
            before = self.residual
        return most_sweeps

    def hold(self, position: np.ndarray, offset: float) -> None:
        """Find held forces, drives of near pairs and the stress of the held forces from the last sweep's fields."""
        p = self.pairs
        self.held[:] = 0.0
        self.stress[:] = 0.0
        pairs = HeldPairs(p.first, p.second, self.box.image_shift(self._image, offset), self._slot)
        held_forces(self.table, self.model, self._grains(position), pairs, self.held, self.grip, self.stress)

    def _grains(self, position: np.ndarray) -> MagneticGrains:
        return MagneticGrains(
            position, self._radius, self._volume, self._used, self._applied, self._slope, self._field,
            self._potential, self._fraction, self._contrast, self._height, self._own_image,
        )  # fmt: skip

    @property
    def magnetisation(self) -> np.ndarray:
        """Mean of the grains' (3,) [A/m]."""
        return self.moment.mean(axis=0) / self.volume
