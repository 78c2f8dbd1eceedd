"""Check of a CAD or mesh file by its content, before gmsh or meshio reads it.

gmsh's own reading (``merge``, ``open``) decides by name and first line, and whatever it does not know it runs as a
script in its language, whose SystemCall is a shell: a text that is named ``a.msh``, or an options file ``a.msh.opt``
next to an honest mesh. So shapes go to the CAD kernel alone, by ``importShapes`` with the format named; a mesh that
begins as meshes do is copied without its neighbours; and scripts (.geo) are run only for those who trust them.
"""

from __future__ import annotations

import io
import math
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

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


# How many cells a file says that it has, and its types of cells that meshio passes over without an error.
_COUNTS = {
    ".vtu": re.compile(rb"""NumberOfCells\s*=\s*["'](\d+)["']"""),
    ".vtk": re.compile(rb"^CELL_TYPES\s+(\d+)", re.MULTILINE),
    ".ply": re.compile(rb"^element face (\d+)", re.MULTILINE),
}
_VTK_TYPES = {2: "poly vertex", 4: "poly line", 6: "triangle strip", 8: "pixel", 11: "voxel", 41: "convex point set"}
_NO_SURFACE = {2, 4}  # of these


def read_by_meshio(path: Path) -> Any:
    """Read a mesh by meshio, all of its cells.

    Raises
    ------
    CadError
        With the reason that meshio gives, or the number of the cells that it leaves out and their kind.
    """
    import meshio

    if path.suffix.lower() == ".ply":
        _refuse_properties(path)
    said = io.StringIO()  # meshio prints its warnings, and the reason before it exits
    try:
        # overflow: of a text's bytes, read as the number of triangles of a binary STL
        with np.errstate(over="ignore"), redirect_stderr(said), redirect_stdout(said):
            mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # each of meshio's readers raises errors of its own
        kinds = _in_words(_legacy_types(path) & _VTK_TYPES.keys()) if path.suffix.lower() == ".vtk" else ""
        text = said.getvalue().partition("Error:")[0] if isinstance(error, SystemExit) else str(error)
        reason = f"cells of the kind {kinds}" if kinds else " ".join(text.split()) or type(error).__name__
        raise CadError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again") from None
    _refuse_unread(path, mesh, {int(kind) for kind in re.findall(r"\(type\s+(\d+)\)", said.getvalue())})
    return mesh


def _refuse_unread(path: Path, mesh: Any, passed_over: set[int]) -> None:
    """Refuse a file of which meshio left out cells: kinds that it does not know, all pieces but the last, a rest."""
    suffix = path.suffix.lower()
    content = path.read_bytes() if suffix in _COUNTS else b""
    unread = sum(map(int, _COUNTS[suffix].findall(content))) if content else 0
    unread -= sum(len(block.data) for block in mesh.cells)
    if unread <= 0 or (passed_over and passed_over <= _NO_SURFACE):
        return
    pieces = len(_COUNTS[suffix].findall(content))
    if passed_over:
        why = f"cells of the kind {_in_words(passed_over)}; export it as triangles"
    elif pieces > 1:
        why = f"only the last of its {pieces} pieces is read; merge them into one (in ParaView: Merge Blocks)"
    else:
        why = "it is cut off, or damaged; export it again"
    raise CadError(f"{path}: {unread} of its cells cannot be read: {why}")


def _refuse_properties(path: Path) -> None:
    """Refuse a binary PLY whose faces have more than their corners: meshio takes these numbers for corners."""
    header = path.read_bytes().partition(b"end_header")[0].decode("ascii", errors="replace")
    if "format binary" not in header:
        return
    names = re.findall(r"^property .*?(\S+)\s*$", header.partition("element face")[2], re.MULTILINE)
    if names and names[0] != "vertex_indices":
        raise CadError(f"{path}: the corners of its faces are named {names[0]} instead of vertex_indices; rename them")
    if len(names) > 1:
        raise CadError(
            f"{path}: its faces have other properties than their corners ({', '.join(names[1:])}); export it without "
            "them, or as text (ASCII)"
        )


def _legacy_types(path: Path) -> set[int]:
    """Numbers of the kinds of cells in a legacy VTK file; empty where they are not found."""
    content = path.read_bytes()
    count, _, body = content.partition(b"CELL_TYPES")[2].partition(b"\n")
    try:
        n = int(count)
        types = body.split(None, n)[:n] if b"ASCII" in content[:_HEAD] else np.frombuffer(body[: 4 * n], ">i4")
        return {int(kind) for kind in types}
    except ValueError:
        return set()


def _in_words(kinds: set[int]) -> str:
    return ", ".join(_VTK_TYPES.get(kind, f"VTK type {kind}") for kind in sorted(kinds))
