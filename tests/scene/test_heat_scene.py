"""[effects.heat]: what leaves is what slip and copper make; limits, duty, runaway and cold start; refusals."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.device_model.coil_heat import housing_rise, steady_rise
from emclutch.device_model.heat_model import COIL, POWDER, Drive, HeatModel, heat_problem, resistance_at_20
from emclutch.results.report.render import terminal
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.studies import heat as heat_study
from emclutch.studies import heat_torque
from emclutch.studies.heat import HOTTEST_PLACES, _Study, _where_reached, heat
from emclutch.studies.heat_report import averaging_in_words
from field.heat.conduction import HeatNotConverged, HeatProblem, ThermalRunaway

RPM = np.pi / 30.0
BRAKE = {
    "scene": {"title": "a small brake"},
    "geometry": {
        "kind": "drum", "disc_radius": "15 mm", "disc_thickness": "12 mm", "gap": "1 mm", "face_gap": "1 mm",
        "seal_radius": "13 mm", "rotor_wall": "3 mm", "ring_width": "3 mm", "cover_thickness": "2 mm",
        "clearance": "0.3 mm", "coil_width": "6 mm", "coil_height": "6 mm", "yoke": "3 mm", "shaft_radius": "3 mm",
    },
    "coil": {"current": "0.5 A", "turns": 300},
    "field": {"source": "coil", "size_factor": 3.0, "gap_layers": 3},
    "motion": {"rotor": {"speed": "300 rpm"}},
    "effects": {"heat": {"torque": "0.1 N m", "duty": {"end": "1 h"}}},
}  # fmt: skip


def brake(**values):
    return case_from(BRAKE, values)


def faults(**values):
    with pytest.raises(SceneError) as refused:
        brake(**values)
    return str(refused.value)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return heat(brake(), speeds=["100 rpm", 1000.0 * RPM], out=tmp_path_factory.mktemp("heat") / "brake")


def test_what_leaves_is_what_slip_and_copper_make(found):
    steady = found.summary["steady"]
    assert steady["slip_power"] == pytest.approx(0.1 * 300.0 * RPM, rel=1e-9)
    R = steady["copper_loss"] / 0.5**2
    cold = HeatModel(1.0, lambda *_: 0.0).resistance(steady["coil_mean"])
    geometry = brake().scene.shape()
    winding = brake().scene.coil.winding_in(geometry.coil_area, geometry.coil_mean_radius)
    assert winding.resistance * cold == pytest.approx(R, rel=1e-9)
    assert steady["heat_out"] == pytest.approx(steady["slip_power"] + steady["copper_loss"], rel=1e-7)
    assert abs(found.summary["duty"]["energy_error"]) < 1e-7
    assert found.summary["duty"]["heat_of_slip"] == pytest.approx(3600.0 * steady["slip_power"], rel=1e-6)


def test_what_check_says_of_steady_operation_is_what_heat_computes(found):
    """Slip and copper loss at the temperature of the winding, through the same surface; both run away at 4 A."""

    def rise(current, slip_power=0.1 * 300.0 * RPM, **values):
        scene = brake(**values).scene
        return housing_rise(scene, SimpleNamespace(largest_current=current), scene.shape(), slip_power)

    surface = found.summary["steady"]["surface"] - 20.0
    assert rise(0.5) == pytest.approx(surface, rel=0.25)
    assert rise(0.0) < 0.75 * rise(0.5)  # slip alone
    assert rise(4.0) == np.inf  # as test_a_current_without_a_steady_state_runs_away_and_says_so
    at_voltage = {"coil": {"voltage": "3 V", "turns": 300}, "effects": {}}
    assert 0.0 < rise(0.5, **at_voltage) < rise(0.5)  # the current falls as the winding warms


def test_the_steady_rise_balances_both_powers_and_what_leaves():
    """S (h x + epsilon sigma (T^4 - T_0^4)) = P + L (1 + a x) at a current, (P + L)/(1 + a x) at a voltage."""
    for at_voltage in (False, True):
        x = steady_rise(0.05, 40.0, 20.0, at_voltage)
        out = 0.05 * (6.0 * x + 0.9 * 5.670374e-8 * ((293.15 + x) ** 4 - 293.15**4))
        ratio = 1.0 + 3.93e-3 * x
        assert out == pytest.approx(60.0 / ratio if at_voltage else 40.0 + 20.0 * ratio, rel=1e-9)
    assert steady_rise(0.05, 0.0, 0.0, False) == 0.0 and steady_rise(0.05, 1e3, 0.0, False) == np.inf


@pytest.mark.parametrize("drive", [{"voltage": "3 V"}, {"current": "0.5 A"}])
def test_the_steady_rise_does_not_depend_on_the_temperature_that_the_scene_gives_the_winding(drive):
    """The winding warms until the powers balance; the same drive heats it at 20 and at 80 degrees C."""

    def rise(temperature):
        coil = {"resistance": "6 ohm", "temperature": temperature}
        scene = brake(coil=coil | drive, effects={}).scene
        current = 0.5 if "current" in drive else 3.0 / scene.coil.resistance_in(1e-4, 0.03)
        return housing_rise(scene, SimpleNamespace(largest_current=current), scene.shape(), current / 0.5)

    assert 0.0 < rise(20.0) < np.inf and rise(80.0) == pytest.approx(rise(20.0), rel=1e-9)


def test_the_duty_ends_in_the_steady_state_and_writes_its_files(found):
    last, steady = found.table.iloc[-1], found.summary["steady"]
    for key in ("coil_mean", "powder_hottest", "surface"):
        assert last[key] == pytest.approx(steady[key], abs=0.05 * (steady[key] - 20.0))
        assert np.all(np.diff(found.table[key]) > -1e-6)
    assert {"heat.csv", "permitted.csv", "heat.json", "temperature.png", "heat.png", "index.html"} == {
        path.name for path in found.folder.iterdir()
    }
    assert json.loads((found.folder / "heat.json").read_text())["steady"]["surface"] == steady["surface"]
    error = found.summary["error_of_the_mesh"]
    assert max(abs(error["surface"]), abs(error["coil_hottest"])) < 0.01 * (steady["coil_hottest"] - 20.0)


def test_at_the_permitted_slip_power_the_limit_is_met(found):
    slow, own, fast = found.permitted.to_dict("records")
    assert own["speed"] == pytest.approx(300.0 * RPM) and slow["slip_power"] < own["slip_power"] < fast["slip_power"]
    words = " ".join(terminal(found.report()).split())
    power = f"Permitted steady slip power at 300 rpm: {own['slip_power']:.3g} W"
    assert f"{power} with the coil at its full current. Limited by: surface." in words
    assert f"end of the duty, 1 h 00 min {found.table['coil_hottest'].iloc[-1]:.1f}" in words
    assert f"{found.summary['steady']['surface']:.1f} (rotor)" in words
    assert fast["film"] > slow["film"] and fast["slip_power"] > slow["slip_power"]
    scene = brake().scene
    problem, model = (
        heat_problem(scene, 100.0 * RPM),
        HeatModel(resistance_at_20(scene), lambda *_: slow["torque"]),
    )
    drive = Drive(0.5, slip=100.0 * RPM)
    steady = problem.steady(lambda means: model.powers(drive, means))
    surface, hottest = max(problem.surface_temperatures(steady).values()), problem.largest(steady)[COIL]
    assert min(75.0 - surface, 130.0 - hottest) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(
    ("motion", "speeds"),
    [
        ({"rotor": "300 rpm"}, (1000, 0)),
        ({"disc": "-300 rpm"}, (0, -1000)),
        ({"rotor": "1500 rpm", "disc": "1400 rpm"}, (1500, 500)),
        ({"rotor": "200 rpm", "disc": "300 rpm"}, (0, 1000)),
        ({"rotor": "300 rpm", "disc": "-100 rpm"}, (750, -250)),
        ({}, (0, 0)),
    ],
)
def test_the_bodies_that_turn_are_cooled_as_they_turn(motion, speeds):
    """At the permitted power of 1000 rpm the hottest place outside has its limit, with films of both bodies' speeds.

    The films are built from speeds written down here: a body at rest stays at rest.
    """
    bodies = {name: {"speed": speed} for name, speed in motion.items()}
    case = brake(**{"motion": bodies, "effects.heat.coil_limit": 250.0})
    (row,) = _Study.of(case, None).permitted([1000.0 * RPM]).to_dict("records")
    assert (row["rotor_speed"], row["disc_speed"]) == pytest.approx(tuple(RPM * speed for speed in speeds))
    problem = heat_problem(case.scene, *(RPM * speed for speed in speeds))
    model = HeatModel(resistance_at_20(case.scene), lambda *_: 0.0)
    steady = problem.steady(lambda means: model.powers(Drive(0.5, slip=1.0, torque=row["slip_power"]), means))
    assert max(problem.surface_temperatures(steady).values()) == pytest.approx(75.0, abs=0.02)


@pytest.mark.parametrize("speeds", [(-100, -50), (-50, -100), (100, 50), (100, -50), (-100, 50), (0, -100)])
def test_at_the_largest_slip_the_speeds_are_those_of_the_scene(speeds):
    bodies = {name: {"speed": f"{speed} rpm"} for name, speed in zip(("rotor", "disc"), speeds, strict=True)}
    motion = brake(motion=bodies).scene.motion
    assert motion.speeds_at_slip(motion.largest_slip) == pytest.approx(tuple(RPM * speed for speed in speeds))


def test_the_films_of_a_duty_are_those_of_its_slip():
    """duty.slip turns the body that turns in [motion]; a slip that varies cools as its slowest speed does."""

    def surfaces(study):
        return {one.surface.name: one.surface.film for one in study.problem._surfaces}

    constant = brake(**{"effects.heat.duty.slip": "1500 rpm"})
    expected = heat_problem(constant.scene, 1500.0 * RPM)
    assert surfaces(_Study.of(constant, None)) == {one.surface.name: one.surface.film for one in expected._surfaces}
    ramp = {"times": [0.0, 600.0], "values": ["-500 rpm", "1500 rpm"]}
    study = _Study.of(brake(**{"effects.heat.duty": {"end": "600 s", "slip": ramp}}), None)
    assert surfaces(study) == surfaces(_Study.of(constant, None))  # on all the time, at the largest slip
    at_rest = study.problem.with_films({"rotor": 6.0, "disc": 6.0})
    table, _, hottest = study.through_the_duty(None)
    hottest_row = table[table["time"] == hottest.time].iloc[0]
    assert hottest_row["heat_out"] == pytest.approx(sum(at_rest.losses(hottest.temperature).values()), rel=1e-12)


def test_a_duty_of_a_quarter_has_a_quarter_of_the_heat(found, tmp_path):
    """On for 30 s of 120 s: in the end the mean rise is a quarter of the steady one, but for radiation and copper."""
    part = heat(
        brake(**{"effects.heat.duty": {"end": "40 min", "period": "120 s", "on": "30 s"}, "effects.heat.tolerance":
        0.5}), speeds=[100.0 * RPM], out=tmp_path / "part",
    )  # fmt: skip
    end = part.table[part.table["time"] > 2280.0]
    mean = np.trapezoid(end["surface"], end["time"]) / np.ptp(end["time"]) - 20.0
    assert 0.2 < mean / (found.summary["steady"]["surface"] - 20.0) < 0.35
    assert part.summary["duty"]["heat_of_slip"] == pytest.approx(0.25 * 2400.0 * 0.1 * 300.0 * RPM, rel=1e-6)
    assert abs(part.summary["duty"]["energy_error"]) < 1e-7


def test_ramps_of_current_and_slip_make_their_integral():
    """Torque and slip proportional to s, from 0 to 1 and back: 1/3 of the heat of the peak; others below, by hand."""
    curve = {"currents": [0.0, 0.5], "torques": [0.0, 0.1]}
    ramp = {"times": [0.0, 0.5, 1.0], "values": [0.0, 0.5, 0.0]}
    slip = {"times": [0.0, 0.5, 1.0], "values": ["0 rpm", "300 rpm", "0 rpm"]}
    duty = {"end": "4 s", "period": "1 s", "current": ramp, "slip": slip}
    values = {"effects.heat.torque": None, "effects.heat.duty": duty, "effects.heat.torque_curve": curve}
    peak = 0.1 * 300.0 * RPM

    def of_duty(**more):
        case = brake(**values | {"field.size_factor": 4.0, "effects.heat.tolerance": 2.0} | more)
        study = _Study.of(case, None)
        return study, study.through_the_duty(None)[1]

    study, found = of_duty()
    assert found["heat_of_slip"] == pytest.approx(4.0 * peak / 3.0, rel=1e-9)
    # of a coil that warms by less than half a kelvin
    assert found["heat_of_coil"] == pytest.approx(4.0 * study.model.R_20 * 0.25 / 3.0, rel=3e-3)
    assert abs(found["heat_error"]) < 1e-6
    # no torque up to half the current: the integral of s (2 s - 1) from 1/2 to 1 is 5/24
    late = {"currents": [0.25, 0.5], "torques": [0.0, 0.1]}
    _, found = of_duty(**{"effects.heat.torque_curve": late})
    assert found["heat_of_slip"] == pytest.approx(4.0 * peak * 5.0 / 24.0, rel=1e-9)
    # the slip reverses at a third of the ramp: the integral of s |3 s - 1|/2 is 29/108
    reverses = {"times": [0.0, 0.5, 1.0], "values": ["-150 rpm", "300 rpm", "-150 rpm"]}
    _, found = of_duty(**{"effects.heat.duty": duty | {"slip": reverses}})
    assert found["heat_of_slip"] == pytest.approx(4.0 * peak * 29.0 / 108.0, rel=1e-9)


def test_an_averaged_duty_is_the_resolved_one(monkeypatch):
    """The last period of a duty resolved: peaks, means, ripple and heat; means within the error that is given."""
    duty = {"end": "4 h", "period": "20 min", "on": "6 min"}
    fade = {"temperatures": [20.0, 150.0], "factors": [1.0, 0.8]}
    values = {"effects.heat.duty": duty, "effects.heat.fade": fade, "effects.heat.torque": "0.15 N m"}
    study = _Study.of(brake(**values, **{"field.size_factor": 4.0, "effects.heat.tolerance": 0.05}), None)
    table, resolved, _ = study.through_the_duty(None)
    monkeypatch.setattr(heat_study, "MAX_RESOLVED_PERIODS", 1)
    rows, averaged, _ = study.through_the_duty(None)
    last, ripple, end = table[table["time"] > 13199.9], averaged["ripple"], rows.iloc[-1]
    for key in HOTTEST_PLACES:
        assert ripple[key] == pytest.approx(np.ptp(last[key]), rel=0.05) and ripple[key] > 5.0
        assert end[key] == pytest.approx(last[key].max(), abs=0.05 * ripple[key])
        assert rows[key].iloc[0] == 20.0
    for key in ("coil_mean", "powder_mean"):
        mean = np.trapezoid(last[key], last["time"]) / np.ptp(last["time"])
        assert abs(end[key] - mean) < averaged["error_of_the_mean"] + 0.05 < 1.0
    # while it slips the powder is warmer than in the mean by half its ripple, so that it fades more
    assert 1.0 < averaged["heat_of_slip"] / resolved["heat_of_slip"] < 1.03
    assert abs(averaged["energy_error"]) < 1e-7 and "ripple" not in resolved
    for key in HOTTEST_PLACES:  # repeated for ever, as at the end of twelve periods and more
        assert resolved["steady"][key] == pytest.approx(averaged["steady"][key], abs=1e-3)
        assert last[key].max() - 0.1 < resolved["steady"][key] < last[key].max() + 2.0


@pytest.mark.hard
def test_short_pulses_that_run_away_say_so():
    """4 A for a third of every 3 s over 3 h have no steady temperatures: no error of the mean, and a stop."""
    duty = {"end": "3 h", "period": "3 s", "on": "1 s"}
    study = _Study.of(brake(**{"coil.current": "4 A", "effects.heat.duty": duty, "field.size_factor": 4.0}), None)
    table, found, _ = study.through_the_duty(None)
    assert "stopped" in found["state"] and found["end"] < 10800.0 and np.all(np.isfinite(table))
    assert found["steady"] is None and found["error_of_the_mean"] is None and found["ripple"]["coil_hottest"] > 0.0
    line = " ".join(averaging_in_words(found).split())
    assert "3600 periods" in line and "not known" in line


@pytest.mark.hard
def test_a_current_without_a_steady_state_runs_away_and_says_so(tmp_path):
    """A given current runs away: reported with the largest that does not; every number is finite."""
    done = CliRunner().invoke(
        app, ["heat", _written(tmp_path, {"coil.current": "4 A"}), "--speed", "100 rpm", "--out", str(tmp_path / "hot")]
    )
    assert done.exit_code == 0, done.output
    words = " ".join(done.output.split())
    assert words.count("No steady state: winding above 250") == 1 and "stopped: winding above 250" in words
    assert "Lower current or slip power" in words
    told = json.loads((tmp_path / "hot" / "heat.json").read_text())
    limit = told["largest_current"]["at_a_mean_of_250_degrees"]
    assert 0.5 < told["largest_current"]["at_the_coil_limit"] < limit < 4.0
    table = np.genfromtxt(tmp_path / "hot" / "heat.csv", delimiter=",", skip_header=1)
    assert np.all(np.isfinite(table))


@pytest.mark.hard
def test_a_cold_start_and_a_given_voltage(tmp_path):
    """At -40 degrees C the coil takes more current than at 20, and less as it warms: no runaway at any voltage."""
    cold = heat(
        brake(**{
            "coil": {"voltage": "3 V", "turns": 300}, "effects.heat.ambient": -40.0, "effects.heat.torque": None,
            "effects.heat.torque_curve": {"currents": [0.0, 2.0], "torques": [0.0, 0.4]},
            "effects.heat.fade": {"temperatures": [-40.0, 200.0], "factors": [1.0, 0.8]},
        }),
        speeds=[100.0 * RPM], out=tmp_path / "cold",
    )  # fmt: skip
    table = cold.table
    assert table["coil_mean"].iloc[0] == pytest.approx(-40.0) and np.all(np.diff(table["current"]) < 1e-9)
    assert np.all(np.diff(table["torque"]) < 1e-9) and np.all(np.isfinite(table))
    steady = cold.summary["steady"]
    assert steady["copper_loss"] == pytest.approx(3.0 * steady["current"], rel=1e-9)
    assert steady["heat_out"] == pytest.approx(steady["slip_power"] + steady["copper_loss"], rel=1e-7)


def test_a_shaft_and_a_better_powder_take_heat():
    """A conductance of the shaft draws off heat; a poor powder is hotter, and so are contacts that resist."""

    def steady(**values):
        problem = heat_problem(brake(**values).scene)
        found = problem.steady(lambda means: (np.array([2.0, 5.0]), np.zeros(2)))
        return problem, found, problem.largest(found)[POWDER]

    _, _, usual = steady()
    problem, found, cooler = steady(**{"effects.heat.shaft_conductance": "0.5 W/K"})
    assert problem.losses(found)["shaft_ends"] > 0.5 and cooler < usual - 5.0
    shaft = {"effects.heat.shaft_conductance": "0.5 W/K", "effects.heat.shaft_heat_capacity": "90 J/K"}
    held, slow, _ = steady(**shaft)
    assert held.heat_content.sum() == pytest.approx(problem.heat_content.sum() + 90.0)
    assert np.allclose(slow[: len(found)], found, rtol=1e-9, atol=0.0)  # the ends differ, and no heat passes between
    assert held.losses(slow)["shaft_ends"] == pytest.approx(problem.losses(found)["shaft_ends"], rel=1e-9)
    assert "shaft_conductance above 0" in faults(**{"effects.heat.shaft_heat_capacity": "90 J/K"})
    filled = {**BRAKE, "particles": {"diameter": "0.3 mm", "mass": "1 g", "region": "poles"}, "time": {"end": "1 ms"}}
    filled["effects"] = BRAKE["effects"] | {"magnetic_force": {}}

    def of_grains(**values):
        problem = heat_problem(case_from(filled, values).scene)
        found = problem.steady(lambda means: (np.array([2.0, 5.0]), np.zeros(2)))
        return problem.largest(found)[POWDER] - problem.surface_temperatures(found)["rotor"]

    packed, poor = of_grains(), of_grains(**{"effects.heat.powder_conductivity": "0.05 W/(m K)"})
    resists = of_grains(**{"effects.heat.contact_resistance": "0.01 m^2 K/W"})
    assert 0.0 < packed < min(poor, resists)


def test_a_curve_is_scaled_to_a_run(monkeypatch):
    """12 N m at 0.8 A of a run and a curve that is linear: 6 N m at 0.4 A, whatever the curve's own torques are."""
    curve = {"currents": [0.0, 1.0], "torques": [0.0, 10.0]}
    values = {"effects.heat.torque": None, "effects.heat.torque_curve": curve, "effects.heat.duty.current": "0.4 A"}

    def study(current, mean=-12.0, **more):
        known = SimpleNamespace(mean=mean, is_steady=True)
        run = SimpleNamespace(summary={"current": current}, best=known, torque=known)
        monkeypatch.setattr(heat_torque, "load_result", lambda _: run)
        return _Study.of(brake(**values | {"field.size_factor": 4.0} | more), "runs/a")

    found = study(-0.8)
    assert found._row({found.peak: 1.0}, np.full(found.problem.n_dofs, 20.0))["torque"] == pytest.approx(6.0)
    assert "times 1.5" in found.torque_summary["at_other_currents"]
    voltage = study(0.8, **{"coil": {"voltage": "3 V", "turns": 300}, "effects.heat.duty.current": None})
    assert voltage.model.torque(0.4, 90.0) == pytest.approx(6.0)
    for current, said in (
        (0.0, "torque_curve cannot be scaled to the best estimate of the run runs/a .*no torque"),
        (None, "no coil current"),
    ):
        with pytest.raises(ValueError, match=said):
            study(current)
    alone = {"effects.heat.torque_curve": None, "effects.heat.duty.current": None}
    assert study(0.5, **alone).model.torque(0.1, 90.0) == 12.0
    with pytest.raises(
        ValueError, match=r"runs/a .* current of 0.8 A, the duty one of 0.5 A; give \[particles\] or .*torque_curve"
    ):
        study(0.8, **alone)
    with pytest.raises(ValueError, match=r"torque = 0.1 N m conflicts with the run"):
        study(0.5, **alone | {"effects.heat.torque": "0.1 N m"})


