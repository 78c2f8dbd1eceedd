"""Runs at an inertial number: one factor for all speeds, times as shear strains, a sector as wide as some grains."""

from math import asin, floor, pi, sin

import pytest

from emclutch.results import OutputError, RunFolder
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.simulation.check import check
from emclutch.simulation.plan import make_plan
from emclutch.simulation.resume import refuse_earlier_end, seconds_of
from emclutch.simulation.scaled_slip import QUASI_STATIC
from particles.diagnostics.inertial_number import inertial_number

CELL = {
    "scene": {"title": "sheared annulus"},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 2e-3},
    "field": {"source": "uniform", "field_strength": 60e3, "direction": "radial"},
    "particles": {"diameter": "0.1 mm", "solid_fraction": 0.35, "sector": "6 diameters"},
    "motion": {"rotor": {"speed": "300 rpm"}, "disc": {"speed": "-30 rpm"}},
    "effects": {"dipoles": {"model": "near_field"}, "saturation": {}},
    "time": {"end": "strain 12"},
}
SHEAR = 10.6e-3 / 1.2e-3  # mean radius over the width of the gap: strain rate over slip


def cell(**values):
    return case_from(CELL, values)


@pytest.mark.parametrize("wanted", [0.01, 0.2])
def test_all_speeds_are_multiplied_so_that_the_inertial_number_is_the_one_asked_for(wanted):
    case = cell(**{"accuracy.inertial_number": wanted})
    _, plan = make_plan(case)
    rotor, disc = (getattr(plan.scene.motion, name).speed(0.0) for name in ("rotor", "disc"))
    assert rotor / (10.0 * pi) == pytest.approx(plan.scaled.factor, rel=1e-12) and rotor / disc == pytest.approx(-10.0)
    assert case.scene.motion.rotor.speed(0.0) == pytest.approx(10.0 * pi)  # the user's scene stays
    reported = check(case)
    pressure = reported.expected.pressure
    found = inertial_number((rotor - disc) * SHEAR, 0.1e-3, 7700.0, pressure)
    assert found == pytest.approx(wanted, rel=1e-9)
    assert plan.end == pytest.approx(12.0 / SHEAR / (rotor - disc), rel=0.01)  # to a whole window
    # slip power, heat and Stokes number are those of the device at its own speeds
    own = check(cell())
    for name in ("heat", "fluid_drag", "inertia of grains", "centrifugal force"):
        one, other = (next(line for line in each.omitted_effects if line.effect == name) for each in (reported, own))
        assert one.value == pytest.approx(other.value, rel=0.01) and one.note == other.note
    assert f"rotor turned at {rotor * 30.0 / pi:.4g} rpm instead of 300 rpm" in reported.decisions["speed"]
    assert bool(reported.decisions["speed"].warnings) == (wanted > QUASI_STATIC)


def test_the_steps_of_a_strain_do_not_grow_with_finer_grains():
    steps = []
    for diameter in ("0.2 mm", "0.1 mm"):
        _, plan = make_plan(cell(**{"accuracy.inertial_number": 0.03, "particles.diameter": diameter}))
        steps.append(plan.end / plan.dt)
    assert steps[1] == pytest.approx(steps[0], rel=0.1)


def test_a_strain_is_slip_times_mean_radius_over_width():
    _, plan = make_plan(cell(**{"time.average_from": "strain 6"}))
    assert plan.scene.span.end_time == pytest.approx(12.0 / (11.0 * pi * SHEAR), rel=1e-12)
    assert plan.scene.span.average_time == pytest.approx(0.5 * plan.scene.span.end_time, rel=1e-12)
    assert cell().resolved()["time"]["end"] == "strain 12" and case_from(cell().resolved()).scene == cell().scene
    with pytest.raises(ValueError, match=r"average_from = 1 s is not before time\.end = strain 12"):
        make_plan(cell(**{"time.average_from": "1 s"}))


