"""A triangle wall from a file: STL, OBJ, PLY, VTK or MSH as they are, STEP, IGES or BREP meshed by gmsh.

Meshes carry no unit: their numbers are metres times ``scale``. CAD files are read in millimetres (STEP says its unit,
and is converted), and ``scale`` mends a wrong one.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from geometry.file_content import SHAPE_FORMATS, CadError, check_file, read_by_meshio
from geometry.mesher import MAX_TRIANGLES, MILLIMETRE, gmsh_model
from geometry.triangle_wall import MERGED, TriangleWall, heights

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


def triangle_wall_from_file(
    path: str | Path,
    name: str,
    body: str,
    *,
    scale: float = 1.0,
    size: float | None = None,
) -> TriangleWall:
    """Read the surface in a file as a wall.

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
    CadError
        For a file that is missing or cannot be read, an unknown ending, no triangles, a wall larger than 10 m.
    """
    path = Path(path)
    check_file(path, "surface", MESH_SUFFIXES + CAD_SUFFIXES, scale)
    if size is not None and not (math.isfinite(size) and size > 0.0):
        raise CadError(f"`size` = {size}: allowed is a length above 0 m")
    if path.suffix.lower() in CAD_SUFFIXES:
        vertices, triangles = _mesh_faces(path, None if size is None else size / scale)
    elif size is None:
        vertices, triangles = _read_mesh(path)
    else:
        raise CadError(f"`size` is for CAD files; {path} is a mesh and keeps its triangles: remove `size`")
    vertices = scale * vertices
    if len(triangles) == 0:
        raise CadError(f"{path} holds no triangles; export it again: the surface, not curves or solid cells alone")
    if not np.isfinite(vertices[triangles]).all():
        raise CadError(f"{path} holds coordinates that are not finite; export it again")
    sides = np.ptp(vertices[triangles].reshape(-1, 3), axis=0)
    if sides.max() > LARGEST:
        raise CadError(
            f"{path}: the wall measures {sides.max():.4g} m, allowed are {LARGEST:g} m; if the file is in millimetres, "
            f"give `scale` = {0.001 * scale:g}"
        )
    # exports hold needles of no area; twice the limit, as merging may still move their corners
    triangles = triangles[heights(vertices, triangles) > 2.0 * MERGED * float(np.linalg.norm(sides))]
    if len(triangles) == 0:
        raise CadError(f"{path}: none of its triangles has an area; export it again")
    return TriangleWall(name, body, vertices, triangles)


def _read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) in the file's unit and triangles (t, 3) of a mesh."""
    is_stl = path.suffix.lower() == ".stl"
    try:
        mesh = read_by_meshio(path)
    except CadError:
        if is_stl:
            raise CadError(f"{path} {_wrong_stl(path)}; export it again") from None
        raise
    if len(mesh.points) == 0:  # also what is made of some files that are no STL
        raise CadError(f"{path} {_wrong_stl(path) if is_stl else 'holds no triangles'}; export it again")
    vertices = np.pad(np.asarray(mesh.points, dtype=float), ((0, 0), (0, 3 - mesh.points.shape[1])))
    found = [np.zeros((0, 3), dtype=np.int64)]
    for block in mesh.cells:
        if block.type in ("triangle", "quad"):
            found += [block.data[:, [0, k, k + 1]] for k in range(1, block.data.shape[1] - 1)]
    return vertices, np.vstack(found).astype(np.int64)


def _wrong_stl(path: Path) -> str:
    """Fault of an STL file that could not be read."""
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


def _mesh_faces(path: Path, size: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) [m] and triangles (t, 3) on all faces of a CAD file, of at most `size` [m]."""
    with gmsh_model(_OPTIONS | {"Mesh.MeshSizeMax": 1e22 if size is None else size / MILLIMETRE}) as gmsh:
        try:
            gmsh.model.occ.importShapes(str(path), highestDimOnly=False, format=SHAPE_FORMATS[path.suffix.lower()])
            gmsh.model.occ.synchronize()
            area = MILLIMETRE**2 * sum(gmsh.model.occ.getMass(2, tag) for _, tag in gmsh.model.getEntities(2))
            count = 0.0 if size is None else area / (math.sqrt(3.0) / 4.0 * size**2)
            if count > MAX_TRIANGLES:
                raise CadError(
                    f"{path} would have about {count:.2g} triangles; allowed: at most {MAX_TRIANGLES:.2g}; raise "
                    "`size`, or leave it out"
                )
            gmsh.model.mesh.generate(2)
        except CadError:
            raise
        except Exception as error:  # gmsh raises plain Exception, with its own last message
            raise CadError(f"{path} cannot be read and meshed ({error}); export it again, best as STEP") from None
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, corners = gmsh.model.mesh.getElementsByType(2)
    position = np.empty((int(tags.max(initial=0)) + 1, 3))
    position[tags] = coordinates.reshape(-1, 3)
    used, triangles = np.unique(corners, return_inverse=True)
    return MILLIMETRE * position[used], triangles.reshape(-1, 3).astype(np.int64)
