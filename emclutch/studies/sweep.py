"""A parameter study: every point is a run in a folder of its own; tables and pictures over all of them.

Points are tasks (`emclutch.studies.tasks`) that this process runs one after the other, or hands to an executor. It
alone writes the study's tables, now and then while it runs and at the end, in the study's order, so that they depend on
the points alone: not on how many run at a time, nor on which is done first. A part of a study, one process of many that
know nothing of each other, writes its points alone; `emclutch.studies.gather` makes the tables.
"""

from __future__ import annotations

import io
import logging
import threading
from collections.abc import Iterable
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from pathlib import Path

from emclutch.results import OutputError, RunFolder
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import LOCK, FolderInUse, has_files, locked_folder
from emclutch.results.history import last_time
from emclutch.results.lease import leased
from emclutch.results.measured_table import keep_measured
from emclutch.results.run_end import seconds_of
from emclutch.results.run_folder import logging_to
from emclutch.results.study_folder import is_study
from emclutch.results.study_table import DONE, FAILED, STOPPED, WAITING, StudyTable
from emclutch.results.torque_curves import best_of
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.replica_count import replica_count
from emclutch.scene.study import StudySection, read_study
from emclutch.simulation.pictures import draw_missing
from emclutch.studies.accuracy.target import cases_of
from emclutch.studies.adaptive import AdaptiveStudy
from emclutch.studies.dask_executor import SchedulerLost
from emclutch.studies.point_index import PointIndex, lease_of, part_folder
from emclutch.studies.points import PointFolder, can_resume, folders_of_points, is_done_now, unclaimed
from emclutch.studies.tables import DonePoint, label_of, write_failures, write_tables
from emclutch.studies.task_queue import TaskQueue
from emclutch.studies.tasks import STOP, PointOutcome, PointTask, run_leased_point, run_point
from emclutch.studies.throttle import Throttle
from emclutch.studies.workers import ctrl_c_sets, threads_of_a_worker, worker_pool

