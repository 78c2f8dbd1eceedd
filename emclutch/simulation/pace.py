"""Tells once when a run falls behind its plan by a factor of two, and why.

What the parts of the windows take is compared with what was predicted for the same span of simulated time
(`emclutch.simulation.forecast.cost`), from the first windows on that compile nothing.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from emclutch.simulation.forecast.cost import Cost, spoken

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow

log = logging.getLogger(__name__)
BEHIND = 2.0  # times the seconds predicted
WINDOWS = 10  # at least, and
SHARE = 0.02  # of the run, and
MIN_S = 20.0  # have passed before anything is said: short runs need no plan, and short jams pass
WAITED_S, ASLEEP = 5.0, 0.1  # a window so long in which the process had no more than this share of a core slept
BUSY = 1.4  # processor time that was to be had over what was got: other programs take the cores
_WORK = {
    "field": "field solves and deposit",
    "magnetic": "moments and magnetic forces",
    "contact": "the grains' steps",
}


class RunPace:
    """Callback of the loop; it says at most one thing.

    Parameters
    ----------
    cost : Cost
        Of the run.
    begin : float
        Simulated time [s] at which this process takes the run up.
    tell : callable or None
        Takes the text, which is logged as a warning too.
    compiled : callable
        How many kernels this process has compiled so far: the clock restarts whenever it has compiled another one.
    """

    def __init__(
        self, cost: Cost, begin: float, tell: Callable[[str], None] | None, compiled: Callable[[], int] = lambda: 0
    ) -> None:
        self._cost, self._tell, self._compiled = cost, tell, compiled
        self.said = ""
        self._latest = 0.0  # reading of the processor's clock after the last window [s]
        self._restart(begin)

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        now = row.time
        if self._compiled() != self._kernels:
            self._restart(now)
            return
        work = {part: getattr(row.seconds, part) or 0.0 for part in self._spent}
        processor = time.process_time()
        at_work, self._latest = processor - self._latest, processor
        if sum(work.values()) > WAITED_S and at_work < ASLEEP * sum(work.values()):
            self._restart(now)  # it waited for a kernel that another process compiles
            return
        self._windows += 1
        for part, seconds in work.items():
            self._spent[part] += seconds
        if not self.said and self._is_time(now):
            self.said = self._reason(now)
            if self.said:
                log.warning("%s", self.said)
                if self._tell is not None:
                    self._tell(self.said)

    def _restart(self, now: float) -> None:
        self._begin, self._windows, self._kernels = now, 0, self._compiled()
        self._spent = dict.fromkeys(_WORK, 0.0)
        self._wall = time.perf_counter()
        self._processor = self._latest = time.process_time()

    def _is_time(self, now: float) -> bool:
        passed = (now - self._begin) / self._cost.time[-1]
        return self._windows >= WINDOWS and passed >= SHARE and sum(self._spent.values()) >= MIN_S

    def _reason(self, now: float) -> str:
        """Return what is wrong, or nothing."""
        before, after = self._cost.until(self._begin), self._cost.until(now)
        predicted = {part: after[part] - before[part] for part in _WORK}
        spent, planned = sum(self._spent.values()), sum(predicted.values())
        if spent <= BEHIND * planned:
            return ""
        wall, processor = time.perf_counter() - self._wall, time.process_time() - self._processor
        cost = self._cost
        at_work = cost.gain / cost.machine.delay(cost.threads)  # cores at work, on a machine as when it was predicted
        if BUSY * processor < at_work * wall:
            why = (
                f"the machine is busy: of {wall:.0f} s this run had {processor:.0f} s of a core; end other programs, "
                "or wait"
            )
        else:
            part = max(_WORK, key=lambda part: self._spent[part] - predicted[part])
            why = f"{_WORK[part]} took {spoken(self._spent[part])} where {spoken(predicted[part])} were predicted"
        left = spent / planned * (self._cost.seconds["total"] - sum(after.values()))
        return (
            f"the run is behind its plan, {spent / planned:.1f} times as slow as predicted, about {spoken(left)} left: "
            f"{why}"
        )
