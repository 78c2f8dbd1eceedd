"""Looking at a run: the script for ParaView names what the files hold, and pictures show it."""

import ast
import math
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from emclutch.cli import view
from emclutch.cli.view import view_run
from emclutch.results import OutputError
from emclutch.results.array_units import ARRAY_UNITS
from emclutch.results.view.look import LOOKS, MARGIN, camera, view_axes
from emclutch.results.view.paraview_script import NAME, private_script, write_script
from emclutch.results.view.run_files import COLOURS, read_run_files
from emclutch.results.vtk.data_set import array_names, read_data_set, read_texts
from emclutch.results.vtk.field_arrays import SectionArrays
from emclutch.results.vtk.series import PvdSeries
from emclutch.scene.errors import SceneError

TITLE = 'A "drum" \\ with\nits\'s # powder'


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Files as a run writes them: two moments of 20 grains between two rims, a section of air and disc."""
    folder = tmp_path_factory.mktemp("run")
    title = TITLE.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    (folder / "case.toml").write_text(f'[scene]\ntitle = "{title}"\n[particles]\nsector = 0.1\n')
    rng = np.random.default_rng(1)
    series = {name: PvdSeries(folder, name) for name in ("particles", "walls", "contacts", "field", "flux_lines")}
    rims = [SimpleNamespace(name=body, body=body, start=(r, -0.005), end=(r, 0.005))
            for body, r in (("disc", 0.02), ("rotor", 0.021))]  # fmt: skip
    section = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.01], [0.0, 0.01], [0.04, 0.0], [0.04, 0.01]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    for time in (0.0, 1e-3):
        angle, r, z = rng.uniform(0.0, 0.1, 20), rng.uniform(0.0201, 0.0209, 20), rng.uniform(-0.004, 0.004, 20)
        x = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
        arrays = {"radius": np.full(20, 1e-4), "velocity": rng.random((20, 3)), "magnetic_moment": rng.random((20, 3))}
        series["particles"].write_particles(time, x, arrays)
        series["walls"].write_walls(time, rims, angles={"rotor": 100.0 * time}, sector_angle=0.1)
        series["contacts"].write_contacts(time, x[:-1], x[1:], rng.random((19, 3)))
        series["flux_lines"].write_flux_lines(time, np.array([[[0.0, 0.005], [0.02, 0.005]]]), np.array([1e-6]))
        at_points = {"flux_density": rng.random((6, 2)), "vector_potential": rng.random(6)}
        cells = {"region": np.array([1, 1, 0, 0]), "flux_density": rng.random((4, 2))}
        series["field"].write_field(time, SectionArrays(section, triangles, cells, at_points, ["air", "disc"]))
    write_script(read_run_files(folder))
    return folder


def constants(script):
    """The values that a script's head gives its names."""
    found = {}
    for node in ast.parse(script.read_text(encoding="utf-8"), feature_version=(3, 10)).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            try:
                found[node.targets[0].id] = ast.literal_eval(node.value)
            except ValueError:
                pass
    return found


def test_script_names_files_arrays_and_regions_that_are_there(run):
    """Also an untrusted title stays a text."""
    known, files = constants(run / NAME), read_run_files(run)
    data = {name: read_data_set(written[0][1]) for name, written in files.series.items()}
    at_points = {name: array_names(one.GetPointData()) for name, one in data.items()}
    assert known["TITLE"] == TITLE and known["SECTOR"] == pytest.approx(math.degrees(0.1))
    coloured = {array for array, _ in known["QUANTITIES"].values()}
    assert coloured == {"velocity", "magnetic_moment", "diameter"} <= set(at_points["particles"])
    assert read_texts(data["field"], "region_names")[known["AIR"]] == "air"
    assert known["WHERE"] == "POINTS" and known["FIELDS"]["B"][0] in at_points["field"]
    assert [name for name, _ in known["REGIONS"]] == ["air", "disc"]
    assert known["REGIONS"][1][1] == pytest.approx(files.shades[1], abs=1e-3)
    assert list(known["BODIES"]) == ["disc", "rotor"] and "stripe" in array_names(data["walls"].GetCellData())
    assert all(label.endswith(f"[{ARRAY_UNITS[name].replace('m2', 'm²')}]") for name, label in COLOURS.values())


