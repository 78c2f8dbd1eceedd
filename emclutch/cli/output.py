"""Output of commands: a plan, a torque, a study, a design, JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from emclutch.cli.input import warn

if TYPE_CHECKING:
    from emclutch.scene.case import Case
    from emclutch.scene.study import StudySection
    from emclutch.studies.design_search import DesignResult


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows of texts under their head."""
    table = Table(*head)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    Console().print(table)


FIRST = "expected torque", "cost", "field", "accuracy"
"""What an engineer looks for first; rows with a warning stand beside them."""


def print_plan(case: Case, as_json: bool, threads: int | None = None, details: bool = False) -> None:
    """Print the plan of a scene and the effects it leaves out: the most important rows, or with `details` all."""
    from emclutch.simulation.check import check  # local: it needs the packages of the physics

    checked = check(case, threads)
    if as_json:
        found = {
            "title": checked.title, "effects": checked.effects, "warnings": checked.warnings,
            "plan": checked.decisions, "omitted_effects": [line.as_dict() for line in checked.omitted_effects],
        }  # fmt: skip
        print_json(found | checked.expected.as_dict())
        return
    warn([text for text in checked.warnings if text not in case.warnings])  # those were printed with the scene
    Console().print(f"{checked.title}: OK", highlight=False, markup=False)
    first = {name: words for name, words in checked.decisions.items() if name in FIRST or "WARNING" in words}
    if first and not details:
        Console().print(f"effects: {', '.join(checked.effects) or 'none'}", highlight=False, markup=False)
        print_table(("estimate", ""), sorted(first.items(), key=lambda row: (*FIRST, row[0]).index(row[0])))
        missing = [
            (line.effect.replace("_", " "), line.in_words()) for line in checked.omitted_effects if line.is_reservation
        ]
        if missing:
            print_table(("omitted, may be relevant", "criterion (limit)"), missing)
        typer.echo("grains, steps, mesh and all that is left out: emclutch check CASE --details")
        return
    effects = case.scene.effects.names()
    print_table(("effect", ""), ((name, "on" if name in checked.effects else "off") for name in effects))
    print_table(("plan", ""), checked.decisions.items())
    for head, rows in checked.left_out_tables():
        print_table(head, rows)


def print_study(study: StudySection, jobs: int, as_json: bool) -> None:
    """Print what the points of a study are predicted to take."""
    from emclutch.studies.forecast import predict_study, time_in_words  # local: it needs the packages of the physics

    found = predict_study(study, jobs)
    if as_json:
        print_json(found.as_dict())
        return
    Console().print(f"{found.title}: OK", highlight=False, markup=False)
    print_table(
        ("point", "steps", "grains", "replicas", "takes", "memory", "disk"),
        (
            (
                point.label, str(point.steps), str(point.grains), str(point.replicas),
                time_in_words(point.seconds, point.earliest), f"{point.memory:.0f} MiB", f"{point.disk:.0f} MiB",
            )
            for point in found.points
        ),
    )  # fmt: skip
    Console().print(found.in_words(), highlight=False, markup=False)


def print_points(study: StudySection, part: tuple[int, int] | None) -> None:
    """Print the points of a study as lines of CSV, counted from 1 as parts count them; of a part its own."""
    import csv  # local, as above
    import sys

    points = study.points()
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["point", *study.values])
    for number in range(len(points)) if part is None else study.numbers_of(part):
        writer.writerow([number + 1, *points[number].values()])


def print_design(found: DesignResult, as_json: bool) -> None:
    """Print the value that a search has found, and the run with it."""
    from emclutch.results.report.verdict import closing_lines
    from emclutch.studies.design_search import (  # local: it needs the packages of the physics
        as_data,
        in_words,
        run_in_words,
    )

    if as_json:
        print_json(as_data(found))
        return
    lines = in_words(found)
    if found.run is not None:
        lines += [*closing_lines(found.run)[:1], *run_in_words(found)]
    typer.echo("\n".join(lines))


def print_json(values: Any) -> None:
    """Print values as JSON."""
    typer.echo(json.dumps(values, indent=2, default=str))
