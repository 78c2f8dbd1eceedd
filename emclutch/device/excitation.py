"""A winding and the course of its current: what every device with a coil has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field.coil.winding import Winding


@dataclass(frozen=True, slots=True)
class Excitation:
    """A winding and the course of its current.

    Attributes
    ----------
    winding : Winding
    times, currents : tuple of float
        [s] and [A]; linear between, held beyond.
    """

    winding: Winding
    times: tuple[float, ...]
    currents: tuple[float, ...]

    @property
    def turns(self) -> float:
        """Turns of the coil."""
        return self.winding.turns

    def current(self, time: float) -> float:
        """I [A] at a time [s]."""
        return float(np.interp(time, self.times, self.currents))

    @property
    def largest_current(self) -> float:
        """Largest |I| of the course [A]."""
        return max(abs(current) for current in self.currents)
