"""A device from a finished mesh of its half section: the mesh as it is, and what grains see of it.

x is the radius and y (or z, where the mesh lies in the plane y = 0) the axis. Regions are the names that a file gives
its triangles: gmsh's physical groups, cell sets, or a column of tags, of which tag 3 is the name ``tag3``. The mesh has
its air with it; where it does not name `axis` and `outer`, they are determined: the outline on r = 0, and the rest of
it. gmsh's own .msh is read by gmsh, VTK's formats by VTK, all others by meshio.

The powder's outline are the edges between its triangles and all others; edges of one line with one region behind are
joined, so that the mesher's subdivision leaves no trace. The gap is the smallest distance of two pieces of it that face
each other across powder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geometry.cad_meshing import CadSection, OutlineEdge
from geometry.cad_parts import CadFile, CadPart
from geometry.file_content import CadError, check_file, lone_copy
from geometry.mesh_file import read_mesh
from geometry.mesher import gmsh_model, region_ranges
from geometry.section import SectionMesh

GMSH = ".msh"
MESH_SUFFIXES = (GMSH, ".vtu", ".vtk", ".inp", ".mesh", ".med")
"""Endings of the meshes that are read: gmsh, VTK, Abaqus, Medit, Salome."""

# Cell data that hold regions by their usual names, where a file has several columns of whole numbers.
_TAGS = ("gmsh:physical", "medit:ref", "cell_tags", "region", "regions", "material", "MaterialIds")
_ONE_ORDER = "mesh the section by triangles of first order"
_READ = (1, 2, 15)  # gmsh's numbers of straight lines, triangles and points
_ON_AXIS = 1e-9  # of the mesh's size
_FLAT = 1e-6  # of the mesh's size
# Of the device's size: numbers in a file of single precision, or of seven digits, are rounded to 1e-7.
_ROUNDED = 1e-6
_OPPOSED = -0.85  # cosine of the angle between two normals, from which on two edges face each other

_Content = tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]
"""Nodes (n, 3) in the file's unit, corners of triangles (m, 3), their labels (m,), and the nodes of named edges."""


def meshed_section(path: str | Path, *, powder: str = "powder", **options: Any) -> tuple[SectionMesh, CadSection]:
    """Read a mesh with its air, and the section that it is of.

    Parameters
    ----------
    path, **options
        As `read_section_mesh` takes them.
    powder : str
        Region of the grains.

    Raises
    ------
    CadError
        As `read_section_mesh`; a mesh whose outline is not one line around air.
    """
    mesh, parts = read_section_mesh(path, **options)
    _check_outline(path, mesh)
    edges, behind = _directed_outline(mesh, powder)
    pieces = _join(mesh.points, edges, behind, _ROUNDED * max(part.upper[0] for part in parts))
    return mesh, CadSection(tuple(parts), tuple(pieces), _gap(pieces))


def read_section_mesh(path: str | Path, **options: Any) -> tuple[SectionMesh, list[CadPart]]:
    """Read a mesh of straight triangles, and what each of its names was taken for; the air is no part.

    Parameters
    ----------
    path : str or Path
        Its ending is one of `MESH_SUFFIXES`.
    **options
        Those of a `CadFile`; `scale` is metres per unit of the file, and meshes written here are in metres.

    Raises
    ------
    CadError
        A missing or unreadable file, one that is no mesh, triangles without a name or beyond the axis, regions that are
        missing or mean nothing.
    """
    file = CadFile(Path(path), **options)
    nodes, triangles, labels, edges = _read(file)
    regions = {label: file.region_of(label) for label in sorted(set(labels))}
    owner = np.array([regions[label] for label in labels])
    order = np.lexsort((labels.astype(str), owner))
    triangles, labels, owner = triangles[order], labels[order], owner[order]
    used, corners = np.unique(triangles, return_inverse=True)
    points = _plane(file.path, file.scale * nodes[used])
    triangles = corners.reshape(-1, 3).astype(np.int64)
    area = _area(points[triangles])
    if np.any(area == 0.0):
        raise CadError(f"{path}: {np.count_nonzero(area == 0.0)} triangle(s) have no area; mesh it again")
    triangles[area < 0.0, 1:] = triangles[area < 0.0, :0:-1]
    parts = [_part(label, region, points[triangles[labels == label]]) for label, region in regions.items()]
    file.check_parts(parts)
    solid = [part for part in parts if part.region != "air"]
    if solid:
        sides = np.max([part.upper for part in solid], axis=0) - np.min([part.lower for part in solid], axis=0)
        file.check_size(float(sides.max()), "say the file's own by `unit`, or give `scale` = {factor}")
    boundaries = {name: np.searchsorted(used, pairs).astype(np.int64) for name, pairs in edges.items()}
    outline = _outline(triangles)
    on_axis = np.all(points[outline, 0] == 0.0, axis=1)
    boundaries.setdefault("axis", outline[on_axis])
    boundaries.setdefault("outer", outline[~on_axis])
    counts = {str(name): int(count) for name, count in zip(*np.unique(owner, return_counts=True), strict=True)}
    return SectionMesh(points, triangles, region_ranges(counts), boundaries), solid


