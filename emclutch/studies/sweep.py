"""A parameter study: every point is a run in a folder of its own; tables and pictures over all of them.

Points are tasks of a `emclutch.studies.study.Study`. The process of the study alone writes the tables, now and then
while points run and at the end, in the study's order: they follow from the points, whoever runs these, and in which
order. Processes that run one point each write that point alone; `collect` makes the tables.
"""

from __future__ import annotations

import io
import logging
import shlex
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import nullcontext, suppress
from math import inf
from pathlib import Path
from typing import Any

from emclutch.results import OutputError, RunFolder
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.history import last_time
from emclutch.results.measured_table import keep_measured
from emclutch.results.report.render import write_index
from emclutch.results.report.study_report import StudyState, state_report
from emclutch.results.run_end import seconds_of
from emclutch.results.study_folder import is_study
from emclutch.results.study_table import DONE, FAILED, STOPPED, WAITING, StudyTable
from emclutch.results.torque_curves import best_of
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.study import StudySection, read_study
from emclutch.studies.point import names_in, row_in, tasks_of, time_reached
from emclutch.studies.study import (
    ELSEWHERE,
    FILES,
    SCENE,
    STOP,
    Row,
    Study,
    Task,
    checked_jobs,
    child_processes,
    ctrl_c_sets,
)
from emclutch.studies.tables import label_of, write_failures, write_tables
from emclutch.studies.throttle import Throttle

log = logging.getLogger(__name__)
PAGE_SECONDS = 5.0  # between two writings of index.html: a browser loads it every ten
SHOWN = 20
"""Points that are named in a line; a study may have thousands."""


def sweep(
    study: StudySection | str | Path,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: StudyTable | None = None,
    force: bool = False,
    measured: str | Path | None = None,
    point: int | None = None,
) -> Path:
    """Run every point of a study, and return the study's folder.

    The folder holds a folder for each point, as ``003_current=0.8A_7f3a9c01d2`` (each a whole run), `study.csv` with a
    row a point, `study.log` with what became of each, `index.html`, a page of all of it that is rewritten while they
    run, and where they apply: `seeds.csv`, averages over `scene.seed`; `torque_vs_current.csv`, `.json` (linear range)
    and `.png` of a study over `coil.current` or `coil.voltage`; `torque_vs_speed.csv` and `.png` of one over constant
    `motion.rotor.speed`; `grain_size.csv`, `.json` (law and extrapolation) and `.png` of one over `particles.diameter`
    or `particles.sizes` in a sheared gap; `speeds.png` where shafts change their speed; `methods.csv` of one over
    `contact.method`.

    Parameters
    ----------
    study : a Study, or the path of a study file.
    out : folder; default: the next free studies/<name>-<nnn>.
    threads : of the kernels of each point's replicas; default: ``OMP_NUM_THREADS`` or all cores, shared out among
        `jobs` and replicas. Results do not depend on it.
    resume : keep the points that are done and continue the others from their checkpoints, also to a later time.end.
        Values may be inserted, removed and put in another order; a point whose scene has changed is a new one.
    jobs : points that run at a time, each in a process of its own with its replicas; 1, the default, runs all
        of them in this one. Results do not depend on it.
    executor : where points run instead: any `concurrent.futures.Executor` whose workers see the same file system, such
        as ``distributed.Client(address).get_executor(pure=False)``. It gets `jobs` points at a time, by default all.
        Each worker runs its point in a child process.
    progress : table of the points to keep up to date.
    force : run also points that need more memory than is free.
    measured : table of current [A] and torques [N m] to lay over the torque curve, as `read_measured` takes it
        (`emclutch.results.measured_table`); the folder keeps it as ``measured.csv``.
    point : number of the one point to run, or to continue, from 0, for job arrays: in the same folder other processes
        and machines may run other points. No tables are written: `collect` does. A second process that runs the same
        point takes it over from the first.

    Raises
    ------
    SceneError
        The study has faults, or no such point.
    OutputError, RunError
        At the end, where points have failed: with the values and the reason of each, which also lie in `failures.csv`.
        The other points are run all the same, and `resume` repeats those that failed. OutputError where all of them
        failed of their input or output. `Interrupted` after Ctrl-C: those that run end with a checkpoint.
    ValueError
        `jobs` is less than 1; a `point` has no folder, or jobs or an executor.
    """
    at_a_time = checked_jobs(1 if jobs is None else jobs)
    if point is not None and (out is None or executor is not None or at_a_time > 1):
        raise ValueError(f"point = {point} needs the folder of the study, out, and runs in this process")
    numbers = None if point is None else [point]
    study = study if isinstance(study, StudySection) else read_study(study, numbers=numbers)
    folder = Path(out) if out is not None else RunFolder.next_path(study.path.stem, "studies")
    if resume and not folder.is_dir():  # before the lock makes it
        raise OutputError(f"nothing to resume in {folder}: there is no such folder; name the study's folder with --out")
    options = {"threads": threads, "processes": 1 if executor is not None else at_a_time, "force": force}
    with child_processes(at_a_time) if executor is None else nullcontext(executor) as workers:
        running = _Sweep(study, folder, workers, jobs if workers is executor else at_a_time, progress)
        if point is not None:
            running.run_point(point, options)
        else:
            with running.opened(resume):
                if measured is not None:
                    keep_measured(measured, folder)
                running.run_points(options)
    running.raise_failures(jobs)
    return folder


