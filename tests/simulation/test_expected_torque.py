"""The expected torque is the integral of its law over the sheared gap, and has the limits of that law."""

from math import pi
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from emclutch.device_model.device import build_device
from emclutch.scene.case import case_from, load_case
from emclutch.simulation.forecast.expected_torque import CHAIN, chain_stress, expected_torque, neck_stress
from emclutch.simulation.forecast.shot_clutch import shot_clutch_torque, shot_ring_radius

CASES = Path(__file__).resolve().parents[2] / "cases"
INNER, OUTER, HEIGHT, FILL = 10e-3, 11.2e-3, 2e-3, 0.35
MIDDLE, GAP = 0.5 * (INNER + OUTER), OUTER - INNER
CELL = {
    "scene": {"title": "sheared annulus"},
    "geometry": {"kind": "shear_cell", "inner_radius": INNER, "outer_radius": OUTER, "height": HEIGHT},
    "field": {"source": "uniform", "field_strength": 60e3, "direction": "radial"},
    "particles": {"diameter": "0.1 mm", "solid_fraction": FILL, "sector": "20 deg", "saturation": 1.7e6},
    "motion": {"rotor": {"speed": "300 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"dipoles": {"model": "near_field"}, "saturation": {}},
    "time": {"end": "1 ms"},
}


def expected(**values):
    scene = case_from(CELL, values).scene
    return expected_torque(scene, build_device(scene), None)


def in_field(H, **values):
    return expected(**{"field.field_strength": H, **values}).torque


def test_torque_of_a_cell_is_the_integral_over_its_cylinders():
    """T = (1/g) integral of tau(H0 R/r) 2 pi r^2 L dr, every cylinder being one that the powder may yield on."""
    found, _ = quad(
        lambda r: float(neck_stress(FILL, 60e3 * MIDDLE / r, 1.7e6)) * 2.0 * pi * r**2 * HEIGHT, INNER, OUTER
    )
    assert in_field(60e3) == pytest.approx(found / GAP, rel=1e-3)


@pytest.mark.parametrize(("model", "power"), [("near_field", 1.0), ("mutual", 2.0)])
def test_weak_fields_shear_necks_in_proportion_and_dipoles_as_the_square(model, power):
    weak, twice = (in_field(H, **{"effects.dipoles.model": model}) for H in (100.0, 200.0))
    assert np.log2(twice / weak) == pytest.approx(power, abs=0.01)


@pytest.mark.parametrize("model", ["near_field", "mutual"])
def test_torque_grows_with_the_field_up_to_the_plateau_of_saturated_grains(model):
    torques = [in_field(H, **{"effects.dipoles.model": model}) for H in (-1e3, 10e3, 50e3, 200e3, 800e3, 9e6)]
    assert np.all(np.diff(torques[:-1]) > 0.0)
    plateau = 271.7e3 * FILL**1.5239 * 2.0 * pi * HEIGHT * (OUTER**3 - INNER**3) / (3.0 * GAP)
    assert torques[-1] == pytest.approx(plateau, rel=1e-3)


def test_grains_of_more_saturation_are_alike_in_a_stronger_field():
    """Fields over Ms and stresses over mu_0 Ms^2 are all that the law of necks knows."""
    H = np.array([1e3, 50e3, 500e3])
    assert neck_stress(0.3, 2.0 * H, 2.0e6) == pytest.approx(4.0 * neck_stress(0.3, H, 1.0e6), rel=1e-12)


def test_chain_stress_is_the_steepest_slope_of_its_energy():
    """Of one pair a grain, at d sqrt(1 + gamma^2): U = mu_0 m^2 (gamma^2 - 2)/(4 pi d^3 (1 + gamma^2)^2.5)."""
    strain = np.linspace(0.0, 1.0, 20001)
    volume = pi / 6.0
    energy = 4e-7 * pi * volume**2 / (4.0 * pi) * (strain**2 - 2.0) / (1.0 + strain**2) ** 2.5
    steepest = 0.4 / volume * np.gradient(energy, strain).max()
    assert chain_stress(0.4, np.ones(1))[0] == pytest.approx(steepest, rel=5e-3)
    assert CHAIN < 0.125


@pytest.mark.parametrize("values", [{"field.direction": "axial"}, {"field.field_strength": 0.0},
                                    {"effects.dipoles": None, "effects.magnetic_force": {}}])  # fmt: skip
def test_without_a_pull_across_the_gap_there_is_friction_of_the_centrifugal_force_alone(values):
    found = expected(**values)
    mass = 0.35 * 7700.0 * pi * (OUTER**2 - INNER**2) * HEIGHT
    speed = 300.0 * pi / 30.0
    assert found.torque == pytest.approx(0.3 * mass * speed**2 * MIDDLE**2, rel=0.02)  # a whole number of grains
    assert "friction of weight and centrifugal force" in found.in_words()
    weight = expected(**values, **{"effects.gravity": {}}).torque - found.torque
    assert weight == pytest.approx(0.3 * mass * 9.81 * MIDDLE, rel=0.02)


def test_a_shot_clutch_has_its_closed_form():
    scene = load_case(CASES / "thesis" / "centrifugal.toml", {"effects.gravity": None}).scene
    device, shape = build_device(scene), scene.shape()
    bulk = 0.6 * 7800.0
    torque = shot_clutch_torque(
        1000.0 * pi / 30.0, friction=0.3, bulk_density=bulk, width=shape.width, drum_radius=shape.drum_radius,
        ring_radius=shot_ring_radius(device.fill.mass / bulk, shape.width, shape.drum_radius),
    )  # fmt: skip
    assert expected_torque(scene, device, None).torque == pytest.approx(torque, rel=1e-12)


def test_what_is_a_bound_is_called_one():
    assert "within a factor of three" in expected().in_words()
    assert "at most" in expected(**{"effects.dipoles": None, "effects.magnetic_force": {}}).in_words()
    coarse = expected(**{"particles.diameter": "0.5 mm", "particles.sector": None}).in_words()
    assert coarse.startswith("of the order of") and "holds 2.4 grains" in coarse
    box = case_from(CELL, {"geometry": {"kind": "box", "size": ["2 mm", "2 mm", "2 mm"]}, "motion": None,
                           "field.direction": "z", "particles.sector": None}).scene  # fmt: skip
    assert expected_torque(box, build_device(box), None).torque is None
