"""Errors that stop a run of grains."""

from __future__ import annotations

from enum import Enum

import numpy as np


class ParticleError(RuntimeError):
    """A run of grains that cannot continue or cannot start; the message says what to change."""


class PackingError(ParticleError):
    """The wanted grains do not fit, or their overlaps could not be relaxed away.

    Attributes
    ----------
    overlap : float or None
        The largest overlap that was reached, as a fraction of the diameter; None where nothing was tried.
    """

    def __init__(self, message: str, overlap: float | None = None) -> None:
        super().__init__(message)
        self.overlap = overlap


class DemErrorKind(Enum):
    """Reason why one grain stopped a run."""

    OVERLAP = "overlap"
    TOO_FAST = "too fast"
    ESCAPED = "escaped"
    NOT_FINITE = "not finite"


class DemError(ParticleError):
    """One grain stopped the run.

    Attributes
    ----------
    kind : DemErrorKind
        What to decide by; the words may change.
    particle_id : int
        The grain's stable number.
    place : ndarray, shape (3,)
        Its centre [m].
    time : float
        Simulated time [s].
    """

    def __init__(
        self, kind: DemErrorKind, fault: str, remedy: str, particle_id: int, place: np.ndarray, time: float
    ) -> None:
        x, y, z = (1e3 * float(value) for value in place)
        r = float(np.hypot(x, y))
        super().__init__(
            f"grain {particle_id} at (x, y, z) = ({x:.4g}, {y:.4g}, {z:.4g}) mm (r = {r:.4g} mm), "
            f"t = {time:.6g} s: {fault}; {remedy}"
        )
        self.kind = kind
        self.particle_id = int(particle_id)
        self.place = np.array(place, dtype=float)
        self.time = float(time)
