"""Points of a study are known by their values: nothing finished is computed twice, mixed with another, or lost."""

import json
import logging
import shutil
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pandas
import pytest
from stand_in_runs import FRICTION, SPEED, folder_of, number_of, study_file
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.cli.plot import plot_runs
from emclutch.results import OutputError, RunFolder
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import locked_folder
from emclutch.results.history import last_time
from emclutch.results.report.render import html
from emclutch.results.report.study_report import study_report
from emclutch.results.study_result import load_study as read_folder
from emclutch.scene.study import read_study
from emclutch.studies import point as study_point
from emclutch.studies import sweep as run_study
from emclutch.studies import tables as study_tables
from emclutch.studies.attempt import TakenOver, attempt, clear_attempt, refuse_taken_over
from emclutch.studies.point import tasks_of
from emclutch.studies.study import TaskProgress
from emclutch.studies.sweep import sweep


def study_of(folder, values, **settings):
    return read_study(study_file(folder, values, settings))


def stops(_):
    raise KeyboardInterrupt


def table(folder):
    return pandas.read_csv(folder / "study.csv")


def test_a_study_whose_first_point_fails_says_so(tmp_path, monkeypatch, runs):
    """It has a table without rows, which a report reads; a later failure leaves the rows of the other points."""

    def fails(case, *, out, resume, **_):
        RunFolder.create(out, case.toml(), resume=resume).write_failure("grains overlap; raise contact.stiffness")
        raise RunError("grains overlap; raise contact.stiffness")

    study, out = study_of(tmp_path, {FRICTION: [0.1, 0.3]}), tmp_path / "out"
    with monkeypatch.context() as patched, pytest.raises(RunError, match="0 of 2 points are done"):
        patched.setattr(study_point, "run", fails)
        sweep(study, out=out)
    found = read_folder(out)
    assert len(found.table) == 0 and found.varied == [] and found.total == 2
    page = html(study_report(found, lambda result: ()))
    assert "0 of 2 points done" in page and f"{folder_of(out, 0).name}: the run failed before its first window" in page
    with pytest.raises(OutputError, match="no point of the study"):
        plot_runs([out], out=tmp_path / "picture.png", log=print)
    sweep(study, out=out, resume=True)
    (folder_of(out, 0) / "summary.json").unlink()
    with monkeypatch.context() as patched, pytest.raises(RunError, match="000_friction"):
        patched.setattr(study_point, "run", fails)
        sweep(study, out=out, resume=True)
    assert table(out)[FRICTION].tolist() == [0.3]


def test_values_may_be_inserted_removed_and_put_in_another_order(tmp_path, runs):
    out = sweep(study_of(tmp_path, {FRICTION: [0.1, 0.3]}), out=tmp_path / "out")
    assert runs.points == [0, 1]
    runs.asked.clear()
    sweep(study_of(tmp_path, {FRICTION: [0.3, 0.2, 0.1]}), out=out, resume=True)
    assert [asked[:2] for asked in runs.asked] == [(1, False)]
    names = [name.rpartition("_")[0] for name in table(out)["folder"]]
    assert table(out)[FRICTION].tolist() == [0.3, 0.2, 0.1]
    assert names == ["001_friction=0.3", "001_friction=0.2", "000_friction=0.1"]  # those that were there keep theirs
    runs.asked.clear()
    inserted = {FRICTION: [0.1, 0.2, 0.3], SPEED: ["100 rpm"]}  # that of the scene
    sweep(study_of(tmp_path, inserted), out=out, resume=True)
    assert not runs.asked
    sweep(study_of(tmp_path, inserted | {SPEED: ["100.0 rpm", "50 rpm"]}), out=out, resume=True)
    assert len(runs.asked) == 3  # another key, and a value that is written otherwise, change no scene
    runs.asked.clear()
    sweep(study_of(tmp_path, {FRICTION: [0.2]}), out=out, resume=True)
    assert not runs.asked and table(out)[FRICTION].tolist() == [0.2]
    assert "left as they are: 000_friction=0.1" in (out / "study.log").read_text()


