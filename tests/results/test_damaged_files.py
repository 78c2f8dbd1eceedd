"""Files of a run that are cut off, empty, foreign, of another version, or find no room: nothing is lost."""

import logging
import subprocess

import h5py
import numpy as np
import pytest
from full_disk import full_disk

from emclutch.results import HistoryWriter, OutputError, RunFolder, load_result, read_history
from emclutch.results.atomic_file import replace_text
from emclutch.results.checkpoint import read_checkpoint, write_checkpoint
from emclutch.results.folder_lock import has_files
from emclutch.results.record import Record
from emclutch.results.vtk.series import PvdSeries

SHARES = [0.0, 1e-3, 0.1, 0.5, 0.9, 0.999]  # of a file's length that are left of it


@pytest.mark.parametrize("share", SHARES)
def test_a_checkpoint_that_is_cut_off_is_reported(tmp_path, share):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"a": np.random.default_rng(0).random(3000), "b": {"c": "text"}})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(OutputError, match=r"cannot read .*checkpoint\.h5.*elsewhere with --out"):
        read_checkpoint(path)
    path.write_bytes(whole)
    assert read_checkpoint(path)["b"] == {"c": "text"}


def test_a_checkpoint_of_a_newer_version_is_reported(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"a": 1})
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = 3
    with pytest.raises(OutputError, match="has layout 3, this program reads 2; resume with the program that wrote it"):
        read_checkpoint(path)


def test_a_checkpoint_that_finds_no_room_leaves_the_former_one_and_takes_none(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"a": 1})
    with full_disk(20_000), pytest.raises(OSError) as refused:
        write_checkpoint(path, {"a": np.zeros(100_000)})
    assert refused.value.filename == str(path)
    assert read_checkpoint(path) == {"a": 1} and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("share", SHARES)
def test_a_record_that_is_cut_off_is_kept_beside_the_new_one(tmp_path, share):
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        record.append_grains(0, 0.0, {"position": np.random.default_rng(0).random((300, 3))})
    left = path.read_bytes()[: int(share * path.stat().st_size)]
    path.write_bytes(left)
    with Record.open(path, "a", resume_time=0.0) as record:
        record.append_grains(1, 1.0, {"position": np.zeros((300, 3))})
    assert (tmp_path / "run-broken-1.h5").read_bytes() == left and record.frames().tolist() == [1.0]


def rows(path, count):
    with HistoryWriter(path) as history:
        for number in range(1, count + 1):
            history.append({"time": 0.1 * number, "current": 1.0})


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (lambda whole: whole[: len(whole) // 2], r"can be read to t = 0\.\d+ s, and the checkpoint is at t = 0\.9 s"),
        (lambda whole: "", "holds no row that can be read"),
        (lambda whole: whole.splitlines()[0] + "\n", "holds no row that can be read"),
        (lambda whole: "x,y\n1,2\n", "holds no row that can be read"),
        (lambda whole: whole.replace("0.5,", "half,"), r"can be read to t = 0\.4 s"),
        (None, "holds no row that can be read"),
    ],
)
def test_rows_that_are_missing_before_the_checkpoint_are_reported(tmp_path, content, reported):
    """A mean over what is left would pass for that of the run."""
    path = tmp_path / "history.csv"
    rows(path, 10)
    if content is None:
        path.unlink()
    else:
        path.write_text(content(path.read_text()))
    before = path.read_bytes() if path.exists() else None
    with pytest.raises(OutputError, match=rf"history\.csv {reported}.*rows in between are missing.*--out"):
        HistoryWriter(path, resume_time=0.9)
    assert (path.read_bytes() if path.exists() else None) == before


@pytest.mark.parametrize(
    "content", [b"\xff\xfe\x00", b"x,y\n1,2\n", b"time,current\n0.1,one\n", b"time,current\n0.1\n"]
)
def test_a_history_of_something_else_is_reported(tmp_path, content):
    (tmp_path / "history.csv").write_bytes(content)
    with pytest.raises(OutputError, match=r"history\.csv is not the history of a run, or damaged"):
        read_history(tmp_path / "history.csv")


def test_a_history_without_a_window_is_reported(tmp_path):
    (tmp_path / "history.csv").write_text("")
    result = load_result(tmp_path)
    with pytest.raises(OutputError, match=r"history\.csv has no window yet; continue with: emclutch run .* --resume"):
        _ = result.torque
    with pytest.raises(OutputError, match="has no window yet"):
        _ = result.verdict
    assert "has no window yet; continue with: emclutch run" in result._repr_html_()


@pytest.mark.parametrize("name", ["summary", "plan", "provenance"])
@pytest.mark.parametrize("content", ["", "half {", "[]"])
def test_a_file_of_json_that_is_damaged_is_reported(tmp_path, name, content):
    folder = RunFolder(tmp_path)
    assert getattr(folder, f"read_{name}")() == {}
    getattr(folder, name).write_text(content)
    with pytest.raises(OutputError, match=rf"{name}\.json.*remove it"):
        getattr(folder, f"read_{name}")()


