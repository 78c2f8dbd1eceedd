"""An untrusted scene is data: it keeps the promises of docs/how_to/untrusted_scenes.md."""

from __future__ import annotations

import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.device_model.device import build_device
from emclutch.results import OutputError
from emclutch.results.checkpoint import read_checkpoint, write_checkpoint
from emclutch.results.errors import RunError
from emclutch.results.folder_lock import LOCK, locked_folder
from emclutch.results.record import Record
from emclutch.results.vtk.series import PvdSeries
from emclutch.scene.case import DEEPEST, MAX_FILE, case_from, load_case, read_toml
from emclutch.scene.errors import SceneError
from emclutch.simulation.check import check
from emclutch.simulation.forecast import space
from emclutch.simulation.forecast.space import disk, memory
from emclutch.simulation.plan import make_plan
from emclutch.simulation.run import run
from geometry.file_content import CadError
from geometry.mesher import GROWTH, expected_triangles
from geometry.surface_import import triangle_wall_from_file
from particles.packing import file_packing
from particles.packing.file_packing import read_packing

CASES = Path(__file__).parents[2] / "cases"
BOX = {
    "scene": {"title": "A box"},
    "geometry": {"kind": "box", "size": ["10 mm", "10 mm", "10 mm"]},
    "particles": {"diameter": "2 mm", "count": 3},
    "effects": {"gravity": {}},
    "time": {"end": "0.1 ms"},
    "output": {"snapshots": 0, "pictures": False},
}


def refused(folder: Path, values: dict, command: str = "check") -> str:
    """What is said of the box with other values; exit code 2."""
    file = folder / "scene.toml"
    data = case_from(BOX).data
    for key, value in values.items():
        section, dot, name = key.partition(".")
        data |= {section: data.get(section, {}) | {name: value} if dot else value}
    file.write_text(tomli_w.dumps(data), encoding="utf-8")
    result = CliRunner().invoke(app, [command, str(file)])
    assert result.exit_code == 2 and "Traceback" not in result.output, result.output
    return result.stderr


# -- sizes


def test_grains_beyond_any_machine_are_refused_before_they_are_drawn(tmp_path):
    sizes = {"kind": "uniform", "min": "0.9 um", "max": "1 um"}
    words = refused(tmp_path, {"particles": {"sizes": sizes, "solid_fraction": 0.3}})
    assert "particles.solid_fraction" in words and "at most 1e+07" in words
    assert "particles.count" in refused(tmp_path, {"particles.count": 20_000_000})


def test_steps_beyond_a_lifetime_are_refused(tmp_path):
    words = refused(tmp_path, {"time.end": "1e4 s", "contact.stiffness": "1e11 N/m"})
    assert "time.end" in words and "at most 1e+12" in words


def test_windows_and_snapshots_count_in_memory_and_disk():
    scene = case_from(BOX, {"output.snapshots": 100}).scene
    device = build_device(scene)
    assert memory(scene, device, 10**6) - memory(scene, device, 10) > 1e3
    assert disk(scene, device, 10**6) - disk(scene, device, 10) > 1e3
    fewer = case_from(BOX, {"output.snapshots": 10}).scene
    assert disk(scene, device, 10) > disk(fewer, device, 10)


def test_a_run_that_would_fill_the_disk_is_refused_unless_forced(tmp_path, monkeypatch):
    monkeypatch.setattr(space.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 2**20}))
    with pytest.raises(RunError, match=r"MiB of disk, and 1 MiB are free.*output\.snapshots.*--force"):
        run(case_from(BOX), out=tmp_path / "run")
    space.refuse_full_disk(100.0, tmp_path, force=True)


@pytest.mark.parametrize("case", ["quickstart", "slotted_disc"])
def test_meshes_beyond_any_machine_are_refused_before_they_are_made(case):
    finest = {"field.size_factor": 0.2, "field.gap_layers": 40, "effects.back_reaction": None}
    with pytest.raises(ValueError, match=r"(triangles|tetrahedra); allowed: at most .*raise field\.size_factor"):
        make_plan(load_case(CASES / f"{case}.toml", finest))


