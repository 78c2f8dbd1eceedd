"""A study: a folder, the tasks that are done in it, and a row of each.

A task is a scene and what is measured on it. It is done in this process, in child processes, or on the workers of an
executor on other machines; all that these share with the study is its folder. The row of a task lies in its folder as
``row.json``: it tells what is done from what is to be done again, so that a study continues after it was stopped or
killed, by any number of processes. Two processes never have one task's folder (`emclutch.studies.attempt`).
"""

from __future__ import annotations

import hashlib
import json
import logging
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from emclutch.results.atomic_file import json_values, replace_json
from emclutch.results.errors import Interrupted, OutputError, RunError
from emclutch.results.folder_lock import has_files, locked_folder
from emclutch.results.run_folder import logging_to
from emclutch.results.study_table import DONE, FAILED, STOPPED
from emclutch.scene.case import Case
from emclutch.scene.errors import SceneError
from emclutch.scene.replica_count import cores_at_hand
from emclutch.simulation.forecast.space import NotEnoughSpace
from emclutch.studies.attempt import TakenOver, attempt, attempts_in, refuse_taken_over
from emclutch.studies.task_process import ChildProcesses, TaskProcessEnded, call_of, perform_call, result_of

log = logging.getLogger(__name__)
ROW, STOP = "row.json", "stop-asked"
LOOK_SECONDS = 0.5  # between two looks at the tasks that run
STOP_SECONDS = 0.2  # between two looks for the file that asks to stop: windows may be shorter, file systems far away
GRACE = 4.0
"""Seconds that children have to end with a checkpoint once Ctrl-C was pressed; the last one is a minute old at most."""
ELSEWHERE = "elsewhere"
"""State of a task that another process has taken over."""
SCENE, FILES, RUN, MACHINE, PROGRAM = "scene", "files", "run", "machine", "program"
"""What a task has failed of: input, files, the run itself, what the machine lacks now, or a defect."""


class Task(NamedTuple):
    """One thing that a study measures.

    Attributes
    ----------
    name : str
        Of its folder, below that of the study.
    case : Case
    measure : callable
        Function of a module: takes the task, the `Path` of its folder and a `TaskProgress`, and returns the values of
        the row. It continues what it finds in the folder.
    options : dict of str to Any
        Of `measure`, in plain values.
    after : str
        Name of the task that has to be done first; empty: none.
    digest : str
        Of all that the row depends on, where that may change between two calls: a row of another digest is not kept.
    product : str
        File in the folder that the row is of, which may be continued alone; empty: none.
    """

    name: str
    case: Case
    measure: Callable[[Task, Path, TaskProgress], dict[str, Any]]
    options: dict[str, Any] = {}
    after: str = ""
    digest: str = ""
    product: str = ""

    def row(self, folder: Path) -> Row | None:
        """Return the row in the folder of the task; None where it has none, or one that is not of what lies there."""
        row = read_row(folder)
        if row is None or row.digest != self.digest:
            return None
        return None if row.state == DONE and row.product != self.product_in(folder) else row

    def is_done(self, folder: Path) -> bool:
        """Return True if the task is done in a folder."""
        row = self.row(folder)
        return row is not None and row.state == DONE

    def product_in(self, folder: Path) -> str:
        """Return a digest of the file that the row is of; empty where there is none."""
        try:
            return hashlib.sha256((folder / self.product).read_bytes()).hexdigest()[:16] if self.product else ""
        except OSError:
            return ""


@dataclass(frozen=True, slots=True)
class Row:
    """Outcome of a task.

    Attributes
    ----------
    state : str
        DONE, FAILED, STOPPED or ELSEWHERE.
    values : dict of str to Any
        What was measured, by name.
    reason : str
        Why there are no values, with the remedy.
    kind : str
        Of the reason: SCENE, FILES, RUN, MACHINE or PROGRAM.
    digest : str
        That of the task.
    product : str
        Digest of the file that the row is of.
    seconds, wall : float
        Processor time and wall-clock time of the process that has ended it [s].
    """

    state: str
    values: dict[str, Any] = field(default_factory=dict)
    reason: str = ""
    kind: str = ""
    digest: str = ""
    product: str = ""
    seconds: float = 0.0
    wall: float = 0.0

    @property
    def short_reason(self) -> str:
        """Return the reason on one line, without the place of the log."""
        return " ".join(self.reason.split("\n(log:")[0].split())

    def write(self, folder: Path) -> None:
        """Write it to the folder of its task."""
        replace_json(folder / ROW, {one.name: getattr(self, one.name) for one in fields(self)})


