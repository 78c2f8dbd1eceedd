"""Meshes of triangles and other cells from files: VTK's own formats by VTK, all others by meshio.

meshio reads neither VTK's legacy polydata nor several pieces of a file, and passes over cells that it does not know.
"""

from __future__ import annotations

import io
import re
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from geometry.file_content import CadError

VTK_SUFFIXES = (".vtk", ".vtu", ".vtp")
_HEAD = 1000  # bytes; the third line says BINARY or ASCII
_COUNTED = re.compile(rb"^(VERTICES|LINES|POLYGONS|TRIANGLE_STRIPS|CELLS) +(\d{1,12}) +(\d{1,12})\s*?\n", re.MULTILINE)
_OF_POLYDATA = ("vtkPolyVertex", "vtkPolyLine", "vtkPolygon", "vtkTriangleStrip")
_NAMES = ("vertex", "line", "triangle", "quad", "polygon", "tetra", "hexahedron", "wedge", "pyramid")


def read_mesh(path: Path) -> Any:
    """Read a mesh, VTK's formats by VTK, all others by meshio, as a meshio.Mesh.

    Raises
    ------
    CadError
        With the reason that the reader gives.
    """
    if path.suffix.lower() in VTK_SUFFIXES:
        return _read_by_vtk(path)
    import meshio

    said = io.StringIO()  # meshio prints its warnings, and the reason before it exits
    try:
        with redirect_stderr(said), redirect_stdout(said):
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # each of meshio's readers raises errors of its own
        text = said.getvalue().partition("Error:")[0] if isinstance(error, SystemExit) else str(error)
        reason = " ".join(text.split()) or type(error).__name__
        raise CadError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again") from None


def _read_by_vtk(path: Path) -> Any:
    """As `read_mesh`; cells with curved edges are refused."""
    import meshio
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = _data_set(path)
    arrays = [data.GetCellData().GetArray(number) for number in range(data.GetCellData().GetNumberOfArrays())]
    columns = {array.GetName() or "": vtk_to_numpy(array) for array in arrays if array is not None}
    cells: list[tuple[str, np.ndarray]] = []
    values: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    first = 0
    for kinds, array in _cell_arrays(data):
        start = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
        corners = vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64)
        sizes = np.diff(start)
        if (sizes < 0).any() or start[0] != 0 or start[-1] != len(corners):
            raise CadError(f"{path} is damaged: the corners of its cells do not follow one another; export it again")
        for kind, size in sorted({*zip(kinds, sizes.tolist(), strict=True)}):
            mine = np.flatnonzero((kinds == kind) & (sizes == size))
            name, order = _cells_of(str(kind), size)
            if name not in _NAMES:
                raise CadError(f"{path} holds cells of the kind {name}; export flat triangles")
            cells.append((name, corners[start[mine][:, None] + order.ravel()].reshape(-1, order.shape[-1])))
            for column, value in columns.items():
                values[column].append(np.repeat(value[first + mine], len(order), axis=0))
        first += len(sizes)
    return meshio.Mesh(vtk_to_numpy(data.GetPoints().GetData()) if cells else np.zeros((0, 3)), cells, cell_data=values)


def _data_set(path: Path) -> Any:
    """VTK's data set of a file: polydata or an unstructured grid; what VTK calls an error is one."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkIOLegacy import vtkDataSetReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    readers = {".vtk": vtkDataSetReader, ".vtu": vtkXMLUnstructuredGridReader, ".vtp": vtkXMLPolyDataReader}
    reader: Any = readers[path.suffix.lower()]()
    if path.suffix.lower() == ".vtk":
        _check_counts(path)
    said = vtkStringOutputWindow()
    window, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(said)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader.SetFileName(str(path))
        reader.Update()
        text = said.GetOutput()  # bytes where it quotes what is no text
    finally:
        vtkOutputWindow.SetInstance(window)
        vtkLogger.SetStderrVerbosity(verbosity)
    text = " ".join((text.decode(errors="replace") if isinstance(text, bytes) else text).split())
    if error := re.search(r"ERROR: In .*?\): (.+)", text):
        reason = error[1].partition("ERROR:")[0].strip()
        raise CadError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again")
    data = reader.GetOutput()
    if data.GetClassName() in ("vtkPolyData", "vtkUnstructuredGrid"):
        return data
    grid = vtkAppendFilter()  # a structured grid becomes an unstructured one
    grid.AddInputData(data)
    grid.Update()
    return grid.GetOutput()


def _check_counts(path: Path) -> None:
    """Refuse a legacy file whose cells do not fill their list: VTK would read beyond its end."""
    content = path.read_bytes()
    is_text = b"BINARY" not in content[:_HEAD].upper()
    for match in _COUNTED.finditer(content):
        count, size = int(match[2]), int(match[3])
        body = content[match.end() :]
        if body.startswith(b"OFFSETS"):
            continue
        try:
            numbers = [int(word) for word in body.split(None, size)[:size]] if is_text else (
                np.frombuffer(body, ">i4", size).tolist())  # fmt: skip
            at = 0
            for _ in range(count):
                if numbers[at] < 0:
                    raise ValueError
                at += 1 + numbers[at]
            if at != size:
                raise ValueError
        except (ValueError, IndexError):
            name = match[1].decode()
            raise CadError(
                f"{path} cannot be read as .vtk: {name} are not {count} cells of {size} numbers in all; export it again"
            ) from None


def _cell_arrays(data: Any) -> list[tuple[np.ndarray, Any]]:
    """Return class names and corners of the cells, in the order of the cells' data."""
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    if data.GetNumberOfCells() == 0:
        return []
    if data.GetClassName() == "vtkPolyData":
        parts = zip(_OF_POLYDATA, (data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips()), strict=True)
        return [(np.repeat(kind, n), array) for kind, array in parts if (n := array.GetNumberOfCells())]
    kinds = [data.GetCellType(number) for number in range(data.GetNumberOfCells())]
    names = {kind: cell.GetClassName() for kind in {*kinds} if (cell := vtkGenericCell.InstantiateCell(kind))}
    return [(np.array([names.get(kind, "vtkUnknown") for kind in kinds]), data.GetCells())]


def _cells_of(kind: str, size: int) -> tuple[str, np.ndarray]:
    """Name of the cells that one of a class of VTK with `size` corners consists of, and their corners (cells, k)."""
    if kind == "vtkTriangleStrip":  # every other triangle has its first corners exchanged
        order = [[k + k % 2, k + 1 - k % 2, k + 2] for k in range(size - 2)]
        return "triangle", np.array(order, dtype=np.int64).reshape(-1, 3)
    if kind == "vtkPixel":
        return "quad", np.array([[0, 1, 3, 2]])
    name = " ".join(re.findall("[A-Z][a-z]+", kind)).lower().removeprefix("poly ")
    if name == "polygon":
        name = {3: "triangle", 4: "quad"}.get(size, name if size > 4 else "polygon without area")
    return name.replace("voxel", "hexahedron"), np.arange(size)[None]
