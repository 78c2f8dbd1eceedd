"""The walls that grains touch: planes, surfaces of revolution about the shaft axis z, and triangles.

A `RevolvedWall` turns the straight segment start -> end of the (r, z) half-plane about the axis: a
cylinder, an annulus or a cone in one. The point of such a surface that is closest to a sphere's centre lies
in the centre's own half-plane, so that contact reduces to the distance from the point (r, z) to a segment.

**Edges.** With t = (c - start)·(end - start)/|end - start|^2, a centre c with 0 < t < 1 touches the face.
Otherwise the closest point is an end of the segment, an edge circle v that two segments of one body usually
share. It must be touched once: only the wall that *owns* the end sees it, and only if

    (c - v) · neighbour <= 0,

neighbour being the unit vector that leaves v along the other segment, i.e. if the other segment is clamped
at v as well. On a convex edge the force then turns continuously from one face over the edge into the other;
in a concave corner both faces are touched and the edge never is; on a straight join there is one contact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from geometry.triangle_wall import TriangleWall

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class RevolvedWall:
    """The surface that the segment start -> end sweeps about the z axis.

    Attributes
    ----------
    name, body : str
        Its own name, and the body (shaft) that it turns with.
    start, end : (r, z)
        Ends of the segment [m], r >= 0. Grains may be on either side: the distance is unsigned.
    magnetic : bool
        A steel face, which mirrors dipoles.
    start_neighbour, end_neighbour : (r, z) or None
        Unit vector that leaves this end along the neighbouring segment of the same body; None where this wall
        does not own the edge circle of that end.
    """

    name: str
    body: str
    start: Pair
    end: Pair
    magnetic: bool = False
    start_neighbour: Pair | None = None
    end_neighbour: Pair | None = None

    def __post_init__(self) -> None:
        if min(self.start[0], self.end[0]) < 0.0:
            raise ValueError(f"wall {self.name!r}: a radius is negative ({self.start} to {self.end} m)")
        if self.length <= 0.0 or max(self.start[0], self.end[0]) == 0.0:
            raise ValueError(f"wall {self.name!r} has no area: it runs from {self.start} to {self.end} m")

    @property
    def length(self) -> float:
        """Length of the generating segment [m]."""
        return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])

    @property
    def area(self) -> float:
        """Area of the full surface [m^2] (Pappus' first theorem)."""
        return math.pi * (self.start[0] + self.end[0]) * self.length


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """An unbounded plane through ``point`` [m]; ``normal`` (unit) points to the grains' side; shapes (3,)."""

    name: str
    body: str
    point: np.ndarray
    normal: np.ndarray
    magnetic: ClassVar[bool] = False  # a plane mirrors no dipoles

    def __post_init__(self) -> None:
        point, normal = np.asarray(self.point, dtype=float), np.asarray(self.normal, dtype=float)
        size = float(np.linalg.norm(normal))
        if point.shape != (3,) or normal.shape != (3,) or not size > 0.0:
            raise ValueError(f"plane {self.name!r} needs a point and a non-zero normal of 3 components each")
        object.__setattr__(self, "point", point)
        object.__setattr__(self, "normal", normal / size)


Wall = RevolvedWall | Plane | TriangleWall


@dataclass(frozen=True, slots=True)
class AnnularBox:
    """The space r0 < r < r1, z0 < z < z1 [m] that is to be filled with grains."""

    r0: float
    r1: float
    z0: float
    z1: float

    def volume(self, angle: float = 2.0 * math.pi) -> float:
        """Volume [m^3] of the sector of ``angle`` [rad], the full ring by default."""
        return 0.5 * angle * (self.r1**2 - self.r0**2) * (self.z1 - self.z0)


def cylinder(name: str, body: str, radius: float, z0: float, z1: float, *, magnetic: bool = False) -> RevolvedWall:
    """Cylinder r = radius from z0 to z1 [m], with no edge of its own."""
    return RevolvedWall(name, body, (radius, z0), (radius, z1), magnetic)


def annulus(name: str, body: str, z: float, r0: float, r1: float) -> RevolvedWall:
    """Flat ring at height z from r0 to r1 [m] (a disc for r0 = 0), with no edge of its own."""
    return cone(name, body, (r0, z), (r1, z))


def cone(name: str, body: str, start: Pair, end: Pair) -> RevolvedWall:
    """Frustum between the circles start and end (r, z) [m], without edges but an apex on the axis."""
    return _close_on_axis(RevolvedWall(name, body, start, end))


def outline(
    name: str | Sequence[str],
    body: str,
    vertices: Sequence[Pair],
    closed: bool = False,
    *,
    magnetic: bool | Sequence[bool] = False,
) -> list[RevolvedWall]:
    """The walls of a polyline in (r, z), each inner vertex owned by exactly one: the segment that ends there.

    Parameters
    ----------
    name, magnetic
        One for all (the name is numbered from 1), or one for each segment.
    body : str
        The body that all of them turn with.
    vertices : sequence of (r, z)
        Corners [m] in order. A closed outline joins the last to the first; the ends of an open one belong
        to nobody.

    Raises
    ------
    ValueError
        If there are fewer than two vertices, a segment has no length, or the names do not fit the segments.
    """
    corners = [(float(r), float(z)) for r, z in vertices]
    count = len(corners) if closed else len(corners) - 1
    if count < (3 if closed else 1):
        raise ValueError(f"an outline needs at least {3 if closed else 2} vertices, got {len(corners)}")
    names = [f"{name}_{k + 1}" for k in range(count)] if isinstance(name, str) else list(name)
    steel = [magnetic] * count if isinstance(magnetic, bool) else list(magnetic)
    if len(names) != count or len(steel) != count:
        raise ValueError(f"{count} segments, but {len(names)} names and {len(steel)} magnetic flags")
    walls = [RevolvedWall(names[k], body, corners[k], corners[(k + 1) % len(corners)], steel[k]) for k in range(count)]
    owned = []
    for k, wall in enumerate(walls):
        if k + 1 < count or closed:
            follower = walls[(k + 1) % count]
            wall = replace(wall, end_neighbour=_direction(follower.start, follower.end))
        owned.append(_close_on_axis(wall))
    return owned


def _direction(start: Pair, end: Pair) -> Pair:
    length = math.hypot(end[0] - start[0], end[1] - start[1])
    return (end[0] - start[0]) / length, (end[1] - start[1]) / length


def _close_on_axis(wall: RevolvedWall) -> RevolvedWall:
    """Own the ends on the axis: there the surface continues into its own mirror image.

    Without this a grain exactly on the axis, where t = 0, would touch nothing.
    """
    r, z = _direction(wall.start, wall.end)
    if wall.start[0] == 0.0 and wall.start_neighbour is None:
        wall = replace(wall, start_neighbour=(-r, z))
    if wall.end[0] == 0.0 and wall.end_neighbour is None:
        wall = replace(wall, end_neighbour=(r, -z))
    return wall
