"""A study within a budget: a file of decisions says what is run, so that one that continues comes to the same end."""

from __future__ import annotations

import json
import logging
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from emclutch.results import OutputError
from emclutch.results.atomic_file import replace_json
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import has_files, locked_folder
from emclutch.results.text import format_duration
from emclutch.scene.case import Case
from emclutch.scene.flat import differing_keys, flat_scene
from emclutch.scene.input_files import file_contents
from emclutch.studies.accuracy.plan import makespan
from emclutch.studies.study import DONE, FAILED, RUN, SCENE, Row, Study, Task

log = logging.getLogger(__name__)
VERSION = 4
BUDGET = 1200.0
"""Default wall-clock time of a study [s]."""


class BudgetedStudy(Study):
    """A study whose decisions lie in a file of its folder.

    Parameters
    ----------
    case : Case
    folder : Path
    plan : str
        Name of the file of decisions.
    executor : as of `Study`
    progress : object with update(fraction, text), and log(text) perhaps; or None

    Attributes
    ----------
    known : dict of str to Any
        The decisions.
    elapsed : float
        Wall-clock time of the tasks done, as if it had never been stopped [s].
    performed : int
        Tasks done by this process, not by one that was stopped.
    """

    def __init__(self, case: Case, folder: Path, plan: str, executor: Executor | None, progress: Any) -> None:
        super().__init__(folder, executor)
        self.case, self.plan, self.progress = case, plan, progress
        self.known: dict[str, Any] = {}
        self.elapsed, self.performed = 0.0, 0
        self._series: tuple[Sequence[Task], str] = ((), "")

    @contextmanager
    def planned(self, begin: Callable[[], dict[str, Any]], *, resume: bool, budget: float | None) -> Iterator[None]:
        """Hold the folder inside a ``with`` block, with the decisions of a new study or those that it holds.

        Parameters
        ----------
        begin : returns the decisions of a new study, as plain values, before there is a folder.
        resume : whether it continues.
        budget : as it was asked for [s]; one that is larger than before adds to what is done; None: not.

        Raises
        ------
        OutputError
            The folder is in use or not empty, has nothing to resume, or is of another scene or a larger budget.
        """
        with locked_folder(self.folder) if self.folder.is_dir() else nullcontext():
            self.refuse_folder(resume)
        if not resume:
            self.known = begin() | {"version": VERSION, "input_files": file_contents(self.case.scene)}
        with self.opened(resume):
            if resume:
                self.known = self._read_plan(budget)
                if budget is not None and budget > self.known["budget"]:
                    begun = format_duration(self.known["budget"])
                    self.decide(budget=budget, **self.open_decisions())
                    self.log(f"the budget is raised from {begun} to {format_duration(budget)}; finished tasks are kept")
            else:
                self.decide()
                self.case.write_toml(self.folder / "case.toml")
            self.at_a_time = self.known["jobs"]
            yield

    def refuse_folder(self, resume: bool) -> None:
        """Raise OutputError where the study cannot begin, or has nothing to continue."""
        has_plan = (self.folder / self.plan).is_file()
        if resume and not has_plan:
            raise OutputError(
                f"nothing to resume in {self.folder}: it has no {self.plan}; name the study's folder with --out"
            )
        if not resume and self.folder.is_dir() and has_files(self.folder):
            how = "continue it with --resume, or " if has_plan else ""
            raise OutputError(f"{self.folder} is not empty; {how}write elsewhere with --out")

    @property
    def budget(self) -> float:
        """Return the processor time that it may take [s]."""
        return float(self.known["budget"] * self.known["jobs"])

    @abstractmethod
    def open_decisions(self) -> dict[str, Any]:
        """Return the decisions that a larger budget leaves open, as they stand before they are taken."""

    @abstractmethod
    def fraction(self) -> float:
        """Return how much is done, 0 to 1."""

    def do(self, tasks: Sequence[Task], text: str) -> None:
        """Do those tasks that are not done yet.

        Raises
        ------
        Interrupted
            The user has stopped it, or the machine lacks memory or disk now.
        OutputError
            A folder cannot be written.
        """
        self._series = (tasks, text)
        self._tell(text)
        self.run(tasks)
        if self.stopped:
            failed = {name: row for name, row in self.rows.items() if row.state == FAILED and not self.keeps(row)}
            reasons = "".join(f"{name}: {row.short_reason}\n" for name, row in failed.items())
            done = sum(self.keeps(row) for row in self.rows.values())
            how = f"continue with the same command and --out {self.folder} --resume"
            raise Interrupted(f"{reasons}stopped with {done} tasks done; {how}")
        self.elapsed += self.wall(tasks)

    def keeps(self, row: Row) -> bool:
        """True of what is done, and of what the scene fails of: it would again."""
        return row.state == DONE or (row.state == FAILED and row.kind in (RUN, SCENE))

    def ended(self, task: Task, row: Row, kept: bool) -> None:
        if not self.keeps(row):
            self.stopped = True
            return
        tasks, text = self._series
        if not kept:
            self.performed += 1
            log.info("%s: %s in %.3g s", task.name, row.short_reason or row.values, row.seconds)
            done = sum(one.name in self.rows for one in tasks)
            self._tell(f"{text}: {done} of {len(tasks)}")

    def _tell(self, text: str | None) -> None:
        if self.progress is not None:
            self.progress.update(self.fraction(), text)

    def wall(self, tasks: Sequence[Task]) -> float:
        """Return the wall-clock time of those tasks that are done [s]."""
        return makespan([self.rows[task.name].wall for task in tasks if task.name in self.rows], self.known["jobs"])

    def decide(self, **values: Any) -> None:
        """Add to the decisions, and write them."""
        self.known |= values
        replace_json(self.folder / self.plan, self.known)

    def log(self, words: str) -> None:
        """Write a line to the log and by the progress."""
        log.info("%s", words)
        if (show := getattr(self.progress, "log", None)) is not None:
            show(words)

    def refuse_failed(self, name: str) -> None:
        """Raise RunError where a task has failed that all else refers to."""
        row, folder = self.rows[name], self.folder / name
        if row.state == FAILED:
            raise RunError(
                f"{name}, at the scene's own settings, has failed: {row.short_reason}; change the scene, and begin a "
                f"new study with --out, or, where its cause is gone, remove {folder} and continue with --resume\n"
                f"(log: {folder / 'run.log'})"
            )

    def _read_plan(self, budget: float | None) -> dict[str, Any]:
        path, place = self.folder / self.plan, f"the study in {self.folder}"
        try:
            known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            if known["version"] != VERSION:
                raise ValueError("it is of another version of the program")
            keys = differing_keys(flat_scene(known["case"]), flat_scene(self.case.toml()))
            files = differing_keys(known["input_files"], file_contents(self.case.scene))
            begun = float(known["budget"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise OutputError(f"cannot read {path}: {error}; begin a new study with --out") from None
        if keys:
            raise OutputError(f"{place} is of another scene ({', '.join(keys)}); begin a new one with --out")
        if files:
            changed = ", ".join(files)
            raise OutputError(f"{place} is of other files (changed since: {changed}); begin a new one with --out")
        if budget is not None and budget < begun:
            raise OutputError(
                f"{place} has a budget of {format_duration(begun)}, and {format_duration(budget)} is less; continue it "
                "without --budget or with a larger one, which keeps what is finished, or begin a new one with --out"
            )
        return known
