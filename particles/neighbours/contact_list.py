"""Verlet list of the grains and of the walls near them, with the history of each contact beside its slot.

A list made with a skin stays complete until a grain has moved by half the skin. When a new one is made the
grains may have been sorted anew and wrapped through the faces of the sector; the history of every touching
contact finds its new slot by the pair's two ids. Were grains turned by R^w, the pair (i, j, shift) becomes

    (i', j', shift + w_i - w_j)   with xi' = R^w_i xi,

or, where the new list has it the other way round, (j', i', -shift') with xi'' = -R^(-shift') xi'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit

from particles.neighbours.neighbour_list import PairList, find_pairs
from particles.neighbours.partition import Chunks, make_chunks
from particles.sector import CyclicSector
from particles.walls.device_walls import DeviceWalls


class ListedWalls(NamedTuple):
    """The (grain, wall) slots of a list, row by row.

    Attributes
    ----------
    start : ndarray of int64, shape (n + 1,)
        Grain i has the slots ``start[i]`` up to ``start[i + 1]``.
    wall : ndarray of int64, shape (s,)
        Index of the wall in the order given to the DEM.
    smooth : ndarray of bool, shape (s,)
        Whether it is a plane or a wall of revolution; of a triangle wall each triangle has a slot of its own.
    """

    start: np.ndarray
    wall: np.ndarray
    smooth: np.ndarray


class SlotMemory(NamedTuple):
    """What the slots of a list remember, a row a slot: the one place that names these arrays.

    A new list makes them by `empty`, the step takes them in this order (`particles.dem.kernel_state`), a checkpoint has
    them by these names.

    Attributes
    ----------
    touching : ndarray of uint8, shape (p,)
        Whether grain and partner touched in the last step.
    history : ndarray, shape (p, columns)
        What the contact remembers (`particles.dem.contact_kernel`), in the frame of the first grain.
    """

    touching: np.ndarray
    history: np.ndarray

    @classmethod
    def empty(cls, count: int, columns: int) -> SlotMemory:
        """Of so many slots that touch nothing."""
        return cls(np.zeros(count, dtype=np.uint8), np.zeros((count, columns)))

    def copied(self) -> SlotMemory:
        """The same in arrays of its own."""
        return SlotMemory(*(array.copy() for array in self))

    def arrays(self, kind: str) -> dict[str, np.ndarray]:
        """Of slots of a ``kind``, by their names in a checkpoint."""
        return {f"{kind}_{name}": array for name, array in self._asdict().items()}

    @classmethod
    def from_arrays(cls, kind: str, state: dict[str, np.ndarray]) -> SlotMemory:
        """The inverse of `arrays`, copied."""
        return cls(*(state[f"{kind}_{name}"].copy() for name in cls._fields))


class ContactMemory(NamedTuple):
    """The touching contacts alone, row by row as in the list that they are taken from."""

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray
    history: np.ndarray
    wall_start: np.ndarray
    wall_other: np.ndarray
    wall_history: np.ndarray


class _PairSlots(NamedTuple):
    """Pairs of a `ContactList` that take over what those of another one remember."""

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray
    touching: np.ndarray
    history: np.ndarray


@dataclass(slots=True)
class ContactList:
    """Slots of possible contacts: p pairs and s (grain, wall) slots for n grains.

    Attributes
    ----------
    pairs : PairList
        Half list.
    row : ndarray of uint32, shape (p,)
        First grain of each pair.
    chunks : Chunks
        How its rows are shared among threads.
    wall_start, wall_other : ndarray, shapes (n + 1,), (s,) int32
        Walls near each grain; triangles count on after the smooth walls.
    pair_memory, wall_memory : SlotMemory
        Of p pairs and of s wall slots.
    reference : ndarray, shape (n, 3)
        Positions [m] at which the list was made.
    angles : ndarray, shape (n_bodies,)
        Angles of the bodies [rad] at that time.
    """

    pairs: PairList
    wall_start: np.ndarray
    wall_other: np.ndarray
    reference: np.ndarray
    angles: np.ndarray
    columns: int = 3
    row: np.ndarray = field(init=False)
    chunks: Chunks = field(init=False)
    pair_memory: SlotMemory = field(init=False)
    wall_memory: SlotMemory = field(init=False)

    def __post_init__(self) -> None:
        self.row = self.pairs.rows().astype(np.uint32)
        self.chunks = make_chunks(self.pairs.start, self.pairs.other, self.wall_start)
        self.pair_memory = SlotMemory.empty(self.pairs.count, self.columns)
        self.wall_memory = SlotMemory.empty(len(self.wall_other), self.columns)

    @classmethod
    def make(
        cls,
        position_radius: np.ndarray,
        skin: float,
        walls: DeviceWalls,
        angles: Sequence[float],
        sector: CyclicSector | None,
        columns: int,
        gap: float = 0.0,
    ) -> ContactList:
        """The list at ``position_radius`` (n, 4) [m] with ``skin`` [m] and bodies at ``angles`` [rad].

        A contact has ``columns`` numbers to remember. Surfaces count as touching up to a ``gap`` [radii].
        """
        position, radius = position_radius[:, :3], position_radius[:, 3]
        reach, cutoff = reaches(radius, skin, gap)
        pairs = find_pairs(position, cutoff, sector, reach)
        start, other = walls.near(position, reach, skin, angles)
        return cls(pairs, start, other, np.array(position), np.array(angles), columns)

    def wall_rows(self) -> np.ndarray:
        """The grain of each wall slot, int64, shape (s,)."""
        return np.repeat(np.arange(len(self.wall_start) - 1), np.diff(self.wall_start))

    def memory(self) -> ContactMemory:
        """What the touching contacts remember; the list itself can be dropped then."""
        pairs = _touching_rows(self.pairs.start, self.pairs.other, self.pairs.shift, *self.pair_memory)
        no_shift = np.zeros(len(self.wall_other), dtype=np.int8)
        walls = _touching_rows(self.wall_start, self.wall_other, no_shift, *self.wall_memory)
        start, other, shift, history = pairs
        return ContactMemory(start, other, shift, history, walls[0], walls[1], walls[3])

    def take(
        self,
        memory: ContactMemory,
        order: np.ndarray,
        wraps: np.ndarray | None,
        sector: CyclicSector | None,
        vectors: np.ndarray,
    ) -> None:
        """Carry ``memory`` over: grain ``order[k]`` of the old list is grain k here, turned by ``wraps`` (old order).

        ``vectors`` are the first columns of what turns with the grains. A contact of the last step that has no slot
        here has parted since, further than the skin: it is forgotten.
        """
        n = len(order)
        rank = np.empty(n, dtype=np.int64)
        rank[order] = np.arange(n)
        turned = np.zeros(n, dtype=np.int64) if wraps is None else wraps
        parts = 1 if sector is None else sector.n_sectors
        angle = 0.0 if sector is None else sector.angle
        to = _PairSlots(self.pairs.start, self.pairs.other, self.pairs.shift, *self.pair_memory)
        _carry_pairs(vectors, rank, turned, parts, angle, memory, to)
        _carry_walls(
            vectors, rank, turned, angle, memory.wall_start, memory.wall_other, memory.wall_history,
            self.wall_start, self.wall_other, *self.wall_memory,
        )  # fmt: skip

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs; the chunks follow from it."""
        places = {
            "pair_start": self.pairs.start, "pair_other": self.pairs.other, "pair_shift": self.pairs.shift,
            "wall_start": self.wall_start, "wall_other": self.wall_other,
            "reference": self.reference, "angles": self.angles,
        }  # fmt: skip
        return places | self.pair_memory.arrays("pair") | self.wall_memory.arrays("wall")

    @classmethod
    def from_arrays(cls, state: dict[str, np.ndarray]) -> ContactList:
        """The inverse of `arrays`."""
        pairs = PairList(*(state[f"pair_{name}"].copy() for name in ("start", "other", "shift")))
        start, other, reference, angles = (
            state[name].copy() for name in ("wall_start", "wall_other", "reference", "angles")
        )
        made = cls(pairs, start, other, reference, angles, state["pair_history"].shape[1])
        made.pair_memory, made.wall_memory = (SlotMemory.from_arrays(kind, state) for kind in ("pair", "wall"))
        return made


