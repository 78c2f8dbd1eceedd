"""Pairs of grains near each other, by a hierarchy of cell grids.

The list is a half list in compressed rows (CSR): row i holds its partners j > i in
``other[start[i]:start[i+1]]``, nearest first. Every pair stands in one row only, also across the faces of a
cyclic sector: there grains near a face get a ghost beyond the other one, turned by +angle (shift = 1) or
-angle (shift = -1), and only a grain of lower number sees it.

Grains of like size, to a factor of two of their reach, share a grid with cells as long as their largest
interaction (V. Ogarko, S. Luding, Comput. Phys. Commun. 183 (2012) 931, with levels of fixed ratio). Grain i
looks for partners j > i in the grids of all levels, its own, coarser and finer ones, in the cells that the sum
of the reaches covers. The row of i is thus complete after one visit, and rows do not depend on each other:
blocks of them may be filled by several threads, with the same result.

Grains may stand in any order. Sorted by `cell_order` with `finest_cell` they are found about twice as fast,
because cells before a grain's own hold lower numbers only.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numba import njit

from geometry.inner_functions import inner
from particles.lists.cells import MARGIN, CellGrid, bounds, cell_order
from particles.sector import CyclicSector

__all__ = ["PairList", "cell_order", "find_pairs", "finest_cell"]

LEVELS = 31  # of size; grains smaller than 1e-9 of the largest share the last one
BLOCK = 8192  # rows that are filled at once: their scratch stays in the cache
WORTH_SHARING = 3 * BLOCK  # grains from which on several threads are worth starting
FEW = 8  # grains on a line of cells: rarely more at two to the cell
SHORT = 32  # partners up to which all are compared with all to sort them
BESIDE_FACE = 1.2  # cut-offs from a face within which a grain gets a ghost: the fifth is drift past the face


@dataclass(frozen=True, slots=True)
class PairList:
    """Half list of pairs.

    Attributes
    ----------
    start : ndarray of int64, shape (n + 1,)
        Row i is ``start[i]:start[i + 1]``.
    other : ndarray of int32, shape (p,)
        The partner j > i; within a row sorted by distance, equal ones by j.
    shift : ndarray of int8, shape (p,)
        The partner's position is R(shift*angle) x_j; all zero without a sector, otherwise 0, 1 or -1.
    """

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.other)

    def rows(self) -> np.ndarray:
        """The grain i of each pair, int64, shape (p,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def incoming(self) -> tuple[np.ndarray, np.ndarray]:
        """The transposed index: (start (n + 1,), slot (p,)), the slots in which each grain is the partner."""
        start = np.zeros(len(self.start), dtype=np.int64)
        np.cumsum(np.bincount(self.other, minlength=len(self.start) - 1), out=start[1:])
        return start, _transpose(start, self.other)


def find_pairs(
    position: np.ndarray,
    cutoff: float | None = None,
    sector: CyclicSector | None = None,
    reach: np.ndarray | None = None,
) -> PairList:
    """Every pair nearer than ``cutoff`` and than the sum of the two reaches, once.

    Parameters
    ----------
    position : ndarray, shape (n, 3)
        Centres [m], in any order and memory layout; in a sector inside the wedge, or not further than a fifth of
        the largest interaction distance outside.
    cutoff : float, optional
        Largest distance of centres [m].
    sector : CyclicSector, optional
        Adds the pairs across its faces.
    reach : ndarray, shape (n,), optional
        Keeps only pairs nearer than ``reach[i] + reach[j]`` [m] (grains of different size).

    Raises
    ------
    ValueError
        If there is neither cut-off nor reach, one of them is out of range, a position is not finite, or the
        sector is too narrow.
    """
    position = np.asarray(position, dtype=float)
    limit, near = _limits(len(position), cutoff, reach)
    start = np.zeros(len(position) + 1, dtype=np.int64)
    if sector is not None and len(position):
        sector.require_width(position, limit)
    if len(position) < 2 or limit == 0.0:
        return PairList(start, np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8))
    found = _rows(_search(position, near, limit, sector), start)
    np.cumsum(start, out=start)
    other = np.concatenate([other for other, _ in found])
    shift = np.zeros(len(other), dtype=np.int8) if sector is None else np.concatenate([shift for _, shift in found])
    return PairList(start, other, shift)


