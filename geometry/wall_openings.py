"""Openings of a triangle wall that looks like the surface of a solid part."""

from __future__ import annotations

import numpy as np

from geometry.triangle_wall import TriangleWall

_SHEET = 0.01  # of its largest side: a part that is thinner is a sheet
_FLAT_RIM = 0.1  # of the part's thickness: the rim of an opening is flatter, that of a bent sheet is not
_BULGE = 1.1  # of the area of a disc with the length of all rims: a sheet that only bends has at most that area
_LEAST = 3  # triangles that have something between them


def openings_in_words(wall: TriangleWall) -> str:
    """Where a part of the wall is open that should be closed; empty where there is none.

    A part should be closed if it would be a solid with flat lids (the rim of each opening is flat, and the part itself
    is not), or if it has more area than a disc with the length of its rims. A sheet, also a bent one, has a rim that is
    about as thick as itself, and by the isoperimetric inequality no more area than that disc. A tube or a hopper cannot
    be told from a solid whose lids were lost.
    """
    free = wall.free_edges
    if not len(free):
        return ""
    part = _labels(len(wall.vertices), wall.triangles[:, [0, 1, 1, 2]].reshape(-1, 2))
    rim = _labels(len(wall.vertices), free)
    triangles_of = np.bincount(part[wall.triangles[:, 0]])
    a, b, c = np.moveaxis(wall.vertices[wall.triangles], 1, 0)
    area = np.bincount(part[wall.triangles[:, 0]], 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    edges: list[np.ndarray] = []
    for one in np.unique(part[free[:, 0]]):
        if triangles_of[one] < _LEAST:
            continue
        mine, vertices = free[part[free[:, 0]] == one], wall.vertices[part == one]
        thickness = _thickness(vertices)
        if thickness < _SHEET * float(np.ptp(vertices, axis=0).max()):
            continue
        length = float(np.linalg.norm(np.diff(wall.vertices[mine], axis=1), axis=2).sum())
        bulges = area[one] > _BULGE * length**2 / (4.0 * np.pi)
        ends = np.unique(mine)
        rims = [wall.vertices[ends[rim[ends] == number]] for number in np.unique(rim[ends])]
        if bulges or max(map(_thickness, rims)) < _FLAT_RIM * thickness:
            edges.append(mine)
    if not edges:
        return ""
    x, y, z = 1e3 * wall.vertices[edges[0][0]].mean(axis=0)
    return (
        f"is open: {sum(map(len, edges))} edges belong to one triangle only, the first near ({x:.4g}, {y:.4g}, "
        f"{z:.4g}) mm, and grains can pass there; if the part is solid, close it in the program that drew it and "
        "export it again (a tube or a hopper may be open)"
    )


def _labels(count: int, edges: np.ndarray) -> np.ndarray:
    """Number of the connected piece of each of `count` vertices."""
    from scipy.sparse import coo_array  # local, as in `TriangleWall`
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return connected_components(links, directed=False)[1]


def _thickness(points: np.ndarray) -> float:
    """Extent [m] of points (n, 3) across the plane that they lie nearest to."""
    centred = points - points.mean(axis=0)
    across = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    return float(np.ptp(centred @ across))
