r"""Linear spring-dashpot contact with tangential history (Cundall & Strack 1979), clipped to be non-tensile.

Normal force on grain i, towards its partner along n (delta overlap, v_n closing speed):

    F = -max(0, k_n delta + gamma_n v_n) n,        gamma_n = 2 zeta_n sqrt(k_n m_eff),
    1/m_eff = 1/m_i + 1/m_j,                       m_eff = m_i against a wall.

`from_restitution` solves the damping for the clipped force (`particles.laws.restitution`).

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

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geometry.kernels.device_functions import njit_without_refcounts
from geometry.kernels.simd_math import sqrt
from particles.laws.columns import DAMPING_N, DAMPING_T, STIFFNESS_N, STIFFNESS_T
from particles.laws.contact_law import LinearImpact, check_parameters, law_row
from particles.laws.restitution import damping_ratio, restitution_of


@njit_without_refcounts(error_model="numpy", fastmath={"contract"})
def linear_spring(rows, kind, delta, m_eff, r_eff, memory):
    """Spring and dashpots of `LinearContact` (signature: `particles.laws.contact_law`)."""
    f = rows[kind, STIFFNESS_N] * delta
    unit = 2.0 * sqrt(rows[kind, STIFFNESS_N] * m_eff)
    gamma_n, gamma_t = rows[kind, DAMPING_N] * unit, rows[kind, DAMPING_T] * unit
    return f, rows[kind, STIFFNESS_T], gamma_n, gamma_t, 0.5 * f * delta, memory


@njit_without_refcounts(error_model="numpy", fastmath={"contract"})
def equal_linear_spring(rows, kind, delta, m_eff, r_eff, memory):
    """`linear_spring` between grains of one size and mass: its dashpots are constants."""
    f = rows[kind, STIFFNESS_N] * delta
    return f, rows[kind, STIFFNESS_T], rows[kind, DAMPING_N], rows[kind, DAMPING_T], 0.5 * f * delta, memory


@dataclass(frozen=True, slots=True)
class LinearContact(LinearImpact):
    """Parameters of every contact; `from_restitution` is the usual constructor.

    Attributes
    ----------
    stiffness_n, stiffness_t : float
        Normal and tangential spring [N/m].
    damping_n, damping_t : float
        Fraction of critical damping zeta [-]: gamma = 2 zeta sqrt(stiffness_n m_eff) for both.
    friction : float
        Coulomb coefficient mu [-].
    """

    kernel: ClassVar[str] = "linear"

    stiffness_n: float
    stiffness_t: float
    damping_n: float
    damping_t: float
    friction: float

    def __post_init__(self) -> None:
        check_parameters(
            self,
            {"stiffness_n": "N/m"},
            {"stiffness_t": "N/m", "damping_n": "", "damping_t": "", "friction": ""},
        )

    @property
    def restitution(self) -> float:
        """Restitution [-] of every impact."""
        return restitution_of(self.damping_n)

    @classmethod
    def from_restitution(
        cls,
        stiffness_n: float,
        restitution: float,
        friction: float,
        *,
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
        )

    def row(self) -> np.ndarray:
        """(k_n, k_t, zeta_n, zeta_t) and the friction, shape (N_LAW,)."""
        columns = [self.stiffness_n, self.stiffness_t, self.damping_n, self.damping_t]
        return law_row(columns, self.friction, self.damping_n)
