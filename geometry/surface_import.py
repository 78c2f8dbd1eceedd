"""A triangle wall from a file: STL, OBJ, PLY, VTK or MSH as they are, STEP, IGES or BREP meshed by gmsh.

Meshes carry no unit: their numbers are metres times ``scale``. CAD files are read in millimetres (STEP says its unit,
and is converted), and ``scale`` mends a wrong one.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from geometry.file_content import SHAPE_FORMATS, CadError, check_file
from geometry.mesh_file import VTK_SUFFIXES, read_mesh
from geometry.mesher import MAX_TRIANGLES, MILLIMETRE, gmsh_model
from geometry.obj_file import read_obj
from geometry.ply_file import read_ply
from geometry.polygon_faces import FaceFault, fans
from geometry.stl_file import read_stl
from geometry.triangle_wall import MERGED, TriangleWall, heights

MESH_SUFFIXES = (".stl", ".obj", ".ply", *VTK_SUFFIXES, ".msh")
CAD_SUFFIXES = tuple(SHAPE_FORMATS)
_FACES = ("triangle", "quad", "polygon")
# without a surface of their own: points, lines, and solid elements, of which a mesh has its surface besides
_NO_FACES = re.compile(r"(vertex|line|tetra|hexahedron|wedge|pyramid)\d*")
_NEEDLE = 1e-9  # of the whole area: a face that has less is a fault of the export, and no hole
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
        Its ending says its kind: `MESH_SUFFIXES` or `CAD_SUFFIXES`. Quadrilaterals are halved, flat convex faces with
        more corners become fans of triangles; solid elements, lines and triangles without area are left out.
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
        For a file that is missing or cannot be read, an unknown ending, no triangles, a wall larger than 10 m, faces
        of another kind, concave or warped ones.
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
            f"give `scale` = {0.001 * scale:g}, if it is in inches {0.0254 * scale:g}"
        )
    # exports hold needles of no area; twice the limit, as merging may still move their corners
    triangles = triangles[heights(vertices, triangles) > 2.0 * MERGED * float(np.linalg.norm(sides))]
    if len(triangles) == 0:
        raise CadError(f"{path}: none of its triangles has an area; export it again")
    return TriangleWall(name, body, vertices, triangles)


def _read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) in the file's unit and triangles (t, 3) of a mesh."""
    suffix = path.suffix.lower()
    if suffix == ".stl":
        vertices = read_stl(path).reshape(-1, 3)
        return vertices, np.arange(len(vertices)).reshape(-1, 3)
    reader = {".obj": read_obj, ".ply": read_ply}.get(suffix, _read_cells)
    vertices, faces = reader(path)
    named = np.concatenate([np.zeros(0, dtype=np.int64), *(block.ravel() for block in faces)])
    beyond = named[(named < 0) | (named >= len(vertices))]
    if len(beyond):
        raise CadError(f"{path}: a face names vertex {beyond[0]}, from 0, of {len(vertices)}; export it again")
    try:
        fanned = [fans(vertices, block) for block in faces]
    except FaceFault as fault:
        raise CadError(f"{path}: {fault}") from None
    return vertices, np.vstack([np.zeros((0, 3), dtype=np.int64), *fanned])


def _read_cells(path: Path) -> tuple[np.ndarray, list[np.ndarray]]:
    """Vertices (v, 3) and faces (m, k) of a mesh whose cells may be of many kinds."""
    mesh = read_mesh(path)
    faces = [np.asarray(block.data).astype(np.int64) for block in mesh.cells if block.type in _FACES]
    unknown = {block.type for block in mesh.cells if not (block.type in _FACES or _NO_FACES.fullmatch(block.type))}
    if unknown:
        raise CadError(f"{path} holds cells of the kind {', '.join(sorted(unknown))}; export flat triangles")
    points = np.asarray(mesh.points, dtype=float)
    return (np.pad(points, ((0, 0), (0, 3 - points.shape[1]))) if len(points) else np.zeros((0, 3))), faces


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
            _refuse_unmeshed(path, gmsh)
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


def _refuse_unmeshed(path: Path, gmsh: Any) -> None:
    """Refuse a shape that the mesher passed over a face of, which would be a hole."""
    faces = [tag for _, tag in gmsh.model.getEntities(2)]
    bare = [tag for tag in faces if len(gmsh.model.mesh.getElementsByType(2, tag)[1]) == 0]
    total_area = sum(gmsh.model.occ.getMass(2, tag) for tag in faces)
    bare = [tag for tag in bare if gmsh.model.occ.getMass(2, tag) > _NEEDLE * total_area]
    if bare:
        raise CadError(
            f"{path}: {len(bare)} of {len(faces)} faces cannot be meshed, the first is number {bare[0]}; repair the "
            "shape in the program that drew it, or export triangles (STL)"
        )