def reaches(radius: np.ndarray, skin: float, gap: float) -> tuple[np.ndarray, float]:
    """How far each grain looks (n,) [m], and the largest distance of a pair [m]; ``gap`` [radii], see `ContactList`."""
    reach = radius + 0.5 * skin
    if gap > 0.0:
        reach = reach + 0.5 * gap * radius
    return reach, 2.0 * float(radius.max()) + skin + gap * float(radius.max())


@njit(cache=True, error_model="numpy")
def _touching_rows(start, other, shift, touching, history):
    """Rows of what touches: (start, other, shift, history)."""
    kept = 0
    for k in range(other.shape[0]):
        kept += touching[k]
    new_start = np.empty_like(start)
    new_other, new_shift = np.empty(kept, dtype=np.int32), np.empty(kept, dtype=np.int8)
    new_history = np.empty((kept, history.shape[1]))
    p = 0
    for i in range(start.shape[0] - 1):
        new_start[i] = p
        for k in range(start[i], start[i + 1]):
            if touching[k] != 0:
                new_other[p], new_shift[p] = other[k], shift[k]
                for a in range(history.shape[1]):
                    new_history[p, a] = history[k, a]
                p += 1
    new_start[start.shape[0] - 1] = p
    return new_start, new_other, new_shift, new_history


