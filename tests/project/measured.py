"""The table of record: numbers that were measured, with where and when; and what pages say of them.

Pages and the headers of scenes name the row behind a number that they print, in Markdown as an HTML comment:
``17.8 +- 0.2<!-- measured: NAME -->``, in a scene's header as text: ``17.8 +- 0.2 (measured: NAME)``. The table is
docs/measured.csv. A row is written from a finished run by

    python tests/project/measured.py RUN NAME "what it is"

which takes torque, interval, command, date, commit and machine from the run's folder and replaces a row of that name.
"""

from __future__ import annotations

import csv
import json
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "docs" / "measured.csv"
COLUMNS = ("name", "value", "low", "high", "unit", "quantity", "command", "date", "commit", "machine")
SAID = re.compile(
    r"(?P<value>\d*\.?\d+)(?: \+- (?P<half>\d*\.?\d+))?(?: N m| ms| s)?\s*(?:<!-- |\()measured: (?P<name>[\w.]+)"
)


class Statement(NamedTuple):
    """A number that a page prints, with the row that it names."""

    page: str
    value: str
    half: str | None
    name: str


def table(path: Path = TABLE) -> dict[str, dict[str, str]]:
    """Rows by name."""
    with path.open(encoding="utf-8", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def pages() -> Iterator[Path]:
    """What users read: README, pages, scenes that ship."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").rglob("*.md"))
    yield from sorted((ROOT / "cases").rglob("*.toml"))


def statements(text: str, page: str) -> Iterator[Statement]:
    """Numbers of a text that name a row."""
    for found in SAID.finditer(re.sub(r"\n#? *", " ", text)):
        yield Statement(page, found["value"], found["half"], found["name"])


def unit_of_last_digit(number: str) -> float:
    """10 to the power of the last printed digit."""
    return 10.0 ** -len(number.partition(".")[2])


def disagreement(said: Statement, row: dict[str, str]) -> str:
    """What is wrong with a printed number; empty where it is the row's, rounded."""
    slack = 0.5001 * unit_of_last_digit(said.value)
    if abs(float(said.value) - float(row["value"])) > slack:
        return f"{said.page} says {said.value} for {said.name}, the table {row['value']}"
    if said.half is not None:
        half = 0.5 * (float(row["high"]) - float(row["low"]))
        if abs(float(said.half) - half) > 0.5001 * unit_of_last_digit(said.half) + 1e-3 * half:
            return f"{said.page} says +- {said.half} for {said.name}, the table {half:.3g}"
    return ""


def row_of_run(folder: Path, name: str, quantity: str) -> dict[str, str]:
    """A row from a finished run; ValueError where its torque has no interval."""
    import emclutch

    result = emclutch.load_result(folder)
    (low, high), source = result.torque.interval(), json.loads((folder / "provenance.json").read_text())
    if not result.torque.known:
        raise ValueError(f"{folder}: the torque has no interval ({result.torque.reason})")
    machine = source["machine"]
    command = [Path(source["command"][0]).name, *source["command"][1:]]
    return dict(
        zip(
            COLUMNS,
            (
                name,
                f"{result.torque.mean:.4g}",
                f"{low:.4g}",
                f"{high:.4g}",
                "N m",
                f"{quantity} (95 % interval; {result.torque.reason.partition(':')[0]})",
                shlex.join(command),
                source["written"][:10],
                (source["commit"] or "unknown")[:7],
                f"{machine['cpu']}, {machine['cores']} cores",
            ),
            strict=True,
        )
    )


def write_row(row: dict[str, str], path: Path = TABLE) -> None:
    """Append a row, or replace that of its name."""
    rows = table(path) | {row["name"]: row}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows.values())


if __name__ == "__main__":
    write_row(row_of_run(Path(sys.argv[1]), sys.argv[2], sys.argv[3]))
