"""Rolling resistance of grains that are not the perfect spheres they are computed as.

A couple against the relative spin in the contact's tangent plane, of constant size (Zhou, Wright, Yang, Xu & Yu,
Physica A 269 (1999) 536, model A), on i and its opposite on j:

    T = -mu_r R_eff |F_n| w/|w|,     w = tangential part of omega_i - omega_j,     1/R_eff = 1/R_i + 1/R_j,

R_eff = R_i at a wall. So that it stops a rolling grain instead of shaking it, it is no larger than
0.2 I_eff |w|/dt: below that the resistance is viscous, and a loaded grain creeps. It only ever takes energy, and the
two couples cancel: angular momentum is conserved. Spheres on smooth walls roll like balls in a bearing and let a
clutch slip; ground powder is rough and angular: values of 0.1 to 0.3 are usual for irregular grains (Wensrich &
Katterfeld, Powder Technology 217 (2012) 409).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class RollingFriction:
    """Coefficients mu_r [-] between grains, and at walls (as between grains unless given)."""

    coefficient: float
    wall_coefficient: float | None = None

    def __post_init__(self) -> None:
        for name in ("coefficient", "wall_coefficient"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise ValueError(f"{name} of rolling friction = {value:g}; allowed: 0 or more (0.1 to 0.3 is usual)")

    def table(self) -> np.ndarray:
        """(mu_r between grains, mu_r at walls), shape (2,), for the kernel."""
        wall = self.coefficient if self.wall_coefficient is None else self.wall_coefficient
        return np.array([self.coefficient, wall])
