"""An entry of unusual size is reported with its value, its range and what may be meant; a usual one is not."""

from math import pi
from pathlib import Path

import pytest

from emclutch.device_model.coil_heat import COOLING, coil_heat_in_words
from emclutch.device_model.excitation import Excitation
from emclutch.scene.case import case_from, load_case
from emclutch.scene.errors import SceneError
from geometry import Clutch
from geometry.time_profile import TimeProfile

GOOD = load_case(Path(__file__).parents[1] / "scene" / "broken" / "good.toml")
POWDER = GOOD.data["particles"] | {"density": 72.0, "mass": "0.1 g"}
COIL = {"coil.voltage": None, "coil.resistance": None, "coil.turns": 1000}  # 10 mm by 10 mm, 0.6 of it copper
CELL = {
    "scene": {"title": "cell"},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11e-3, "height": 2e-3},
    "field": {"source": "uniform", "field_strength": -12.0 / (4e-7 * pi), "direction": "radial"},
    "particles": {"diameter": "0.1 mm", "solid_fraction": 0.3},
    "effects": {"dipoles": {}, "saturation": {}},
    "time": {"end": "1 ms"},
}


@pytest.mark.parametrize(
    ("values", "reported", "asks"),
    [
        ({"contact.friction": 4.0}, "4 is outside the usual range of 0.05 to 1", "decimal point"),
        ({"contact.wall_friction": 0.01}, "0.01 is outside", "decimal point"),
        ({"contact.restitution": 0.999}, "0.999 is outside", "never comes to rest"),
        ({"particles": POWDER}, "72 kg/m^3 is outside the usual range of 2000 to 9000 kg/m^3", "g/cm^3"),
        ({"particles": POWDER | {"density": 7.87, "mass": "0.01 g"}}, "7.87 kg/m^3 is outside", "write '7.87 g/cm^3'"),
        ({"contact.friction": 5}, "5 is outside", "decimal point"),
        ({"particles.saturation": 1.7}, "1.7e-06 MA/m is outside", "write '1.7 MA/m'"),
        ({"particles.stands_for": 60e-9}, "particles.stands_for = 6e-05 mm is outside", "metres"),
        ({"contact.stiffness": 5.0}, "5 N/m is outside", "write '5 kN/m'"),
        ({"contact.law": "hertz_mindlin", "contact.youngs_modulus": 210.0}, "2.1e-07 GPa", "write '210 GPa'"),
        ({"effects.gravity": {"acceleration": 9810.0}}, "9810 m/s^2 is outside", "write '9810 mm/s^2'"),
        ({"effects.cohesion": {"model": "dmt", "work_of_adhesion": 50.0}}, "50 J/m^2 is outside", "write '50 mJ/m^2'"),
        ({"effects.rolling_friction": {"coefficient": 2.0}}, "coefficient = 2 is outside", "effective radii"),
        ({"motion.rotor.speed": 1e5}, "4600 m/s is outside", "rad/s"),
        ({**COIL, "coil.current": "3 A"}, "density in the copper = 50 A/mm^2", "0.6 of it, or raise geometry.coil_w"),
        ({**COIL, "coil.current": None, "coil.voltage": "600 V"}, "current density", "Lower coil.voltage to 0"),
    ],
)
def test_what_is_unusual_is_reported(values, reported, asks):
    (warning,) = GOOD.with_values(values).warnings
    assert reported in warning and asks in warning


def test_a_mass_that_the_density_makes_too_large_names_the_density():
    with pytest.raises(SceneError, match=r"more than can be packed.*write '7\.87 g/cm\^3'"):
        GOOD.with_values({"particles": POWDER | {"density": 7.87}})


def test_a_uniform_field_of_twelve_tesla_is_reported_and_what_is_usual_is_not():
    (warning,) = case_from(CELL, {}).warnings
    assert "12 T is outside the usual range of 0 to 2.5 T" in warning
    for values in ({"contact.friction": 0.0}, {**COIL, "coil.current": "1 A"}):  # without friction is asked for
        assert GOOD.with_values(values).warnings == ()


class Wound(Excitation):
    """A winding alone: its heat needs neither poles nor a mesh."""

    def pole_line(self, *, faces=False):
        raise AssertionError("heat does not look at the poles")

    def mesh_in_words(self):
        return ""


def test_a_warm_coil_gives_off_what_it_takes():
    """P = R I^2 = alpha S Delta T, on the mantle and the ends of the housing."""
    shape = Clutch()
    winding = GOOD.scene.coil.winding_in(shape.coil_area, shape.coil_mean_radius)
    surface = 2.0 * pi * shape.outer_radius * shape.housing_length + 2.0 * pi * shape.outer_radius**2
    assert GOOD.scene.geometry.cooled_surface(shape) == pytest.approx(surface, rel=1e-12)
    rise = 25.5 * 2.0**2 / (COOLING * surface)
    words = [coil_heat_in_words(GOOD.scene, Wound(winding, TimeProfile.constant(I)), shape) for I in (-2.0, 0.5)]
    assert f"102 W; steady temperature without slip: {float(f'{rise:.2g}'):g} K above the room" in words[0]
    assert ["overloaded" in "".join(one.warnings) for one in words] == [True, False]
