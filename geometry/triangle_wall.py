"""A wall of triangles: vanes, ribs, hoppers, anything that is neither a plane nor a surface of revolution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

MERGED = 1e-9  # of the wall's size: vertices closer than this are one, a triangle that is thinner is none


@dataclass(frozen=True, slots=True, eq=False)
class TriangleWall:
    """Triangles that grains may touch from either side.

    Vertices that coincide are merged, those that no triangle uses and triangles that stand twice (in either direction)
    are dropped, so that `vertices` and `triangles` may be fewer than were given.

    Attributes
    ----------
    name, body : str
        Its own name, and the body (shaft) that it turns with.
    vertices : ndarray, shape (v, 3)
        Places [m] when the body's angle is 0.
    triangles : ndarray of int64, shape (t, 3)
        Vertices of each. The right-hand rule gives the normal; it matters for nothing but a grain whose centre is
        exactly on the surface.
    """

    name: str
    body: str
    vertices: np.ndarray
    triangles: np.ndarray
    magnetic: ClassVar[bool] = False  # triangles mirror no dipoles

    def __post_init__(self) -> None:
        vertices, triangles = np.array(self.vertices, dtype=float), np.asarray(self.triangles)
        self._check(vertices, triangles)
        size = float(np.linalg.norm(np.ptp(vertices[triangles].reshape(-1, 3), axis=0)))
        thin = np.flatnonzero(~(heights(vertices, triangles) > MERGED * size))
        if len(thin):
            corners = np.round(1e3 * vertices[triangles[thin[0]]], 6).tolist()
            raise ValueError(
                f"triangle wall {self.name!r}: {len(thin)} of {len(triangles)} triangles have no area, the first is "
                f"{thin[0]} with corners {corners} mm; remove them"
            )
        vertices, triangles = _merged(vertices, triangles, MERGED * size)
        _, kept = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
        triangles = triangles[np.sort(kept)]
        for name, value in (("vertices", vertices), ("triangles", triangles)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    def _check(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        of = f"triangle wall {self.name!r}: "
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise ValueError(f"{of}vertices have shape {vertices.shape}; it must be (v, 3)")
        if triangles.size == 0:
            raise ValueError(f"{of}there are no triangles")
        if triangles.ndim != 2 or triangles.shape[1] != 3 or not np.issubdtype(triangles.dtype, np.integer):
            raise ValueError(
                f"{of}triangles have shape {triangles.shape} of {triangles.dtype}; it must be (t, 3) of integers"
            )
        low, high = int(triangles.min()), int(triangles.max())
        if low < 0 or high >= len(vertices):
            raise ValueError(
                f"{of}a triangle names vertex {low if low < 0 else high}, but there are {len(vertices)}; "
                "they count from 0"
            )
        bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
        if len(bad):
            raise ValueError(f"{of}vertex {bad[0]} is not finite: {vertices[bad[0]].tolist()}")

    @property
    def area(self) -> float:
        """Area of all triangles [m^2]."""
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    @property
    def volume(self) -> float:
        """Volume inside [m^3]; positive if closed with normals outwards (divergence theorem)."""
        a, b, c = np.moveaxis(self.vertices[self.triangles] - self.vertices[0], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest x, y, z [m], each of shape (3,)."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @property
    def free_edges(self) -> np.ndarray:
        """Vertices (k, 2) of the edges that belong to one triangle, or to three, five...: the rims of its openings."""
        ends = self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        edges, uses = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
        return edges[uses % 2 == 1]

    @property
    def is_closed(self) -> bool:
        """True if it is watertight: no edge is free."""
        return len(self.free_edges) == 0

    def turned(self, angle: float, name: str | None = None) -> TriangleWall:
        """The same wall turned by ``angle`` [rad] about the axis z: the next vane."""
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return TriangleWall(name or self.name, self.body, self.vertices @ turn.T, self.triangles)


def box_surface(
    name: str, body: str, centre: Sequence[float], size: Sequence[float], angle: float = 0.0
) -> TriangleWall:
    """A closed box, ``size`` (3,) [m] about ``centre`` (3,) [m], its first side turned by ``angle`` [rad] from x."""
    if len(size) != 3 or min(size) <= 0.0:
        raise ValueError(f"box {name!r}: its sides are {list(size)} m; three positive lengths are needed")
    x, y, z = centre
    cos, sin = math.cos(angle), math.sin(angle)
    corners = [
        (x + 0.5 * (a * size[0] * cos - b * size[1] * sin), y + 0.5 * (a * size[0] * sin + b * size[1] * cos))
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return extruded(name, body, np.array(corners), z - 0.5 * size[2], z + 0.5 * size[2])


def extruded(name: str, body: str, polygon_xy: np.ndarray, z0: float, z1: float, caps: bool = True) -> TriangleWall:
    """The prism over a simple polygon, convex or not, between the heights z0 < z1 [m].

    Parameters
    ----------
    polygon_xy : array_like, shape (k, 2)
        Corners [m] in order, in either direction, the first not repeated.
    caps : bool
        Whether bottom and top are there. Normals point outwards.

    Raises
    ------
    ValueError
        For fewer than three corners, a polygon that meets itself, or z1 <= z0.
    """
    polygon = np.asarray(polygon_xy, dtype=float)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3:
        raise ValueError(f"prism {name!r}: a polygon of shape {polygon.shape}; it must be (k, 2) with k >= 3")
    if not (z0 < z1 and np.isfinite([z0, z1]).all() and np.isfinite(polygon).all()):
        raise ValueError(f"prism {name!r}: z runs from {z0} to {z1} m; finite corners and z0 < z1 are needed")
    _refuse_crossing(name, polygon)
    if _area(polygon) < 0.0:
        polygon = polygon[::-1]
    k = len(polygon)
    vertices = np.vstack([np.column_stack([polygon, np.full(k, z)]) for z in (z0, z1)])
    i, j = np.arange(k), (np.arange(k) + 1) % k
    triangles = [np.column_stack([i, j, j + k]), np.column_stack([i, j + k, i + k])]
    if caps:
        cap = _ears(polygon)
        triangles += [cap[:, ::-1], cap + k]
    return TriangleWall(name, body, vertices, np.vstack(triangles))


def joined(name: str, body: str, walls: Sequence[TriangleWall]) -> TriangleWall:
    """Several walls as one; their common vertices are merged."""
    offsets = np.cumsum([0, *(len(wall.vertices) for wall in walls)])
    return TriangleWall(
        name,
        body,
        np.vstack([wall.vertices for wall in walls]),
        np.vstack([wall.triangles + offset for wall, offset in zip(walls, offsets, strict=False)]),
    )


def heights(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Height over the longest edge of each triangle [m]; 0 where all its corners coincide."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    longest = np.maximum.reduce([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)])
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.divide(doubled, longest, out=np.zeros_like(longest), where=longest > 0.0)


def _merged(vertices: np.ndarray, triangles: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """One vertex, the first, for all that are closer than ``tolerance`` [m]; only those that are used."""
    from scipy.sparse import coo_array  # local: the face of the program loads geometry without scipy
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(vertices)
    close = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    links = coo_array((np.ones(len(close)), (close[:, 0], close[:, 1])), shape=(count, count))
    _, label = connected_components(links, directed=False)
    first = np.unique(label, return_index=True)[1]
    used, renumbered = np.unique(first[label][triangles], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int64)


def _area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the signed area of the triangle abc, positive to the left."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _refuse_crossing(name: str, polygon: np.ndarray) -> None:
    k = len(polygon)
    for i in range(k):
        a, b = polygon[i], polygon[(i + 1) % k]
        for j in range(i + 1, k):
            c, d = polygon[j], polygon[(j + 1) % k]
            if j == i + 1 or (j + 1) % k == i:  # neighbours share a corner; they must not fold back over each other
                tip, out, back = (b, a, d) if j == i + 1 else (a, b, c)
                crossing = _turn(tip, out, back) == 0.0 and float((out - tip) @ (back - tip)) >= 0.0
            else:
                crossing = (
                    _turn(a, b, c) * _turn(a, b, d) <= 0.0
                    and _turn(c, d, a) * _turn(c, d, b) <= 0.0
                    and bool(np.all(np.maximum(a, b) >= np.minimum(c, d)))
                    and bool(np.all(np.maximum(c, d) >= np.minimum(a, b)))
                )
            if crossing:
                raise ValueError(
                    f"prism {name!r}: sides {i} and {j} of its polygon meet; give the corners in order round it, "
                    "none twice"
                )


def _ears(polygon: np.ndarray) -> np.ndarray:
    """Triangles (k - 2, 3) of a simple polygon given counter-clockwise, by cutting ears off.

    G. H. Meisters, Am. Math. Monthly 82, 1975, 648: a simple polygon has an ear. Of those that there are the fattest
    is cut; corners in the middle of a straight side are kept for a triangle that has area.
    """
    left = list(range(len(polygon)))
    ears = []
    while len(left) > 3:
        best, fatness = -1, 0.0
        for n in range(len(left)):
            a, b, c = (polygon[left[m % len(left)]] for m in (n - 1, n, n + 1))
            doubled = _turn(a, b, c)
            shape = doubled / max(float(np.sum((q - p) ** 2)) for p, q in ((a, b), (b, c), (c, a)))
            if shape <= fatness:
                continue
            others = (polygon[m] for m in left if m not in (left[n - 1], left[n], left[(n + 1) % len(left)]))
            if not any(min(_turn(a, b, p), _turn(b, c, p), _turn(c, a, p)) >= 0.0 for p in others):
                best, fatness = n, shape
        if best < 0:
            raise ValueError("a polygon is too thin to be cut into triangles; give its corners more exactly")
        ears.append([left[best - 1], left[best], left[(best + 1) % len(left)]])
        del left[best]
    return np.array([*ears, left])
