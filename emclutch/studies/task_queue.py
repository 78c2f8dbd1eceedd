"""Tasks of a study in their order, so many at a time, until they are done or the user stops."""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from pathlib import Path
from typing import Any

from emclutch.results.errors import RunError

LOOK_SECONDS = 0.5


class TaskQueue:
    """Hands tasks to an executor, so many at a time, until they are done or the user stops."""

    def __init__(self, executor: Executor, jobs: int, asked: threading.Event) -> None:
        self.executor, self.jobs, self.asked = executor, jobs, asked
        self.stop_file: Path | None = None
        self.stopped = False

    def all(
        self,
        function: Callable[[Any], Any],
        tasks: Sequence[Any],
        take: Callable[[int, Any], None],
        may_begin: Callable[[int], bool] = lambda number: True,
        look: Callable[[Sequence[int]], None] = lambda numbers: None,
    ) -> None:
        """Do the tasks in their order; `take` gets number and outcome of each. `may_begin` false ends the series."""
        waiting = list(range(len(tasks)))
        running: dict[Future[Any], int] = {}
        try:
            while True:
                while waiting and len(running) < self.jobs and not (self.asked.is_set() or self.stopped):
                    if not may_begin(waiting[0]):
                        waiting.clear()
                        break
                    number = waiting.pop(0)
                    running[self.executor.submit(function, tasks[number])] = number
                if self.asked.is_set():
                    self.stopped = True
                    if self.stop_file is not None:
                        self.stop_file.touch()
                if not running:
                    return
                for future in wait(running, LOOK_SECONDS, FIRST_COMPLETED).done:
                    take(running.pop(future), future.result())
                look(list(running.values()))
        except BaseException as error:
            if self.stop_file is not None:
                self.stop_file.touch()
            wait(running)  # they end at the sight of the file
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


def tell(progress: Any, fraction: float, text: str | None) -> None:
    """Tell a progress, or None, how much is done; without a text the last one stays."""
    if progress is not None:
        progress.update(fraction, text)


def note(progress: Any, text: str) -> None:
    """Tell a progress that takes notes what a study is going to do."""
    take = getattr(progress, "note", None)
    if take is not None:
        take(text)
