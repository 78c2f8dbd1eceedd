"""Grains of the DEM in the order of their cells, with the list of what each may touch: rebuilt, saved and put back.

A list is rebuilt by wrapping grains where space repeats, sorting them by cells and carrying over what their contacts
remember. That, and a checkpoint, handle every array that has a row a grain or a row a slot. Each of these is named
once: those of a grain in `particles.grains.RECORDS` and in PER_GRAIN, those of a slot in
`particles.neighbours.contact_list.SlotMemory`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geometry.walls import Wall
from particles.bodies import Body
from particles.dem.contact_columns import ContactColumns, round_up
from particles.grain_motion import GrainMotion, Gravity
from particles.grains import Grains
from particles.neighbours.contact_list import ContactList
from particles.neighbours.neighbour_list import cell_order, finest_cell
from particles.neighbours.skin import USUAL, WIDEST, next_skin
from particles.periodicity import Periodicity

ESCAPE = "the walls may have a slot, or it was pressed through one: raise the stiffness or shorten dt"


class ListedGrains(GrainMotion):
    """Grains, the walls near them, and the list of both; `particles.DEM` moves them.

    Parameters
    ----------
    grains, walls, bodies, dt, gravity, periodicity, skin, overlap_limit
        As of `particles.DEM`.
    columns : ContactColumns
        Of what a contact remembers.
    species : ndarray of int, shape (n,), or None
        Material of each grain.

    Attributes
    ----------
    attraction
        As of `particles.DEM`.
    """

    PER_GRAIN = {"external_force": True, "_species": False, "_net": True}

    def __init__(
        self,
        grains: Grains,
        walls: Sequence[Wall],
        bodies: Sequence[Body],
        columns: ContactColumns,
        *,
        dt: float,
        gravity: Gravity | None,
        periodicity: Periodicity | None,
        skin: float | None,
        overlap_limit: float,
        species: np.ndarray | None,
    ) -> None:
        self._mean_radius = math.fsum(grains.radius) / grains.count  # to the bit, in whatever order they stand
        self._own_skin = skin is None
        super().__init__(
            grains, walls, bodies, dt=dt, gravity=gravity, periodicity=periodicity,
            skin=USUAL * self._mean_radius if skin is None else skin, overlap_limit=overlap_limit,
        )  # fmt: skip
        self._columns, self._species, self._net = columns, species, np.zeros((grains.count, 3))
        self._list_step = 0
        self._contacts: ContactList | None = None
        self._rebuild()

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain at the last step [N], shape (n, 3)."""
        return self._net.copy()

    @property
    def _list(self) -> ContactList:
        assert self._contacts is not None
        return self._contacts

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to continue bit for bit."""
        arrays = super().state()
        arrays["counters"] = np.append(arrays["counters"], self._list_step)
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into grains that were listed with the same walls, bodies, periodicity and `attraction`.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, contacts that remember something else, or an attraction
            whose table is not known here.
        """
        self._refuse_other_memory(state)
        super().restore(state)
        self._list_step = int(state["counters"][4])

    def _restore_list(self, arrays: dict[str, np.ndarray]) -> None:
        self._contacts = ContactList.from_arrays(arrays, self._columns.total)

    def _refuse_other_memory(self, state: dict[str, np.ndarray]) -> None:
        """Raise ValueError unless contacts of the state remember what these do; older ones not in whole fours."""
        remembered, total = state["list_pair_history"].shape[1], self._columns.total
        if round_up(remembered) != total:
            raise ValueError(
                f"a contact of the state remembers {remembered} numbers, one of this DEM {total}; "
                "begin with grains of the same kind of contact law, rolling and twisting friction and energy budget"
            )

    def _fresh_list(self, reach: np.ndarray, cutoff: float) -> ContactList:
        angles = [body.angle for body in self.bodies]
        return ContactList.make(
            self.grains.position, reach, cutoff, self.skin, self._device, angles, self.periodicity, self._columns.total
        )

    @property
    def _interaction(self) -> float:
        return self._reaches(self.skin)[1] - self.skin

    def _rebuild(self) -> None:
        """Wrap, sort by cells, list the neighbours again, and carry what contacts remember into the new list."""
        g = self.grains
        self._refuse_escaped(2.0 * float(g.radius.max()), ESCAPE)
        wraps = None if self.periodicity is None else self._wrap(self.periodicity)
        memory = None
        if self._contacts is not None:
            memory = self._contacts.memory()
            if self._own_skin:
                untouched = (self._contacts.pairs.count - len(memory.other)) / g.count
                widest = WIDEST if self.periodicity is None else USUAL  # its width is checked for the usual one
                steps = self.step_count - self._list_step
                self.skin = next_skin(self.skin, steps, untouched, self._mean_radius, widest)
            self._contacts = None  # before the next one: two lists are the most memory that grains ever need
        reach, cutoff = self._reaches(self.skin)
        order = cell_order(g.position_radius, finest_cell(reach, cutoff))
        if np.any(order[1:] < order[:-1]):
            self._sort(order)
            reach = reach.take(order)
        made = self._fresh_list(reach, cutoff)
        if memory is not None:
            made.transfer(memory, order, wraps, self.sector, self._columns.vectors)
        self._contacts = made
        self._list_step = self.step_count
        self._note_list()
