"""Time that a run has left, by the pace of its own windows: simulated time over wall-clock time, without constants."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from math import sqrt
from typing import TYPE_CHECKING

from emclutch.simulation.forecast.cost import Cost, spoken
from geometry.kernels.cache import compile_seconds

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow

SHARES = (0.01, 0.1)  # of the run, after which the time left is announced; the second corrects the first
WINDOWS, MIN_S = 6, 5.0  # and seconds, that must have passed
LONG, BEHIND = 60.0, 2.0  # s: less is not worth a line; times as long as estimated, from which on it is a warning
BUSY = 0.7  # of the cores that its threads use, or fewer: other programs take them


class RunPace:
    """Callback of the loop that announces how long the run has to go, should it continue like the windows so far.

    The pace is that of the later half of them: in the first ones grains have not met yet, and the field is solved more
    often.

    Parameters
    ----------
    cost : Cost
        Estimated before the run.
    begin : float
        Simulated time [s] at which this process takes the run up.
    announce : callable
        Takes the text, and the level for the log: a warning where the run takes longer than estimated by `BEHIND`.
    """

    def __init__(self, cost: Cost, begin: float, announce: Callable[[str, int], None]) -> None:
        self._cost, self._announce, self._due = cost, announce, [*SHARES]
        self._readings = [(begin, *_clocks())]

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        if not self._due:
            return
        self._readings.append((row.time, *_clocks()))
        now, wall, _ = (late - first for late, first in zip(self._readings[-1], self._readings[0], strict=True))
        if now >= self._due[0] * self._cost.end and len(self._readings) > WINDOWS and wall >= MIN_S:
            self._due = [share for share in self._due if now < share * self._cost.end]
            self._say()

    def left(self) -> tuple[float, float]:
        """Return the seconds left of this round, and the cores that this process has had."""
        middle, last = self._readings[len(self._readings) // 2], self._readings[-1]
        passed, wall, processor = (late - early for late, early in zip(last, middle, strict=True))
        return (self._cost.end - last[0]) * wall / passed, processor / max(wall, 1e-9)

    def _say(self) -> None:
        seconds, cores = self.left()
        estimated = self._cost.until(self._cost.end) - self._cost.until(self._readings[-1][0])
        if seconds <= LONG:
            return
        slow = seconds > BEHIND * estimated
        text = f"about {spoken(seconds)} left, by the pace of the windows so far"
        if slow:
            text += f": {seconds / max(estimated, 1e-9):.1f} times as long as estimated before the run"
            text += "; other programs take the cores" if cores < BUSY * sqrt(self._cost.threads) else ""
        self._announce(text, logging.WARNING if slow else logging.INFO)


def _clocks() -> tuple[float, float]:
    """Return the wall clock without what compiling took, and the processor's [s]."""
    return time.perf_counter() - compile_seconds(), time.process_time()
