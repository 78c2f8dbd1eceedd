"""An accuracy study gives the same result however often it is killed on the way, within its budget.

Its replicas are stood in for by a torque that is known in closed form, of a cost as it is predicted; one real replica
is run.
"""

import json
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

import emclutch
from emclutch.results import load_result
from emclutch.results.accuracy_studies import find_accuracy_study
from emclutch.results.errors import Interrupted, OutputError, RunError
from emclutch.results.recommended import own_choice
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.simulation.discretisation_error import device_of
from emclutch.simulation.forecast import cost
from emclutch.simulation.forecast.space import NotEnoughSpace
from emclutch.simulation.plan import make_plan
from emclutch.studies import powder_law
from emclutch.studies import study as engine
from emclutch.studies.accuracy import answers, budgeted_study, measured_study, planned_values, study, tasks
from emclutch.studies.accuracy.frozen_state import frozen_state
from emclutch.studies.accuracy.tasks import GRAINS, measure_moments, measure_replica
from emclutch.studies.attempt import refuse_taken_over
from emclutch.studies.study import FAILED, Task, perform, read_row

CELL = {
    "scene": {"title": "sheared annulus", "seed": 3},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 0.6e-3},
    "field": {"source": "uniform", "field_strength": "400 kA/m", "direction": "radial"},
    "particles": {"diameter": "0.3 mm", "solid_fraction": 0.5, "sector": "12 deg", "initial_velocity": "sheared"},
    "motion": {"rotor": {"speed": "1500 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"magnetic_force": {}, "dipoles": {"cutoff": 2.5, "model": "mutual"}, "saturation": {}},
    "time": {"end": "5 ms", "window": "20 us", "until": "torque 10 %"},
}
BUDGET = 330.0


class Killed(BaseException):
    """End of a process without a word."""


class Replicas:
    """Torque 1 N m (1 + 20/steps^2 ...), 5 % of noise by the seed; time passes as it is predicted, by this clock."""

    def __init__(self, slower=1.0):
        self.clock, self.done, self.kill_at, self.fails, self.slower = 0.0, [], None, {}, slower

    def __call__(self, task, folder, progress):
        self._ends(task, folder)
        scene = task.case.scene
        for key, words in self.fails.items():
            if key in task.name:
                raise RunError(words)
        noise = np.random.default_rng(zlib.crc32(task.name.encode())).normal(0.0, 0.05)
        torque = (1.0 + 0.5 * (10.0 / scene.span.steps_per_contact) ** 2) * np.exp(noise)
        self.clock += self.slower * (20.0 if task.name != "warm-up" else 1.0)
        means = [torque * (1.0 + 0.01 * n) for n, _ in enumerate(task.options["starts"])]
        return {"torque": torque, "means": means, "grains": 57, "steps": 100}

    def pull(self, task, folder, progress):
        self._ends(task, folder)
        self.clock += 1.0
        return {"moments": 2.0 + task.case.scene.effects.attraction.tolerance, "grains": 57}

    def _ends(self, task, folder):
        if self.kill_at is not None and len(self.done) == self.kill_at:
            self.kill_at = None
            (folder / "history.csv").write_text("half a r")
            raise Killed
        self.done.append(task.name)


@pytest.fixture
def replicas(monkeypatch, tmp_path):
    found = Replicas()
    monkeypatch.setenv("EMCLUTCH_ACCURACY_STUDIES", str(tmp_path / "accuracy_studies"))
    monkeypatch.setattr(study, "measure_replica", found)
    monkeypatch.setattr(study, "measure_moments", found.pull)
    monkeypatch.setattr(answers, "write_answers", lambda *given: ("found",))
    monkeypatch.setattr(planned_values, "process_time", lambda: found.clock)
    for module in (cost, planned_values, measured_study):
        monkeypatch.setattr(module, "slowness", lambda: 1.0)  # else a slow machine needs larger budgets
    clocks = dict.fromkeys(("process_time", "perf_counter", "monotonic"), lambda: found.clock)
    monkeypatch.setattr(engine, "time", SimpleNamespace(**clocks))
    return found


def study_without_dates(result):
    values = json.loads((result.folder / "accuracy_study.json").read_text())
    del values["machine"]
    return values


def test_a_study_that_is_killed_again_and_again_gives_the_same_result(replicas, tmp_path, monkeypatch):
    case = case_from(CELL)
    whole = emclutch.accuracy(case, out=tmp_path / "whole", budget=BUDGET, jobs=1)
    order, replicas.done = replicas.done, []
    for kill_at in (3, 12, 15):
        replicas.kill_at = kill_at
        with pytest.raises(Killed):
            emclutch.accuracy(
                case, out=tmp_path / "cut", budget=None if replicas.done else BUDGET, jobs=1, resume=bool(replicas.done)
            )
    cut = emclutch.accuracy(case, out=tmp_path / "cut", jobs=1, resume=True)
    assert replicas.done == order  # nothing is done twice, in the same order
    assert study_without_dates(cut) == study_without_dates(whole)
    seconds = planned_values.Base.seconds.fget  # of a process that finds the machine at another speed, by round-off
    monkeypatch.setattr(planned_values.Base, "seconds", property(lambda base: seconds(base) * (1.0 + 4e-16)))
    again = emclutch.accuracy(case, out=tmp_path / "cut", jobs=1, resume=True)
    assert study_without_dates(again) == study_without_dates(whole) and replicas.done == order


def test_a_larger_budget_adds_replicas_and_repeats_none(replicas, tmp_path):
    """Also where the process is killed in them; settings that had no time get it, and the error becomes smaller."""
    case, out, small = case_from(CELL), tmp_path / "out", BUDGET / 3.0
    before, done = emclutch.accuracy(case, out=out, budget=small, jobs=1), len(replicas.done)
    replicas.kill_at = done + 2
    with pytest.raises(Killed):
        emclutch.accuracy(case, out=out, budget=3.0 * BUDGET, jobs=1, resume=True)
    after = emclutch.accuracy(case, out=out, jobs=1, resume=True)
    assert len(set(replicas.done)) == len(replicas.done) > done and replicas.clock <= study.OVERRUN * 3.0 * BUDGET
    assert before.study.unknown and not after.study.unknown
    assert after.study.machine["budget"] == 3.0 * BUDGET
    again = emclutch.accuracy(case, out=out, budget=3.0 * BUDGET, jobs=1, resume=True)
    assert study_without_dates(again) == study_without_dates(after) and len(set(replicas.done)) == len(replicas.done)
    assert find_accuracy_study(device_of(case))[0].to_json() == after.study.to_json()


def test_the_study_has_every_setting_and_runs_of_the_device_find_it(replicas, tmp_path):
    case = case_from(CELL)
    found = emclutch.accuracy(case, out=tmp_path / "out", budget=BUDGET, jobs=1)
    measured = found.study
    assert find_accuracy_study(measured.device)[0] == measured and found.answers == ("found",)
    assert {one.name for one in measured.settings} == {
        "sector", "start_up", "moment_tolerance", "overlap", "contact_step", "update_interval",
    } - set(measured.unknown)  # fmt: skip
    assert replicas.clock <= study.OVERRUN * BUDGET
    steps = measured.setting("contact_step")
    coarse = next(one for one in steps.values if one.value == 10.0)
    assert coarse.result == pytest.approx(1.5, abs=3.0 * coarse.error * 1.5) and coarse.replicas > 0
    assert measured.scatter == pytest.approx(0.05, rel=0.5) and measured.strain == 9.0
    own_error = measured.error("contact_step")
    assert abs(own_error.bias - 0.125) < own_error.half_width
    assert measured.error("moment_tolerance").half_width < 0.01  # no noise
    later = measured.setting("start_up").values
    assert [one.value for one in later] == [4.5, 9.0, 13.5] and later[-1].error == 0.0


def test_replicas_are_planned_for_the_targets_that_are_asked_for(replicas, tmp_path, monkeypatch):
    """At the scene's own settings, and at those that come nearest to each target; what a replica leaves is kept."""
    plan, aims = study.more_replicas, []
    monkeypatch.setattr(study, "more_replicas", lambda *given: aims.append(given[-1]) or plan(*given))
    found = emclutch.accuracy(case_from(CELL), out=tmp_path / "out", budget=BUDGET, jobs=1, targets=(0.3, 0.02))
    assert json.loads((tmp_path / "out" / "plan.json").read_text())["targets"] == [0.3, 0.02]
    assert len(aims) == 2 and all(len(some) > 1 for some in aims)
    own, *others = aims[-1]
    assert own.step_sizes["contact_step"] == 1 / 20
    assert any(one.step_sizes["contact_step"] != 1 / 20 for one in others)
    assert own.rest >= own_choice(found.study).statistical * 0.5


def test_what_the_budget_has_no_room_for_is_unknown_and_stays_so(replicas, tmp_path):
    """Replicas that take far longer than the first ones end the study early; it does not begin others later."""
    case, beginning = case_from(CELL), 10
    plan, out = study.first_replicas, tmp_path / "out"

    def slow_from_now_on(*given):
        replicas.slower = 30.0
        return plan(*given)

    study.first_replicas, found = slow_from_now_on, None
    try:
        found = emclutch.accuracy(case, out=out, budget=BUDGET, jobs=1)
    finally:
        study.first_replicas = plan
    known = json.loads((out / "plan.json").read_text())
    first, *others = known["stages"]
    assert known["begun"] is not None and known["begun"] < len(first) and not any(others)
    assert len(replicas.done) < len(first) + beginning and found.study.unknown
    assert all("not measured in this budget: about" in words for words in found.study.unknown.values())
    done = list(replicas.done)
    again = emclutch.accuracy(case, out=out, jobs=1, resume=True)
    assert replicas.done == done and study_without_dates(again) == study_without_dates(found)


def test_a_value_that_fails_says_so_and_the_scene_itself_ends_the_study(replicas, tmp_path):
    replicas.fails = {"overlap-": "grains press in too far"}
    found = emclutch.accuracy(case_from(CELL), out=tmp_path / "value", budget=BUDGET, jobs=1)
    assert "grains press in too far" in found.study.unknown["overlap"]
    replicas.fails = {"own/02": "no"}
    with pytest.raises(RunError, match=r"own/02, at the scene's own settings, has failed: no; change the scene"):
        emclutch.accuracy(case_from(CELL), out=tmp_path / "own", budget=BUDGET, jobs=1)


def test_ctrl_c_keeps_what_is_done(replicas, tmp_path, monkeypatch):
    def stops(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(study, "measure_moments", stops)
    with pytest.raises(Interrupted, match=r"stopped with 5 tasks done; continue with .* --resume"):
        emclutch.accuracy(case_from(CELL), out=tmp_path / "out", budget=BUDGET, jobs=1)


def test_faults_are_told_before_anything_runs(replicas, tmp_path):
    def refused(values, **options):
        case = case_from(CELL).with_values(values)
        with pytest.raises(SceneError) as error:
            emclutch.accuracy(case, out=tmp_path / "out", budget=options.get("budget", BUDGET), jobs=1)
        assert not (tmp_path / "out").exists() and not replicas.done
        return str(error.value)

    text = refused({"accuracy.values.sector": [1.0], "accuracy.values.start_up": [5.0, 30.0]})
    assert "accuracy.values.sector = 1" in text and "remove it from the list" in text
    assert "accuracy.values.start_up = 30 is not before the end of the replicas, strain 18" in text
    text = refused({"accuracy.values.overlap": [0.01, 1e-4], "time.step": "0.08 us"})
    assert text.count("accuracy.values.overlap") == 1 and "accuracy.values.overlap = 0.0001 is no value that" in text
    text = refused({}, budget=1.0)
    assert "--budget = 1 s is less than the 4 replicas" in text and "other settings" in text and "five times" in text
    text = refused({"accuracy.values.rigid_step": ["1 us"], "accuracy.values.contact_step": []})
    assert "accuracy.values.rigid_step = [1e-06] is of contact.dvi.step, which this scene does not use" in text
    assert "accuracy.values.contact_step = [] has no value" in text
    rigid = {"contact.method": "dvi", "particles.sector": None}
    text = refused(rigid | {"accuracy.values.rigid_sweeps": [2.5]}, budget=1e6)
    assert "rigid_sweeps = 2.5 is no value that the scene can have: contact.dvi.max_sweeps is a whole" in text


@pytest.mark.parametrize(("start", "drifts"), [("strain 9", True), ("strain 9", False), ("2 ms", False)])
def test_the_run_that_compiles_ends_before_a_given_average_begins(start, drifts):
    given = CELL["time"] | {"end": "strain 18", "average_from": start, "exclude_drift": drifts}
    base = planned_values.base_of(case_from(CELL | {"time": given}))
    short = make_plan(base.case.with_values(planned_values.compiling_run(base.plan)), threads=1)[1]
    assert 0.0 < short.end <= 4 * base.plan.end / base.plan.windows


def test_a_scene_without_a_disc_is_refused(tmp_path):
    box = CELL | {"geometry": {"kind": "sheared_box", "size": 3 * [2e-3], "shear_rate": 500.0}}
    box |= {"field": CELL["field"] | {"direction": "z", "means": "macroscopic"}, "motion": {}, "time": {"end": "1 ms"}}
    box |= {"particles": {"diameter": "0.3 mm", "solid_fraction": 0.35}}
    with pytest.raises(SceneError, match="has no disc, and accuracy is measured by the disc's torque"):
        emclutch.accuracy(case_from(box), out=tmp_path / "out")


def test_a_scene_that_packs_alike_is_refused(tmp_path):
    lattice = CELL | {"particles": CELL["particles"] | {"packing": "lattice", "solid_fraction": 0.3}}
    with pytest.raises(SceneError, match=r"particles.packing = 'lattice' begins every replica alike"):
        emclutch.accuracy(case_from(lattice), out=tmp_path / "out")


def test_a_finished_study_that_is_shown_again_leaves_a_later_study_in_place(replicas, tmp_path):
    case = case_from(CELL)
    early = emclutch.accuracy(case, out=tmp_path / "early", budget=BUDGET, jobs=1)
    later = emclutch.accuracy(case, out=tmp_path / "later", budget=0.75 * BUDGET, jobs=1)
    assert any(
        "now take their errors from this study" in line and "no longer from one of" in line for line in later.remarks
    )
    again = emclutch.accuracy(case, out=tmp_path / "early", jobs=1, resume=True)
    assert again.remarks == early.remarks and find_accuracy_study(device_of(case))[0].to_json() == later.study.to_json()


def test_a_replica_without_memory_stops_the_study_and_is_run_when_it_continues(replicas, tmp_path, monkeypatch):
    def short(task, *given):
        if task.name == "own/02":
            lack = NotEnoughSpace("needs 9 GiB of memory; 1 GiB are free")
            raise RunError(f"{lack}\n(log: run.log)") from lack
        return replicas(task, *given)

    case, out = case_from(CELL), tmp_path / "out"
    monkeypatch.setattr(study, "measure_replica", short)
    with pytest.raises(Interrupted, match=r"own/02: needs 9 GiB of memory; 1 GiB are free\nstopped with"):
        emclutch.accuracy(case, out=out, budget=BUDGET, jobs=1)
    monkeypatch.setattr(study, "measure_replica", replicas)
    cut, whole = emclutch.accuracy(case, out=out, jobs=1, resume=True), tmp_path / "whole"
    assert study_without_dates(cut) == study_without_dates(emclutch.accuracy(case, out=whole, budget=BUDGET, jobs=1))


def test_folders_of_other_studies_are_refused(replicas, tmp_path, monkeypatch):
    case, out = case_from(CELL), tmp_path / "out"
    with pytest.raises(OutputError, match=r"nothing to resume"):
        emclutch.accuracy(case, out=out, jobs=1, resume=True)
    emclutch.accuracy(case, out=out, budget=BUDGET, jobs=1)
    with pytest.raises(OutputError, match="is not empty; continue it with --resume"):
        emclutch.accuracy(case, out=out, jobs=1)
    with pytest.raises(OutputError, match=r"is of another scene \(field.field_strength\)"):
        emclutch.accuracy(case.with_values({"field.field_strength": "1 kA/m"}), out=out, jobs=1, resume=True)
    with monkeypatch.context() as changed:
        changed.setattr(budgeted_study, "file_contents", lambda scene: {"particles.sizes.file": "changed"})
        with pytest.raises(OutputError, match=r"is of other files \(changed since: particles.sizes.file\)"):
            emclutch.accuracy(case, out=out, jobs=1, resume=True)
    with pytest.raises(OutputError, match=r"has a budget of 6 min, and 1 min is less; .*larger one, which keeps"):
        emclutch.accuracy(case, out=out, jobs=1, budget=60.0, resume=True)


@pytest.mark.parametrize("module", [tasks, powder_law], ids=["replica", "cell"])
def test_a_task_begins_in_the_folder_of_its_attempt(module, tmp_path, monkeypatch):
    """One that is made anew may have another inode, as if another process had taken the task."""

    def run(case, out, **options):
        refuse_taken_over(out)
        raise RunError("begun")

    monkeypatch.setattr(module, "run", run)
    measure = module.measure_replica if module is tasks else module.measure_cell
    row = perform(Task("own/00", case_from(CELL), measure), tmp_path)
    assert (row.state, row.reason) == (FAILED, "begun")


def test_a_replica_gives_the_mean_torque_of_its_run_and_the_frozen_packing(tmp_path):
    case = case_from(CELL).with_values({"accuracy.time_end": "strain 0.2"})
    base = planned_values.base_of(case)
    assert planned_values.starts_of(base) == ["strain 0.1"]  # a run shorter than the start-up: its second half
    case = base.case.with_values({"output.energy_budget": True})  # the step that other tests compile
    task = Task("own/00", case, measure_replica, {"starts": ["strain 0.1"], "keeps_grains": True})
    found, target = perform(task, tmp_path), tmp_path / "own" / "00"
    history = load_result(target).history
    assert found == read_row(target) and found.seconds > 0.0 and found.values["grains"] == 57
    ends = np.append(0.0, history.time)
    impulse = np.append(0.0, np.cumsum(np.diff(ends) * history.torque_disc))
    start = 0.1 / load_result(target).folder.read_plan()["shear_rate"]
    expected = (impulse[-1] - np.interp(start, ends, impulse)) / (ends[-1] - start)
    assert 1.9 * start < ends[-1] <= 2.0 * start * (1.0 + 1e-9)
    assert found.values["torque"] == pytest.approx(expected, rel=1e-9)
    options = {"grains": str(target / GRAINS), "own_key": "effects.dipoles.tolerance"}
    own = perform(Task("frozen/own", base.case, measure_moments, options), tmp_path).values["moments"]
    kept = np.load(target / GRAINS)
    exact = frozen_state(base.case, kept["position"], 2.0 * kept["radius"])
    assert own != exact.squared_moments and own == pytest.approx(exact.squared_moments, rel=0.01)
