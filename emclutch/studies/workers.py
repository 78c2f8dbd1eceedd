"""Processes of this machine that run the points of a study."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from geometry.kernels.threads import default_threads


def worker_pool(jobs: int) -> ProcessPoolExecutor:
    """A pool of so many processes, each begun afresh: a fork of one with compiled kernels and threads may hang."""
    return ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=begin_worker)


def begin_worker() -> None:
    """Initialiser of a process of the pool."""
    leave_ctrl_c_to_the_study()
    threading.Thread(target=end_with_the_study, name="end with the study", daemon=True).start()


def end_with_the_study() -> None:
    """End this process when the one that started it does not live any more.

    A pool does not do so: without this its processes would continue, hold their points' folders, and then wait for
    ever. The points continue from their checkpoints.
    """
    study = multiprocessing.parent_process()
    if study is not None:
        study.join()
        os._exit(1)


def threads_of_a_worker(processes: int) -> int:
    """Threads of each of so many processes, where none are asked for: ``OMP_NUM_THREADS`` or all cores, shared out."""
    import numba

    available: int = getattr(numba.config, "NUMBA_NUM_THREADS")  # noqa: B009 (numba's stubs hide it)
    return max(1, default_threads(available) // processes)


def leave_ctrl_c_to_the_study() -> None:
    """Ignore Ctrl-C, which a terminal sends to all its processes: the study asks its points to stop (`study_tasks`).

    While a point runs, `emclutch.simulation.run` answers the signal itself, with a checkpoint.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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
