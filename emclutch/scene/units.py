"""Quantities of a scene: text such as ``"1.2 mm"`` or a bare SI number becomes a float in SI, at the border.

A field of a scene model is declared with one of the annotated types below (`Length`, `Speed`, ...). Each
knows the physical quantity, its SI unit, the allowed range and an example, so that a wrong entry is answered
in those terms. Below the scene models every quantity is a float in SI; no unit object leaves this file.

pint reads the units. It is imported at the first text that has one which is not among `FACTORS` (it takes 0.5 s).
Units of torque are those of tables (`geometry.table_file`) before pint's, for which "lb in" is a mass times a length.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

from emclutch.scene.section import Entry

if TYPE_CHECKING:
    from pint import UnitRegistry
    from pydantic import GetJsonSchemaHandler

_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?(?:\s*[^\d\s,].*)?")
# A unit: names, each with an exponent of one digit at most (or n.5), and the operators between them. Nothing else
# reaches pint, which would compute 9**9**9.
_NAME = r"\(*[A-Za-zµμΩ°%]+(?:(?:\^|\*\*)?-?\d(?:\.5)?|[²³])?\)*"
_UNIT_TEXT = re.compile(rf"(?:1\s*/\s*)?{_NAME}(?:\s*[*/·\s]\s*{_NAME})*")
_MAX_UNIT = 40
_ANGLE_UNITS = {
    "radian",
    "milliradian",
    "degree",
    "arcminute",
    "arcsecond",
    "turn",
    "revolutions_per_minute",
    "revolutions_per_second",
}
_MEANT = {"m": ("mm", "millimetres"), "rad": ("deg", "degrees")}  # likely, where a bare number is too large
_LEAST = 1e-15  # in SI: what has to be positive is refused below it, what may be 0 as well is 0
_COMMON_UNITS = (
    "m, mm, um, cm, g, kg, mg, s, ms, us, min, A, mA, V, ohm, mohm, rpm, rad/s, deg/s, rad, deg, turn, N, "
    "mN, N m, mN m, N/m, kN/m, N/m^1.5, Pa, MPa, GPa, J/m^2, m/s, kg/m^3, g/cm^3, A/m, kA/m, MA/m, T, mT, kg m^2, "
    "g cm^2, m/s^2, degC, %"
).split(", ")

TORQUE_UNIT = "N*m"
FACTORS = {
    "m": {"mm": 1e-3, "um": 1e-6, "cm": 1e-2},
    "kg": {"g": 1e-3, "mg": 1e-6},
    "s": {"ms": 1e-3, "us": 1e-6, "min": 60.0},
    "A": {"mA": 1e-3},
    "ohm": {"mohm": 1e-3},
    "rad/s": {"rpm": math.pi / 30.0},
    "rad": {"deg": math.pi / 180.0},
    "N": {"mN": 1e-3},
    "N/m": {"kN/m": 1e3, "MN/m": 1e6},
    "Pa": {"MPa": 1e6, "GPa": 1e9},
    "A/m": {"kA/m": 1e3, "MA/m": 1e6},
    "T": {"mT": 1e-3},
    "": {"%": 1e-2},
    "degC": {"°C": 1.0},
}
"""Units of most scenes, in the SI unit of their quantity: to the last bit as pint converts them."""

_OERSTEDS = {"Oe": 1e3 / (4.0 * math.pi), "kOe": 1e6 / (4.0 * math.pi)}
# Of Gauss' system, by quantity: pint gives them dimensions of their own. A magnetisation in Oe might be 4 pi M.
_GAUSSIAN = {
    "a field strength": _OERSTEDS,
    "a coercivity": _OERSTEDS,
    "a flux density": {"G": 1e-4, "kG": 0.1},
}


@lru_cache(maxsize=1)
def registry() -> UnitRegistry:
    """Return the one unit registry of the program, built at the first call."""
    from pint import UnitRegistry  # local: see the module's docstring

    return UnitRegistry()


@lru_cache(maxsize=1)
def _names_of_dimensions() -> dict[Any, str]:
    """Map a dimension to words, for «is a mass; a length is needed»."""
    words = {
        "m": "a length",
        "kg": "a mass",
        "s": "a time",
        "A": "a current",
        "ohm": "a resistance",
        "V": "a voltage",
        "rad": "an angle or a pure number",
        "rad/s": "an angular speed or a frequency",
        "N": "a force",
        "N*m": "a torque or an energy",
        "A/m": "a field strength",
        "T": "a flux density",
        "N/m": "a stiffness",
        "N/m^1.5": "a Hertz stiffness",
        "kg/m^3": "a density",
        "kg*m^2": "a moment of inertia",
        "m/s": "a speed",
        "m/s^2": "an acceleration",
        "K": "a temperature",
        "m^2": "an area",
        "m^3": "a volume",
        "Pa": "a pressure",
        "W": "a power",
        "H": "an inductance",
        "Wb": "a magnetic flux",
    }
    return {registry().parse_units(unit).dimensionality: name for unit, name in words.items()}


@dataclass(frozen=True)
class Quantity(Entry):
    """Meaning of a float in a scene: physical quantity, SI unit, allowed range and an example.

    Attributes
    ----------
    name : words with their article, e.g. ``"a length"``
    unit : SI unit of the stored float; empty for a pure number
    example : an entry that is right, as a user would type it
    minimum, maximum : bounds in SI; infinite where there is none
    open_minimum : the minimum itself is not allowed
    least : what is above 0 and below this is refused: it is never meant, and its square or cube may be no number
    angular : the unit must contain an angle. Hz, 1/s and pure numbers have the same dimension as rad/s and
        rad, and ``"50 Hz"`` read as 50 rad/s instead of 50 turns per second would be a silent factor of 2 pi.
    """

    name: str
    unit: str
    example: str
    minimum: float = -math.inf
    maximum: float = math.inf
    open_minimum: bool = False
    angular: bool = False
    least: float = 0.0

    STORED = float

    @property
    def range_text(self) -> str:
        """The allowed range, ``"> 0 m, <= 10 m"``, in SI but for angles; empty where everything finite is allowed."""
        name, factor = ("deg", 180.0 / math.pi) if self.unit == "rad" else (self.unit, 1.0)
        unit = f" {name}" if name else ""
        parts = []
        if self.minimum > -math.inf:
            parts.append(f"{'>' if self.open_minimum else '>='} {factor * self.minimum:g}{unit}")
        if self.maximum < math.inf:
            parts.append(f"<= {factor * self.maximum:g}{unit}")
        return ", ".join(parts)

    def read(self, given: object) -> float:
        """Return the entry as a float in SI.

        Raises
        ------
        ValueError
            Not a number or a text with a unit, wrong dimension, out of range. The message follows on the
            key and the entry, as in ``geometry.gap = '3 kg' is a mass; a length is needed, e.g. '1 mm'``.
        """
        if isinstance(given, str):
            value = _in_si(self, given)
        elif isinstance(given, (int, float)) and not isinstance(given, bool):
            try:
                value = float(given)
            except OverflowError:  # a whole number of more than 308 digits
                value = math.inf
        else:
            raise ValueError(f"is not a number; {self._needed()}")
        if not math.isfinite(value):
            raise ValueError(f"is not finite; {self._needed()}")
        if self.unit in _MEANT and value > self.maximum and not isinstance(given, str):
            unit, name = _MEANT[self.unit]
            raise ValueError(
                f"is read as {value:g} {self.unit}, out of range; allowed: {self.range_text}; write '{value:g} {unit}' "
                f"if {name} are meant"
            )
        if 0.0 < value < self.least:
            raise ValueError(f"is below the minimum; allowed: at least {self.least:g} {self.unit}".rstrip())
        below = value < self.minimum or (self.open_minimum and value == self.minimum)
        if below or value > self.maximum:
            raise ValueError(f"is out of range; allowed: {self.range_text}, e.g. {self.given_example}")
        return 0.0 if abs(value) < _LEAST else value  # round-off of 0, as in a table of a sine: its square may be none

    def _from_text(self, text: str) -> float:
        if _DECIMAL_COMMA.fullmatch(text):
            point = text.strip().replace(",", ".")
            entry = f"'{point}'" if self.unit else point
            raise ValueError(f"has a decimal comma; decimals follow a point: {entry}")
        match = _NUMBER_AND_UNIT.fullmatch(text)
        if match is None:
            what = "a number with a unit" if self.unit else "a number"
            raise ValueError(f"is not {what}; {self._needed()}")
        number, unit_text = float(match[1]), match[2]
        if not unit_text:
            if self.unit:
                raise ValueError(f"has no unit; write {self.given_example}, or without quotes a number in {self.unit}")
            return number
        factor = 1.0 if unit_text == self.unit.replace("*", " ") else FACTORS.get(self.unit, {}).get(unit_text)
        factor = _GAUSSIAN.get(self.name, {}).get(unit_text, factor)
        meant: list[str] = []
        if factor is None and self.unit == TORQUE_UNIT:
            from geometry.table_file import factor_of, units_meant  # local: it needs numpy, most scenes have no torque

            factor = factor_of(unit_text, "Nm")
            meant = units_meant(unit_text, "Nm") or units_meant(unit_text.replace("/", ""), "Nm")
        if factor is not None:
            return factor * number
        unit = _parse_unit(unit_text)
        wanted = registry().parse_units(self.unit)
        if unit is None:
            fitting = [u for u in _COMMON_UNITS if _parse_unit(u).dimensionality == wanted.dimensionality]
            close = get_close_matches(unit_text, fitting, n=len(fitting), cutoff=0.5) if fitting else []
            # one wrong letter, and that not the first, before a letter too many: 'mn' is rather 'mm' than 'm'
            close.sort(key=lambda u: (len(u) != len(unit_text), u[0] != unit_text[0]))
            hint = f"did you mean '{[*meant, *close][0]}'? " if meant or close else ""
            raise ValueError(f"has the unknown unit '{unit_text}'; {hint}{self._needed(unit_given=True)}")
        if unit.dimensionality != wanted.dimensionality:
            what = _names_of_dimensions().get(unit.dimensionality, f"in {unit_text}")
            hint = f"did you mean '{meant[0]}'? " if meant else ""
            raise ValueError(f"is {what}; {hint}{self._needed(unit_given=True)}")
        has_angle = bool(_ANGLE_UNITS & set(unit._units))
        if self.angular and not has_angle:
            raise ValueError(f"has no angle in its unit (turns or radians?); {self._needed()}")
        if has_angle and not self.angular:
            raise ValueError(f"is an angle; {self._needed(unit_given=True)}")
        return float(registry().Quantity(number, unit).to(wanted).magnitude)

    def _needed(self, unit_given: bool = False) -> str:
        if unit_given and not self.unit:
            return f"{self.name} is needed; write it without a unit, e.g. {self.given_example}"
        return f"{self.name} is needed, e.g. {self.given_example}"

    @property
    def given_example(self) -> str:
        """The example as it stands in a scene: with quotes where it has a unit."""
        return f"'{self.example}'" if self.unit else self.example

    @property
    def kind_text(self) -> str:
        name = self.name.removeprefix("an ").removeprefix("a ")
        return f"{name} [{self.unit}]" if self.unit else name

    @property
    def sample(self) -> str | float:
        return self.example if self.unit else float(self.example)

    def needed_for(self, key: str) -> str:
        return f"{self.name} is needed, e.g. {key} = {self.given_example}"

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number: dict[str, Any] = {"type": "number"}
        if self.minimum > -math.inf:
            number["exclusiveMinimum" if self.open_minimum else "minimum"] = self.minimum
        if self.maximum < math.inf:
            number["maximum"] = self.maximum
        if not self.unit:
            return {**number, "examples": [float(self.example)]}
        number["description"] = f"{self.name} in {self.unit}"
        text = {"type": "string", "description": f"{self.name} with its unit", "examples": [self.example]}
        return {"anyOf": [text, number]}


@lru_cache(maxsize=4096)
def _in_si(quantity: Quantity, text: str) -> float:
    """Return the number of a text; the points of a study have most of their entries in common."""
    return quantity._from_text(text)


@lru_cache(maxsize=256)
def _parse_unit(text: str) -> Any:
    """Return pint's unit for a text, or None where there is none."""
    if len(text) > _MAX_UNIT or _UNIT_TEXT.fullmatch(text) is None:
        return None
    # Habits that pint does not know: "g/cm3", "rev/min", "N·m", "Nm" (for pint a measure of yarns).
    text = re.sub(r"([A-Za-z])(-?\d)", r"\1^\2", text).replace("·", "*")
    text = re.sub(r"\brevs?\b", "turn", text)
    text = re.sub(r"\b([mk]?N)m\b", r"\1*m", text)
    try:
        return registry().parse_units(text)
    except Exception:  # pint answers nonsense with errors of many kinds, tokenizer and syntax errors included
        return None