def read_row(folder: Path) -> Row | None:
    """Return the row in the folder of a task; None where it has none, or a damaged one, which is rebuilt."""
    path = folder / ROW
    try:
        return Row(**json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_shared_names))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, TypeError) as error:
        log.warning("cannot read %s, which is rebuilt: %s", path, error)
        return None


def _shared_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    return {sys.intern(name): value for name, value in pairs}  # those of thousands of rows


class TaskProgress:
    """Progress of a task, and whether the study is to stop.

    Parameters
    ----------
    study : Path
        Folder of the study, in which a file asks to stop.
    folder : Path
        Of the attempt.
    progress : notified of the run's progress, or None.
    """

    def __init__(self, study: Path, folder: Path, progress: Any = None) -> None:
        self._file, self._folder, self._progress = study / STOP, folder, progress
        self._last_poll, self._asked = -STOP_SECONDS, False

    @property
    def stop_asked(self) -> bool:
        """True once the study is to stop; `TakenOver` where another process continues this task."""
        now = time.monotonic()
        if not self._asked and now - self._last_poll >= STOP_SECONDS:
            self._asked, self._last_poll = self._file.exists(), now
            refuse_taken_over(self._folder)
        return self._asked

    def update(self, fraction: float, text: str) -> None:
        """See `emclutch.results.progress.Progress`."""
        if self._progress is not None:
            self._progress.update(fraction, text)

    def status(self, text: str) -> None:
        """See `emclutch.results.progress.Progress`."""
        if (status := getattr(self._progress, "status", None)) is not None:
            status(text)


def perform(task: Task, study: Path, progress: Any = None) -> Row:
    """Do a task in a folder of a study, unless it is done, and return its row; what it fails of is in the row."""
    folder = study / task.name
    if (study / STOP).exists():
        return Row(STOPPED)
    try:
        with attempt(folder, task.is_done) as own:
            row = _measured(task, study, own, progress)
            if row.state in (DONE, FAILED):
                row.write(own)
            return row
    except TakenOver as error:
        return Row(ELSEWHERE, reason=str(error))
    except OutputError as error:
        return Row(FAILED, reason=str(error), kind=FILES)
    except OSError as error:  # of the row itself
        reason = f"cannot write to {folder}: {error.strerror or error}; free disk space or fix the permissions"
        return Row(FAILED, reason=reason, kind=FILES)


def _measured(task: Task, study: Path, own: Path, progress: Any) -> Row:
    begin = time.process_time(), time.perf_counter()
    if (known := task.row(own)) is not None and known.state == DONE:
        return known  # another process has done it meanwhile
    (own / ROW).unlink(missing_ok=True)  # of a failure, or of another end
    values, reason, kind = {}, "", ""
    try:
        values = json_values(task.measure(task, own, TaskProgress(study, own, progress)))  # as they are read again
    except (Interrupted, KeyboardInterrupt):
        return Row(STOPPED)
    except TakenOver:
        raise
    except SceneError as error:
        reason, kind = error.report(), SCENE
    except OutputError as error:
        reason, kind = str(error), FILES
    except OSError as error:
        reason = f"{error.filename or own}: {error.strerror or error}; check the path, its permissions and free space"
        kind = FILES
    except RunError as error:
        reason, kind = str(error), MACHINE if isinstance(error.__cause__, NotEnoughSpace) else RUN
    except Exception as error:
        log.exception("%s: defect of the program", task.name)
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        reason = f"defect of the program, please report it: {type(error).__name__}: {error} ({place})"
        kind = PROGRAM
    refuse_taken_over(own)
    reason = reason.replace(str(own), str(study / task.name))  # where it lies from now on
    spent = time.process_time() - begin[0], time.perf_counter() - begin[1]
    return Row(FAILED if kind else DONE, values, reason, kind, task.digest, task.product_in(own), *spent)


def checked_jobs(jobs: int | None) -> int:
    """Return the number of tasks that run at a time, by default one for each core; ValueError below 1."""
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs = {jobs}; allowed: 1 or more")
    return cores_at_hand() if jobs is None else jobs


@contextmanager
def child_processes(jobs: int) -> Iterator[Executor | None]:
    """Yield an executor for so many tasks at a time, each in a child process; None for one, which this process does."""
    if jobs == 1:
        yield None
        return
    with ChildProcesses(jobs) as executor:
        try:
            yield executor
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            executor.children.end()


