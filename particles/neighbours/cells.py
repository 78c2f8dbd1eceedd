"""Grids of cells: which grains lie in which cell, and the order in which they are stored.

Cells are numbered with one axis running fastest, so that adjacent cells along it are one contiguous
run of grains. The slowest axis is the longest one of the cloud: a contiguous part of the grains is then a slab
with small faces. Along the fastest axis cells have half the length, which trims the ends of a run.

Two ways lead from a cell to its grains. A table of starts, one entry a cell, while cells are not many more
than grains; otherwise (a grain that flew far off, a stream in free fall) a search among the sorted cell numbers
of the grains: memory follows the grains and never the space.

A grid is two rows of numbers, with the columns named here: ``grid`` (int64) and ``length`` (float64).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function

# columns of ``grid``. AXIS (3): the axis (0 x, 1 y, 2 z) that runs fastest, in the middle, slowest; COUNT (3): cells
# along these, cell (a, b, c) has the number (c*count[1] + b)*count[0] + a. Of a search: its first entry and the one
# after its last, where its table begins, where its cell numbers do (-1: it has none)
AXIS, COUNT, BEGIN, END, TABLE, NUMBER, N_GRID = 0, 3, 6, 7, 8, 9, 10
# columns of ``length``. LOW (3): corner of the first cell [m]; INVERSE (3): cells a metre [1/m]; both in the order of
# AXIS. REACH: the largest of its grains [m]
LOW, INVERSE, REACH, N_LENGTH = 0, 3, 6, 7
# A cell is larger than asked by this fraction: two grains nearer than the edge are then never two cells apart
# by rounding, which is below 2 eps times the number of cells along an axis.
MARGIN = 1e-8
MAX_ALONG_AXIS = 2**20  # cells; three axes together stay within an int64
TABLE_PER_GRAIN = 16  # cells a grain (of 4 bytes) up to which the table of starts is kept; a dense bed has one
FIXED_TABLE = 1000  # cells that even a handful of grains may have
LONGER = 1.25  # so much longer is an axis that runs slower than usual
SORTED, NOT_FINITE, SPARSE = range(3)  # status of `_sort_by_cells`


def cell_order(position: np.ndarray, size: float) -> np.ndarray:
    """The order in which grains lie cell by cell; ties keep their order.

    A search whose finest cells have the edge ``size`` (`finest_cell`) is fastest on grains in this order.

    Parameters
    ----------
    position : ndarray, shape (n, 3) or more columns
        Centres [m] in the first three.
    size : float
        Edge of the cells [m].

    Returns
    -------
    ndarray of int64, shape (n,)
        ``position[order]`` is sorted.
    """
    points = np.require(position, float, ["C", "W"])
    number, order = np.empty(len(points), dtype=np.int64), np.empty(len(points), dtype=np.int64)
    if len(points) == 0:
        return order
    status = _sort_by_cells(points, size, number, order)
    if status == NOT_FINITE:
        raise not_finite(points)
    return np.argsort(number, kind="stable") if status == SPARSE else order


def not_finite(position: np.ndarray) -> ValueError:
    """Message where one of these positions (n, 3 or more) [m] is not a finite number."""
    x = position[:, :3]
    k = int(np.flatnonzero(~np.isfinite(x).all(axis=1))[0])
    return ValueError(
        f"grain {k} stands at {x[k].tolist()} m; neighbours can only be found of finite positions: shorten the time "
        "step or check the forces on it"
    )


@device_function(error_model="numpy")
def bounds(points, low, high):
    """Corners (3,) of the box around the points; False if a coordinate is not finite."""
    x0, y0, z0, x1, y1, z1 = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    odd = 0.0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        odd += (x - x) + (y - y) + (z - z)  # not a number once one is not finite
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    low[0], low[1], low[2] = x0, y0, z0
    high[0], high[1], high[2] = x1, y1, z1
    return odd == 0.0


@device_function(error_model="numpy")
def lay_grid(low, high, size, grid, length):
    """Cells of edge ``size`` over the box from ``low`` to ``high`` (3,); returns how many there are.

    Axes run x, y, z from fastest to slowest, unless one earlier is clearly longer: with a bare comparison a cloud as
    long as it is wide would be stored again in another order whenever round-off tips the balance.
    """
    slow = 2
    for a in range(1, -1, -1):
        if high[a] - low[a] > LONGER * (high[slow] - low[slow]):
            slow = a
    fast = 1 if slow == 0 else 0
    middle = 3 - fast - slow
    if high[fast] - low[fast] > LONGER * (high[middle] - low[middle]):
        fast, middle = middle, fast
    grid[AXIS], grid[AXIS + 1], grid[AXIS + 2] = fast, middle, slow
    cells = 1
    for k in range(3):
        a = grid[AXIS + k]
        extent = high[a] - low[a]
        edge = max((1.0 + MARGIN) * size * (0.5 if k == 0 else 1.0), extent / (MAX_ALONG_AXIS - 1))
        length[LOW + k], length[INVERSE + k] = low[a], 1.0 / edge
        grid[COUNT + k] = np.int64(extent * length[INVERSE + k]) + 1
        cells *= grid[COUNT + k]
    return cells


@device_function(error_model="numpy")
def number_grains(points, begin, end, grid, length, number):
    """Fill in the cell numbers of the points from ``begin`` to ``end``; returns whether they never descend."""
    fast, middle, slow = grid[AXIS], grid[AXIS + 1], grid[AXIS + 2]
    low0, low1, low2 = length[LOW], length[LOW + 1], length[LOW + 2]
    inverse0, inverse1, inverse2 = length[INVERSE], length[INVERSE + 1], length[INVERSE + 2]
    count0, count1 = grid[COUNT], grid[COUNT + 1]
    before, ascends = 0, True
    for i in range(begin, end):
        # never past the last cell: its count came from the same expression at the upper corner
        a = np.int64((points[i, fast] - low0) * inverse0)
        b = np.int64((points[i, middle] - low1) * inverse1)
        c = np.int64((points[i, slow] - low2) * inverse2)
        now = (c * count1 + b) * count0 + a
        ascends &= now >= before
        number[i] = before = now
    return ascends


@device_function(error_model="numpy")
def counting_sort(number, begin, end, table, cells, order):
    """Stable order of ``number[begin:end]``, in the same places of ``order``.

    The first place of each number, counted from ``begin``, and one more come into the last ``cells`` + 1 places of
    ``table``.
    """
    first = table.shape[0] - cells - 1
    for c in range(first, first + cells + 1):
        table[c] = 0
    for k in range(begin, end):
        table[first + number[k] + 1] += 1
    for c in range(first + 1, first + cells + 1):
        table[c] += table[c - 1]
    for k in range(begin, end):
        order[begin + table[first + number[k]]] = k
        table[first + number[k]] += 1
    for c in range(first + cells, first, -1):  # each has moved on to the start of the next
        table[c] = table[c - 1]
    table[first] = 0


@njit(cache=True, error_model="numpy")
def _sort_by_cells(points, size, number, order):
    """Fill in the order of the points; where cells are too many for a table, cell numbers only."""
    low, high = np.empty(3), np.empty(3)
    grid, length = np.empty(N_GRID, dtype=np.int64), np.empty(N_LENGTH)
    if not bounds(points, low, high):
        return NOT_FINITE
    n, cells = points.shape[0], lay_grid(low, high, size, grid, length)
    if number_grains(points, 0, n, grid, length, number):
        for m in range(n):
            order[m] = m
    elif cells > TABLE_PER_GRAIN * n + FIXED_TABLE:
        return SPARSE
    else:
        counting_sort(number, 0, n, np.empty(cells + 1, dtype=np.int32), cells, order)
    return SORTED
