"""The mesh of a clutch: closed-form areas and volumes, names, layers across gaps, gmsh left as it was."""

import signal
import subprocess
import sys

import numpy as np
import pytest

from geometry import Clutch, draw_section, mesh_clutch
from geometry.mesher import initialize_gmsh
from geometry.meshing import powder_faces

THIN_DISC = Clutch(
    disc_thickness=6e-3,
    seal_radius=20e-3,
    ring_width=7e-3,
    coil_width=8e-3,
    magnetic=frozenset({"disc", "rotor", "cover"}),
    coil_radius=54e-3,
)
CLUTCHES = {"drum": Clutch(), "thin disc": THIN_DISC, "no ring": Clutch(ring_width=0.0)}


@pytest.fixture(scope="module", params=CLUTCHES)
def meshed(request):
    clutch = CLUTCHES[request.param]
    return clutch, mesh_clutch(clutch)


def area_and_volume(corners):
    """Area and swept volume of a polygon (r, z), by Green's theorem."""
    (r, z), (s, w) = corners.T, np.roll(corners, -1, axis=0).T
    cross = r * w - s * z
    return 0.5 * cross.sum(), 2.0 * np.pi * np.sum((r + s) * cross) / 6.0


def elements_along(mesh, points):
    """Index of the element that each point lies in (the first, on an edge)."""
    corner = mesh.points[mesh.triangles]
    found = []
    for point in points:
        to = corner - point
        turn = to[:, :, 0] * np.roll(to, -1, axis=1)[:, :, 1] - to[:, :, 1] * np.roll(to, -1, axis=1)[:, :, 0]
        found.append(int(np.argmax(turn.min(axis=1) >= -1e-18)))
    return found


def test_every_region_has_its_closed_form_area_and_pappus_volume(meshed):
    clutch, mesh = meshed
    total = np.zeros(2)
    for name, polygons in clutch.section_polygons().items():
        exact = np.sum([area_and_volume(corners) for corners in polygons], axis=0)
        assert (mesh.area(name), mesh.volume(name)) == pytest.approx(tuple(exact), rel=1e-9), name
        total += exact
    R = clutch.air_radius  # a polygon inscribed in the half-circle lacks a little
    assert mesh.area("air") == pytest.approx(0.5 * np.pi * R**2 - total[0], rel=0.01)
    assert set(mesh.regions) == {*clutch.section_polygons(), "air"}
    assert mesh.volume("powder") == pytest.approx(clutch.volume_to_fill(), rel=1e-9)


def test_boundaries_have_their_closed_form_lengths(meshed):
    clutch, mesh = meshed
    lengths = {
        "axis": 2.0 * clutch.air_radius,
        "rotor_bore": clutch.cavity_length,
        "rotor_faces": 2.0 * (clutch.bore_radius - clutch.seal_radius),
        "disc_rim": clutch.disc_thickness,
        "disc_faces": 2.0 * (clutch.disc_radius - clutch.seal_radius),
        "seal_rim": 2.0 * clutch.face_gap,
    }
    for name, length in lengths.items():
        assert mesh.boundary_length(name) == pytest.approx(length, rel=1e-9), name
    assert set(mesh.boundaries) == {*lengths, "outer"}
    assert np.all(mesh.points[mesh.boundaries["axis"], 0] == 0.0)
    outer = np.linalg.norm(mesh.points[mesh.boundaries["outer"]], axis=2)
    assert outer == pytest.approx(np.full(outer.shape, clutch.air_radius), rel=1e-9)


@pytest.mark.parametrize("layers, factor, least", [(4, 1.0, 4), (6, 1.0, 6), (4, 2.0, 3)])
def test_a_line_across_each_gap_meets_enough_elements(layers, factor, least):
    clutch = Clutch()
    mesh = mesh_clutch(clutch, gap_layers=layers, size_factor=factor)
    across = (np.arange(60) + 0.5) / 60.0
    for z in np.linspace(-14.7e-3, 14.7e-3, 13):
        line = np.column_stack((clutch.disc_radius + across * clutch.gap, np.full(60, z)))
        assert len(set(elements_along(mesh, line))) >= least
    for r in np.linspace(41.2e-3, 44.3e-3, 5):
        line = np.column_stack((np.full(60, r), 15e-3 + across * clutch.face_gap))
        assert len(set(elements_along(mesh, line))) >= least


def test_triangles_are_well_shaped_and_few(meshed):
    _, mesh = meshed
    corner = mesh.points[mesh.triangles]
    edges = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
    quality = 4.0 * 3.0**0.5 * mesh.element_area() / (edges**2).sum(axis=1)  # 1: equilateral
    assert quality.min() > 0.2 and quality.mean() > 0.9
    assert 3000 < len(mesh.triangles) < 9000