def _positive(name: str, unit: str, example: str, maximum: float = math.inf, angular: bool = False) -> Quantity:
    return Quantity(name, unit, example, 0.0, maximum, open_minimum=True, angular=angular, least=_LEAST)


# Upper bounds only catch slips of unit (a bare 20 for 20 mm): they lie far above any clutch.
Length = Annotated[float, Quantity("a length", "m", "1 mm", 0.0, 10.0, open_minimum=True, least=1e-9)]
LengthOrNone = Annotated[float, Quantity("a length", "m", "1 mm", 0.0, 10.0, least=1e-9)]
Angle = Annotated[float, _positive("an angle", "rad", "3 deg", maximum=2.0 * math.pi, angular=True)]
ReposeAngle = Annotated[float, _positive("an angle", "rad", "34 deg", maximum=0.5 * math.pi, angular=True)]
Speed = Annotated[float, Quantity("an angular speed", "rad/s", "100 rpm", -1e5, 1e5, angular=True)]
Torque = Annotated[float, Quantity("a torque", "N*m", "12 N m", -1e7, 1e7)]
LoadTorque = Annotated[float, Quantity("a torque", "N*m", "2 N m", 0.0, 1e7)]
Mass = Annotated[float, _positive("a mass", "kg", "20 g", maximum=1e3)]
Current = Annotated[float, Quantity("a current", "A", "0.94 A", -1e5, 1e5)]
Resistance = Annotated[float, _positive("a resistance", "ohm", "25.5 ohm", maximum=1e9)]
FieldStrength = Annotated[float, Quantity("a field strength", "A/m", "100 kA/m", -1e8, 1e8)]
Magnetisation = Annotated[float, _positive("a magnetisation", "A/m", "1.3 MA/m", maximum=1e8)]
FluxDensity = Annotated[float, Quantity("a flux density", "T", "1.5 T", 0.0, 100.0)]
Coercivity = Annotated[float, Quantity("a coercivity", "A/m", "150 A/m", 0.0, 1e5)]
CurveFieldStrength = Annotated[float, Quantity("a field strength", "A/m", "1 kA/m", 0.0, 1e9)]
Stiffness = Annotated[float, _positive("a stiffness", "N/m", "10 kN/m", maximum=1e12)]
HertzStiffness = Annotated[float, _positive("a Hertz stiffness", "N/m^1.5", "1e9 N/m^1.5", maximum=1e18)]
Modulus = Annotated[float, _positive("a modulus of elasticity", "Pa", "210 GPa", maximum=1e13)]
Power = Annotated[float, Quantity("a power", "W", "200 W", 0.0, 1e9)]
LinearSpeed = Annotated[float, _positive("a speed", "m/s", "0.5 m/s", maximum=1e4)]
Force = Annotated[float, Quantity("a force", "N", "1 mN", 0.0, 1e6)]
WorkOfAdhesion = Annotated[float, Quantity("a work of adhesion", "J/m^2", "0.05 J/m^2", 0.0, 1e3)]
Time = Annotated[float, _positive("a time", "s", "20 ms", maximum=1e5)]
Instant = Annotated[float, Quantity("a time", "s", "20 ms", 0.0, 1e5)]
Density = Annotated[float, _positive("a density", "kg/m^3", "7700 kg/m^3", maximum=3e4)]
Inertia = Annotated[float, _positive("a moment of inertia", "kg*m^2", "2e-4 kg m^2", maximum=1e6)]
Temperature = Annotated[float, Quantity("a temperature", "degC", "80 degC", -100.0, 250.0)]
Acceleration = Annotated[float, Quantity("an acceleration", "m/s^2", "9.81 m/s^2", 0.0, 1e6)]


