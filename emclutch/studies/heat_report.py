"""The report on a thermal study: limits and when they are passed, temperatures, permitted slip power, heat flows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas

from emclutch.device_model.coil_heat import HOTTEST
from emclutch.results.quantity import RPM
from emclutch.results.report.report import Mark, Picture, Report, Shown, Statement, Statements, Table, note, warning
from emclutch.results.text import format_duration, in_words

PLACES = {"coil_hottest": "coil", "powder_hottest": "powder", "surface": "surface"}
WEAKER = {"low": "weaker", "high": "stronger"}
"""Powder whose torque is an end of the 95 % interval: a weaker one needs more current for a slip power."""
NEGLIGIBLE = 1.0
"""Error of the mesh [K] that is not printed."""
PERMITTED = {
    "by_surface": "limited by surface [W]",
    "by_coil": "limited by coil [W]",
    "by_powder": "limited by powder [W]",
    "slip_power": "permitted slip power [W]",
    "torque": "torque at that power [N m]",
    "current": "current of that power [A]",
}


def heat_report(folder: Path, summary: dict[str, Any], permitted: pandas.DataFrame) -> Report:
    """Return the report on ``heat.json`` and ``permitted.csv``."""
    data = summary | {"permitted": permitted.to_dict("records"), "folder": str(folder)}
    report = Report(f"Temperatures: {folder.name}", data=data, folder=folder)
    report.add("Result", Statements([*_limits(summary), *_permitted_at_the_duty(summary, permitted),
                                     *_remarks(summary, permitted)]), Shown.TERMINAL)  # fmt: skip
    report.add("Temperatures", _temperatures(summary), Shown.TERMINAL)
    report.add("Permitted slip power", _permitted(permitted), Shown.TERMINAL)
    pictures = [Picture(in_words(one.stem), one) for one in sorted(folder.glob("*.png"))]
    return report.add("Pictures", pictures, Shown.PAGE)


def _temperatures(summary: dict[str, Any]) -> Table:
    """Return the temperatures of the steady state and through the duty."""
    steady, duty = summary["steady"], summary["duty"]
    rows = [("steady, on all the time", steady)] if "surface" in steady else []
    rows += [(f"steady, {WEAKER[end]} powder", row) for end, row in summary["steady_at_the_ends"].items()]
    ends = (f"end of the duty, {format_duration(duty['end'])}", "last"), ("maximum over the duty", "largest")
    for words, prefix in ends["ripple" in duty :]:  # the end of an averaged duty is a maximum too
        rows.append((words, {key: duty[f"{prefix}_{key}"] for key in (*PLACES, "surface_part")}))
    if duty.get("steady"):
        rows.append(("maximum, duty repeated for ever", duty["steady"]))
    shown = {"surface": "{surface:.1f} ({surface_part})"}
    table = [(words, *(shown.get(key, f"{{{key}:.1f}}").format(**row) if key in row else "none" for key in PLACES))
             for words, row in rows]  # fmt: skip
    return Table(table, ("temperature [°C]", *(f"{name}, hottest" for name in PLACES.values())), (1, 2, 3))


def _permitted(permitted: pandas.DataFrame) -> Table:
    table = [(f"{RPM * row['speed']:.0f}", *(f"{row[key]:.3g}" for key in PERMITTED if key in row))
             for row in permitted.to_dict("records")]  # fmt: skip
    head = ("slip [rpm]", *(words for key, words in PERMITTED.items() if key in permitted))
    return Table(table, head, range(len(head)))


def _limits(summary: dict[str, Any]) -> Iterator[Statement]:
    """Say whether the duty passes the limits of surface and coil, and when, or would if it went on for ever."""
    duty, limits = summary["duty"], summary["limits"]
    passed = {key: after for key in limits if (after := duty[f"{key}_limit_passed_after"]) is not None}
    for key, after in passed.items():
        limit = f"its limit of {limits[key]:g} °C"
        yield warning(f"the {PLACES[key]} exceeds {limit} after {format_duration(after)} of the duty")
    if not passed:
        places, given = _joined(PLACES[key] for key in limits), _joined(f"{limit:g} °C" for limit in limits.values())
        yield Statement(Mark.GOOD, f"{places.capitalize()} stay below their limits ({given}) through the duty.")
    if duty.get("steady", {}) is None:
        yield warning(f"if the duty went on for ever, the winding would exceed {HOTTEST:g} °C")
    for_ever = duty.get("steady") or (summary["steady"] if summary["on_all_the_time"] else {})
    for key, limit in limits.items():
        if key not in passed and for_ever.get(key, limit) > limit:
            text = f"if the duty went on for ever, the {PLACES[key]} would reach {for_ever[key]:.0f} °C"
            yield warning(f"{text}, above its limit of {limit:g} °C")


def _permitted_at_the_duty(summary: dict[str, Any], permitted: pandas.DataFrame) -> Iterator[Statement]:
    """Say the slip power that is permitted all the time at the largest slip of the duty, and which limit it meets."""
    if not summary["slip"]:
        return
    row = permitted.loc[(permitted["speed"] - summary["slip"]).abs().idxmin()]
    powers = {row[f"by_{PLACES[key]}"]: PLACES[key] for key in summary["limits"]}
    limit, largest = powers[min(powers)], summary["largest_current"]
    if len(powers) == 1 and "current" in row:
        limit = "the largest current"
    at = f"Permitted steady slip power at {RPM * summary['slip']:.4g} rpm"
    if row["slip_power"] > 0.0:
        full = f"with the coil at its full {'current' if summary['voltage'] is None else 'voltage'}"
        drive = f"at {row['current']:.3g} A" if "current" in row else full
        ends = [f"{largest[key]:.3g}" for key in ("with_slip_high", "with_slip_low") if key in largest]
        interval = f" (95 %: {' to '.join(ends)} A)" if ends else ""
        yield note(f"{at}: {row['slip_power']:.3g} W {drive}{interval}. Limited by: {limit}.")
    else:
        yield warning(f"{at}: 0 W. The copper loss alone brings the {limit} to its limit. Lower the current")


def _remarks(summary: dict[str, Any], permitted: pandas.DataFrame) -> Iterator[Statement]:
    """Say the torque, the heat flows, the largest currents and the errors."""
    steady, duty, torque, largest = summary["steady"], summary["duty"], summary["torque"], summary["largest_current"]
    yield Statement(
        Mark.WARNING if torque.get("is_guess") else Mark.NOTE,
        f"Torque at {torque['current']:.3g} A and {torque['temperature']:g} °C by {torque['source']}: "
        f"{torque.get('words') or format(torque['value'], '.3g') + ' N m'}.",
    )
    if "needed_torque" in torque:
        needed, given = torque["needed_torque"], torque["needed_torque"] * summary["slip"]
        yield note(f"The slip power of {given:.4g} W at {RPM * summary['slip']:.4g} rpm needs {needed:.3g} N m: "
                   f"{torque['needed_current']:.3g} A with the powder at {torque['temperature']:g} °C, by "
                   f"{torque['at_other_currents']}.")  # fmt: skip
        if steady.get("torque", needed) < 0.999 * needed:
            yield warning(f"the warm device transmits only {steady['torque']:.3g} N m at its largest current: "
                          f"{steady['slip_power']:.3g} W of slip")  # fmt: skip
    elif "full_current" in torque:
        yield note(torque["full_current"])
    limits, default = summary["limits"], summary["default_limits"]
    known = (f"{PLACES[key]} {limit:g} °C{' (default)' * (key in default)}" for key, limit in limits.items())
    unknown = "" if "powder_hottest" in limits else " No limit of the powder is given (effects.heat.powder_limit)."
    yield note(f"Temperature limits: {_joined(known)}.{unknown}")
    cooling = summary["cooling"]
    yield note(f"Cooling, the largest uncertainty: convection {cooling['convection']:.3g} W/(m^2 K), emissivity "
               f"{cooling['emissivity']:.3g}, shaft {cooling['shaft_conductance']:.3g} W/K. Vary "
               "effects.heat.convection.")  # fmt: skip
    others = torque["at_other_currents"], torque["at_other_temperatures"]
    friction = " The friction of the powder is taken as constant with temperature." * ("the law" in others[1])
    if others[0] == others[1] == torque["source"]:
        if friction:
            yield note(friction.strip())
    elif others[0] == others[1]:
        yield note(f"At other currents and temperatures of the powder: {others[0]}.{friction}")
    else:
        yield note(f"At other currents: {others[0]}. At other temperatures of the powder: {others[1]}.{friction}")
    if "surface" in steady:
        flows = {key.removeprefix("heat_out_"): heat for key, heat in steady.items() if key.startswith("heat_out_")}
        out = ", ".join(f"{in_words(name)} {heat:.3g} W" for name, heat in flows.items())
        copper, slip = f"{steady['copper_loss']:.3g} W of the coil", f"{steady['slip_power']:.3g} W of slip"
        drive = f"{steady['current']:.3g} A"
        if summary["voltage"] is not None:
            drive = f"{summary['voltage']:.3g} V ({drive} through the warm coil)"
        at = f"{drive} with {steady['torque']:.3g} N m, powder at {steady['powder_mean']:.0f} °C"
        yield note(f"Steady state at {at}: {copper} and {slip} flow out through {out}.")
        supply, needed = summary["supply_voltage"], steady["copper_loss"] / (abs(steady["current"]) or math.inf)
        if supply is not None and needed > supply:
            yield warning(f"{drive} through the warm coil needs {needed:.3g} V, more than coil.voltage = {supply:.3g} "
                          "V gives. To compute with this voltage: --set coil.current=none")  # fmt: skip
    else:
        yield warning(steady["state"])
        yield note(f"Without slip a steady state exists up to {largest['at_a_mean_of_250_degrees']:.3g} A. Lower "
                   "current or slip power, cool better, or shorten the duty.")  # fmt: skip
    yield note(f"Duty: {duty['state']} ({duty['steps']} steps).")
    if "ripple" in duty:
        yield note(averaging_in_words(duty))
    elif duty.get("steady"):
        yield note(f"Error of the maximum of the duty repeated for ever: {duty['error_of_the_mean']:.1g} K.")
    elif duty.get("steady") == {}:
        yield note("The state of the duty repeated for ever is not found: raise effects.heat.duty.end.")
    if not permitted[["rotor_speed", "disc_speed"]].to_numpy().any():
        yield note("The permitted slip power is that of bodies cooled as at rest: neither turns in [motion].")
    yield note(f"Without slip the coil reaches its limit at {largest['at_the_coil_limit']:.3g} A. A steady state below "
               f"{HOTTEST:g} °C exists up to {largest['at_a_mean_of_250_degrees']:.3g} A.")  # fmt: skip
    error = summary["error_of_the_mesh"]
    if isinstance(error, dict) and (worst := max(map(abs, error.values()))) > NEGLIGIBLE:
        yield note(f"Error of the mesh in the steady state: {worst:.2g} K.")


def _joined(words: Iterable[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} and {last}"


def averaging_in_words(duty: dict[str, Any]) -> str:
    """Say how a duty of many periods was computed, its ripple and the error of its mean."""
    sizes = ", ".join(f"{name} {duty['ripple'][key]:.2g} K" for key, name in PLACES.items())
    error = duty["error_of_the_mean"]
    known = "not known, as the mean power has no steady temperatures" if error is None else f"{error:.1g} K"
    return (
        f"The {duty['averaged_periods']:.0f} periods of the duty are averaged: mean power in long steps, one period "
        f"resolved. Ripple from smallest to largest: {sizes}. Error of the mean by the ripple: {known}. "
        "Current, torque and powers in heat.csv are means over a period."
    )