log = logging.getLogger(__name__)
LOGGERS = [__name__, "emclutch.studies.points", "emclutch.studies.adaptive"]
PAGE_SECONDS = 5.0  # between two writings of index.html: a browser loads it every ten


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
    part: tuple[int, int] | None = None,
    measured: str | Path | None = None,
) -> Path:
    """Run every point of a study, or a part of them, and return the study's folder.

    The folder holds point-000, point-001, ... (each a whole run), `study.csv` with a row a point, `study.log` with what
    became of each, `index.html`, a page of all of it that is rewritten while they run, and where they apply:
    `seeds.csv`, averages over `scene.seed`; `torque_vs_current.csv`, `.json` (linear range) and `.png` of a study over
    `coil.current` or `coil.voltage`; `torque_vs_speed.csv` and `.png` of one over constant `motion.rotor.speed`;
    `grain_size.csv`, `.json` (law and extrapolation) and `.png` of one over `particles.diameter` or `particles.sizes`
    in a sheared gap; `speeds.png` where shafts change their speed; `methods.csv` of one over
    `contact.method`.

    Parameters
    ----------
    study : a Study, or the path of a study file.
    out : folder; default: the next free studies/<name>-<nnn>.
    threads : of the kernels of each point's replicas; default: ``OMP_NUM_THREADS`` or all cores, shared out among
        `jobs` and replicas. Results do not depend on it.
    resume : keep the points that are done and continue the others from their checkpoints, also to a later time.end.
        A point is known by its values, so that values may be inserted, removed and put in another order; the folders
        keep their names, and new points get numbers that are free.
    jobs : points that run at a time, each in a process of its own with its replicas; 1, the default, runs all
        of them in this one. A script that asks for more must do so under ``if __name__ == "__main__":``. Results do not
        depend on it.
    executor : where points run instead: any `concurrent.futures.Executor`, of a cluster too, whose workers see the same
        file system, such as `emclutch.DaskExecutor`. It gets `jobs` points at a time, by default all; it is not shut
        down. Each point is run under a lease: a worker that gets one a second time waits for the first, and continues
        what that has left.
    progress : table of the points to keep up to date.
    force : run also points that need more memory than is free.
    part : which part of how many, e.g. (3, 40): points 3, 43, 83, ... counted from 1, one after the other in this
        process; the other parts are run by other processes or machines that see the folder, in any order and at any
        time. It writes no tables: `emclutch.gather` does. What became of its points is in ``parts/3-of-40``. With
        `resume` it may be the first to come. A point that another process is at work on is left to that one.

    measured : table of current [A] and torques [N m] to lay over the torque curve, as `read_measured` takes it
        (`emclutch.results.measured_table`); the folder keeps it as ``measured.csv``.

    Raises
    ------
    SceneError
        The study has faults, or no such part; a target of accuracy whose study is missing, in a part.
    OutputError, RunError
        At the end, where points have failed: with the values and the reason of each, which also lie in `failures.csv`.
        The other points are run all the same, and `resume` repeats those that failed. OutputError where all of them
        failed of their input or output. `Interrupted` after Ctrl-C: those that run end with a checkpoint.
    ValueError
        `jobs` is less than 1; a `part` is to have jobs, an executor or no folder.
    """
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs = {jobs}; allowed: 1 or more")
    if part is not None:
        if out is None or executor is not None or jobs not in (None, 1):
            raise ValueError(
                f"part = {part} needs a folder, out, that all parts have in common, and runs its points one after the "
                "other: leave jobs and executor out, and take more parts"
            )
        return _sweep_part(study, Path(out), threads, resume, progress, force, part)
    study = study if isinstance(study, StudySection) else read_study(study)
    folder = Path(out) if out is not None else RunFolder.next_path(study.path.stem, "studies")
    if resume and not folder.is_dir():  # before the lock makes it
        raise OutputError(f"nothing to resume in {folder}: there is no such folder; name the study's folder with --out")
    with locked_folder(folder):
        if not resume and has_files(folder):
            raise OutputError(f"{folder} is not empty; continue it with --resume, or write elsewhere with --out")
        (folder / STOP).unlink(missing_ok=True)
        if measured is not None:
            keep_measured(measured, folder)
        with logging_to(folder / "study.log", LOGGERS):
            share = 1 if executor is not None else jobs or 1
            table = progress or StudyTable(stream=io.StringIO())
            run = _StudyRun(study, folder, threads, share, resume, table, force, leases=executor is not None)
            try:
                if executor is None and share == 1:
                    run.here()
                elif executor is None:
                    while run.has_pending():  # a worker that was killed breaks its pool
                        with worker_pool(share) as workers:
                            run.by(workers, jobs)
                else:
                    run.by(executor, jobs)
                run.fail_what_waits_for_failed_points()
            finally:
                (folder / STOP).unlink(missing_ok=True)
                run.end()
        run.raise_failures(jobs)
    return folder


def _sweep_part(
    study: StudySection | str | Path,
    folder: Path,
    threads: int | None,
    resume: bool,
    progress: StudyTable | None,
    force: bool,
    part: tuple[int, int],
) -> Path:
    """Run the points of a part, see `sweep`. The study's folder is not locked: every point has a lease of its own."""
    study = study if isinstance(study, StudySection) else read_study(study, part=part)
    study.numbers_of(part)  # raises before a folder is made
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file; name a folder with --out")
    if (folder / STOP).exists():
        raise OutputError(f"{folder / STOP} asks the points of this study to stop; remove it if no sweep is stopping")
    home = part_folder(folder, part)
    try:
        home.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {home}: {error.strerror or error}; write elsewhere with --out") from error
    with logging_to(home / "study.log", LOGGERS):
        run = _PartRun(study, folder, threads, resume, progress or StudyTable(stream=io.StringIO()), force, part)
        try:
            run.here()
            run.fail_what_waits_for_failed_points()
        finally:
            run.end()
    run.raise_failures(None)
    return folder


