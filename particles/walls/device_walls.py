"""All walls of a device for the kernels: the smooth ones, then the triangles, numbered through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from geometry.triangle_wall import TriangleWall
from geometry.walls import Wall
from particles.bodies import Body
from particles.walls.triangle_kernels import N_TRIANGLE, triangle_overlaps
from particles.walls.triangle_search import TriangleSearch
from particles.walls.wall_kernels import near_walls, wall_overlaps
from particles.walls.wall_table import triangle_table, wall_table


class DeviceWalls:
    """Walls and triangles in the kernels' form.

    Attributes
    ----------
    rows : ndarray, shape (n_smooth, N_WALL)
        Smooth walls.
    triangles : ndarray, shape (n_smooth + n_triangles, N_TRIANGLE)
        Triangles stand at their number, after as many empty rows as there are smooth walls; no rows without any.
    body, wall : ndarray of int64, shape (n_smooth + n_triangles,)
        Index of the body that each turns with, and of the wall, in the order given, that it is part of.
    reach : ndarray, shape (n_bodies,)
        Largest radius of a body's triangles [m]: how fast they move when it turns.
    """

    def __init__(self, walls: Sequence[Wall], bodies: Sequence[Body]) -> None:
        smooth = wall_table(walls, bodies)
        flat = triangle_table(walls, bodies)
        self.rows = smooth.rows
        self.body = np.concatenate([smooth.body, flat.body]).astype(np.int64)
        self.wall = np.concatenate([smooth.wall, flat.wall]).astype(np.int64)
        self.triangles = np.zeros((0, N_TRIANGLE))
        self.reach = np.zeros(len(bodies))
        self._search = None
        if len(flat.rows):
            self.triangles = np.concatenate([np.zeros((len(smooth.rows), N_TRIANGLE)), flat.rows])
            self._search = TriangleSearch(flat)
            for b in range(len(bodies)):
                mine = [wall for wall in walls if isinstance(wall, TriangleWall) and wall.body == bodies[b].name]
                self.reach[b] = max((float(np.hypot(*wall.vertices[:, :2].T).max()) for wall in mine), default=0.0)

    def near(
        self, position: np.ndarray, reach: np.ndarray, skin: float, angles: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Walls nearer than ``reach`` (n,) [m] to each centre (n, 3) [m], triangles by half a ``skin`` [m] further.

        Returns the compressed rows (start (n + 1,) int64, number (s,) int32), ascending.
        """
        position, n = np.ascontiguousarray(position), len(position)
        start = np.zeros(n + 1, dtype=np.int64)
        other = np.zeros(n, dtype=np.int32)
        count = near_walls(position, reach, self.rows, start, other)
        if count > len(other):
            other = np.zeros(count, dtype=np.int32)
            near_walls(position, reach, self.rows, start, other)
        other = other[:count]
        if self._search is None:
            return start, other.copy()
        more_start, more = self._search.near(position, reach + 0.5 * skin, angles)
        both_start, both = start + more_start, np.empty(len(other) + len(more), dtype=np.int32)
        _merge(start, other, more_start, more + np.int32(len(self.rows)), both_start, both)
        return both_start, both

    def overlaps(
        self, position: np.ndarray, radius: np.ndarray, start: np.ndarray, other: np.ndarray, angles: Sequence[float]
    ) -> np.ndarray:
        """Overlap [m] and unit vector towards the wall of each slot of the rows, (s, 4); -inf where none counts."""
        position, radius = np.ascontiguousarray(position), np.ascontiguousarray(radius)
        row = np.repeat(np.arange(len(start) - 1), np.diff(start))
        overlap = np.empty((len(other), 4))
        smooth = other < len(self.rows)
        overlap[smooth] = wall_overlaps(position, radius, self.rows, row[smooth], other[smooth].astype(np.int64))
        if len(self.triangles):
            turn = np.column_stack([np.cos(angles), np.sin(angles)])
            more = np.zeros(len(start), dtype=np.int64)
            np.cumsum(np.bincount(row[~smooth], minlength=len(start) - 1), out=more[1:])
            triangles = other[~smooth].astype(np.int64)
            overlap[~smooth] = triangle_overlaps(position, radius, self.triangles, self.body, turn, more, triangles)
        return overlap


@njit(cache=True, error_model="numpy")
def _merge(start, other, more_start, more, both_start, both):
    for i in range(start.shape[0] - 1):
        p = both_start[i]
        for k in range(start[i], start[i + 1]):
            both[p] = other[k]
            p += 1
        for k in range(more_start[i], more_start[i + 1]):
            both[p] = more[k]
            p += 1
