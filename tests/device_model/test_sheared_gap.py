"""What is sheared follows what is filled: shear rate, strain and impacts at the faces are those of their gap."""

import json
import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.device_model.device import build_device
from emclutch.scene.case import load_case
from emclutch.simulation.observables import Observables

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
# A disc of 45 mm in a gap of 1 mm, its faces from 30 mm on: 2 pi 45 6 mm^2 of rim and 2 pi (45^2 - 30^2) mm^2 of faces.
NO_FIELD = {f"effects.{name}": None for name in ("magnetic_force", "dipoles", "saturation")}
WIDE = {"geometry.face_gap": "1.6 mm", "particles.mass": "10 g"}


def device_of(region, **values):
    scene = load_case(GOOD, {**NO_FIELD, **WIDE, "particles.region": region, **values}).scene
    return scene, build_device(scene)


@pytest.mark.parametrize(
    ("region", "gap", "radius"),
    [
        ("rim", 1e-3, 45.5e-3),
        ("faces", 1.6e-3, 2.0 / 3.0 * (45**3 - 30**3) / (45**2 - 30**2) * 1e-3),
        ("cavity", 1.6e-3, 38e-3),  # the faces have four times the area of the rim
    ],
)
def test_gap_and_radius_are_those_of_the_filled_region(region, gap, radius):
    _, device = device_of(region)
    assert device.shear_gap == pytest.approx(gap)
    assert device.shear_radius == pytest.approx(radius)


def test_a_cavity_around_a_thick_disc_is_sheared_at_the_rim():
    _, device = device_of("cavity", **{"geometry.disc_thickness": "60 mm"})
    assert device.shear_gap == pytest.approx(1e-3) and device.shear_radius == pytest.approx(45.5e-3)
    assert device.narrowest_gap == pytest.approx(1e-3)


def test_the_inertial_number_at_the_faces_is_that_of_both_face_gaps():
    """I = (omega r/g) d sqrt(rho mu A r/T), with A of both faces and r their mean radius."""
    scene, device = device_of("faces")
    torque, slip, radius, area = 2.0, 10.0, 38e-3, 2.0 * math.pi * (45**2 - 30**2) * 1e-6
    observables = Observables(scene, device)
    pressure = observables.friction_pressure(torque)
    assert pressure == pytest.approx(torque / (area * radius) / scene.contact.friction_at_walls, rel=1e-12)
    expected = slip * radius / 1.6e-3 * 0.2e-3 * math.sqrt(scene.particles.density / pressure)
    assert observables.inertial_number(slip, pressure) == pytest.approx(expected, rel=1e-12)
    assert observables.inertial_number(slip, 0.0) is None


def test_check_names_the_gap_and_the_impacts_in_it(tmp_path):
    """Layers of 0.2 mm grains go past each other at twice d/g of the wall's speed of 0.482 m/s at r = 46 mm."""
    reported = {}
    for region in ("rim", "faces"):
        scene = tmp_path / f"{region}.toml"
        load_case(GOOD, {**NO_FIELD, **WIDE, "effects.gravity": None, "particles.region": region}).write_toml(scene)
        output = CliRunner().invoke(app, ["check", str(scene), "--json"])
        reported[region] = json.loads(output.stdout)["plan"]
    assert reported["rim"]["sheared gap"] == "at the rim, 1 mm wide at a mean radius of 45.5 mm"
    assert reported["faces"]["sheared gap"] == "at the faces, 1.6 mm wide at a mean radius of 38 mm"
    assert "impacts at 0.193 m/s" in reported["rim"]["stiffness"]  # 0.482 * 0.4
    assert "impacts at 0.12 m/s" in reported["faces"]["stiffness"]  # 0.482 * 0.25