def test_what_does_not_go_together_is_refused_with_its_remedy(tmp_path):
    assert "steel_x" in faults(**{"effects.heat.conductivity": {"steel_x": "50 W/(m K)"}})
    assert "torque_curve" in faults(**{"coil": {"voltage": "3 V", "turns": 300}})
    assert "torque_curve" in faults(**{"effects.heat.duty.current": {"times": [0, 10], "values": [0, 1]}})
    other = faults(**{"effects.heat.duty.current": "0.05 A"})
    assert "effects.heat.duty.current = '0.05 A'" in other and "of 0.5 A; give [particles]" in other
    assert brake(**{"effects.heat.duty.current": "500 mA"}).scene.effects.thermal.duty.current.largest == 0.5
    assert "period" in faults(**{"effects.heat.duty": {"on": "5 s"}})
    assert "longer than the period" in faults(**{"effects.heat.duty": {"on": "50 s", "period": "20 s"}})
    assert "surface_limit" in faults(**{"effects.heat.ambient": 80.0})
    assert brake(**{"effects.heat.surface_limit": "1000 degC"}).scene.effects.thermal.surface_limit == 1000.0
    assert "as many" in faults(**{"effects.heat.fade": {"temperatures": [20.0, 100.0], "factors": [1.0]}})
    halved = faults(**{"effects.heat.fade": {"temperatures": [100.0, 150.0], "factors": [0.5, 0.4]}})
    assert "effects.heat.fade.factors" in halved and "must begin with 1" in halved and "divide all by 0.5" in halved
    for key, values in (("slip", ["0 rpm", "300 rpm"]), ("current", ["0 A", "0.5 A"])):
        table = {"times": ["0 s", "300 s"], "values": values}
        cut = faults(**{"effects.heat.duty": {"period": "120 s", key: table}})
        assert f"effects.heat.duty.{key}" in cut and "to 300 s, beyond the period of 120 s" in cut
    bare = {"effects.heat.convection": 0.0, "effects.heat.emissivity": 0.0}
    uncooled = faults(**bare, **{"effects.heat.self_cooling": False})
    assert "effects.heat.convection" in uncooled and "emissivity and shaft_conductance" in uncooled
    assert brake(**bare, **{"effects.heat.shaft_conductance": "1 W/K"})
    slots = {"count": 12, "depth": "2 mm"}
    assert "disc_slots" in faults(**{"geometry.disc_slots": slots})
    cell = {"kind": "shear_cell", "inner_radius": "10 mm", "outer_radius": "11 mm", "height": "2 mm"}
    assert "'clutch' or 'drum'" in faults(geometry=cell, field=None, coil=None)
    with pytest.raises(SceneError, match="no torque"):
        heat(brake(**{"effects.heat.torque": None}), out=tmp_path / "none")
    with pytest.raises(SceneError, match=r"give effects\.heat\.torque"):  # the defaults of the table, which has none
        heat(brake(**{"effects.heat": None}), out=tmp_path / "none")
    heat_of = emclutch.heat
    with pytest.raises(emclutch.OutputError, match="exists"):
        heat_of(brake(), out=tmp_path)


