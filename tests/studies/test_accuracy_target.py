"""`accuracy.target`: settings by the device's study stand for it, a run ends at the total error, or says why not."""

import math

import pytest
from made_up_study import cell, contact_step, study, without_error

import emclutch
from emclutch.results import OutputError, RunFolder
from emclutch.results.accuracy_studies import VARIABLE, save_accuracy_study
from emclutch.results.accuracy_study import Basis, MeasuredSetting, MeasuredValue
from emclutch.scene.errors import SceneError
from emclutch.scene.replica_count import automatic_count
from emclutch.scene.study import read_study
from emclutch.simulation.discretisation_error import accuracy_in_words, device_of
from emclutch.simulation.plan import make_plan
from emclutch.simulation.run import run as run_with_settings
from emclutch.simulation.stopping_rule import stopping_rule
from emclutch.studies.accuracy import target as accuracy_target
from emclutch.studies.accuracy.target import cases_of, with_target

ENDS = {"time__average_from": None, "accuracy__replicas": None}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where accuracy studies are looked for in one test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "accuracy_studies"))
    return tmp_path / "accuracy_studies"


def with_study(case, *settings, **values):
    others = [] if "unknown" in values else without_error(case, make_plan(case)[1], settings)
    save_accuracy_study(study(device_of(case), *settings, *others, **values))


def test_settings_and_end_follow_from_the_study(folder):
    case = cell(accuracy__target="5 %", **ENDS)
    with_study(case, contact_step(0.04, 0.004), scatter=0.02)
    found = with_target(case).scene
    assert found.accuracy.target is None and found.span.steps_per_contact == 10.0  # half the cost of 20
    choice = accuracy_target.settled(case).choice
    assert choice.values["contact_step"] == 10.0 and choice.total.bias == pytest.approx(0.17, abs=0.01)
    assert found.span.until.relative == pytest.approx(math.sqrt(0.05**2 - choice.total.half_width**2), abs=1e-4)
    finer = cell(accuracy__target="1 %", **ENDS)
    assert with_target(finer).scene.span.steps_per_contact == 40.0


def test_the_scatter_of_the_study_is_in_the_scene(folder):
    """With three degrees of freedom only at another current, where it may be another one."""
    case = cell(accuracy__target="5 %", **ENDS)
    with_study(case, contact_step(0.04, 0.004), scatter=0.02, freedom=16.0)
    found = with_target(case).scene
    expected = accuracy_target.settled(case).choice.scatter  # of the coarser step
    assert found.accuracy.replica_scatter == pytest.approx(expected) and found.accuracy.replica_scatter_freedom == 16
    assert automatic_count(found) == 2 and automatic_count(case.scene) == 4
    device, plan = make_plan(with_target(case))
    assert stopping_rule(plan.scene, device, plan.end).lengths == (plan.end,)  # the scatter is of means to the end
    with_study(case, contact_step(0.04, 0.004), scatter=0.02, freedom=16.0, drive={"coil.current": 0.5})
    found = with_target(case).scene
    assert found.accuracy.replica_scatter_freedom == 3 and automatic_count(found) == 4
    with pytest.raises(SceneError, match="and this scene has one; remove it, or take a random packing and"):
        with_target(case).with_values({"accuracy.replicas": 1})


def test_the_step_by_dvi_follow_from_the_study(folder):
    """A longer one than the rules allow where its error is small enough, and then the scene allows it."""
    rigid = {"contact__method": "dvi", "time__window": "0.8 ms", "time__end": "4 ms", **ENDS}
    case = cell(accuracy__target="5 %", **rigid)
    own = make_plan(case)[1].dt
    values = [MeasuredValue(f * own, f * own, 2.0 * 1.03**f, 0.002, 4, 3.0 / f, 1.0 / f) for f in (4.0, 2.0, 1.0, 0.5)]
    steps = MeasuredSetting("rigid_step", "contact.dvi.step", Basis.TORQUE, own, 1.0, 0.0, tuple(values), 30.0)
    with_study(case, steps, scatter=0.02)
    found, plan = with_target(case).scene.contact.dvi, make_plan(with_target(case))[1]
    assert found.allow_long_step and plan.dt == pytest.approx(4.0 * own, rel=1e-4)
    accurate = with_target(cell(accuracy__target="0.8 %", **rigid))
    found, plan = accurate.scene.contact.dvi, make_plan(accurate)[1]
    assert not found.allow_long_step and plan.dt <= own * 1.001


def test_a_case_without_a_target_is_left_alone(folder):
    case = cell()
    assert with_target(case) is case


def test_a_missing_study_is_run_within_the_budget(folder, monkeypatch):
    asked = {}

    def stand_in(case, **given):
        asked.update(given)
        with_study(case, contact_step(0.04, 0.004), scatter=0.02)

    monkeypatch.setattr(accuracy_target, "accuracy", stand_in)
    case = cell(accuracy__target="5 %", accuracy__budget="3 min", **ENDS)
    assert "up to 3 min (accuracy.budget)" in accuracy_in_words(case, make_plan(case)[1])
    assert with_target(case).scene.span.until is not None
    assert asked["budget"] == 180.0 and asked["targets"] == (0.05,) and not asked["resume"]
    assert folder in asked["out"].parents
    assert "of processor time" in accuracy_in_words(case, make_plan(case)[1])


