"""Local refinement of a section's mesh: red-green-blue, without hanging nodes.

A marked triangle has all its edges halved (red: four similar children).  Its neighbours are closed through
their longest edge, always halved if any other is: green with two children, blue with three.  No angle then
falls below a bound that depends on the coarsest mesh alone (Rivara, Int. J. Numer. Methods Eng. 20, 1984;
Carstensen, Constr. Approx. 20, 2004), however often it is repeated.  The children of a triangle cover it
exactly, so functions of the coarse mesh are carried over without loss; at a curved edge, whose new node lies on the
curve, they do so up to the sliver between chord and curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .section import SectionMesh

# Of an element in a cusp: its last chord cuts 16^-3 = 2e-4 of what the first one does off the curve.
_MAX_DIVISIONS = 4

# Children by the case, in terms of nodes 0, 1, 2 (edge 01 the longest) and middles 3 of 01, 4 of 12, 5 of 20.
_CHILDREN = {
    (False, False, False): ((0, 1, 2),),
    (True, False, False): ((0, 3, 2), (3, 1, 2)),
    (True, True, False): ((0, 3, 2), (3, 1, 4), (3, 4, 2)),
    (True, False, True): ((3, 1, 2), (0, 3, 5), (3, 2, 5)),
    (True, True, True): ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}


@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """A refined mesh and where it comes from.

    Attributes
    ----------
    mesh : SectionMesh
        The first points are those of the coarse mesh, in its order.
    parent : ndarray (n_triangles,), int64
        Coarse triangle that each triangle is part of.
    """

    mesh: SectionMesh
    parent: np.ndarray


def refine(mesh: SectionMesh, marked: np.ndarray) -> Refinement:
    """Divide the marked triangles into four, and others so that no hanging node and no tangled element is left.

    Parameters
    ----------
    mesh : SectionMesh
    marked : ndarray (k,), int64
        Indexes of triangles, or a mask of all.

    Raises
    ------
    ValueError
        A marked triangle that the mesh does not have.
    """
    refined = _divided(mesh, _as_mask(mesh, marked))
    untangled = without_tangles(refined.mesh)
    return Refinement(untangled.mesh, refined.parent[untangled.parent])


def without_tangles(mesh: SectionMesh) -> Refinement:
    """Divide triangles whose curved edges bend too much for their corners, until none is left.

    In a cusp, where a curve touches its neighbour as a tangent, all are tangled, however small: after some divisions
    the edge at its tip becomes straight.
    """
    parent = np.arange(len(mesh.triangles))
    for _ in range(_MAX_DIVISIONS):
        tangled = mesh.tangled()
        if tangled.size == 0:
            return Refinement(mesh, parent)
        refined = _divided(mesh, _as_mask(mesh, tangled))
        mesh, parent = refined.mesh, parent[refined.parent]
    while (tangled := mesh.tangled()).size and mesh.curved is not None:
        mesh = replace(mesh, curved=mesh.curved.without(mesh.triangles[tangled]))
    return Refinement(mesh, parent)


def _divided(mesh: SectionMesh, chosen: np.ndarray) -> Refinement:
    """Divide triangles of a mask."""
    triangles = _longest_edge_first(mesh)
    n_points = len(mesh.points)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    keys, edge = np.unique(sides[..., 0] * n_points + sides[..., 1], return_inverse=True)
    edge = edge.reshape(-1, 3)

    halved = np.zeros(keys.size, dtype=bool)
    halved[edge[chosen]] = True
    while np.any(wanting := halved[edge].any(axis=1) & ~halved[edge[:, 0]]):
        halved[edge[wanting, 0]] = True

    middle = np.full(keys.size, -1, dtype=np.int64)
    middle[halved] = n_points + np.arange(np.count_nonzero(halved))
    ends = np.column_stack((keys // n_points, keys % n_points))
    points = np.concatenate((mesh.points, mesh.points[ends[halved]].mean(axis=1)))

    nodes = np.concatenate((triangles, middle[edge]), axis=1)
    children, parents = [], []
    for case, corners in _CHILDREN.items():
        members = np.flatnonzero(np.all(halved[edge] == case, axis=1))
        children.append(nodes[members][:, corners].reshape(-1, 3))
        parents.append(np.repeat(members, len(corners)))
    parent = np.concatenate(parents)
    # siblings stay together and in their parents' order: regions remain runs of neighbouring elements
    order = np.argsort(parent, kind="stable")
    parent = parent[order]

    boundaries = {name: _halve(edges, keys, middle, n_points) for name, edges in mesh.boundaries.items()}
    curved = mesh.curved
    if curved is not None:
        new = _middle_of(curved.nodes, keys, middle, n_points)
        points[new[new >= 0]] = curved.middle()[new >= 0]
        curved = curved.halved(new)
    first = np.searchsorted(parent, np.arange(len(triangles) + 1))
    regions = {name: _expanded(elements, first) for name, elements in mesh.regions.items()}
    return Refinement(SectionMesh(points, np.concatenate(children)[order], regions, boundaries, curved), parent)


def _as_mask(mesh: SectionMesh, marked: np.ndarray) -> np.ndarray:
    marked = np.asarray(marked)
    n = len(mesh.triangles)
    if marked.dtype == bool:
        if marked.shape != (n,):
            raise ValueError(f"`marked` is a mask of shape {marked.shape}; the mesh has {n} triangles")
        return marked
    if marked.size and (marked.min() < 0 or marked.max() >= n):
        raise ValueError(f"`marked` names triangle {marked.max()}; the mesh has {n}, counted from 0")
    mask = np.zeros(n, dtype=bool)
    mask[marked.astype(np.int64)] = True
    return mask


def _longest_edge_first(mesh: SectionMesh) -> np.ndarray:
    """Corners turned, orientation kept, so that the longest edge runs from the first to the second."""
    corners = mesh.points[mesh.triangles]
    length = np.linalg.norm(corners[:, [1, 2, 0]] - corners, axis=2)
    # of edges that are equal to rounding every triangle must choose by the same rule, or closure wanders far
    longest = np.argmax(np.round(length / length.max(axis=1, keepdims=True), 9), axis=1)
    return np.take_along_axis(mesh.triangles, (longest[:, None] + np.arange(3)) % 3, axis=1)


def _halve(edges: np.ndarray, keys: np.ndarray, middle: np.ndarray, n_points: int) -> np.ndarray:
    """Edges of a boundary, the halved ones in two, along it as before."""
    centre = _middle_of(edges, keys, middle, n_points)
    both = np.stack((np.column_stack((edges[:, 0], centre)), np.column_stack((centre, edges[:, 1]))), axis=1)
    both[centre < 0, 0] = edges[centre < 0]
    kept = np.column_stack((np.ones(len(edges), dtype=bool), centre >= 0))
    return both[kept]


def _middle_of(edges: np.ndarray, keys: np.ndarray, middle: np.ndarray, n_points: int) -> np.ndarray:
    """New node of each edge (k,), -1 where it is not halved."""
    ends = np.sort(edges, axis=1)
    return middle[np.searchsorted(keys, ends[:, 0] * n_points + ends[:, 1])]


def _expanded(elements: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Children of elements (k,), ascending: those of element i are first[i] to first[i + 1] - 1."""
    count = first[elements + 1] - first[elements]
    shift = np.repeat(first[elements] - np.concatenate(([0], np.cumsum(count)[:-1])), count)
    return shift + np.arange(count.sum())
