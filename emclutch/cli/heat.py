"""`emclutch heat`: its results in tables and sentences."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from emclutch.results.pictures.figure import RPM
from emclutch.results.text import format_duration
from emclutch.scene.units import Quantity
from emclutch.studies.heat import HOTTEST, HeatResult

SLIP_SPEED = Quantity("an angular speed", "rad/s", "100 rpm", 0.0, 1e5, open_minimum=True, angular=True)
RIPPLE_NAMES = {"coil_hottest": "coil", "powder_hottest": "powder", "surface": "surface"}


def as_data(found: HeatResult) -> dict[str, Any]:
    """For a machine: heat.json and the rows of permitted.csv."""
    return found.summary | {"permitted": found.permitted.to_dict("records"), "folder": str(found.folder)}


def tables_of(found: HeatResult) -> list[Table]:
    """Temperatures in the steady state and through the duty, and the permitted slip power."""
    steady, duty = found.summary["steady"], found.summary["duty"]
    temperatures = Table("temperature [°C]", "coil, hottest", "powder, hottest", "surface, hottest")
    keys = ("coil_hottest", "powder_hottest", "surface")
    if "surface" in steady:
        temperatures.add_row("steady, on all the time", *(f"{steady[key]:.1f}" for key in keys))
    temperatures.add_row("maximum over the duty cycle", *(f"{duty[f'largest_{key}']:.1f}" for key in keys))
    if duty.get("steady"):
        temperatures.add_row("maximum, duty cycle repeated for ever", *(f"{duty['steady'][key]:.1f}" for key in keys))
    limits = "limit by surface [W]", "limit by coil [W]", "permitted slip power [W]"
    permitted = Table("slip [1/min]", *limits, "torque [N m]")
    for row in found.permitted.to_dict("records"):
        shown = (row["by_surface"], row["by_coil"], row["slip_power"], row["torque"])
        permitted.add_row(f"{RPM * row['speed']:.0f}", *(f"{value:.3g}" for value in shown))
    return [temperatures, permitted]


def in_words(found: HeatResult) -> list[str]:
    """The heat's ways, when limits are passed, and what runs away."""
    summary, steady, duty = found.summary, found.summary["steady"], found.summary["duty"]
    lines = []
    torque = summary["torque"]
    value = f"{torque['value']:.3g} N m; " if "value" in torque else ""
    lines.append(f"torque: {value}{torque['source']}")
    if "surface" in steady:
        ways = ", ".join(
            f"{key.removeprefix('heat_out_').replace('_', ' ')} {heat:.3g} W"
            for key, heat in steady.items()
            if key.startswith("heat_out_")
        )
        lines.append(
            f"steady: {steady['copper_loss']:.3g} W of the coil at {steady['current']:.3g} A, "
            f"{steady['slip_power']:.3g} W of slip; out through {ways}"
        )
    else:
        limit = summary["largest_current"]["at_a_mean_of_250_degrees"]
        lines.append(
            f"{steady['state']} (thermal runaway, or above the range of copper's linear law); "
            f"without slip it stays below that up to {limit:.3g} A: lower the current or the slip power, cool "
            "better, or shorten the duty"
        )
    lines.append(
        f"duty: {duty['state']}, {duty['steps']} steps; residual of the energy balance {abs(duty['energy_error']):.1e}"
    )
    if "heat_error" in duty:
        lines[-1] += f"; heat made, relative to the integral of the duty's power: {duty['heat_error']:+.1e}"
    if "ripple" in duty:
        lines.append(averaging_in_words(duty))
    for key, name in (("surface", "surface"), ("coil_hottest", "coil")):
        passed = duty[f"{key}_limit_passed_after"]
        if passed is not None:
            lines.append(f"WARNING: the {name} exceeds its limit after {format_duration(passed)}")
    if not found.permitted[["rotor_speed", "disc_speed"]].to_numpy().any():
        lines.append("permitted slip power: neither body turns in [motion], so both are cooled as at rest")
    largest = summary["largest_current"]
    lines.append(
        f"largest current without slip: {largest['at_the_coil_limit']:.3g} A at the coil's limit, "
        f"{largest['at_a_mean_of_250_degrees']:.3g} A with a steady state below {HOTTEST:g} °C"
    )
    error = summary["error_of_the_mesh"]
    if isinstance(error, dict):
        lines.append(f"error of the mesh, steady: {max(map(abs, error.values())):.2g} K")
    return lines


def averaging_in_words(duty: dict[str, Any]) -> str:
    """How a duty of many periods was computed, its ripple and the error of its mean."""
    sizes = ", ".join(f"{name} {duty['ripple'][key]:.2g} K" for key, name in RIPPLE_NAMES.items())
    error = duty["error_of_the_mean"]
    known = "not known, as the mean power has no steady temperatures" if error is None else f"{error:.1g} K"
    return (
        f"averaged: the mean power of a period in steps over many of {duty['averaged_periods']:.0f} periods, and the "
        f"ripple of one period resolved ({sizes} from smallest to largest); error of the mean by the ripple: {known}"
    )
