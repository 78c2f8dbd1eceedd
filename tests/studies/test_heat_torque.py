"""The torque that heats: the law of the powder at each current and temperature, scaled to a measurement; limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest

from emclutch.device_model.heat_model import POWDER
from emclutch.results import Result, RunFolder
from emclutch.results.report.render import terminal
from emclutch.results.report.report import Mark
from emclutch.results.statistics import Estimate
from emclutch.scene.case import load_case
from emclutch.scene.errors import SceneError
from emclutch.studies import heat_torque
from emclutch.studies.design_search import expectation_of
from emclutch.studies.heat import _hottest_places, _Study, heat
from emclutch.studies.heat_report import _limits as heat_report_limits
from emclutch.studies.heat_report import heat_report

CASES = Path(__file__).resolve().parents[2] / "cases"
SLOW = {"motion.rotor.speed": "50 rpm", "field.size_factor": 3.0, "effects.heat": {"duty": {"end": "60 s"}}}
RPM = np.pi / 30.0
STEADY = Estimate(None, 0.001, 20, 1e-3, 0.01, True, "the signal drifts", remedy="run longer")


def small(**values):
    return load_case(CASES / "quickstart.toml", SLOW | values)


def exact(current, temperature, **values):
    return expectation_of(small(**{"coil.current": current, "field.temperature": temperature} | values)).torque


@pytest.fixture(scope="module")
def study():
    return _Study.of(small(), None)


def test_between_the_points_the_torque_is_the_law_s(study):
    """At currents and temperatures that none of the points has: within 0.3 % of the largest torque, 0.02 % in theta."""
    torque, largest = study.model.torque, study.torque_summary["value"]
    assert largest == pytest.approx(exact(1.0, 20.0), rel=1e-9)
    for current, temperature in ((0.22, 20.0), (0.47, 150.0), (0.83, -40.0)):
        assert torque(current, temperature) == pytest.approx(exact(current, temperature), abs=3e-3 * largest)
    assert torque(0.0, 20.0) == 0.0 < exact(0.0, 20.0)  # which is a bound of the friction without a field
    for temperature in (-40.0, 120.0, 240.0):
        m = heat_torque.saturation_ratio(temperature)
        assert torque(m, temperature) == pytest.approx(exact(m, temperature), rel=2e-4)  # at a point


def test_the_torque_rises_with_the_current_and_falls_with_the_temperature(study):
    """Where the field saturates anything: in a field that is linear the torque does not depend on Ms."""
    at = np.array([[study.model.torque(I, theta) for theta in range(-60, 280, 20)] for I in np.linspace(0.1, 1.0, 46)])
    assert np.all(np.diff(at, axis=0) > 0.0) and np.all(np.diff(at[:, :16], axis=1) < 0.0)
    assert np.array_equal(at[:, 16], at[:, -1])  # beyond 250 degrees C that at its end


def test_powder_whose_saturation_is_constant_does_not_fade(monkeypatch):
    monkeypatch.setattr(heat_torque, "saturation_ratio", lambda _: 1.0)
    torque = _Study.of(small(), None).model.torque
    assert torque(0.7, 20.0) == torque(0.7, 240.0) > 0.0


def test_at_a_voltage_current_torque_and_temperatures_agree():
    """R(T) I = U, P = T(I, theta) omega by the law at both, and what both make leaves."""
    drive = {"coil.current": None, "coil.voltage": "9 V", "coil.resistance": "20 ohm"}  # and turns, which the law needs
    study = _Study.of(small(**drive), None)
    row, _ = study.steady()
    assert study.model.resistance(row["coil_mean"]) * row["current"] == pytest.approx(9.0, rel=1e-9)
    own = exact(row["current"], row["powder_mean"], **{"coil.voltage": None})
    assert row["torque"] == pytest.approx(own, rel=5e-3)
    assert row["slip_power"] == pytest.approx(row["torque"] * 50.0 * RPM, rel=1e-9)
    assert row["heat_out"] == pytest.approx(row["slip_power"] + row["copper_loss"], rel=1e-7)
    cold = exact(study.torque_summary["current"], 20.0, **{"coil.voltage": None})
    assert row["torque"] < 0.9 * cold == pytest.approx(0.9 * study.torque_summary["value"], rel=1e-6)


def test_a_measured_torque_scales_the_law(study, monkeypatch):
    """effects.heat.torque at the coil's current, a run's at the run's; fade replaces the law's change with theta."""
    law = study.model.torque
    fade = {"temperatures": [20.0, 120.0], "factors": [1.0, 0.8]}
    scaled = _Study.of(small(**{"effects.heat.torque": "1.1 N m", "effects.heat.fade": fade}), None)
    ratio = 1.1 / law(1.0, 20.0)
    for current in (0.3, 1.0):
        assert scaled.model.torque(current, 20.0) == pytest.approx(ratio * law(current, 20.0), rel=1e-9)
        assert scaled.model.torque(current, 70.0) == pytest.approx(0.9 * ratio * law(current, 20.0), rel=1e-9)
    assert not scaled.ends and f"law of the powder times {ratio:.4g}" in scaled.torque_summary["at_other_currents"]
    monkeypatch.setattr(heat_torque, "load_result", lambda _: finished_run(STEADY, -0.25))
    of_run = _Study.of(small(), "runs/a").model.torque
    assert of_run(0.4, 20.0) == pytest.approx(0.2, rel=1e-9)
    assert of_run(0.8, 150.0) == pytest.approx(0.2 * law(0.8, 150.0) / law(0.4, 20.0), rel=5e-3)


def finished_run(raw, mean):
    """A run at -0.4 A with a raw torque [N m], which its grains' size raises by a quarter."""
    summary = {"torque": replace(raw, mean=mean).as_dict(), "current": -0.4,
               "grain_size": {"torque_excess": 0.25, "torque_excess_low": 0.2, "torque_excess_high": 0.3}}  # fmt: skip
    found = Result(RunFolder("runs/a"), summary)
    found._history = pandas.DataFrame({"torque_disc": [mean]})
    return found


