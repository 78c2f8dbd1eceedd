"""A shipped study is that of the shipped scene whose name it has, and knows the error of each of its settings."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from emclutch.results.accuracy_studies import SHIPPED, VARIABLE, device_hash
from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.results.recommended import LimitingError, own_choice, reaching
from emclutch.results.text import format_duration, format_percent
from emclutch.scene.case import load_case
from emclutch.scene.flat import flat_scene, keys_at_default
from emclutch.simulation.discretisation_error import accuracy_in_words, accuracy_study_of_device, device_of
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.simulation.plan import make_plan
from emclutch.simulation.recommended_case import cheapest_case
from emclutch.studies.accuracy import fidelities
from emclutch.studies.accuracy.fidelities import estimate_by_other_devices
from emclutch.studies.accuracy.report import changes_in_words

CASES = Path(__file__).parents[2] / "cases"
STUDIES = sorted(SHIPPED.glob("*.json"))


@cache
def shipped(name):
    """The study of a shipped scene."""
    return next(one for path in STUDIES if (one := AccuracyStudy.from_json(path.read_text())).case == name)


@cache
def answer_of(name, target):
    """The cheapest settings of a shipped scene for a target, or what limits it: some seconds."""
    return cheapest_case(load_case(CASES / f"{name}.toml"), shipped(name), target)


def test_the_quickstart_has_one(monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    case = load_case(CASES / "quickstart.toml")
    _, path = accuracy_study_of_device(case)
    assert path in STUDIES
    assert "Largest remaining error: " in accuracy_in_words(case, make_plan(case)[1])


def test_an_old_file_is_named_once_and_the_shipped_one_used(monkeypatch, tmp_path, caplog):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    case = load_case(CASES / "quickstart.toml")
    (old := tmp_path / f"{device_of(case)}.json").write_text('{"version": 1}')
    assert accuracy_study_of_device(case)[1] == accuracy_study_of_device(case)[1] == SHIPPED / old.name
    assert caplog.text.count(f"{old} is no study of this version (it is of version 1 of accuracy studies") == 1


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_the_page_has_the_answers_of_this_version(path, monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    study = AccuracyStudy.from_json(path.read_text())
    page = re.sub(r"\n +", " ", (CASES.parent / "docs" / "accuracy.md").read_text())  # an item in one line
    for target in (0.10, 0.05, 0.03):
        answer = answer_of(study.case, target)
        if isinstance(answer, LimitingError):
            line = re.search(rf"^- \*\*(.*)\*\*: {re.escape(answer.in_words())}\.", page, re.MULTILINE)
            assert line and f"± {format_percent(target)}" in line[1].split(" and ")  # equal answers share a line
        else:
            values, replicas = changes_in_words(study, answer[0]) or "none", answer[0].replicas
            assert f"| {format_percent(target)} | {values} | {replicas} |" in page


def test_the_ten_lines_have_the_numbers_of_the_studies():
    """Cost and half width of lines 4 to 6 are those of the brake's study; line 7 has what two studies took."""
    brake, quickstart = shipped("powder_clutch"), shipped("quickstart")
    cheapest, _ = answer_of("powder_clutch", 0.1)
    lines = re.split(r"\n\d+\. ", (CASES.parent / "docs" / "accuracy.md").read_text())
    for line, choice in ((lines[4], cheapest), (lines[5], own_choice(brake))):
        cost = f"{format_duration(choice.seconds)}** ({format_duration(choice.wall_seconds(2))})"
        assert cost in line and f"± {format_percent(choice.half_width)}" in line
    limit = answer_of("powder_clutch", 0.05)
    assert limit.seconds == answer_of("powder_clutch", 0.03).seconds
    assert f"{format_duration(limit.seconds)}** ({format_duration(limit.seconds / 2)})" in lines[6]
    for study in (brake, quickstart):
        assert format_duration(study.machine["processor_seconds"]) in lines[7]


