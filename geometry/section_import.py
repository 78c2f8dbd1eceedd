"""A finished mesh of a section: its named triangles are the regions, its named edges boundaries.

x is the radius and y (or z, where the mesh lies in the plane y = 0) the axis.  The mesh has its air with it; where it
does not name `axis` and `outer`, they are found: the outline on r = 0, and the rest of the outline.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geometry.cad_parts import CadError, CadPart, check_names, check_side, check_size, region_of
from geometry.mesh_blocks import MeshBlocks, read_blocks
from geometry.section import SectionMesh

_ON_AXIS = 1e-9  # of the mesh's size
_FLAT = 1e-6  # of the mesh's size


def read_section_mesh(
    path: str | Path,
    *,
    names: Mapping[str, str] | None = None,
    needed: Sequence[str] = (),
    known: Sequence[str] | None = None,
    scale: float = 1.0,
) -> SectionMesh:
    """Read a mesh of straight triangles.

    Parameters
    ----------
    path : str or Path
        A file that `geometry.mesh_blocks` reads.
    names, needed, known
        As `geometry.cad_import.imported_section` takes them.
    scale : float
        Metres per unit of the file; meshes written here are in metres.

    Raises
    ------
    CadError
        A missing or unreadable file, one that is no mesh, triangles without a name or beyond the axis, regions that are
        missing or mean nothing.
    """
    return read_device_mesh(path, names=names, needed=needed, known=known, scale=scale)[0]


def read_device_mesh(
    path: str | Path,
    *,
    names: Mapping[str, str] | None = None,
    needed: Sequence[str] = (),
    known: Sequence[str] | None = None,
    scale: float = 1.0,
) -> tuple[SectionMesh, list[CadPart]]:
    """Read a mesh as `read_section_mesh` does, with what each of its names was taken for; the air is no part."""
    path, names, expected = Path(path), names or {}, [*needed, *(known or ())]
    blocks = read_blocks(path, lambda name: region_of(name, names, expected) in expected)
    if blocks.unnamed:
        raise CadError(
            f"{path}: {blocks.unnamed} triangle(s) have no name, or more than one; put every surface into one physical "
            f"group or cell set; found: {', '.join(blocks.triangles) or 'no group'}"
        )
    regions = {label: region_of(label, names, expected) for label in blocks.triangles}
    points, corners, used = _plane(path, blocks, scale)
    parts = [
        _part(label, regions[label], points[triangles])
        for label, triangles in zip(blocks.triangles, corners, strict=True)
    ]
    solid = [part for part in parts if part.region != "air"]
    check_names(path, parts, needed, known)
    check_side(path, parts)
    _check_extent(path, solid)
    order = sorted(range(len(parts)), key=lambda k: parts[k].region)
    triangles = np.concatenate([corners[k] for k in order])
    counts: dict[str, int] = {}
    for k in order:
        counts[parts[k].region] = counts.get(parts[k].region, 0) + len(corners[k])
    ends = np.cumsum(list(counts.values()))
    numbered = {name: np.arange(end - n, end) for (name, n), end in zip(counts.items(), ends, strict=True)}
    boundaries = {name: np.searchsorted(used, edges).astype(np.int64) for name, edges in blocks.edges.items()}
    outline = outline_edges(triangles)
    on_axis = np.all(points[outline, 0] == 0.0, axis=1)
    boundaries.setdefault("axis", outline[on_axis])
    boundaries.setdefault("outer", outline[~on_axis])
    return SectionMesh(points, triangles, numbered, boundaries), solid


def check_outline(path: str | Path, mesh: SectionMesh) -> None:
    """Refuse a mesh whose outline is not one line around air: cracks between parts, holes, no air around the device.

    Raises
    ------
    CadError
    """
    outer = outline_edges(mesh.triangles)
    outer = outer[~np.all(mesh.points[outer, 0] == 0.0, axis=1)]
    nodes, at = np.unique(outer, return_inverse=True)
    at = at.reshape(outer.shape)
    n, line = connected_components(
        coo_array((np.ones(len(at)), (at[:, 0], at[:, 1])), shape=(nodes.size, nodes.size)), directed=False
    )
    if n > 1:
        reach = [float(np.hypot(*mesh.points[nodes[line == k]].T).max()) for k in range(n)]
        r, z = mesh.points[nodes[line == int(np.argmin(reach))]].mean(axis=0)
        raise CadError(
            f"{path}: the mesh has a hole or a crack near r = {1e3 * r:.4g} mm, z = {1e3 * z:.4g} mm; mesh every part "
            "and the air between them, neighbours sharing their nodes (merge double nodes before the export)"
        )
    air = np.zeros(len(mesh.points), dtype=bool)
    air[mesh.triangles[mesh.regions.get("air", np.zeros(0, dtype=np.int64))]] = True
    if not air[outer].all():
        r, z = mesh.points[outer[~air[outer].all(axis=1)][0]].mean(axis=0)
        raise CadError(
            f"{path}: no air at the outline of the mesh near r = {1e3 * r:.4g} mm, z = {1e3 * z:.4g} mm; mesh the air "
            "around the whole device as well, named air, out to about three times its size"
        )


def outline_edges(triangles: np.ndarray) -> np.ndarray:
    """Edges that belong to one triangle only, shape (k, 2)."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    return unique[uses == 1].astype(np.int64)


def _plane(path: Path, blocks: MeshBlocks, scale: float) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Nodes in use (r, z) [m], the triangles of each label by them, and the file's numbers of those nodes."""
    flat = np.concatenate(list(blocks.triangles.values()))
    used = np.unique(flat)
    points = scale * blocks.points[used]
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
    corners = []
    for block in blocks.triangles.values():
        triangles = np.searchsorted(used, block).astype(np.int64)
        area = _area(points[triangles])
        if np.any(area == 0.0):
            raise CadError(f"{path}: {np.count_nonzero(area == 0.0)} triangle(s) have no area; mesh it again")
        triangles[area < 0.0, 1:] = triangles[area < 0.0, :0:-1]
        corners.append(triangles)
    return points, corners, used


def _area(corners: np.ndarray) -> np.ndarray:
    """Signed area [m^2] of triangles, corners (k, 3, 2)."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _part(label: str, region: str, corners: np.ndarray) -> CadPart:
    area = _area(corners)
    (r0, z0), (r1, z1) = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    radius = float((area * corners[:, :, 0].mean(axis=1)).sum() / area.sum())
    return CadPart(label, region, float(area.sum()), radius, float(r0), float(r1), float(z0), float(z1))


def _check_extent(path: Path, parts: Sequence[CadPart]) -> None:
    if parts:
        sides = (
            max(part.r1 for part in parts) - min(part.r0 for part in parts),
            max(part.z1 for part in parts) - min(part.z0 for part in parts),
        )
        check_size(path, max(sides), "say the file's own by `unit`, or give `scale` = {factor}")
