"""Grids of cells: which grains lie in which cell, and the order in which they are stored.

Cells are numbered with one axis running fastest, so that cells beside each other along it are one contiguous
run of grains. The slowest axis is the longest one of the cloud: a contiguous share of the grains is then a slab
with small faces. Along the fastest axis cells have half the length, which trims the ends of a run.

Two ways lead from a cell to its grains. A table of starts, one entry a cell, while cells are not many more
than grains; otherwise (a grain that flew far off, a stream in free fall) a search among the sorted cell numbers
of the grains: memory follows the grains and never the space.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

# A cell is larger than asked by this share: two grains nearer than the edge are then never two cells apart
# by rounding, which is below 2 eps times the number of cells along an axis.
MARGIN = 1e-8
MOST_ALONG_AXIS = 2**20  # cells; three axes together stay within an int64
TABLE_PER_GRAIN = 16  # cells a grain (of 4 bytes) up to which the table of starts is kept; a dense bed has one
FIXED_TABLE = 1000  # cells that even a handful of grains may have


@dataclass(frozen=True, slots=True)
class CellGrid:
    """Box-shaped cells over a cloud of points; all arrays in the order fastest, middle, slowest axis.

    Attributes
    ----------
    axis : ndarray of int64, shape (3,)
        The axis (0 x, 1 y, 2 z) that runs fastest, in the middle, slowest.
    low : ndarray, shape (3,)
        Corner of the first cell [m].
    inverse_edge : ndarray, shape (3,)
        Cells a metre [1/m].
    count : ndarray of int64, shape (3,)
        Cells along each axis; cell (a, b, c) has the number (c*count[1] + b)*count[0] + a.
    """

    axis: np.ndarray
    low: np.ndarray
    inverse_edge: np.ndarray
    count: np.ndarray

    @classmethod
    def over(cls, low: np.ndarray, high: np.ndarray, size: float) -> CellGrid:
        """Cells of edge ``size`` [m] over the box from ``low`` to ``high`` (3,) [m]."""
        extent = high - low
        axis = _axes(extent)
        edge = np.maximum((1.0 + MARGIN) * size * np.array([0.5, 1.0, 1.0]), extent[axis] / (MOST_ALONG_AXIS - 1))
        inverse = 1.0 / edge
        return cls(axis, low[axis], inverse, (extent[axis] * inverse).astype(np.int64) + 1)

    @property
    def cells(self) -> int:
        """How many there are."""
        return int(np.prod(self.count))

    def numbers(self, position: np.ndarray, member: np.ndarray) -> tuple[np.ndarray, bool]:
        """Cell numbers (int64) of the grains ``member`` (m,) among ``position`` (n, 3), and whether they ascend."""
        number = np.empty(len(member), dtype=np.int64)
        return number, _number(position, member, self.axis, self.low, self.inverse_edge, self.count, number)

    def sort(self, number: np.ndarray, grains: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Order (int64) in which ``number`` (m,) ascends, ties kept, and the table of starts (int32, cells + 1).

        There is no table where it would be much longer than the number of ``grains`` in the whole search.
        """
        if self.cells > TABLE_PER_GRAIN * grains + FIXED_TABLE:
            return np.argsort(number, kind="stable"), None
        start, order = np.zeros(self.cells + 1, dtype=np.int32), np.empty(len(number), dtype=np.int64)
        _counting_sort(number, start, order)
        return order, start


def cell_order(position: np.ndarray, size: float) -> np.ndarray:
    """The order in which grains lie cell by cell; ties keep their order.

    A search whose finest cells have the edge ``size`` (`finest_cell`) is fastest on grains in this order.

    Parameters
    ----------
    position : ndarray, shape (n, 3)
        Centres [m].
    size : float
        Edge of the cells [m].

    Returns
    -------
    ndarray of int64, shape (n,)
        ``position[order]`` is sorted.
    """
    if len(position) == 0:
        return np.zeros(0, dtype=np.int64)
    grid = CellGrid.over(*bounds(position), size)
    number, ascends = grid.numbers(position, np.arange(len(position), dtype=np.int32))
    return np.arange(len(position)) if ascends else grid.sort(number, len(position))[0]


def bounds(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (3,) [m] of the box around ``position`` (n, 3) [m].

    Raises
    ------
    ValueError
        If a position is not a finite number.
    """
    low, high = np.empty(3), np.empty(3)
    if not _bounds(position, low, high):
        k = int(np.flatnonzero(~np.isfinite(position).all(axis=1))[0])
        raise ValueError(
            f"grain {k} stands at {np.asarray(position[k]).tolist()} m; neighbours can only be found of finite "
            "positions: shorten the time step or check the forces on it"
        )
    return low, high


def _axes(extent: np.ndarray) -> np.ndarray:
    """Axes from fastest to slowest: x, y, z, unless one earlier is clearly longer.

    A quarter longer: with a bare comparison a cloud as long as it is wide would be stored anew in another order
    whenever round-off tips the balance.
    """
    slowest = 2
    for a in (1, 0):
        if extent[a] > 1.25 * extent[slowest]:
            slowest = a
    fastest, middle = (a for a in range(3) if a != slowest)
    if extent[fastest] > 1.25 * extent[middle]:
        fastest, middle = middle, fastest
    return np.array([fastest, middle, slowest])


@njit(cache=True, error_model="numpy")
def _bounds(position, low, high):
    """Corners of the box; False if a coordinate is not finite."""
    low[:], high[:] = np.inf, -np.inf
    odd = 0.0
    for i in range(position.shape[0]):
        for a in range(3):
            x = position[i, a]
            odd += x - x  # not a number once one is not finite
            low[a], high[a] = min(low[a], x), max(high[a], x)
    return odd == 0.0


@njit(cache=True, error_model="numpy")
def _number(position, member, axis, low, inverse, count, number):
    """Fill in the cell numbers; returns whether they never descend."""
    fast, middle, slow = axis[0], axis[1], axis[2]
    before, ascends = 0, True
    for m in range(member.shape[0]):
        i = member[m]
        # never past the last cell: its count came from the same expression at the upper corner
        a = int((position[i, fast] - low[0]) * inverse[0])
        b = int((position[i, middle] - low[1]) * inverse[1])
        c = int((position[i, slow] - low[2]) * inverse[2])
        number[m] = (c * count[1] + b) * count[0] + a
        ascends &= number[m] >= before
        before = number[m]
    return ascends


@njit(cache=True, error_model="numpy")
def _counting_sort(number, start, order):
    """Stable order of ``number``; ``start`` (zeros on entry) becomes the first place of each number."""
    for m in range(number.shape[0]):
        start[number[m] + 1] += 1
    for c in range(1, start.shape[0]):
        start[c] += start[c - 1]
    for m in range(number.shape[0]):
        order[start[number[m]]] = m
        start[number[m]] += 1
    for c in range(start.shape[0] - 1, 0, -1):  # each has moved on to the start of the next
        start[c] = start[c - 1]
    start[0] = 0
