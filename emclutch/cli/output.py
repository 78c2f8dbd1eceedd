"""Output of commands: a report for the terminal or as JSON; the points of a study as CSV."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from emclutch.results.report.report import Report
    from emclutch.scene.study import StudySection


def show(report: Report, as_json: bool = False, details: bool = False) -> None:
    """Print what a result reports: its data as JSON, or the sections for the terminal, with `details` all of them."""
    from emclutch.results.report.render import terminal  # local: `--help` starts without the packages that draw

    if as_json:
        print_json(report.data)
    else:
        typer.echo(terminal(report, details))


def print_points(study: StudySection) -> None:
    """Print the points of a study as lines of CSV, counted from 0."""
    import csv  # local, as above
    import sys

    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["point", *study.values])
    writer.writerows([number, *point.values()] for number, point in enumerate(study.points()))


def print_json(values: Any) -> None:
    """Print values as JSON."""
    typer.echo(json.dumps(values, indent=2, default=str))
