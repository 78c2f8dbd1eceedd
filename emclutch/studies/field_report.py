"""The report on a field study: gap field and inductance, a row a current, magnetic circuit, forces, winding, solver."""

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
    sentence,
    warning,
)
from emclutch.results.text import format_percent, in_words

HEADS = (
    ("current", "I"),
    ("gap_flux_density", "B gap"),
    ("flux_linkage", "linkage"),
    ("apparent_inductance", "L"),
    ("incremental_inductance", "incremental L"),
    ("copper_loss", "copper loss"),
    ("energy", "energy"),
    ("coenergy", "co-energy"),
    ("hysteresis_loss", "hysteresis loss"),
)
"""Columns of field.csv that the terminal shows, and how they are headed there; axial forces besides."""
FORCE = "axial_force_"
REASONS = ("not_defined", "no_virtual_work", "error_estimate_of_two_shells")
"""Entries of a body's force that say why a value is missing."""
SOLVER = ("unknowns", "triangles", "tetrahedra", "order", "solver", "newton residuals")
"""Details of the solution that the page shows, but not the terminal."""
AMPERE_TURNS = (
    "ampere-turns of a part: the integral of H·B over the part, divided by the flux of the coil. Their sum is N I. The "
    "flux through air and coil is leakage"
)


def field_report(folder: Path, summary: dict[str, Any]) -> Report:
    """Return the report on ``field.json``."""
    report = Report(f"Field: {folder.name}", data=summary, folder=folder)
    report.add("Result", Statements([*_statements(summary)]), Shown.TERMINAL)
    report.add("Currents", _currents(summary), Shown.TERMINAL)
    if parts := summary["at_last_current"].get("ampere_turns_by_part"):
        whole = sum(parts.values())
        table = [(in_words(name), f"{one:.4g}", format_percent(one / whole)) for name, one in parts.items()]
        drops = Table(table, ("part", "ampere-turns [A]", "fraction"), (1, 2))
        report.add("Magnetic circuit", [drops, Statements([note(sentence(AMPERE_TURNS))])], Shown.TERMINAL)
    if forces := summary["at_last_current"].get("axial_force"):
        report.add("Axial forces", _forces(forces), Shown.TERMINAL)
    details = [*_details(summary)]
    report.add("At the last current", Table([row for row in details if row[0] not in SOLVER]), Shown.TERMINAL)
    report.add("Solver", Table([row for row in details if row[0] in SOLVER]), Shown.PAGE)
    report.add("Materials", Table([*summary.get("materials", {}).items()], ("region", "material")), Shown.PAGE)
    pictures = [Picture(in_words(one.stem), one) for one in sorted(folder.glob("*.png"))]
    return report.add("Pictures", pictures, Shown.PAGE)


def _statements(summary: dict[str, Any]) -> Iterator[Statement]:
    """Say the field of the gap and the inductance at the last current, and the error of the mesh."""
    last, details = summary["currents"][-1], summary["at_last_current"]
    at = f"at {last['current']:.4g} A"
    if (B := last.get("gap_flux_density")) is not None:
        sheared = details.get("gap_flux_density_sheared")
        more = "" if sheared is None else f", powder spread evenly ({sheared:.3g} T sheared, as in operation)"
        yield Statement(Mark.GOOD, f"Mean flux density in the gap: {B:.3g} T {at}{more}.")
    inductance = last.get("apparent_inductance")
    text = "" if inductance is None else f"; inductance {inductance:.3g} H"
    yield note(f"Flux linkage: {last['flux_linkage']:.4g} Wb {at}{text}.")
    errors = details.get("estimated_relative_error") or {}
    if errors:
        worst = max(errors, key=lambda name: abs(errors[name]))
        yield note(f"Estimated error of the mesh: {format_percent(abs(errors[worst]))} ({worst}).")
    yield from map(warning, summary["warnings"])


def _currents(summary: dict[str, Any]) -> Table:
    rows, units = summary["currents"], summary["units"]
    forces = [(name, f"axial force on {name.removeprefix(FORCE)}") for name in rows[0] if name.startswith(FORCE)]
    shown = [(name, head) for name, head in (*HEADS, *forces) if name in rows[0]]
    table = [[in_cells(row.get(name)) for name, _ in shown] for row in rows]
    return Table(table, [f"{head} [{units[name]}]" for name, head in shown], range(len(shown)))


def _details(summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    units = summary["units"]
    for name, value in summary["at_last_current"].items():
        if name not in ("ampere_turns_by_part", "axial_force"):  # tables of their own
            if name == "estimated_relative_error":
                value = {part: format_percent(abs(error)) for part, error in value.items()}
            yield in_words(name) + (f" [{units[name]}]" if name in units else ""), in_cells(value)


def _forces(forces: dict[str, dict[str, Any]]) -> Table:
    """Return the axial force on each body with its check and its error, and the reason of what is missing."""
    rows = []
    for body, one in forces.items():
        regions = ", ".join(one.get("regions", [body]))
        values = (one.get("maxwell_stress", one.get("lorentz")), one.get("virtual_work"), one.get("error_estimate"))
        name = in_words(body) if regions == body else f"{in_words(body)} ({in_words(regions)})"
        reasons = "; ".join(str(one[key]) for key in REASONS if key in one)
        rows.append((name, *("" if value is None else f"{value:.4g}" for value in values), reasons))
    heads = ("axial force on", "force [N]", "by virtual work [N]", "estimated error [N]", "missing")
    width = len(heads) if any(row[-1] for row in rows) else len(heads) - 1
    return Table([row[:width] for row in rows], heads[:width], (1, 2, 3))


def in_cells(value: object) -> str:
    """Return a value of ``field.json`` as text of a cell."""
    if isinstance(value, dict):
        return "; ".join(f"{in_words(name)}: {in_cells(part)}" for name, part in value.items())
    if isinstance(value, list):
        return ", ".join(map(in_cells, value))
    if value is None:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
