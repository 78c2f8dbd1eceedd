"""Files over all points of a study, rewritten while it runs, but seldom: each time costs more with more points."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

SHARE = 0.05
"""Of the time that passes, which the writing of files over all points may take."""


class Renewal:
    """Does what takes long so seldom that it takes a twentieth of the time, and whenever it must be done.

    Parameters
    ----------
    action : what is done.
    pause : least time between the end of one and the begin of the next [s].
    """

    def __init__(self, action: Callable[[], None], pause: float = 0.0) -> None:
        self._action, self._pause = action, pause
        self._next = -float("inf")

    def __call__(self, at_once: bool = False) -> None:
        """Do it if it is due, or `at_once`."""
        began = monotonic()
        if at_once or began >= self._next:
            self._action()
            ended = monotonic()
            self._next = ended + max(self._pause, (ended - began) * (1.0 / SHARE - 1.0))
