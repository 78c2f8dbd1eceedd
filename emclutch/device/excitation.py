"""A winding and its current in time: what every device with a coil has."""

from __future__ import annotations

from dataclasses import dataclass

from field.coil.winding import Winding
from geometry.time_profile import TimeProfile


@dataclass(frozen=True, slots=True)
class Excitation:
    """A winding and its current in time.

    Attributes
    ----------
    winding : Winding
    currents : TimeProfile
        [A].
    """

    winding: Winding
    currents: TimeProfile

    @property
    def turns(self) -> float:
        """Turns of the coil."""
        return self.winding.turns

    def current(self, time: float) -> float:
        """I [A] at a time [s]."""
        return float(self.currents.at(time))

    @property
    def largest_current(self) -> float:
        """Largest |I| at any time [A]."""
        return self.currents.largest
