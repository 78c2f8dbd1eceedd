"""Time that a piece of work has left, by the pace of the later half of what has been done."""

from __future__ import annotations

import time

from geometry.kernels.cache import compile_seconds

MAX_READINGS = 200  # then every second one is dropped


class TimeLeft:
    """Readings of the clocks as work advances, compiling kept out.

    The earlier half is left out: at its beginning kernels are loaded, grains of a run have not met yet, and the field
    is solved more often. Where the work grows, readings start again.

    Parameters
    ----------
    fraction : of the work that is done at the start, above 0 where a run resumes.
    """

    def __init__(self, fraction: float) -> None:
        self._readings = [(fraction, *_clocks())]

    @property
    def advanced(self) -> float:
        """Fraction of the work that has been done since the start, of what was left then."""
        first = self._readings[0][0]
        return (self._readings[-1][0] - first) / max(1.0 - first, 1e-300)

    @property
    def passed(self) -> float:
        """Seconds since the start."""
        return self._readings[-1][1] - self._readings[0][1]

    def read(self, fraction: float) -> None:
        """Note that so much of the work is done."""
        if fraction < self._readings[-1][0]:
            self._readings = []
        if not self._readings or fraction > self._readings[-1][0]:
            self._readings.append((fraction, *_clocks()))
        if len(self._readings) > MAX_READINGS:
            self._readings = [*self._readings[:-1:2], self._readings[-1]]

    def estimate(self) -> tuple[float, float] | None:
        """Return the seconds left, and the cores that this process has had; None before anything is done.

        What has passed since the last reading that advanced counts as done.
        """
        if len(self._readings) < 2:
            return None
        last = self._readings[-1]
        half = 0.5 * (self._readings[0][0] + last[0])
        early = max(one for one in self._readings[:-1] if one is self._readings[0] or one[0] <= half)
        done, wall, processor = (b - a for a, b in zip(early, last, strict=True))
        since = _clocks()[0] - last[1]
        return max((1.0 - last[0]) * wall / done - since, 0.0), processor / max(wall, 1e-9)


def _clocks() -> tuple[float, float]:
    """Return the wall clock without what compiling took, and the processor's [s]."""
    return time.perf_counter() - compile_seconds(), time.process_time()
