"""A run's folder: nothing is overwritten, everything reads back, a resumed run continues exactly."""

import io
import json
import logging
from pathlib import Path

import h5py
import numpy as np
import pytest

from emclutch.results import (
    COLUMNS,
    HistoryWriter,
    OutputError,
    Progress,
    RunFolder,
    load_result,
    read_history,
)
from emclutch.results.checkpoint import read_checkpoint, write_checkpoint
from emclutch.results.record import Record
from emclutch.results.statistics import steady_mean
from emclutch.scene.case import load_case
from emclutch.simulation.resume import refuse_earlier_end
from emclutch.simulation.run import run

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"


def test_folder_with_files_is_not_overwritten(tmp_path):
    (tmp_path / "precious.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"is not empty; write elsewhere with --out"):
        RunFolder.create(tmp_path, "a = 1")
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]


def test_finished_folder_offers_to_resume(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "a = 1")
    write_checkpoint(folder.checkpoint, {})
    with pytest.raises(OutputError, match="--resume"):
        RunFolder.create(tmp_path / "run", "a = 1")
    again = RunFolder.create(tmp_path / "run", "a = 2", resume=True)
    assert again.case.read_text() == "a = 2"
    assert (tmp_path / "run" / "case-1.toml").read_text() == "a = 1"


def test_the_conclusion_of_an_earlier_scene_is_moved_aside(tmp_path):
    """While a run goes on with another scene, and where that fails, its folder has no page of the old one."""
    folder = RunFolder.create(tmp_path / "run", "a = 1")
    write_checkpoint(folder.checkpoint, {})
    folder.write_summary({"torque": 1.0})
    folder.index.write_text("1 N m")
    RunFolder.create(folder.path, "a = 1", resume=True)
    assert folder.index.is_file() and folder.summary.is_file()  # the same scene: they are its
    RunFolder.create(folder.path, "a = 2", resume=True)
    assert not folder.index.exists() and not folder.summary.exists()
    assert (folder.path / "index-1.html").read_text() == "1 N m" and (folder.path / "summary-1.json").is_file()


