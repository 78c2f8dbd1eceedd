"""Ctrl-C while a run marches."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Any


class interruptible:
    """Ctrl-C asks the loop to stop after its window; a second one stops at once.

    So does the first one while `at_once()` is true: before there is a window whose end could be waited for, and while a
    kernel is compiled, which may take a minute. KeyboardInterrupt is raised then; where a callback of the compiler
    loses it, the loop still stops after its window.
    """

    def __init__(self, stop: threading.Event, at_once: Callable[[], bool] = lambda: False):
        self._stop, self._at_once = stop, at_once
        self._former: Any = None

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            self._former = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, number, frame):
        again = self._stop.is_set()
        self._stop.set()
        if again or self._at_once():
            raise KeyboardInterrupt

    def __exit__(self, *error):
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)
