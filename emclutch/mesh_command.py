"""`emclutch mesh`: the scene's mesh as .msh and a picture of its section with the regions named."""

from __future__ import annotations

from pathlib import Path

from emclutch.case import Case
from emclutch.device import field_in_space, mesh_of
from emclutch.results import OutputError, RunFolder
from emclutch.results.folder_lock import locked_folder
from geometry import Clutch, draw_section
from geometry.cad_shape import CadShape


def mesh_case(case: Case, out: str | Path | None = None) -> tuple[Path, Path, int]:
    """Write mesh.msh and mesh.png of a clutch into the folder `out` (default: the next runs/<case>-mesh-<nnn>).

    Returns both paths and the number of triangles. Raises OutputError when a file is there already, ValueError for a
    geometry that has no mesh (box, shear cell).
    """
    shape = case.scene.shape()
    if not isinstance(shape, (Clutch, CadShape)):
        raise ValueError(
            f"geometry.kind = {case.scene.geometry.kind!r} has no field and so no mesh; clutch and drum have one"
        )
    if isinstance(shape, CadShape) and field_in_space(case.scene):
        raise ValueError("with geometry.in_space the mesh is in space; `emclutch field` writes it with its field.pvd")
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-mesh")
    files = folder / "mesh.msh", folder / "mesh.png"
    for file in files:
        if file.exists():
            raise OutputError(f"{file} exists; name another folder with --out")
    try:
        with locked_folder(folder):
            mesh = mesh_of(case.scene, files[0])
            draw_section(mesh, files[1], title=case.scene.scene.title)
    except OSError as error:
        raise OutputError(
            f"cannot write to {folder}: {error.strerror or error}; name another folder with --out"
        ) from error
    return *files, len(mesh.triangles)
