"""A device from a finished mesh of its section: the mesh as it is, and what grains see of it.

The powder's outline are the edges between its triangles and all others; edges of one line with one region behind are
joined, so that the mesher's subdivision leaves no trace.  The gap is the smallest distance of two pieces of it that
face each other across powder.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_meshing import CadSection, OutlineEdge
from geometry.section import SectionMesh
from geometry.section_import import check_outline, read_device_mesh

# Of the device's size: numbers in a file of single precision, or of seven digits, are rounded to 1e-7.
_ROUNDED = 1e-6
_OPPOSED = -0.85  # cosine of the angle between two normals, from which on two edges face each other


def meshed_section(path: str | Path, *, powder: str = "powder", **options: Any) -> tuple[SectionMesh, CadSection]:
    """Read a mesh with its air; options and errors of `geometry.section_import.read_section_mesh`, and open outlines.

    Raises
    ------
    CadError
    """
    mesh, parts = read_device_mesh(path, **options)
    check_outline(path, mesh)
    edges, behind = _directed_outline(mesh, powder)
    pieces = _joined(mesh.points, edges, behind, _ROUNDED * max(part.r1 for part in parts))
    gap = _gap(pieces)
    return mesh, CadSection(tuple(parts), tuple(pieces), gap)


def _directed_outline(mesh: SectionMesh, powder: str) -> tuple[np.ndarray, list[str]]:
    """Edges (k, 2) of the powder's outline with the powder on their left, without the axis, and what is behind."""
    region = mesh.region_of_element()
    pairs = mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = np.repeat(region, 3)
    opposite = {(int(a), int(b)): name for (a, b), name in zip(pairs, owner, strict=True) if name != powder}
    mine = pairs[owner == powder]
    found = [(edge, opposite.get((int(edge[1]), int(edge[0])))) for edge in mine]
    kept = [(edge, str(name)) for edge, name in found if name is not None]
    return np.array([edge for edge, _ in kept], dtype=np.int64).reshape(-1, 2), [name for _, name in kept]


def _joined(points: np.ndarray, edges: np.ndarray, behind: Sequence[str], tolerance: float) -> list[OutlineEdge]:
    """Edges joined into straight pieces with one region behind, ends rounded alike; `tolerance` [m]."""
    if len(edges) == 0:
        return []
    follower = {int(a): k for k, (a, _) in enumerate(edges)}
    meets = np.bincount(edges.ravel())
    before = {int(b): k for k, (_, b) in enumerate(edges)}

    def goes_on(one: int, other: int | None) -> bool:
        if other is None or meets[edges[one, 1]] != 2 or behind[one] != behind[other]:
            return False
        a, b, c = points[edges[one, 0]], points[edges[one, 1]], points[edges[other, 1]]
        return _offset(a, b, c) < tolerance

    begins = [k for k, (a, _) in enumerate(edges) if int(a) not in before or not goes_on(before[int(a)], k)]
    pieces, left = [], set(range(len(edges)))
    while left:
        k = next((k for k in begins if k in left), min(left))  # a loop without a corner begins anywhere
        start = points[edges[k, 0]]
        while True:
            left.discard(k)
            following = follower.get(int(edges[k, 1]))
            if following is None or following not in left or not goes_on(k, following):
                break
            # an arc of many short edges bends away from the chord to its beginning
            if _offset(start, points[edges[k, 1]], points[edges[following, 1]]) >= tolerance:
                pieces.append((start, points[edges[k, 1]], behind[k]))
                start = points[edges[k, 1]]
            k = following
        pieces.append((start, points[edges[k, 1]], behind[k]))
    ends = np.array([(a, b) for a, b, _ in pieces])
    for axis in range(2):
        ends[..., axis] = _rounded_alike(ends[..., axis], tolerance)
    return [
        OutlineEdge((float(a[0]), float(a[1])), (float(b[0]), float(b[1])), name)
        for (a, b), (_, _, name) in zip(ends, pieces, strict=True)
    ]


def _offset(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Distance [m] of c from the line through a and b; infinite where the way turns back."""
    u, v = b - a, c - b
    if u @ v <= 0.0:
        return float("inf")
    return float(abs(u[0] * v[1] - u[1] * v[0]) / np.hypot(*u))


def _rounded_alike(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Values of which those closer than `tolerance` became one."""
    flat, number = np.unique(values, return_inverse=True)
    group = np.cumsum(np.append(False, np.diff(flat) > tolerance))
    mean = np.bincount(group, flat) / np.bincount(group)
    return mean[group][number].reshape(values.shape)


def _gap(pieces: Sequence[OutlineEdge]) -> float:
    """Smallest distance [m] of two pieces that face each other across the powder on their left; inf without any."""
    if not pieces:
        return float("inf")
    start, end = (np.array([getattr(piece, name) for piece in pieces]) for name in ("start", "end"))
    along = end - start
    normal = np.column_stack((-along[:, 1], along[:, 0])) / np.linalg.norm(along, axis=1)[:, None]
    opposed = normal @ normal.T < _OPPOSED
    smallest = float("inf")
    for end_of_one in (start, end):
        arm = end_of_one[:, None] - start
        share = np.clip(np.einsum("ija,ja->ij", arm, along) / (along**2).sum(axis=1), 0.0, 1.0)
        way = start + share[..., None] * along - end_of_one[:, None]
        length = np.linalg.norm(way, axis=2)
        across = np.einsum("ija,ia->ij", way, normal) > 0.5 * length
        seen = opposed & across & (length > 0.0)
        smallest = min(smallest, float(length[seen].min(initial=np.inf)))
    return smallest
