"""Output of an accuracy study: scenes that have the settings of the study, and tables with every value."""

import dataclasses
import math
import tomllib

import pandas
import pytest
from made_up_study import cell, contact_step, study, without_error

from emclutch.results.accuracy_study import Basis, MeasuredSetting, MeasuredValue
from emclutch.results.recommended import Choice, recommended
from emclutch.scene.case import load_case
from emclutch.settings import settings_of
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, Interval
from emclutch.simulation.plan import make_plan
from emclutch.simulation.recommended_case import case_for
from emclutch.studies.accuracy.answers import scene_text, write_answers
from emclutch.studies.accuracy.fidelities import CheapestAnswer, TorqueByLaw
from emclutch.studies.accuracy.report import accuracy_report


def by_law(high, guess=False):
    """Of a torque of 1 N m."""
    parts = {} if guess else {"form": high - 1.0}
    expected = ExpectedTorque(Interval(1.0, 1.0 / high, high, guess), "a law", parts=parts)
    return TorqueByLaw(expected, 2.0, "emclutch check CASE")


LAW = by_law(1.07)


@pytest.fixture(scope="module")
def case():
    return cell(particles__sector="40 deg", time__end="strain 18", time__average_from=None)


@pytest.fixture(scope="module")
def own(case):
    plan = make_plan(case)[1]
    return {one.name: one.own(case.scene, plan) for one in settings_of(case.scene)}


def settings(own):
    wide, step = own["sector"], contact_step(0.004, 0.01, own["contact_step"])
    values = [
        MeasuredValue(f * wide, 1 / (f * wide), 1.948 + 0.06 / f**2, 0.01 / f**0.5, 2, 3 * f, f) for f in (1.0, 2.0)
    ]
    failed = MeasuredValue(80.0, 1.0 / 80.0, None, 0.0, 0, 0.1, 1.2, "does not converge")
    sector = MeasuredSetting("sector", "particles.sector", Basis.TORQUE, wide, 2.0, 0.0, tuple(values), 20.0)
    return sector, dataclasses.replace(step, values=(*step.values, failed))


@pytest.fixture
def without_picture(monkeypatch):
    monkeypatch.setattr("emclutch.studies.accuracy.answers.accuracy_picture", lambda *_, **__: None)


@pytest.fixture(scope="module")
def rest(case, own):
    return without_error(case, make_plan(case)[1], settings(own))


def whole(own, rest, **values):
    return study("abc", *settings(own), *rest, scatter=0.02, **values)


def test_scenes_have_the_settings_of_the_study(tmp_path, case, own, rest, without_picture):
    write_answers(case, whole(own, rest), tmp_path, (0.05, 0.1), (), LAW)
    for target in (0.05, 0.1):
        found = load_case(tmp_path / f"target_{100 * target:g}_percent.toml")
        choice = recommended(whole(own, rest), target)
        plan = make_plan(found)[1]
        for setting in settings_of(found.scene):
            if setting.name in choice.values:  # some are whole numbers
                expected = choice.values[setting.name]
                assert setting.own(found.scene, plan) == pytest.approx(expected, rel=0.02), setting.name
        statistical = found.scene.time.until.relative
        assert math.hypot(statistical, choice.total.half_width) == pytest.approx(target, rel=0.01)
        assert statistical >= choice.statistical
        assert found.scene.accuracy.replicas is None
        assert found.scene.accuracy.max_replicas >= 24
        assert str(found.scene.time.end) == "strain 18"


def test_a_scene_says_where_it_comes_from_and_by_what_its_torque_is_to_be_divided(case, own, rest):
    of = whole(own, rest)
    choice = recommended(of, 0.05)
    text = scene_text(case_for(case, of, choice, 0.05)[1], of, choice, 0.05, "target_5_percent.toml")
    assert tomllib.loads(text)["time"]["until"].startswith("torque ")
    for words in ("emclutch run target_5_percent.toml", "2026-01-01", "abc", f"{1.0 + choice.total.bias:.4g}"):
        assert any(words in line for line in text.splitlines() if line.startswith("#")), words
    kept = Choice({one.name: own[one.name] for one in of.settings}, choice.total, 4, 0.02, 0.01, 1.0)
    data = case_for(case, of, kept, 0.5)[1].data  # settings that are the scene's own remain automatic
    assert (data["effects"], data["particles"]) == (case.data["effects"], case.data["particles"])


