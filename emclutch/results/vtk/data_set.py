"""VTK data sets from arrays, written to and read from XML files (.vtp, .vtu) that ParaView 5.11 opens.

vtk is imported when the first snapshot is written, not before: it takes 0.2 s and 45 MiB.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.array_units import ARRAY_UNITS
from emclutch.results.atomic_file import replace_bytes
from emclutch.results.errors import OutputError

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkUnstructuredGrid

BLOCK = 1 << 15  # bytes compressed together; larger blocks are no smaller together, and slower
LEVEL = 1  # of zlib: higher ones take several times as long for a few per cent


def poly_data(
    points: np.ndarray,
    *,
    vertices: bool = False,
    lines: np.ndarray | None = None,
    polygons: Sequence[np.ndarray] = (),
) -> vtkPolyData:
    """Return points with the cells that join them.

    Parameters
    ----------
    points : (n, 3) [m].
    vertices : one vertex cell a point (sphere glyphs need points only, a plain view needs cells).
    lines : (k, 2) point numbers.
    polygons : point numbers of each polygon.
    """
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    data = vtkPolyData()
    _set_points(data, points)
    if vertices:
        data.SetVerts(_cells(np.arange(len(points))[:, None]))
    if lines is not None:
        data.SetLines(_cells(lines))
    if len(polygons):
        data.SetPolys(_cells(polygons))
    return data


def simplices(points: np.ndarray, corners: np.ndarray) -> vtkUnstructuredGrid:
    """Return a mesh of linear triangles, corners (k, 3), or tetrahedra (k, 4), on points (n, 3) [m]."""
    from vtkmodules.vtkCommonDataModel import VTK_TETRA, VTK_TRIANGLE, vtkUnstructuredGrid

    data = vtkUnstructuredGrid()
    _set_points(data, points)
    data.SetCells(VTK_TRIANGLE if corners.shape[1] == 3 else VTK_TETRA, _cells(corners))
    return data


def write_data_set(
    path: Path,
    data: Any,
    *,
    time: float,
    point_arrays: Mapping[str, np.ndarray] | None = None,
    cell_arrays: Mapping[str, np.ndarray] | None = None,
    texts: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write a data set in one step, with the units of its arrays.

    Parameters
    ----------
    path : ``.vtp`` of `poly_data`, ``.vtu`` of `simplices`.
    time : [s], kept as field data ``TimeValue``.
    point_arrays, cell_arrays : (n,) or (n, m) by name; units as of `ARRAY_UNITS`. Cells count in the order vertices,
        lines, polygons.
    texts : lists of strings by name, as field data: strings of ``.vtp``, and the codes of their characters, 10 between
        two strings, of ``.vtu``, since meshio refuses a file with strings.
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    for attributes, arrays in ((data.GetPointData(), point_arrays), (data.GetCellData(), cell_arrays)):
        for name, values in (arrays or {}).items():
            attributes.AddArray(_array(values, name))
    names = dict.fromkeys([*(point_arrays or {}), *(cell_arrays or {})])
    units = [f"{name}={ARRAY_UNITS[name]}" for name in names if name in ARRAY_UNITS]
    text_array = _strings if path.suffix == ".vtp" else _codes
    data.GetFieldData().AddArray(_array(np.array([time]), "TimeValue"))
    for name, strings in {"UNITS_LABEL": units, **(texts or {})}.items():
        data.GetFieldData().AddArray(text_array(strings, name))
    writer = vtkXMLPolyDataWriter() if path.suffix == ".vtp" else vtkXMLUnstructuredGridWriter()
    writer.SetInputData(data)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetHeaderTypeToUInt64()
    writer.SetBlockSize(BLOCK)
    writer.SetCompressionLevel(LEVEL)
    writer.WriteToOutputStringOn()  # into memory: the file on disk is either whole or not there
    writer.Write()
    content = writer.GetOutputString()
    replace_bytes(path, content if isinstance(content, bytes) else content.encode())


def read_data_set(path: str | Path) -> Any:
    """Return the data set of a ``.vtp`` or ``.vtu``; OutputError where the file is missing or damaged."""
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    path = Path(path)
    reader = vtkXMLPolyDataReader() if path.suffix == ".vtp" else vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    vtkObject.GlobalWarningDisplayOff()  # the error below says it
    read = reader.GetExecutive().Update()
    vtkObject.GlobalWarningDisplayOn()
    if not read:
        raise OutputError(f"{path} is missing, or is not a file that a run wrote")
    return reader.GetOutput()


def array_names(attributes: Any) -> list[str]:
    """Return the names of the arrays of a data set's points or cells."""
    return [attributes.GetArrayName(number) for number in range(attributes.GetNumberOfArrays())]


def read_texts(data: Any, name: str) -> list[str]:
    """Return a list of strings in the field data of a data set; empty where it has none of that name."""
    array = data.GetFieldData().GetAbstractArray(name)
    if array is None:
        return []
    values = [array.GetValue(number) for number in range(array.GetNumberOfValues())]
    return values if array.GetClassName() == "vtkStringArray" else bytes(values).decode().splitlines()


def _strings(texts: Sequence[str], name: str) -> Any:
    from vtkmodules.vtkCommonCore import vtkStringArray

    array = vtkStringArray()
    array.SetName(name)
    for text in texts:
        array.InsertNextValue(text)
    return array


def _codes(texts: Sequence[str], name: str) -> Any:
    return _array(np.frombuffer("\n".join(texts).encode(), dtype=np.uint8), name)


def _array(values: np.ndarray, name: str = "") -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkDataArray

    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    if name in ARRAY_UNITS:
        array.GetInformation().Set(vtkDataArray.UNITS_LABEL(), ARRAY_UNITS[name])
    return array


def _set_points(data: Any, points: np.ndarray) -> None:
    from vtkmodules.vtkCommonCore import vtkPoints

    of = vtkPoints()
    of.SetData(_array(np.asarray(points, dtype=np.float64).reshape(-1, 3), "Points"))
    data.SetPoints(of)


def _cells(corners: np.ndarray | Iterable[np.ndarray]) -> vtkCellArray:
    """Return cells of the point numbers (k, m), or of arrays of different lengths."""
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    if isinstance(corners, np.ndarray):
        count, flat = np.full(len(corners), corners.shape[1]), corners.ravel()
    else:
        rows = list(corners)
        count, flat = np.array([len(row) for row in rows]), np.concatenate(rows)
    cells = vtkCellArray()
    cells.SetData(_array(np.append(0, np.cumsum(count))), _array(flat.astype(np.int64)))
    return cells