def _read(file: CadFile) -> _Content:
    """Read the triangles of a file with their labels."""
    path = file.path
    check_file(path, "mesh", MESH_SUFFIXES, file.scale)
    nodes, triangles, labels, edges = _read_by_gmsh(path) if path.suffix.lower() == GMSH else _read_by_meshio(file)
    if len(triangles) == 0:
        raise CadError(f"{path} holds no triangles; {_ONE_ORDER}")
    if unnamed := np.count_nonzero(labels == ""):
        named = ", ".join(sorted(set(labels) - {""})) or "no group"
        raise CadError(
            f"{path}: {unnamed} triangle(s) have no name, or more than one; put every surface into one physical "
            f"group or cell set; found: {named}"
        )
    return nodes, triangles, labels, edges


def _read_by_gmsh(path: Path) -> _Content:
    with lone_copy(path) as copy, gmsh_model({"General.Terminal": 0}) as gmsh:
        try:
            gmsh.merge(str(copy))
        except Exception as error:  # gmsh raises plain Exception, with its own last message
            raise CadError(f"{path} cannot be read ({error}); write it again from gmsh as .msh") from None
        others = [kind for kind in gmsh.model.mesh.getElementTypes() if kind not in _READ]
        if others:
            kinds = ", ".join(gmsh.model.mesh.getElementProperties(kind)[0] for kind in others)
            raise CadError(f"{path} holds cells of the kind {kinds}; {_ONE_ORDER}")
        triangles = _by_entity(gmsh, 2)
        labels = [name for name, corners in triangles for _ in corners]
        edges: dict[str, np.ndarray] = {}
        for name, corners in _by_entity(gmsh, 1):
            edges[name] = np.concatenate((edges[name], corners)) if name in edges else corners
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points = np.full((int(tags.max(initial=0)) + 1, 3), np.nan)
    points[tags] = coordinates.reshape(-1, 3)
    corners = np.concatenate([np.zeros((0, 3), dtype=np.int64), *(corners for _, corners in triangles)])
    return points, corners, np.array(labels, dtype=object), {name: edges[name] for name in sorted(edges)}


def _by_entity(gmsh: Any, dim: int) -> list[tuple[str, np.ndarray]]:
    """Return names and the nodes of their elements: a curve once for each of its physical groups, a surface once.

    A surface has the name of its one group, "" for none or several.
    """
    named = []
    for _, tag in gmsh.model.getEntities(dim):
        groups = gmsh.model.getPhysicalGroupsForEntity(dim, tag)
        names = [gmsh.model.getPhysicalName(dim, group) or f"tag{group}" for group in groups]
        if dim == 2 and len(names) != 1:
            names = [""]
        nodes = gmsh.model.mesh.getElementsByType(dim, tag)[1]  # types 1 and 2: straight lines and triangles
        if len(nodes):
            named += [(name, nodes.reshape(-1, dim + 1).astype(np.int64)) for name in names]
    return named


def _read_by_meshio(file: CadFile) -> _Content:
    path = file.path
    if path.suffix.lower() == ".inp":  # Abaqus: another file, which nobody has looked at and no run would know of
        with open(path, "rb") as stream:
            if any(line.lstrip().lower().startswith(b"*include") for line in stream):
                raise CadError(f"{path} reads another file (*INCLUDE); write the mesh into one file")
    mesh = read_mesh(path)
    kinds = sorted({block.type for block in mesh.cells} - {"vertex", "line", "triangle"})
    if kinds:
        raise CadError(f"{path} holds cells of the kind {', '.join(kinds)}; {_ONE_ORDER}")
    flat = [number for number, block in enumerate(mesh.cells) if block.type == "triangle"]
    triangles = np.concatenate([np.zeros((0, 3), dtype=np.int64), *(mesh.cells[number].data for number in flat)])
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
    labels = _labels_of_sets(mesh, flat, lambda name: file.expects(file.region_of(name)))
    if labels is None and len(triangles):
        labels = _labels_of_tags(path, mesh, flat)
    return points, triangles.astype(np.int64), np.zeros(0, dtype=object) if labels is None else labels, {}