@pytest.mark.parametrize(
    ("values", "key", "message"),
    [
        ({"motion.rotor": {"free": {"inertia": 1e-5}}}, "time.end", "motion.rotor is free"),
        (
            {"motion.rotor.speed": {"times": [0.0, 1e-3], "values": [0.0, 30.0]}},
            "accuracy.inertial_number",
            "changes in time",
        ),
        ({"motion.disc.speed": "300 rpm"}, "accuracy.inertial_number", "both shafts have the same speed"),
        ({"effects.dipoles": None}, "accuracy.inertial_number", "only magnetised powder has an expected pressure"),
        ({"effects.fluid_drag": {"viscosity": 0.1}}, "accuracy.inertial_number", "the drag of the fluid depends"),
        ({"accuracy.inertial_number": 2.0}, "accuracy.inertial_number", "<= 1"),
        ({"time.end": "strain -1"}, "time.end", "write it as in 'strain 20'"),
        ({"time.average_from": "strain 12"}, "time.average_from", "is not before time.end = strain 12"),
        (
            {"geometry": {"kind": "box", "size": [5e-3] * 3}, "particles.sector": None, "field.direction": "z"},
            "time.end",
            "no gap is sheared",
        ),
    ],
)  # fmt: skip
def test_what_has_no_one_slip_is_refused(values, key, message):
    with pytest.raises(SceneError) as refused:
        cell(**{"accuracy.inertial_number": 0.02, **values})
    assert any(fault.key == key and message in fault.message for fault in refused.value.faults)


def test_a_pressure_is_needed_and_weight_must_not_count():
    with pytest.raises(ValueError, match="no field magnetises the powder"):
        make_plan(cell(**{"accuracy.inertial_number": 0.02, "field.field_strength": 0.0}))
    with pytest.raises(ValueError, match="weight adds more"):
        make_plan(cell(**{"accuracy.inertial_number": 0.02, "field.field_strength": 100.0, "effects.gravity": {}}))


def test_a_sector_is_the_narrowest_that_is_as_wide_as_asked():
    for diameter in (0.1e-3, 0.05e-3):
        particles = cell(**{"particles.diameter": diameter}).scene.particles
        radius = 10e-3 + 0.5 * diameter
        assert particles.sector * particles.n_sectors == pytest.approx(2.0 * pi, rel=1e-12)
        assert particles.n_sectors == floor(pi / asin(3.0 * diameter / radius))
        assert 2.0 * radius * sin(pi / (particles.n_sectors + 1)) < 6.0 * diameter
    with pytest.raises(SceneError, match="less than twice the dipole cut-off"):
        cell(**{"particles.sector": "3 diameters"})
    with pytest.raises(SceneError, match="wider than half the ring"):
        cell(**{"particles.sector": "300 diameters"})


def test_ends_of_a_run_are_compared_by_its_own_shear_rate(tmp_path):
    folder = RunFolder.create(tmp_path / "run", cell().toml())
    assert seconds_of("strain 12", folder) is None and seconds_of(3e-3, folder) == 3e-3  # nothing has been planned
    folder.write_plan({"shear_rate": 400.0})
    folder.history.write_text("time\n0.01\n0.02\n0.03\n")
    assert seconds_of("strain 12", folder) == pytest.approx(0.03)
    state = {"case": cell().toml(), "window": 3}
    for end in ("strain 13", "40 ms"):
        refuse_earlier_end(folder, state, cell(**{"time.end": end}).scene.span.end)
    for end in ("strain 11", "20 ms"):
        with pytest.raises(OutputError, match="earlier than the checkpoint"):
            refuse_earlier_end(folder, state, cell(**{"time.end": end}).scene.span.end)


def test_what_a_run_had_stands_beside_what_was_asked_for():
    _, plan = make_plan(cell(**{"accuracy.inertial_number": 0.1}))
    assert "Inertial number: 0.1 requested, 0.013 at" in plan.scaled.note()
    had = plan.scaled.had(0.075, "magnetic")
    assert had["inertial_number_of_the_run"] == 0.075 and "warnings" not in had
    assert had["note"] == f"{plan.scaled.note()}, 0.075 in the run (magnetic pressure)"
    (text,) = plan.scaled.had(0.15, "magnetic")["warnings"]
    assert "had an inertial number of 0.15" in text and "lower accuracy.inertial_number" in text
    assert plan.scaled.had(None, "magnetic") == {}