@njit(cache=True, error_model="numpy")
def _carry_pairs(vectors, rank, wraps, parts, angle, memory, to):
    start, other, shift, history = memory.start, memory.other, memory.shift, memory.history
    new_start, new_other, new_shift, new_touching, new_history = to
    for old_i in range(rank.shape[0]):
        for k in range(start[old_i], start[old_i + 1]):
            i, j = rank[old_i], rank[other[k]]
            across = (wraps[old_i] + shift[k] - wraps[other[k]]) % parts
            slot, sign, turns = -1, 1.0, wraps[old_i]
            for q in range(new_start[i], new_start[i + 1]):
                if new_other[q] == j and (new_shift[q] - across) % parts == 0:
                    slot = q
                    break
            if slot < 0:
                for q in range(new_start[j], new_start[j + 1]):
                    if new_other[q] == i and (new_shift[q] + across) % parts == 0:
                        slot, sign, turns = q, -1.0, wraps[old_i] - across
                        break
            if slot < 0:
                continue
            c, t = np.cos(turns * angle), np.sin(turns * angle)
            new_touching[slot] = 1
            for first in range(history.shape[1]):
                new_history[slot, first] = history[k, first]
            for v in range(vectors.shape[0]):
                first = vectors[v]
                x, y = history[k, first], history[k, first + 1]
                if turns != 0:
                    x, y = c * x - t * y, t * x + c * y
                new_history[slot, first], new_history[slot, first + 1] = sign * x, sign * y
                new_history[slot, first + 2] = sign * history[k, first + 2]


@njit(cache=True, error_model="numpy")
def _carry_walls(vectors, rank, wraps, angle, start, other, history, new_start, new_other, new_touching, new_history):
    for old_i in range(rank.shape[0]):
        for k in range(start[old_i], start[old_i + 1]):
            i = rank[old_i]
            slot = -1
            for q in range(new_start[i], new_start[i + 1]):
                if new_other[q] == other[k]:
                    slot = q
            if slot < 0:
                continue
            c, t = np.cos(wraps[old_i] * angle), np.sin(wraps[old_i] * angle)
            new_touching[slot] = 1
            for first in range(history.shape[1]):
                new_history[slot, first] = history[k, first]
            for v in range(vectors.shape[0]):
                first = vectors[v]
                x, y = history[k, first], history[k, first + 1]
                if wraps[old_i] != 0:
                    x, y = c * x - t * y, t * x + c * y
                new_history[slot, first], new_history[slot, first + 1] = x, y