def test_a_script_that_was_edited_is_kept_and_not_executed(run, tmp_path, monkeypatch):
    """A folder may come from somebody else: ParaView gets a script that is made outside of it."""
    edited, flag = shutil.copytree(run, tmp_path / "edited"), tmp_path / "executed"
    planted = f"open({str(flag)!r}, 'w')"
    (edited / NAME).write_text(planted)
    write_script(read_run_files(edited))
    assert (edited / NAME).read_text() == planted
    program = tmp_path / "bin" / "paraview"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\nexec python3 "${1#--script=}"\n')  # runs the script, as ParaView does
    program.chmod(0o755)
    started = []
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr(view.subprocess, "Popen", lambda command, **_: started.append(command))
    view.open_in_paraview(edited)
    monkeypatch.undo()
    script = Path(started[0][1].removeprefix("--script="))
    subprocess.run(started[0], check=False, capture_output=True, timeout=60)  # ends for want of ParaView's package
    assert edited.resolve() not in script.resolve().parents and not flag.exists() and planted not in script.read_text()
    assert constants(script)["RUN"] == str(edited.resolve()) and script.parent.stat().st_mode & 0o077 == 0


def test_what_cannot_be_shown_is_refused(run, tmp_path):
    new, there = tmp_path / "new.png", tmp_path / "there.png"
    there.touch()
    for error, says, folder, given in (
        (SceneError, "none of speed, moment, diameter", run, {"colour": "force", "screenshot": new}),
        (SceneError, r"must end in \.gif or \.mp4", run, {"movie": tmp_path / "a.avi"}),
        (SceneError, "5 ms", run, {"time": "5 mm", "screenshot": new}),
        (SceneError, r"--time.*moments go from 0 s to 1 ms", run, {"time": "2 ms", "screenshot": new}),
        (OutputError, "no series", tmp_path, {}),
        (OutputError, "exists", run, {"screenshot": there}),
    ):
        with pytest.raises(error, match=says):
            view_run(folder, **given)


def test_of_a_ring_grains_in_front_of_the_drawn_half_are_left_out(run):
    from emclutch.results.view.frame_meshes import frame_meshes

    files = read_run_files(run)
    grains = {look: frame_meshes(files, 1e-3, LOOKS[look], "diameter", ring=True)["grains"] for look in LOOKS}
    assert grains["gap"].bounds[3] > 0.02 and grains["device"].bounds[3] < 5e-4 and grains["device"].bounds[2] < -0.02


def test_without_a_screen_the_options_that_need_none_are_named(run, monkeypatch, capsys):
    monkeypatch.setattr(view, "has_screen", lambda: False)
    with pytest.raises(SceneError, match=rf"view {run}: there is no screen for a window; add --screenshot"):
        view_run(run)
    with pytest.raises(SceneError, match="no screen"):
        view_run(run, time="0.6 ms")
    assert "nearest stored moment: 1 ms" in capsys.readouterr().err


PICTURES = """
import sys
from pathlib import Path
import numpy as np
from PIL import Image
from emclutch.results.view.look import HEAD_HEIGHT, LOOKS
from emclutch.results.view.pyvista_view import RunView, movie, screenshot
from emclutch.results.view.run_files import read_run_files

run, lone, out = map(Path, sys.argv[1:])
files = read_run_files(run)
for look in LOOKS:
    view = RunView(files, look, "moment", window=False, size=(300, 220))
    view.draw(1e-3)
    path = screenshot(view, out / f"{look}.png", None)
    assert Image.open(path).convert("RGB").getcolors(50) is None, f"{look} is blank"
with Image.open(movie(RunView(files, "chains", "speed", window=False, size=(200, 150)), out / "m.gif")) as moving:
    assert moving.n_frames == 2

view = RunView(read_run_files(lone), "gap", "diameter", window=False, size=(300, 300))
picture = np.asarray(Image.open(screenshot(view, out / "lone.png", None)).convert("RGB"))[70:256, 40:225]
radius = 150.0 * (1.0 - HEAD_HEIGHT) * 1e-4 / view.plotter.camera.parallel_scale
assert abs((picture.min(axis=2) < 230).sum() / (np.pi * radius**2) - 1.0) < 0.05, "a sphere has not its size"
"""


def test_pictures_off_screen_show_something_and_spheres_have_their_size(run, tmp_path):
    """In a process of its own: where OpenGL is missing, VTK ends the process."""
    PvdSeries(tmp_path, "particles").write_particles(0.0, np.zeros((1, 3)), {"radius": np.array([1e-4])})
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", PICTURES, str(run), str(tmp_path), str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    if done.returncode in (-signal.SIGSEGV, -signal.SIGABRT):
        pytest.skip("VTK finds neither EGL nor OSMesa here (libegl1, libosmesa6)")
    assert done.returncode == 0, done.stderr