def test_temperatures_that_are_not_found_name_the_key(tmp_path, monkeypatch):
    def fails(*_, **__):
        raise HeatNotConverged("no steady temperatures")

    monkeypatch.setattr(HeatProblem, "steady", fails)
    done = CliRunner().invoke(
        app,
        ["heat", _written(tmp_path, {"effects.heat.fade": {"temperatures": [20.0, 21.0], "factors": [1.0, 0.1]}})],
    )
    words = " ".join(done.output.split())
    assert done.exit_code == 2 and "effects.heat.fade" in words and "less steeply" in words, done.output
    assert done.stderr.startswith("mesh and torque\n")


def test_what_is_not_found_is_said(monkeypatch):
    """A temperature that no power brings to its limit; a mesh of the next order on which the winding runs away."""
    with pytest.raises(emclutch.RunError, match=r"surface_limit = 75 .* make 50 degrees C; lower surface_limit"):
        _where_reached(lambda power: 50.0 - 30.0 / (1.0 + power), 75.0, "surface_limit")
    study = _Study.of(brake(), None)

    def runs_away(*_, **__):
        raise ThermalRunaway("the copper loss grows faster")

    monkeypatch.setattr(HeatProblem, "steady", runs_away)
    assert study.mesh_error(np.zeros(1)) == "not known: with elements of the next order the copper loss grows faster"


def _written(folder, values):
    path = folder / "brake.toml"
    path.write_text(brake(**values).toml(), encoding="utf-8")
    return str(path)
