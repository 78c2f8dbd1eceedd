"""Limit the time that a study spends on rewriting the files over all of its points."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

MAX_FRACTION = 0.05
"""Largest fraction of the wall-clock time that is spent on writing."""


class Throttle:
    """Calls an action at most so often that it takes `MAX_FRACTION` of the wall-clock time.

    Parameters
    ----------
    action : function to call.
    pause : least time between the end of a call and the next one [s].
    """

    def __init__(self, action: Callable[[], None], pause: float = 0.0) -> None:
        self._action, self._pause = action, pause
        self._next = -float("inf")

    def __call__(self, at_once: bool = False) -> None:
        """Call the action if it is due, or `at_once`."""
        began = monotonic()
        if at_once or began >= self._next:
            self._action()
            ended = monotonic()
            self._next = ended + max(self._pause, (ended - began) * (1.0 / MAX_FRACTION - 1.0))