def test_names_point_at_their_own_bodies_and_leaders_do_not_cross(run):
    from emclutch.results.view.frame_meshes import body_names, frame_meshes, name_places

    files = read_run_files(run)
    for ring in (False, True):
        axes = view_axes("gap", not ring)
        points, names = body_names(files, frame_meshes(files, 1e-3, ("grains", "walls"), "speed", ring=ring), axes)
        radii = dict(zip(names, np.hypot(*points.T[:2]), strict=True))
        assert radii == pytest.approx({"disc": 0.02, "rotor": 0.021}, 1e-4)
    axes = view_axes("device", True)
    points, names = body_names(files, frame_meshes(files, 1e-3, ("device",), None), axes)
    assert names == ["disc"] and 0.0 < points[0, 0] < 0.02 and 0.0 < points[0, 2] < 0.01
    rng = np.random.default_rng(2)
    parts = np.column_stack((rng.uniform(0.0, 0.04, 12), np.zeros(12), rng.uniform(0.0, 0.01, 12)))
    box = (-0.04, 0.04, -0.04, 0.0, 0.0, 0.01)
    start, end = (side @ np.transpose(axes) for side in (name_places(parts, box, axes), parts))
    assert np.ptp(start[:, 0]) < 1e-12 and start[0, 0] < (np.array(box)[[[0, 2, 4]]] @ axes[0]).min()
    for one in range(12):
        for other in range(one):
            assert not _cross(start[one], end[one], start[other], end[other])


def _cross(a, b, c, d):
    """Whether the segments a b and c d of the view's plane cross."""
    side = [np.sign(np.linalg.det(np.array([q - p, r - p])[:, :2])) for p, q, r in
            ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]  # fmt: skip
    return side[0] != side[1] and side[2] != side[3]


def test_edges_of_a_device_lie_where_bodies_meet_and_at_its_corners():
    """Of two rings side by side: in both cuts the outlines, and circles at corners and where their border ends."""
    import pyvista

    from emclutch.results.view.frame_meshes import device_edges

    points = np.array([(r, 0.0, z) for z in (0.0, 1.0, 2.0) for r in (1.0, 2.0)])
    section = pyvista.PolyData(points, faces=np.array([(3, 0, 1, 2), (3, 1, 3, 2), (3, 2, 3, 4), (3, 3, 5, 4)]).ravel())
    for region, circles in (([0, 0, 1, 1], 6), ([0, 0, 0, 0], 4)):
        section.cell_data["region"] = np.array(region)
        drawn = device_edges(section)
        lengths = drawn.compute_cell_sizes()["Length"]
        outline, border = 6.0, float(max(region))
        radii = 1.5 * circles  # half of the circles have radius 1, half 2
        assert lengths.sum() == pytest.approx(2.0 * (outline + border) + np.pi * radii, rel=1e-3)


def test_the_picture_of_a_device_is_filled_and_none_of_it_is_cut():
    """Its cylinder touches a border of what is free, within the margin."""
    box, aspect = (-0.1, 0.1, -0.1, 0.0, -0.02, 0.03), 1.3
    focus, _, _, half = camera("device", False, box, aspect, left=0.2)
    angles = np.linspace(np.pi, 2.0 * np.pi, 181)
    x, z = np.meshgrid(0.1 * np.exp(1j * angles), box[4:])
    rims = np.column_stack((x.real.ravel(), x.imag.ravel(), z.ravel()))
    seen = (rims - focus) @ np.transpose(view_axes("device", False))
    right, up = seen[:, 0] / (half * aspect), seen[:, 1] / half
    assert right.min() > 0.4 - 1.0 and right.max() < 1.0 and abs(up).max() < 1.0
    assert max(np.ptp(right) / 1.6, np.ptp(up) / 2.0) == pytest.approx(1.0 / MARGIN["device"], rel=0.01)


@pytest.mark.skipif(
    not (shutil.which("pvbatch") and shutil.which("xvfb-run")),
    reason="needs Debian's packages paraview, python3-paraview and xvfb",
)
def test_paraview_draws_the_script_of_a_run_that_was_moved(run, tmp_path):
    """Beside its own name the script finds ParaView's package, and its files where it lies now."""
    moved = shutil.copytree(run, tmp_path / "moved")
    command = ["xvfb-run", "-a", "-s", "-screen 0 400x300x24", "pvbatch", NAME, "--colour", "moment"]
    command += ["--size", "300", "220", "--time", "600 us", "--screenshot", "a.png"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, cwd=moved, env=environment, capture_output=True, text=True, timeout=300)
    if "vtkXOpenGLRenderWindow" in done.stderr:
        pytest.skip("no X server came up")
    assert done.returncode == 0 and "Error" not in done.stderr, done.stderr
    assert Image.open(moved / "a.png").convert("RGB").getcolors(50) is None  # it has more
    private = private_script(read_run_files(run))  # a copy elsewhere, as `emclutch view` makes
    command[command.index(NAME)] = str(private)
    command[1:2] = ["-a", "-n", "150"]  # the first server may still hold its number
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and (tmp_path / "a.png").exists(), done.stderr
