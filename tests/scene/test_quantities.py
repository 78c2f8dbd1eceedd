"""Quantities: text with a unit or a bare SI number becomes SI; all else is refused in the user's words."""

from __future__ import annotations

import math

import pytest
from pydantic import TypeAdapter, ValidationError

from emclutch.scene import units
from geometry import table_file

POUND_INCH = 0.45359237 * 9.80665 * 0.0254  # [N m]
RIGHT = [
    (units.Length, "1.2 mm", 1.2e-3), (units.Length, 0.5, 0.5), (units.Length, "50 µm", 50e-6),
    (units.Length, ".5e1 cm", 0.05),
    (units.Speed, "1500 rpm", 50 * math.pi), (units.Speed, "-1 turn/s", -2 * math.pi),
    (units.Speed, "60 rev/min", 2 * math.pi),
    (units.Angle, "3 deg", math.pi / 60), (units.Angle, "3°", math.pi / 60), (units.Current, "940 mA", 0.94),
    (units.Resistance, "25.5 ohm", 25.5), (units.Mass, "20 g", 0.02), (units.FieldStrength, "100 kA/m", 1e5),
    (units.Magnetisation, "1.3 MA/m", 1.3e6), (units.Torque, "12 N m", 12.0), (units.Torque, "12 N·m", 12.0),
    (units.Torque, "2 mN m", 2e-3), (units.Torque, "1 lbf*in", POUND_INCH),
    (units.Torque, "10 in-lbs", 10.0 * POUND_INCH), (units.Torque, "1 lb ft", 12.0 * POUND_INCH),
    (units.Torque, "16 oz in", POUND_INCH), (units.Torque, "1 kgf m", 9.80665), (units.Torque, "1 N·cm", 0.01),
    (units.Torque, "2 J", 2.0),
    (units.Time, "20 ms", 0.02), (units.Density, "7.7 g/cm3", 7700.0), (units.Inertia, "2 kg m^2", 2.0),
    (units.Speed, "3 rad s-1", 3.0), (units.FieldStrength, "2 kA*m^-1", 2e3),
    (units.Density, "1 kg/(m m²)", 1.0),
    (units.Stiffness, "3 N/mm", 3000.0),
    (units.CurveFieldStrength, "2 Oe", 500.0 / math.pi), (units.Coercivity, "0.2 kOe", 5e4 / math.pi),
    (units.FluxDensity, "21.5 kG", 2.15), (units.FluxDensity, "500 G", 0.05),
]  # fmt: skip
WRONG = [
    (units.Length, "3 kg", "is a mass; a length is needed, e.g. '1 mm'"), (units.Length, "3", "has no unit"),
    (units.Length, "1 mn", "unknown unit"), (units.Length, "wide", "is not a number with a unit"),
    (units.Length, 0, "allowed: > 0 m"), (units.Length, "20 m", "<= 10 m"),
    (units.Length, True, "is not a number"),
    (units.Length, [1], "is not a number"), (units.Length, math.inf, "is not finite"),
    (units.Length, "1e999 m", "not finite"), (units.Length, 10**400, "is not finite"),
    (units.Length, 5e-324, "is below the minimum; allowed: at least 1e-09 m"),
    (units.Mass, "1e-20 kg", "is below the minimum"),
    (units.Speed, "50 Hz", "no angle"), (units.Angle, "0.1 m", "is a length"),
    (units.Angle, "10 %", "no angle"),
    (units.Time, "1 V", "is a voltage"), (units.Length, "1 m**9**9**9", "unit"),
    (units.Length, "1 __import__('os')", "unit"),
    (units.Magnetisation, "1 kOe", "is in kOe; a magnetisation is needed"),
    (units.Torque, "10 NM", "did you mean 'Nm'"), (units.Torque, "10 nm", "is a length; did you mean 'Nm'"),
    (units.Torque, "10 lb/in", "is in lb/in; did you mean 'lbin'"), (units.Torque, "10 Lb-In", "did you mean 'lbin'"),
    (units.Torque, "10 lb", "is a mass; a torque is needed"),
    (units.Current, "1 A/m", "is a field strength"), (units.Mass, "5 N", "is a force"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "given", "value"), RIGHT)
def test_entry_becomes_si(kind, given, value):
    assert TypeAdapter(kind).validate_python(given) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(("kind", "given", "message"), WRONG)
def test_entry_is_refused(kind, given, message):
    with pytest.raises(ValidationError, match=message.replace("'", ".")):
        TypeAdapter(kind).validate_python(given)


@pytest.mark.parametrize("given", [-2.225e-311, "1.766e-177 mA", 1.2246e-16])
def test_what_is_nothing_but_round_off_is_nothing(given):
    assert TypeAdapter(units.Current).validate_python(given) == 0.0
    assert units.number("0.3", 0.0, 1.0).read(5e-324) == 0.0
    assert TypeAdapter(units.Current).validate_python("1 nA") > 0.0


@pytest.mark.parametrize(
    "unit",
    ["lbf in", "in-lbs", "lb in", "in lb", "inch-pounds", "lbf ft", "ft-lb", "foot pounds", "oz in", "in-oz", "kgf m",
     "kg cm", "kp·m", "N·cm", "N cm", "N-m", "N.m", "Nmm", "kN m",
     *next(one for one in table_file.UNITS if "Nm" in one)],
)  # fmt: skip
def test_units_of_torque_are_those_of_tables(unit):
    factor = table_file.factor_of(unit, "Nm")
    assert TypeAdapter(units.Torque).validate_python(f"2 {unit}") == pytest.approx(2.0 * factor, rel=1e-14)


def test_percent_is_a_pure_number():
    assert units.number("0.3", 0.0, 1.0).read("45 %") == pytest.approx(0.45)


def test_an_angle_is_not_a_pure_number():
    with pytest.raises(ValueError, match="is an angle"):
        units.number("0.3").read("3 deg")