def number(example: str, minimum: float = -math.inf, maximum: float = math.inf, *, above: bool = False) -> Quantity:
    """Return the quantity of a pure number within [minimum, maximum]; `above`: the minimum is excluded."""
    return Quantity("a number", "", example, minimum, maximum, open_minimum=above, least=_LEAST if above else 0.0)


def quantity_of(kind: Any) -> Quantity:
    """Return the quantity that an annotated type of this module is marked with, as `Time`."""
    (quantity,) = kind.__metadata__
    return quantity


def unit_of(entry: object, quantity: Quantity) -> tuple[str, float]:
    """Return the unit of an `entry` of a quantity, and a value in it over that in SI; SI's of a number and of 0.

    That of a temperature is degC, as no factor leads to K.
    """
    match = _NUMBER_AND_UNIT.fullmatch(entry) if isinstance(entry, str) else None
    if match is None or not match[2] or float(match[1]) == 0.0 or quantity.unit == "degC":
        return quantity.unit, 1.0
    return match[2], float(match[1]) / quantity.read(entry)


def in_unit_of(entry: object, value: float, quantity: Quantity) -> str:
    """Return a value [SI] of a quantity as text, in the unit of an `entry` of it: 1.234 mm where that is '0.5 mm'."""
    unit, factor = unit_of(entry, quantity)
    return f"{factor * value:.4g} {unit}".rstrip()


def format_number(value: float) -> str:
    """A number of which no more is known: 270, 4400, 0.0093, 1.9e-06."""
    return f"{float(f'{value:.2g}'):g}"
