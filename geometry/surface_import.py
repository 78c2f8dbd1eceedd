"""A triangle wall from a file: STL, OBJ, PLY, VTK or MSH as they are, STEP, IGES or BREP meshed by gmsh.

Meshes carry no unit: their numbers are metres times ``scale``. CAD files are read in millimetres (STEP says its unit,
and is converted), and ``scale`` mends a wrong one.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from geometry.file_content import SHAPE_FORMATS, content_fault, size_fault
from geometry.mesher import MAX_TRIANGLES, MILLIMETRE, gmsh_model
from geometry.triangle_wall import MERGED, TriangleWall, _heights

MESH_SUFFIXES = (".stl", ".obj", ".ply", ".vtk", ".vtu", ".msh")
CAD_SUFFIXES = tuple(SHAPE_FORMATS)
LARGEST = 10.0  # m; the devices meant here measure 5 mm to 5 m, so that a larger wall was drawn in millimetres

_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,
    # 36 sides to a circle: facets that turn by 10 degrees, half of what grains still feel as one surface
    "Mesh.MeshSizeFromCurvature": 36,
    "Mesh.MeshSizeExtendFromBoundary": 1,
    "Mesh.MeshSizeFromPoints": 0,
}


class SurfaceError(ValueError):
    """A file that cannot be taken as a wall; says what was found in it and what to do."""


def triangle_wall_from_file(
    path: str | Path,
    name: str,
    body: str,
    *,
    scale: float = 1.0,
    size: float | None = None,
    magnetic: bool = False,
) -> TriangleWall:
    """The surface in a file as a wall.

    Parameters
    ----------
    path : str or Path
        Its ending says its kind: `MESH_SUFFIXES` or `CAD_SUFFIXES`. Quadrilaterals are halved; solid elements, lines
        and triangles without area are left out.
    name, body : str
        Of the wall.
    scale : float
        Factor on all lengths.
    size : float, optional
        Largest side of a triangle on the faces of a CAD file [m]; None: as coarse as its curved faces allow at 36 sides
        to a circle.

    Raises
    ------
    SurfaceError
        For a file that is missing or cannot be read, an unknown ending, no triangles, a wall larger than 10 m.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES + CAD_SUFFIXES:
        raise SurfaceError(
            f"{path} ends in {suffix or 'nothing'!r}; read are {', '.join(MESH_SUFFIXES)} and {', '.join(CAD_SUFFIXES)}"
        )
    if not path.is_file():
        raise SurfaceError(f"{path} does not exist; check the path, which in a scene is relative to its folder")
    if not (math.isfinite(scale) and scale > 0.0):
        raise SurfaceError(f"`scale` = {scale}: allowed is a factor above 0, e.g. 0.001 for a mesh in millimetres")
    if size is not None and not (math.isfinite(size) and size > 0.0):
        raise SurfaceError(f"`size` = {size}: allowed is a length above 0 m")
    is_mesh = suffix in MESH_SUFFIXES
    if is_mesh and size is not None:
        raise SurfaceError(f"`size` is for CAD files; {path} is a mesh and keeps its triangles: remove `size`")
    if fault := size_fault(path) if is_mesh else content_fault(path):
        raise SurfaceError(f"{path} {fault}")
    vertices, triangles = _mesh(path) if is_mesh else _cad(path, None if size is None else size / scale)
    vertices = scale * vertices
    if len(triangles) == 0:
        raise SurfaceError(f"{path} holds no triangles; export it again: the surface, not curves or solid cells alone")
    if not np.isfinite(vertices[triangles]).all():
        raise SurfaceError(f"{path} holds coordinates that are not finite; export it again")
    extent = float(np.ptp(vertices[triangles].reshape(-1, 3), axis=0).max())
    if extent > LARGEST:
        raise SurfaceError(
            f"{path}: the wall measures {extent:.4g} m, allowed are {LARGEST:g} m; if the file is in millimetres, "
            f"give `scale` = {0.001 * scale:g}"
        )
    diagonal = float(np.linalg.norm(np.ptp(vertices[triangles].reshape(-1, 3), axis=0)))
    # exports hold needles of no area; twice the limit, as merging may still move their corners
    triangles = triangles[_heights(vertices, triangles) > 2.0 * MERGED * diagonal]
    if len(triangles) == 0:
        raise SurfaceError(f"{path}: none of its triangles has an area; export it again")
    return TriangleWall(name, body, vertices, triangles, magnetic)


