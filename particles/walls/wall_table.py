"""Walls as tables of numbers for the kernels, and the space that they enclose.

Planes and walls of revolution make one table, the triangles of all `TriangleWall`s another, in the frame of the body
that each turns with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from geometry.triangle_wall import TriangleWall, joined
from geometry.walls import Plane, RevolvedWall, Wall
from particles.bodies import Body
from particles.walls.triangle_kernels import N_TRIANGLE
from particles.walls.wall_kernels import N_WALL, beyond


@dataclass(frozen=True, slots=True)
class WallTable:
    """Planes and walls of revolution in the kernel's form.

    Attributes
    ----------
    rows : ndarray, shape (n, N_WALL)
        Columns as named in `particles.walls.wall_kernels`, lengths in m.
    body, wall : ndarray of int64, shape (n,)
        Index of the body that each turns with, and of the wall in the list that it comes from.
    """

    rows: np.ndarray
    body: np.ndarray
    wall: np.ndarray


@dataclass(frozen=True, slots=True)
class TriangleTable:
    """The triangles of all triangle walls, body by body.

    Attributes
    ----------
    rows : ndarray, shape (t, N_TRIANGLE)
        Columns as named in `particles.walls.triangle_kernels`, in the frame of the body [m].
    body, wall : ndarray of int64, shape (t,)
        Index of the body of each triangle (ascending), and of the wall in the list that it comes from.
    first : ndarray of int64, shape (n_bodies + 1,)
        Body b has the triangles ``first[b]`` up to ``first[b + 1]``.
    """

    rows: np.ndarray
    body: np.ndarray
    wall: np.ndarray
    first: np.ndarray

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.rows)


def wall_table(walls: Sequence[Wall], bodies: Sequence[Body]) -> WallTable:
    """Translate the planes and walls of revolution among ``walls``; ``bodies`` are looked up by name.

    Raises
    ------
    ValueError
        For a body that does not exist or stands twice, or a plane that would have to swing with a turning
        body.
    """
    index = _body_of(walls, bodies)
    for wall, b in zip(walls, index, strict=True):
        if isinstance(wall, Plane) and bodies[b].can_turn and abs(wall.normal[2]) < 1.0 - 1e-12:
            raise ValueError(
                f"plane {wall.name!r} is not normal to the axis but its body {wall.body!r} turns: it would "
                "swing round; put it on a body at rest, or use a wall of revolution or a triangle wall"
            )
    which = np.array([k for k, wall in enumerate(walls) if not isinstance(wall, TriangleWall)], dtype=np.int64)
    return WallTable(wall_rows(walls), index[which], which)


def triangle_table(walls: Sequence[Wall], bodies: Sequence[Body]) -> TriangleTable:
    """Translate the triangle walls among ``walls``; ``bodies`` are looked up by name.

    Raises
    ------
    ValueError
        For a body that does not exist or stands twice.
    """
    index = _body_of(walls, bodies)
    chosen = sorted((b, k) for k, b in enumerate(index) if isinstance(walls[k], TriangleWall))
    meshes = [wall for _, k in chosen if isinstance(wall := walls[k], TriangleWall)]
    sizes = [len(mesh.triangles) for mesh in meshes]
    body = np.repeat(np.array([b for b, _ in chosen], dtype=np.int64), sizes)
    which = np.repeat(np.array([k for _, k in chosen], dtype=np.int64), sizes)
    rows = np.concatenate([triangle_rows(mesh.vertices, mesh.triangles) for mesh in meshes] or [triangle_rows()])
    return TriangleTable(rows, body, which, np.searchsorted(body, np.arange(len(bodies) + 1)).astype(np.int64))


def _body_of(walls: Sequence[Wall], bodies: Sequence[Body]) -> np.ndarray:
    """Index of the body of each wall, int64."""
    names = [body.name for body in bodies]
    if len(set(names)) != len(names):
        raise ValueError(f"two bodies have the same name: {sorted(names)}; give each its own")
    for wall in walls:
        if wall.body not in names:
            raise ValueError(
                f"wall {wall.name!r} belongs to body {wall.body!r}, which does not exist; "
                f"bodies are: {', '.join(names) or 'none'}"
            )
    return np.array([names.index(wall.body) for wall in walls], dtype=np.int64)


def wall_rows(walls: Sequence[Wall]) -> np.ndarray:
    """The geometry of planes and walls of revolution alone, shape (n, N_WALL)."""
    analytic = [wall for wall in walls if not isinstance(wall, TriangleWall)]
    rows = np.zeros((len(analytic), N_WALL))
    for row, wall in zip(rows, analytic, strict=True):
        if isinstance(wall, Plane):
            row[:7] = [1.0, *wall.point, *wall.normal]
            continue
        (r0, z0), (r1, z1) = wall.start, wall.end
        row[1:7] = [r0, z0, r1, z1, (r1 - r0) / wall.length, (z1 - z0) / wall.length]
        if wall.start_neighbour is not None:
            row[7:10] = [1.0, *wall.start_neighbour]
        if wall.end_neighbour is not None:
            row[10:13] = [1.0, *wall.end_neighbour]
    return rows


def triangle_rows(vertices: np.ndarray | None = None, triangles: np.ndarray | None = None) -> np.ndarray:
    """Point and axes of each triangle for `triangle_kernels`, shape (t, N_TRIANGLE); vertices (v, 3) [m]."""
    if vertices is None or triangles is None:
        return np.zeros((0, N_TRIANGLE))
    corner = vertices[triangles]
    sides = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    # the longest edge first; turning the corners keeps the side that the normal points to
    turned = (np.argmax(sides, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corner, turned[:, :, None], axis=1), 1, 0)
    length = sides.max(axis=1)
    u = (b - a) / length[:, None]
    along = np.einsum("ij,ij->i", c - a, u)
    v = c - a - along[:, None] * u
    v /= np.linalg.norm(v, axis=1)[:, None]
    v -= np.einsum("ij,ij->i", u, v)[:, None] * u  # of a sliver's height, rounding may be a large part
    v /= np.linalg.norm(v, axis=1)[:, None]
    height = np.einsum("ij,ij->i", c - a, v)
    return np.column_stack([a, u, v, np.cross(u, v), length, along, height])


class Enclosure:
    """The space that walls enclose.

    The walls of revolution together span a radius and a height, which triangle walls may widen; where there are neither
    they nor planes, the triangle walls span them if together they are watertight. A plane bounds a half-space.
    """

    def __init__(self, walls: Sequence[Wall]) -> None:
        self._planes = wall_rows([wall for wall in walls if isinstance(wall, Plane)])
        span = _span(tuple(walls))
        self._cylinder = (np.inf, -np.inf, np.inf) if span is None else span

    def outside(self, position: np.ndarray, margin: float) -> np.ndarray:
        """True where centres (n, 3) [m] are beyond it by more than ``margin`` [m]: bool, shape (n,)."""
        return beyond(np.ascontiguousarray(position), self._planes, *self._cylinder, margin)


def outside(position: np.ndarray, walls: Sequence[Wall], margin: float) -> np.ndarray:
    """True where centres are outside of the walls by more than ``margin`` [m]: bool, shape (n,)."""
    return Enclosure(walls).outside(position, margin)


@lru_cache(maxsize=16)
def _span(walls: tuple[Wall, ...]) -> tuple[float, float, float] | None:
    """Largest radius, lowest and highest z [m] of the walls about the axis; None where they do not enclose."""
    ends = [end for wall in walls if isinstance(wall, RevolvedWall) for end in (wall.start, wall.end)]
    meshes = [wall for wall in walls if isinstance(wall, TriangleWall)]
    if ends:
        if not np.all(np.ptp(np.array(ends), axis=0) > 0.0):
            return None
    elif not meshes or len(meshes) < len(walls):
        return None
    elif not all(mesh.is_closed for mesh in meshes) and not joined("all", "any", meshes).is_closed:
        return None
    points = np.array(ends).reshape(-1, 2)
    for mesh in meshes:
        points = np.vstack([points, np.column_stack([np.hypot(*mesh.vertices.T[:2]), mesh.vertices[:, 2]])])
    return float(points[:, 0].max()), float(points[:, 1].min()), float(points[:, 1].max())
