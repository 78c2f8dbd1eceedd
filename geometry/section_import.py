"""A finished mesh of a section from gmsh (.msh): its physical surfaces are the regions, its physical curves boundaries.

x is the radius and y the axis.  The mesh has its air with it; where it does not name `axis` and `outer`, they are
found: the outline on r = 0, and the rest of the outline.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_import import CadError
from geometry.file_content import content_fault, lone_copy
from geometry.meshing import gmsh_model
from geometry.section import SectionMesh

_ON_AXIS = 1e-9  # of the mesh's size


def read_section_mesh(path: str | Path, *, scale: float = 1.0) -> SectionMesh:
    """Read a mesh of straight triangles.

    Parameters
    ----------
    path : str or Path
        A .msh file of gmsh, of any format that gmsh reads.
    scale : float
        Metres per unit of the file; meshes written here are in metres.

    Raises
    ------
    CadError
        A missing or unreadable file, one that is no mesh of gmsh, triangles without a name or beyond the axis.
    """
    path = Path(path)
    if not path.is_file():
        raise CadError(f"{path} does not exist; check the path")
    if fault := content_fault(path):
        raise CadError(f"{path} {fault}")
    with lone_copy(path) as copy, gmsh_model({"General.Terminal": 0}) as gmsh:
        try:
            gmsh.merge(str(copy))
        except Exception as error:  # gmsh raises plain Exception, with its own last message
            raise CadError(f"{path} cannot be read ({error}); write it anew from gmsh as .msh") from None
        regions = _blocks(gmsh, 2, 2, 3)
        curves = _blocks(gmsh, 1, 1, 2)
        total = len(gmsh.model.mesh.getElementsByType(2)[0])
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
    if total == 0:
        raise CadError(f"{path} holds no triangles; mesh the section by triangles of first order")
    named = sum(map(len, regions.values()))
    if named != total:
        raise CadError(
            f"{path}: {total - named} of {total} triangles have no name, or more than one; put every surface into one "
            f"physical group; found: {', '.join(regions) or 'no group'}"
        )
    position = np.empty((int(tags.max()) + 1, 2))
    position[tags] = scale * coordinates.reshape(-1, 3)[:, :2]
    corners = np.concatenate(list(regions.values()))
    used = np.unique(corners)
    points, triangles = position[used], np.searchsorted(used, corners)
    size = float(np.ptp(points, axis=0).max())
    if points[:, 0].min() < -_ON_AXIS * size:
        raise CadError(f"{path}: nodes reach to r = {points[:, 0].min():.4g} m, beyond the axis; x is the radius")
    points[np.abs(points[:, 0]) < _ON_AXIS * size, 0] = 0.0
    a, b, c = (points[triangles[:, i]] for i in range(3))
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[clockwise, 1:] = triangles[clockwise, :0:-1]
    ends = np.cumsum([len(block) for block in regions.values()])
    numbered = {
        name: np.arange(end - len(block), end) for (name, block), end in zip(regions.items(), ends, strict=True)
    }
    boundaries = {name: np.searchsorted(used, edges).astype(np.int64) for name, edges in curves.items()}
    outline = _outline(triangles)
    on_axis = np.all(points[outline, 0] == 0.0, axis=1)
    boundaries.setdefault("axis", outline[on_axis])
    boundaries.setdefault("outer", outline[~on_axis])
    return SectionMesh(np.ascontiguousarray(points), triangles.astype(np.int64), numbered, boundaries)


def _blocks(gmsh: Any, dim: int, kind: int, width: int) -> dict[str, np.ndarray]:
    """Nodes of the elements of each named group, shape (k, width)."""
    blocks = {}
    for _, group in gmsh.model.getPhysicalGroups(dim):
        name = gmsh.model.getPhysicalName(dim, group)
        entities = gmsh.model.getEntitiesForPhysicalGroup(dim, group)
        nodes = [gmsh.model.mesh.getElementsByType(kind, entity)[1].reshape(-1, width) for entity in entities]
        if name and nodes and sum(map(len, nodes)):
            blocks[name] = np.concatenate(nodes).astype(np.int64)
    return dict(sorted(blocks.items()))


def _outline(triangles: np.ndarray) -> np.ndarray:
    """Edges that belong to one triangle only, shape (k, 2)."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    return unique[uses == 1].astype(np.int64)
