"""Triangles of an STL file, binary or as text.

A binary file is a head of 80 bytes, the number of its triangles and 50 bytes for each; text is a list of facets with
their vertices, in any case. Normals, colours and names are not read.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from geometry.file_content import CadError

_BEGIN, _SIZE = 84, 50  # bytes
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path) -> np.ndarray:
    """Corners (t, 3, 3) of the triangles in the file's unit; warns of bytes after the last triangle.

    Raises
    ------
    CadError
        With the line of a text that cannot be read; a file that is cut off, or no STL.
    """
    content = path.read_bytes()
    count = int.from_bytes(content[80:_BEGIN], "little") if len(content) >= _BEGIN else 0
    rest = len(content) - _BEGIN - _SIZE * count
    is_text = content.lstrip()[:5].lower() == b"solid" and b"\0" not in content
    if rest and is_text:
        return _read_text(path, content)
    if len(content) < _BEGIN or is_text:
        raise CadError(f"{path} is neither ASCII nor binary STL; export it again")
    if rest < 0 or (rest and rest % _SIZE == 0):
        found = (len(content) - _BEGIN) // _SIZE
        raise CadError(
            f"{path} is cut off or no STL: it announces {count} triangles and holds {found}; export it again"
        )
    if rest:
        warnings.warn(f"{path}: not used: {rest} bytes after the last triangle", UserWarning, stacklevel=2)
    return np.frombuffer(content, _FACET, count, _BEGIN)["corners"].astype(float)


def _read_text(path: Path, content: bytes) -> np.ndarray:
    corners: list[list[float]] = []
    word = ""
    for number, line in enumerate(content.decode(errors="replace").splitlines(), 1):
        words = line.lower().split()
        word = words[0] if words else word
        if word == "vertex" and words:
            try:
                x, y, z = map(float, words[1:])
            except ValueError:
                raise CadError(
                    f"{path}: line {number}: {line.strip()!r} is not a vertex with three numbers; export it again"
                ) from None
            corners.append([x, y, z])
        elif word in ("facet", "endfacet", "endsolid") and len(corners) % 3:
            raise CadError(f"{path}: line {number}: the facet does not have three corners; export triangles")
    if word != "endsolid":
        raise CadError(f"{path} is cut off: endsolid is missing after its last facet; export it again")
    return np.array(corners, dtype=float).reshape(-1, 3, 3)