def finest_cell(reach: np.ndarray, cutoff: float | None = None) -> float:
    """Edge [m] of the finest cells that `find_pairs` makes for these reaches (n,) [m]: what to sort grains by."""
    limit, near = _limits(len(reach), cutoff, reach)
    return min(limit, 2.0 * _levels(near)[-1][1])


def _limits(n: int, cutoff: float | None, reach: np.ndarray | None) -> tuple[float, np.ndarray]:
    """The largest interaction distance [m], and everybody's reach (n,) [m]."""
    if cutoff is not None and not 0.0 < cutoff < np.inf:
        raise ValueError(f"cut-off = {cutoff * 1e3:g} mm; allowed: more than 0 and finite")
    if reach is None:
        if cutoff is None:
            raise ValueError("neither a cut-off nor a reach is given; pass the largest distance of a pair, or radii")
        return cutoff, np.full(n, 0.5 * cutoff)
    near = np.ascontiguousarray(reach, dtype=float)
    if near.shape != (n,):
        raise ValueError(f"reach has shape {near.shape}; it must be ({n},), one for each grain")
    largest = float(near.max(initial=0.0))
    if not (near.min(initial=0.0) >= 0.0 and largest < np.inf):
        raise ValueError("a reach is negative or not a finite number; pass radii plus half the skin [m]")
    return min(2.0 * largest, np.inf if cutoff is None else cutoff), near


# columns of a grid's row in `_Search.grids`; AXIS and COUNT have three
AXIS, COUNT, BEGIN, END, TABLE, NUMBER = 0, 3, 6, 7, 8, 9
# columns of its row in `_Search.lengths`; LOW and INVERSE have three
LOW, INVERSE, REACH = 0, 3, 6


class _Piece(NamedTuple):
    """Room for some rows of the list.

    Attributes
    ----------
    other, shift : ndarray of int32 and int8, shape (room,)
        Partners and their shifts.
    near, key : ndarray of int32 and float, shape (room,)
        Scratch: candidates of a row, then codes and squared distances [m^2] of its partners.
    rank : ndarray of int64, shape (SHORT,)
        Scratch: places of the partners of a short row.
    """

    other: np.ndarray
    shift: np.ndarray
    near: np.ndarray
    key: np.ndarray
    rank: np.ndarray


class _Search(NamedTuple):
    """Grids of cells over each other, one a level of size, and what lies in them: what the kernel needs.

    Attributes
    ----------
    limit : float
        Largest interaction distance [m].
    grids, lengths : ndarray, shapes (g, 10) int64, (g, 7) float64
        A grid a row with the columns named above: those of grains first, then those of ghosts.
    own : int
        Number of grids with grains in them.
    ordered : int
        The grid by whose cells all grains stand in order; -1 if there is none.
    beside_face : ndarray of bool, shape (n,) or (0,)
        Which grains stand near a face of the sector: only these see ghosts.
    slot : ndarray of int32, shape (n,)
        Entry of each grain.
    entry, code : ndarray, shapes (m, 4) float64, (m,) int32
        x, y, z and reach [m] of grains and ghosts, cell by cell; whose image it is: 4 j + 1 + shift.
    table, number : ndarray, shapes (c,) int32, (e,) int64
        Tables of starts one behind the other; cell numbers of the entries of grids that have none.
    """

    limit: float
    grids: np.ndarray
    lengths: np.ndarray
    own: int
    ordered: int
    beside_face: np.ndarray
    slot: np.ndarray
    entry: np.ndarray
    code: np.ndarray
    table: np.ndarray
    number: np.ndarray


