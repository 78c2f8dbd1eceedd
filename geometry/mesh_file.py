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
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkCommonDataModel import vtkGenericCell
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkIOLegacy import vtkDataSetReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    readers = {".vtk": vtkDataSetReader, ".vtu": vtkXMLUnstructuredGridReader, ".vtp": vtkXMLPolyDataReader}
    reader: Any = readers[path.suffix.lower()]()
    said = vtkStringOutputWindow()
    window, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(said)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader.SetFileName(str(path))
        reader.Update()
    finally:
        vtkOutputWindow.SetInstance(window)
        vtkLogger.SetStderrVerbosity(verbosity)
    if error := re.search(r"ERROR: In .*?\): (.+)", " ".join(said.GetOutput().split())):
        reason = error[1].partition("ERROR:")[0].strip()
        raise CadError(f"{path} cannot be read as {path.suffix.lower()} ({reason}); export it again")
    grid = vtkAppendFilter()  # polygons and structured grids become an unstructured one
    grid.AddInputData(reader.GetOutput())
    grid.Update()
    data = grid.GetOutput()
    count = data.GetNumberOfCells()
    if count == 0:
        return meshio.Mesh(np.zeros((0, 3)), [])
    points = vtk_to_numpy(data.GetPoints().GetData())
    kinds = np.array([data.GetCellType(number) for number in range(count)])
    start = vtk_to_numpy(data.GetCells().GetOffsetsArray()).astype(np.int64)
    corners = vtk_to_numpy(data.GetCells().GetConnectivityArray()).astype(np.int64)
    arrays = [data.GetCellData().GetArray(number) for number in range(data.GetCellData().GetNumberOfArrays())]
    columns = {array.GetName() or "": vtk_to_numpy(array) for array in arrays if array is not None}
    cells: list[tuple[str, np.ndarray]] = []
    values: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    sizes = np.diff(start)
    for kind, size in sorted({*zip(kinds.tolist(), sizes.tolist(), strict=True)}):
        mine = np.flatnonzero((kinds == kind) & (sizes == size))
        name, order = _cells_of(vtkGenericCell.InstantiateCell(kind).GetClassName(), size)
        if name not in _NAMES:
            raise CadError(f"{path} holds cells of the kind {name}; export flat triangles")
        block = corners[start[mine][:, None] + order.ravel()].reshape(-1, order.shape[-1])
        cells.append((name, block))
        for column, value in columns.items():
            values[column].append(np.repeat(value[mine], len(order), axis=0))
    return meshio.Mesh(points, cells, cell_data=values)


def _cells_of(kind: str, size: int) -> tuple[str, np.ndarray]:
    """Name of the cells that one of a class of VTK with `size` corners consists of, and their corners (cells, k)."""
    if kind == "vtkTriangleStrip":  # every other triangle has its first corners exchanged
        return "triangle", np.array([[k + k % 2, k + 1 - k % 2, k + 2] for k in range(size - 2)])
    if kind == "vtkPixel":
        return "quad", np.array([[0, 1, 3, 2]])
    name = " ".join(re.findall("[A-Z][a-z]+", kind)).lower().removeprefix("poly ")
    return name.replace("voxel", "hexahedron"), np.arange(size)[None]
