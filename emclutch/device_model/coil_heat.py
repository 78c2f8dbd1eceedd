"""Heat of the coil's copper, and the steady temperature rise of the device.

Copper loss P = R I^2 leaves through the housing's surface S by still air and radiation, Delta T = P/(alpha S), with
alpha = 12 W/(m^2 K): natural convection of about 6, and radiation of painted steel, 4 epsilon sigma T^3 = 6 at 320 K. A
turning rotor fans itself and a flange carries heat off: half of Delta T is possible; the winding inside is hotter.
Until then the copper alone takes what it makes, dT/dt = rho J^2/(c rho_m).
"""

from __future__ import annotations

from emclutch.device_model.excitation import Excitation
from emclutch.device_model.warning_text import with_warnings
from emclutch.scene.units import two_digits

COOLING = 12.0
"""alpha [W/(m^2 K)] of still air and radiation."""

COPPER_HEAT = 385.0
"""Specific heat of copper [J/(kg K)]."""

WARM = 100.0
"""Rise [K] that enamelled wire of class F stands above a room of 40 degrees C (IEC 60085: 155 degrees C, a hot spot of
15 K)."""

ABSURD = 1000.0
"""Rise [K] near which copper melts."""


def coil_heat_in_words(scene, coil: Excitation, shape) -> str:
    """Current density, copper loss and what it heats, at the largest current."""
    current, winding = coil.largest_current, coil.winding
    if current == 0.0:
        return "none: the current is 0 A"
    loss = scene.coil.resistance_in(shape.coil_area, shape.coil_mean_radius) * current**2
    rate = loss / (winding.copper_mass * COPPER_HEAT)
    text = f"{1e-6 * winding.current_density(current):.3g} A/mm^2, {loss:.3g} W"
    surface = scene.geometry.cooled_surface(shape)
    if surface is None:
        return f"{text}; the copper alone warms by {two_digits(rate)} K/s"
    rise = loss / (COOLING * surface)
    text += f": in the end {two_digits(rise)} K above the room, if {COOLING:g} W/(m^2 K) cool the housing's "
    text += f"{1e4 * surface:.3g} cm^2"
    if rise > ABSURD:
        return with_warnings(text, "copper melts; are current, turns and window in the units that were meant?")
    if rise > WARM:
        text += f"; for short duty only: the copper warms by {two_digits(rate)} K/s at first"
    return text
