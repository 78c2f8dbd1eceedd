"""From a gmsh model of named volumes to a `Mesh3D`: sizes, second-order nodes, named boundaries.

Lengths in the model are millimetres, as in `geometry.meshing`; a `Mesh3D` is in metres. Element sizes are
formulas of the place: inside a shape a fixed size, outside growing in proportion to the distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from geometry.mesh_3d import EDGES, Mesh3D, second_order_jacobian
from geometry.mesher import GROWTH, MILLIMETRE, region_ranges, use_least_size

SOLID_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,
    "Mesh.Algorithm3D": 10,  # HXT: two to four times faster than Delaunay here, and fewer slivers
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.HighOrderOptimize": 0,
    "Mesh.Optimize": 1,
    "Mesh.ScalingFactor": 1.0,
    "Mesh.MeshSizeFactor": 1.0,
}

# Of gmsh's ten nodes the last two middles are ours exchanged.
_FROM_GMSH = np.array([0, 1, 2, 3, 4, 5, 6, 7, 9, 8])
# The same element with its second and third corner exchanged.
_MIRRORED = np.array([0, 2, 1, 3, 6, 5, 4, 7, 9, 8])
_FACES = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])  # outward normals

SizeFormula = tuple[float, str]
"""Size [m] inside a shape, and the distance to it in millimetres as a formula of x, y, z."""


def box_distance(lower: Sequence[float], upper: Sequence[float]) -> str:
    """Return the distance to the box between two corners [m], a formula in millimetres."""
    parts = (f"{_beyond(axis, a, b)}^2" for axis, a, b in zip("xyz", lower, upper, strict=True))
    return f"Sqrt({'+'.join(parts)})"


def _beyond(coordinate: str, low: float, high: float) -> str:
    low, high = low / MILLIMETRE, high / MILLIMETRE
    return f"Max({low:.12g}-({coordinate}),({coordinate})-({high:.12g}),0)"


def set_sizes(gmsh: Any, formulas: list[SizeFormula], far: float, growth: float = GROWTH) -> None:
    """The least of all sizes, growing with the distance from each shape, and nowhere above ``far`` [m]."""
    field = gmsh.model.mesh.field
    tags = []
    for size, distance in formulas:
        tags.append(field.add("MathEval"))
        field.setString(tags[-1], "F", f"Min({far / MILLIMETRE:.12g},{size / MILLIMETRE:.12g}+{growth:g}*({distance}))")
    use_least_size(gmsh, tags)


def generate(
    gmsh: Any, volumes: Mapping[str, list[int]], order: int
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Mesh the volumes of a model and read them back.

    Returns
    -------
    points : ndarray (n, 3)
        Nodes [m], corners first.
    elements : ndarray (m, 4 or 10)
        Nodes of each element in the order of `Mesh3D`, sorted by region.
    regions : dict of str to ndarray
        Indexes of the elements of each region.
    """
    mesh = gmsh.model.mesh
    mesh.generate(3)
    if order == 2:
        mesh.setOrder(2)
    kind, width = (11, 10) if order == 2 else (4, 4)
    blocks = [
        np.concatenate([mesh.getElementsByType(kind, tag)[1] for tag in tags]).reshape(-1, width)
        for tags in volumes.values()
    ]
    elements = np.concatenate(blocks).astype(np.int64)
    tags, coordinates, _ = mesh.getNodes()
    position = np.empty((int(tags.max()) + 1, 3))
    position[tags] = coordinates.reshape(-1, 3)
    corners = np.unique(elements[:, :4])
    used = np.concatenate((corners, np.setdiff1d(elements, corners)))
    number = np.empty(len(position), dtype=np.int64)
    number[used] = np.arange(used.size)
    points, elements = position[used] * MILLIMETRE, number[elements]
    if order == 2:
        elements = elements[:, _FROM_GMSH]
    counts = {name: len(block) for name, block in zip(volumes, blocks, strict=True)}
    return points, positive(points, elements), region_ranges(counts)


def positive(points: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Exchange two corners of the elements of negative volume."""
    a, b, c, d = (points[elements[:, i]] for i in range(4))
    negative = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    elements = elements.copy()
    elements[negative] = elements[negative][:, _MIRRORED[: elements.shape[1]]]
    return elements


def straighten(points: np.ndarray, elements: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """The nodes with the edges of the listed elements made straight again, shape of ``points``."""
    points = points.copy()
    corners = elements[bad][:, EDGES]
    points[elements[bad, 4:]] = points[corners].mean(axis=2)
    return points


def faces_of(tetrahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every face once, with the elements on its two sides.

    Returns
    -------
    faces : ndarray (k, 3)
        Corners; the normal points out of the first element.
    sides : ndarray (k, 2)
        Elements; the second is -1 on the outline.
    """
    corners = tetrahedra[:, _FACES].reshape(-1, 3)
    ordered = np.sort(corners, axis=1)
    n = int(tetrahedra.max()) + 1
    key = (ordered[:, 0] * n + ordered[:, 1]) * n + ordered[:, 2]
    rank = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.append(True, np.diff(key[rank]) != 0))
    twice = np.zeros(len(first), dtype=bool)
    twice[:-1] = np.diff(first) == 2
    twice[-1] = len(key) - first[-1] == 2
    sides = np.full((len(first), 2), -1, dtype=np.int64)
    sides[:, 0] = rank[first] // 4
    sides[twice, 1] = rank[first[twice] + 1] // 4
    return corners[rank[first]], sides


def faces_where(points: np.ndarray, faces: np.ndarray, test: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The faces whose three corners all pass a test of points (n, 3), shape (k, 3)."""
    used = np.unique(faces)
    passed = np.zeros(len(points), dtype=bool)
    passed[used] = test(points[used])
    return faces[passed[faces].all(axis=1)]


def finish(
    points: np.ndarray,
    elements: np.ndarray,
    regions: dict[str, np.ndarray],
    boundaries: dict[str, np.ndarray],
    *,
    periodic: np.ndarray | None = None,
    sector_angle: float = 2.0 * np.pi,
    n_sectors: int = 1,
) -> Mesh3D:
    """The mesh, with the edges of folded elements straightened.

    A coarse element between two close curved faces can fold when its edges are bent onto one of them.
    """
    second = elements if elements.shape[1] == 10 else None
    keywords: dict[str, Any] = dict(periodic=periodic, sector_angle=sector_angle, n_sectors=n_sectors)
    if second is not None:
        for _ in range(5):
            folded = np.flatnonzero(second_order_jacobian(points[elements]).min(axis=1) <= 0.0)
            if folded.size == 0:
                break
            points = straighten(points, elements, folded)
    return Mesh3D(points, np.ascontiguousarray(elements[:, :4]), second, regions, boundaries, **keywords)