def test_a_combination_that_the_scene_refuses_is_passed_over(tmp_path, case, own, rest, without_picture):
    """Settings are measured one at a time; a wide sector that does not fit the ring is not the answer."""
    sector, *others = settings(own)
    wide = MeasuredValue(500.0, 1.0 / 500.0, 2.0, 0.001, 2, 0.1, 0.01)
    of = study("abc", MeasuredSetting("sector", "particles.sector", Basis.TORQUE, own["sector"], 2.0, 0.0,
                                  (*sector.values, wide), 20.0), *others, *rest, scatter=0.02)  # fmt: skip
    assert recommended(of, 0.1).values["sector"] == 500.0
    write_answers(case, of, tmp_path, (0.1,), (), LAW)
    assert load_case(tmp_path / "target_10_percent.toml").scene.grains.sector < 3.2


def test_what_is_not_reached_has_a_reason_and_no_scene(tmp_path, case, own, rest, without_picture):
    (tmp_path / "target_0.1_percent.toml").write_text("of an earlier study")

    def said(of, target):
        answers = write_answers(case, of, tmp_path, (target,), (), LAW)
        return [one.text for one in accuracy_report(of, answers, tmp_path, (), LAW).statements()]

    assert any("0.1 %: not reached" in line and "limited by the" in line for line in said(whole(own, rest), 0.001))
    assert not list(tmp_path.glob("target*"))
    reason = {"grains_per_gap": "not measured in this budget: about 9 min more"}
    lines = said(whole(own, rest, unknown=reason), 0.1)
    assert lines[-1].startswith(
        "± 10 %: reached by the law of the powder (± 7 %); the error of the setting grains per gap"
    )
    assert "9 min" in lines[-1]


def test_tables_have_every_value(tmp_path, case, own, rest):
    of = whole(own, rest)
    write_answers(case, of, tmp_path, (0.05,), (), LAW)
    table = pandas.read_csv(tmp_path / "accuracy.csv")
    assert len(table) == sum(len(one.values) for one in of.settings) and table["own"].sum() == len(of.settings)
    row = table[(table.setting == "sector") & table.own].iloc[0]
    assert row.bias == pytest.approx(of.error("sector").bias)
    assert table.failure.dropna().tolist() == ["does not converge"]
    text, page = ((tmp_path / name).read_text() for name in ("accuracy.md", "index.html"))
    assert "(accuracy.png)" in text and "data:image/png" in page and (tmp_path / "accuracy.png").stat().st_size > 1000
    for name in ("sector", "update_interval", "friction"):
        assert name in text and name in page


def test_the_law_is_the_cheapest_where_its_interval_is_within_the_target(tmp_path, case, own, rest, without_picture):
    """Else the settings that the study found; a guess reaches nothing. Only the reason is left where nothing does."""
    of = whole(own, rest)

    def found(law, targets):
        answers = write_answers(case, of, tmp_path, targets, (), law)
        return accuracy_report(of, answers, tmp_path, (), law)

    report = found(LAW, (0.1, 0.05, 0.001))
    law, grains, nothing = report.data["cheapest"]
    assert (law["fidelity"], law["half_width"], law["seconds"]) == ("law", pytest.approx(0.07), 2.0)
    assert (
        grains["fidelity"] == "grains" and grains["half_width"] <= 0.05 and "target_5_percent.toml" in grains["command"]
    )
    assert nothing["fidelity"] is None and "limited by the sector (± " in nothing["reason"]
    lines = [one.text for one in report.statements()]
    assert any(
        "± 10 %: reached by the law of the powder" in line and "; runs of grains reach ± " in line for line in lines
    )
    guess = found(by_law(1.07, guess=True), (0.1,))
    assert guess.data["law"]["half_width"] is None and guess.data["cheapest"][0]["fidelity"] == "grains"
    assert any("reaches no target" in one.text for one in guess.statements())
    without_study = CheapestAnswer(target=0.1, law=by_law(1.2), grains=None, command="emclutch accuracy CASE", cores=1)
    assert without_study.fidelity is None and "no accuracy study" in without_study.as_dict()["reason"]