def commands(study: StudySection, out: Path, options: Sequence[str] = ()) -> list[str]:
    """Return a command for each point that is not done, for job arrays; points that hand on their grains share a line.

    `options` are added to each.
    """
    chains: dict[str, list[str]] = {}
    ends: dict[str, str] = {}
    for number, task in enumerate(tasks_of(study, out)):
        first = ends[task.name] = ends.get(task.after, task.name)
        if time_reached(task, out) < inf:
            words = ["emclutch", "sweep", str(study.path), "--out", str(out), "--point", str(number), *options]
            chains.setdefault(first, []).append(shlex.join(words))
    return [" && ".join(chain) for chain in chains.values()]


def collect(study: StudySection | str | Path, out: str | Path) -> StudyState:
    """Write tables and pictures of all points of a study that are done, and return the state of each.

    Nothing is run and no point is changed: to collect again, at any time and beside points that run, does no harm.

    Parameters
    ----------
    study : a Study, or the path of its file.
    out : folder of the study.

    Raises
    ------
    SceneError
        The study has faults.
    OutputError
        The folder is none of this study, or it cannot be read or written.
    """
    study = study if isinstance(study, StudySection) else read_study(study)
    folder = Path(out)
    collected = _Sweep(study, folder, None, 1, None)
    collected.take(tasks_of(study, folder))
    names = names_in(folder)
    if not {task.name for task in collected.tasks} & {*names}:
        found = f"{', '.join(names[:SHOWN])}, none of them a point of {study.path}" if names else "no points of a study"
        raise OutputError(f"{folder} holds {found}; name the folder of this study, or its file as it was")
    begun = collected.attempts_at(collected.tasks)
    for number, task in enumerate(collected.tasks):
        row = row_in(task, folder / task.name)
        if row is not None:
            collected.rows[task.name] = row
            collected.ended(task, row, kept=False)
        elif task.name in begun:
            collected.table.set_running(number)
    return collected.end()


