"""Parameters of a rigid contact: Coulomb friction and restitution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class DviContact:
    """Friction mu and restitution e [-] between grains, and at walls (as between grains unless given).

    ``threshold`` [m/s]: an approach slower than that does not rebound. Without it the rebounds of a resting grain from
    the step's own h g would never end.
    """

    friction: float
    restitution: float = 0.0
    wall_friction: float | None = None
    wall_restitution: float | None = None
    threshold: float = 0.01

    def __post_init__(self) -> None:
        for name in ("friction", "wall_friction"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise ValueError(f"{name} of a rigid contact = {value:g}; allowed: 0 or more")
        for name in ("restitution", "wall_restitution"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} of a rigid contact = {value:g}; allowed: 0 to 1")
        if not 0.0 <= self.threshold < math.inf:
            raise ValueError(f"threshold of restitution = {self.threshold:g} m/s; allowed: 0 or more")

    def table(self) -> np.ndarray:
        """Rows between grains and at walls, columns friction, restitution, threshold, shape (2, 3)."""
        wall_friction = self.friction if self.wall_friction is None else self.wall_friction
        wall_restitution = self.restitution if self.wall_restitution is None else self.wall_restitution
        return np.array(
            [[self.friction, self.restitution, self.threshold], [wall_friction, wall_restitution, self.threshold]]
        )
