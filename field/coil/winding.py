"""The winding of a coil: turns, wire, resistance and copper loss.

N turns of mean length 2 pi r share a window of area A with a copper fill factor f:

    R = rho(T) N^2 2 pi r/(f A),      rho(T) = rho_20 (1 + alpha (T - 20 deg C)),      P = R I^2,

valid for a layer winding whose turns share the mean radius and carry direct current (no skin effect).
Source of rho_20 and alpha: IEC 60028, annealed copper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

COPPER_RESISTIVITY = 1.72e-8
"""Resistivity of annealed copper at 20 degrees C [ohm m] (IEC 60028: 1.7241e-8, rounded)."""

COPPER_TEMPERATURE_COEFFICIENT = 3.93e-3
"""Relative growth of copper's resistivity per kelvin at 20 degrees C [1/K] (IEC 60028)."""

COPPER_DENSITY = 8890.0
"""[kg/m^3] (IEC 60028)."""

ROOM = 20.0
"""Temperature [degrees C] that resistances are given at."""


def copper_resistivity(temperature: float = ROOM) -> float:
    """rho [ohm m] at a temperature [degrees C], -100 to 250."""
    _check_temperature(temperature)
    return COPPER_RESISTIVITY * resistance_ratio(temperature)


def resistance_ratio(temperature: float) -> float:
    """R(T)/R(20 degrees C) of copper [-]."""
    _check_temperature(temperature)
    return 1.0 + COPPER_TEMPERATURE_COEFFICIENT * (temperature - ROOM)


def _check_temperature(temperature: float) -> None:
    if not -100.0 <= temperature <= 250.0:
        raise ValueError(
            f"`temperature` = {temperature:g} degrees C of the winding; copper's linear law holds from -100 to 250"
        )


@dataclass(frozen=True, slots=True)
class Winding:
    """A coil of copper wire in its window.

    Parameters
    ----------
    turns : float
        N [-].
    window_area : float
        A of the winding's section [m^2].
    mean_radius : float
        r of a mean turn [m].
    fill_factor : float
        f, copper's fraction of the window [-], 0 to 1.
    temperature : float
        Of the copper [degrees C].
    """

    turns: float
    window_area: float
    mean_radius: float
    fill_factor: float = 0.6
    temperature: float = ROOM

    def __post_init__(self) -> None:
        for name, unit in (("turns", ""), ("window_area", " m^2"), ("mean_radius", " m"), ("fill_factor", "")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"`{name}` = {value}{unit} of the winding must be a finite number above 0")
        if self.fill_factor > 1.0:
            raise ValueError(f"`fill_factor` = {self.fill_factor} of the winding must be at most 1; wire: 0.4 to 0.7")
        _check_temperature(self.temperature)

    @classmethod
    def of_resistance(
        cls, resistance: float, window_area: float, mean_radius: float, fill_factor: float = 0.6
    ) -> Winding:
        """The winding that fills the window and has this resistance [ohm] at 20 degrees C: N^2 = R f A/(rho 2 pi r)."""
        if not (math.isfinite(resistance) and resistance > 0.0):
            raise ValueError(f"`resistance` = {resistance} ohm of the winding must be a finite number above 0")
        turns = math.sqrt(resistance * fill_factor * window_area / (COPPER_RESISTIVITY * 2.0 * math.pi * mean_radius))
        return cls(turns, window_area, mean_radius, fill_factor)

    @property
    def mean_turn_length(self) -> float:
        """[m]"""
        return 2.0 * math.pi * self.mean_radius

    @property
    def wire_section(self) -> float:
        """Copper section of the wire [m^2]."""
        return self.fill_factor * self.window_area / self.turns

    @property
    def wire_diameter(self) -> float:
        """Diameter of a round wire of that section, without its insulation [m]."""
        return math.sqrt(4.0 * self.wire_section / math.pi)

    @property
    def copper_mass(self) -> float:
        """[kg]"""
        return COPPER_DENSITY * self.turns * self.mean_turn_length * self.wire_section

    @property
    def resistance(self) -> float:
        """R at the winding's temperature [ohm]."""
        return copper_resistivity(self.temperature) * self.turns * self.mean_turn_length / self.wire_section

    def copper_loss(self, current: float) -> float:
        """R I^2 [W] at a current [A]."""
        return self.resistance * current**2

    def current_density(self, current: float) -> float:
        """In the copper [A/m^2], at a current [A]; 3e6 to 6e6 is usual without forced cooling."""
        return current / self.wire_section