def _search(position: np.ndarray, reach: np.ndarray, limit: float, sector: CyclicSector | None) -> _Search:
    """Sort grains, and their ghosts beyond the faces, into the cells of their levels."""
    n = len(position)
    clouds = [(position, reach, np.arange(1, 4 * n, 4, dtype=np.int32))]
    beside_face = np.zeros(0, dtype=bool)
    if sector is not None:
        beside_face, grain, shift = _ghosts(position, BESIDE_FACE * limit, sector)
        if len(grain):
            code = (4 * grain + 1 + shift).astype(np.int32)
            clouds.append((sector.turn(position[grain], shift), reach[grain], code))
    m = sum(len(code) for _, _, code in clouds)
    entry, entry_code, slot = np.empty((m, 4)), np.empty(m, dtype=np.int32), np.empty(n, dtype=np.int32)
    grids: list[list[int]] = []
    lengths: list[list[float]] = []
    tables: list[np.ndarray] = []
    numbers: list[np.ndarray] = []
    begin, own, ordered = 0, 0, -1
    for points, near, code in clouds:
        corners = bounds(points)
        for member, top in _levels(near):
            grid = CellGrid.over(*corners, min(limit, 2.0 * top))
            number, ascends = grid.numbers(points, member)
            order, table = grid.sort(number, m)
            _place(points, near, code, member, order, entry[begin:], entry_code[begin:])
            row = [*grid.axis, *grid.count, begin, begin + len(member), -1, -1]
            if table is None:
                row[NUMBER] = sum(len(shelf) for shelf in numbers)
                numbers.append(number[order])
            else:
                row[TABLE] = sum(len(starts) for starts in tables)
                tables.append(table)
            grids.append(row)
            lengths.append([*grid.low, *grid.inverse_edge, top])
            begin += len(member)
        if points is position:
            own = len(grids)
            # the last level is the finest: do all grains stand in the order of its cells?
            if ascends and (own == 1 or grid.numbers(points, np.arange(n, dtype=np.int32))[1]):
                ordered = own - 1
            slot[entry_code[:n] >> 2] = np.arange(n, dtype=np.int32)
    return _Search(
        limit, np.array(grids), np.array(lengths), own, ordered, beside_face, slot, entry, entry_code,
        _joined(tables, np.int32), _joined(numbers, np.int64),
    )  # fmt: skip


def _ghosts(position: np.ndarray, beside: float, sector: CyclicSector) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which grains stand within ``beside`` [m] of a face (n,), and their images (grain (g,), shift (g,))."""
    x, y = position[:, 0], position[:, 1]
    c, s = np.cos(sector.angle), np.sin(sector.angle)
    low = (y < beside) & (x > 0.0)
    high = (c * y - s * x > -beside) & (c * x + s * y > 0.0)
    grain = np.concatenate([np.flatnonzero(low), np.flatnonzero(high)])
    return low | high, grain, np.repeat([1, -1], [np.count_nonzero(low), np.count_nonzero(high)])


def _levels(reach: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Grains of like size, the largest first: their numbers (int32), ascending, and their largest reach [m]."""
    n, largest = len(reach), float(reach.max())
    if reach.min() > 0.5 * largest:
        return [(np.arange(n, dtype=np.int32), largest)]
    member, first, top = np.empty(n, dtype=np.int32), np.zeros(LEVELS + 1, dtype=np.int64), np.zeros(LEVELS)
    _sort_by_level(reach, largest, member, first, top)
    return [(member[first[k] : first[k + 1]], float(top[k])) for k in range(LEVELS) if first[k + 1] > first[k]]


def _joined(parts: list[np.ndarray], kind: type) -> np.ndarray:
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([np.zeros(0, dtype=kind), *parts])


