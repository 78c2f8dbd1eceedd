"""Tasks of a study in their order, so many at a time, until they are done or the user stops."""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from emclutch.results.errors import RunError

LOOK_SECONDS = 0.5  # between two looks at the tasks that run


class TaskQueue:
    """Hands tasks to an executor, so many at a time (None: all), until they are done or the user stops."""

    def __init__(
        self, executor: Executor, jobs: int | None, asked: threading.Event, stop_file: Path | None = None
    ) -> None:
        self.executor, self.jobs, self.asked, self.stop_file = executor, jobs, asked, stop_file
        self.stopped = False
        self.running: dict[Future[Any], int] = {}

    def hand_out(
        self,
        function: Callable[[Any], Any],
        next_task: Callable[[], tuple[int, Any] | None],
        take: Callable[[int, Future[Any]], None],
        look: Callable[[], None] = lambda: None,
        not_begun: Callable[[int], None] = lambda number: None,
    ) -> None:
        """Do tasks, each with its number, until `next_task` returns None while none runs.

        `take` gets number and future of each that has ended, `not_begun` the number of each that the executor had not
        begun when the user stopped or when it broke; `look` is called now and then.
        """
        ended: SimpleQueue[Future[Any]] = SimpleQueue()  # to wait for all again each time is quadratic
        while True:
            ends = self.asked.is_set() or self.stopped
            while not ends and (self.jobs is None or len(self.running) < self.jobs) and (new := next_task()):
                try:
                    self.running[future := self.executor.submit(function, new[1])] = new[0]
                except BrokenExecutor:
                    not_begun(new[0])
                    raise
                future.add_done_callback(ended.put)
            if self.asked.is_set():
                self.stopped = True
                if self.stop_file is not None:
                    self.stop_file.touch()
            if ends:
                for future in [future for future in self.running if future.cancel()]:
                    not_begun(self.running.pop(future))
            if not self.running:
                return
            finished: list[Future[Any]] = []
            with suppress(Empty):
                finished.append(ended.get(timeout=LOOK_SECONDS))
                finished += [ended.get() for _ in range(ended.qsize())]
            for future in finished:
                if future in self.running:  # it may have been cancelled
                    take(self.running[future], future)
                    del self.running[future]
            look()

    def all(
        self,
        function: Callable[[Any], Any],
        tasks: Iterable[tuple[int, Any]],
        take: Callable[[int, Any], None],
        look: Callable[[], None] = lambda: None,
    ) -> None:
        """Do numbered tasks in their order; `take` gets number and outcome. RunError where a process was killed."""
        left = iter(tasks)
        try:
            self.hand_out(function, lambda: next(left, None), lambda number, task: take(number, task.result()), look)
        except BaseException as error:
            if self.stop_file is not None:
                self.stop_file.touch()
            wait(self.running)  # they end when the file is there
            if not isinstance(error, BrokenExecutor):
                raise
            raise RunError(
                "a process of the study ended without a message; it was killed, most often for want of memory, or the "
                "calling script lacks its if __name__ == '__main__'; continue with --resume, and fewer --jobs"
            ) from error


class InThisProcess(Executor):
    """Executor that does a task in this process, at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **more: Any) -> Future[Any]:
        """Return the finished future."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **more))
        return future


def makespan(seconds: Sequence[float], jobs: int) -> float:
    """Return the time until tasks are done that are begun in this order [s], `jobs` at a time."""
    ends = [0.0] * max(1, jobs)
    for one in seconds:
        heapq.heappush(ends, heapq.heappop(ends) + one)
    return max(ends)


def update_progress(progress: Any, fraction: float, text: str | None) -> None:
    """Update a progress, or None, by the fraction that is done; without a text the last one stays."""
    if progress is not None:
        progress.update(fraction, text)


def log_progress(progress: Any, text: str) -> None:
    """Print a line by a progress that has a log."""
    if (log := getattr(progress, "log", None)) is not None:
        log(text)
