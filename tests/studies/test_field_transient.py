"""`emclutch field --transient`: the coil alone in time against closed forms of one and of two coupled circuits, the
static flux linkage of steel, and copper that keeps its heat.

Diffusion of the field into a steel rod: tests/field/test_eddy_currents.py.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest
import tomli_w
from closed_forms import mutual_inductance_of_loops, self_inductance_of_ring
from flux_linkage_curve import current_of_linkage
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from step_file import rectangle, write_polygons
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.scene.case import load_case
from emclutch.scene.errors import SceneError
from emclutch.studies.coil_transient import CoilTransient
from emclutch.studies.field import coil_of_field
from field.coil.winding import COPPER_DENSITY, COPPER_RESISTIVITY, COPPER_TEMPERATURE_COEFFICIENT
from field.section.error_estimate import MeanFluxDensity, estimate_error
from geometry.time_profile import TimeProfile

pytestmark = pytest.mark.physics

N, R, V = 200, 160.0, 160.0
RADIUS, SIDE, SIGMA = 20e-3, 0.5e-3, 35e6
STEP = TimeProfile.constant(V)
CASES = Path(__file__).parents[2] / "cases"
COARSE = {"field.size_factor": 3.0, "field.gap_layers": 3, "field.order": 1}


@pytest.fixture(scope="module")
def in_air(tmp_path_factory):
    """A coil of 2 mm x 2 mm about a circle of 20 mm, and a ring of 0.5 mm x 0.5 mm 2 mm above it; no steel."""
    folder, half = tmp_path_factory.mktemp("air"), 0.5 * SIDE
    ring = rectangle(RADIUS - half, RADIUS + half, 2e-3 - half, 2e-3 + half)
    write_polygons(folder / "air.step", {"coil": [rectangle(19e-3, 21e-3, -1e-3, 1e-3)], "ring": [ring]})
    data = {
        "scene": {"title": "A coil and a ring in air"},
        "geometry": {"kind": "cad", "file": "air.step", "materials": {"ring": "metal"}},
        "materials": {"metal": {"law": "linear", "relative_permeability": 1.0, "conductivity": SIGMA}},
        "coil": {"voltage": V, "turns": N, "resistance": R},
        "field": {"source": "coil"},
        "effects": {"coil_circuit": {}},
    }
    (folder / "air.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
    return folder / "air.toml"


@pytest.fixture(scope="module")
def coil_of(in_air):
    """coil_of(voltage, heat_capacity): the coil alone, as without eddy currents the ring is air."""
    scene = load_case(in_air).scene
    device = coil_of_field(scene)

    def build(voltage, heat_capacity=np.inf):
        coil = CoilTransient(scene, device, None, faces=False)
        coil.voltage, coil.heat_capacity = voltage, heat_capacity
        return coil

    return build


@pytest.fixture(scope="module")
def tau(coil_of):
    """L/R by the static field, checked by its closed form."""
    inductance = N * coil_of(STEP).static(1.0).flux_linkage_per_turn
    assert inductance == pytest.approx(N**2 * self_inductance_of_ring(RADIUS, 2e-3, 2e-3), rel=2e-3)
    return inductance / R


def rises(course):
    return course.rises["current_rise_time"], course.rises["current_rise_time_90"]


def test_a_shorted_ring_is_the_second_winding_of_a_transformer(in_air, monkeypatch, tmp_path):
    """L di/dt + R i = (V, 0) of coil and ring, all of L and R by closed forms; the ring changes i by up to 7 %."""
    sets = "effects.eddy_currents=on", "accuracy.inertial_number=0.01"  # the second is of a run of the grains
    sets = [part for one in sets for part in ("--set", one)]
    arguments = ["field", str(in_air), "--transient", *sets, "--out", tmp_path / "o"]
    monkeypatch.setattr("emclutch.results.progress.LINE_MIN_SECONDS", 0.0)  # each part of the work has a line
    result = CliRunner().invoke(app, list(map(str, arguments)))
    assert result.exit_code == 0, result.output
    assert "Current to 0.9998 A: 63 % of the change after 18.8 µs, 90 % after 49.8 µs" in result.output
    assert "%  the coil in time" in result.stderr and "again with coarser time steps" in result.stderr
    for name in ("transient.png", "section.png", "index.html", "field.pvd"):
        assert (tmp_path / "o" / name).stat().st_size > 200
    table = pandas.read_csv(tmp_path / "o" / "transient.csv")
    mutual = N * mutual_inductance_of_loops(RADIUS, RADIUS, 2e-3)
    ring = self_inductance_of_ring(RADIUS, SIDE, SIDE)
    inductance = np.array([[N**2 * self_inductance_of_ring(RADIUS, 2e-3, 2e-3), mutual], [mutual, ring]])
    resistance = np.diag([R, 2.0 * np.pi * RADIUS / (SIGMA * SIDE**2)])
    decay, final = -np.linalg.solve(inductance, resistance), np.array([V / R, 0.0])
    currents = np.array([final - expm(decay * t) @ final for t in table["time"]])
    assert np.abs(table["current"] - currents[:, 0]).max() < 1e-3
    alone = V / R * (1.0 - np.exp(-table["time"] * R / inductance[0, 0]))
    assert np.abs(table["current"] - alone).max() > 0.05
    ring_loss = resistance[1, 1] * np.trapezoid(currents[:, 1] ** 2, table["time"])
    assert table["eddy_heat"].iloc[-1] == pytest.approx(ring_loss, rel=0.02)
    summary = json.loads((tmp_path / "o" / "transient.json").read_text())
    assert abs(summary["relative_residual"]) < 1e-3 and summary["distance"] < 0.01


def test_the_error_of_a_linear_rise_is_proportional_to_the_tolerance(coil_of, tau):
    """i = V/R (1 - exp(-t/tau)): of order 1 in the tolerance of the local error, order 2 in the step; 63 % at tau."""
    errors = []
    for tolerance in (3e-2, 3e-3, 3e-4):
        course = coil_of(STEP).course(5.0 * tau, tolerance)
        time = course.table["time"]
        errors.append(np.abs(course.table["current"] - V / R * (1.0 - np.exp(-time / tau))).max())
        early, late = rises(course)
        assert early == pytest.approx(tau, rel=tolerance) and late == pytest.approx(np.log(10.0) * tau, rel=tolerance)
    assert np.log10(errors[0] / errors[2]) / 2.0 == pytest.approx(1.0, abs=0.15), errors
    energy = course.table.iloc[-1]
    stored = 0.5 * tau * R * energy["current"] ** 2
    assert energy["field_energy"] == pytest.approx(stored, rel=1e-4)
    assert energy["supplied_energy"] == pytest.approx(energy["copper_heat"] + stored, rel=1e-4)


def test_a_table_of_the_voltage_on_and_off(coil_of, tau):
    """24 V from 2 tau on, off again at 6 tau: each piece against its exponential; times count from the last change."""
    on, off, edge = 2.0 * tau, 6.0 * tau, 1e-4 * tau
    times, values = (on, on + edge, off, off + edge), (0.0, 24.0, 24.0, 0.0)
    assert coil_of(TimeProfile(times[:2], values[:2])).changes_at == on
    coil = coil_of(TimeProfile(times, values))
    course = coil.course(None, 1e-3)
    assert coil.changes_at == off
    time, current = course.table["time"].to_numpy(), course.table["current"].to_numpy()
    risen = 24.0 / R * (1.0 - np.exp(-np.clip(time - on, 0.0, off - on) / tau))
    exact = risen * np.exp(-np.clip(time - off, 0.0, None) / tau)
    assert np.abs(current - exact).max() < 2e-3 * 24.0 / R
    assert rises(course) == pytest.approx((tau, np.log(10.0) * tau), rel=2e-3)
    assert abs(current[-1]) < 0.01 * 24.0 / R and course.final["current"] == 0.0


def test_switching_off_what_was_steady_heats_the_copper_with_the_field_energy(coil_of, tau):
    """i = V/R exp(-t/tau) from the static field on, and 1/2 L i^2 becomes heat; times count from 0."""
    coil = coil_of(TimeProfile((0.0, 1e-6 * tau), (V, 0.0)))
    coil.begins_steady = True
    course = coil.course(8.0 * tau, 1e-3)
    assert course.table["current"].iloc[0] == pytest.approx(V / R, rel=1e-6)
    assert rises(course) == pytest.approx((tau, np.log(10.0) * tau), rel=2e-3)
    assert course.table["copper_heat"].iloc[-1] == pytest.approx(0.5 * tau * R * (V / R) ** 2, rel=1e-3)


def test_copper_that_keeps_its_heat(coil_of):
    """C dT/dt = V^2/R(T), R = R_0 (1 + alpha dT): (1 + alpha dT)^2 = 1 + 2 alpha V^2 t/(R_0 C), long after the rise."""
    tolerance, capacity, alpha = 0.03, 1.0, COPPER_TEMPERATURE_COEFFICIENT
    coil = coil_of(STEP, capacity)
    table = coil.course(0.4, tolerance).table
    last, ratio = table.iloc[-1], np.sqrt(1.0 + 2.0 * alpha * V**2 / R * table["time"] / capacity)
    warmer = table["winding_temperature"] - 20.0
    assert warmer.iloc[-1] > 40.0 and np.allclose(warmer, (ratio - 1.0) / alpha, rtol=0.0, atol=0.2)
    # the resistance of a row is that of the middle of the step that ends there
    assert last["current"] == pytest.approx(V / R / ratio.iloc[-1], rel=0.3 * tolerance)
    assert last["supplied_energy"] == pytest.approx(last["copper_heat"] + last["field_energy"], rel=1e-4)
    with pytest.raises(ValueError, match="the winding passes 250 degrees C"):
        coil.march(5.0, 0.1)


@pytest.mark.parametrize(("resistance", "wire"), [(R, N * 2.0 * np.pi * RADIUS * COPPER_RESISTIVITY / R),
                                                  (None, 0.6 * 4e-6 / N), (10.0, 4e-6 / N)])  # fmt: skip
def test_the_copper_that_warms_is_the_wire_of_the_resistance(in_air, resistance, wire):
    """Turns and resistance give the section rho length/R, at most that of a window full of copper."""
    scene = load_case(in_air, {"coil.resistance": resistance}).scene
    heat = CoilTransient(scene, coil_of_field(scene), None, faces=False).heat_capacity
    assert heat == pytest.approx(385.0 * COPPER_DENSITY * wire * N * 2.0 * np.pi * RADIUS, rel=1e-9)


OF_GRAINS = ("magnetic_force", "dipoles", "saturation", "wall_images", "back_reaction", "rolling_friction",
             "eddy_currents")  # fmt: skip


def test_a_saturating_coil_follows_its_static_flux_linkage():
    """d lambda/dt = V - R i(lambda) with i(lambda) of a sweep of static fields, by an integrator of its own."""
    voltage, none = 500.0, ("particles", "motion", "time", "contact", *(f"effects.{name}" for name in OF_GRAINS))
    case = load_case(CASES / "switch_on.toml", COARSE | {"coil.voltage": voltage} | dict.fromkeys(none))
    device = coil_of_field(case.scene)
    transient = CoilTransient(case.scene, device, None, faces=False)
    transient.heat_capacity = np.inf
    course, resistance = transient.course(None, 1e-3), transient.cold_resistance
    final = voltage / resistance
    of_linkage = current_of_linkage(device.problem, device.turns, 1.01 * final, points=60)
    time, current = course.table["time"].to_numpy(), course.table["current"]
    exact = solve_ivp(lambda t, y: voltage - resistance * of_linkage(y), (0.0, time[-1]), [0.0], t_eval=time, rtol=1e-8)
    assert np.abs(current - of_linkage(exact.y[0])).max() < 2e-3 * final
    linear = final * (1.0 - np.exp(-time * voltage / course.final["flux_linkage"]))
    assert np.abs(current - linear).max() > 0.05 * final, "a coil that saturates"


def test_powder_and_its_order_delay_the_coil(tmp_path):
    """Even powder raises the flux linkage, sheared powder more; the gap's field comes after the current."""
    case = load_case(CASES / "switch_on.toml", COARSE | {"time.end": "40 ms"})
    result = emclutch.field_transient(case, tolerance=0.02, out=tmp_path / "o")
    found = result.summary
    assert repr(result).startswith("<TransientResult: Current") and "float64" not in repr(found)
    device = coil_of_field(case.scene)
    transient = CoilTransient(case.scene, device, None, faces=False)
    empty = transient.course(0.04, 0.02)
    assert rises(empty)[0] < found["current_rise_time"] < found["current_rise_time_sheared"]
    assert found["current_rise_time"] < found["gap_flux_density_rise_time"]
    assert "Maxwell Garnett" in found["powder"] and found["at_end"]["time"] == 0.04
    assert 0.0 < found["rise_time_error"] < 0.02
    # of a device without poles it is the mean over the powder's region
    transient = CoilTransient(case.scene, replace(device, has_poles=False), None, faces=False)
    mean = estimate_error(empty.field, (MeanFluxDensity("powder"),)).goals[0]
    found = transient.quantities(empty.field)["gap_flux_density"]
    assert found == pytest.approx(mean.value * (1.0 - mean.relative), rel=5e-3) and abs(mean.relative) < 0.2


