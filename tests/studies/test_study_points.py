"""Points of a study are known by their values: nothing finished is computed twice, mixed with another, or lost."""

import json
import logging

import pandas
import pytest
from stand_in_runs import FRICTION, study_file

from emclutch.cli.plot import plot_runs
from emclutch.results import OutputError, RunFolder
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import locked_folder
from emclutch.results.report.render import html
from emclutch.results.report.study_report import study_report
from emclutch.results.study_folder import read_study as read_folder
from emclutch.scene.study import read_study
from emclutch.studies import sweep as run_study
from emclutch.studies import tables as study_tables
from emclutch.studies import tasks as study_tasks
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
        patched.setattr(study_tasks, "run", fails)
        sweep(study, out=out)
    found = read_folder(out)
    assert len(found.table) == 0 and found.varied == [] and found.points == 2
    page = html(study_report(found, lambda result: ()))
    assert "0 of 2 points done" in page and "point-000: the run failed before its first window" in page
    with pytest.raises(OutputError, match="no point of the study"):
        plot_runs([out], out=tmp_path / "picture.png", log=print)
    sweep(study, out=out, resume=True)
    (out / "point-000" / "summary.json").unlink()
    with monkeypatch.context() as patched, pytest.raises(RunError, match="point-000"):
        patched.setattr(study_tasks, "run", fails)
        sweep(study, out=out, resume=True)
    assert table(out)[FRICTION].tolist() == [0.3]


def test_values_may_be_inserted_removed_and_put_in_another_order(tmp_path, runs):
    out = sweep(study_of(tmp_path, {FRICTION: [0.1, 0.3]}), out=tmp_path / "out")
    assert runs.points == ["point-000", "point-001"]
    runs.asked.clear()
    sweep(study_of(tmp_path, {FRICTION: [0.3, 0.2, 0.1]}), out=out, resume=True)
    assert [asked[:2] for asked in runs.asked] == [("point-004", False)]
    assert table(out)[[FRICTION, "folder"]].to_numpy().tolist() == [
        [0.3, "point-001"], [0.2, "point-004"], [0.1, "point-000"]]  # fmt: skip
    runs.asked.clear()
    sweep(study_of(tmp_path, {FRICTION: [0.2]}), out=out, resume=True)
    assert not runs.asked and table(out)["folder"].tolist() == ["point-004"]
    assert "left as they are: point-000, point-001" in (out / "study.log").read_text()


def test_a_later_end_continues_every_point_and_is_in_the_table(tmp_path, runs):
    values = {FRICTION: [0.1, 0.3]}
    out = sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=tmp_path / "out")
    runs.asked.clear()
    sweep(study_of(tmp_path, values, **{"time.end": "5 ms"}), out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [("point-000", True, 5e-3), ("point-001", True, 5e-3)]
    assert (out / "point-000" / "summary-1.json").is_file()  # that of the former end
    assert table(out)["end_time"].tolist() == [5e-3, 5e-3]
    (out / "point-000" / "summary.json").unlink()
    with pytest.raises(OutputError, match=r"point-000 has run to 0\.005 s.*ends at 0\.004 s.*--out"):
        sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=out, resume=True)


def test_a_torque_that_was_known_before_its_end_stays_as_it_is(tmp_path, runs):
    values = {FRICTION: [0.1, 0.3]}
    out = sweep(study_of(tmp_path, values, **{"time.end": "4 ms"}), out=tmp_path / "out")
    for name, reached in (("point-000", True), ("point-001", False)):
        folder = RunFolder(out / name)
        folder.write_summary(folder.read_summary() | {"until": {"reached": reached}})
    runs.asked.clear()
    sweep(study_of(tmp_path, values, **{"time.end": "5 ms"}), out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [("point-001", True, 5e-3)]


@pytest.mark.parametrize(("rate", "old"), [(500.0, []), (1000.0, ["point-000"])])
def test_a_point_that_ends_at_a_strain_is_compared_by_its_own_shear_rate(tmp_path, runs, rate, old):
    out = sweep(study_of(tmp_path, {FRICTION: [0.1, 0.3]}, **{"time.end": "4 ms"}), out=tmp_path / "out")
    point = RunFolder(out / "point-000")
    point.case.write_text(point.case.read_text().replace("end = 0.004", 'end = "strain 2"'))
    point.plan.write_text(json.dumps({"shear_rate": rate}))
    assert read_folder(out).outdated() == old


def test_a_point_resumed_alone_makes_the_table_old_and_sweep_renews_it(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.3]}, **{"time.end": "4 ms"})
    out = sweep(study, out=tmp_path / "out")
    assert read_folder(out).outdated() == []
    (_, case), _ = study.cases()
    alone = {"out": out / "point-000", "threads": 1, "progress": None, "resume": True, "start": None, "force": False}
    runs.torque = 1.5
    runs(case.with_values({"time.end": "5 ms"}), **alone)
    assert read_folder(out).outdated() == ["point-000"]
    reported = []
    plot_runs([out], out=tmp_path / "picture.png", log=reported.append)
    assert any("older than point-000" in text and "--resume" in text for text in reported)
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
    assert [asked[:3] for asked in runs.asked] == [("point-000", True, 5e-3)]


