"""Studies of many tasks that continue after they were stopped or killed.

A file of decisions in the study's folder says what is to be run, and the folder of each task whether it is done
(`emclutch.studies.accuracy.tasks`); so a study that continues comes to the same end.
"""

from __future__ import annotations

import json
import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from itertools import takewhile
from pathlib import Path
from typing import Any

from emclutch.results import OutputError
from emclutch.results.atomic_file import replace_json
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import has_files, locked_folder
from emclutch.results.run_folder import logging_to
from emclutch.results.text import format_duration
from emclutch.scene.case import Case
from emclutch.scene.flat import differing_keys, flat_scene
from emclutch.scene.input_files import file_contents
from emclutch.scene.replica_count import cores_at_hand
from emclutch.studies.accuracy.tasks import STOPPED, AccuracyTask, TaskResult, perform, result_in
from emclutch.studies.task_queue import InThisProcess, TaskQueue, log_progress, makespan, update_progress
from emclutch.studies.tasks import STOP
from emclutch.studies.workers import ctrl_c_sets, worker_pool

log = logging.getLogger(__name__)
VERSION = 3
BUDGET = 1200.0
"""Default wall-clock time of a study [s]."""


def checked_jobs(jobs: int | None) -> int:
    """Return the number of tasks that run at a time, by default one for each core; ValueError below 1."""
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs = {jobs}; allowed: 1 or more")
    return cores_at_hand() if jobs is None else jobs


@contextmanager
def begun_study(
    case: Case,
    folder: Path,
    plan: str,
    *,
    resume: bool,
    budget: float | None,
    jobs: int,
    begin: Callable[[TaskQueue], dict[str, Any]],
) -> Iterator[tuple[dict[str, Any], TaskQueue]]:
    """Hold the folder of a study; yield its decisions, and a queue of `jobs` processes that Ctrl-C ends.

    `begin` returns the decisions of a new study, as plain values; those of another one are read from the file `plan`.
    """
    if folder.is_dir():
        with locked_folder(folder):
            refuse_folder(folder, resume, plan)
    else:
        refuse_folder(folder, resume, plan)
    asked = threading.Event()
    with ctrl_c_sets(asked), worker_pool(jobs) if jobs > 1 else nullcontext(InThisProcess()) as executor:
        queue = TaskQueue(executor, jobs, asked)
        known = None if resume else begin(queue)
        with locked_folder(folder):
            refuse_folder(folder, resume, plan)  # nobody has written it meanwhile
            queue.stop_file = folder / STOP
            queue.stop_file.unlink(missing_ok=True)
            with logging_to(folder / "study.log", ["emclutch.studies"]):
                if known is None:
                    known = read_plan(folder / plan, case, budget)
                else:
                    known |= {"version": VERSION, "input_files": file_contents(case.scene)}
                    replace_json(folder / plan, known)
                    case.write_toml(folder / "case.toml")
                try:
                    yield known, queue
                finally:
                    queue.stop_file.unlink(missing_ok=True)