def test_the_number_of_triangles_is_predicted():
    """Within a factor of two, of the device of the quickstart as it is and finer."""
    from geometry.meshing import _expected, mesh_clutch

    clutch = load_case(CASES / "quickstart.toml").scene.shape()
    for factor in (1.0, 0.5):
        found, predicted = len(mesh_clutch(clutch, size_factor=factor).triangles), _expected(clutch, 4.0, factor)
        assert 0.5 * found < predicted < 2.0 * found
    assert expected_triangles([(0.1, 1.0, 0.0)]) == pytest.approx(20.0 / GROWTH / (3**0.5 / 4.0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 5000 + "]" * 5000, "nests tables"),
        ("[" + ".".join("a" * (DEEPEST + 5)) + "]\nb = 1", "nests tables"),
        ("[" + ".".join("a" * 5000) + "]\nb = 1", "nests tables"),
        ("a = " + "1" * 5000, "is not TOML"),
        ('[coil]\nturns = 1\n# once more\n"turns" = 2', "gives the key coil.turns twice, in lines 2 and 4; keep one"),
        ("[a]\n[b] # of it\n[ a ]", r"gives the table \[a\] twice, in lines 1 and 3"),
        ('a = 1\nb = """\na = 2"""\nc = ', r"is not TOML: Invalid value"),
        ("[b]\na = [0x" + "f" * 5000 + "]", r"\n  - b\.a holds a whole number of more than 64 bits"),
        ("a = '" + "x" * MAX_FILE + "'", "larger than 20 MB"),
    ],
)
def test_files_that_only_python_would_stumble_on(tmp_path, text, words):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError, match=words):
        read_toml(tmp_path / "scene.toml")


def test_a_device_is_read_no_further_than_a_file_may_be_long():
    with pytest.raises(SceneError, match="larger than 20 MB"):
        read_toml(Path("/dev/zero"))


def test_a_study_of_too_many_points_is_refused_before_they_are_listed(tmp_path):
    values = {f"particles.{key}": list(range(1, 1001)) for key in ("count", "density", "susceptibility")}
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(BOX))
    (tmp_path / "study.toml").write_text(tomli_w.dumps({"study": {"case": "scene.toml", "values": values}}))
    result = CliRunner().invoke(app, ["sweep", str(tmp_path / "study.toml")])
    assert result.exit_code == 2 and "study.values makes 1e+09 points" in result.stderr


def test_packing_files_are_refused_by_what_they_say_of_their_size(tmp_path, monkeypatch):
    """An archive that unpacks to more than is allowed, an array whose head lies, points that are not there."""
    bomb = tmp_path / "bomb.npz"
    np.savez_compressed(bomb, position=np.zeros((200_000, 3)))
    monkeypatch.setattr(file_packing, "MAX_BYTES", 1_000_000)
    assert bomb.stat().st_size < 100_000
    with pytest.raises(ValueError, match=r"holds 4.8e\+06 bytes of arrays; allowed"):
        read_packing(bomb, radius=1e-3)
    liar = tmp_path / "liar.npz"
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 3), }"
    with zipfile.ZipFile(liar, "w") as archive:
        archive.writestr("position.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
    with pytest.raises(ValueError, match="not an npz archive of arrays"):
        read_packing(liar, radius=1e-3)
    points = tmp_path / "points.vtp"
    points.write_text('<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="999999999999"></Piece></PolyData>')
    with pytest.raises(ValueError, match=r"holds 2.4e\+13 bytes"):
        read_packing(points, radius=1e-3)


def test_tables_are_refused_by_their_length(tmp_path, monkeypatch):
    monkeypatch.setattr("geometry.table_file.MAX_FILE", 10)
    (tmp_path / "grains.csv").write_text("x [mm], y [mm], z [mm]\n1, 2, 3\n")
    words = refused(tmp_path, {"particles": {"packing": "file", "packing_file": "grains.csv", "diameter": "2 mm"}})
    assert "particles.packing_file" in words and "larger than" in words


def test_a_curve_is_not_read_from_a_device(tmp_path):
    words = refused(tmp_path, {"materials": {"mine": {"law": "table", "table": "/dev/zero"}}})
    assert "materials.mine.table" in words and "is a device, a pipe" in words


def test_surfaces_finer_than_any_wall_needs_are_refused(tmp_path):
    from step_file import write_step

    def build(occ):
        occ.addRectangle(0.0, 0.0, 0.0, 10.0, 10.0)
        return ["tile"]

    file = write_step(tmp_path / "tile.step", build)
    with pytest.raises(CadError, match="triangles; allowed"):
        triangle_wall_from_file(file, "tile", "housing", size=1e-6)
    assert len(triangle_wall_from_file(file, "tile", "housing", size=5e-3).triangles) > 1


# -- files


def links(folder: Path) -> dict[str, object]:
    """Names in an HDF5 file that stand for something else."""
    with h5py.File(folder / "other.h5", "w") as file:
        file["secret"] = np.arange(3.0)
    return {
        "into another file": h5py.ExternalLink("other.h5", "/secret"),
        "to another name": h5py.SoftLink("/h5md"),
    }


def spoil(path: Path, kind: str, folder: Path) -> None:
    """Put a name that leads elsewhere into a file."""
    with h5py.File(path, "a") as file:
        inside = file["state"] if "state" in file else file["observables"]
        if kind == "another name of":
            inside["again"] = file["/"]
        elif kind == "its values in another file":
            (folder / "raw").write_bytes(bytes(80))
            inside.create_dataset("again", (10,), "f8", external=[(str(folder / "raw"), 0, 80)])
        elif kind == "has its values":
            layout = h5py.VirtualLayout((3,), "f8")
            layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "secret", (3,))
            inside.create_virtual_dataset("again", layout)
        else:
            inside["again"] = links(folder)[kind]


