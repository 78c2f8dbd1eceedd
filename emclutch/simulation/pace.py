"""Time that a run has left, by the pace of its own windows, set against what was estimated before it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from math import sqrt
from typing import TYPE_CHECKING

from emclutch.results.time_left import TimeLeft
from emclutch.simulation.forecast.cost import Cost, format_rough_time

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow

SHARES = (0.05, 0.1)  # of the run, done by this process: the time left is reported then, and corrected; before, a busy
# machine or the first contacts make the pace one of chance
WINDOWS, MIN_S = 6, 5.0  # and seconds, that must have passed
LONG, BEHIND = 60.0, 2.0  # s: less is not worth a line; times as long as estimated, from which on it is a warning
BUSY = 0.7  # of the cores that its threads use, or fewer: other programs take them


class RunPace:
    """Callback of the loop that reports how long the run has to go, should it continue like the windows so far.

    Parameters
    ----------
    cost : Cost
        Estimated before the run.
    share : callable
        Fraction of the run that is done, of all replicas, when this one has come to a time [s]; the progress bar shows
        the same.
    begin : float
        Simulated time [s] at which this process takes the run up.
    report : callable
        Takes the text, and the level for the log: a warning where the run takes longer than estimated by `BEHIND`.
    """

    def __init__(
        self, cost: Cost, share: Callable[[float], float], begin: float, report: Callable[[str, int], None]
    ) -> None:
        self._cost, self._share, self._report, self._due = cost, share, report, [*SHARES]
        self._begin, self._windows = share(begin), 0
        self._left = TimeLeft(self._begin)

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        if not self._due:
            return
        done, self._windows = self._share(row.time), self._windows + 1
        self._left.read(done)
        own = done - self._begin
        if own >= self._due[0] and self._windows >= WINDOWS and self._left.passed >= MIN_S:
            self._due = [share for share in self._due if own < share]
            self._report_left(done)

    def _report_left(self, done: float) -> None:
        if (found := self._left.estimate()) is None or found[0] <= LONG:
            return
        seconds, cores = found
        estimated = self._cost.rounds * self._cost.until(self._cost.end) * (1.0 - done)
        slow = seconds > BEHIND * estimated
        text = f"about {format_rough_time(seconds)} left"
        if slow:
            text += f": {seconds / max(estimated, 1e-9):.1f} times the estimate"
            text += ", because the machine is busy" if cores < BUSY * sqrt(self._cost.threads) else ""
        self._report(text, logging.WARNING if slow else logging.INFO)
