"""A run or a study that is killed, resumed and killed again until it is done, and what it then has on its disk."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import h5py
import numpy as np
import pandas

from emclutch.results.atomic_file import is_unfinished
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.history import whole_rows

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TIMES = re.compile(r"wall_|seconds|processor_time")  # of a clock, which no two runs have in common
LONGEST = 3600.0  # s, for a process that is not killed


@dataclass(frozen=True, slots=True)
class Death:
    """When a process is killed: at an event of its files (see `mortal_command`), or after some seconds.

    Attributes
    ----------
    event : int
        Number of the event; 0: none.
    seconds : float
        After the event, or after the start of the process.
    whole_family : bool
        With its replicas and workers; else these see it die.
    """

    event: int = 0
    seconds: float = 0.0
    whole_family: bool = False


@dataclass(slots=True)
class KilledRun:
    """A run, or a study, that is started, killed and resumed as a user would.

    Attributes
    ----------
    source : Path
        Scene or study.
    folder : Path
        Of the run.
    command : str
        "run" or "sweep".
    options : list of str
        Of the command.
    moments : Counter
        At what the process was when it was killed.
    """

    source: Path
    folder: Path
    command: str = "run"
    options: list[str] = field(default_factory=list)
    moments: Counter = field(default_factory=Counter)

    def live(self, death: Death | None = None) -> int | None:
        """Start or resume it; the number of its events, or None where it was killed before it was done."""
        before = self._log()
        by_itself = Death() if death is None else death
        command = [sys.executable, str(HERE / "mortal_command.py"), str(self.folder)]
        command += [str(by_itself.event), str(by_itself.seconds)]
        process = subprocess.Popen(
            [*command, *self._words()], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
        try:
            is_timed = death is not None and not death.event
            _, said = process.communicate(timeout=by_itself.seconds if is_timed else LONGEST)
        except subprocess.TimeoutExpired:
            for pid in [process.pid, *(family(process.pid) if by_itself.whole_family else [])]:
                os.kill(pid, signal.SIGKILL)
            _, said = process.communicate()
        if process.returncode == -signal.SIGKILL:
            self.moments[self._moment(self._log()[len(before) :])] += 1
            return None
        if process.returncode != 0:
            raise AssertionError(f"{' '.join(self._words())} ended with {process.returncode}:\n{said}")
        return int(re.findall(r"(\d+) events", said)[-1])

    def _words(self) -> list[str]:
        """The command with which a user starts it, or continues where that is possible."""
        if self.command == "sweep":
            begun = (self.folder / "study.log").is_file()
            return ["sweep", str(self.source), "--out", str(self.folder), *self.options, *["--resume"] * begun]
        if (self.folder / "case.toml").is_file():
            return ["run", str(self.folder), "--resume", *self.options]
        return ["run", str(self.source), "--out", str(self.folder), *self.options]

    def _log(self) -> str:
        log = self.folder / "run.log"
        return log.read_text(encoding="utf-8") if log.is_file() else ""

    def _moment(self, said: str) -> str:
        """At what a run was, from what it left; `said` is what it wrote into its log."""
        if self.command == "sweep":
            done = len(list(self.folder.glob("*/summary.json")))
            return f"point {done + 1}" if done or (self.folder / "attempts").is_dir() else "start-up"
        unfinished = [path.name for path in self.folder.rglob("*.new") if is_unfinished(path)]
        if any("run.h5" in name for name in unfinished):
            return "record being written"
        if any("checkpoint" in name for name in unfinished):
            return "checkpoint being written"
        if unfinished:
            return "another file being written"
        if not said:
            return "start-up"
        if "started: " not in said and "resumed at " not in said:
            return "mesh, packing"
        if whole_rows(self.folder / "history.csv") == 0:
            return "first window"
        return "summary, pictures" if (self.folder / "summary.json").is_file() else "windows"


def family(pid: int) -> list[int]:
    """All processes that descend from one."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    own = [int(word) for word in path.read_text().split()] if path.is_file() else []
    return own + [below for each in own for below in family(each)]


def record_of(folder: Path) -> dict[str, Any]:
    """Everything that a run or a study leaves and that no clock is in, by name, to the last bit."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if "set-aside" in name or not path.is_file():
            continue
        if path.name == "history.csv" or path.name == "study.csv":
            table = pandas.read_csv(path, dtype=str, keep_default_na=False)
            found |= {f"{name}: {column}": list(table[column]) for column in table if not TIMES.match(column)}
        elif path.name == "summary.json":
            found |= {f"{name}: {key}": value for key, value in _without_clocks(json.loads(path.read_text())).items()}
        elif path.name == "run.h5":
            found |= {f"{name}: {place}": value for place, value in _arrays(path).items()}
        elif path.name == "checkpoint.h5":
            dem = read_checkpoint(path)["dem"]
            found |= {f"{name}: {key}": _bits(value) for key, value in dem.items()}
        elif path.suffix in (".vtp", ".vtu", ".pvd") or path.name in ("profiles.csv", "wall_pressure.csv"):
            found[name] = path.read_bytes()
    return found


def differences(first: dict[str, Any], second: dict[str, Any]) -> list[str]:
    """Names of what is not the same in two records."""
    return sorted(name for name in {*first, *second} if first.get(name) != second.get(name))


def table_of(things: list, row_of: Callable[[Any, Path], dict[str, Any]], path: Path) -> list[dict[str, Any]]:
    """A row for each thing, made in a folder of its own; printed, and stored as a table, as soon as it is there.

    What cannot be compared, since a run did not come to its end, differs; the next thing's turn comes all the same.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    for thing in things:
        with tempfile.TemporaryDirectory() as scratch:
            try:
                rows.append(row_of(thing, Path(scratch)))
            except AssertionError as error:
                rows.append({"differ": 1, "which": f"{thing.name}: {error}"})
        print(pandas.DataFrame(rows[-1:]).to_string(index=False, max_colwidth=None), flush=True)
        pandas.DataFrame(rows).to_csv(path, index=False)
    return rows


def ended(folder: Path) -> None:
    """Wait until nobody holds anything below a folder any more."""
    from emclutch.results.folder_lock import LOCK, FolderInUse, locked_folder

    last = monotonic() + LONGEST
    for lock in sorted(folder.rglob(LOCK)):
        while lock.parent.is_dir() and monotonic() < last:
            try:
                with locked_folder(lock.parent):
                    break
            except FolderInUse:
                sleep(0.1)


def _without_clocks(summary: dict[str, Any]) -> dict[str, Any]:
    clocks = ("seconds", "plan", "figure_of_merit", "verdict")  # the verdict says what more would take
    paths = ("discretisation_error_note",)  # names the scene's file, for a run that continues its folder's
    return {key: value for key, value in summary.items() if key not in (*clocks, *paths)}


def _arrays(path: Path) -> dict[str, tuple]:
    found: dict[str, tuple] = {}

    def take(name: str, node: Any) -> None:
        of_a_clock = any(TIMES.match(part) for part in name.split("/"))
        if isinstance(node, h5py.Dataset) and not name.startswith("parameters") and not of_a_clock:
            found[name] = _bits(node[()])

    with h5py.File(path, "r") as file:
        file.visititems(take)
    return found


def _bits(value: Any) -> tuple:
    array = np.asarray(value)
    return str(array.dtype), array.shape, array.tobytes()