@pytest.mark.parametrize(
    "kind",
    ["into another file", "to another name", "another name of", "its values in another file", "has its values"],
)
def test_hdf5_files_are_not_left(tmp_path, kind):
    links(tmp_path)
    before = (tmp_path / "other.h5").read_bytes()
    checkpoint = tmp_path / "checkpoint.h5"
    write_checkpoint(checkpoint, {"a": 1.0})
    spoil(checkpoint, kind, tmp_path)
    with pytest.raises(OutputError, match=rf"state/again .*{kind}.*do not trust it"):
        read_checkpoint(checkpoint)
    Record.open(tmp_path / "run.h5", "w").close()
    spoil(tmp_path / "run.h5", kind, tmp_path)
    for mode, time in (("r", None), ("a", 0.0)):  # that which continues would cut back what lies behind a link
        with pytest.raises(OutputError, match=rf"observables/again .*{kind}"):
            Record.open(tmp_path / "run.h5", mode, resume_time=time)
    assert (tmp_path / "other.h5").read_bytes() == before


def test_a_checkpoint_holds_no_more_than_its_file(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"a": 1.0})
    with h5py.File(path, "a") as file:
        huge = file["state"].create_dataset("b", (10**12,), "f8", chunks=(1024,))
        huge.attrs["kind"] = "array"
    with pytest.raises(OutputError, match=r"/state/b is to have 8000000000000 bytes, in a file of"):
        read_checkpoint(path)


def test_paths_that_lead_out_of_the_scenes_folder_are_reported(tmp_path, monkeypatch):
    home, elsewhere = tmp_path / "home", tmp_path / "elsewhere"
    home.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(home)
    (elsewhere / "grains.csv").write_text("x [mm], y [mm], z [mm]\n0, 0, 3\n")
    (elsewhere / "curve.csv").write_text("H [A/m], B [T]\n0, 0\n200, 0.9\n1000, 1.4\n10000, 1.8\n")
    (home / "link.csv").symlink_to(elsewhere / "curve.csv")
    (home / "own.csv").write_text((elsewhere / "curve.csv").read_text())

    def reported(packing_file: str, curve: str, folder: str) -> str:
        data = BOX | {
            "particles": {"packing": "file", "packing_file": packing_file, "diameter": "2 mm"},
            "materials": {"mine": {"law": "table", "table": curve}},
            "output": {"folder": folder},
        }
        (home / "scene.toml").write_text(tomli_w.dumps(data))
        return check(home / "scene.toml").decisions.get("paths", "")

    words = reported("../elsewhere/grains.csv", "link.csv", str(elsewhere / "run"))
    for key in ("particles.packing_file = ", "materials.mine.table = ", "output.folder = "):
        assert f"{key}{elsewhere.resolve()}" in words
    (home / "grains.csv").write_text((elsewhere / "grains.csv").read_text())
    assert reported("grains.csv", "own.csv", "runs/one") == ""


def test_a_folder_of_a_run_reaches_no_file_outside_it(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("mine")
    folder = tmp_path / "run"
    folder.mkdir()
    for file in ("../precious", str(precious)):
        (folder / "walls.pvd").write_text(
            f'<VTKFile><Collection><DataSet timestep="9" file="{file}"/></Collection></VTKFile>'
        )
        with pytest.raises(OutputError, match="is outside its folder"):
            PvdSeries(folder, "walls", resume_time=1.0)
    for target in (precious, tmp_path / "not there"):
        (folder / LOCK).symlink_to(target)
        with pytest.raises(OutputError, match="is a symbolic link; remove it"), locked_folder(folder):
            pass
        (folder / LOCK).unlink()
    assert precious.read_text() == "mine" and not (tmp_path / "not there").exists()


# -- words


def test_what_a_terminal_would_obey_is_not_printed(tmp_path):
    assert "scene.title" in refused(tmp_path, {"scene.title": "a\x1b[2Jb"})
    words = refused(tmp_path, {"scene.a\x1b]0;b": 1})
    assert "\x1b" not in words and "scene.a\\x1b]0;b" in words