def _labels_of_sets(mesh: Any, flat: list[int], is_meant: Callable[[str], bool]) -> np.ndarray | None:
    """Label of each triangle by the file's sets of cells, "" for none or several; None where there are no sets.

    Where any set is meant, the others are not looked at: a file may have sets that overlap, such as one of all cells.
    """
    start = np.cumsum([0, *(len(mesh.cells[number].data) for number in flat)])
    members: dict[str, np.ndarray] = {}
    for name, by_block in mesh.cell_sets.items():
        # Abaqus: a set that was closed before the last block has no entry for it, or another set in its place
        entries = [(k, np.asarray(by_block[number])) for k, number in enumerate(flat) if number < len(by_block)]
        mine = [start[k] + entry.astype(np.int64).ravel() for k, entry in entries if entry.dtype.kind in "iuf"]
        if sum(map(len, mine)):
            members[name] = np.concatenate(mine)
    if not members:
        return None
    uses = np.zeros(start[-1], dtype=np.int64)
    labels = np.full(start[-1], "", dtype=object)
    for name, cells in ({name: cells for name, cells in members.items() if is_meant(name)} or members).items():
        uses[cells] += 1
        labels[cells] = name
    labels[uses > 1] = ""
    return labels


def _labels_of_tags(path: Path, mesh: Any, flat: list[int]) -> np.ndarray:
    """Label of each triangle by the file's one column of whole numbers, and the names that it gives them."""
    columns: dict[str, np.ndarray] = {}
    for name, by_block in mesh.cell_data.items():
        values = np.concatenate([np.asarray(by_block[number]) for number in flat])
        if values.ndim == 1 and values.dtype.kind in "iuf" and np.array_equal(values, np.round(values)):
            columns[name] = values.astype(np.int64)
    chosen = [name for name in _TAGS if name in columns][:1] or list(columns)
    if len(chosen) != 1:
        there = ", ".join(sorted(mesh.cell_data)) or "none"
        raise CadError(
            f"{path} does not say which region a triangle is of: it has no named cell sets, and "
            f"{'several columns' if chosen else 'no column'} of whole numbers by cell (cell data: {there}); write "
            f"one, best named 'region'"
        )
    # Salome's lists of names by tag
    names = {int(tag): "/".join(steps) for tag, steps in getattr(mesh, "cell_tags", {}).items()}
    return np.array([names.get(int(tag), f"tag{tag}") for tag in columns[chosen[0]]], dtype=object)


def _plane(path: Path, points: np.ndarray) -> np.ndarray:
    """Points (x, y, z) [m] as (r, z), shape (n, 2), those on the axis with r = 0 exactly."""
    if not np.isfinite(points).all():
        raise CadError(f"{path} holds coordinates that are not finite; export it again")
    size = float(np.ptp(points, axis=0).max())
    y, z = (float(np.abs(points[:, k]).max()) for k in (1, 2))
    if min(y, z) > _FLAT * size:
        raise CadError(
            f"{path} lies neither in the plane y = 0 nor in z = 0 (y to {1e3 * y:.4g} mm, z to {1e3 * z:.4g} mm); mesh "
            "the half section there, x as the radius"
        )
    points = np.ascontiguousarray(points[:, [0, 2] if y <= _FLAT * size < z else [0, 1]])
    points[np.abs(points[:, 0]) < _ON_AXIS * size, 0] = 0.0
    return points


def _area(corners: np.ndarray) -> np.ndarray:
    """Signed area [m^2] of triangles, corners (k, 3, 2)."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _part(label: str, region: str, corners: np.ndarray) -> CadPart:
    area = _area(corners)
    radius = float((area * corners[:, :, 0].mean(axis=1)).sum() / area.sum())
    lower, upper = corners.min(axis=(0, 1)).tolist(), corners.max(axis=(0, 1)).tolist()
    return CadPart(label, region, float(area.sum()), tuple(lower), tuple(upper), radius)


def _outline(triangles: np.ndarray) -> np.ndarray:
    """Edges that belong to one triangle only, shape (k, 2)."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    return unique[uses == 1].astype(np.int64)


