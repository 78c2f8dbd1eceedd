"""Report of kernels that are compiled while a run waits, and their compile time; Ctrl-C, also while one is compiled."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

from numba.core import event as numba_event

SLOW = {"particles.dem.step_kernel": "the DEM step", "particles.dvi.step_kernel": "the DVI step"}
"""What is compiled for some half a minute: module and name."""

ONCE = "first run only, 0.5 to 5 min"


@dataclass
class Compiled:
    """Kernels that were compiled, not read from the cache.

    Attributes
    ----------
    count : int
        Specialisations, without the functions that were compiled into them.
    seconds : float
        Wall-clock time that it took [s].
    is_going_on : bool
        Whether one is being compiled now.
    stop_asked : bool
        Raise KeyboardInterrupt after the compiler's present pass.
    """

    count: int = 0
    seconds: float = 0.0
    is_going_on: bool = False
    stop_asked: bool = False


@dataclass
class _Listener(numba_event.Listener):
    report: Callable[[str], None]
    compiled: Compiled = field(default_factory=Compiled)
    _depth: int = 0
    _begin: float = 0.0
    _has_reported: bool = False

    def on_start(self, event: numba_event.Event) -> None:
        self._depth += 1
        self.compiled.is_going_on = True
        if self._depth > 1:
            return
        self._begin = perf_counter()
        module = event.data["dispatcher"].py_func.__module__
        if module in SLOW:
            self.report(f"Compiling {SLOW[module]} ({ONCE})")
        elif not self._has_reported:
            self._has_reported = True
            self.report(f"Compiling kernels ({ONCE})")

    def on_end(self, event: numba_event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.compiled.is_going_on = False
            self.compiled.count += 1
            self.compiled.seconds += perf_counter() - self._begin


@dataclass
class _StopAfterPass(numba_event.Listener):
    compiled: Compiled

    def on_start(self, event: numba_event.Event) -> None:
        pass

    def on_end(self, event: numba_event.Event) -> None:
        if self.compiled.stop_asked:
            self.compiled.stop_asked = False
            raise KeyboardInterrupt


@contextmanager
def reported_compilation(report: Callable[[str], None]) -> Iterator[Compiled]:
    """Call ``report`` with a line when a kernel is not in the cache; yields what has been compiled so far."""
    listener = _Listener(report)
    stop = _StopAfterPass(listener.compiled)
    with (
        numba_event.install_listener("numba:compile", listener),
        numba_event.install_listener("numba:run_pass", stop),
    ):
        yield listener.compiled


class interruptible:
    """Ctrl-C asks the loop to stop after its window; a second one stops at once.

    So does the first one while `at_once()` is true: before there is a window whose end could be waited for.
    KeyboardInterrupt is raised then. While a kernel is compiled, which may take a minute, the compiler raises it after
    its present pass: a callback of LLVM, where the signal may arrive, would lose it.
    """

    def __init__(
        self, stop: threading.Event, at_once: Callable[[], bool] = lambda: False, compiled: Compiled | None = None
    ):
        self._stop, self._at_once, self._compiled = stop, at_once, compiled or Compiled()
        self._former: Any = None

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            self._former = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, number, frame):
        again = self._stop.is_set()
        self._stop.set()
        if self._compiled.is_going_on:
            self._compiled.stop_asked = True
        elif again or self._at_once():
            raise KeyboardInterrupt

    def __exit__(self, *error):
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)