class _StudyRun:
    """The points of a running study: which wait, which run, what became of them."""

    part: tuple[int, int] | None = None
    is_over = False

    def __init__(
        self,
        study: StudySection,
        folder: Path,
        threads: int | None,
        share: int,
        resume: bool,
        table: StudyTable,
        force: bool,
        leases: bool = False,
    ) -> None:
        self.leases = leases  # points are taken, and what lies there is judged, by whoever runs them
        self.study, self.folder, self.threads, self.resume, self.table = study, folder, threads, resume, table
        self.force = force
        self.share = share  # processes of this study on this machine
        numbers = None if self.part is None else study.numbers_of(self.part)
        self.home = folder if self.part is None else part_folder(folder, self.part)  # of log and failures
        self.points = list(cases_of(study, _StatusLog(), measure=numbers is None, numbers=numbers))
        self.asked = [case.scene.accuracy.target for _, case in study.cases(numbers)]
        before, cases = study.predecessors(), [case for _, case in self.points]
        self.index = index = PointIndex(folder, self.home)
        if numbers is None:
            self.targets, self.before = folders_of_points(folder, cases, fixed=study.values, index=index), before
            if others := unclaimed(folder, self.targets):
                log.info("of none of the study's points, and left as they are: %s", ", ".join(others))
        else:
            part = (numbers, len(before))
            self.targets = folders_of_points(folder, cases, fixed=study.values, part=part, index=index)
            places = {number: place for place, number in enumerate(numbers)}
            self.before = [None if (one := before[number]) is None else places[one] for number in numbers]
        write_failures(self.home, [])
        self.curve = AdaptiveStudy(study, folder) if study.is_adaptive else None
        self.waiting = list(range(len(self.points))) if self.curve is None else []
        self.done: dict[int, DonePoint] = {}
        self.failures: dict[int, PointOutcome] = {}
        self.stopped = False
        self.write, self.write_page = Throttle(self._write), Throttle(self._write_page, PAGE_SECONDS)
        table.begin(
            [label_of(study, values) or t.path.name for (values, _), t in zip(self.points, self.targets, strict=True)]
        )

    def here(self) -> None:
        """Run the points in this process, one after the other."""
        while not self.stopped and (new := self._next_task()):
            number, task = new
            self.table.set_running(number)
            self._take(number, run_point(task, _Part(self, number)))

    def by(self, executor: Executor, at_a_time: int | None) -> None:
        """Hand the points to an executor, so many `at_a_time`, and wait for them."""
        asked = threading.Event()
        queue = TaskQueue(executor, at_a_time, asked, self.folder / STOP)
        look_at_points = Throttle(lambda: self._look_at(queue.running.values()))

        def look() -> None:
            look_at_points()
            self.write_page()

        def take(number: int, future: Future[PointOutcome]) -> None:
            try:
                outcome = future.result()
            except BrokenExecutor:
                raise
            except Exception as error:  # for example in passing the task on
                outcome = PointOutcome(FAILED, f"{type(error).__name__}: {error}")
            self._take(number, outcome)

        def not_begun(number: int) -> None:
            self.waiting.insert(0, number)
            if asked.is_set():
                self.table.set_ended(number, STOPPED)

        try:
            with ctrl_c_sets(asked):
                function = run_leased_point if self.leases else run_point
                queue.hand_out(function, self._next_task, take, look, not_begun)
        except SchedulerLost as error:
            log.error("%s", error)
            for number in sorted(set(queue.running.values()) - set(self.done)):
                self.table.set_ended(number, STOPPED)
            raise RunError(
                f"{error}; {len(self.done)} of {len(self.points)} points are done; start it again, then "
                f"{self._how_to_go_on()} --dask {error.address}"
            ) from error
        except BrokenExecutor as error:
            log.error("a process of the study ended without a message: %s", error)
            reason = (
                "its process, or another one of the pool, ended without a message; it was killed, most often for want "
                "of memory, or the calling script lacks its if __name__ == '__main__'; take fewer --jobs"
            )
            for number in sorted(set(queue.running.values()) - set(self.done)):
                self._take(number, PointOutcome(FAILED, reason))
        finally:
            self.stopped |= queue.stopped

    def raise_failures(self, jobs: int | None) -> None:
        """Raise the failures of the points, or `Interrupted`; nothing where all points are done."""
        if self.failures:
            texts = []
            for number, failure in sorted(self.failures.items()):
                values = ", ".join(f"{key} = {value}" for key, value in self.points[number][0].items())
                texts.append(f"{self.targets[number].path.name} ({values}): {failure.message}")
            how = self._how_to_go_on()
            folders = (RunFolder(self.targets[number].path) for number in self.failures)
            if any(folder.read_failure() is not None for folder in folders):
                how = f"leave points whose scene fails out of the study's values, or change the scene; then {how}"
            number_failed = f"{len(self.failures)} failed; " if len(self.failures) > 1 else ""
            texts.append(f"{len(self.done)} of {len(self.points)} points are done; {number_failed}{how}")
            kind = OutputError if all(failure.is_input for failure in self.failures.values()) else RunError
            raise kind("\n".join(texts))
        if self.stopped:
            more = f" --jobs {jobs}" if jobs and jobs > 1 else ""
            raise Interrupted(
                f"stopped with {len(self.done)} of {len(self.points)} points done; {self._how_to_go_on()}{more}"
            )

    def has_pending(self) -> bool:
        """True if a pending point can run."""
        self._choose()
        return not self.stopped and any(self.before[n] is None or self.before[n] in self.done for n in self.waiting)

    def fail_what_waits_for_failed_points(self) -> None:
        """Points that begin with the grains of one that failed have failed too, until the study continues."""
        for number in [] if self.stopped else list(self.waiting):
            before = self.before[number]
            if before is not None and before in self.failures:
                self.waiting.remove(number)
                name = self.targets[before].path.name
                self._take(number, PointOutcome(FAILED, f"it begins with the grains of {name}, which has failed"))

    def _how_to_go_on(self) -> str:
        part = "" if self.part is None else f" --part {self.part[0]}/{self.part[1]}"
        return f"continue with: emclutch sweep {self.study.path}{part} --out {self.folder} --resume"

    def _next(self) -> int | None:
        """The first point that waits for no other one, taken off the list."""
        self._choose()
        for number in self.waiting:
            before = self.before[number]
            if before is None or before in self.done:
                self.waiting.remove(number)
                return number
        return None

    def _next_task(self) -> tuple[int, PointTask] | None:
        """The first point that waits for no other one and is not done, and its task."""
        while (number := self._next()) is not None:
            if (task := self._task(number)) is not None:
                return number, task
        return None

    def _choose(self) -> None:
        """Let an adaptive curve choose its next points, once those that it has chosen are done."""
        if self.curve is not None and not self.waiting and not self.stopped:
            try:
                self.waiting = self.curve.next_points(self.done, self.failures)
            except ValueError as error:
                raise RunError(f"the next points of the curve cannot be chosen: {error}") from error

    def _task(self, number: int) -> PointTask | None:
        """The task of a point; None where it is done already."""
        case, point, before = self.points[number][1], self.targets[number], self.before[number]
        if self.resume and point.is_done:
            point.refuse_changed_files(case)
            log.info("%s is done: kept", point.path.name)
            try:
                if draw_missing(RunFolder(point.path), case):
                    log.info("%s had no pictures: they are drawn", point.path.name)
            except OutputError as error:  # its numbers are there: no reason to end the study
                log.warning("%s has no pictures, and they cannot be drawn: %s", point.path.name, error)
            self._is_done(number, kept=True)
            return None
        resumed = not self.leases and can_resume(case, point.path, self.resume)
        start = None if before is None else str(self.targets[before].path.resolve())
        path = None if case.path is None else str(case.path.resolve())
        threads = self.threads
        if threads is None and self.share > 1:
            threads = threads_of_a_worker(self.share * replica_count(case.scene))
        return PointTask(
            case.data, path, case.trust_scripts, str(point.path.resolve()), threads, resumed, start, self.force,
            self.asked[number],
        )  # fmt: skip

    def _take(self, number: int, outcome: PointOutcome) -> None:
        if outcome.state == DONE:
            self._is_done(number)
        elif outcome.state == STOPPED:
            self.stopped = True
            self.table.set_ended(number, STOPPED)
        else:
            log.error("%s has failed: %s", self.targets[number].path.name, outcome.message)
            self.failures[number] = outcome
            self.table.set_ended(number, FAILED)
            self.write()
            self.write_page()

    def _is_done(self, number: int, kept: bool = False) -> None:
        (values, _), path = self.points[number], self.targets[number].path
        found = self.index.point(path)
        row = found.row
        torque, interval = best_of(row)
        self.table.set_done(number, torque, interval, row["seconds"], kept=kept, converged=row["converged"])
        if not kept:
            log.info("%s is done", path.name)
        self.done[number] = DonePoint(values, path, row, found.speeds_vary)
        self.write()
        self.write_page()

    def end(self) -> None:
        """Write what is over all points as it is in the end."""
        self.is_over = True
        self.write(at_once=True)
        self.write_page(at_once=True)

    def _write_page(self) -> None:
        from emclutch.results.report.render import write_index
        from emclutch.results.report.study_report import StudyState, state_report

        names = [target.path.name for target in self.targets]
        failures = {names[n]: self.failures[n].message for n in sorted(self.failures)}
        points = dict(zip(names, self.table.rows, strict=True))
        left = None if self.is_over else self.table.seconds_left()
        state = StudyState(self.folder, self.study.title, points, failures, left, not self.is_over)
        with suppress(OSError):  # results meet the same disk, and are missed more
            write_index(state_report(state))

    def _write(self) -> None:
        """Write tables and failures, as far as the study has come; an old table stays until there is a new row."""
        if self.done or not is_study(self.folder):
            write_tables(self.folder, self.study, [self.done[one] for one in sorted(self.done)])
        self._write_failures()

    def _write_failures(self) -> None:
        failed = [(self.targets[n].path.name, self.points[n][0], self.failures[n].message) for n in self.failures]
        write_failures(self.home, sorted(failed, key=lambda row: row[0]))

    def _look_at(self, numbers: Iterable[int]) -> None:
        """Show in the table how far points are that run elsewhere."""
        for number in numbers:
            folder = RunFolder(self.targets[number].path)
            if self.table.rows[number].state == WAITING:  # in an executor's queue
                if not (folder.path / LOCK).is_file():
                    continue
                self.table.set_running(number)
            reached = last_time(folder.history)
            end = seconds_of(self.points[number][1].scene.span.end, folder)
            if reached is not None and end is not None:
                self.table.set_fraction(number, reached / end)


