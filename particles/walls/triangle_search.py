"""Triangles near each grain: a grid of cells over the triangles of each body, in that body's frame.

There the triangles never move, so that a grid is made once and lasts as long as the reach asked for hardly changes. A
cell lists every triangle within reach of it, in ascending order: a grain looks into its own cell only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from particles.walls.triangle_kernels import (
    AX,
    AZ,
    CX,
    CY,
    LENGTH,
    UX,
    UZ,
    VX,
    VZ,
    list_by_cell,
    near_triangles,
)  # fmt: skip
from particles.walls.wall_table import TriangleTable

_SPARE = 1.2  # a grid is made for a little more than the reach that is asked for
MAX_CELLS = 2_000_000
VISITS = 100_000, 250  # cells looked at while a grid is made: in all, and for each triangle


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
        count = near_triangles(*arguments, other)
        if count > len(other):
            other = np.zeros(count, dtype=np.int32)
            near_triangles(*arguments, other)
        return start, other[:count].copy()

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
            list_by_cell(rows, lo, hi, reach, lower, upper, grid, count, listed)
        start[1:] = np.cumsum(count)
        cursor, listed = start[:-1].copy(), np.empty(start[-1], dtype=np.int64)
        for grid, lo, hi in zip(grids, first[:-1], first[1:], strict=True):
            list_by_cell(rows, lo, hi, reach, lower, upper, grid, cursor, listed)
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
    while np.prod(size / cell + 1.0) > MAX_CELLS or np.prod(boxes / cell + 1.0, axis=1).sum() > visits:
        cell *= 1.25
    return cell