@pytest.mark.parametrize("content", ["", "<half", '<VTKFile><DataSet timestep="one" file="a"/></VTKFile>'])
def test_a_series_that_is_damaged_is_reported(tmp_path, content):
    (tmp_path / "walls.pvd").write_text(content)
    with pytest.raises(OutputError, match=r"walls\.pvd is not a series of a run.*move it elsewhere"):
        PvdSeries(tmp_path, "walls", resume_time=1.0)


def test_what_a_killed_process_had_begun_to_write_is_removed_and_nothing_else(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "a = 1")
    (folder.path / "field").mkdir()
    left = [folder.path / "case.toml.12.new", folder.path / "field" / "field_000001.vtu.12.new"]
    kept = [folder.path / "mine.new", folder.path / "replicas" / "01" / "checkpoint.h5.12.new"]
    kept[1].parent.mkdir(parents=True)
    for path in left + kept:
        path.write_text("half")
    RunFolder.create(folder.path, "a = 1", resume=True)
    assert [path.exists() for path in left + kept] == [False, False, True, True]


def test_a_folder_in_which_a_run_had_hardly_begun_is_empty(tmp_path):
    (tmp_path / "case.toml.12.new").write_text("half")
    (tmp_path / "emclutch.lock").write_text("")
    assert not has_files(tmp_path)
    assert RunFolder.create(tmp_path, "a = 1").case.read_text() == "a = 1"
    assert not (tmp_path / "case.toml.12.new").exists()


def test_only_a_run_that_has_nothing_to_lose_starts_anew(tmp_path):
    """Without a checkpoint a run may be resumed before its second window; later its rows would be lost."""
    folder = RunFolder.create(tmp_path / "run", "a = 1")
    assert not folder.has_checkpoint()
    rows(folder.history, 1)
    assert not folder.has_checkpoint()
    with pytest.raises(OutputError, match="continue it with --resume"):
        RunFolder.create(folder.path, "a = 1")
    rows(folder.history, 2)
    with pytest.raises(OutputError, match=r"nothing to resume in .*: it has no checkpoint\.h5.*--out"):
        folder.has_checkpoint()
    rows(folder.history, 1)
    folder.write_summary({})
    with pytest.raises(OutputError, match="nothing to resume"):
        folder.has_checkpoint()
    write_checkpoint(folder.checkpoint, {})
    assert folder.has_checkpoint()


def test_a_log_that_cannot_be_written_says_nothing_and_stops_nothing(tmp_path, capfd):
    folder = RunFolder.create(tmp_path / "run", "")
    with folder.logging():
        with full_disk():
            logging.getLogger("field").info("on a full disk")
    assert capfd.readouterr() == ("", "")
    with folder.logging():
        logging.getLogger("field").info("with room again")
    assert "with room again" in folder.log.read_text()


def test_a_text_that_finds_no_room_leaves_the_former_one(tmp_path):
    path = tmp_path / "summary.json"
    replace_text(path, "old")
    with full_disk(10), pytest.raises(OSError):
        replace_text(path, "new" * 1000)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


@pytest.fixture
def small_disk(tmp_path):
    """A file system of its own of 256 KiB, where this process may mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", place], capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", place], check=True)


def test_on_a_disk_that_is_really_full_the_last_checkpoint_and_the_record_stay(small_disk):
    folder = RunFolder.create(small_disk / "run", "a = 1")
    write_checkpoint(folder.checkpoint, {"window": 1})
    with Record.open(folder.record, "w") as record:
        record.append_grains(0, 0.0, {"position": np.zeros((30_000, 3))})
    before = folder.record.read_bytes()
    for _ in range(2):
        with pytest.raises(OSError, match="No space left"):
            write_checkpoint(folder.checkpoint, {"a": np.random.default_rng(0).random(100_000)})
        with pytest.raises(OSError, match="No space left"):
            record.append_grains(1, 1.0, {"position": np.random.default_rng(0).random((30_000, 3))})
    with pytest.raises(OSError, match="No space left"):
        folder.write_plan({"long": "x" * 300_000})
    assert read_checkpoint(folder.checkpoint) == {"window": 1} and folder.record.read_bytes() == before
    assert sorted(path.name for path in folder.path.iterdir()) == ["case.toml", "checkpoint.h5", "run.h5"]
    record.append_grains(1, 1.0, {"position": np.ones((30_000, 3))})
    assert record.frames().tolist() == [0.0, 1.0]


def test_a_disk_that_may_only_be_read_is_reported(small_disk):
    done = subprocess.run(["mount", "-o", "remount,ro", small_disk], capture_output=True)
    if done.returncode:
        pytest.skip("it cannot be mounted read-only here")
    with pytest.raises(OutputError, match=r"cannot write to .*Read-only file system; write elsewhere with --out"):
        RunFolder.create(small_disk / "run", "a = 1")
