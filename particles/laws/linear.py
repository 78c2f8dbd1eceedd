r"""Linear spring-dashpot contact with tangential history (Cundall & Strack 1979), clipped to be non-tensile.

Normal force on grain i, towards its partner along n (delta overlap, v_n closing speed):

    F = -max(0, k_n delta + gamma_n v_n) n,        gamma_n = 2 zeta_n sqrt(k_n m_eff),
    1/m_eff = 1/m_i + 1/m_j,                       m_eff = m_i against a wall.

**Restitution.** Because the force never pulls, an impact ends when the force vanishes, before the overlap
does (Schwager & Poeschel, Granular Matter 9 (2007) 465). With s = sqrt(1 - zeta^2)

    e(zeta) = exp(-(zeta/s) (pi - atan2(2 zeta s, 1 - 2 zeta^2))),       zeta < 1,

and its continuation beyond critical damping. `damping_ratio` solves this e(zeta) = e for zeta, so that the
asked restitution is the one obtained (the common -ln e/sqrt(pi^2 + ln^2 e) would give 0.9020, 0.5503,
0.3249 for 0.9, 0.5, 0.2). e = 0 needs infinite damping; 0.05 is the least that a time step resolves.

**Tangential.** A spring xi and a dashpot in parallel, in series with a slider that yields at mu |F_n|:

    F_t = -(k_t xi + gamma_t dxi/dt),   |F_t| <= mu |F_n|.

While it sticks dxi/dt is the sliding velocity u_t. When it slips, F_t keeps its trial direction at length
mu |F_n|, and the spring is set to the length that carries that force together with the dashpot,

    xi = (F_cap + (gamma_t/dt) xi_old)/(k_t + gamma_t/dt),

the return mapping of an implicit step. The slip then is parallel to the force and the step dissipates

    F.slip + gamma_t |dxi|^2/dt + k_t |dxi|^2/2 >= 0,

whatever the incidence: friction creates no energy. Defaults k_t = 2/7 k_n (the tangential half period
equals the normal one for solid spheres) and gamma_t = gamma_n/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

LEAST_RESTITUTION = 0.05


@dataclass(frozen=True, slots=True)
class LinearContact:
    """Parameters of every contact; `from_restitution` is the usual way to make one.

    Attributes
    ----------
    stiffness_n, stiffness_t : float
        Normal and tangential spring [N/m].
    damping_n, damping_t : float
        Share of critical damping zeta [-]: gamma = 2 zeta sqrt(stiffness_n m_eff) for both.
    friction : float
        Coulomb coefficient mu [-] between grains, and at walls unless ``wall_friction`` is given.
    wall_friction : float
        Coulomb coefficient at walls [-].
    """

    stiffness_n: float
    stiffness_t: float
    damping_n: float
    damping_t: float
    friction: float
    wall_friction: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.stiffness_n < math.inf:
            raise ValueError(f"stiffness_n = {self.stiffness_n:g} N/m; allowed: more than 0")
        for name, unit in (("stiffness_t", " N/m"), ("damping_n", ""), ("damping_t", ""), ("friction", "")):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value:g}{unit}; allowed: 0 or more")
        if self.wall_friction is not None and not 0.0 <= self.wall_friction < math.inf:
            raise ValueError(f"wall_friction = {self.wall_friction:g}; allowed: 0 or more")

    @classmethod
    def from_restitution(
        cls,
        stiffness_n: float,
        restitution: float,
        friction: float,
        *,
        wall_friction: float | None = None,
        stiffness_t: float | None = None,
        damping_t: float | None = None,
    ) -> LinearContact:
        """Contact of given ``stiffness_n`` [N/m] whose binary impacts have ``restitution`` [-]."""
        zeta = damping_ratio(restitution)
        return cls(
            stiffness_n,
            2.0 / 7.0 * stiffness_n if stiffness_t is None else stiffness_t,
            zeta,
            0.5 * zeta if damping_t is None else damping_t,
            friction,
            wall_friction,
        )

    def table(self) -> np.ndarray:
        """Rows grain-grain and grain-wall of (k_n, k_t, zeta_n, zeta_t, mu), shape (2, 5), for the kernel."""
        row = [self.stiffness_n, self.stiffness_t, self.damping_n, self.damping_t]
        wall = self.friction if self.wall_friction is None else self.wall_friction
        return np.array([[*row, self.friction], [*row, wall]])


def restitution_of(zeta: float) -> float:
    """Restitution e [-] of the clipped contact at the damping ratio ``zeta`` [-] (module docstring)."""
    if zeta < 1.0:
        s = math.sqrt(1.0 - zeta * zeta)
        return math.exp(-(zeta / s) * (math.pi - math.atan2(2.0 * zeta * s, 1.0 - 2.0 * zeta * zeta)))
    s = math.sqrt(zeta * zeta - 1.0)
    # s -> 0 is the removable limit e = exp(-2) at critical damping
    return math.exp(-2.0) if s < 1e-6 else math.exp(-(zeta / s) * math.log((zeta + s) / (zeta - s)))


def damping_ratio(restitution: float) -> float:
    """Damping ratio zeta [-] that gives ``restitution`` [-] in the clipped contact.

    Raises
    ------
    ValueError
        Outside 0.05 <= restitution <= 1.
    """
    if not LEAST_RESTITUTION <= restitution <= 1.0:
        raise ValueError(
            f"restitution = {restitution:g}; allowed: {LEAST_RESTITUTION:g} to 1 (a smaller one needs more "
            "damping than a time step resolves)"
        )
    if restitution == 1.0:
        return 0.0
    from scipy.optimize import brentq

    # e falls monotonically from 1 at zeta = 0 to about 0.024 at zeta = 3
    return float(brentq(lambda zeta: restitution_of(zeta) - restitution, 0.0, 3.0, xtol=1e-15, rtol=1e-14))
