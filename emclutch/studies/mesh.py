"""`emclutch mesh`: the scene's mesh as .msh and a picture of its section with the regions named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from emclutch.device_model.device import mesh_of
from emclutch.results import OutputError, RunFolder
from emclutch.results.folder_lock import locked_folder
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError, bad_input_for
from geometry import draw_section

if TYPE_CHECKING:
    from geometry.section import SectionMesh


@dataclass(frozen=True, slots=True)
class MeshedScene:
    """A scene's mesh with the files that it was written to.

    Attributes
    ----------
    mesh : SectionMesh
        Triangles of the half section with regions by name; points [m], (n, 2), are (r, z).
    file, picture : Path
        mesh.msh and mesh.png.
    """

    mesh: SectionMesh
    file: Path
    picture: Path


def mesh(case: Case | str | Path, out: str | Path | None = None) -> MeshedScene:
    """Mesh the section of a scene, and write mesh.msh and mesh.png.

    Parameters
    ----------
    case : Case, or the path of a scene file.
    out : folder without such files; default: the next runs/<case>-mesh-<nnn>.

    Raises
    ------
    OutputError
        A file is there already, or cannot be written.
    SceneError
        The scene has faults, or a geometry that has no mesh (box, shear cell).
    """
    case = as_case(case)
    geometry = case.scene.geometry
    if not geometry.has_coil:
        message = "has no field and so no mesh; clutch and drum have one, and a section from cad"
        fault = Fault("geometry.kind", repr(geometry.name()), message)
        raise SceneError([fault], "scene" if case.path is None else str(case.path))
    if geometry.is_from_file and geometry.is_solved_in_3d:
        message = "makes the mesh a 3D one; `emclutch field` writes it with its field.pvd"
        fault = Fault("geometry.three_dimensional", "true", message)
        raise SceneError([fault], "scene" if case.path is None else str(case.path))
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-mesh")
    files = folder / "mesh.msh", folder / "mesh.png"
    for file in files:
        if file.exists():
            raise OutputError(f"{file} exists; name another folder with --out")
    try:
        with locked_folder(folder):
            with bad_input_for(case.path):
                made = mesh_of(case.scene)
            made.write(files[0])
            draw_section(made, files[1], title=case.scene.scene.title)
    except OSError as error:
        raise OutputError(
            f"cannot write to {folder}: {error.strerror or error}; name another folder with --out"
        ) from error
    return MeshedScene(made, *files)
