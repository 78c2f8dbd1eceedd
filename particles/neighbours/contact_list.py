"""Verlet list of the grains and of the walls near them, with the history of each contact.

A list made with a skin stays complete until a grain has moved by half the skin. When a new one is made the
grains may have been sorted again and wrapped through faces; the history of every touching contact finds its new slot
by the pair's two ids. Were grains of a sector turned by R^w, the pair (i, j, shift) becomes

    (i', j', shift + w_i - w_j)   with xi' = R^w_i xi,

or, where the new list has it in reverse order, (j', i', -shift') with xi'' = -R^(-shift') xi'.

In a box that only moves its images a pair is met once, and its history goes with it whatever the image is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numba
import numpy as np
from numba import njit, prange

from geometry.kernels.aligned_arrays import aligned_zeros
from geometry.kernels.device_functions import device_function
from particles.neighbours.neighbour_list import WORTH_SHARING, find_pairs
from particles.neighbours.partition import Chunks, make_chunks
from particles.neighbours.slot_list import SlotList, slots_of
from particles.periodicity import Periodicity
from particles.sector import CyclicSector
from particles.threads import at_most
from particles.walls.device_walls import DeviceWalls

BLOCK = 2048  # grains, at the most, whose contacts a thread carries over at once


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
    """History of the slots of a list, one row per slot: the one place that names these arrays.

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
        """Return the memory of so many slots that touch nothing."""
        return cls(np.zeros(count, dtype=np.uint8), aligned_zeros((count, columns)))

    def copied(self) -> SlotMemory:
        """Return a copy in arrays of its own."""
        return SlotMemory(*(array.copy() for array in self))

    def arrays(self, kind: str) -> dict[str, np.ndarray]:
        """Return the arrays of slots of a ``kind`` by their names in a checkpoint."""
        return {f"{kind}_{name}": array for name, array in self._asdict().items()}

    @classmethod
    def from_arrays(cls, kind: str, state: dict[str, np.ndarray], columns: int) -> SlotMemory:
        """The inverse of `arrays`, copied; histories of older states may have had fewer ``columns`` at the end."""
        touching, history = (state[f"{kind}_{name}"] for name in cls._fields)
        made = cls.empty(len(touching), columns)
        made.touching[:], made.history[:, : history.shape[1]] = touching, history
        return made


class ContactMemory(NamedTuple):
    """The touching contacts alone, row by row as in the list that they are taken from."""

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray
    history: np.ndarray
    wall_start: np.ndarray
    wall_other: np.ndarray
    wall_history: np.ndarray


class _Slots(NamedTuple):
    """Slots of a `SlotList` that take over what those of another one remember; those of walls have no shift."""

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray
    touching: np.ndarray
    history: np.ndarray


class _Turned(NamedTuple):
    """Map of the grains of the new list from those of the old one.

    Attributes
    ----------
    rank, wraps : ndarray of int64, shapes (n,), (n,) or (0,)
        Place of each grain in the new list; by how many sectors it was turned, none without a sector.
    parts : int
        Sectors in the ring.
    angle : float
        Of a sector [rad].
    """

    rank: np.ndarray
    wraps: np.ndarray
    parts: int
    angle: float


