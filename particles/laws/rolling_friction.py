"""Rolling resistance of grains that are not the perfect spheres they are computed as.

A spring and a dashpot for the rolling angle theta, in series with a slider (Iwashita & Oda, J. Eng. Mech. 124 (1998)
285; model C of Ai, Chen, Rotter & Ooi, Powder Technology 206 (2011) 269), on i and its opposite on j:

    T = -(k_r theta + gamma_r dtheta/dt),   |T| <= mu_r R_eff |F_n|,   dtheta/dt = w while it sticks,
    k_r = k_t R_eff^2,   gamma_r = 2 zeta_n sqrt(k_r I_eff),

w the tangential part of omega_i - omega_j, 1/R_eff = 1/R_i + 1/R_j (R_i at a wall), I_eff the reduced inertia. theta
turns with the pair and yields by the return mapping of the tangential spring (`particles.laws.linear`), so that a
loaded grain rests, whatever the time step, and the torque only ever takes energy; the two cancel: angular momentum is
conserved. Spheres on smooth walls roll like balls in a bearing and let a clutch slip; ground powder is rough and
angular: values of 0.1 to 0.3 are usual for irregular grains (Wensrich & Katterfeld, Powder Technology 217 (2012) 409).
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
