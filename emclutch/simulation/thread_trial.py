"""Tries how many threads pay, while a run goes on: no bit of a result depends on their number, so it may change.

Two threads gain up to a factor of two, or cost some of it: a thousand grains leave them some ten microseconds of
work between two stages, and whoever has to share its core with another program is late at each. Which holds is a
property of the machine, the scene and the hour, so it is measured, and again after a minute, two, four ...
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coupling import Simulation

log = logging.getLogger(__name__)
ROUNDS = 3  # windows of each number in a trial; the fastest counts
SLOW = 1.5  # times as slow as the fastest in the first round: not tried any further
GAIN = 1.05  # more threads must be faster by this factor, or fewer are taken
AGAIN_S, AGAIN_WINDOWS = 60.0, 60  # seconds and windows from the first trial to the second
LONGER = 2.0  # times as long to the next one, where a trial changed nothing


class ThreadTrial:
    """Callback of the loop; it sets the number of threads of the windows to come.

    Parameters
    ----------
    most : int
        Threads that this process may use; powers of two up to it, and it itself, are tried.
    use : callable
        Sets the number of threads of the compiled loops.
    compiled : callable
        How many kernels this process has compiled so far: windows in which one is compiled measure nothing.
    tell : callable or None
        Takes the text of the first choice; all are logged.
    clock : callable
        Wall clock [s].
    """

    def __init__(
        self,
        most: int,
        use: Callable[[int], object],
        compiled: Callable[[], int] = lambda: 0,
        tell: Callable[[str], None] | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.numbers = sorted({*(2**k for k in range(most.bit_length()) if 2**k < most), most})
        self.threads = most
        self._chosen, self._patience = 0, 1.0
        self._to_try: list[int] = []  # one entry a window
        self._use, self._compiled, self._tell, self._clock = use, compiled, tell, clock
        self._kernels = compiled()
        self._before: float | None = None  # simulated time at the window's begin [s]
        self._begin_trial()

    def __call__(self, simulation: Simulation, row: dict) -> None:
        now, kernels = float(row["time"]), self._compiled()
        span, self._before = now - (now if self._before is None else self._before), now
        clean, self._kernels = kernels == self._kernels, kernels
        if not clean or span <= 0.0:
            return
        if not self._to_try:
            self._rested += 1
            waited = min(self._rested / AGAIN_WINDOWS, (self._clock() - self._tried) / AGAIN_S)
            if waited >= self._patience:
                self._begin_trial()
            return
        self._rates[self._to_try.pop(0)].append((row["wall_contact"] + row.get("wall_magnetic", 0.0)) / span)
        if all(len(rates) == 1 for rates in self._rates.values()):
            least = min(self._rate(number) for number in self.numbers)
            self._to_try = (ROUNDS - 1) * [number for number in self.numbers if self._rate(number) < SLOW * least]
        if self._to_try:
            self._take(self._to_try[0])
        else:
            self._choose()

    def _begin_trial(self) -> None:
        self._rates: dict[int, list[float]] = {number: [] for number in self.numbers}
        self._to_try = list(self.numbers)
        self._take(self._to_try[0])

    def _choose(self) -> None:
        chosen = self.numbers[0]
        for number in self.numbers[1:]:
            if self._rate(number) * GAIN < self._rate(chosen):
                chosen = number
        self._patience = LONGER * self._patience if chosen == self._chosen else 1.0
        self._chosen, self._rested, self._tried = chosen, 0, self._clock()
        self._take(chosen)
        told = ", ".join(f"{number}: {self._rate(1) / self._rate(number):.2f}" for number in self.numbers[1:])
        text = f"threads: {chosen} (tried; times as fast as one thread: {told})"
        log.info("%s", text)
        if self._tell is not None:
            self._tell(text)
            self._tell = None

    def _rate(self, number: int) -> float:
        """Seconds a simulated second."""
        return min(self._rates[number])

    def _take(self, number: int) -> None:
        self.threads = number
        self._use(number)
