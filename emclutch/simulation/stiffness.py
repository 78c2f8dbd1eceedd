"""Stiffness of the contacts of a run, and the load on them."""

from __future__ import annotations

from dataclasses import dataclass

from coupling.expected_load import NECK_MARGIN
from emclutch.effects.effect import Load
from particles.dem.overlap_limits import SOFT


@dataclass(frozen=True, slots=True)
class Stiffness:
    """The normal stiffness of contacts between grains, at the largest overlap that is to be expected.

    Attributes
    ----------
    value : float
        [N/m]
    asked : bool
        Whether the scene gives it; else it follows from the load.
    law : str
        Of the contact, as `contact.law`.
    overlap : float
        The largest to be expected, over the diameter.
    load : Load
        The largest.
    speed : float
        Of impacts [m/s].
    snap : float or None
        Overlap over the diameter of grains that snap together from afar, for an instant; None without magnetism.
    neck : float
        Negative stiffness of saturated necks between near grains [N/m]; 0 where there are none.
    """

    value: float
    asked: bool
    law: str
    overlap: float
    load: Load
    speed: float
    snap: float | None
    neck: float

    @property
    def is_below_necks(self) -> bool:
        """True if it is less than `NECK_MARGIN` times that of necks; round-off of what follows from it is not."""
        return self.value < 0.999 * NECK_MARGIN * self.neck

    @property
    def is_soft(self) -> bool:
        """True if grains press in so far that peaks of the torque mean little."""
        return self.overlap > SOFT
