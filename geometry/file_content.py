"""Check of a CAD or mesh file by its content, before gmsh reads it.

gmsh's own reading (``merge``, ``open``) decides by name and first line, and whatever it does not know it runs as a
script in its language, whose SystemCall is a shell: a text that is named ``a.msh``, or an options file ``a.msh.opt``
beside an honest mesh. So shapes go to the CAD kernel alone, by ``importShapes`` with the format named; a mesh that
begins as meshes do is copied without its neighbours; and scripts (.geo) are run only for those who trust them.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from geometry.cad_parts import CadError

SCRIPT = ".geo"
SHAPE_FORMATS = {".step": "step", ".stp": "step", ".iges": "iges", ".igs": "iges", ".brep": "brep"}
"""Name of a format in gmsh's ``importShapes``, by the ending of a file."""

MAX_FILE = 200_000_000
"""Bytes: 4 million triangles of a binary STL; a larger file is refused before it is read."""

_HEAD = 1000  # bytes; STEP and BREP may have a comment or blank lines before their mark
_IGES_COLUMN = 72  # from 0: the letter of a line's section


def untrusted_script(path: Path) -> str:
    """Return why a script is refused, and what to do."""
    return (
        f"{path} is a script of gmsh, which may run any command on this machine; if you trust who wrote it, allow it "
        "by --trust-scripts (in Python: trust_scripts=True), otherwise ask for a STEP file"
    )


def content_fault(path: Path) -> str:
    """Return what is wrong with the content of a CAD or .msh file; empty where it is what the file's ending says.

    It says only that the file begins like one of its kind: whether it can be read is found by reading it.
    """
    if fault := size_fault(path):
        return fault
    with open(path, "rb") as stream:
        head = stream.read(_HEAD)
    kind = SHAPE_FORMATS.get(path.suffix.lower(), "msh")
    if kind == "step" and b"ISO-10303-21" not in head:
        return "is not a STEP file: it does not begin with ISO-10303-21; export it again"
    if kind == "brep" and not (b"DBRep_DrawableShape" in head or b"CASCADE Topology" in head):
        return "is not a BREP file: it does not begin with DBRep_DrawableShape; export it again, best as STEP"
    if kind == "iges" and head[_IGES_COLUMN : _IGES_COLUMN + 1] not in (b"S", b"C"):  # start section, or compressed
        return "is not an IGES file: its first line has no S in column 73; export it again, best as STEP"
    if kind == "msh" and not head.startswith((b"$MeshFormat", b"$NOD")):
        return "is not a mesh of gmsh: it does not begin with $MeshFormat; write it again from gmsh as .msh"
    return ""


def size_fault(path: Path) -> str:
    """Return what is wrong with the size of a file; empty where it can be read."""
    if path.stat().st_size > MAX_FILE:
        return f"is larger than {MAX_FILE // 1_000_000} MB; simplify the shape, or mesh it more coarsely"
    return ""


@contextmanager
def lone_copy(path: Path) -> Iterator[Path]:
    """A copy of a file in a folder of its own: gmsh also runs what lies beside a file as FILE.opt."""
    with tempfile.TemporaryDirectory(prefix="emclutch-") as folder:
        yield Path(shutil.copyfile(path, Path(folder) / f"copy{path.suffix.lower()}"))


def read_by_meshio(path: Path) -> Any:
    """Read a mesh by meshio.

    Raises
    ------
    CadError
        With the reason that meshio gives.
    """
    import meshio
    import numpy as np

    try:
        with np.errstate(over="ignore"):  # of a text's bytes, read as the number of triangles of a binary STL
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # each of meshio's readers fails in a way of its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CadError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again") from None
