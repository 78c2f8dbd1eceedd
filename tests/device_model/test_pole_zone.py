"""Stress, field and fill between pole faces are those of the torque, the field and the grains that make them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas
import pytest

import emclutch
from emclutch.device_model.device import build_device
from emclutch.effects.dipoles import STRONGEST_FIELD
from emclutch.results import Estimate, quantities
from emclutch.scene.grain_smear import element_layers, smear_width
from emclutch.simulation.assembly import assemble
from emclutch.simulation.forecast.expected_field import mean_field_strength
from emclutch.simulation.plan import make_plan
from field import RadialField

CASE = emclutch.load_case(Path(__file__).resolve().parents[2] / "cases" / "powder_clutch.toml").with_values(
    {"particles.diameter": "0.2 mm", "particles.sector": "1.5 deg", "accuracy.inertial_number": None}
)


@pytest.fixture(scope="module")
def zone():
    case = CASE.with_values({"effects.magnetic_force": None, "effects.dipoles": None, "effects.wall_images": None,
                             "effects.saturation": None, "effects.back_reaction": None})  # fmt: skip
    return build_device(case.scene).pole_zone


def test_a_stress_on_both_pole_faces_gives_its_torque(zone):
    """2 pi R L tau R of two faces 12 mm long at 45 mm: 12 N m are 39.3 kPa."""
    tau = 30e3
    assert zone.shear_stress(2.0 * 2.0 * np.pi * 45e-3**2 * 12e-3 * tau) == pytest.approx(tau, rel=1e-12)
    assert zone.shear_stress(12.0) == pytest.approx(39.3e3, rel=1e-3)


def test_field_strength_is_the_mean_by_volume(zone):
    """Of H_r = H0 R/r it is H0 R times the gap's width over the mean radius times that width: H0 at the mean radius."""
    assert zone.field_strength(RadialField(80e3, 45e-3)) == pytest.approx(80e3, rel=1e-6)


class Slotted:
    """H [A/m] of a slotted body, 80 kA/m (1 + cos(6 angle)/2) along r."""

    def sample(self, position):
        angle = np.arctan2(position[:, 1], position[:, 0])
        H = 80e3 * (1.0 + 0.5 * np.cos(6.0 * angle))
        return np.column_stack([H * np.cos(angle), H * np.sin(angle), 0.0 * H]), np.zeros((len(H), 3, 3))


@pytest.mark.parametrize("first", [0.0, 0.1])
def test_field_strength_of_slots_is_the_mean_about_the_axis(zone, first):
    angles = first + np.pi / 3.0 * (np.arange(16) + 0.5) / 16.0
    assert zone.field_strength(Slotted(), angles) == pytest.approx(80e3, rel=1e-9)


def test_fill_counts_the_grains_between_the_faces_alone(zone):
    place = np.array([[45e-3, 0.0, 10e-3], [0.0, 45e-3, -10e-3], [45e-3, 0.0, 0.0], [45e-3, 0.0, 15.5e-3]])
    box = np.pi * ((45.5e-3) ** 2 - (44.5e-3) ** 2) * 12e-3
    assert zone.fill(place, np.full(4, 1e-8)) == pytest.approx(2e-8 / (2.0 * box), rel=1e-12)


@pytest.mark.parametrize(("cutoff", "width", "layers"), [(2.5, 0.5e-3, 8), (3.0, 0.6e-3, 7), (5.5, 1e-3, 4)])
def test_the_smear_is_no_wider_than_the_gap_and_has_four_rows_of_elements(cutoff, width, layers):
    """Gap 1 mm, grains of 0.2 mm."""
    scene = CASE.with_values({"effects.dipoles.cutoff": cutoff, "particles.sector": "3 deg"}).scene
    assert smear_width(scene) == pytest.approx(width, rel=1e-12) and element_layers(scene, 4) == layers
    assert element_layers(scene, 20) == 20


