"""Grains in the order of their cells, with the list of what each may touch: renewed, saved and put back.

A list is renewed by wrapping grains through the sector, sorting them by cells and carrying over what their contacts
remember. That, and a checkpoint, handle every array that has a row a grain or a row a slot. Each of these is named
once: those of a grain in `particles.grains.RECORDS` and in PER_GRAIN, those of a slot in
`particles.neighbours.contact_list.SlotMemory`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geometry.walls import Wall
from particles import checkpoint
from particles.bodies import Body
from particles.dem import run_faults
from particles.dem.attraction import PREFIX as ATTRACTION
from particles.dem.attraction import Attraction
from particles.dem.contact_columns import ContactColumns, whole
from particles.grains import Grains
from particles.neighbours.contact_list import ContactList, ListedWalls, reaches
from particles.neighbours.neighbour_list import PairList, cell_order, finest_cell
from particles.neighbours.skin import USUAL, WIDEST, next_skin
from particles.sector import CyclicSector
from particles.walls.device_walls import DeviceWalls
from particles.walls.wall_table import Enclosure

PER_GRAIN = {"external_force": True, "_species": False, "_net": True}
"""Arrays of `ListedGrains` with a row a grain, or None: whether rows are vectors that turn where a grain is wrapped."""


class ListedGrains:
    """Grains, the walls near them, and the list of both; `particles.DEM` moves them.

    Parameters
    ----------
    grains, walls, bodies, dt, sector, skin
        As of `particles.DEM`.
    columns : ContactColumns
        Of what a contact remembers.
    species : ndarray of int, shape (n,), or None
        Material of each grain.

    Attributes
    ----------
    external_force, attraction, step_count, order_version, list_version
        As of `particles.DEM`.
    """

    def __init__(
        self,
        grains: Grains,
        walls: Sequence[Wall],
        bodies: Sequence[Body],
        columns: ContactColumns,
        *,
        dt: float,
        sector: CyclicSector | None,
        skin: float | None,
        species: np.ndarray | None,
    ) -> None:
        self.grains, self.walls, self.bodies = grains, list(walls), list(bodies)
        self.dt, self.sector = float(dt), sector
        self._mean_radius = math.fsum(grains.radius) / grains.count  # to the bit, in whatever order they stand
        self._own_skin = skin is None
        self.skin = USUAL * self._mean_radius if skin is None else float(skin)
        if not 0.0 < self.skin < np.inf:
            raise ValueError(f"skin = {self.skin * 1e3:g} mm; allowed: more than 0 (a quarter of a diameter is usual)")
        self.external_force: np.ndarray | None = None
        self.attraction: Attraction | None = None
        self.step_count = self.order_version = self.list_version = 0
        self._columns, self._species, self._net = columns, species, np.zeros((grains.count, 3))
        self._device = DeviceWalls(self.walls, self.bodies)
        # a device that does not hold its grains at the start (a bare disc, a belt) cannot lose them either
        self._enclosure: Enclosure | None = Enclosure(self.walls)
        if self._enclosure.outside(grains.position, 0.0).any():
            self._enclosure = None
        self._stale = True
        self._list_step = 0
        self._contacts: ContactList | None = None
        self._rebuild()

    @property
    def time(self) -> float:
        """Time [s] of the positions; velocities lag by half a step."""
        return self.step_count * self.dt

    @property
    def list_skin(self) -> float:
        """Return how much further than touching the present list reaches [m]."""
        return self.skin

    @property
    def listed_pairs(self) -> PairList:
        """Pairs of the present list; see `renew_list`, and `Attraction.near_gap` for how far they reach.

        Of row i: the partners ``other`` at R(shift*angle) x_other, all in the present order of the grains.
        """
        return self._list.pairs

    @property
    def listed_walls(self) -> ListedWalls:
        """Walls near each grain in the present list."""
        number = self._list.wall_other
        return ListedWalls(self._list.wall_start, self._device.wall[number], number < len(self._device.rows))

    @property
    def n_sectors(self) -> int:
        """Sectors in the full ring (1 without a sector)."""
        return 1 if self.sector is None else self.sector.n_sectors

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain at the last step [N], shape (n, 3)."""
        return self._net.copy()

    @property
    def _list(self) -> ContactList:
        assert self._contacts is not None
        return self._contacts

    def invalidate(self) -> None:
        """Say that positions were changed from outside: the list is renewed before the next step."""
        self._stale = True

    def renew_list(self) -> bool:
        """Make the neighbour list again if it is outdated, as `DEM.run` would; whether it was.

        For who needs to know, before a run, which pairs its list holds. Grains may be sorted and wrapped.
        """
        if not self._outdated:
            return False
        self._rebuild()
        return True

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to go on bit for bit."""
        held = {name.lstrip("_"): getattr(self, name) for name in PER_GRAIN}
        arrays = checkpoint.taken(self.grains, self.bodies, self._list.arrays(), **held)
        if self.attraction is not None:
            arrays |= self.attraction.state()
        arrays["counters"] = np.array(
            [self.step_count, self.order_version, self._stale, self.list_version, self._list_step], dtype=np.int64
        )
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into grains that were listed with the same walls, bodies, sector and `attraction`.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, contacts that remember something else, or an attraction
            whose table is not known here.
        """
        self._refuse_other_memory(state)
        checkpoint.refuse_another_scene("DEM", state, self.grains, self.bodies)
        attracts = any(name.startswith(ATTRACTION) for name in state)
        if attracts and self.attraction is None:
            raise ValueError("the state's grains attract each other; give this DEM the same `attraction` first")
        checkpoint.put_grains(state, self.grains)
        for name in PER_GRAIN:
            setattr(self, name, checkpoint.held_in(state, name.lstrip("_")))
        if self.attraction is not None and attracts:
            self.attraction.restore(state)
        else:
            self.attraction = None
        self._contacts = ContactList.from_arrays(checkpoint.list_of(state), self._columns.total)
        checkpoint.put_bodies(state, self.bodies)
        self.step_count, self.order_version, stale, self.list_version, self._list_step = (
            int(v) for v in state["counters"]
        )
        self._stale = bool(stale)

    def _refuse_other_memory(self, state: dict[str, np.ndarray]) -> None:
        """Raise ValueError unless contacts of the state remember what these do; older ones not in whole fours."""
        remembered, total = state["list_pair_history"].shape[1], self._columns.total
        if whole(remembered) != total:
            raise ValueError(
                f"a contact of the state remembers {remembered} numbers, one of this DEM {total}; "
                "begin with grains of the same kind of contact law, rolling and twisting friction and energy budget"
            )

    def _fresh_list(self, reach: np.ndarray, cutoff: float) -> ContactList:
        angles = [body.angle for body in self.bodies]
        return ContactList.make(
            self.grains.position, reach, cutoff, self.skin, self._device, angles, self.sector, self._columns.total
        )

    def _reaches(self) -> tuple[np.ndarray, float]:
        return reaches(self.grains.radius, self.skin, self._near_gap)

    @property
    def _near_gap(self) -> float:
        """Gap [radii] up to which a list made now holds every pair at every step."""
        return 0.0 if self.attraction is None else self.attraction.near_gap

    @property
    def _outdated(self) -> bool:
        return self._stale or (self.attraction is not None and not self.attraction.listed)

    def _rebuild(self) -> None:
        """Wrap, sort by cells, list the neighbours again, and carry what contacts remember into the new list."""
        g = self.grains
        if self._enclosure is not None:
            gone = np.flatnonzero(self._enclosure.outside(g.position, 2.0 * float(g.radius.max())))
            if len(gone):
                raise run_faults.escaped(g, gone, self.time)
        wraps = None if self.sector is None else self._wrap(self.sector)
        memory = None
        if self._contacts is not None:
            memory = self._contacts.memory()
            if self._own_skin:
                extra = (self._contacts.pairs.count - len(memory.other)) / g.count
                widest = WIDEST if self.sector is None else USUAL  # a sector is checked for the usual one
                steps = self.step_count - self._list_step
                self.skin = next_skin(self.skin, steps, extra, self._mean_radius, widest)
            self._contacts = None  # before the next one: two lists are the most memory that grains ever need
        reach, cutoff = self._reaches()
        order = cell_order(g.position_radius, finest_cell(reach, cutoff))
        if np.any(order[1:] < order[:-1]):
            self._sort(order)
            reach = reach.take(order)
        made = self._fresh_list(reach, cutoff)
        if memory is not None:
            made.take(memory, order, wraps, self.sector, self._columns.vectors)
        self._contacts = made
        self._list_step = self.step_count
        self.list_version += 1
        self._stale = False
        if self.attraction is not None:
            self.attraction.renew()
            self.attraction.listed = True

    def _wrap(self, sector: CyclicSector) -> np.ndarray:
        """Turn back into the sector what has left it; by how many sectors each grain was turned, shape (n,)."""
        g, wraps = self.grains, sector.wraps(self.grains.position)
        gone = np.flatnonzero(wraps)
        held = [getattr(self, name) for name, turns in PER_GRAIN.items() if turns]
        for array in (g.position, g.velocity, g.angular_velocity, g.magnetic_moment, *held):
            if array is not None:
                array[gone] = sector.turn(array[gone], wraps[gone])
        if self.attraction is not None:
            self.attraction.wrapped(gone, wraps[gone], sector)
        return wraps

    def _sort(self, order: np.ndarray) -> None:
        """Put grain ``order[k]`` into place k in everything that has a row a grain."""
        self.grains.permute(order)
        for name in PER_GRAIN:
            if (array := getattr(self, name)) is not None:
                setattr(self, name, array.take(order, axis=0))
        if self.attraction is not None:
            self.attraction.sorted_as(order)
        self.order_version += 1
