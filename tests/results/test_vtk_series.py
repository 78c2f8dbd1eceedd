"""Series for ParaView, re-opened with vtk's own readers: times, arrays, units, shapes."""

import math
import os
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from emclutch.results.vtk.data_set import read_texts
from emclutch.results.vtk.field_arrays import SectionArrays
from emclutch.results.vtk.series import PvdSeries, read_pvd
from geometry import box_surface


def opened(path):
    """The data set of a file, read by vtk."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    reader = vtkXMLPolyDataReader() if path.suffix == ".vtp" else vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    return reader.GetOutput()


def array(attributes, name):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(attributes.GetArray(name))


def texts(data, name):
    strings = data.GetFieldData().GetAbstractArray(name)
    return [strings.GetValue(i) for i in range(strings.GetNumberOfValues())]


def points(data):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(data.GetPoints().GetData())


def test_grains_come_back_exactly_with_times_and_units(tmp_path):
    from vtkmodules.vtkCommonCore import vtkDataArray

    rng = np.random.default_rng(0)
    series = PvdSeries(tmp_path, "particles")
    for i in range(3):
        position, velocity = rng.random((50, 3)), rng.random((50, 3))
        arrays = {"radius": np.full(50, 1e-4), "velocity": velocity, "particle_id": np.arange(50)}
        series.write_particles(0.1 * i, position, arrays)
    assert [time for time, _ in read_pvd(tmp_path / "particles.pvd")] == [0.0, 0.1, 0.2]
    assert [file.name for _, file in read_pvd(tmp_path / "particles.pvd")][2] == "particles_000002.vtp"
    data = opened(read_pvd(tmp_path / "particles.pvd")[2][1])
    assert np.array_equal(points(data), position)
    assert np.array_equal(array(data.GetPointData(), "velocity"), velocity)
    assert np.array_equal(array(data.GetPointData(), "diameter"), np.full(50, 2e-4))
    assert array(data.GetPointData(), "particle_id").tolist() == list(range(50))
    assert data.GetNumberOfVerts() == 50
    assert array(data.GetFieldData(), "TimeValue")[0] == 0.2
    assert "velocity=m/s" in texts(data, "UNITS_LABEL")
    key = vtkDataArray.UNITS_LABEL()
    assert data.GetPointData().GetArray("velocity").GetInformation().Get(key) == "m/s"


@pytest.mark.parametrize("count", [0, 1, 60_000])  # none, one, several compressed blocks of 1 MiB
def test_any_number_of_grains(tmp_path, count):
    position = np.random.default_rng(0).random((count, 3))
    path = PvdSeries(tmp_path, "particles").write_particles(0.0, position, {"radius": np.ones(count)})
    data = opened(path)
    assert data.GetNumberOfPoints() == count
    assert count == 0 or np.array_equal(points(data), position)


def test_field_lies_in_the_half_plane_of_the_device(tmp_path):
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
    at_corners = {"flux_density": np.array([[1.0, 2.0]] * 3), "vector_potential": np.arange(3.0)}
    section = SectionArrays(corners, np.array([[0, 1, 2]]), {"region": np.array([1])}, at_corners, ["air", "disc"])
    data = opened(PvdSeries(tmp_path, "field").write_field(0.5, section))
    assert points(data).tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 2]]
    assert array(data.GetPointData(), "flux_density")[0].tolist() == [1.0, 0.0, 2.0]
    assert array(data.GetCellData(), "region").tolist() == [1]
    assert read_texts(data, "region_names") == ["air", "disc"]
    assert "flux_density=T" in read_texts(data, "UNITS_LABEL")


# Each returns the points (n, 3), the corners of the cells (k, 3 or 4) and the cell array `region`.
def by_meshio(path):
    import meshio

    mesh = meshio.read(path)
    return mesh.points, mesh.cells[0].data, mesh.cell_data["region"][0]


def by_pyvista(path):
    import pyvista

    mesh = pyvista.read(path)
    (cells,) = mesh.cells_dict.values()
    return mesh.points, cells, mesh.cell_data["region"]


def by_vtk(path):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = opened(path)
    cells = vtk_to_numpy(data.GetCells().GetConnectivityArray()).reshape(data.GetNumberOfCells(), -1)
    return points(data), cells, array(data.GetCellData(), "region")


PARAVIEW = """
import sys
import numpy as np
from paraview.simple import OpenDataFile
from paraview import servermanager
from vtkmodules.util.numpy_support import vtk_to_numpy
source = OpenDataFile(sys.argv[1])
source.UpdatePipeline()
data = servermanager.Fetch(source)
corners = vtk_to_numpy(data.GetCells().GetConnectivityArray()).reshape(data.GetNumberOfCells(), -1)
region = vtk_to_numpy(data.GetCellData().GetArray("region"))
np.savez(sys.argv[2], vtk_to_numpy(data.GetPoints().GetData()), corners, region)
"""


def by_paraview(path):
    if (pvpython := shutil.which("pvpython")) is None:
        pytest.skip("ParaView's pvpython is not installed")
    script, found = path.with_suffix(".py"), path.with_suffix(".npz")
    script.write_text(PARAVIEW)
    subprocess.run([pvpython, "--force-offscreen-rendering", script, path, found], check=True, timeout=120)
    with np.load(found) as arrays:
        return tuple(arrays.values())


@pytest.mark.parametrize("reader", [by_meshio, by_pyvista, by_vtk, by_paraview])
@pytest.mark.parametrize("corners", [3, 4])
def test_a_field_is_read_by_other_programs(tmp_path, reader, corners):
    """Points, triangles or tetrahedra and regions in several compressed blocks come back to the last bit."""
    rng = np.random.default_rng(1)
    at, cells = rng.random((20_000, corners - 1)), rng.integers(0, 20_000, (30_000, corners))
    arrays = {"region": rng.integers(0, 2, 30_000), "flux_density": rng.random((30_000, corners - 1))}
    names = ["air", "disc"]
    series = PvdSeries(tmp_path, "field")
    if corners == 3:
        path = series.write_field(0.5, SectionArrays(at, cells, arrays, {"vector_potential": at[:, 0]}, names))
        at = np.column_stack([at[:, 0], np.zeros(len(at)), at[:, 1]])
    else:
        path = series.write_field_3d(0.5, at, cells, arrays, region_names=names)
    for found, expected in zip(reader(path), (at, cells, arrays["region"]), strict=True):
        np.testing.assert_array_equal(found, expected)


def rim(body="rotor", radius=2.0):
    return SimpleNamespace(name=f"{body}_rim", body=body, start=(radius, -1.0), end=(radius, 1.0))


def plane(point, normal):
    return SimpleNamespace(name="plane", body="housing", point=np.array(point), normal=np.array(normal, dtype=float))


def test_ring_turns_with_its_body(tmp_path):
    series = PvdSeries(tmp_path, "walls")
    still = opened(series.write_walls(0.0, [rim()]))
    turned = opened(series.write_walls(1.0, [rim()], angles={"rotor": 0.3}, speeds={"rotor": 5.0}))
    x, y, z = points(still).T
    expected = np.column_stack([x * math.cos(0.3) - y * math.sin(0.3), x * math.sin(0.3) + y * math.cos(0.3), z])
    assert np.allclose(points(turned), expected, atol=1e-12)
    assert np.allclose(np.linalg.norm(array(turned.GetPointData(), "velocity"), axis=1), 10.0)
    a, b = (array(data.GetCellData(), "material_angle") for data in (still, turned))
    assert np.allclose(a, b)
    assert texts(turned, "body_names") == ["rotor"]


def test_triangle_wall_turns_with_its_body(tmp_path):
    """Each point at its angle, velocity speed x radius; the plane beside it is drawn as large as the wall."""
    vane = box_surface("vane", "disc", (3.0, 0.0, 0.0), (2.0, 0.2, 1.0))
    walls = [vane, plane((0, 0, -1.0), (0, 0, 1.0))]
    path = PvdSeries(tmp_path, "walls").write_walls(0.0, walls, angles={"disc": 0.3}, speeds={"disc": 5.0})
    data = opened(path)
    at = points(data)[: len(vane.vertices)]
    assert data.GetNumberOfPolys() == len(vane.triangles) + 1
    assert np.allclose(at, vane.turned(0.3).vertices)
    speed = np.linalg.norm(array(data.GetPointData(), "velocity"), axis=1)
    assert np.allclose(speed[: len(at)], 5.0 * np.hypot(at[:, 0], at[:, 1]))
    assert np.ptp(points(data)[len(at) :, 0]) > 2.0


def test_sector_of_a_ring_stays_over_its_grains(tmp_path):
    angle = math.pi / 6
    path = PvdSeries(tmp_path, "walls").write_walls(0.0, [rim()], angles={"rotor": 1.0}, sector_angle=angle)
    data = opened(path)
    theta = np.arctan2(points(data)[:, 1], points(data)[:, 0])
    assert theta.min() == pytest.approx(0.0) and theta.max() == pytest.approx(angle)
    material = np.sort(array(data.GetCellData(), "material_angle"))
    seen = (material - (2.0 * math.pi - 1.0)) % (
        2.0 * math.pi
    )  # the body has turned by 1: the sector shows what was behind
    assert np.all(seen < angle)


@pytest.mark.parametrize("sector_angle", [None, math.pi / 6, 0.7])
def test_marks_turn_with_their_body(tmp_path, sector_angle):
    """A place has a mark if and only if that material point had it before the body turned."""
    series = PvdSeries(tmp_path, "walls")

    def marked(turned, azimuth):
        path = series.write_walls(0.0, [rim()], angles={"rotor": turned}, sector_angle=sector_angle)
        data = opened(path)
        x, y, _ = points(data).T
        number = len(x) // 2  # the lower row of corners is followed by the upper
        edge = np.unwrap(np.arctan2(y, x)[:number])
        if sector_angle is None:
            azimuth = edge[0] + (azimuth - edge[0]) % (2.0 * math.pi)
        return array(data.GetCellData(), "stripe")[np.searchsorted(edge, azimuth) - 1]

    at = np.linspace(0.03, 0.37, 23)
    still = marked(0.0, at)
    assert set(still) == {0, 1}
    for turn in (0.01, 0.1, 0.15):
        assert np.array_equal(marked(turn, at + turn), still)


def test_planes_of_a_box_meet_at_its_corners(tmp_path):
    normals = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    planes = [plane(-np.array(n) * np.array([0.5, 1.0, 2.0]), n) for n in normals]
    data = opened(PvdSeries(tmp_path, "walls").write_walls(0.0, planes))
    assert data.GetNumberOfPolys() == 6 and data.GetNumberOfPoints() == 24
    assert np.allclose(np.unique(np.abs(points(data)), axis=0), [[0.5, 1.0, 2.0]])


def test_single_plane_is_a_square(tmp_path):
    data = opened(PvdSeries(tmp_path, "walls").write_walls(0.0, [plane((0, 0, 0), (0, 0, 1))]))
    assert data.GetNumberOfPoints() == 4 and np.allclose(points(data)[:, 2], 0.0)


def test_contacts_are_lines_with_forces(tmp_path):
    start, end = np.zeros((2, 3)), np.array([[1.0, 0, 0], [0, 2.0, 0]])
    force = np.array([[-3.0, 1.0, 0.0], [0.0, 0.0, 4.0]])
    data = opened(PvdSeries(tmp_path, "contacts").write_contacts(0.0, start, end, force))
    assert data.GetNumberOfLines() == 2
    assert array(data.GetCellData(), "force_normal").tolist() == [3.0, 0.0]
    assert np.array_equal(array(data.GetCellData(), "force"), force)


def test_series_resumes_after_its_checkpoint(tmp_path):
    series = PvdSeries(tmp_path, "particles")
    for i in range(4):
        series.write_particles(0.1 * i, np.full((1, 3), i, float), {})
    series = PvdSeries(tmp_path, "particles", resume_time=0.1)
    assert [time for time, _ in read_pvd(series.path)] == [0.0, 0.1]
    assert len(list((tmp_path / "particles").iterdir())) == 2
    series.write_particles(0.2, np.full((1, 3), 9.0), {})
    time, file = read_pvd(series.path)[-1]
    assert (time, file.name) == (0.2, "particles_000002.vtp") and points(opened(file))[0, 0] == 9.0


def test_series_is_whole_after_every_file(tmp_path, monkeypatch):
    """Whoever reads while a run writes, and wherever it is killed, finds XML that names files which are there."""
    seen = []

    def look(*_):
        if path.is_file():
            listed = read_pvd(path)
            assert all(opened(file).GetNumberOfPoints() == 1 for _, file in listed)
            seen.append(len(listed))

    path = tmp_path / "particles.pvd"
    series = PvdSeries(tmp_path, "particles")
    replace, unlink = os.replace, Path.unlink
    monkeypatch.setattr(os, "replace", lambda *names: (look(), replace(*names), look()))
    monkeypatch.setattr(Path, "unlink", lambda *given, **options: (look(), unlink(*given, **options), look()))
    for i in range(4):
        series.write_particles(0.1 * i, np.full((1, 3), i, float), {})
    PvdSeries(tmp_path, "particles", resume_time=0.15)
    assert seen[:6] == [1, 1, 1, 1, 2, 2] and seen[-1] == 2 and max(seen) == 4
