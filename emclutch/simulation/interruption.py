"""Ctrl-C while a run marches."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Any

from emclutch.simulation.kernel_compilation import Compiled


class interruptible:
    """Ctrl-C asks the loop to stop after its window; a second one stops at once.

    So does the first one while `at_once()` is true: before there is a window whose end could be waited for.
    KeyboardInterrupt is raised then. While a kernel is compiled, which may take a minute, the compiler raises it after
    its present pass (`kernel_compilation`): a callback of LLVM, where the signal may arrive, would lose it.
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