def test_a_torque_that_the_run_itself_does_not_know_is_refused(monkeypatch):
    monkeypatch.setattr(heat_torque, "load_result", lambda _: finished_run(replace(STEADY, converged=False), -0.25))
    with pytest.raises(ValueError, match=r"runs/a is not known \(the signal drifts\); run longer, or give effects"):
        _Study.of(small(), "runs/a")


def test_a_given_slip_power_is_the_heat_of_the_powder_while_the_coil_is_on():
    """P t_on, as of the torque P / omega: at the law's current, at a given one, without a law, and with a voltage."""
    duty = {"end": "60 s", "period": "20 s", "on": "5 s"}
    alone = {"particles": None, "effects": {"heat": {"slip_power": "20 W", "duty": duty}}, "time": None}
    drive = {"coil.current": None, "coil.voltage": "9 V", "coil.resistance": "20 ohm"}
    by_law = {"effects.heat.slip_power": "2 W", "effects.heat.duty": duty}
    given = {"effects.heat.slip_power": "20 W", "effects.heat.duty": duty | {"current": "0.5 A"}}
    for power, values in ((2.0, by_law), (20.0, given), (20.0, alone), (20.0, alone | drive)):
        study = _Study.of(small(**values), None)
        table, summary, _ = study.through_the_duty(None)
        assert summary["heat_of_slip"] == pytest.approx(power * 15.0, rel=1e-6)
        assert table["slip_power"].max() == pytest.approx(power)
        told = study.torque_summary.get("full_current", "")
        assert (values is by_law) == (told == "") and ("duty.current" in told) == (values is given)


@pytest.mark.parametrize(
    "coil", [{}, {"coil.current": None, "coil.voltage": "20 V", "coil.resistance": "20 ohm"}]
)
def test_the_current_of_a_slip_power_is_that_of_the_law_at_the_temperature_of_the_powder(coil, study):
    """T(I, theta) omega = P; the warm powder needs more current; both powers leave; the permitted one is at a limit."""
    power = 1.0
    given = {"effects.heat.slip_power": f"{power} W", "effects.heat.powder_limit": "60 degC"}
    own = _Study.of(small(**given | coil), None)
    row, _ = own.steady()
    torque, cold = study.model.torque, own.torque_summary["needed_current"]
    assert torque(cold, 20.0) * 50.0 * RPM == pytest.approx(power, rel=1e-6)
    assert torque(row["current"], row["powder_mean"]) * 50.0 * RPM == pytest.approx(power, rel=1e-6)
    assert cold < row["current"] < 1.0 and row["slip_power"] == pytest.approx(power, rel=1e-9)
    assert row["copper_loss"] == pytest.approx(own.model.resistance(row["coil_mean"]) * row["current"] ** 2, rel=1e-9)
    assert row["heat_out"] == pytest.approx(row["slip_power"] + row["copper_loss"], rel=1e-7)
    (permitted,) = own.permitted([50.0 * RPM]).to_dict("records")
    assert permitted["slip_power"] == min(permitted[f"by_{place}"] for place in ("surface", "coil", "powder"))
    assert permitted["slip_power"] == permitted["by_powder"]
    assert permitted["powder_hottest"] == pytest.approx(60.0, abs=0.01)
    assert permitted["torque"] * 50.0 * RPM == pytest.approx(permitted["slip_power"], rel=1e-9)
    high, low = (own.with_torque_times(by).steady()[0]["current"] for by in (1.1, 0.9))
    assert high < row["current"] < low


