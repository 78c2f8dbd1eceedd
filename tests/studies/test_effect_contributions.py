"""Torque with all effects less torque without one is what it adds; a scene is valid without what is left out."""

import csv
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ttest_ind

import emclutch
from emclutch.results.atomic_file import replace_json
from emclutch.results.effect_contributions import Contributions, Without
from emclutch.results.errors import Interrupted
from emclutch.scene.case import case_from, load_case
from emclutch.scene.errors import SceneError
from emclutch.studies import study as engine
from emclutch.studies.accuracy.effect_contributions import effect_contributions, removals, write_effects
from emclutch.studies.study import DONE, STOPPED, Row

CASES = Path(__file__).parents[2] / "cases"
TOY = {
    "scene": {"title": "Grains between two cylinders", "seed": 5},
    "geometry": {"kind": "shear_cell", "inner_radius": "20 mm", "outer_radius": "26 mm", "height": "6 mm"},
    "particles": {"diameter": "2 mm", "count": 40},
    "contact": {"friction": 0.3, "restitution": 0.5},
    "motion": {"rotor": {"speed": "600 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"gravity": {}, "rolling_friction": {"coefficient": 0.2}},
    "time": {"end": "2 ms"},
}


def test_what_needs_an_effect_is_left_out_with_it():
    found = {one.effect: one for one in removals(load_case(CASES / "quickstart.toml"))}
    assert found["dipoles"].others == ("wall_images", "back_reaction")
    assert found["magnetic_force"].others == found["wall_images"].others == ("back_reaction",)
    assert found["back_reaction"].others == found["rolling_friction"].others == ()
    heated = load_case(CASES / "quickstart.toml", {"effects.heat": {}})
    assert {one.effect: one.reason for one in removals(heated)}["heat"] == "a run of the grains does not depend on it"


@pytest.mark.parametrize("name", ["quickstart", "switch_on", "thesis/electromagnetic", "hard/mutual_and_dense"])
def test_a_scene_is_valid_without_what_is_left_out(name):
    case = load_case(CASES / f"{name}.toml")
    found = removals(case)
    assert [one.effect for one in found] == list(case.scene.effects.active)
    for one in found:
        if not one.reason:
            assert not {one.effect, *one.others} & set(case.with_values(one.values).scene.effects.active)


def test_an_effect_that_a_setting_needs_is_kept_with_the_reason():
    found = {one.effect: one for one in removals(load_case(CASES / "quickstart.toml"))}
    assert "near_field" in found["saturation"].reason
    case = load_case(CASES / "hard/mutual_and_dense.toml")
    assert not next(one for one in removals(case) if one.effect == "saturation").reason


def test_the_interval_of_a_difference_is_that_of_welch():
    rng = np.random.default_rng(3)
    a, b = rng.normal(1.0, 0.1, 6), rng.normal(0.8, 0.3, 3)
    low, high = ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    found = Contributions("two", Without("", (), tuple(a)), (), ()).torque(Without("effect", (), tuple(b)))
    assert found.interval() == pytest.approx((low, high), rel=1e-6)


def contributions() -> Contributions:
    """Return a scene whose torque is due to one of its effects."""
    whole = Without("", (), (0.78, 0.81, 0.76, 0.80, 0.77, 0.79), 25.0)
    return Contributions(
        "toy",
        whole,
        (
            Without("dipoles", ("wall_images",), (0.05, 0.06, 0.04), 8.0),
            Without("saturation", reason="is needed by near_field"),
            Without("wall_images", (), (0.75, 0.84, 0.78), 20.0),
        ),
        ("gravity",),
    )


def test_the_sentence_names_what_carries_the_torque_and_what_is_not_significant():
    text = " ".join(contributions().in_words())
    assert "dipoles (with wall_images)" in text
    assert "68 % of the time" in text
    assert text.endswith("Not significant with so many replicas: wall_images.")


def test_tables_have_every_effect_and_the_reason_of_those_that_stay(tmp_path):
    write_effects(contributions(), tmp_path)
    rows = list(csv.DictReader((tmp_path / "effects.csv").read_text().splitlines()))
    assert [row["left_out"] for row in rows] == ["", "dipoles", "saturation", "wall_images"]
    assert float(rows[1]["adds_torque"]) == pytest.approx(0.785 - 0.05)
    assert (rows[1]["significant"], rows[3]["significant"]) == ("True", "False")
    assert rows[2]["reason"] == "is needed by near_field"
    page = (tmp_path / "effects.md").read_text()
    assert "cost no time: gravity" in page
    assert "effects.png" in page
    assert page.startswith("# What each effect adds: toy\n")


class Replicas:
    """Stands for the runs of a study: a torque by seed, 2 s each; the third to come is stopped."""

    def __init__(self):
        self.done, self.stops = [], 2

    def __call__(self, task, study, progress):
        if len(self.done) == self.stops:
            self.stops = -1
            return Row(STOPPED)
        self.done.append(task.name)
        row = Row(DONE, {"torque": 1.0 + (task.case.scene.scene.seed % 7) / 100.0}, seconds=1.0, wall=2.0)
        (study / task.name).mkdir(parents=True)
        replace_json(study / task.name / "row.json", asdict(row))
        return row


def test_a_study_that_continues_runs_nothing_twice_and_ends_with_the_same_table(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "perform", replicas := Replicas())
    case, options = case_from(TOY), {"budget": 100.0, "jobs": 1}
    stopped, whole = tmp_path / "stopped", tmp_path / "whole"
    with pytest.raises(Interrupted, match="--resume"):
        effect_contributions(case, out=stopped, **options)
    found = effect_contributions(case, out=stopped, jobs=1, resume=True)
    assert len(set(replicas.done)) == len(replicas.done)
    rounds = json.loads((stopped / "effects_plan.json").read_text())["rounds"]
    assert rounds == 100 // (4 * 2)  # of two whole scenes and two others
    assert len(replicas.done) == 3 + 4 * rounds  # and a short run of each
    assert found.contributions == effect_contributions(case, out=whole, **options).contributions
    assert {one.effect for one in found.contributions.measured} == {"gravity", "rolling_friction"}


def test_a_budget_that_is_too_short_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(SceneError, match="--budget"):
        effect_contributions(case_from(TOY), out=tmp_path / "study", budget=1e-3, jobs=1)
    assert not (tmp_path / "study").exists()


def test_a_scene_without_effects_has_nothing_to_leave_out(tmp_path):
    with pytest.raises(SceneError, match="nothing to leave out"):
        effect_contributions(case_from(TOY, {"effects": {}}), out=tmp_path / "study", jobs=1)


def test_the_study_is_in_the_library():
    assert emclutch.effect_contributions.__wrapped__ is effect_contributions
