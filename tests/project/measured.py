"""The table of record: numbers that were measured, with where and when; and what pages say of them.

Pages name the row behind a number that they print in an HTML comment, ``17.8 +- 0.2<!-- measured: NAME -->``, which
nobody sees. For the header of a scene the table says where the number stands, in the column `header`:
``scene.toml: words {} words``. The table is docs/measured.csv. A row is written from a finished run by

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
COLUMNS = ("name", "value", "low", "high", "unit", "quantity", "command", "date", "commit", "machine", "header")
NUMBER = r"(?P<value>\d*\.?\d+)(?: \+- (?P<half>\d*\.?\d+))?"
SAID = re.compile(NUMBER + r"(?: N m| ms| s)?\s*<!-- measured: (?P<name>[\w.]+)")


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
    """README and the pages of docs/."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").rglob("*.md"))


def statements(text: str, page: str) -> Iterator[Statement]:
    """Numbers of a text that name a row."""
    for found in SAID.finditer(re.sub(r"\n#? *", " ", text)):
        yield Statement(page, found["value"], found["half"], found["name"])


def in_header(row: dict[str, str]) -> Statement | None:
    """The number of a row that a scene's header prints, None of a row without one; ValueError where it is not there."""
    if not row["header"]:
        return None
    scene, _, words = row["header"].partition(": ")
    comment = re.sub(r"\n#? *", " ", (ROOT / "cases" / scene).read_text(encoding="utf-8"))
    pattern = NUMBER.join(map(re.escape, words.split("{}")))
    if (found := re.search(pattern, comment)) is None:
        raise ValueError(f"cases/{scene} does not say: {words}")
    return Statement(scene, found["value"], found["half"], row["name"])


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
            COLUMNS[:-1],
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
    rows = table(path)
    rows[row["name"]] = {"header": ""} | rows.get(row["name"], {}) | row
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows.values())


if __name__ == "__main__":
    write_row(row_of_run(Path(sys.argv[1]), sys.argv[2], sys.argv[3]))