def test_a_key_that_is_new_in_the_program_orphans_no_study():
    """At its default; any other entry of it is another device."""
    case = load_case(CASES / "quickstart.toml")
    flat, default = flat_scene(case.toml()), set(keys_at_default(case.scene))
    known = device_hash(flat, (), default)
    assert device_hash(flat | {"geometry.new": 0.0}, (), default | {"geometry.new"}) == known
    assert device_hash(flat | {"geometry.new": 1.0}, (), default) != known
    assert "contact.friction" in default and device_hash(flat | {"contact.friction": 0.4}, (), default) != known


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_it_is_of_a_shipped_scene_as_it_is_now(path):
    study = AccuracyStudy.from_json(path.read_text())
    assert device_of(load_case(CASES / f"{study.case}.toml")) == study.device == path.stem
    total = study.total({one.name: one.values[0].step_size for one in study.settings})
    assert study.unknown == {} and total.unknown == {} and study.machine["slowness"] > 0.0


def test_other_devices_estimate_what_grains_will_cost(monkeypatch):
    """The brake's study predicts the quickstart's cost within COST_FACTOR; a missed target names its limit."""
    brake, quickstart = shipped("powder_clutch"), shipped("quickstart")
    case = load_case(CASES / "quickstart.toml")
    monkeypatch.setattr(fidelities, "known_studies", lambda: [brake])
    estimate = estimate_by_other_devices(case, 0.1, 30.0, 1)
    own, _ = answer_of("quickstart", 0.1)
    low, high = estimate["seconds"]
    assert estimate["devices"] == ["powder_clutch"]
    assert low < own.seconds * slowness() / quickstart.machine["slowness"] < high
    missed = estimate_by_other_devices(case, 0.02, 30.0, 1)
    assert missed["seconds"] is None and 0.02 < missed["half_width"] < 0.1 and missed["limit"] in brake.told
    assert f"reach ± {format_percent(missed['half_width'])} at best, limited by the " in missed["words"]


def test_studies_of_the_same_kind_estimate_a_device():
    """The disc clutch estimates another disc clutch; the two drums do not."""
    case = load_case(CASES / "disc_clutch.toml", {"geometry.face_gap": "1.1 mm"})
    estimate = estimate_by_other_devices(case, 0.05, 400.0, 2)
    assert estimate["devices"] == ["disc_clutch"] and estimate["limit"] == "grains_per_gap"


def test_the_inertial_number_counts_where_no_scene_imposes_it(monkeypatch):
    """Coarse grains at the real speed have a larger inertial number than the powder."""
    brake = next(one for one in (AccuracyStudy.from_json(path.read_text()) for path in STUDIES)
                 if one.case == "powder_clutch")  # fmt: skip
    case = load_case(CASES / "quickstart.toml")
    assert case.scene.accuracy.inertial_number is None and brake.setting("inertial_number") is not None
    monkeypatch.setattr(fidelities, "known_studies", lambda: [brake])
    assert estimate_by_other_devices(case, 0.02, 30.0, 1)["limit"] == "inertial_number"


def test_settings_that_a_scene_refuses_estimate_nothing(monkeypatch):
    """A study whose settings reach the target, and are refused, is none that misses it; nor is one beside it named."""
    brake, quickstart = shipped("powder_clutch"), shipped("quickstart")
    best, case = next(reaching(brake, 0.1)), load_case(CASES / "quickstart.toml")
    missed = LimitingError("grains_per_gap", 0.2, None, best=replace(best, statistical=0.2))
    answers = {brake.case: LimitingError("field_mesh", None, None, "refused", best), quickstart.case: missed}
    monkeypatch.setattr(fidelities, "known_studies", lambda: [brake, quickstart])
    monkeypatch.setattr(fidelities, "cheapest_at", lambda case, study, target: answers[study.case])
    estimate = estimate_by_other_devices(case, 0.1, 30.0, 1)
    assert estimate["devices"] == [quickstart.case] and estimate["half_width"] > 0.2
    answers[quickstart.case] = (best, case)
    reached = estimate_by_other_devices(case, 0.1, 30.0, 1)
    answers[brake.case] = missed
    again = estimate_by_other_devices(case, 0.1, 30.0, 1)
    assert again | {"words": ""} == reached | {"words": ""} and reached["devices"] == [quickstart.case]
    assert "With the errors of powder_clutch runs of grains reach ± 22 % at best" in again["words"]
    monkeypatch.setattr(fidelities, "cheapest_at", lambda case, study, target: answers[brake.case])
    answers[brake.case] = LimitingError("field_mesh", None, None, "refused", best)
    assert estimate_by_other_devices(case, 0.1, 30.0, 1) is None