def test_ends_that_are_the_studys_values_tell_points_apart(tmp_path, runs):
    out = sweep(study_of(tmp_path, {"time.end": ["2 ms", "6 ms"]}), out=tmp_path / "out")
    runs.asked.clear()
    sweep(study_of(tmp_path, {"time.end": ["2 ms", "4 ms", "6 ms"]}), out=out, resume=True)
    assert [asked[:3] for asked in runs.asked] == [("point-004", False, 4e-3)]


def test_a_point_killed_before_its_first_checkpoint_is_started_anew(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.3]})
    runs.acts = {0.1: stops}
    with pytest.raises(Interrupted, match="--resume"):
        sweep(study, out=tmp_path / "out")
    (tmp_path / "out" / "point-000" / "history.csv").write_text("half")
    runs.acts, runs.asked = {}, []
    out = sweep(study, out=tmp_path / "out", resume=True)
    assert [asked[:2] for asked in runs.asked] == [("point-000", False), ("point-001", False)]
    assert (out / "point-000-set-aside-1" / "history.csv").read_text() == "half"
    assert "point-000 has no checkpoint to continue from: restarted" in (out / "study.log").read_text()
    runs.asked.clear()
    sweep(study, out=out, resume=True)
    assert not runs.asked


def test_a_point_killed_before_its_scene_was_written_keeps_its_folder(tmp_path, runs):
    """Another number would stand in the table."""
    (tmp_path / "out" / "point-000").mkdir(parents=True)
    (tmp_path / "out" / "point-000" / "case.toml.12.new").write_text("half")
    out = sweep(study_of(tmp_path, {FRICTION: [0.1, 0.3]}), out=tmp_path / "out", resume=True)
    assert table(out)["folder"].tolist() == ["point-000", "point-001"]
    assert not (out / "point-000" / "case.toml.12.new").exists()


def test_a_point_killed_between_its_set_aside_folder_and_its_new_one_keeps_its_number(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.3]})
    out = sweep(study, out=tmp_path / "out")
    (out / "point-000").rename(out / "point-000-set-aside-1")
    out = sweep(study, out=tmp_path / "out", resume=True)
    assert table(out)["folder"].tolist() == ["point-000", "point-001"]


def test_a_point_that_another_process_writes_is_not_set_aside(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1]})
    point = RunFolder.create(tmp_path / "out" / "point-000", next(iter(study.cases()))[1].toml())
    with locked_folder(point.path), pytest.raises(OutputError, match="in use by process"):
        sweep(study, out=tmp_path / "out", resume=True)
    assert point.case.is_file() and not runs.asked


def test_a_finished_point_of_other_input_files_is_not_kept(tmp_path, runs):
    (tmp_path / "sizes.csv").write_text("diameter [mm]\n0.2\n0.21\n")
    sizes = {"particles.diameter": None, "particles.sizes": {"kind": "file", "file": str(tmp_path / "sizes.csv")}}
    study = study_of(tmp_path, {FRICTION: [0.1]})
    study = study.model_copy(update={"set": sizes})
    out = sweep(study, out=tmp_path / "out")
    (tmp_path / "sizes.csv").write_text("diameter [mm]\n0.2\n0.22\n")
    with pytest.raises(OutputError, match=r"another content of particles\.sizes\.file = .*sizes\.csv.*--out"):
        sweep(study, out=out, resume=True)


def test_nothing_is_resumed_where_nothing_is(tmp_path, runs):
    with pytest.raises(OutputError, match="there is no such folder"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "none", resume=True)
    assert not (tmp_path / "none").exists() and logging.getLogger(run_study.__name__).handlers == []
