"""Report of kernels that are compiled while a run waits, and their compile time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

from numba.core import event as numba_event

SLOW = {"particles.dem.step_kernel": "the grains' step (DEM)", "particles.dvi.step_kernel": "the grains' step (DVI)"}
"""What is compiled for some half a minute: module and name."""

ONCE = "once, half a minute, some minutes on a slow machine"


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
    announce: Callable[[str], None]
    compiled: Compiled = field(default_factory=Compiled)
    _depth: int = 0
    _begin: float = 0.0
    _announced: bool = False

    def on_start(self, event: numba_event.Event) -> None:
        self._depth += 1
        self.compiled.is_going_on = True
        if self._depth > 1:
            return
        self._begin = perf_counter()
        module = event.data["dispatcher"].py_func.__module__
        if module in SLOW:
            self.announce(f"compiling {SLOW[module]}, {ONCE}")
        elif not self._announced:
            self._announced = True
            self.announce("compiling kernels, once for each kind of scene, some minutes on a slow machine")

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
def announced_compilation(announce: Callable[[str], None]) -> Iterator[Compiled]:
    """Call ``announce`` with a line when a kernel is not in the cache; yields what has been compiled so far."""
    listener = _Listener(announce)
    stop = _StopAfterPass(listener.compiled)
    with (
        numba_event.install_listener("numba:compile", listener),
        numba_event.install_listener("numba:run_pass", stop),
    ):
        yield listener.compiled
