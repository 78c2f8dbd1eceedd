"""The thesis' centrifugal clutch as scenes: they say what the cases promise, and what cannot be is refused."""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict
from pathlib import Path

import pytest

import emclutch
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.scene.fill import fill_of
from emclutch.simulation.forecast.shot_clutch import shot_clutch_torque, shot_ring_radius
from geometry.centrifugal import CentrifugalClutch

THESIS = Path(__file__).resolve().parents[2] / "cases" / "thesis"
RPM = math.pi / 30.0
SCENES = ("centrifugal", "centrifugal_overload", "centrifugal_held")


@pytest.fixture(scope="module")
def case():
    return emclutch.load_case(THESIS / "centrifugal.toml")


def refusal(case, values) -> str:
    with pytest.raises(SceneError) as refused:
        case.with_values(values)
    return refused.value.report()


def test_all_scenes_have_the_same_device():
    """The defaults of the shape are the thesis' device; a scene that departs from it would be another."""
    for name in SCENES:
        shape = emclutch.load_case(THESIS / f"{name}.toml").scene.shape()
        assert asdict(shape) == pytest.approx(asdict(CentrifugalClutch()), rel=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_resolved_scenes_load_to_the_same(name):
    case = emclutch.load_case(THESIS / f"{name}.toml")
    assert case_from(tomllib.loads(case.toml())).scene == case.scene


def test_a_thousand_spheres_fill_about_half_of_the_device(case):
    shape, particles = case.scene.shape(), case.scene.particles
    fill = fill_of(shape, particles)
    assert fill.count == 1000
    mean_cube = (0.015**4 - 0.010**4) / (4 * 0.005)  # of diameters from 10 to 15 mm, each as likely
    assert fill.mass == pytest.approx(1000 * 7800 * math.pi / 6 * mean_cube)
    settled = fill.count * particles.grain_volume / 0.6  # solid fraction of settled shot
    assert 1 / 3 < settled / shape.volume < 0.52
    assert len(shape.boxes_to_fill(particles.region)) == shape.vanes


def test_the_motor_waits_for_the_filling_and_the_load_holds_below_half_its_speed(case):
    speed = case.scene.motion.rotor.speed
    assert speed.times[:2] == (0.0, 2.0) and speed.values[:2] == (0.0, 0.0)  # the thesis fills for 2 s
    assert speed.values[-1] == pytest.approx(1000 * RPM)
    shape, particles = case.scene.shape(), case.scene.particles
    ring = shot_ring_radius(1000 * particles.grain_volume / 0.6, shape.width, shape.drum_radius)
    torque = shot_clutch_torque(
        1000 * RPM, friction=case.scene.contact.friction, bulk_density=0.6 * particles.density, width=shape.width,
        drum_radius=shape.drum_radius, ring_radius=ring,
    )  # fmt: skip
    load = case.scene.motion.disc.free.load_torque
    engaged = 1000 * math.sqrt(load(0.0) / torque)  # the torque grows with the square of the speed
    # The estimate knows no friction on covers and vanes, no heaps and no ribs, and so is a lower bound of the torque:
    # the output starts at that speed at the latest.
    assert 500 < engaged < 850


def test_the_study_has_the_thesis_numbers_of_spheres():
    study = emclutch.read_study(THESIS / "centrifugal_study.toml")
    points = [(case.scene.contact.method, case.scene.particles.count) for _, case in study.cases()]
    assert points == [(method, count) for method in ("dem", "dvi") for count in (200, 500, 1000)]
    speeds = emclutch.read_study(THESIS / "centrifugal_speeds.toml")
    assert all(case.scene.motion.disc.speed.largest == 0.0 for _, case in speeds.cases())


def test_the_overload_switches_on_after_the_start(case):
    motion = emclutch.load_case(THESIS / "centrifugal_overload.toml").scene.motion
    load = motion.disc.free.load_torque
    motor = motion.rotor.free.motor
    assert motor.switched_on == 2.0 < load.times[0]
    assert load.values == (200.0, 1500.0, 1500.0, 3000.0)
    # the motor can drive its load but no overload
    assert motor.signed_stall_torque > load.values[0]
    assert motor.slope * motor.no_load_speed == pytest.approx(motor.signed_stall_torque)
    assert motion.rotor.free.largest_speed == pytest.approx(1100 * RPM)


def test_a_motor_that_turns_backwards_has_a_negative_torque_and_a_positive_slope(case):
    motor = {"stall_torque": "10 N m", "no_load_speed": "-600 rpm"}
    shaft = case.with_values({"motion.rotor.speed": None, "motion.rotor.free": {"inertia": 1, "motor": motor}})
    motor = shaft.scene.motion.rotor.free.motor
    assert motor.signed_stall_torque == -10.0
    assert motor.slope == pytest.approx(10.0 / (600 * RPM))


REFUSED = {
    "tips that let the shot pass": ({"geometry.tip_clearance": "17 mm"},
        "geometry.tip_clearance = '17 mm' is not possible", "lower geometry.tip_clearance"),
    "fraction of a vane": ({"geometry.vanes": 2.5}, "geometry.vanes = 2.5", "allowed: 1 to 60"),
    "slots without sizes": ({"geometry.slot_width": None}, "geometry.slot_width", "correct geometry.slot_width"),
    "too many spheres": ({"particles.count": 3000}, "particles.count = 3000", "allowed: at most"),
    "misspelt key": ({"geometry.rib_hight": "1 mm"}, "geometry.rib_hight", "did you mean 'rib_height'?"),
    "part of a device with a coil": ({"particles.region": "rim"}, "particles.region", "remove it"),
    "motor beside a drive torque": ({"motion.disc.free.drive_torque": 1, "motion.disc.free.motor":
        {"stall_torque": 1, "no_load_speed": 1}}, "motion.disc.free.drive_torque", "keep one of them"),
    "motor that does not turn": ({"motion.disc.free.motor": {"stall_torque": "1 N m", "no_load_speed": 0}},
        "motion.disc.free.motor.no_load_speed", "'1500 rpm'"),
    "motor without torque": ({"motion.disc.free.motor": {"stall_torque": 0, "no_load_speed": 1}},
        "motion.disc.free.motor.stall_torque", "allowed: > 0"),
    "load that drives": ({"motion.disc.free.load_torque": {"times": [0, 1], "values": ["1 N m", "-1 N m"]}},
        "motion.disc.free.load_torque.values[1]", "allowed: >= 0"),
    "load that goes back in time": ({"motion.disc.free.load_torque": {"times": [1, 0], "values": [1, 2]}},
        "motion.disc.free.load_torque.times", "must increase"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_with_a_remedy(case, name):
    values, *fragments = REFUSED[name]
    report = refusal(case, values)
    for fragment in fragments:
        assert fragment in report
