"""Triangles of a mesh file by the names that it gives them: gmsh's physical groups, cell sets, or a table of tags.

gmsh's own .msh is read by gmsh, the others by meshio. Where a file has no names but one number a cell, the label of a
cell is ``tag`` and its number, ``tag3``: the caller translates it as any other name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad_parts import CadError
from geometry.file_content import content_fault, lone_copy, size_fault
from geometry.mesher import gmsh_model

GMSH = ".msh"
MESH_SUFFIXES = (GMSH, ".vtu", ".vtk", ".inp", ".mesh", ".med")
"""Endings of the meshes that are read: gmsh, VTK, Abaqus, Medit, Salome."""

# Cell data that hold regions by their usual names, where a file has several columns of whole numbers.
_TAGS = ("gmsh:physical", "medit:ref", "cell_tags", "region", "regions", "material", "MaterialIds")
_ONE_ORDER = "mesh the section by triangles of first order"


@dataclass(frozen=True, slots=True)
class MeshBlocks:
    """Content of a mesh file.

    Attributes
    ----------
    points : ndarray (n, 3)
        In the file's unit.
    triangles, edges : dict of str to ndarray (k, 3), (k, 2)
        Nodes of the elements by their labels.
    unnamed : int
        Triangles without a label, or with more than one.
    """

    points: np.ndarray
    triangles: dict[str, np.ndarray]
    edges: dict[str, np.ndarray]
    unnamed: int


def read_blocks(path: Path, is_meant: Callable[[str], bool] = lambda name: False) -> MeshBlocks:
    """Read a mesh of straight triangles.

    Parameters
    ----------
    path : Path
        Its ending is one of `MESH_SUFFIXES`.
    is_meant : callable
        Whether a name is one that the caller looks for. Where any set of cells is, the others are not looked at: a file
        may have sets that overlap, such as one of all cells.

    Raises
    ------
    CadError
        A file that is missing, cannot be read, or holds no triangles of first order.
    """
    if not path.is_file():
        raise CadError(f"{path} does not exist; check the path, which in a scene is relative to its folder")
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise CadError(f"{path} is no mesh that is read here; give one of {', '.join(MESH_SUFFIXES)}")
    if fault := content_fault(path) if path.suffix.lower() == GMSH else size_fault(path):
        raise CadError(f"{path} {fault}")
    blocks = _of_gmsh(path) if path.suffix.lower() == GMSH else _of_meshio(path, is_meant)
    if not blocks.triangles and blocks.unnamed == 0:
        raise CadError(f"{path} holds no triangles; {_ONE_ORDER}")
    return blocks


def _of_gmsh(path: Path) -> MeshBlocks:
    with lone_copy(path) as copy, gmsh_model({"General.Terminal": 0}) as gmsh:
        try:
            gmsh.merge(str(copy))
        except Exception as error:  # gmsh raises plain Exception, with its own last message
            raise CadError(f"{path} cannot be read ({error}); write it again from gmsh as .msh") from None
        triangles, edges = _groups(gmsh, 2, 2, 3), _groups(gmsh, 1, 1, 2)
        total = len(gmsh.model.mesh.getElementsByType(2)[0])
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points = np.full((int(tags.max(initial=0)) + 1, 3), np.nan)
    points[tags] = coordinates.reshape(-1, 3)
    # a triangle in two groups is there twice
    return MeshBlocks(points, triangles, edges, abs(total - sum(map(len, triangles.values()))))


def _groups(gmsh: Any, dim: int, kind: int, width: int) -> dict[str, np.ndarray]:
    """Nodes of the elements of each physical group, shape (k, width)."""
    groups = {}
    for _, group in gmsh.model.getPhysicalGroups(dim):
        name = gmsh.model.getPhysicalName(dim, group) or f"tag{group}"
        entities = gmsh.model.getEntitiesForPhysicalGroup(dim, group)
        nodes = [gmsh.model.mesh.getElementsByType(kind, entity)[1].reshape(-1, width) for entity in entities]
        if nodes and sum(map(len, nodes)):
            groups[name] = np.concatenate(nodes).astype(np.int64)
    return dict(sorted(groups.items()))


def _of_meshio(path: Path, is_meant: Callable[[str], bool]) -> MeshBlocks:
    import meshio

    _refuse_includes(path)
    try:
        mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # each of meshio's readers fails in a way of its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CadError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again") from None
    kinds = sorted({block.type for block in mesh.cells} - {"vertex", "line", "triangle"})
    if kinds:
        raise CadError(f"{path} holds cells of the kind {', '.join(kinds)}; {_ONE_ORDER}")
    flat = [number for number, block in enumerate(mesh.cells) if block.type == "triangle"]
    corners = [np.asarray(mesh.cells[number].data, dtype=np.int64) for number in flat]
    count = sum(map(len, corners))
    if count == 0:
        return MeshBlocks(np.zeros((0, 3)), {}, {}, 0)
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    label = _set_labels(mesh, flat, is_meant)
    if label is None:
        label = _tag_labels(path, mesh, flat)
    triangles = np.concatenate(corners)
    names = sorted(set(label[label != ""]))
    found = {str(name): triangles[label == name] for name in names}
    return MeshBlocks(points, found, {}, int(np.count_nonzero(label == "")))


def _refuse_includes(path: Path) -> None:
    """An Abaqus file that reads another one, which nobody has looked at and no run would know of."""
    if path.suffix.lower() == ".inp":
        with open(path, "rb") as stream:
            if any(line.lstrip().lower().startswith(b"*include") for line in stream):
                raise CadError(f"{path} reads another file (*INCLUDE); write the mesh into one file")


def _set_labels(mesh: Any, flat: list[int], is_meant: Callable[[str], bool]) -> np.ndarray | None:
    """Label of each triangle by the file's sets of cells, "" for none or several; None where there are no sets."""
    start = np.cumsum([0, *(len(mesh.cells[number].data) for number in flat)])
    members: dict[str, np.ndarray] = {}
    for name, by_block in mesh.cell_sets.items():
        # Abaqus: a set that was closed before the last block has no entry for it
        mine = [start[k] + _indices(by_block[number]) for k, number in enumerate(flat) if number < len(by_block)]
        if mine and sum(map(len, mine)):
            members[name] = np.concatenate(mine)
    if not members:
        return None
    meant = {name: cells for name, cells in members.items() if is_meant(name)} or members
    uses = np.zeros(start[-1], dtype=np.int64)
    label = np.full(start[-1], "", dtype=object)
    for name, cells in meant.items():
        uses[cells] += 1
        label[cells] = name
    label[uses > 1] = ""
    return label


