"""VTK XML files (.vtp, .vtu) with raw appended, zlib-compressed arrays.

Written directly rather than through the vtk package: importing that takes longer than writing all files
of a small run, and a run needs nothing else of it. ParaView 5.11 and vtk's own readers open the files.
Format: "VTK XML formats", https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from emclutch.results.array_units import ARRAY_UNITS
from emclutch.results.atomic_file import replace_bytes

BLOCK = 1 << 20  # bytes compressed together
TYPES = {
    "f8": "Float64",
    "f4": "Float32",
    "i8": "Int64",
    "i4": "Int32",
    "i1": "Int8",
    "u1": "UInt8",
    "u2": "UInt16",
}
VTK_TRIANGLE, VTK_TETRA = 5, 10


def write_poly_data(
    path: Path,
    points: np.ndarray,
    *,
    time: float,
    vertices: bool = False,
    lines: np.ndarray | None = None,
    polygons: Sequence[np.ndarray] | np.ndarray = (),
    point_arrays: Mapping[str, np.ndarray] | None = None,
    cell_arrays: Mapping[str, np.ndarray] | None = None,
    texts: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write a ``.vtp``.

    Parameters
    ----------
    points : (n, 3) [m].
    time : [s], kept as field data ``TimeValue``.
    vertices : one vertex cell a point (sphere glyphs need points only, a plain view needs cells).
    lines : (k, 2) point numbers.
    polygons : (k, 3) or (k, 4) point numbers, or a list of longer ones.
    point_arrays, cell_arrays : (n,) or (n, m) by name; units as of `ARRAY_UNITS`. Cells count in the
        order vertices, lines, polygons.
    texts : lists of strings by name, as field data.
    """
    n = len(points)
    body = _Appended()
    n_vertices = n if vertices else 0
    segments = np.zeros((0, 2), dtype=np.int64) if lines is None else np.asarray(lines, dtype=np.int64).reshape(-1, 2)
    polys = [np.asarray(polygon, dtype=np.int64) for polygon in polygons]
    xml = [
        f'<Piece NumberOfPoints="{n}" NumberOfVerts="{n_vertices}" NumberOfLines="{len(segments)}" '
        f'NumberOfStrips="0" NumberOfPolys="{len(polys)}">'
    ]
    xml += _data_section("PointData", point_arrays, body)
    xml += _data_section("CellData", cell_arrays, body)
    xml += _points_section(points, body)
    xml += _cells_section("Verts", np.arange(n_vertices), np.arange(1, n_vertices + 1), body)
    xml += _cells_section("Lines", segments.ravel(), 2 * np.arange(1, len(segments) + 1), body)
    connectivity = np.concatenate(polys) if polys else np.zeros(0, dtype=np.int64)
    offsets = np.cumsum([len(polygon) for polygon in polys], dtype=np.int64)
    xml += _cells_section("Polys", connectivity, offsets, body)
    xml.append("</Piece>")
    _write_file(path, "PolyData", time, xml, point_arrays, cell_arrays, texts, body)


