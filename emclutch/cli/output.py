"""Output of commands: a plan, a torque, a study, a design, JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from emclutch.scene.case import Case

if TYPE_CHECKING:
    from emclutch.scene.study import StudySection
    from emclutch.studies.design_search import DesignResult


def torque_line(torque: dict[str, Any] | None) -> str:
    """Say a run's torque with its error, and where it is not converged, why."""
    from emclutch.results.statistics import Estimate  # local: it imports numpy
    from emclutch.results.torque_in_words import torque_in_words

    if not torque or torque.get("mean") is None:
        return "torque on the disc: none" + (f" ({torque['reason']})" if torque else "")
    found = Estimate.from_dict(torque)
    text = f"torque on the disc: {torque_in_words(found)}"
    if found.interval() is not None:
        text += f", {packings(found.replicas)}"
    return f"{text}; {found.reason}"


def packings(count: int) -> str:
    """Say out of how many packings a mean is, and of one, what its error lacks."""
    return f"{count} packings" if count > 1 else "one packing: what packings differ by is not in it"


def tell_plan(case: Case, as_json: bool, threads: int | None = None) -> None:
    from emclutch.simulation.check import check  # local: it needs the packages of the physics

    checked = check(case, threads)
    if as_json:
        print_json({"title": checked.title, "effects": checked.effects, "warnings": checked.warnings,
                     "plan": checked.decisions, "left_out": [line.as_dict() for line in checked.left_out]})  # fmt: skip
        return
    console = Console()
    console.print(f"{checked.title}: OK", highlight=False, markup=False)
    effects = Table("effect", "")
    for name in case.scene.effects.names():
        effects.add_row(name, "on" if name in checked.effects else "off")
    console.print(effects)
    rows = Table("what follows", "")
    for label, text in checked.decisions.items():
        rows.add_row(label, escape(text))
    console.print(rows)
    if case.scene.particles is None:
        return
    rows = Table("left out", "matters", "by this number (from there on)")
    for line in checked.left_out:
        rows.add_row(line.effect, line.verdict, line.in_words())
    console.print(rows)


def tell_study(study: StudySection, jobs: int, as_json: bool) -> None:
    from emclutch.studies.forecast import predict_study, time_in_words  # local: it needs the packages of the physics

    found = predict_study(study, jobs)
    if as_json:
        print_json(found.as_dict())
        return
    console = Console()
    console.print(f"{found.title}: OK", highlight=False, markup=False)
    rows = Table("point", "steps", "grains", "packings", "takes", "memory", "disk")
    for point in found.points:
        rows.add_row(
            escape(point.label),
            str(point.steps),
            str(point.grains),
            str(point.replicas),
            time_in_words(point.seconds, point.earliest),
            f"{point.memory:.0f} MiB",
            f"{point.disk:.0f} MiB",
        )
    console.print(rows)
    console.print(found.in_words(), highlight=False, markup=False)


def tell_design(found: DesignResult, as_json: bool) -> None:
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
    typer.echo(json.dumps(values, indent=2, default=str))