class _Sweep(Study):
    """The points of a study as tasks, with their progress, tables and page."""

    def __init__(
        self,
        section: StudySection,
        folder: Path,
        executor: Executor | None,
        at_a_time: int | None,
        table: StudyTable | None,
    ) -> None:
        super().__init__(folder, executor, at_a_time)
        self.section, self.table = section, table or StudyTable(stream=io.StringIO())
        self.tasks: list[Task] = []
        self.numbers: dict[str, list[int]] = {}
        self.is_over = False
        self.point: int | None = None  # that alone is run
        self.write, self.write_page = Throttle(self._write), Throttle(self._write_page, PAGE_SECONDS)
        self.look_at = Throttle(self._look_at)

    def run_points(self, options: dict[str, Any]) -> None:
        """Run all points; at the end write what is over all of them."""
        self.take(tasks_of(self.section, self.folder, progress=_StatusLog(), measure=True, **options))
        names = {task.name for task in self.tasks}
        if others := sorted(name for name in names_in(self.folder) if name not in names and "set-aside" not in name):
            log.info("of none of the study's points, and left as they are: %s", ", ".join(others))
        write_failures(self.folder, [])
        try:
            self.run(self.tasks)
        finally:
            self.end()

    def run_point(self, number: int, options: dict[str, Any]) -> None:
        """Run one point, whatever runs beside it; nothing else in the folder is written."""
        if (self.folder / STOP).exists():
            stop = self.folder / STOP
            raise OutputError(f"{stop} asks the points of this study to stop; remove it if no sweep is stopping")
        self.point = number
        self.write = self.write_page = Throttle(lambda: None)
        first = self.section.predecessors()[number]
        numbers = [number] if first is None else [first, number]
        *before, task = tasks_of(self.section, self.folder, numbers, **options)
        self.take([task])
        if (target := task.case.scene.accuracy.target) is not None:  # not once by each task of an array
            message = "needs an accuracy study of the device; run it first: emclutch accuracy"
            raise SceneError([Fault("accuracy.target", f"{target}", f"{message} {self.section.case_path}")], task.name)
        for one in before:
            if (row := row_in(one, self.folder / one.name)) is None or row.state != DONE:
                raise OutputError(f"{task.name} begins with the grains of {task.after}; run that point first")
            self.rows[one.name] = row
        with ctrl_c_sets(self._asked):
            self.run(self.tasks)

    def take(self, tasks: Sequence[Task]) -> None:
        """Take the tasks of the points, with a row each in the table of progress."""
        self.tasks = [*tasks]
        for number, task in enumerate(tasks):
            self.numbers.setdefault(task.name, []).append(number)
        self.table.begin([label_of(self.section, task.options["values"]) or task.name for task in tasks])

    def begun(self, task: Task) -> None:
        if self.executor is None:
            for number in self.numbers[task.name]:
                self.table.set_running(number)

    def ended(self, task: Task, row: Row, kept: bool) -> None:
        for number in self.numbers[task.name]:
            if row.state == DONE:
                values = row.values
                torque, interval = best_of(values)
                known = {"kept": kept, "converged": values["converged"]}
                self.table.set_done(number, torque, interval, values["seconds"], **known)
            else:
                self.table.set_ended(number, STOPPED if row.state == STOPPED else FAILED)
        self.write()
        self.write_page()

    def look(self, running: Sequence[Task]) -> None:
        self._running = running
        self.look_at()
        self.write_page()

    def _look_at(self) -> None:
        """Show in the table how far points are that run elsewhere."""
        folders = self.attempts_at(self._running)
        for task in self._running:
            if task.name not in folders:  # in an executor's queue
                continue
            folder = RunFolder(folders[task.name])
            reached, end = last_time(folder.history), seconds_of(task.case.scene.span.end, folder)
            for number in self.numbers[task.name]:
                if self.table.rows[number].state == WAITING:
                    self.table.set_running(number)
                if reached is not None and end is not None:
                    self.table.set_fraction(number, reached / end)

    def progress_of(self, task: Task) -> Any:
        return _PointProgress(self, self.numbers[task.name][0])

    def failures(self) -> list[tuple[Task, Row]]:
        """Return the points that have failed, with their rows, in the study's order."""
        rows = ((task, self.rows.get(task.name)) for task in self.tasks)
        return [(task, row) for task, row in rows if row is not None and row.state in (FAILED, ELSEWHERE)]

    def raise_failures(self, jobs: int | None) -> None:
        """Raise the failures of the points, or `Interrupted`; nothing where all points are done."""
        done, number = sum(self._is_done(task) for task in self.tasks), len(self.tasks)
        option = "--resume" if self.point is None else f"--point {self.point}"
        how = f"continue with: emclutch sweep {self.section.path} --out {self.folder} {option}"
        if failures := self.failures():
            texts = []
            for task, row in failures:
                values = ", ".join(f"{key} = {value}" for key, value in task.options["values"].items())
                texts.append(f"{task.name} ({values}): {row.reason}")
            if any(RunFolder(self.folder / task.name).read_failure() is not None for task, _ in failures):
                how = f"leave points whose scene fails out of the study's values, or change the scene; then {how}"
            if all(row.state == ELSEWHERE for _, row in failures):
                how = f"see their state with: emclutch sweep {self.section.path} --out {self.folder} --collect"
            several = f"{len(failures)} failed; " if len(failures) > 1 else ""
            texts.append(f"{done} of {number} points are done; {several}{how}")
            is_input = all(row.kind in (SCENE, FILES) for _, row in failures)
            raise (OutputError if is_input else RunError)("\n".join(texts))
        if self.stopped and done < number:
            more = f" --jobs {jobs}" if jobs and jobs > 1 else ""
            raise Interrupted(f"stopped with {done} of {number} points done; {how}{more}")

    def _is_done(self, task: Task) -> bool:
        return task.name in self.rows and self.rows[task.name].state == DONE

    def end(self) -> StudyState:
        """Write what is over all points as it is in the end, and return their state."""
        self.is_over = True
        self.write(at_once=True)
        self.write_page(at_once=True)
        return self.state()

    def state(self) -> StudyState:
        """Return the state of the points."""
        failures = {task.name: row.reason for task, row in self.failures()}
        points = {task.name: row for task, row in zip(self.tasks, self.table.rows, strict=True)}
        left = None if self.is_over else self.table.seconds_left()
        return StudyState(self.folder, self.section.title, points, failures, left, not self.is_over)

    def _write_page(self) -> None:
        with suppress(OSError):  # results meet the same disk, and are missed more
            write_index(state_report(self.state()))

    def _write(self) -> None:
        """Write tables and failures, as far as the study has come; an old table stays until there is a new row."""
        done = [(task.options["values"], self.rows[task.name].values) for task in self.tasks if self._is_done(task)]
        if done or not is_study(self.folder):
            write_tables(self.folder, self.section, done)
        failures = [(task, row) for task, row in self.failures() if row.state == FAILED]
        failed = [(task.name, task.options["values"], row.reason) for task, row in failures]
        write_failures(self.folder, failed)


class _StatusLog:
    """Progress of the accuracy studies that are run before the points."""

    def update(self, fraction: float, text: str) -> None:
        """Nothing: the table of points has not begun."""

    def status(self, text: str) -> None:
        log.info("%s", text)


class _PointProgress:
    """Progress of one point that runs in this process."""

    def __init__(self, study: _Sweep, number: int) -> None:
        self._study, self._number = study, number

    def update(self, fraction: float, text: str) -> None:
        self._study.table.set_fraction(self._number, fraction, text)
        self._study.write_page()

    def status(self, text: str) -> None:
        self._study.table.set_status(self._number, text)
