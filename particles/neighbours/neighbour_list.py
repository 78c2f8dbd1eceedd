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

import numba
import numpy as np

from particles.neighbours import neighbour_kernels as kernels
from particles.neighbours.cells import CellGrid, bounds, cell_order
from particles.neighbours.neighbour_kernels import (
    NUMBER,
    SHORT,
    TABLE,
    Piece,
    Search,
)
from particles.sector import CyclicSector

__all__ = ["PairList", "cell_order", "find_pairs", "finest_cell"]

LEVELS = 31  # of size; grains smaller than 1e-9 of the largest share the last one
BLOCK = 8192  # rows that are filled at once: their scratch stays in the cache
WORTH_SHARING = 3 * BLOCK  # grains from which on several threads are worth starting
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
        return start, kernels.transpose(start, self.other)


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


def _search(position: np.ndarray, reach: np.ndarray, limit: float, sector: CyclicSector | None) -> Search:
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
            kernels.place(points, near, code, member, order, entry[begin:], entry_code[begin:])
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
    return Search(
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
    kernels.sort_by_level(reach, largest, member, first, top)
    return [(member[first[k] : first[k + 1]], float(top[k])) for k in range(LEVELS) if first[k + 1] > first[k]]


def _joined(parts: list[np.ndarray], kind: type) -> np.ndarray:
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([np.zeros(0, dtype=kind), *parts])


def _rows(search: Search, start: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Partners and shifts of all rows, in pieces; the length of row i goes into ``start[i + 1]``."""
    n = len(search.slot)
    blocks = [(first, min(first + BLOCK, n)) for first in range(0, n, BLOCK)]
    threads = min(numba.get_num_threads(), len(blocks)) if n >= WORTH_SHARING else 1
    if threads == 1:
        return [piece for first, stop in blocks for piece in _block(search, first, stop, start)]
    with ThreadPoolExecutor(threads) as pool:
        filled = pool.map(lambda block: _block(search, block[0], block[1], start), blocks)
        return [piece for pieces in filled for piece in pieces]


def _block(search: Search, row: int, stop: int, start: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The rows from ``row`` to ``stop``: a piece as long as the scratch has room, then the next."""
    pieces = []
    room = 8 * (stop - row) + 256
    while row < stop:
        piece = Piece(
            np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int8), np.empty(room, dtype=np.int32),
            np.empty(room), np.empty(SHORT, dtype=np.int64),
        )  # fmt: skip
        reached, found = kernels.fill_rows(search, row, stop, start, piece)
        shift = piece.shift[:found].copy() if len(search.beside_face) else piece.shift[:0]
        pieces.append((piece.other[:found].copy(), shift))
        if reached == row:  # this row alone needs more
            room *= 4
        row = reached
    return pieces