def _rows(search: _Search, start: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Partners and shifts of all rows, in pieces; the length of row i goes into ``start[i + 1]``."""
    n = len(search.slot)
    blocks = [(first, min(first + BLOCK, n)) for first in range(0, n, BLOCK)]
    threads = min(numba.get_num_threads(), len(blocks)) if n >= WORTH_SHARING else 1
    if threads == 1:
        return [piece for first, stop in blocks for piece in _block(search, first, stop, start)]
    with ThreadPoolExecutor(threads) as pool:
        filled = pool.map(lambda block: _block(search, block[0], block[1], start), blocks)
        return [piece for pieces in filled for piece in pieces]


def _block(search: _Search, row: int, stop: int, start: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The rows from ``row`` to ``stop``: a piece as long as the scratch has room, then the next."""
    pieces = []
    room = 8 * (stop - row) + 256
    while row < stop:
        piece = _Piece(
            np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int8), np.empty(room, dtype=np.int32),
            np.empty(room), np.empty(SHORT, dtype=np.int64),
        )  # fmt: skip
        reached, found = _fill_rows(search, row, stop, start, piece)
        shift = piece.shift[:found].copy() if len(search.beside_face) else piece.shift[:0]
        pieces.append((piece.other[:found].copy(), shift))
        if reached == row:  # this row alone needs more
            room *= 4
        row = reached
    return pieces


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_rows(search, row, stop, start, piece):
    """Fill rows from ``row`` on; returns the row at which the room ended, or ``stop``, and the pairs found."""
    limit, grids, lengths, own, ordered, beside_face, slot, entry, code, table, number = search
    other, shift, near, key, rank = piece
    room, found = other.shape[0], 0
    after = 0  # first entry of the ordered grid that has a higher number than i
    if ordered >= 0:
        after = _first_from(4 * row, code, grids[ordered, BEGIN], grids[ordered, END])
    for i in range(row, stop):
        me, last_code = slot[i], 4 * i + 3
        x, y, z, r = entry[me, 0], entry[me, 1], entry[me, 2], entry[me, 3]
        m = 0
        for g in range(grids.shape[0]):
            if g == own and not beside_face[i]:
                break
            begin, end = grids[g, BEGIN], grids[g, END]
            # at least half as wide as a cell, hence twice its margin
            width = (1.0 + 2.0 * MARGIN) * min(limit, r + lengths[g, REACH])
            u0 = entry[me, grids[g, AXIS]] - lengths[g, LOW]
            u1 = entry[me, grids[g, AXIS + 1]] - lengths[g, LOW + 1]
            u2 = entry[me, grids[g, AXIS + 2]] - lengths[g, LOW + 2]
            a0, a1 = _span(u0, width, lengths[g, INVERSE], grids[g, COUNT])
            b0, b1 = _span(u1, width, lengths[g, INVERSE + 1], grids[g, COUNT + 1])
            c0, c1 = _span(u2, width, lengths[g, INVERSE + 2], grids[g, COUNT + 2])
            if a0 == a1 or b0 == b1:
                continue
            first, first_b = begin, b0
            if g == ordered:  # lines before the grain's own hold lower numbers only
                while after < end and code[after] <= last_code:
                    after += 1
                first = after
                c0, first_b = int(u2 * lengths[g, INVERSE + 2]), int(u1 * lengths[g, INVERSE + 1])
            everywhere = (c1 - c0) * (b1 - b0) > end - begin  # more lines than grains: look at all of these
            if everywhere:
                b1, c1 = first_b + 1, c0 + 1
            for c in range(c0, c1):
                for b in range(first_b, b1):
                    line = (c * grids[g, COUNT + 1] + b) * grids[g, COUNT]
                    if everywhere:
                        lo, hi = begin, end
                    elif grids[g, TABLE] >= 0:
                        line += grids[g, TABLE]
                        lo, hi = begin + table[line + a0], begin + table[line + a1]
                    else:
                        shelf = grids[g, NUMBER]
                        lo = _first_from(line + a0, number, shelf, shelf + end - begin)
                        hi = _first_from(line + a1, number, lo, shelf + end - begin) + begin - shelf
                        lo += begin - shelf
                    lo = max(lo, first)
                    length = max(hi - lo, 0)
                    if m + length + FEW > room:
                        return i, found
                    for k in range(FEW):  # mostly enough, and without a branch on the length
                        near[m + k] = lo + k
                    for k in range(FEW, length):
                        near[m + k] = lo + k
                    m += length
                first_b = b0
        if found + m > room:
            return i, found
        partners = 0
        for k in range(m):
            e = near[k]
            dx, dy, dz = entry[e, 0] - x, entry[e, 1] - y, entry[e, 2] - z
            square = dx * dx + dy * dy + dz * dz
            width = min(limit, r + entry[e, 3])
            # written in any case, kept by counting it: a branch would be mispredicted every other time
            near[partners], key[partners] = code[e], square
            partners += 1 if (square < width * width) & (code[e] > last_code) else 0
        if partners > SHORT:
            _heap_sort(key, near, partners)
            for k in range(partners):
                other[found + k] = near[k]
        else:
            for k in range(partners):
                place = 0
                for q in range(k):
                    behind = 1 if (key[q] > key[k]) | ((key[q] == key[k]) & (near[q] > near[k])) else 0
                    rank[q] += behind
                    place += 1 - behind
                rank[k] = place
            for k in range(partners):
                other[found + rank[k]] = near[k]
        if beside_face.shape[0] > 0:
            for k in range(found, found + partners):
                shift[k] = (other[k] & 3) - 1
        for k in range(found, found + partners):
            other[k] >>= 2
        start[i + 1] = partners
        found += partners
    return stop, found


