"""Which triangles are near each grain: a grid of cells over the triangles of each body, in that body's frame.

There the triangles never move, so that a grid is made once and lasts as long as the reach asked for hardly changes. A
cell lists every triangle within reach of it, in ascending order: a grain looks into its own cell only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from particles.walls.triangle_kernels import AX, AZ, CX, CY, LENGTH, UX, UZ, VX, VZ, _offset
from particles.walls.wall_table import TriangleTable

_SPARE = 1.2  # a grid is made for a little more than the reach that is asked for
MOST_CELLS = 2_000_000
VISITS = 100_000, 250  # cells looked at while a grid is made: in all, and for each triangle
# columns of a body's grid
X0, Y0, Z0, PER_LENGTH, SHAPE_X, SHAPE_Y, SHAPE_Z, FIRST_CELL = range(8)


class TriangleSearch:
    """Finds near triangles, `table` being those of all bodies."""

    def __init__(self, table: TriangleTable) -> None:
        self.table = table
        self._reach = 0.0
        self._grids = np.zeros((0, 8))
        self._cell_start = self._cell_triangle = np.zeros(1, dtype=np.int64)

    def near(self, position: np.ndarray, reach: np.ndarray, angle: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Triangles closer than ``reach`` (n,) [m] to each centre ``position`` (n, 3) [m], bodies at ``angle`` [rad].

        Returns
        -------
        start, other : (n + 1,) int64, (s,) int32
            ``other[start[i]:start[i + 1]]`` are those of grain i, ascending, and so body by body.
        """
        n = len(position)
        start = np.zeros(n + 1, dtype=np.int64)
        if len(self.table.rows) == 0 or n == 0:
            return start, np.zeros(0, dtype=np.int32)
        farthest = float(reach.max())
        if not 0.5 * self._reach < farthest <= self._reach:
            self._make_grids(_SPARE * farthest)
        turn = np.column_stack([np.cos(angle), np.sin(angle)])
        other = np.zeros(2 * n, dtype=np.int32)
        arguments = (
            np.ascontiguousarray(position), np.ascontiguousarray(reach), self.table.rows, turn, self._grids,
            self._cell_start, self._cell_triangle, start,
        )  # fmt: skip
        found = near_triangles(*arguments, other)
        if found > len(other):
            other = np.zeros(found, dtype=np.int32)
            near_triangles(*arguments, other)
        return start, other[:found].copy()

    def _make_grids(self, reach: float) -> None:
        rows, first = self.table.rows, self.table.first
        corners = _corners(rows)
        lower, upper = corners.min(axis=1) - reach, corners.max(axis=1) + reach
        grids = np.zeros((len(first) - 1, 8))
        cells = 0
        for grid, lo, hi in zip(grids, first[:-1], first[1:], strict=True):
            if lo == hi:
                continue
            origin = lower[lo:hi].min(axis=0)
            size = upper[lo:hi].max(axis=0) - origin
            cell = _cell_size(size, (upper - lower)[lo:hi], reach)
            shape = np.floor(size / cell) + 1
            grid[:] = [*origin, 1.0 / cell, *shape, cells]
            cells += int(shape.prod())
        count = np.zeros(cells, dtype=np.int64)
        start = np.zeros(cells + 1, dtype=np.int64)
        listed = np.empty(0, dtype=np.int64)
        for grid, lo, hi in zip(grids, first[:-1], first[1:], strict=True):
            _list_by_cell(rows, lo, hi, reach, lower, upper, grid, count, listed)
        start[1:] = np.cumsum(count)
        cursor, listed = start[:-1].copy(), np.empty(start[-1], dtype=np.int64)
        for grid, lo, hi in zip(grids, first[:-1], first[1:], strict=True):
            _list_by_cell(rows, lo, hi, reach, lower, upper, grid, cursor, listed)
        self._grids, self._reach, self._cell_start, self._cell_triangle = grids, reach, start, listed


