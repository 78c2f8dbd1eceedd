"""All of `make stability`, one part after the other: `python tests/hard/all_parts.py FOLDER`.

It begins with the processor time that it will take on this machine, from what the parts take on the reference machine
and from the measured speed (`emclutch.simulation.forecast.machine_speed`). Every part prints and stores a table of its
own below FOLDER; a part that fails does not keep the others from running. It ends with one table of all: what was
checked how often, what failed, what came nearest to it, seconds announced and taken, stored as FOLDER/parts.csv. Exit
code 1: a part failed.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas

from emclutch.simulation.forecast.cost import format_rough_time
from emclutch.simulation.forecast.machine_speed import slowness

HERE = Path(__file__).resolve().parent
Count = tuple[int, int, str]


@dataclass(frozen=True, slots=True)
class Part:
    """One of the scripts.

    Attributes
    ----------
    name : str
        In words.
    script : str
        Its file; it gets the folder.
    table : str
        The file that it leaves there.
    seconds : float
        Processor time on the reference machine [s], with kernels that are compiled.
    count : callable
        (checks, failures, what came nearest to one) of its table.
    """

    name: str
    script: str
    table: str
    seconds: float
    count: Callable[[pandas.DataFrame], Count]

    def row(self, folder: Path, done: bool) -> dict[str, object]:
        """What the table says; `done`: whether the script ended as it should. No table is a failure."""
        path = folder / self.table
        checks, failed, nearest = self.count(pandas.read_csv(path)) if path.is_file() else (0, 1, "no table")
        return {"part": self.name, "checks": checks, "failed": max(failed, int(not done)), "nearest": nearest}


def _margins(table: pandas.DataFrame) -> Count:
    worst = table.loc[table["margin"].idxmax()]
    stops = int(table["invariant"].str.startswith("stops").sum())
    nearest = f"{worst['invariant']} of {worst['case']} at {worst['steps']}: {worst['margin']:.2g} of its bound"
    nearest += f"; {stops} runs stopped"
    return len(table), int((~(table["margin"] < 1.0)).sum()), nearest


def _kills(table: pandas.DataFrame) -> Count:
    return (
        int(table["kills"].sum()),
        int(table["differ"].sum()),
        f"{int(table['compared'].sum())} parts of records compared",
    )


def _threads(table: pandas.DataFrame) -> Count:
    each = table["compared"].str.count(",") + 1
    compared = int((each * table["parts"]).sum())
    return int(each.sum()), int(table["differ"].sum()), f"{compared} parts of records compared"


def _random(table: pandas.DataFrame) -> Count:
    ran = int(table.loc[table["outcome"] == "ran", "scenes"].sum())
    return int(table["scenes"].sum()), int(table["broken"].sum()), f"{ran} of them run to their end"


def _taken_away(table: pandas.DataFrame) -> Count:
    return len(table), int(table["broken"].sum()), f"{table['list'].nunique()} lists of modules"


def _long(table: pandas.DataFrame) -> Count:
    return len(table), int(table["failed"].sum()), f"{table['test'].str.partition('::')[0].nunique()} files"


PARTS = (
    Part("hard scenes, long", "stability.py", "stability.csv", 400.0, _margins),
    Part("kills", "kills.py", "kills.csv", 200.0, _kills),
    Part("threads", "threads.py", "threads.csv", 350.0, _threads),
    Part("random scenes", "random_runs.py", "random.csv", 220.0, _random),
    Part("taken away", "take_away.py", "take_away.csv", 125.0, _taken_away),
    Part("tests left out of the gate", "long_tests.py", "long_tests.csv", 200.0, _long),
)


def announcement(parts: Sequence[Part], slow: float) -> str:
    """Return how long all parts will take, and each, on a machine `slow` times as slow as the reference machine."""
    each = ", ".join(f"{part.name} {format_rough_time(slow * part.seconds)}" for part in parts)
    total = format_rough_time(slow * sum(part.seconds for part in parts))
    return f"about {total} of processor time, and what compiling takes ({each})"


def main(folder: Path, parts: Sequence[Part] = PARTS) -> int:
    """Run all parts; the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    slow = slowness()
    print(announcement(parts, slow), flush=True)
    rows: list[dict[str, object]] = []
    for part in parts:
        print(f"\n{part.name}", flush=True)
        (folder / part.table).unlink(missing_ok=True)
        before = os.times()
        done = subprocess.run([sys.executable, str(HERE / part.script), str(folder)], check=False).returncode == 0
        spent = sum(after - at for after, at in zip(os.times()[:4], before[:4], strict=True))
        seconds = {"announced": round(slow * part.seconds), "seconds": round(spent)}
        rows.append(part.row(folder, done) | seconds)
        pandas.DataFrame(rows).to_csv(folder / "parts.csv", index=False)
    print("\n" + pandas.DataFrame(rows).to_string(index=False, max_colwidth=None))
    return 1 if any(row["failed"] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