def test_a_later_end_continues_every_point_and_is_in_the_table(tmp_path, runs):
    values = {FRICTION: [0.1, 0.3]}
    out = sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=tmp_path / "out")
    runs.asked.clear()
    sweep(study_of(tmp_path, values, **{"time.end": "5 ms"}), out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [(0, True, 5e-3), (1, True, 5e-3)]
    assert (folder_of(out, 0) / "summary-1.json").is_file()  # that of the former end
    assert table(out)["end_time"].tolist() == [5e-3, 5e-3]
    (folder_of(out, 0) / "summary.json").unlink()
    with pytest.raises(OutputError, match=r"000_friction=0.1_.* has run to 0\.005 s.*ends at 0\.004 s.*--out"):
        sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=out, resume=True)


def test_a_torque_that_was_known_before_its_end_stays_as_it_is(tmp_path, runs):
    values = {FRICTION: [0.1, 0.3]}
    out = sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=tmp_path / "out")
    for number, reached in enumerate((True, False)):
        folder = RunFolder(folder_of(out, number))
        folder.write_summary(folder.read_summary() | {"until": {"reached": reached}})
    runs.asked.clear()
    sweep(study_of(tmp_path, values, **{"time.end": "5 ms"}), out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [(1, True, 5e-3)]


@pytest.mark.parametrize(("rate", "old"), [(500.0, []), (1000.0, [0])])
def test_a_point_that_ends_at_a_strain_is_compared_by_its_own_shear_rate(tmp_path, runs, rate, old):
    out = sweep(study_of(tmp_path, {FRICTION: [0.1, 0.3]}, **{"time.end": "4 ms"}), out=tmp_path / "out")
    point = RunFolder(folder_of(out, 0))
    point.case.write_text(point.case.read_text().replace("end = 0.004", 'end = "strain 2"'))
    point.plan.write_text(json.dumps({"shear_rate": rate}))
    assert [number_of(name) for name in read_folder(out).outdated()] == old


def test_a_point_resumed_alone_makes_the_table_old_and_sweep_renews_it(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.3]}, **{"time.end": "4 ms"})
    out = sweep(study, out=tmp_path / "out")
    assert read_folder(out).outdated() == []
    (_, case), _ = study.cases()
    alone = {"out": folder_of(out, 0), "threads": 1, "progress": None, "resume": True, "start": None, "force": False}
    runs.torque = 1.5
    runs(case.with_values({"time.end": "5 ms"}), **alone)
    assert read_folder(out).outdated() == [folder_of(out, 0).name]
    reported = []
    plot_runs([out], out=tmp_path / "picture.png", log=reported.append)
    assert any("older than 000_friction=0.1" in text and "--resume" in text for text in reported)
    runs.asked.clear()
    sweep(study, out=out, resume=True)
    assert not runs.asked and read_folder(out).outdated() == []
    assert table(out)[["end_time", "torque"]].to_numpy().tolist() == [[5e-3, 1.5], [4e-3, 0.3]]
    sweep(study, out=out, resume=True)
    assert not runs.asked


def test_torque_against_current_has_the_end_time(tmp_path, monkeypatch):
    monkeypatch.setattr(study_tables, "torque_against_current_picture", lambda *_, **__: None)
    study = study_of(tmp_path, {"coil.current": ["0.1 A", "0.2 A"]})
    row = {"coil.current": "0.1 A", "end_time": 2e-3, "current": 0.1, "torque": 1.0, "converged": True}
    study_tables.write_torques(tmp_path, study, [row])
    assert pandas.read_csv(tmp_path / "torque_vs_current.csv")["end_time"].tolist() == [2e-3]