class _PartRun(_StudyRun):
    """The points of a part of a study, in this process. Whatever runs beside it, it writes nothing that is not its own.

    A point is run under its lease (`emclutch.results.lease`), and what stands in its folder is looked at again when it
    is held: two equal parts, or two ways to part one study, divide the points among them.
    """

    def __init__(
        self,
        study: StudySection,
        folder: Path,
        threads: int | None,
        resume: bool,
        table: StudyTable,
        force: bool,
        part: tuple[int, int],
    ) -> None:
        self.part = part
        self.in_use: dict[int, PointOutcome] = {}
        super().__init__(study, folder, threads, 1, True, table, force)
        for values, case in self.points:
            if (target := case.scene.accuracy.target) is not None:
                message = (
                    "needs an accuracy study that no part runs; run it first, where all parts find it: "
                    f"emclutch accuracy {study.case_path} ({label_of(study, values)})"
                )
                raise SceneError([Fault("accuracy.target", f"{target}", message)], str(study.path))
        begun = [target.path.name for target in self.targets if target.path.is_dir() and has_files(target.path)]
        if begun and not resume:
            raise OutputError(f"{', '.join(begun)} in {folder} have begun; continue this part with --resume")

    def here(self) -> None:
        while not self.stopped and (number := self._next()) is not None:
            path, case = self.targets[number].path, self.points[number][1]
            try:
                with leased(lease_of(path), str(path)) as lease:
                    self.targets[number] = PointFolder(path, is_done_now(path, case, self.study.values))
                    if (task := self._task(number)) is not None:
                        self.table.set_running(number)
                        self._take(number, run_point(task, _Part(self, number), lease))
            except FolderInUse as error:
                log.warning("%s is left to another process: %s", path.name, error)
                self.in_use[number] = PointOutcome(FAILED, str(error), is_input=True)
                self.table.set_ended(number, FAILED)

    def raise_failures(self, jobs: int | None) -> None:
        self.failures |= self.in_use  # none of the point's: not in failures.csv
        super().raise_failures(jobs)

    def _write(self) -> None:
        """Write the failures alone: tables are of all parts, see `emclutch.gather`."""
        self._write_failures()

    def _write_page(self) -> None:
        """Write nothing: the page is of all parts, see `emclutch.gather`."""


class _StatusLog:
    """Progress of the accuracy studies that are run before the points."""

    def update(self, fraction: float, text: str) -> None:
        """Nothing: the table of points has not begun."""

    def status(self, text: str) -> None:
        log.info("%s", text)


class _Part:
    """Progress of one point that runs in this process."""

    def __init__(self, study: _StudyRun, number: int) -> None:
        self._study, self._number = study, number

    def update(self, fraction: float, text: str) -> None:
        self._study.table.set_fraction(self._number, fraction, text)
        self._study.write_page()

    def status(self, text: str) -> None:
        self._study.table.set_status(self._number, text)
