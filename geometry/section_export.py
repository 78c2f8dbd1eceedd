"""Writes the mesh of a section as .msh of gmsh, with regions and boundaries as physical groups."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.section import SectionMesh


def write_section_mesh(mesh: SectionMesh, path: str | Path) -> None:
    """Write a mesh (format 2.2, coordinates in metres) that `geometry.section_import.read_section_mesh` reads back.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    import meshio

    groups = [("line", 1, mesh.boundaries), ("triangle", 2, {n: mesh.triangles[i] for n, i in mesh.regions.items()})]
    cells: list[tuple[str, np.ndarray]] = []
    tags: list[np.ndarray] = []
    names: dict[str, np.ndarray] = {}
    for kind, dim, blocks in groups:
        for tag, (name, block) in enumerate(blocks.items(), 1):
            cells.append((kind, block))
            tags.append(np.full(len(block), tag))
            names[name] = np.array([tag, dim])
    points = np.column_stack((mesh.points, np.zeros(len(mesh.points))))
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    meshio.Mesh(points, cells, cell_data=data, field_data=names).write(path, file_format="gmsh22", binary=False)
