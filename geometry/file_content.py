"""Check of a CAD or mesh file by its content, before gmsh or meshio reads it.

gmsh's own reading (``merge``, ``open``) decides by name and first line, and whatever it does not know it runs as a
script in its language, whose SystemCall is a shell: a text that is named ``a.msh``, or an options file ``a.msh.opt``
next to an honest mesh. So shapes go to the CAD kernel alone, by ``importShapes`` with the format named; a mesh that
begins as meshes do is copied without its neighbours; and scripts (.geo) are run only for those who trust them.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

SCRIPT = ".geo"
SHAPE_FORMATS = {".step": "step", ".stp": "step", ".iges": "iges", ".igs": "iges", ".brep": "brep"}
"""Name of a format in gmsh's ``importShapes``, by the ending of a file."""

MAX_FILE = 200_000_000
"""Bytes: 4 million triangles of a binary STL; a larger file is refused before it is read."""

_HEAD = 1000  # bytes; STEP and BREP may have a comment or blank lines before their mark
_IGES_COLUMN = 72  # from 0: the letter of a line's section, S(tart) or C(ompressed)


class CadError(ValueError):
    """A CAD or mesh file that cannot be taken as a device or a wall; says what is in it and what to do."""


def check_file(path: Path, kind: str, suffixes: Sequence[str], scale: float = 1.0, *, trusted: bool = False) -> None:
    """Refuse a file that is missing, too large or not what its ending says; whether it can be read is found by reading.

    Parameters
    ----------
    path : Path
    kind : str
        What it should be, in words: "CAD file".
    suffixes : sequence of str
        The endings that are allowed.
    scale : float
        Factor on its lengths.
    trusted : bool
        Whether a script may run.

    Raises
    ------
    CadError
    """
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise CadError(f"{path} is not a {kind} that is read here; give one of {', '.join(suffixes)}")
    if not path.is_file():
        raise CadError(f"{path} does not exist; check the path, which in a scene is relative to its folder")
    if not (math.isfinite(scale) and scale > 0.0):
        raise CadError(f"`scale` = {scale}: allowed is a factor above 0, e.g. 0.001 for a file in millimetres")
    if path.stat().st_size > MAX_FILE:
        raise CadError(
            f"{path} is larger than {MAX_FILE // 1_000_000} MB; simplify the shape, or mesh it more coarsely"
        )
    if suffix == SCRIPT and not trusted:
        raise CadError(
            f"{path} is a script of gmsh, which may run any command on this machine; if you trust who wrote it, allow "
            "it by --trust-scripts (in Python: trust_scripts=True), otherwise ask for a STEP file"
        )
    with open(path, "rb") as stream:
        head = stream.read(_HEAD)
    if suffix == ".msh":
        if not head.startswith((b"$MeshFormat", b"$NOD")):
            raise CadError(
                f"{path} is not a mesh of gmsh: it does not begin with $MeshFormat; write it again from gmsh as .msh"
            )
        return
    begins = {
        "step": (b"ISO-10303-21" in head, "it does not begin with ISO-10303-21; export it again"),
        "brep": (b"DBRep_DrawableShape" in head or b"CASCADE Topology" in head,
                 "it does not begin with DBRep_DrawableShape; export it again, best as STEP"),
        "iges": (head[_IGES_COLUMN : _IGES_COLUMN + 1] in (b"S", b"C"),
                 "its first line has no S in column 73; export it again, best as STEP"),
    }  # fmt: skip
    name = SHAPE_FORMATS.get(suffix)
    if name is not None and not begins[name][0]:
        raise CadError(f"{path} is not a{'n' if name == 'iges' else ''} {name.upper()} file: {begins[name][1]}")


@contextmanager
def lone_copy(path: Path) -> Iterator[Path]:
    """Copy a file into a folder of its own: gmsh also runs FILE.opt in the folder of a file."""
    with tempfile.TemporaryDirectory(prefix="emclutch-") as folder:
        yield Path(shutil.copyfile(path, Path(folder) / f"copy{path.suffix.lower()}"))
