"""Vertices and faces of a Wavefront OBJ file.

A corner of a face is ``vertex``, ``vertex/texture``, ``vertex//normal`` or ``vertex/texture/normal``; vertices count
from 1, or backwards from the last one that was read (-1). Materials, groups, points and lines hold no surface.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.file_content import CadError

# statements that hold a surface, or name another file, and are not read
_UNREAD = {
    "surf": "free-form surfaces (surf)",
    "bzp": "Bezier patches (bzp)",
    "bsp": "B-spline patches (bsp)",
    "call": "a reference to another file (call)",
}


def read_obj(path: Path) -> tuple[np.ndarray, list[np.ndarray]]:
    """Vertices (v, 3) in the file's unit, and the faces (m, k) of each number k of corners.

    Raises
    ------
    CadError
        With the line that cannot be read.
    """
    vertices: list[list[float]] = []
    faces: dict[int, list[list[int]]] = {}
    begun, farthest = "", (-1, 0)
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            text = begun + line.split("#")[0].rstrip()
            if text.endswith("\\"):
                begun = text[:-1] + " "
                continue
            begun, words = "", text.split()
            try:
                if not words:
                    continue
                if words[0] == "v":
                    x, y, z = words[1:4]
                    vertices.append([float(x), float(y), float(z)])
                elif words[0] in ("f", "fo"):
                    corners = [_vertex(word, len(vertices)) for word in words[1:]]
                    if len(corners) < 3:
                        raise ValueError(f"a face of {len(corners)} corners")
                    farthest = max(farthest, (max(corners), number))
                    faces.setdefault(len(corners), []).append(corners)
                elif words[0] in _UNREAD:
                    raise CadError(f"{path} holds {_UNREAD[words[0]]}, which is not read; export it as triangles")
            except CadError:
                raise
            except ValueError as error:
                raise CadError(f"{path}: line {number} cannot be read ({error}); export it again") from None
    if farthest[0] >= len(vertices):
        place = f"line {farthest[1]}: a face names vertex {farthest[0] + 1}"
        raise CadError(f"{path}: {place}, and the file holds {len(vertices)}; export it again")
    blocks = [np.array(block, dtype=np.int64) for block in faces.values()]
    return np.array(vertices, dtype=float).reshape(-1, 3), blocks


def _vertex(word: str, count: int) -> int:
    """Number of a corner's vertex, from 0, where ``count`` vertices have been read."""
    given = int(word.split("/")[0])
    if given == 0 or given < -count:
        raise ValueError(f"vertex {given}, after {count} vertices")
    return given - 1 if given > 0 else count + given