@dataclass(slots=True)
class ContactList(SlotList):
    """Slots of possible contacts, with what each contact remembers.

    Attributes
    ----------
    columns : int
        Numbers that a contact remembers.
    chunk_start : ndarray of int64, or None
        First row of each of its `chunks`, once they are made.
    row : ndarray of uint32, shape (p,)
        First grain of each pair.
    pair_memory, wall_memory : SlotMemory
        Of p pairs and of s wall slots.
    """

    columns: int = 3
    chunk_start: np.ndarray | None = None
    row: np.ndarray = field(init=False)
    pair_memory: SlotMemory = field(init=False)
    wall_memory: SlotMemory = field(init=False)
    _chunks: Chunks | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.row = _rows(self.pairs.start, self.pairs.count)
        self.pair_memory = SlotMemory.empty(self.pairs.count, self.columns)
        self.wall_memory = SlotMemory.empty(len(self.wall_other), self.columns)

    @classmethod
    def make(
        cls,
        position: np.ndarray,
        reach: np.ndarray,
        cutoff: float,
        skin: float,
        walls: DeviceWalls,
        angles: Sequence[float],
        periodicity: Periodicity | None,
        columns: int,
    ) -> ContactList:
        """The list at ``position`` (n, 3) [m] with the `reaches` of a ``skin`` [m] and bodies at ``angles`` [rad].

        A contact has ``columns`` numbers to remember.
        """
        pairs = find_pairs(position, cutoff, periodicity, reach)
        start, other = walls.near(position, reach, skin, angles)
        return cls(pairs, start, other, np.array(position), np.array(angles), columns)

    @property
    def chunks(self) -> Chunks:
        """Partition of its rows among threads: by the contacts when it is first asked for, before any step."""
        if self._chunks is None:
            touching = self.pair_memory.touching
            self._chunks = make_chunks(self.pairs.start, self.pairs.other, touching, self.wall_start, self.chunk_start)
            self.chunk_start = self._chunks.start
        return self._chunks

    def memory(self) -> ContactMemory:
        """History of the touching contacts; the list itself can be dropped then."""
        return memory_of(self, self.pair_memory, self.wall_memory)

    def transfer(
        self,
        memory: ContactMemory,
        order: np.ndarray,
        wraps: np.ndarray | None,
        sector: CyclicSector | None,
        vectors: np.ndarray,
    ) -> None:
        """Carry ``memory`` over, as `carry_over`."""
        carry_over(memory, order, wraps, sector, vectors, self, self.pair_memory, self.wall_memory)

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs."""
        memory = self.pair_memory.arrays("pair") | self.wall_memory.arrays("wall")
        return SlotList.arrays(self) | {"chunk_start": self.chunks.start} | memory

    @classmethod
    def from_arrays(cls, state: dict[str, np.ndarray], columns: int) -> ContactList:
        """The inverse of `arrays`, of contacts that remember so many ``columns``."""
        made = cls(*slots_of(state), columns, state.get("chunk_start"))  # older states have no chunks
        made.pair_memory, made.wall_memory = (SlotMemory.from_arrays(kind, state, columns) for kind in ("pair", "wall"))
        return made


def reaches(radius: np.ndarray, skin: float, gap: float) -> tuple[np.ndarray, float]:
    """Reach of each grain (n,) [m], and the largest distance of a pair [m].

    Surfaces count as touching up to a ``gap`` [radii].
    """
    reach, largest = radius + 0.5 * skin, float(radius.max())
    if gap > 0.0:
        reach = reach + 0.5 * gap * radius
    return reach, 2.0 * largest + skin + gap * largest


def memory_of(slots: SlotList, pairs: SlotMemory, walls: SlotMemory) -> ContactMemory:
    """Return the histories of the touching contacts of a list."""
    own = slots.pairs
    return _touching_rows(own.start, own.other, own.shift, *pairs, slots.wall_start, slots.wall_other, *walls)


def carry_over(
    memory: ContactMemory,
    order: np.ndarray,
    wraps: np.ndarray | None,
    sector: CyclicSector | None,
    vectors: np.ndarray,
    slots: SlotList,
    pairs: SlotMemory,
    walls: SlotMemory,
) -> None:
    """Carry ``memory`` over into the ``pairs`` and ``walls`` of new ``slots``: grain k was grain ``order[k]`` before.

    In a sector it was turned by ``wraps`` (old order; None: by nothing); ``vectors`` are the first columns of what
    turns with it. A contact of the last step that has no slot here has parted since, further than the skin: it is
    forgotten.
    """
    n, rank = len(order), np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(n)
    if sector is None:
        turned = _Turned(rank, np.zeros(0, dtype=np.int64), 1, 0.0)
    else:
        still = np.zeros(n, dtype=np.int64)
        turned = _Turned(rank, still if wraps is None else wraps, sector.n_sectors, sector.angle)
    own = slots.pairs
    with at_most(numba.get_num_threads() if n >= WORTH_SHARING else 1):
        _carry(
            vectors, turned, memory, _Slots(own.start, own.other, own.shift, *pairs),
            _Slots(slots.wall_start, slots.wall_other, own.shift[:0], *walls), BLOCK,
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _rows(start, count):
    """The row of each slot."""
    row = np.empty(count, dtype=np.uint32)
    for i in range(start.shape[0] - 1):
        for k in range(start[i], start[i + 1]):
            row[k] = i
    return row


@njit(cache=True, error_model="numpy")
def _touching_rows(start, other, shift, touching, history, wall_start, wall_other, wall_touching, wall_history):
    """Rows of what touches."""
    kept_start, place = _touching(start, touching)
    wall_kept_start, wall_place = _touching(wall_start, wall_touching)
    return ContactMemory(
        kept_start, other[place], shift[place], _rows_of(history, place),
        wall_kept_start, wall_other[wall_place], _rows_of(wall_history, wall_place),
    )  # fmt: skip


@device_function(error_model="numpy")
def _touching(start, touching):
    """First place of each row among the slots that touch, and which these are."""
    slots, kept = touching.shape[0], np.uint64(0)
    before, place = np.empty(slots + 1, dtype=np.int64), np.empty(slots + 1, dtype=np.int64)
    for k in range(slots):  # written in any case, kept by counting it: a branch would be mispredicted
        before[k] = np.int64(kept)
        place[kept] = k
        kept += np.uint64(touching[k])
    before[slots] = np.int64(kept)
    kept_start = np.empty_like(start)
    for i in range(start.shape[0]):
        kept_start[i] = before[start[i]]
    return kept_start, place[: np.int64(kept)]


@device_function(error_model="numpy")
def _rows_of(history, place):
    rows = np.empty((place.shape[0], history.shape[1]))
    for p in range(place.shape[0]):
        for a in range(history.shape[1]):
            rows[p, a] = history[place[p], a]
    return rows


@njit(parallel=True, cache=True, error_model="numpy")
def _carry(vectors, turned, memory, pairs, walls, most):
    """Give the slots that touch what they remember; threads share blocks of at most so many grains of the old list."""
    n = turned.rank.shape[0]
    blocks = 2 * ((n + 2 * most - 1) // (2 * most))
    for b in prange(blocks):
        block = np.int64(b)  # numba's own index is unsigned, and everything would be compiled for both
        for old_i in range(block * n // blocks, (block + 1) * n // blocks):
            _carry_pairs(old_i, vectors, turned, memory, pairs)
            _carry_walls(old_i, vectors, turned, memory, walls)


@device_function(without_refcounts=True, error_model="numpy")
def _carry_pairs(old_i, vectors, turned, memory, to):
    rank, parts = turned.rank, turned.parts
    for k in range(memory.start[old_i], memory.start[old_i + 1]):
        old_j = memory.other[k]
        i, j = rank[old_i], rank[old_j]
        across, turns, sign = 0, 0, 1.0
        if parts > 1:
            turns = turned.wraps[old_i]
            across = turns + memory.shift[k] - turned.wraps[old_j]
        if j < i:  # the new list has it in reverse order
            i, j = j, i
            across, turns, sign = -across, turns - across, -1.0
        for q in range(to.start[i], to.start[i + 1]):
            if to.other[q] == j and (parts == 1 or (to.shift[q] - across) % parts == 0):
                _put(k, q, turns * turned.angle, sign, vectors, memory.history, to)
                break


@device_function(without_refcounts=True, error_model="numpy")
def _carry_walls(old_i, vectors, turned, memory, to):
    i = turned.rank[old_i]
    for k in range(memory.wall_start[old_i], memory.wall_start[old_i + 1]):
        for q in range(to.start[i], to.start[i + 1]):
            if to.other[q] == memory.wall_other[k]:
                turns = turned.wraps[old_i] if turned.parts > 1 else 0
                _put(k, q, turns * turned.angle, 1.0, vectors, memory.wall_history, to)
                break


@device_function(without_refcounts=True, error_model="numpy")
def _put(k, slot, angle, sign, vectors, history, to):
    """Contact k of the old list in its slot of the new one, its vectors turned by ``angle`` [rad] and with a sign."""
    to.touching[slot] = 1
    for a in range(history.shape[1]):
        to.history[slot, a] = history[k, a]
    if angle == 0.0 and sign > 0.0:
        return
    c, t = np.cos(angle), np.sin(angle)
    for v in range(vectors.shape[0]):
        first = vectors[v]
        x, y = history[k, first], history[k, first + 1]
        if angle != 0.0:
            x, y = c * x - t * y, t * x + c * y
        to.history[slot, first], to.history[slot, first + 1] = sign * x, sign * y
        to.history[slot, first + 2] = sign * history[k, first + 2]
