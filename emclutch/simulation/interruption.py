"""Ctrl-C while a run marches."""

from __future__ import annotations

import signal
import threading
from typing import Any


class interruptible:
    """Ctrl-C asks the loop to stop after its window; a second one stops at once."""

    def __init__(self, stop: threading.Event):
        self._stop = stop
        self._former: Any = None

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            self._former = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, number, frame):
        if self._stop.is_set():
            raise KeyboardInterrupt
        self._stop.set()

    def __exit__(self, *error):
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)