def write_simplices(
    path: Path,
    points: np.ndarray,
    simplices: np.ndarray,
    *,
    time: float,
    point_arrays: Mapping[str, np.ndarray] | None = None,
    cell_arrays: Mapping[str, np.ndarray] | None = None,
    texts: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write a ``.vtu`` of linear triangles (k, 3) or tetrahedra (k, 4): points (n, 3) [m]; the rest as above."""
    body = _Appended()
    k, corners = simplices.shape
    xml = [f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{k}">']
    xml += _data_section("PointData", point_arrays, body)
    xml += _data_section("CellData", cell_arrays, body)
    xml += _points_section(points, body)
    kinds = np.full(k, VTK_TRIANGLE if corners == 3 else VTK_TETRA, dtype=np.uint8)
    xml += _cells_section("Cells", np.asarray(simplices).ravel(), corners * np.arange(1, k + 1), body, kinds)
    xml.append("</Piece>")
    _write_file(path, "UnstructuredGrid", time, xml, point_arrays, cell_arrays, texts, body)


class _Appended:
    """The block of raw data at the end of the file."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def add(self, data: bytes) -> int:
        """Offset of the data, which are stored as [blocks, block size, last block's size if partial,
        compressed sizes …] in UInt64 and then the compressed blocks."""
        blocks = [data[at : at + BLOCK] for at in range(0, len(data), BLOCK)]
        packed = [zlib.compress(block, 1) for block in blocks]
        partial = len(data) % BLOCK
        head = struct.pack(f"<{3 + len(packed)}Q", len(packed), BLOCK, partial, *(len(p) for p in packed))
        offset = self.size
        self.parts += [head, *packed]
        self.size += len(head) + sum(len(p) for p in packed)
        return offset


def _array(name: str, values: np.ndarray, body: _Appended) -> list[str]:
    array = np.ascontiguousarray(values)
    if array.dtype == bool:
        array = array.astype(np.uint8)
    kind = array.dtype.str[1:]
    if kind not in TYPES:
        raise TypeError(f"array {name} of {array.dtype} cannot be written to a VTK file")
    components = 1 if array.ndim == 1 else int(np.prod(array.shape[1:]))
    offset = body.add(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes())
    head = (
        f'<DataArray type="{TYPES[kind]}" Name={quoteattr(name)} NumberOfComponents="{components}" '
        f'format="appended" offset="{offset}"'
    )
    unit = ARRAY_UNITS.get(name)
    if unit is None:
        return [head + "/>"]
    key = f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{unit}</InformationKey>'
    return [head + ">", key, "</DataArray>"]


def _data_section(tag: str, arrays: Mapping[str, np.ndarray] | None, body: _Appended) -> list[str]:
    xml = [f"<{tag}>"]
    for name, values in (arrays or {}).items():
        xml += _array(name, np.asarray(values), body)
    return [*xml, f"</{tag}>"]


def _points_section(points: np.ndarray, body: _Appended) -> list[str]:
    return [
        "<Points>",
        *_array("Points", np.asarray(points, dtype=np.float64).reshape(-1, 3), body),
        "</Points>",
    ]


def _cells_section(
    tag: str, connectivity: np.ndarray, offsets: np.ndarray, body: _Appended, kinds: np.ndarray | None = None
) -> list[str]:
    xml = [f"<{tag}>"]
    xml += _array("connectivity", np.asarray(connectivity, dtype=np.int64), body)
    xml += _array("offsets", np.asarray(offsets, dtype=np.int64), body)
    if kinds is not None:
        xml += _array("types", kinds, body)
    return [*xml, f"</{tag}>"]


def _write_file(
    path: Path,
    kind: str,
    time: float,
    piece: list[str],
    point_arrays: Mapping[str, np.ndarray] | None,
    cell_arrays: Mapping[str, np.ndarray] | None,
    texts: Mapping[str, Sequence[str]] | None,
    body: _Appended,
) -> None:
    names = dict.fromkeys([*(point_arrays or {}), *(cell_arrays or {})])
    units = [f"{name}={ARRAY_UNITS[name]}" for name in names if name in ARRAY_UNITS]
    fields = ["<FieldData>"]
    offset = body.add(np.array([time], dtype="<f8").tobytes())
    fields.append(
        f'<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="appended" offset="{offset}"/>'
    )
    for name, strings in {"UNITS_LABEL": units, **(texts or {})}.items():
        offset = body.add(b"".join(text.encode() + b"\0" for text in strings))
        fields.append(
            f'<Array type="String" Name={quoteattr(name)} NumberOfTuples="{len(strings)}" '
            f'format="appended" offset="{offset}"/>'
        )
    fields.append("</FieldData>")
    head = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        'compressor="vtkZLibDataCompressor">',
        f"<{kind}>",
        *fields,
        *piece,
        f"</{kind}>",
        '<AppendedData encoding="raw">\n_',
    ]
    replace_bytes(path, b"".join(["\n".join(head).encode(), *body.parts, b"\n</AppendedData>\n</VTKFile>\n"]))
