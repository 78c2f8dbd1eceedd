r"""Cohesion as a pull that lasts as long as grains overlap: F_n = F_rep - F_c, F_c = c_0 + c_1 r_eff.

The clipped repulsion of the law is what friction scales with; F_c is added to it and holds until the overlap ends, so a
contact parts under the pull-off force F_c. It stores -F_c delta, takes no energy, and reaches nowhere beyond touch.

    constant    F_c given [N]
    DMT         F_c = 2 pi w r_eff        small stiff grains (Derjaguin, Muller & Toporov 1975)
    JKR         F_c = (3/2) pi w r_eff    large soft grains (Johnson, Kendall & Roberts 1971)

w [J/m^2] is the work of adhesion, twice the surface energy of like bodies; r_eff = R_i R_j/(R_i + R_j), R_i at a
wall. Which of the two applies, Tabor's parameter (r_eff w^2/(E*^2 z_0^3))^(1/3) says, with the spacing z_0 of atoms,
0.4 nm: DMT below 0.1, JKR above 5 (Johnson & Greenwood, J. Colloid Interface Sci. 192 (1997) 326). Of JKR only the
pull-off force is taken: the neck that holds beyond touch, and the hysteresis with its energy, are left out. Restitution
is that asked for only where the impact is much stronger than F_c delta.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Cohesion:
    """Pull F_c = force + per_radius r_eff, between grains and at walls (as between grains unless given).

    Attributes
    ----------
    force, wall_force : float
        c_0 [N].
    per_radius, wall_per_radius : float
        c_1 [N/m].
    """

    force: float = 0.0
    per_radius: float = 0.0
    wall_force: float | None = None
    wall_per_radius: float | None = None

    def __post_init__(self) -> None:
        for name, unit in (("force", "N"), ("wall_force", "N"), ("per_radius", "N/m"), ("wall_per_radius", "N/m")):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise ValueError(f"{name} of cohesion = {value:g} {unit}; allowed: 0 or more")

    @classmethod
    def constant(cls, force: float, wall_force: float | None = None) -> Cohesion:
        """The same pull [N] at every contact."""
        return cls(force=force, wall_force=wall_force)

    @classmethod
    def dmt(cls, work: float, wall_work: float | None = None) -> Cohesion:
        """2 pi w r_eff, from the work of adhesion [J/m^2]."""
        return cls._of_work(2.0 * math.pi, work, wall_work)

    @classmethod
    def jkr(cls, work: float, wall_work: float | None = None) -> Cohesion:
        """(3/2) pi w r_eff, from the work of adhesion [J/m^2]."""
        return cls._of_work(1.5 * math.pi, work, wall_work)

    @classmethod
    def _of_work(cls, factor: float, work: float, wall_work: float | None) -> Cohesion:
        for name, value in (("work of adhesion", work), ("work of adhesion at walls", wall_work)):
            if value is not None and not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value:g} J/m^2; allowed: 0 or more (0.01 to 1 is usual)")
        return cls(per_radius=factor * work, wall_per_radius=None if wall_work is None else factor * wall_work)

    def table(self) -> np.ndarray:
        """Rows grain-grain and grain-wall of (c_0 [N], c_1 [N/m]), shape (2, 2)."""
        wall_force = self.force if self.wall_force is None else self.wall_force
        wall_per_radius = self.per_radius if self.wall_per_radius is None else self.wall_per_radius
        return np.array([[self.force, self.per_radius], [wall_force, wall_per_radius]])