def test_the_size_factor_scales_the_number_of_elements_like_its_inverse_square():
    coarse, fine = (len(mesh_clutch(Clutch(), size_factor=factor).triangles) for factor in (1.0, 0.5))
    assert 3.0 < fine / coarse < 4.5


def test_the_mesh_is_the_same_every_time():
    assert mesh_clutch(Clutch()).hash() == mesh_clutch(Clutch()).hash()


def test_gmsh_is_finalised_even_after_an_error_and_ctrl_c_stays_with_python(monkeypatch):
    import gmsh

    handler = signal.getsignal(signal.SIGINT)

    def fail(*_):
        raise RuntimeError("in the middle")

    monkeypatch.setattr("geometry.meshing._set_sizes", fail)
    with pytest.raises(RuntimeError, match="in the middle"):
        mesh_clutch(Clutch())
    assert not gmsh.isInitialized()
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.skipif(not hasattr(signal, "SIGPIPE"), reason="no such signal on this system")
@pytest.mark.parametrize("in_thread", [False, True])
def test_a_broken_pipe_stays_an_error_after_meshing(in_thread):
    """`gmsh.initialize` alone makes it end the process: a run whose replica had died was gone without a message."""
    mesh = "Thread(target=mesh_clutch, args=[Clutch()])" if in_thread else "mesh_clutch(Clutch())"
    program = f"""
import os
from threading import Thread
from geometry import Clutch, mesh_clutch
from geometry.mesher import initialize_gmsh
work = {mesh}
if isinstance(work, Thread):
    work.start(), work.join()
end, begin = os.pipe()
os.close(end)
try:
    os.write(begin, b"line")
except BrokenPipeError:
    print("an error")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.strip() == "an error", (done.returncode, done.stderr)


def test_a_gmsh_session_of_the_caller_is_left_as_it_was():
    import gmsh

    initialize_gmsh()
    try:
        gmsh.model.add("the caller's")
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 5)
        mesh = mesh_clutch(Clutch())
        assert gmsh.model.getCurrent() == "the caller's"
        assert gmsh.option.getNumber("Mesh.Algorithm") == 5
        assert "emclutch cross-section" not in gmsh.model.list()
    finally:
        gmsh.finalize()
    assert mesh.hash() == mesh_clutch(Clutch()).hash()


def test_the_file_holds_the_same_mesh_in_metres_with_names(tmp_path, capfd):
    meshio = pytest.importorskip("meshio")
    path = tmp_path / "clutch.msh"
    mesh = mesh_clutch(Clutch())
    mesh.write(path)
    assert capfd.readouterr().out == ""
    assert path.read_text().startswith("$MeshFormat\n2.2 ")
    stored = meshio.read(path)
    assert {name for name, (_, dim) in stored.field_data.items() if dim == 2} == set(mesh.regions)
    assert {name for name, (_, dim) in stored.field_data.items() if dim == 1} == set(mesh.boundaries)
    assert len(stored.cells_dict["triangle"]) == len(mesh.triangles)
    assert stored.points[:, 0].max() == pytest.approx(Clutch().air_radius, rel=0.01)


@pytest.mark.parametrize("options", [{"gap_layers": 2}, {"size_factor": 0.0}])
def test_bad_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        mesh_clutch(Clutch(), **options)


@pytest.mark.parametrize(
    "path, error, words",
    [("clutch.vtk", ValueError, "path"), ("no/such/folder/clutch.msh", FileNotFoundError, "no folder")],
)
def test_a_mesh_is_not_written_to_a_bad_path(path, error, words, tmp_path):
    with pytest.raises(error, match=words):
        mesh_clutch(Clutch(), size_factor=4.0).write(tmp_path / path)
    assert not list(tmp_path.iterdir())


def test_a_curve_on_no_other_face_of_the_powder_is_one_of_the_disc(monkeypatch):
    """Rounding in the mesher may put the middle of a curve off its face by more than the tolerance."""
    monkeypatch.setattr("geometry.meshing.powder_faces", lambda *at: powder_faces(*at) | {"disc_faces": False})
    length = 2.0 * (Clutch().disc_radius - Clutch().seal_radius)
    assert mesh_clutch(Clutch()).boundary_length("disc_faces") == pytest.approx(length, rel=1e-9)


def test_the_picture_needs_no_display_and_no_pyplot(tmp_path):
    mesh = mesh_clutch(Clutch(), size_factor=2.0)
    picture = draw_section(mesh, tmp_path / "section.png", "A clutch")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_importing_the_package_loads_neither_gmsh_nor_matplotlib():
    code = "import sys, geometry; sys.exit(bool({'gmsh', 'matplotlib'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