def _indices(entry: Any) -> np.ndarray:
    """Cells of one block in a set; none where the file has another set in this place."""
    found = np.asarray([] if entry is None else entry)
    return found.astype(np.int64).ravel() if found.dtype.kind in "iuf" else np.zeros(0, dtype=np.int64)


def _tag_labels(path: Path, mesh: Any, flat: list[int]) -> np.ndarray:
    """Label of each triangle by the file's one column of whole numbers."""
    columns: dict[str, np.ndarray] = {}
    for name, by_block in mesh.cell_data.items():
        values = np.concatenate([np.asarray(by_block[number]) for number in flat])
        if values.ndim == 1 and values.dtype.kind in "iuf" and np.array_equal(values, np.round(values)):
            columns[name] = values.astype(np.int64)
    usual = [name for name in _TAGS if name in columns]
    chosen = usual[:1] or list(columns)
    if len(chosen) != 1:
        there = ", ".join(sorted(mesh.cell_data)) or "none"
        raise CadError(
            f"{path} does not say which region a triangle is of: it has no named cell sets, and "
            f"{'several columns' if chosen else 'no column'} of whole numbers by cell (cell data: {there}); write "
            f"one, best named 'region'"
        )
    tags = columns[chosen[0]]
    names = _names_of_tags(mesh)
    return np.array([names.get(int(tag), f"tag{tag}") for tag in tags], dtype=object)


def _names_of_tags(mesh: Any) -> dict[int, str]:
    """Names that a file gives its tags: (tag, dimension) by name as meshio keeps them, or Salome's lists by tag."""
    salome = {int(tag): "/".join(names) for tag, names in getattr(mesh, "cell_tags", {}).items()}
    pairs = {name: np.ravel(entry) for name, entry in mesh.field_data.items()}
    return salome | {int(pair[0]): name for name, pair in pairs.items() if len(pair) == 2 and int(pair[1]) == 2}