def test_the_gap_field_of_a_reversed_current_reverses():
    """From V to -V/2 all is 63 % of its way after the same time, as far as the steel is linear, the gap's field too."""
    steady = {"effects.coil_circuit.begin": "steady", "effects.eddy_currents": None}
    voltage = {"times": [0.0, 1e-6], "values": [20.0, -10.0]}
    case = load_case(CASES / "switch_on.toml", COARSE | steady | {"coil.voltage": voltage})
    device = coil_of_field(case.scene)
    for one in (device, replace(device, has_poles=False)):
        course = CoilTransient(case.scene, one, None, faces=False).course(None, 0.02)
        B = course.table["gap_flux_density"]
        assert B.iloc[0] > 0.0 and course.final["gap_flux_density"] == pytest.approx(-0.5 * B.iloc[0], rel=0.05)
        for suffix in ("", "_90"):
            flux = course.rises[f"flux_linkage_rise_time{suffix}"]
            assert course.rises[f"gap_flux_density_rise_time{suffix}"] == pytest.approx(flux, rel=0.05)


CURRENT = "coil.voltage=none coil.current=1 coil.resistance=none effects.coil_circuit=off"


@pytest.mark.parametrize(
    ("settings", "options", "words"),
    [
        (CURRENT, (), "coil.voltage is missing"),
        ("coil.voltage=0.0", (), "changes nothing"),
        ("effects.coil_circuit.begin=steady", (), "changes nothing"),
        ("effects.coil_circuit=off effects.hysteresis=on", (), "[effects.hysteresis] cannot be computed in time"),
        ("", ("--current", "1 A"), "--current"),
        ("", ("--end", "0 s"), "--end"),
        ("", ("--tolerance", "2"), "1e-06 to 0.1"),
    ],
)
def test_bad_input_is_reported(in_air, settings, options, words, tmp_path):
    sets = [part for one in settings.split() for part in ("--set", one)]
    arguments = ["field", str(in_air), "--transient", *sets, *options, "--out", str(tmp_path / "new")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2 and words in " ".join(result.output.split()), result.output
    assert not (tmp_path / "new").exists()


def test_arguments_may_have_units(in_air, tmp_path):
    for given, words in (({"end": "1 m"}, "end = '1 m'"), ({"end": "0 s"}, "end = '0 s'")):
        with pytest.raises(SceneError, match=words):
            emclutch.field_transient(in_air, **given, out=tmp_path / "new")
    with pytest.raises(SceneError, match=r"currents = '0\.4 V'"):
        emclutch.field(in_air, ["1 A", "0.4 V"], out=tmp_path / "new")
    assert list(emclutch.field(in_air, "500 mA", out=tmp_path / "field").table["current"]) == [0.5]


def test_options_of_the_transient_need_it_and_slots_have_none(in_air, tmp_path):
    for arguments, words in (
        ((str(in_air), "--end", "1 s"), "needs --transient; add it"),
        ((str(CASES / "slotted_disc.toml"), "--transient", "--set", "coil.voltage='24 V'"), "a field in 3D"),
    ):
        result = CliRunner().invoke(app, ["field", *arguments, "--out", str(tmp_path / "new")])
        assert result.exit_code == 2 and words in " ".join(result.output.split()), result.output
