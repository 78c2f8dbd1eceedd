"""Heat of the coil's copper, and the steady temperature rise of the device.

Copper loss P = R I^2 leaves through the housing's surface S by still air and radiation, Delta T = P/(alpha S), with
alpha = 12 W/(m^2 K): natural convection of about 6, and radiation of painted steel, 4 epsilon sigma T^3 = 6 at 320 K. A
turning rotor fans itself and a flange carries heat off: half of Delta T is possible; the winding inside is hotter.
Until then the copper alone takes what it makes, dT/dt = rho J^2/(c rho_m).

In steady operation the slip power P_s warms the housing too, and R = R_20 (1 + a Delta T) grows (`field.coil.winding`):

    S (h (T - T_0) + epsilon sigma (T^4 - T_0^4)) = P_s + R I^2

with h and epsilon as of [effects.heat] by default. At a given voltage I goes as 1/R, and with it P_s: the torque is
taken in proportion to the current (it goes with I to I^2, by how far the iron is saturated). Where no T up to `HOTTEST`
satisfies it, the winding runs away.
"""

from __future__ import annotations

from math import inf

from emclutch.device_model.decision import Decision
from emclutch.device_model.excitation import Excitation
from emclutch.scene.units import format_number
from field.coil.winding import ROOM, resistance_ratio

COOLING = 12.0
"""alpha [W/(m^2 K)] of still air and radiation."""

COPPER_HEAT = 385.0
"""Specific heat of copper [J/(kg K)]."""

WARM = 100.0
"""Rise [K] that enamelled wire of class F stands above a room of 40 degrees C (IEC 60085: 155 degrees C, a hot spot of
15 K)."""

CONVECTION, EMISSIVITY = 6.0, 0.9
"""Heat transfer coefficient of still air [W/(m^2 K)], and emissivity of paint: defaults of [effects.heat]."""

HOTTEST = 250.0
"""Mean temperature of the winding [degrees C] up to which copper's linear law holds; beyond, it counts as run away."""

ABSURD = 1000.0
"""Rise [K] near which copper melts."""


def copper_loss(scene, coil: Excitation, shape) -> float:
    """Return the copper loss at the largest current and the temperature of the winding in the scene [W]."""
    return scene.coil.resistance_in(shape.coil_area, shape.coil_mean_radius) * coil.largest_current**2


def steady_rise(surface: float, slip_power: float, cold_loss: float, at_voltage: bool) -> float:
    """Return the rise of the housing above the room in steady operation [K]; infinite where the winding runs away.

    Parameters
    ----------
    surface : float
        S [m^2].
    slip_power, cold_loss : float
        [W], with the winding at the temperature of the room.
    at_voltage : bool
        Whether a given voltage drives the coil, whose current falls as it warms, and the torque with it.
    """
    from scipy.optimize import brentq  # local: a scene is read without solvers

    from field.heat.conduction import KELVIN, STEFAN_BOLTZMANN

    room = ROOM + KELVIN

    def left(rise: float) -> float:
        ratio = resistance_ratio(ROOM + rise)
        radiated = EMISSIVITY * STEFAN_BOLTZMANN * ((room + rise) ** 4 - room**4)
        power = (slip_power + cold_loss) / ratio if at_voltage else slip_power + cold_loss * ratio
        return surface * (CONVECTION * rise + radiated) - power

    most = HOTTEST - ROOM
    if left(most) < 0.0:
        return inf
    return float(brentq(left, 0.0, most)) if slip_power + cold_loss > 0.0 else 0.0


def housing_rise(scene, coil: Excitation | None, shape, slip_power: float) -> float | None:
    """Return `steady_rise` of a device by a slip power [W] and its copper loss; None where its surface is unknown."""
    surface = scene.geometry.cooled_surface(shape)
    if surface is None:
        return None
    if coil is None:
        return steady_rise(surface, slip_power, 0.0, False)
    loss, ratio = copper_loss(scene, coil, shape), resistance_ratio(scene.coil.temperature)
    if scene.coil.is_at_voltage:
        return steady_rise(surface, slip_power * ratio, loss * ratio, True)  # V^2/R, and a torque as V/R
    return steady_rise(surface, slip_power, loss / ratio, False)  # R I^2


def winding_in_words(scene) -> str:
    """Turns, bare wire, its fill and resistance of a scene's winding; current density and loss at its largest current.

    A resistance beside the turns that is below that of a window full of copper is said to be so.
    """
    coil, shape = scene.coil, scene.shape()
    window = shape.coil_area, shape.coil_mean_radius
    winding, current, R = coil.winding_in(*window), coil.currents_in(*window).largest, coil.resistance_in(*window)
    text = ""
    if winding.resistance > 1.001 * R:
        text = f"; more copper than fits: {winding.turns:.0f} turns have at least {winding.resistance:.3g} ohm"
    return (
        f"{winding.turns:.0f} turns of {1e3 * winding.wire_diameter:.3g} mm copper wire (copper fills "
        f"{100.0 * winding.fill_factor:.3g} % of the window), {R:.3g} ohm at "
        f"{coil.temperature:g} °C; at {current:.3g} A {1e-6 * winding.current_density(current):.3g} A/mm^2 and "
        f"{R * current**2:.3g} W{text}"
    )


def coil_heat_in_words(scene, coil: Excitation, shape) -> str:
    """Current density, copper loss and what it heats, at the largest current."""
    current, winding = coil.largest_current, coil.winding
    if current == 0.0:
        return "none: the current is 0 A"
    loss = copper_loss(scene, coil, shape)
    rate = loss / (winding.copper_mass * COPPER_HEAT)
    text = f"{1e-6 * winding.current_density(current):.3g} A/mm², {loss:.3g} W"
    surface = scene.geometry.cooled_surface(shape)
    if surface is None:
        return f"{text}; the copper alone warms by {format_number(rate)} K/s"
    rise = loss / (COOLING * surface)
    text += f"; steady temperature without slip: {format_number(rise)} K above the room "
    text += f"({COOLING:g} W/(m² K) on {1e4 * surface:.3g} cm²)"
    if rise > ABSURD:
        return Decision(text, "the copper would melt. Are current, turns and window in the units that were meant?")
    J = 1e-6 * winding.current_density(current)
    hot = (
        f"the coil is overloaded at {current:.3g} A ({J:.3g} A/mm²). Its copper warms by {format_number(rate)} K/s at "
        f"first, and would end {format_number(rise)} K above room temperature. Use this current only briefly"
    )
    return Decision(text, hot if rise > WARM else "")