def _corners(rows: np.ndarray) -> np.ndarray:
    """Corners of each triangle [m], (t, 3, 3)."""
    a, u, v = rows[:, AX : AZ + 1], rows[:, UX : UZ + 1], rows[:, VX : VZ + 1]
    b = a + rows[:, LENGTH, None] * u
    return np.stack([a, b, a + rows[:, CX, None] * u + rows[:, CY, None] * v], axis=1)


def _cell_size(size: np.ndarray, boxes: np.ndarray, reach: float) -> float:
    """Edge of a cell [m]: the reach, larger where large triangles or an empty space would make too many cells."""
    cell = reach
    visits = VISITS[0] + VISITS[1] * len(boxes)
    while np.prod(size / cell + 1.0) > MOST_CELLS or np.prod(boxes / cell + 1.0, axis=1).sum() > visits:
        cell *= 1.25
    return cell


@njit(cache=True, error_model="numpy")
def _list_by_cell(rows, lo, hi, reach, lower, upper, grid, cursor, listed):
    """Count the triangles of each cell in ``cursor``, or, where ``listed`` has room, write them there."""
    per = grid[PER_LENGTH]
    ny, nz = int(grid[SHAPE_Y]), int(grid[SHAPE_Z])
    # half a cell's diagonal farther than the reach, with room for rounding
    limit = reach + 0.5 * np.sqrt(3.0) / per * (1.0 + 1e-9)
    for t in range(lo, hi):
        ix0, ix1 = int((lower[t, 0] - grid[X0]) * per), int((upper[t, 0] - grid[X0]) * per)
        iy0, iy1 = int((lower[t, 1] - grid[Y0]) * per), int((upper[t, 1] - grid[Y0]) * per)
        iz0, iz1 = int((lower[t, 2] - grid[Z0]) * per), int((upper[t, 2] - grid[Z0]) * per)
        for ix in range(ix0, min(ix1 + 1, int(grid[SHAPE_X]))):
            for iy in range(iy0, min(iy1 + 1, ny)):
                for iz in range(iz0, min(iz1 + 1, nz)):
                    x, y, z = grid[X0] + (ix + 0.5) / per, grid[Y0] + (iy + 0.5) / per, grid[Z0] + (iz + 0.5) / per
                    du, dv, s = _offset(rows, t, x, y, z)
                    if du * du + dv * dv + s * s <= limit * limit:
                        c = int(grid[FIRST_CELL]) + (ix * ny + iy) * nz + iz
                        if listed.shape[0] > 0:
                            listed[cursor[c]] = t
                        cursor[c] += 1


@njit(cache=True, error_model="numpy")
def near_triangles(position, reach, rows, turn, grids, cell_start, cell_triangle, start, other):
    """Fill ``start`` (n + 1,) and ``other`` as in `TriangleSearch.near`; returns their number, whatever fits."""
    found = 0
    for i in range(position.shape[0]):
        start[i] = found
        limit = reach[i] * reach[i]
        z = position[i, 2]
        for b in range(grids.shape[0]):
            per = grids[b, PER_LENGTH]
            if per == 0.0:  # a body without triangles
                continue
            x = turn[b, 0] * position[i, 0] + turn[b, 1] * position[i, 1]
            y = turn[b, 0] * position[i, 1] - turn[b, 1] * position[i, 0]
            fx, fy, fz = (x - grids[b, X0]) * per, (y - grids[b, Y0]) * per, (z - grids[b, Z0]) * per
            inside = fx >= 0.0 and fy >= 0.0 and fz >= 0.0
            if not (inside and fx < grids[b, SHAPE_X] and fy < grids[b, SHAPE_Y] and fz < grids[b, SHAPE_Z]):
                continue
            c = int(grids[b, FIRST_CELL]) + (int(fx) * int(grids[b, SHAPE_Y]) + int(fy)) * int(
                grids[b, SHAPE_Z]
            ) + int(fz)  # fmt: skip
            for k in range(cell_start[c], cell_start[c + 1]):
                t = cell_triangle[k]
                du, dv, s = _offset(rows, t, x, y, z)
                if du * du + dv * dv + s * s < limit:
                    if found < other.shape[0]:
                        other[found] = t
                    found += 1
    start[position.shape[0]] = found
    return found