def test_a_point_killed_on_its_way_to_a_later_end_is_not_done(tmp_path, runs):
    values = {FRICTION: [0.1]}
    out = sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=tmp_path / "out")
    later = study_of(tmp_path, values, **{"time.end": "5 ms"})
    runs.acts = {0.1: stops}
    with pytest.raises(Interrupted, match="--resume"):
        sweep(later, out=out, resume=True)
    runs.acts, runs.asked = {}, []
    sweep(later, out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [(0, True, 5e-3)]


def test_ends_that_are_the_studys_values_tell_points_apart(tmp_path, runs):
    out = sweep(study_of(tmp_path, {"time.end": ["2 ms", "6 ms"]}), out=tmp_path / "out")
    runs.asked.clear()
    sweep(study_of(tmp_path, {"time.end": ["2 ms", "4 ms", "6 ms"]}), out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [(1, False, 4e-3)]


def test_a_point_killed_before_its_first_checkpoint_is_started_anew(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.3]})
    runs.acts = {0.1: stops}
    with pytest.raises(Interrupted, match="--resume"):
        sweep(study, out=tmp_path / "out")
    (folder_of(tmp_path / "out", 0) / "history.csv").write_text("time\n1e-3\nhalf")
    runs.acts, runs.asked = {}, []
    out = sweep(study, out=tmp_path / "out", resume=True)
    assert [asked[:2] for asked in runs.asked] == [(0, False), (1, False)]
    (aside,) = out.glob("000_*-set-aside-1")
    assert (aside / "history.csv").read_text() == "time\n1e-3\nhalf"
    assert f"{folder_of(out, 0).name} has no checkpoint to continue from: restarted" in (out / "study.log").read_text()
    runs.asked.clear()
    sweep(study, out=out, resume=True)
    assert not runs.asked


@pytest.mark.parametrize("damaged", ["", '{"torque": ', "[1]", "null"])
def test_a_point_with_a_damaged_summary_is_done_again_and_the_others_stay(damaged, tmp_path, runs):
    """Its damaged file is kept, and the command line, which foretells what is left, goes on."""
    file = study_file(tmp_path, {FRICTION: [0.1, 0.3]})
    out = sweep(read_study(file), out=tmp_path / "out")
    before = table(out)
    (folder_of(out, 0) / "summary.json").write_text(damaged)
    runs.asked.clear()
    answer = CliRunner().invoke(app, ["sweep", str(file), "--out", str(out), "--collect"])
    assert answer.exit_code == 3, answer.output
    answer = CliRunner().invoke(app, ["sweep", str(file), "--out", str(out), "--resume"])
    assert answer.exit_code == 0, answer.output
    assert [asked[:2] for asked in runs.asked] == [(0, True)] and table(out).equals(before)
    assert (folder_of(out, 0) / "damaged-summary.json").read_text() == damaged
    assert "summary.json is damaged" in (out / "study.log").read_text()


def test_a_point_killed_before_its_scene_was_written_keeps_its_folder(tmp_path, runs):
    study, out = study_of(tmp_path, {FRICTION: [0.1, 0.3]}), tmp_path / "out"
    killed = out / "attempts" / f"{tasks_of(study, out)[0].name}.0123abcd"
    killed.mkdir(parents=True)
    (killed / "case.toml.12.new").write_text("half")
    sweep(study, out=out, resume=True)
    assert [number_of(name) for name in table(out)["folder"]] == [0, 1] and not (out / "attempts").exists()
    assert not list(out.glob("*/*.new"))


def test_a_point_that_another_process_writes_is_not_touched(tmp_path, runs):
    study, out = study_of(tmp_path, {FRICTION: [0.1]}), tmp_path / "out"
    (task,) = tasks_of(study, out)
    point = RunFolder.create(out / task.name, task.case.toml())
    with locked_folder(point.path), pytest.raises(OutputError, match="in use by process"):
        sweep(study, out=out, resume=True)
    assert point.case.is_file() and not runs.asked


def test_of_killed_attempts_that_which_came_furthest_is_continued(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1]}, **{"time.end": "4 ms"})
    out = sweep(study, out=tmp_path / "out")
    (task,), done = tasks_of(study, out), folder_of(out, 0)
    (done / "row.json").unlink()
    (done / "summary.json").unlink()
    for token, reached in (("00000000", "1e-3"), ("11111111", "3e-3"), ("22222222", "2e-3")):
        shutil.copytree(done, out / "attempts" / f"{task.name}.{token}")
        (out / "attempts" / f"{task.name}.{token}" / "history.csv").write_text(f"time\n{reached}\n")
    shutil.rmtree(done)
    with attempt(done, task.is_done) as own:
        assert last_time(own / "history.csv") == 3e-3 and len(list(own.parent.iterdir())) == 3


