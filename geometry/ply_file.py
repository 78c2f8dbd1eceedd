"""Vertices and faces of a PLY file, as text or binary.

The head lists the elements, each with a number of rows and the properties of a row, of which some are lists with their
length in front. Only the positions of vertices and the corners of faces are used: colours, normals, textures, and
elements such as edges are passed over.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geometry.file_content import CadError

_TYPES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
          "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f",
          "float64": "d"}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
_END = b"end_header"


@dataclass(frozen=True, slots=True)
class _Element:
    """Rows of one kind: name and format of each property, and of the length in front of a list."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    def rows_of_text(self, lines: list[str], start: int) -> list[dict[str, list[float]]]:
        """Values of each property by row; ValueError where a row is missing or has too few."""
        rows = []
        for line in lines[start : start + self.count]:
            words, row = iter(line.split()), {}
            for name, length, _ in self.properties:
                row[name] = [float(next(words)) for _ in range(int(next(words)) if length else 1)]
            rows.append(row)
        if len(rows) < self.count:
            raise ValueError
        return rows

    def rows_of_bytes(self, content: bytes, start: int, order: str) -> tuple[list[dict[str, tuple[float, ...]]], int]:
        """As `rows_of_text`, and the place behind the last row; struct.error where the content ends before."""
        rows = []
        for _ in range(self.count):
            row = {}
            for name, length, kind in self.properties:
                n = 1
                if length:
                    (n,) = struct.unpack_from(order + length, content, start)
                    start += struct.calcsize(order + length)
                row[name] = struct.unpack_from(f"{order}{n}{kind}", content, start)
                start += struct.calcsize(f"{order}{n}{kind}")
            rows.append(row)
        return rows, start


def read_ply(path: Path) -> tuple[np.ndarray, list[np.ndarray]]:
    """Vertices (v, 3) in the file's unit, and the faces (m, k) of each number k of corners.

    Raises
    ------
    CadError
        A file that is no PLY, is cut off, or has its faces in another form.
    """
    content = path.read_bytes()
    head, _, body = content.partition(_END)
    try:
        order, elements = _read_head(head.decode("ascii", errors="replace"))
    except (KeyError, ValueError, IndexError):
        raise CadError(f"{path} cannot be read as .ply (its head is not of this format); export it again") from None
    faces = next((one for one in elements if one.name == "face"), None)
    corners = next((name for name, length, _ in faces.properties if length and name in _CORNERS), "") if faces else ""
    if faces and not corners:
        names = ", ".join(name for name, *_ in faces.properties) or "nothing"
        raise CadError(f"{path}: its faces have {names} instead of {_CORNERS[0]}; export it again")
    if strips := [one.name for one in elements if one.name == "tristrips" and one.count]:
        raise CadError(f"{path} holds strips of triangles ({strips[0]}); export triangles")
    given = {name for one in elements if one.name == "vertex" for name, length, _ in one.properties if not length}
    if not given >= {*"xyz"}:
        names = ", ".join(sorted(given)) or "nothing"
        raise CadError(f"{path}: its vertices have {names}, not x, y and z; export it again")
    rows = _read_body(path, body, order, elements)
    blocks: dict[int, list[list[int]]] = {}
    for row in rows.get("face", []):
        blocks.setdefault(len(row[corners]), []).append([int(corner) for corner in row[corners]])
    if few := sum(len(block) for k, block in blocks.items() if k < 3):
        raise CadError(f"{path}: {few} of its faces have fewer than three corners; export it again")
    points = [[row[axis][0] for axis in "xyz"] for row in rows.get("vertex", [])]
    return np.array(points, dtype=float).reshape(-1, 3), [np.array(block, dtype=np.int64) for block in blocks.values()]


def _read_head(text: str) -> tuple[str, list[_Element]]:
    """Order of the bytes, empty for text, and the elements."""
    lines = [line.split() for line in text.splitlines()]
    if lines[0] != ["ply"]:
        raise ValueError
    order, elements = "", list[_Element]()
    for words in lines[1:]:
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append((words[4], _TYPES[words[2]], _TYPES[words[3]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append((words[2], "", _TYPES[words[1]]))
    return order, elements


def _read_body(path: Path, body: bytes, order: str, elements: list[_Element]) -> dict[str, list]:
    """Rows of each element by its name."""
    # behind the head is the end of a line
    start = 0 if not order else 2 if body[:2] == b"\r\n" else 1
    lines = [line for line in body.decode(errors="replace").splitlines() if line.strip()] if not order else []
    rows: dict[str, list] = {}
    for element in elements:
        try:
            if order:
                rows[element.name], start = element.rows_of_bytes(body, start, order)
            else:
                rows[element.name] = element.rows_of_text(lines, start)
                start += element.count
        except (ValueError, StopIteration, struct.error):
            raise CadError(
                f"{path} is cut off, or damaged: it announces {element.count} of {element.name}; export it again"
            ) from None
    return rows
