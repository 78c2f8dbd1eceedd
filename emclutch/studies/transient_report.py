"""The report on the coil alone in time: rise times, energies, the winding's warming, what was taken."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from emclutch.results.report.report import (
    Mark,
    Picture,
    Report,
    Shown,
    Statement,
    Statements,
    Table,
    note,
    warning,
)
from emclutch.results.text import format_percent, format_time, in_words
from emclutch.studies.field_report import in_cells

QUANTITIES = {"current": ("Current", "A"), "gap_flux_density": ("Flux density in the gap", "T")}
ENERGIES = {
    "supplied_energy": "supplied",
    "copper_heat": "heat of the copper",
    "eddy_heat": "heat of eddy currents",
    "field_energy": "in the field at the end",
}
FAR = 0.05
"""Distance from the final value, relative to the largest, that is worth a warning."""


def transient_report(folder: Path, summary: dict[str, Any]) -> Report:
    """Return the report on ``transient.json``."""
    report = Report(f"Coil in time: {folder.name}", data=summary, folder=folder)
    report.add("Result", Statements([*_statements(summary)]), Shown.TERMINAL)
    report.add("Energy", _energy(summary), Shown.TERMINAL)
    units = summary["units"]
    rows = [(f"{in_words(name)} [{units[name]}]", in_cells(value)) for name, value in summary["at_end"].items()]
    report.add("At the end", Table(rows), Shown.PAGE)
    report.add("Materials", Table([*summary.get("materials", {}).items()], ("region", "material")), Shown.PAGE)
    pictures = [Picture(in_words(one.stem), one) for one in sorted(folder.glob("*.png"), reverse=True)]
    return report.add("Pictures", pictures, Shown.PAGE)


def _statements(summary: dict[str, Any]) -> Iterator[Statement]:
    since, at_end = summary["changes_at"], summary["at_end"]
    for name, (words, unit) in QUANTITIES.items():
        if name in summary["final"]:
            yield _rise(summary, name, words, unit)
    if since > 0.0:
        which = "last" if at_end["voltage"] == 0.0 else "first"
        yield note(f"These times count from {format_time(since)}, the {which} change of the voltage.")
    if summary.get("current_rise_time_sheared") is not None:
        both = [f"{words.lower()} {_times(summary, name, '_sheared')}" for name, (words, _) in QUANTITIES.items()
                if name in summary["final"]]  # fmt: skip
        yield note(f"With the permeability of sheared powder: {'; '.join(both)}.")
    if summary["powder"] is not None:
        yield note(f"Powder: {summary['powder'].rstrip('.')}.")
    if (error := summary["rise_time_error"]) is not None:
        steps, tolerance = summary["steps"], summary["tolerance"]
        yield note(
            f"Error of these times by the {steps} time steps (tolerance {tolerance:g}): {format_percent(error)}."
        )
    if errors := summary["error_of_the_mesh"]:
        worst = max(errors, key=lambda name: abs(errors[name]))
        yield note(f"Estimated error of the mesh: {format_percent(abs(errors[worst]))} ({worst}).")
    (cold, warm), temperature = summary["resistance"], at_end["winding_temperature"]
    grown = "" if warm < 1.001 * cold else f"; its resistance grows from {cold:.4g} to {warm:.4g} ohm"
    yield note(f"Winding: {temperature:.3g} °C at the end if the copper keeps its heat{grown}.")
    if summary["eddy_currents"]:
        shielded = "Eddy currents shield the steel at first, so that the inductance is smaller"
        yield note(f"{shielded}: the current rises sooner than without them, the flux in the gap later.")
    else:
        yield note("Eddy currents are left out. [effects.eddy_currents] adds them.")
    if summary["default_circuit"]:
        unused = ". coil.current is not used" if summary["current_given"] else ""
        yield note(f"coil.voltage is applied from t = 0{unused}.")
    if summary["distance"] > FAR:
        far, end = format_percent(summary["distance"]), format_time(at_end["time"])
        yield warning(f"At the end, {end}, the coil is {far} from its final state; take a later --end")
    yield from map(warning, summary["warnings"])


def _rise(summary: dict[str, Any], name: str, words: str, unit: str) -> Statement:
    final = f"{summary['final'][name]:.4g} {unit}"
    if summary[f"{name}_rise_time"] is None:
        return note(f"{words}: {summary['at_end'][name]:.4g} {unit} at the end, goes to {final}.")
    return Statement(Mark.GOOD, f"{words} to {final}: {_times(summary, name, of=' of the change')}.")


def _times(summary: dict[str, Any], name: str, powder: str = "", of: str = "") -> str:
    early, late = (summary[f"{name}_rise_time{suffix}{powder}"] for suffix in ("", "_90"))
    if early is None:
        return "not 63 % by the end"
    return f"63 %{of} after {format_time(early)}, {'not 90 %' if late is None else f'90 % after {format_time(late)}'}"


def _energy(summary: dict[str, Any]) -> Table:
    """Return the balance of the energies; nothing moves, so that no work is done."""
    rows = [(words, f"{summary['at_end'][name]:.4g}") for name, words in ENERGIES.items()]
    if first := summary["first_field_energy"]:
        rows.insert(0, ("in the field at the start", f"{first:.4g}"))
    left = f"{summary['residual']:.2g} ({format_percent(summary['relative_residual'])})"
    return Table([*rows, ("residual: supplied minus the rest", left)], ("energy", "[J]"), (1,))