def test_who_was_taken_over_finds_out_and_changes_nothing(tmp_path):
    def is_done(folder):
        return (folder / "done").exists()

    with pytest.raises(TakenOver), attempt(tmp_path / "task", is_done) as first:
        (first / "checkpoint").write_text("1")
        progress = TaskProgress(tmp_path, first)
        with attempt(tmp_path / "task", is_done) as second:
            assert not first.exists() and (second / "checkpoint").read_text() == "1"
            with pytest.raises(TakenOver):
                _ = progress.stop_asked
            (second / "checkpoint").write_text("2")
        (first / "replicas" / "01").mkdir(parents=True)  # by a process that the first one had begun
    assert (tmp_path / "task" / "checkpoint").read_text() == "2" and not first.exists()


def test_an_attempt_that_begins_afresh_keeps_its_folder(tmp_path):
    """A folder that is made anew may get another inode; then the task seems taken over."""
    with attempt(tmp_path / "task", lambda folder: True) as own:
        (own / "replicas" / "01").mkdir(parents=True)
        (own / "history.csv").touch()
        inode = own.stat().st_ino
        clear_attempt(own)
        assert not any(own.iterdir()) and own.stat().st_ino == inode
        refuse_taken_over(own)


def test_tasks_side_by_side_share_the_folder_of_attempts_that_each_removes(tmp_path):
    def work(name):
        for _ in range(300):
            with attempt(tmp_path / name, lambda folder: True) as own:
                (own / "row").touch()
        return True

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(work, "abcd"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "d"]


def test_attempts_at_one_task_end_or_are_taken_over_and_nothing_else(tmp_path):
    def work(number):
        for _ in range(150):
            with suppress(TakenOver), attempt(tmp_path / "task", lambda folder: False) as own:
                with suppress(FileNotFoundError):
                    (own / f"row-{number}").touch()

    with ThreadPoolExecutor(3) as threads:
        list(threads.map(work, range(3)))
    assert (tmp_path / "task").is_dir() and not (tmp_path / "attempts").exists()


@pytest.mark.parametrize("ended", [True, False])
def test_of_two_that_end_the_first_has_done_it_unless_it_was_stopped(ended, tmp_path):
    with attempt(tmp_path / "task", lambda folder: ended) as late:
        (late / "row").write_text("late")
        shutil.copytree(late, tmp_path / "task")  # another one, begun at the same moment
        (tmp_path / "task" / "row").write_text("early")
    assert (tmp_path / "task" / "row").read_text() == ("early" if ended else "late")
    assert not (tmp_path / "attempts").exists() and (tmp_path / "task-set-aside-1").exists() is not ended


def test_a_point_of_other_input_files_is_another_point(tmp_path, runs):
    (tmp_path / "sizes.csv").write_text("diameter [mm]\n0.2\n0.21\n")
    sizes = {"particles.diameter": None, "particles.sizes": {"kind": "file", "file": str(tmp_path / "sizes.csv")}}
    study = study_of(tmp_path, {FRICTION: [0.1]})
    study = study.model_copy(update={"set": sizes})
    out = sweep(study, out=tmp_path / "out")
    (tmp_path / "sizes.csv").write_text("diameter [mm]\n0.2\n0.22\n")
    sweep(study, out=out, resume=True)
    assert [asked[:2] for asked in runs.asked] == [(0, False), (0, False)] and len(list(out.glob("000_*"))) == 2


def test_names_tell_scenes_apart_that_look_alike(tmp_path):
    study = study_of(tmp_path, {FRICTION: [0.1 + 1e-9 * n for n in range(600)]})
    names = [task.name.partition("_")[2] for task in tasks_of(study, tmp_path / "out")]
    assert len(set(names)) == 600 and len({name.rpartition("_")[0] for name in names}) < 10


def test_nothing_is_resumed_where_nothing_is(tmp_path, runs):
    with pytest.raises(OutputError, match="there is no such folder"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "none", resume=True)
    assert not (tmp_path / "none").exists() and logging.getLogger(run_study.__name__).handlers == []