def _check_outline(path: str | Path, mesh: SectionMesh) -> None:
    """Refuse a mesh whose outline is not one line around air: cracks between parts, holes, no air around the device."""
    outer = _outline(mesh.triangles)
    outer = outer[~np.all(mesh.points[outer, 0] == 0.0, axis=1)]
    nodes, at = np.unique(outer, return_inverse=True)
    links = coo_array((np.ones(len(outer)), tuple(at.reshape(-1, 2).T)), shape=(nodes.size, nodes.size))
    n, line = connected_components(links, directed=False)
    if n > 1:
        reach = [float(np.hypot(*mesh.points[nodes[line == k]].T).max()) for k in range(n)]
        r, z = mesh.points[nodes[line == int(np.argmin(reach))]].mean(axis=0)
        raise CadError(
            f"{path}: the mesh has a hole or a crack near r = {1e3 * r:.4g} mm, z = {1e3 * z:.4g} mm; mesh every part "
            "and the air between them, neighbours sharing their nodes (merge double nodes before the export)"
        )
    air = np.isin(outer, mesh.triangles[mesh.regions.get("air", [])])
    if not air.all():
        r, z = mesh.points[outer[~air.all(axis=1)][0]].mean(axis=0)
        raise CadError(
            f"{path}: no air at the outline of the mesh near r = {1e3 * r:.4g} mm, z = {1e3 * z:.4g} mm; mesh the air "
            "around the whole device as well, named air, out to about three times its size"
        )


def _directed_outline(mesh: SectionMesh, powder: str) -> tuple[np.ndarray, list[str]]:
    """Edges (k, 2) of the powder's outline with the powder on their left, without the axis, and what is behind."""
    pairs = mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = np.repeat(mesh.region_of_element(), 3)
    opposite = {(int(a), int(b)): str(name) for (a, b), name in zip(pairs, owner, strict=True) if name != powder}
    named = [(edge, opposite.get((int(edge[1]), int(edge[0])))) for edge in pairs[owner == powder]]
    kept = [(edge, name) for edge, name in named if name is not None]
    return np.array([edge for edge, _ in kept], dtype=np.int64).reshape(-1, 2), [name for _, name in kept]


def _join(points: np.ndarray, edges: np.ndarray, behind: Sequence[str], tolerance: float) -> list[OutlineEdge]:
    """Join edges into straight pieces with one region behind, their ends rounded alike; `tolerance` [m]."""
    if len(edges) == 0:
        return []
    before, after = ({int(edge[side]): k for k, edge in enumerate(edges)} for side in (1, 0))
    meets = np.bincount(edges.ravel())

    def are_straight(first: int, one: int, other: int) -> bool:
        """True if `other`, beginning where `one` ends, continues along the line from the start of `first`."""
        a, b, c = points[edges[first, 0]], points[edges[one, 1]], points[edges[other, 1]]
        u, v = b - a, c - b
        is_line = u @ v > 0.0 and abs(u[0] * v[1] - u[1] * v[0]) < tolerance * np.hypot(*u)
        return is_line and meets[edges[one, 1]] == 2 and behind[one] == behind[other]

    previous = [before.get(int(a)) for a, _ in edges]
    begins = [k for k, one in enumerate(previous) if one is None or not are_straight(one, one, k)]
    pieces, left = [], set(range(len(edges)))
    for begin in [*begins, *range(len(edges))]:  # a loop without a corner begins anywhere
        if begin not in left:
            continue
        first = last = begin
        left.remove(last)
        while (following := after.get(int(edges[last, 1]))) in left and are_straight(last, last, following):
            if not are_straight(first, last, following):  # an arc of many short edges bends away from its chord
                pieces.append((first, last))
                first = following
            last = following
            left.remove(last)
        pieces.append((first, last))
    ends = np.array([(points[edges[k, 0]], points[edges[end, 1]]) for k, end in pieces])
    for axis in range(2):
        ends[..., axis] = _round_alike(ends[..., axis], tolerance)
    return [OutlineEdge(tuple(a), tuple(b), behind[k]) for (a, b), (k, _) in zip(ends.tolist(), pieces, strict=True)]


def _round_alike(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the values, of which those closer than `tolerance` became one."""
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
        fraction = np.clip(np.einsum("ija,ja->ij", arm, along) / (along**2).sum(axis=1), 0.0, 1.0)
        to_nearest = start + fraction[..., None] * along - end_of_one[:, None]
        length = np.linalg.norm(to_nearest, axis=2)
        across = np.einsum("ija,ia->ij", to_nearest, normal) > 0.5 * length
        smallest = min(smallest, float(length[opposed & across & (length > 0.0)].min(initial=np.inf)))
    return smallest