@pytest.mark.parametrize(
    ("values", "words"),
    [({"effects.heat.torque": "1 N m"}, r"gives 1 N m at the largest current, 1 A; the largest slip power is 5.24 W"),
     ({"effects.heat.slip_power": "20 N m"}, "is a torque or an energy; a power is needed"),
     ({"motion.rotor.speed": 0.0}, "needs a slip: give effects.heat.duty.slip, or a speed")],
)  # fmt: skip
def test_a_slip_power_that_cannot_be_is_told(values, words, tmp_path):
    with pytest.raises(SceneError, match=words):
        heat(small(**{"effects.heat.slip_power": "20 W"} | values), out=tmp_path / "heat")


def test_the_permitted_power_is_that_of_its_current_and_meets_a_limit(study):
    slip = 50.0 * RPM
    problem, (row,) = study.problem, study.permitted([slip]).to_dict("records")
    found = problem.steady(lambda means: study.model.powers(type(study.peak)(row["current"], slip=slip), means))
    places = _hottest_places(problem, found)
    assert max(places["surface"] - 75.0, places["coil_hottest"] - 130.0) == pytest.approx(0.0, abs=0.01)
    assert row["torque"] == pytest.approx(study.model.torque(row["current"], problem.means(found)[POWDER]), rel=1e-6)
    ends = [study.with_torque_times(by).permitted([slip])["current"][0] for by in (0.9, 1.1)]
    assert ends[0] > row["current"] > ends[1]
    assert study.permitted([1e-6])["current"][0] <= study.peak.current  # no more than the duty has


@pytest.mark.parametrize("slip_power", [None, "1 W"])
def test_the_warm_coil_at_its_voltage_transmits_the_permitted_power(slip_power):
    """Limits that are never met: the power is the steady one at U/R(T), less than the cold torque has."""
    drive = {"coil.current": None, "coil.voltage": "9 V", "coil.resistance": "20 ohm"}
    limits = {"effects.heat.surface_limit": "1000 degC", "effects.heat.coil_limit": "250 degC"}
    study = _Study.of(small(**drive | limits | {"effects.heat.slip_power": slip_power}), None)
    (row,) = study.permitted([50.0 * RPM]).to_dict("records")
    steady, _ = replace(study, peak=replace(study.peak, torque=None)).steady()
    assert row["slip_power"] == row["by_surface"] == row["by_coil"] == pytest.approx(steady["slip_power"], rel=1e-6)
    assert row["current"] * study.model.resistance(steady["coil_mean"]) == pytest.approx(9.0, rel=1e-6)
    assert row["slip_power"] < 0.95 * study.model.torque(9.0 / study.model.R_20, 20.0) * 50.0 * RPM


def test_the_report_says_the_torque_and_its_ends(tmp_path):
    found = heat(small(**{"coil.current": "0.4 A"}), speeds=[5.0], out=tmp_path / "heat")
    steady, ends = found.summary["steady"], found.summary["steady_at_the_ends"]
    assert ends["low"]["surface"] < steady["surface"] < ends["high"]["surface"]
    assert np.all(np.isfinite(found.permitted)) and (found.permitted["current"] <= 0.4).all()
    words = " ".join(terminal(found.report()).split())
    assert "Torque at 0.4 A and 20 °C by the law of the powder" in words
    assert "steady, weaker powder" in words and "The friction of the powder is taken as constant" in words
    assert "Steady state at 0.4 A with" in words
    found.summary["torque"]["is_guess"], found.summary["voltage"] = True, 24.0
    words = " ".join(terminal(heat_report(found.folder, found.summary, found.permitted)).split())
    assert "! Torque at 0.4 A" in words and "Steady state at 24 V (0.4 A through the warm coil) with" in words


@pytest.mark.parametrize(
    ("duty", "all_the_time", "marks"),
    [
        ({}, True, "✓ ! !"),  # a short duty below both limits, which a longer one of the same exceeds
        ({}, False, "✓"),  # switched: on all the time is another duty
        ({"steady": {"surface": 90.0, "coil_hottest": 120.0}}, False, "✓ !"),
        ({"surface_limit_passed_after": 300.0}, True, "! !"),
        ({"steady": None}, False, "✓ !"),  # its mean power runs away
    ],
)
def test_a_duty_below_its_limits_may_be_too_short_to_reach_them(duty, all_the_time, marks):
    passed = {"surface_limit_passed_after": None, "coil_hottest_limit_passed_after": None}
    summary = {"limits": {"surface": 75.0, "coil_hottest": 130.0}, "on_all_the_time": all_the_time,
               "steady": {"surface": 180.0, "coil_hottest": 160.0}, "duty": passed | duty}  # fmt: skip
    said = list(heat_report_limits(summary))
    assert " ".join({Mark.GOOD: "✓", Mark.WARNING: "!"}[one.mark] for one in said) == marks
    if "surface_limit_passed_after" in duty:
        assert said[0].text == "The surface exceeds its limit of 75 °C after 5 min of the duty."