def test_what_cannot_be_reached_is_an_error_with_its_limit_and_a_remedy(folder):
    case = cell(accuracy__target="1 %", **ENDS)
    with_study(case, contact_step(0.3, 0.02), scatter=0.02)
    with pytest.raises(SceneError, match=r"limited by the contact step .*accuracy.values.contact_step.*or ask for"):
        with_target(case)
    with_study(case, contact_step(0.04, 0.2), scatter=0.2)
    with pytest.raises(SceneError, match=r"limited by the scatter of 24 replicas .*accuracy.time_end='strain 72'"):
        with_target(case)
    unknown = {"sector": "not measured in this budget: about 4 min"}
    with_study(case, contact_step(0.0, 0.001), unknown=unknown, over_budget=("sector",))
    with pytest.raises(
        SceneError,
        match=r"sector is not known: not measured in this budget: about 4 min; .*emclutch accuracy CASE --budget \d+",
    ):
        with_target(case)


def test_a_target_does_not_go_with_an_end_by_statistics_nor_into_a_run_as_it_is(tmp_path):
    with pytest.raises(SceneError, match=r"time.until = 'torque 5 %' does by statistics alone; remove one of them"):
        cell(accuracy__target="3 %", time__until="torque 5 %")
    with pytest.raises(SceneError, match="needs settings that are chosen first"):
        run_with_settings(cell(accuracy__target="3 %"), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_run_says_whether_it_has_reached_its_target_also_when_it_continues(folder, tmp_path):
    case = cell(accuracy__target="50 %", time__average_from="0.2 ms")
    with_study(case, contact_step(0.04, 0.004), scatter=0.02)
    result = emclutch.run(case, out=tmp_path / "run", callback=lambda state: state.window == 5)
    assert result.summary["accuracy_target"] == {"asked": 0.5, "reached": False}  # nothing is known of its error
    written = RunFolder(tmp_path / "run").read_scene()
    assert "target" not in written["accuracy"] and written["time"]["until"].startswith("torque")
    again = emclutch.run(tmp_path / "run" / "case.toml", out=tmp_path / "run", resume=True)
    total, is_steady = again.summary["discretisation_error"]["total_error"], again.summary["torque"]["converged"]
    reached = is_steady and total is not None and total <= 0.5
    assert again.summary["accuracy_target"] == {"asked": 0.5, "reached": reached}


def test_a_study_without_a_setting_of_the_scene_is_not_enough(folder):
    case = cell(accuracy__target="5 %", **ENDS)
    plan = make_plan(case)[1]
    known = [one for one in without_error(case, plan, [contact_step(0.0)]) if one.name != "overlap"]
    save_accuracy_study(study(device_of(case), contact_step(0.04, 0.004), *known, scatter=0.02))
    with pytest.raises(SceneError, match="overlap is not known: the accuracy study is of a scene without it"):
        with_target(case)


def test_a_study_with_sectors_has_no_settings_for_the_whole_ring(folder):
    """Its replicas cost a part of one that fills the ring."""
    case = cell(accuracy__target="5 %", **ENDS)
    with_study(case, contact_step(0.04, 0.004), scatter=0.02)
    assert with_target(case)
    ring = cell(accuracy__target="5 %", particles__sector=None, **ENDS)
    assert device_of(ring) == device_of(case)
    with pytest.raises(SceneError, match=r"replicas of the study have a sector.*; set particles\.sector$"):
        with_target(ring)


def test_a_target_is_not_reached_with_an_unknown_error(folder):
    case = cell(accuracy__target="5 %", time__step="1e-7 s", **ENDS)
    with_study(case, contact_step(0.04, 0.004), scatter=0.02)
    with pytest.raises(SceneError, match=r"contact step is not known: time\.step is given: its error is not known$"):
        with_target(case)


def test_an_average_from_a_time_leaves_the_start_up_out(folder):
    case = cell(accuracy__target="5 %", time__average_from="0.2 ms", accuracy__replicas=None)
    with_study(case, contact_step(0.04, 0.004), scatter=0.02)
    assert with_target(case).scene.span.steps_per_contact == 10.0


def test_nothing_is_measured_for_a_run_that_cannot_be_continued(folder, tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        emclutch.run(cell(accuracy__target="5 %", **ENDS), out=tmp_path / "nowhere", resume=True)
    assert not folder.exists()


def test_points_of_a_study_get_settings_where_their_study_is_known(folder, tmp_path):
    case = cell(**ENDS)
    (tmp_path / "case.toml").write_text(case.toml())
    (tmp_path / "study.toml").write_text(
        '[study]\ncase = "case.toml"\n[study.values]\n"accuracy.target" = ["5 %", "1 %"]\n'
    )
    study = read_study(tmp_path / "study.toml")
    assert [one.scene.accuracy.target for _, one in cases_of(study)] == [0.05, 0.01]
    with_study(case, contact_step(0.04, 0.004), scatter=0.02)
    assert [one.scene.span.steps_per_contact for _, one in cases_of(study)] == [10.0, 40.0]
    assert accuracy_target.settled(case.with_values({"accuracy.target": "5 %"})).choice.replicas >= 2
