"""A box that repeats in all three directions, so that it has no walls (`particles.sheared_box`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.box import Box
from geometry.walls import Plane


@dataclass(frozen=True, slots=True)
class PeriodicBox(Box):
    """0 <= x < X, 0 <= y < Y, 0 <= z < Z for size = (X, Y, Z) [m]."""

    @property
    def lower(self) -> np.ndarray:
        """Lowest corner [m], shape (3,)."""
        return np.zeros(3)

    @property
    def upper(self) -> np.ndarray:
        """Highest corner [m], shape (3,)."""
        return np.asarray(self.size)

    def walls(self) -> list[Plane]:
        """None: beyond each face is the box again."""
        return []
