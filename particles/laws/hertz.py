r"""Hertz' spring with a linear dashpot, parameters given directly.

    F_n = k delta^1.5 + gamma_n v_n,     k_t(delta) = k_t sqrt(delta),     gamma_t constant,

v_n = d(delta)/dt, positive while closing: the dashpot repels then. (In the thesis' form F = -k d^1.5 + gamma d' the
sign of the damping depends on a direction that is not stated; this is the one that dissipates.) k [N/m^1.5] holds for
every radius. Kuwabara & Kono would damp with sqrt(delta); a constant gamma_n starts the impact with the finite force
gamma_n v, and its restitution rises with the speed and with the reduced mass: `from_restitution` meets it at a named
reference speed and mass (`particles.laws.restitution`, p = 1.5, q = 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geometry.kernels.device_functions import njit_without_refcounts
from geometry.kernels.simd_math import sqrt
from particles.laws.columns import DAMPING_N, DAMPING_T, STIFFNESS_N, STIFFNESS_T
from particles.laws.contact_law import check_parameters, law_row
from particles.laws.hertz_impact import HertzianImpact
from particles.laws.restitution import check_reference, damping_ratio, power_law_damping, power_law_restitution


@njit_without_refcounts(error_model="numpy", fastmath={"contract"})
def hertz_spring(rows, kind, delta, m_eff, r_eff, memory):
    """Spring and dashpots of `HertzContact` (signature: `particles.laws.contact_law`)."""
    root = sqrt(delta)
    f = rows[kind, STIFFNESS_N] * root * delta
    gamma_n, gamma_t = rows[kind, DAMPING_N], rows[kind, DAMPING_T]
    return f, rows[kind, STIFFNESS_T] * root, gamma_n, gamma_t, 0.4 * f * delta, memory


@dataclass(frozen=True, slots=True)
class HertzContact(HertzianImpact):
    """Parameters of every contact; `from_restitution` is the usual constructor.

    Attributes
    ----------
    stiffness_n, stiffness_t : float
        k and k_t [N/m^1.5].
    damping_n, damping_t : float
        Dashpots [kg/s].
    friction : float
        Coulomb coefficient mu [-].
    damping_rolling : float
        Fraction of critical damping of rolling and twisting [-], where a scene has them.
    """

    kernel: ClassVar[str] = "hertz"

    stiffness_n: float
    stiffness_t: float
    damping_n: float
    damping_t: float
    friction: float
    damping_rolling: float = 0.25

    def __post_init__(self) -> None:
        check_parameters(
            self,
            {"stiffness_n": "N/m^1.5"},
            {
                "stiffness_t": "N/m^1.5",
                "damping_n": "kg/s",
                "damping_t": "kg/s",
                "friction": "",
                "damping_rolling": "",
            },
        )

    @classmethod
    def from_restitution(
        cls,
        stiffness_n: float,
        restitution: float,
        friction: float,
        *,
        m_eff: float,
        speed: float,
        stiffness_t: float | None = None,
        damping_t: float | None = None,
    ) -> HertzContact:
        """Contact of ``stiffness_n`` [N/m^1.5] with ``restitution`` [-] for ``m_eff`` [kg] at ``speed`` [m/s].

        By default the tangential stiffness is 2/7 of the normal one at every overlap (k_t = 3/7 k) and gamma_t half of
        gamma_n, as in the linear law.

        Raises
        ------
        ValueError
            If a number is out of range.
        """
        check_reference(m_eff, speed)
        if not 0.0 < stiffness_n < math.inf:
            raise ValueError(f"stiffness_n = {stiffness_n:g} N/m^1.5; allowed: more than 0")
        depth = (m_eff * speed * speed / stiffness_n) ** 0.4
        gamma = power_law_damping(restitution, 1.5, 0.0) * m_eff * speed / depth
        return cls(
            stiffness_n,
            3.0 / 7.0 * stiffness_n if stiffness_t is None else stiffness_t,
            gamma,
            0.5 * gamma if damping_t is None else damping_t,
            friction,
            damping_ratio(restitution),
        )

    def restitution_at(self, m_eff: float, speed: float) -> float:
        """Restitution [-] of an impact of the reduced mass ``m_eff`` [kg] at ``speed`` [m/s]."""
        check_reference(m_eff, speed)
        depth = (m_eff * speed * speed / self.stiffness_n) ** 0.4
        return power_law_restitution(self.damping_n * depth / (m_eff * speed), 1.5, 0.0)

    def row(self) -> np.ndarray:
        """(k, k_t, gamma_n, gamma_t) and the friction, shape (N_LAW,)."""
        columns = [self.stiffness_n, self.stiffness_t, self.damping_n, self.damping_t]
        return law_row(columns, self.friction, self.damping_rolling)

    def hertzian_stiffness(self, r_eff: float) -> float:
        """Return k [N/m^1.5], which holds for every radius."""
        return self.stiffness_n
