"""Output of commands: a plan, a torque, a study, a design, JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from emclutch.scene.case import Case

if TYPE_CHECKING:
    from emclutch.scene.study import StudySection
    from emclutch.studies.design_search import DesignResult


def result_lines(summary: dict[str, Any]) -> list[str]:
    """Return what a run is for: torque, stress of a sheared box, or both branches of a ramp of the current."""
    if "stress" in summary:
        return [stress_line(summary)]
    if ramp := summary.get("torque_against_current"):
        from emclutch.results.current_ramp import in_words  # local: it imports numpy

        return in_words(ramp)
    return [torque_line(summary.get("torque"))]


def torque_line(torque: dict[str, Any] | None) -> str:
    """Return a run's torque with its error, and where it is not converged, why."""
    from emclutch.results.statistics import Estimate  # local: it imports numpy
    from emclutch.results.text import format_torque

    if not torque or torque.get("mean") is None:
        return "torque on the disc: none" + (f" ({torque['reason']})" if torque else "")
    found = Estimate.from_dict(torque)
    text = f"torque on the disc: {format_torque(found)}"
    if found.interval() is not None:
        text += f", {packings(found.replicas)}"
    return f"{text}; {found.reason}"


def stress_line(summary: dict[str, Any]) -> str:
    """Return the shear stress of a periodic box with its error and effective friction, and where not converged, why."""
    from emclutch.results.statistics import Estimate  # local, as above
    from emclutch.results.text import format_stress

    found, friction = Estimate.from_dict(summary["stress"]), summary.get("effective_friction")
    text = f"shear stress: {format_stress(found)}"
    if found.interval() is not None:
        text += f", {packings(found.replicas)}"
    if friction is not None and friction["mean"] is not None:
        text += f"; effective friction {friction['mean']:.3g}"
    return f"{text}; {found.reason}"


def packings(count: int) -> str:
    """Return out of how many packings a mean is, and of one, what its error lacks."""
    return f"{count} packings" if count > 1 else "one packing: what packings differ by is not in it"


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows of texts under their head."""
    table = Table(*head)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    Console().print(table)


def print_plan(case: Case, as_json: bool, threads: int | None = None) -> None:
    """Print what follows from a scene, and what it leaves out."""
    from emclutch.simulation.check import check  # local: it needs the packages of the physics

    checked = check(case, threads)
    if as_json:
        print_json({"title": checked.title, "effects": checked.effects, "warnings": checked.warnings,
                     "plan": checked.decisions, "left_out": [line.as_dict() for line in checked.left_out]})  # fmt: skip
        return
    Console().print(f"{checked.title}: OK", highlight=False, markup=False)
    effects = case.scene.effects.names()
    print_table(("effect", ""), ((name, "on" if name in checked.effects else "off") for name in effects))
    print_table(("what follows", ""), checked.decisions.items())
    if case.scene.particles is not None:
        rows = ((line.effect, line.verdict, line.in_words()) for line in checked.left_out)
        print_table(("left out", "matters", "by this number (from there on)"), rows)


def print_study(study: StudySection, jobs: int, as_json: bool) -> None:
    """Print what the points of a study are predicted to take."""
    from emclutch.studies.forecast import predict_study, time_in_words  # local: it needs the packages of the physics

    found = predict_study(study, jobs)
    if as_json:
        print_json(found.as_dict())
        return
    Console().print(f"{found.title}: OK", highlight=False, markup=False)
    print_table(
        ("point", "steps", "grains", "packings", "takes", "memory", "disk"),
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
        lines += [torque_line(found.run.summary.get("torque")), *run_in_words(found)]
    typer.echo("\n".join(lines))


def print_json(values: Any) -> None:
    """Print values as JSON."""
    typer.echo(json.dumps(values, indent=2, default=str))
