"""What a scene leaves out is named, each with the number of a closed form, and the verdict follows the number."""

import json
from math import inf, pi, sqrt
from pathlib import Path
from types import SimpleNamespace

import pytest
from sheared_annulus import make_cylinders_of_steel
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.effects import PLANNED_EFFECTS, EffectsSection
from emclutch.effects.heat import HeatSection
from emclutch.effects.omitted_effect import OmittedEffect
from emclutch.scene.case import case_from, load_case
from emclutch.simulation.forecast.expected_torque import expected_torque
from emclutch.simulation.forecast.regime import omitted_effects
from emclutch.simulation.plan import make_plan
from field import MU_0
from field.coil.inductance import apparent_inductance

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
CELL = {
    "scene": {"title": "sheared annulus"},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 2e-3},
    "field": {"source": "uniform", "field_strength": 60e3, "direction": "radial"},
    "particles": {"diameter": "0.1 mm", "solid_fraction": 0.35, "sector": "20 deg"},
    "motion": {"rotor": {"speed": "300 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"dipoles": {"model": "near_field"}, "saturation": {}},
    "time": {"end": "1 ms"},
}
OF_A_COIL = {"back_reaction", "coil_circuit", "eddy_currents", "hysteresis"}
STILL = {"field": None, "effects": {}, "motion": {}, "contact": {"stiffness": "10 kN/m"}}
RATE = 10.0 * pi * 10.6e-3 / 1.2e-3  # shear rate of the cell [1/s]


def numbers(steel=True, **values):
    """Effect -> its line; with the expected torque under the key None."""
    case = case_from(CELL, values)
    with pytest.MonkeyPatch.context() as patch:
        if steel:
            make_cylinders_of_steel(patch)
        device, plan = make_plan(case)
        expected = expected_torque(case.scene, device, plan.peak_field)
        return {line.effect: line for line in omitted_effects(case.scene, device, plan, expected)} | {None: expected}


@pytest.fixture(scope="module")
def usual():
    return numbers()


def test_every_effect_that_is_off_or_not_there_has_its_line(usual):
    reported = set(usual) - {None, "centrifugal force", "inertia of grains"}
    assert reported == set(EffectsSection.names()) - {"dipoles", "saturation"} - OF_A_COIL | set(PLANNED_EFFECTS)
    bare = set(numbers(field=None, effects={"gravity": {}}))
    assert {"cohesion", "rolling_friction", "heat"} < bare
    assert not bare & {"gravity", "dipoles", "saturation", *OF_A_COIL}


def test_an_effect_changes_the_torque_by_its_change_at_the_limit_and_in_proportion_below():
    of = {"effect": "a", "where": "off", "number": "x", "limit": 0.1}
    changes = [OmittedEffect(**of, value=value).on_torque for value in (0.02, 5e-4, 0.2, None)]
    assert changes == ["2 %", "below 0.1 %", "10 % or more", "not known"]
    assert OmittedEffect("a", "off", "x", 50.0, 10.0, below=True).on_torque == "2 %"
    assert OmittedEffect(**of, value=0.02, change=0.2).on_torque == "4 %"


def test_weight_is_compared_with_the_pull_of_two_grains_or_with_the_centrifugal_force(usual):
    """F = (pi/24) mu_0 M^2 d^2, weight rho g pi d^3/6: mu_0 M^2/(4 rho g d); without a field omega^2 r/g."""
    line = usual["gravity"]
    assert line.value == pytest.approx(MU_0 * usual[None].M ** 2 / (4.0 * 7700.0 * 9.81 * 0.1e-3), rel=1e-9)
    fast = numbers(**STILL | {"motion.rotor.speed": "6000 rpm"})["gravity"]
    assert fast.value == pytest.approx((200.0 * pi) ** 2 * 11.2e-3 / 9.81, rel=1e-12)
    assert line.is_significant is fast.is_significant is False
    weak = numbers(**{"field.field_strength": 1e3})["gravity"]
    assert weak.is_significant is numbers(**STILL)["gravity"].is_significant is True


def test_inertial_and_stokes_number_are_those_of_the_shear_rate(usual):
    inertial = RATE * 0.1e-3 * sqrt(7700.0 / usual[None].pressure)
    assert usual["inertia of grains"].value == pytest.approx(inertial, rel=1e-9)
    assert usual["fluid_drag"].value == pytest.approx(RATE * 7700.0 * (0.1e-3) ** 2 / (18.0 * 1.8e-5), rel=1e-9)
    without = numbers(field=None, effects={"gravity": {}}, contact={"stiffness": "10 kN/m"})
    of_friction = without[None].stress / 0.3  # nothing attracts: what friction at the walls needs
    assert without["inertia of grains"].value == pytest.approx(RATE * 0.1e-3 * sqrt(7700.0 / of_friction), rel=1e-9)
    together = numbers(**{"motion.disc.speed": "300 rpm"})
    drag = together["fluid_drag"]
    assert drag.value is drag.is_significant is None and together["heat"].value == 0.0


def test_magnetised_powder_presses_as_straight_chains_of_linear_grains_do_in_a_weak_field():
    """M = H/(1/chi + 1/3 - zeta(3)/6) and p = phi mu_0 M^2/2, with the mean of H over the volume."""
    M = 100.0 / (1.0 / 200.0 + 1.0 / 3.0 - 1.2020569 / 6.0)
    pressure = numbers(**{"field.field_strength": 100.0})[None].pressure
    assert pressure == pytest.approx(0.5 * 0.35 * MU_0 * M**2, rel=0.01)


def test_the_heat_of_slip_warms_the_powder(usual):
    mass = 0.35 * 7700.0 * pi * (11.2e-3**2 - 10e-3**2) * 2e-3
    warmed = usual[None].torque * 10.0 * pi * 1e-3 / (mass * 450.0)
    assert usual["heat"].value == pytest.approx(warmed, rel=0.02)
    assert numbers(**{"time.end": "100 s"})["heat"].is_significant is True
    for rise, hot in ((1500.0, True), (20.0, False)):  # of the housing, in steady operation: a verdict of its own
        at = SimpleNamespace(slip_power=2.0, heating=0.5, copper_loss=3.0, housing_rise=rise, end=0.01)
        (line,) = HeatSection.omitted_effects(at)
        assert line.is_significant is False
        said = f"In continuous operation the housing would be {rise:.0f} K above the room. How long it may last: "
        assert line.in_operation == (f"{said}emclutch heat" if hot else "")
        assert "2 W of slip" in line.note and "3 W of copper loss" in line.note
    at.housing_rise, at.slip_power = inf, None
    (line,) = HeatSection.omitted_effects(at)
    assert line.in_operation.startswith("In continuous operation the winding would exceed 250 °C")


def test_grains_at_steel_and_grains_without_end_of_magnetisation(usual):
    assert usual["wall_images"].value == pytest.approx(2.0 * 0.1 / 1.2)
    smooth = numbers(steel=False, **{"effects.saturation": None, "effects.dipoles.model": "mutual",
                                     "field.field_strength": 600e3})  # fmt: skip
    # a sphere of great chi in the field H of its place has 3 H, whatever the saturation would be
    assert smooth["saturation"].value == pytest.approx(3.0 * 600e3 * 10.6 / 10.0 / 1.3e6, rel=0.02)
    assert smooth["saturation"].is_significant is True and "wall_images" not in smooth


def test_a_coil_that_is_switched_faster_than_its_field_can_follow_and_one_of_too_much_current():
    case = load_case(GOOD, {"field.size_factor": 3.0})
    device, plan = make_plan(case)
    expected = expected_torque(case.scene, device, plan.peak_field)
    lines = {line.effect: line for line in omitted_effects(case.scene, device, plan, expected)}
    ratio = apparent_inductance(plan.peak_field, device.coil.turns) / 25.5 / 20e-3  # the current rises within 20 ms
    assert lines["coil_circuit"].value == pytest.approx(ratio, rel=1e-6) and lines["coil_circuit"].is_significant
    assert 0.0 < lines["eddy_currents"].value < ratio
    assert "gravity" not in lines and lines["back_reaction"].value > 0.0
    much = ("--json", "--set", "field.size_factor=3", "--set", "coil.current=400 A")
    reported = json.loads(CliRunner().invoke(app, ["check", str(GOOD), *much]).stdout)
    assert "T is outside the usual range of 0 to 2.5 T" in reported["plan_warnings"]["field"][0]
    assert any("current density" in warning for warning in reported["warnings"])
    assert len(reported["omitted_effects"]) > len(lines) / 2