def _mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) in the file's unit and triangles (t, 3) of a mesh."""
    import meshio

    try:
        with np.errstate(over="ignore"):  # of a text's bytes, read as the number of triangles of a binary STL
            mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # each of meshio's readers fails in a way of its own
        if path.suffix.lower() == ".stl":
            raise SurfaceError(f"{path} {_wrong_stl(path)}; export it again") from None
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SurfaceError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again") from None
    if len(mesh.points) == 0:  # also what is made of some files that are no STL
        found_instead = _wrong_stl(path) if path.suffix.lower() == ".stl" else "holds no triangles"
        raise SurfaceError(f"{path} {found_instead}; export it again")
    points = np.asarray(mesh.points, dtype=float).reshape(len(mesh.points), -1)
    vertices = np.zeros((len(points), 3))
    vertices[:, : points.shape[1]] = points
    found = [np.zeros((0, 3), dtype=np.int64)]
    for block in mesh.cells:
        cells = np.asarray(block.data)
        if block.type == "triangle":
            found.append(cells)
        elif block.type == "quad":
            found += [cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]]
    return vertices, np.vstack(found).astype(np.int64)


def _wrong_stl(path: Path) -> str:
    """Return what is wrong with an STL file that could not be read."""
    content = path.read_bytes()
    is_text = content.lstrip()[:5].lower() == b"solid" and b"\0" not in content
    announced = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if (is_text and b"endsolid" in content and b"facet" not in content) or (not is_text and announced == 0):
        return "holds no triangles"
    if is_text and b"endsolid" not in content:
        return "is cut off, or neither ASCII nor binary STL"
    if not is_text and announced > 0 and len(content) < 84 + 50 * announced:
        return f"is neither ASCII nor binary STL (a binary one would announce {announced} triangles and is cut off)"
    return "is neither ASCII nor binary STL"


def _cad(path: Path, size: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) [m] and triangles (t, 3) on all faces of a CAD file."""
    options = _OPTIONS | {"Mesh.MeshSizeMax": 1e22 if size is None else size / MILLIMETRE}
    with gmsh_model(options) as gmsh:
        try:
            gmsh.model.occ.importShapes(str(path), highestDimOnly=False, format=SHAPE_FORMATS[path.suffix.lower()])
            gmsh.model.occ.synchronize()
            if size is not None:
                _refuse_too_fine(gmsh, path, size / MILLIMETRE)
            gmsh.model.mesh.generate(2)
        except SurfaceError:
            raise
        except Exception as error:  # gmsh raises plain Exception, with its own last message
            raise SurfaceError(f"{path} cannot be read and meshed ({error}); export it again, best as STEP") from None
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, corners = gmsh.model.mesh.getElementsByType(2)
    position = np.empty((int(tags.max(initial=0)) + 1, 3))
    position[tags] = coordinates.reshape(-1, 3)
    used, triangles = np.unique(corners, return_inverse=True)
    return MILLIMETRE * position[used], triangles.reshape(-1, 3).astype(np.int64)


def _refuse_too_fine(gmsh: Any, path: Path, side: float) -> None:
    """Refuse sides [mm] with which the faces of a CAD file would have more triangles than any wall needs."""
    area = sum(gmsh.model.occ.getMass(2, tag) for _, tag in gmsh.model.getEntities(2))
    count = area / (math.sqrt(3.0) / 4.0 * side**2)
    if count > MAX_TRIANGLES:
        raise SurfaceError(
            f"{path} would have about {count:.2g} triangles; allowed: at most {MAX_TRIANGLES:.2g}; raise `size`, or "
            "leave it out"
        )
