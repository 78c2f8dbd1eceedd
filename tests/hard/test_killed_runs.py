"""Runs that are killed, whose disk is full, whose folder is gone or damaged: they continue, or say why not.

`make stability` kills many more (tests/hard/kills.py), in scenes that have every effect.
"""

import shutil

import pytest
from full_disk import full_disk
from killed_run import Death, KilledRun, differences, record_of
from sheared_annulus import CELL
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.results import OutputError, RunFolder, load_result, read_history
from emclutch.results.checkpoint import read_checkpoint, write_checkpoint
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.report.verdict import verdict
from emclutch.scene.case import case_from
from particles import ParticleError

TOY = {
    "time.end": "60 us", "time.window": "10 us", "accuracy.replicas": 1,
    "output.snapshots": 3, "output.formats": ["hdf5", "vtk"],
}  # fmt: skip
CASE = case_from(CELL, TOY)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The record of a run that nobody disturbs, and its folder."""
    folder = tmp_path_factory.mktemp("undisturbed")
    (folder / "scene.toml").write_text(CASE.toml(), encoding="utf-8")
    run = KilledRun(folder / "scene.toml", folder / "run")
    run.live()
    return record_of(run.folder), run


@pytest.mark.slow
def test_a_run_that_is_killed_four_times_ends_as_an_undisturbed_one(undisturbed, tmp_path):
    """While it plans, in its first window, with a checkpoint half moved, and just after it began to write a record."""
    whole, alone = undisturbed
    run = KilledRun(alone.source, tmp_path / "run")
    for death in (Death(6), Death(14), Death(40), Death(36, 1e-3)):
        assert run.live(death) is None
    assert run.live() is not None
    assert run.moments["mesh, packing"] >= 1 and sum(run.moments.values()) == 4
    assert len(whole) > 100 and differences(record_of(run.folder), whole) == []
    assert "has no checkpoint yet: the run starts again" in (run.folder / "run.log").read_text()


class At:
    """Does something once a fraction of the run is done."""

    def __init__(self, share, act):
        self.share, self.act = share, act

    def update(self, fraction, text):
        if self.act is not None and fraction >= self.share:
            act, self.act = self.act, None
            act()


def test_on_a_full_disk_a_run_stops_and_goes_on_once_there_is_room(undisturbed, tmp_path):
    out, full = tmp_path / "run", full_disk()
    try:
        words = r"run: File too large; check .* its free space .*continue with: .*run --resume"
        with pytest.raises(OutputError, match=words):
            emclutch.run(CASE, out=out, progress=At(0.5, full.__enter__))
    finally:
        full.__exit__(None, None, None)
    emclutch.run(CASE, out=out, resume=True)
    assert differences(record_of(out), undisturbed[0]) == []


def test_a_folder_that_vanishes_is_reported(tmp_path):
    out = tmp_path / "run"
    with pytest.raises(OutputError, match=r"run/.*: No such file or directory; .* then start again"):
        emclutch.run(CASE, out=out, progress=At(0.5, lambda: shutil.rmtree(out)))
    assert not out.exists()


def test_a_run_stopped_before_its_first_window_starts_anew(undisturbed, tmp_path):
    def stop():
        raise KeyboardInterrupt

    out = tmp_path / "run"
    with pytest.raises(Interrupted):
        emclutch.run(CASE, out=out, progress=At(0.0, stop))
    assert not (out / "history.csv").exists()
    with pytest.raises(OutputError, match=r"belongs to another scene \(contact\.friction"):
        emclutch.run(CASE.with_values({"contact.friction": 0.9}), out=out, resume=True)
    emclutch.run(CASE, out=out, resume=True)
    assert differences(record_of(out), undisturbed[0]) == []


@pytest.mark.parametrize("name", ["history.csv", "checkpoint.h5"])
def test_rows_or_arrays_that_are_missing_are_bad_input_and_nothing_is_changed(undisturbed, tmp_path, name):
    out = tmp_path / "run"
    shutil.copytree(undisturbed[1].folder, out)
    if name == "history.csv":
        whole = (out / name).read_text().splitlines(keepends=True)
        (out / name).write_text("".join(whole[:3]))
    else:
        state = read_checkpoint(out / name)
        del state["dem"]["counters"]
        write_checkpoint(out / name, state)
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    done = CliRunner().invoke(app, ["run", str(out), "--resume"])
    assert done.exit_code == 2 and "Traceback" not in done.output
    assert name in done.output and "--out" in done.output
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before


@pytest.mark.parametrize("content", [b"", b"half", None])
def test_a_checkpoint_that_is_none_is_bad_input_and_changes_nothing(undisturbed, tmp_path, content):
    """Zero bytes, something else, another program's; the files stay as they are."""
    out = tmp_path / "run"
    shutil.copytree(undisturbed[1].folder, out)
    if content is None:
        write_checkpoint(out / "checkpoint.h5", {"of": "something else"})
    else:
        (out / "checkpoint.h5").write_bytes(content)
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    done = CliRunner().invoke(app, ["run", str(out), "--resume"])
    assert done.exit_code == 2 and "Traceback" not in done.output
    assert "checkpoint.h5" in done.output and "--out" in done.output
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before


def test_a_run_that_fails_for_its_scene_says_when_and_why_and_offers_no_resuming(tmp_path):
    def fail():
        raise ParticleError("grain 3 has left the device; raise contact.stiffness")

    folder = RunFolder(tmp_path / "run")
    with pytest.raises(RunError, match="grain 3 has left"):
        emclutch.run(CASE, out=folder.path, progress=At(0.4, fail))
    reached = float(read_history(folder.history)["time"].iloc[-1])
    assert folder.read_failure().time == reached > 0.0
    first = verdict(load_result(folder.path))[0].text
    page = CliRunner().invoke(app, ["report", str(folder.path)])
    assert page.exit_code == 0
    for text in (first, page.output):
        assert f"he run failed after {1e6 * reached:.3g} µs: grain 3 has left" in text and "--resume" not in text
    with pytest.raises(OutputError) as again:
        emclutch.run(CASE, out=folder.path)
    assert "--resume" not in str(again.value)
    emclutch.run(CASE, out=folder.path, resume=True)  # by a program that mends it, say
    assert folder.read_failure() is None and load_result(folder.path).summary