@inner(error_model="numpy")
def _span(u, width, inverse, count):
    """Cells from .. to (exclusive) of one axis that [u - width, u + width] touches; both zero if there are none."""
    low, high = (u - width) * inverse, (u + width) * inverse
    if high < 0.0 or low >= count:
        return 0, 0
    return int(max(low, 0.0)), int(min(high, count - 1.0)) + 1


@inner(error_model="numpy")
def _first_from(value, ascending, begin, end):
    """First place in ``ascending[begin:end]`` that holds ``value`` or more."""
    while begin < end:
        middle = (begin + end) // 2
        if ascending[middle] < value:
            begin = middle + 1
        else:
            end = middle
    return begin


@inner(error_model="numpy")
def _heap_sort(key, near, count):
    """Sort the first ``count`` of both by key, equal ones by near."""
    for end in range(2 * count - 1, 0, -1):
        # first half of the turns: make a heap from the middle down; second half: its top goes to the end
        if end >= count:
            root, size = (end - count) // 2, count
        else:
            key[0], key[end] = key[end], key[0]
            near[0], near[end] = near[end], near[0]
            root, size = 0, end
        moved, whose = key[root], near[root]
        while True:
            child = 2 * root + 1
            if child >= size:
                break
            if child + 1 < size and _before(key[child], near[child], key[child + 1], near[child + 1]):
                child += 1
            if not _before(moved, whose, key[child], near[child]):
                break
            key[root], near[root] = key[child], near[child]
            root = child
        key[root], near[root] = moved, whose


@inner(error_model="numpy")
def _before(key, whose, other_key, other_whose):
    return key < other_key or (key == other_key and whose < other_whose)


@njit(cache=True, error_model="numpy")
def _place(position, reach, code, member, order, entry, entry_code):
    """Entries of a grid's grains in the order of its cells."""
    for k in range(member.shape[0]):
        i = member[order[k]]
        entry[k, 0], entry[k, 1], entry[k, 2] = position[i, 0], position[i, 1], position[i, 2]
        entry[k, 3] = reach[i]
        entry_code[k] = code[i]


@njit(cache=True, error_model="numpy")
def _sort_by_level(reach, largest, member, first, top):
    """Grains of level 0, 1, ... one behind the other; ``first`` (levels + 1,), ``top`` (levels,) zero on entry."""
    levels = top.shape[0]
    for turn in range(2):  # count, then place
        for i in range(reach.shape[0]):
            level, bound = 0, 0.5 * largest
            while reach[i] <= bound and level < levels - 1:
                level, bound = level + 1, 0.5 * bound
            if turn == 0:
                first[level + 1] += 1
                top[level] = max(top[level], reach[i])
            else:
                member[first[level]] = i
                first[level] += 1
        if turn == 0:
            for k in range(levels):
                first[k + 1] += first[k]
    for k in range(levels, 0, -1):
        first[k] = first[k - 1]
    first[0] = 0


@njit(cache=True, error_model="numpy")
def _transpose(start, other):
    cursor = start[:-1].copy()
    slot = np.empty(other.shape[0], dtype=np.int32)
    for k in range(other.shape[0]):
        j = other[k]
        slot[cursor[j]] = k
        cursor[j] += 1
    return slot