def test_unusable_folders_are_explained(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file"):
        RunFolder.create(tmp_path / "file", "")
    with pytest.raises(OutputError, match=r"cannot write to .*--out"):
        RunFolder.create(tmp_path / "file" / "below", "")
    with pytest.raises(OutputError, match="nothing to resume"):
        RunFolder.create(tmp_path / "none", "", resume=True)
    assert not (tmp_path / "none").exists()


def test_next_free_number(tmp_path):
    assert RunFolder.next_path("case", tmp_path / "runs").name == "case-001"
    for name in ("case-001", "case-007", "case-two", "other-009"):
        (tmp_path / name).mkdir()
    assert RunFolder.next_path("case", tmp_path).name == "case-008"


def test_provenance_and_summary_are_json_without_nan(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "")
    folder.write_provenance(seed=3, mesh_hash="ab", threads=2, threading_layer="omp")
    folder.write_provenance(seed=4)
    found = json.loads(folder.provenance.read_text())
    assert (found["seed"], found["mesh_hash"], found["threads"]) == (3, "ab", 2)
    assert found["resumed"][0]["seed"] == 4 and found["versions"]["numpy"] == np.__version__
    assert found["machine"]["cores"] >= 1 and found["python"]
    folder.write_summary({"a": np.float64("nan"), "b": np.arange(2), "c": [float("inf"), np.int64(2)], "d": True})
    assert "NaN" not in folder.summary.read_text()
    assert folder.read_summary() == {"a": None, "b": [0, 1], "c": [None, 2], "d": True}


def test_log_takes_the_packages_messages_only(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "")
    with folder.logging():
        logging.getLogger("field.newton").info("three iterations")
        logging.getLogger("matplotlib").info("noise")
    logging.getLogger("field").warning("after the run")
    text = folder.log.read_text()
    assert text.rstrip().endswith("INFO    three iterations") and "noise" not in text and "after" not in text


def test_history_round_trip_is_exact(tmp_path):
    rows = [{"steps": np.int64(i), "time": 0.1 * i, "torque_disc": np.float64(1 / (i + 3))} for i in range(5)]
    with HistoryWriter(tmp_path / "history.csv") as history:
        for row in rows:
            history.append(row)
            assert len(read_history(tmp_path / "history.csv")) == row["steps"] + 1  # flushed
    table = read_history(tmp_path / "history.csv")
    assert list(table.columns) == ["time", "torque_disc", "steps"]
    assert table["torque_disc"].tolist() == [row["torque_disc"] for row in rows]
    assert table.attrs["units"]["torque_disc"] == COLUMNS["torque_disc"].unit == "N m"


def test_history_resumes_after_its_checkpoint(tmp_path):
    path = tmp_path / "history.csv"
    with HistoryWriter(path) as history:
        for i in range(1, 6):
            history.append({"time": 0.1 * i, "current": float(i)})
    whole = path.read_text()
    path.write_text(whole[:-4])  # a last row cut off by a crash
    assert len(read_history(path)) == 4
    with HistoryWriter(path, resume_time=0.1 * 3) as history:
        for i in range(4, 6):
            history.append({"time": 0.1 * i, "current": float(i)})
    assert path.read_text() == whole


def test_history_refuses_unknown_changed_and_broken_values(tmp_path):
    with HistoryWriter(tmp_path / "history.csv") as history:
        with pytest.raises(OutputError, match="torque_dics"):
            history.append({"time": 0.0, "torque_dics": 1.0})
        history.append({"time": 0.0, "current": None})
        with pytest.raises(OutputError, match="columns changed within a run: steps"):
            history.append({"time": 0.0, "current": 1.0, "steps": 1})
        with pytest.raises(OutputError, match=r"current = nan A at t = 0.5 s"):
            history.append({"time": 0.5, "current": float("nan")})


def test_record_is_laid_out_like_h5md_in_the_order_of_the_ids(tmp_path):
    rng = np.random.default_rng(0)
    position = rng.random((4, 6, 3))
    path = tmp_path / "run.h5"
    with Record.open(path, "w", case_text="a = 1", provenance_text="{}") as record:
        for i in range(4):
            order = rng.permutation(6)
            record.append_grains(
                10 * i, 0.1 * i, {"position": position[i][order], "particle_id": order, "radius": np.ones(6)}
            )
            record.append_observables({"time": 0.1 * i, "torque_disc": float(i), "current": None})
    with h5py.File(path) as file:
        assert file["h5md"].attrs["version"].tolist() == [1, 1]
        assert np.array_equal(file["particles/grains/position/value"], position)
        assert file["particles/grains/position/step"][:].tolist() == [0, 10, 20, 30]
        assert file["particles/grains/position/value"].attrs["unit"] == "m"
        assert file["observables/torque_disc/value"].attrs["unit"] == "N m"
        assert file["parameters/case"].asstr()[()] == "a = 1"
    reader = Record.open(path)
    assert reader.frames().tolist() == [0.0, 0.1, 0.2, 0.1 * 3]
    assert np.array_equal(reader.grains(2)["position"], position[2])
    assert reader.observable("torque_disc")[1].tolist() == [0.0, 1.0, 2.0, 3.0]
    with pytest.raises(OutputError, match="it has torque_disc"):
        reader.observable("nothing")
    with pytest.raises(OutputError, match="reading only"):
        reader.append_grains(0, 0.0, {})


def test_record_resumes_after_its_checkpoint(tmp_path):
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        for i in range(4):
            record.append_grains(i, 0.1 * i, {"position": np.full((2, 3), i, float)})
            record.append_observables({"time": 0.1 * i, "current": float(i)})
    with Record.open(path, "a", resume_time=0.1) as record:
        record.append_grains(2, 0.2, {"position": np.full((2, 3), 9.0)})
        record.append_observables({"time": 0.2, "current": 9.0})
    assert record.frames().tolist() == [0.0, 0.1, 0.2]
    assert record.grains()["position"][0, 0] == 9.0
    assert record.observable("current")[1].tolist() == [0.0, 1.0, 9.0]
    with pytest.raises(OutputError, match="number of grains must not change"):
        record.append_grains(3, 0.3, {"position": np.zeros((3, 3))})
    with pytest.raises(OutputError, match="not finite"):
        record.append_grains(3, 0.3, {"position": np.full((2, 3), np.nan)})


def test_broken_record_does_not_stop_a_resumed_run(tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(b"half a file")
    with Record.open(path, "a", resume_time=0.0) as record:
        record.append_grains(0, 0.0, {"position": np.zeros((1, 3))})
    assert (tmp_path / "run-broken-1.h5").read_bytes() == b"half a file"


def same(a, b):
    if isinstance(a, dict):
        return type(b) is dict and a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return type(b) is np.ndarray and (a.dtype, a.shape) == (b.dtype, b.shape) and a.tobytes() == b.tobytes()
    if isinstance(a, float):
        return type(a) is type(b) and np.float64(a).tobytes() == np.float64(b).tobytes()
    return type(a) is type(b) and a == b


def test_checkpoint_returns_every_bit(tmp_path):
    state = {
        "grains": {
            "position": np.random.default_rng(0).random((5, 3)),
            "none": None,
            "empty": np.zeros((0, 3)),
        },
        "odd": np.array([np.nan, -0.0, np.inf, 5e-324]),
        "types": {k: np.arange(3).astype(k) for k in ("bool", "int8", "int32", "uint64", "float32", "complex128")},
        "point": np.array(3.5),
        "numbers": [True, False, 2, -(2**70), 0.1, float("-inf"), float("nan"), np.int32(4), np.float32(0.1)],
        "texts": ("", "Größe", b"\x00\x01", "a/b"),
        "random": np.random.default_rng(5).bit_generator.state,
        "nothing": {},
        "many": {f"x{i}": i for i in range(12)},
    }
    write_checkpoint(tmp_path / "checkpoint.h5", {"former": 1})
    write_checkpoint(tmp_path / "checkpoint.h5", state)
    back = read_checkpoint(tmp_path / "checkpoint.h5")
    assert same(state, back)
    assert list(back) == list(state)
    generator = np.random.default_rng()
    generator.bit_generator.state = back["random"]
    assert generator.random() == np.random.default_rng(5).random()


def test_failed_checkpoint_leaves_the_former_one(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"a": 1})
    with pytest.raises(TypeError, match=r"state\.grains\.law: a object cannot be stored"):
        write_checkpoint(path, {"grains": {"law": object()}})
    assert read_checkpoint(path) == {"a": 1}
    path.write_bytes(b"half")
    with pytest.raises(OutputError, match="without --resume"):
        read_checkpoint(path)


def _hdf5(path, **groups):
    with h5py.File(path, "w") as file:
        for name, value in groups.items():
            file[name.replace("__", "/")] = value
    return path.read_bytes()


def test_files_that_are_no_checkpoint_are_reported(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"a": np.arange(10_000)})
    whole = path.read_bytes()
    foreign = {
        "a text": (b"a text", "cannot be read|cannot read"),
        "cut off": (whole[: len(whole) // 2], "cannot read"),
        "of another program": (_hdf5(tmp_path / "other.h5", particles__position=np.zeros(3)), "no checkpoint that"),
    }
    for content, words in foreign.values():
        path.write_bytes(content)
        with pytest.raises(OutputError, match=rf"checkpoint\.h5.*({words}).*|({words}).*checkpoint\.h5"):
            read_checkpoint(path)
    for state in ({"kind": "dict"}, {"kind": "int"}, {}):  # a layout like ours, with something else in it
        with h5py.File(path, "w") as file:
            file.attrs["version"] = 2
            file.create_group("state").attrs.update(state)
            file["state"].create_dataset("a", data=b"no number")
        with pytest.raises(OutputError, match=r"checkpoint\.h5.*without --resume"):
            read_checkpoint(path)


def test_files_that_are_no_record_are_reported(tmp_path):
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        record.append_grains(0, 0.0, {"position": np.random.default_rng(0).random((500, 3))})
    whole = path.read_bytes()
    foreign = (b"a text", b"", whole[: len(whole) // 2], _hdf5(tmp_path / "other.h5", a=np.zeros(3)))
    for content in foreign:
        path.write_bytes(content)
        with pytest.raises(OutputError, match=r"run\.h5.*(not an HDF5 file|no record that this program wrote)"):
            Record.open(path)
    # a group of that name without its arrays: found when it is asked for
    path.write_bytes(_hdf5(tmp_path / "hollow.h5", particles__grains__position__time=1.0, observables__current=2.0))
    hollow = Record.open(path)
    for read in (hollow.frames, hollow.grains, lambda: hollow.observable("current")):
        with pytest.raises(OutputError, match=r"cannot read .*run\.h5"):
            read()


def test_a_record_of_another_program_does_not_stop_a_resumed_run(tmp_path):
    path = tmp_path / "run.h5"
    content = _hdf5(path, a=np.zeros(3))
    with Record.open(path, "a", resume_time=0.0) as record:
        record.append_grains(0, 0.0, {"position": np.zeros((1, 3))})
    assert (tmp_path / "run-broken-1.h5").read_bytes() == content and len(record.frames()) == 1
    with pytest.raises(OutputError, match="has 1 frames of grains, none of number 1"):
        record.grains(1)


def test_resuming_to_an_end_before_the_checkpoint_is_refused(tmp_path):
    """Nothing is left to do; the folder stays as it is."""
    case = load_case(GOOD, {"time.end": "50 ms"})
    folder = RunFolder.create(tmp_path / "run", case.toml())
    with HistoryWriter(folder.history) as history:
        for i in range(1, 6):
            history.append({"time": 0.01 * i})
    rest = dict.fromkeys(("steps_per_update", "steps", "dem", "rows", "magnetised", "source"), 0)
    write_checkpoint(folder.checkpoint, {"case": case.toml(), "window": 4, **rest})
    before = {path.name: path.read_bytes() for path in folder.path.iterdir()}
    with pytest.raises(OutputError, match=r"time\.end = 0\.03 s is earlier than the checkpoint in .*, at 0\.04 s"):
        run(case.with_values({"time.end": "30 ms"}), out=folder.path, resume=True)
    assert {path.name: path.read_bytes() for path in folder.path.iterdir()} == before


@pytest.mark.parametrize(("end", "last"), [("42 ms", 4), ("50 ms", 5), ("49.5 ms", 5), ("60 ms", 5)])
def test_resuming_to_an_end_after_the_checkpoint_or_to_its_own_is_right(tmp_path, end, last):
    """A run's last window may reach beyond its end: then the end is before the checkpoint, and still its own."""
    written = load_case(GOOD, {"time.end": "49.5 ms"})
    folder = RunFolder.create(tmp_path / "run", written.toml())
    with HistoryWriter(folder.history) as history:
        for i in range(1, last + 1):
            history.append({"time": 0.01 * i})
    end_of_run = written.with_values({"time.end": end}).scene.time.end
    refuse_earlier_end(folder, {"case": written.toml(), "window": last}, end_of_run)


def test_result_reads_the_folder(tmp_path):
    folder = RunFolder.create(tmp_path / "run", "")
    with pytest.raises(OutputError, match=r"before its first window, .*; if it ended, continue it with .* --resume"):
        load_result(folder.path)
    with pytest.raises(OutputError, match=r"case\.toml is a file; name the folder of a run"):
        load_result(folder.case)
    folder.history.touch()
    with pytest.raises(OutputError, match=r"case\.toml is a file; give its folder, .*run$"):
        load_result(folder.case)
    folder.history.unlink()
    rng = np.random.default_rng(0)
    with HistoryWriter(folder.history) as history:
        for i in range(1, 201):
            history.append({"time": 0.01 * i, "torque_disc": 5.0 + rng.standard_normal()})
    cut_off = load_result(folder.path)  # no summary yet: the torque is that of the history
    assert len(cut_off.history) == 200 and abs(cut_off.torque.mean - 5.0) < 0.4
    estimate = steady_mean(cut_off.history["time"], cut_off.history["torque_disc"], average_from=0.5)
    folder.write_summary({"torque": estimate.as_dict()})
    result = load_result(folder.path)
    assert result.torque == estimate.of_one_replica() and result.torque.start == pytest.approx(0.5)
    with pytest.raises(OutputError, match=r"run\.h5 does not exist"):
        result.open_record()


@pytest.mark.parametrize(("seconds", "count"), [(0.2, 10), (0.05, 5)])
def test_progress_writes_plain_lines_where_there_is_no_terminal(monkeypatch, seconds, count):
    """A line every 10 %, but not more than one a second."""
    now = [0.0]
    for clock in ("monotonic", "perf_counter"):
        monkeypatch.setattr(f"emclutch.results.progress.time.{clock}", lambda: now[0])
    stream = io.StringIO()
    with Progress("coupling", stream=stream) as progress:
        for i in range(101):
            progress.update(i / 100.0, f"window {i}")
            now[0] += seconds
    lines = stream.getvalue().splitlines()
    assert len(lines) == count and not any(" 0 s left" in line for line in lines)
    assert lines[0].startswith(f" {100 // count} %  window") and lines[-1].startswith("100 %  window 100  took")


def test_progress_does_not_extrapolate_compilation(monkeypatch):
    now = [0.0]
    for clock in ("monotonic", "perf_counter"):
        monkeypatch.setattr(f"emclutch.results.progress.time.{clock}", lambda: now[0])
    stream = io.StringIO()
    with Progress("coupling", stream=stream) as progress:
        progress.update(0.0)
        for i in range(1, 1001):
            now[0] += 20.0 if i == 1 else 0.05  # the first window compiles
            progress.update(i / 1000.0)
    lines = stream.getvalue().splitlines()
    assert "left" not in lines[0]  # below 3 %
    first = next(line for line in lines if "left" in line)
    assert first.endswith(("44 s left", "45 s left"))  # 900 windows of 0.05 s
    assert lines[-1].endswith("took 1 min")


def test_progress_draws_a_bar_on_a_terminal():
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    stream = Terminal()
    with Progress("coupling", stream=stream) as progress:
        progress.update(0.5, "half")
        progress.update(1.0, "all")
    assert "100 %" in stream.getvalue()