def call_all(executor: Executor | None, function: Callable[[Any], Any], arguments: Iterable[Any]) -> Iterator[Any]:
    """Yield the results of a function of a module in the order of its arguments, as many at a time as there is room."""
    if executor is None:
        yield from map(function, arguments)
    else:
        futures = [executor.submit(perform_call, call_of(function, one)) for one in arguments]
        yield from (result_of(future.result()) for future in futures)


class Study:
    """A folder with tasks that are done, or are to be done.

    Parameters
    ----------
    folder : Path
    executor : concurrent.futures.Executor or None
        Where tasks are done, each in a child process of a worker; None: in this process.
    at_a_time : int or None
        Tasks that the executor gets at a time; None: all.

    Attributes
    ----------
    rows : dict of str to Row
        Of the tasks that have ended, by name.
    stopped : bool
        Whether the user has stopped it.
    """

    def __init__(self, folder: Path, executor: Executor | None = None, at_a_time: int | None = None) -> None:
        self.folder, self.executor, self.at_a_time = folder, executor, at_a_time
        self.rows: dict[str, Row] = {}
        self.stopped = False
        self._put_off: set[str] = set()  # tasks that others may be at
        self._asked = threading.Event()
        self._last = inf  # moment at which children that are to stop are ended

    # what a kind of study adds -------------------------------------------------------------------------------------

    def begun(self, task: Task) -> None:
        """Note that a task begins, or waits in the executor's queue."""

    def ended(self, task: Task, row: Row, kept: bool) -> None:
        """Note that a task has ended; `kept`: before this call."""

    def look(self, running: Sequence[Task]) -> None:
        """Look at tasks that run, twice a second."""

    def progress_of(self, task: Task) -> Any:
        """Return the progress of a task in this process, as of `emclutch.run`."""
        return None

    def may_begin(self, task: Task) -> bool:
        """Return False where neither this task nor a later one is to begin."""
        return True

    def keeps(self, row: Row) -> bool:
        """Return True where a task with such a row is not done again."""
        return row.state == DONE

    # what all of them do -------------------------------------------------------------------------------------------

    @contextmanager
    def opened(self, resume: bool, loggers: Sequence[str] = ("emclutch.studies",)) -> Iterator[None]:
        """Hold the folder, with ``study.log``, inside a ``with`` block; Ctrl-C stops the tasks, a second one at once.

        Raises
        ------
        OutputError
            It is in use, or it is not empty and is not to be resumed.
        """
        with locked_folder(self.folder):
            if not resume and has_files(self.folder):
                how = "continue it with --resume, or write elsewhere with --out"
                raise OutputError(f"{self.folder} is not empty; {how}")
            (self.folder / STOP).unlink(missing_ok=True)
            with logging_to(self.folder / "study.log", loggers), ctrl_c_sets(self._asked):
                try:
                    yield
                finally:
                    (self.folder / STOP).unlink(missing_ok=True)

    def run(self, tasks: Sequence[Task]) -> None:
        """Do tasks in their order, as many at a time as there is room for; those that are done are kept.

        What killed or other processes have begun comes last: they may be at work on it.

        Raises
        ------
        RunError
            The executor has broken.
        """
        waiting = []
        for task in {task.name: task for task in tasks}.values():
            row = task.row(self.folder / task.name)
            if row is not None and self.keeps(row):
                self._end(task, row, kept=True)
            else:
                waiting.append(task)
        running: dict[Future[Any], Task] = {}
        try:
            self._do(waiting, running)
        except BaseException as error:
            if self.executor is not None:
                (self.folder / STOP).touch()
            if not isinstance(error, (BrokenExecutor, CancelledError)):
                raise
            done = sum(row.state == DONE for row in self.rows.values())
            why = str(error) or type(error).__name__
            raise RunError(
                f"the executor has lost its workers or its scheduler ({why}); {done} tasks are done; start it again, "
                "then continue with --resume"
            ) from error
        for task in [one for one in tasks if self._state(one.name) == ELSEWHERE]:
            row = task.row(self.folder / task.name)
            if row is not None and self.keeps(row):
                self._end(task, row, kept=True)

    def _do(self, waiting: list[Task], running: dict[Future[Any], Task]) -> None:
        finished: SimpleQueue[Future[Any]] = SimpleQueue()  # to wait for all again each time is quadratic
        while True:
            stops = self._asked.is_set() or self.stopped
            while not stops and self._has_room(running) and (task := self._next(waiting)) is not None:
                self.begun(task)
                future = self._submitted(task)
                running[future] = task
                future.add_done_callback(finished.put)
                if self.executor is None:
                    break  # it has ended
            if self._asked.is_set():
                self._stop()
            if stops:
                begun = self.attempts_at(running.values())
                for future, task in [*running.items()]:
                    if task.name not in begun and future.cancel():  # what has begun looks for the file
                        self._end(running.pop(future), Row(STOPPED))
            if not running:
                return
            ended: list[Future[Any]] = []
            with suppress(Empty):
                ended.append(finished.get(timeout=LOOK_SECONDS))
                ended += [finished.get() for _ in range(finished.qsize())]
            for future in ended:
                if future in running:  # it may have been cancelled
                    task = running.pop(future)
                    self._end(task, self._row_of(task, future))
            self.look([*running.values()])

    def _stop(self) -> None:
        """Stop what runs: elsewhere by a file, in children at once, or after `GRACE` by their end."""
        self.stopped = True
        if self.executor is not None:
            (self.folder / STOP).touch()
        if isinstance(self.executor, ChildProcesses):
            if self._last == inf:
                self._last = time.monotonic() + GRACE
                self.executor.children.interrupt()
            elif time.monotonic() > self._last:
                self.executor.children.end()

    def attempts_at(self, tasks: Iterable[Task]) -> dict[str, Path]:
        """Return the folders in which processes are, or were, at work on tasks, by the tasks' names."""
        found: dict[str, Path] = {}
        for home in {Path(task.name).parent for task in tasks}:
            found |= {str(home / name): paths[0] for name, paths in attempts_in(self.folder / home).items()}
        return found

    def _has_room(self, running: dict[Future[Any], Task]) -> bool:
        return self.at_a_time is None or len(running) < self.at_a_time

    def _next(self, waiting: list[Task]) -> Task | None:
        """Take the next task whose predecessor is done off the list; those whose predecessor has failed fail."""
        place, begun = 0, attempts_in(self.folder)
        while place < len(waiting):
            task = waiting[place]
            before = self._state(task.after) if task.after else DONE
            if before == FAILED:
                del waiting[place]
                self._end(task, Row(FAILED, reason=f"it begins with the grains of {task.after}, which has failed"))
            elif before != DONE:
                place += 1
            elif task.name in begun and task.name not in self._put_off:
                self._put_off.add(task.name)
                waiting.append(waiting.pop(place))
            else:
                return waiting.pop(place) if self.may_begin(task) else None
        return None

    def _state(self, name: str) -> str:
        return self.rows[name].state if name in self.rows else ""

    def _submitted(self, task: Task) -> Future[Any]:
        if self.executor is not None:
            return self.executor.submit(perform_call, call_of(perform, task, self.folder.resolve()))
        future: Future[Any] = Future()
        future.set_result(perform(task, self.folder, self.progress_of(task)))
        return future

    def _row_of(self, task: Task, future: Future[Any]) -> Row:
        try:
            found: Row = future.result() if self.executor is None else result_of(future.result())
            return found
        except (BrokenExecutor, CancelledError):
            raise
        except TaskProcessEnded as error:
            if self.stopped:
                return Row(STOPPED)
            reason = f"{error}; take fewer at a time, or a machine with more"
        except Exception as error:  # in passing the task on
            reason = f"{type(error).__name__}: {error}"
        row = Row(FAILED, reason=reason, kind=MACHINE, digest=task.digest)
        with suppress(OutputError), attempt(self.folder / task.name, task.is_done) as own:
            row.write(own)
        return row

    def _end(self, task: Task, row: Row, kept: bool = False) -> None:
        self.rows[task.name] = row
        self.stopped |= row.state == STOPPED
        if row.state == FAILED and not kept:
            log.error("%s has failed: %s", task.name, row.reason)
        elif not kept:
            log.info("%s is %s", task.name, row.state)
        self.ended(task, row, kept)


@contextmanager
def ctrl_c_sets(asked: threading.Event) -> Iterator[None]:
    """Ctrl-C sets an event inside a ``with`` block; a second one stops at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ask(number: int, frame: Any) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    former = signal.signal(signal.SIGINT, ask)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)