class ResumableStudy(ABC):
    """A study that goes on: what is decided, and what is done.

    Attributes
    ----------
    folder : Path
    plan : str
        Name of its file of decisions.
    known : dict of str to Any
        The decisions.
    results : dict of str to TaskResult
        By the task's folder.
    elapsed : float
        Wall-clock time of the tasks done, as if it had never been stopped [s].
    performed : int
        Tasks done by this process, not by one that was stopped.
    budget : float
        Processor time [s].
    """

    def __init__(self, folder: Path, plan: str, known: dict[str, Any], queue: TaskQueue, progress: Any) -> None:
        self.folder, self.plan, self.known, self.queue, self.progress = folder, plan, known, queue, progress
        self.results: dict[str, TaskResult] = {}
        self.elapsed, self.performed = 0.0, 0
        self.budget = known["budget"] * known["jobs"]

    @abstractmethod
    def fraction(self) -> float:
        """Return how much is done, 0 to 1."""

    def do(
        self,
        tasks: Sequence[AccuracyTask],
        text: str,
        may_begin: Callable[[int], bool] = lambda number: True,
        look: Callable[[list[AccuracyTask]], None] = lambda running: None,
    ) -> None:
        """Do those tasks that are not done yet; Interrupted where the user stops it.

        `may_begin` false, of a task's number, ends the series; `look` gets what is running, every now and then.
        """
        for task in tasks:
            if (done := result_in(task.target)) is not None:
                self.results[task.folder] = done
        left = [(number, task) for number, task in enumerate(tasks) if task.folder not in self.results]

        reasons = []

        def take(number: int, outcome: TaskResult | str) -> None:
            if isinstance(outcome, str):
                self.queue.stopped = True
                if outcome != STOPPED:
                    reasons.append(f"{tasks[number].folder}: {outcome}\n")
                return
            folder = tasks[number].folder
            self.results[folder] = outcome
            self.performed += 1
            log.info("%s: %s", folder, outcome.failure or f"{outcome.result} in {outcome.seconds:.3g} s")
            done = sum(task.folder in self.results for task in tasks)
            update_progress(self.progress, self.fraction(), f"{text}: {done} of {len(tasks)}")

        update_progress(self.progress, self.fraction(), text)
        self.queue.all(
            perform,
            takewhile(lambda one: may_begin(one[0]), left),
            take,
            lambda: look([tasks[number] for number in self.queue.running.values()]),
        )
        if self.queue.stopped:
            raise Interrupted(
                f"{''.join(reasons)}stopped with {len(self.results)} tasks done; continue with the same command and "
                f"--out {self.folder} --resume"
            )
        self.elapsed += self.wall(tasks)

    def wall(self, tasks: Sequence[AccuracyTask]) -> float:
        """Return the wall-clock time of those tasks that are done [s]."""
        done = [self.results[task.folder].wall for task in tasks if task.folder in self.results]
        return makespan(done, self.known["jobs"])

    def decide(self, **values: Any) -> None:
        """Add to the decisions, and write them."""
        self.known |= values
        replace_json(self.folder / self.plan, self.known)

    def log(self, words: str) -> None:
        """Write a line to the log and by the progress."""
        log.info("%s", words)
        log_progress(self.progress, words)

    def refuse_failed(self, name: str) -> None:
        """Raise RunError where a task has failed that all else refers to."""
        if failure := self.results[name].failure:
            folder = self.folder / name
            raise RunError(
                f"{name}, at the scene's own settings, has failed: {failure}; change the scene, and begin a new study "
                f"with --out, or, where its cause is gone, remove {folder} and continue with --resume\n"
                f"(log: {folder / 'run.log'})"
            )


def refuse_folder(folder: Path, resume: bool, plan: str) -> None:
    """Raise OutputError where a study cannot begin, or has nothing to continue."""
    if resume and not (folder / plan).is_file():
        raise OutputError(f"nothing to resume in {folder}: it has no {plan}; name the study's folder with --out")
    if not resume and folder.is_dir() and has_files(folder):
        how = "continue it with --resume, or " if (folder / plan).is_file() else ""
        raise OutputError(f"{folder} is not empty; {how}write elsewhere with --out")


def read_plan(path: Path, case: Case, budget: float | None) -> dict[str, Any]:
    """Return the decisions of a study; OutputError where it is of another scene, of changed files or another budget."""
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        if known["version"] != VERSION:
            raise ValueError("it is of another version of the program")
        keys = differing_keys(flat_scene(known["case"]), flat_scene(case.toml()))
        contents = file_contents(case.scene)
        files = differing_keys(known.get("input_files", contents), contents)
        begun = float(known["budget"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"cannot read {path}: {error}; begin a new study with --out") from None
    place = f"the study in {path.parent}"
    if keys:
        raise OutputError(f"{place} is of another scene ({', '.join(keys)}); begin a new one with --out")
    if files:
        raise OutputError(f"{place} is of other files (changed since: {', '.join(files)}); begin a new one with --out")
    if budget is not None and budget != begun:
        raise OutputError(
            f"{place} has a budget of {format_duration(begun)}, by which it was planned; continue it "
            "without --budget, or begin a new one with --out"
        )
    return known