def test_a_sector_needs_twice_the_reach_that_the_grains_have():
    """With the cut-off at 5.5 diameters, 1.1 mm, that is 1.1 mm - or the gap's 1 mm, where moments are fed back."""
    values = {"effects.dipoles.cutoff": 5.5, "particles.sector": "2.6470588235294117 deg"}
    assert CASE.with_values(values).scene.particles.sector == pytest.approx(2.0 * np.pi / 136)
    with pytest.raises(emclutch.SceneError, match=r"less than twice the dipole cut-off \(2.2 mm\)"):
        CASE.with_values({**values, "effects.back_reaction": None})


def test_powder_that_has_run_in_lies_between_the_poles(zone):
    """All of the mass between the faces, none beside them: the zone's fill is that of the region."""
    run_in = CASE.with_values({"particles.region": "poles"})
    device = build_device(run_in.scene)
    grains = assemble(*make_plan(run_in, device)).motion.grains
    assert zone.fill(grains.position, 240.0 * 4.0 / 3.0 * np.pi * grains.radius**3) == pytest.approx(
        device.fill.solid_fraction, rel=1e-12
    )
    everywhere = build_device(CASE.with_values({"particles.region": "rim"}).scene).fill
    assert device.fill.mass == pytest.approx(everywhere.mass, rel=1e-12)
    assert device.fill.solid_fraction == pytest.approx(32.0 / 24.0 * everywhere.solid_fraction, rel=1e-9)


def test_a_sector_is_wide_enough_where_grains_may_wander_to():
    """From the rim at 44.5 mm into the face gaps down to the seal, here at 35 mm."""
    values = {"geometry.seal_radius": "35 mm", "particles.sector": "1.5 deg", "particles.region": "rim"}
    with pytest.raises(emclutch.SceneError, match=r"0\.9189 mm wide .*, less than twice the dipole cut-off"):
        CASE.with_values(values)


def test_the_torque_outside_of_the_pole_faces_is_measured_or_not_said(zone):
    """3 of 4 N m on the disc's faces leave a quarter; without a measured load of the walls no fraction is named."""
    history = pandas.DataFrame({"time": [1.0, 2.0], "field_strength_powder": [1e5, 1e5]})
    torque = Estimate(4.0, 0.1, 10, 1.0, 0.0, True, "steady")
    load = {"poles": {"disc": {"torque": 3.0}, "rotor": {"torque": -3.5}},
            "walls": {"rim": {"body": "disc", "torque": 3.2}, "face": {"body": "disc", "torque": 0.8},
                      "bore": {"body": "rotor", "torque": -4.0}}}  # fmt: skip
    planned, simulation = SimpleNamespace(device=SimpleNamespace(pole_zone=zone)), SimpleNamespace(magnetised=True)
    run = SimpleNamespace(planned=planned, simulation=simulation, histories=(history,), torque=torque, wall_load=load)
    assert quantities.poles.of(run)["torque_outside_of_the_poles"] == pytest.approx(0.25)
    run.wall_load = {}
    assert "torque_outside_of_the_poles" not in quantities.poles.of(run)


def test_the_mean_field_of_check_is_that_of_the_run():
    """Between the poles of the solution at the largest current: the limit of near_field is on one quantity."""
    case = CASE.with_values({"field.size_factor": 3.0})
    device, plan = make_plan(case)
    between = device.pole_zone.field_strength(plan.peak_field.sampler("powder"))
    assert mean_field_strength(device, plan.peak_field) == between
    largest = 1.2 * between  # of the field anywhere in the powder, as at the edges of the poles
    limit = {"particles.saturation": largest / STRONGEST_FIELD}
    assert list(case.with_values(limit).scene.effects.attraction.limits(case.with_values(limit).scene, between)) == []
    (text,) = case.scene.effects.attraction.limits(case.scene, 0.13 * case.scene.particles.saturation)
    assert "the mean field in the powder is" in text
