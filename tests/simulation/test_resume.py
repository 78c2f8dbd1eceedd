"""A run continues only with its own checkpoint, scene and input files."""

import json
from pathlib import Path

import pytest

from emclutch.results import OutputError, RunFolder
from emclutch.results.checkpoint import write_checkpoint
from emclutch.scene.case import load_case
from emclutch.scene.input_files import hashed_input_files
from emclutch.simulation.resume import refuse_changed_files, refuse_other_scene, run_checkpoint
from emclutch.simulation.windows import whole_parts

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
CORNER = "v 35 0 {}\nv 36 0 0\nv 35 1 0\nf 1 2 3\n"


@pytest.fixture
def begun(tmp_path):
    """A scene that names a wall and a file of sizes, the folder of its run, and those files."""
    wall, sizes = tmp_path / "wall.obj", tmp_path / "sizes.csv"
    wall.write_text(CORNER.format("0.1"))
    sizes.write_text("diameter [mm]\n0.2\n0.21\n")
    changes = {
        "surfaces.vane": {"file": str(wall), "scale": 1e-3},
        "particles.sector": None,
        "particles.diameter": None,
        "particles.sizes": {"kind": "file", "file": str(sizes)},
    }
    case = load_case(GOOD, changes)
    folder = RunFolder.create(tmp_path / "run", case.toml())
    folder.write_provenance(input_files=hashed_input_files(case.scene))
    return case, folder, wall, sizes


def test_files_that_changed_are_named(begun):
    case, folder, wall, sizes = begun
    kept = json.loads(folder.provenance.read_text())["input_files"]
    assert {key: entry["path"] for key, entry in kept.items()} == {
        "particles.sizes.file": str(sizes), "surfaces.vane.file": str(wall)}  # fmt: skip
    refuse_changed_files(case, folder)
    wall.write_text(CORNER.format("0.2"))
    named = r"surfaces\.vane\.file = .*wall\.obj \(.*put the former file back.*--out"
    with pytest.raises(OutputError, match=named) as refused:
        refuse_changed_files(case, folder)
    assert "sizes.csv" not in str(refused.value)
    wall.write_text(CORNER.format("0.1"))  # the content counts, not its time
    refuse_changed_files(case, folder)


def test_a_run_of_an_older_version_goes_on_with_a_warning(begun):
    case, folder, wall, _ = begun
    folder.provenance.write_text('{"seed": 1}')
    with folder.logging():
        refuse_changed_files(case, folder)
    assert "whether they changed since is unknown" in folder.log.read_text()
    folder.write_provenance(input_files=hashed_input_files(case.scene))  # of its first resumption by this one
    wall.write_text(CORNER.format("0.2"))
    with pytest.raises(OutputError, match=r"wall\.obj"):
        refuse_changed_files(case, folder)


def test_a_curve_that_changed_is_named_in_short(tmp_path):
    """Its points stand in the resolved scene: the file is no part of a run any more."""
    rows = [f"{10.0 * k}, {0.01 * k}" for k in range(100)]
    texts = []
    for last in ("5000, 1.2", "5000, 1.3"):
        (tmp_path / "curve.csv").write_text("\n".join(["H [A/m], B [T]", *rows, last]))
        texts.append(load_case(GOOD, {"materials.mine": {"table": str(tmp_path / "curve.csv")}}).toml())
    with pytest.raises(OutputError, match=r"\(materials\.mine\.B: \[0\.0, .* \.\.\. -> ") as refused:
        refuse_other_scene(*texts, tmp_path)
    assert len(str(refused.value)) < 600


def test_broken_provenance_is_reported(begun):
    case, folder, *_ = begun
    for text in ("half {", "[]"):
        folder.provenance.write_text(text)
        with pytest.raises(OutputError, match=r"provenance\.json.*remove it"):
            refuse_changed_files(case, folder)


def test_a_key_that_an_older_scene_lacks_has_its_default(tmp_path):
    text = load_case(GOOD).toml()
    older = "\n".join(line for line in text.splitlines() if not line.startswith("steps_per_contact"))
    assert older != text.rstrip("\n")
    refuse_other_scene(older, text, tmp_path)
    other = load_case(GOOD, {"time.steps_per_contact": 77.0}).toml()
    with pytest.raises(OutputError, match=r"time\.steps_per_contact: .* -> 77\.0"):
        refuse_other_scene(older, other, tmp_path)


def test_a_checkpoint_of_something_else_is_reported(tmp_path):
    write_checkpoint(tmp_path / "checkpoint.h5", {"case": "", "window": 3})
    with pytest.raises(OutputError, match=r"is not a checkpoint of a run: it lacks steps_per_update, .*--out"):
        run_checkpoint(tmp_path / "checkpoint.h5")


def test_a_run_has_as_many_windows_whether_it_is_resumed_or_not():
    """Round-off of the end over the window takes no window away, and none goes beyond the end."""
    for window in (5e-5, 2e-3, 1e-6 / 3.0, 61 * 4.7e-8):
        for count in (1, 10, 501, 99_999):
            assert whole_parts(count * window, window) == whole_parts((count + 0.01) * window, window) == count


def test_a_checkpoint_of_windows_of_whole_updates_is_read(tmp_path):
    rest = dict.fromkeys(("case", "window", "dem", "rows", "magnetised", "source"), 0)
    write_checkpoint(tmp_path / "checkpoint.h5", rest | {"steps_per_update": 12, "updates": 5})
    assert run_checkpoint(tmp_path / "checkpoint.h5")["steps"] == 60
