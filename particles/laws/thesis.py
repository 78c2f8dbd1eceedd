r"""The thesis' family f(delta/D)(k delta n - gamma m_eff v_n), the granular laws of Silbert et al.

Silbert, Ertas, Grest, Halsey, Levine & Plimpton, Phys. Rev. E 64 (2001) 051302, eqs. 2 and 3: with v_n the closing
speed

    F_n = f(delta/D) (k_n delta + gamma_n m_eff v_n),
    F_t = f(delta/D) (-k_t xi - gamma_t m_eff v_t),       |F_t| <= mu |F_n|,

f = 1 (Hooke) or f(x) = sqrt(x) (Hertz); gamma [1/s] multiplies the reduced mass. D is the diameter of the grains; here
one number of the law, also at walls, and grains of several sizes share it (their mean diameter is a fair choice): as
the law is printed it holds for equal spheres only.

The thesis prints the tangential velocity with R_i omega_i - R_j omega_j; it is the sum that slides (two equal wheels
that mesh do not). The history is projected with the tangential velocity, and turned with the pair. Both stand in the
contact routine that all laws share.

Restitution: for f = 1 that of the linear law at zeta = gamma_n sqrt(m_eff/k_n)/2, at every speed; for f = sqrt it falls
with the speed (p = 1.5, q = 0.5 in `particles.laws.restitution`). Both fall with the reduced mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geometry.kernels.device_functions import njit_without_refcounts
from geometry.kernels.simd import select
from geometry.kernels.simd_math import sqrt
from particles.laws.columns import DAMPING_N, DAMPING_T, DIAMETER, EXPONENT, STIFFNESS_N, STIFFNESS_T
from particles.laws.contact_law import check_parameters, law_row
from particles.laws.hertz_impact import impact_time, loaded_depth, tangent_stiffness
from particles.laws.restitution import (
    check_reference,
    damping_ratio,
    power_law_damping,
    power_law_restitution,
    restitution_of,
)


@njit_without_refcounts(error_model="numpy", fastmath={"contract"})
def thesis_spring(rows, kind, delta, m_eff, r_eff, memory):
    """Spring and dashpots of `ThesisContact` (signature: `particles.laws.contact_law`)."""
    bent = rows[kind, EXPONENT] > 0.0
    f, part = select(bent, sqrt(delta / rows[kind, DIAMETER]), 1.0), select(bent, 0.4, 0.5)
    force = f * rows[kind, STIFFNESS_N] * delta
    unit = f * m_eff
    k_t = f * rows[kind, STIFFNESS_T]
    gamma_n, gamma_t = rows[kind, DAMPING_N] * unit, rows[kind, DAMPING_T] * unit
    return force, k_t, gamma_n, gamma_t, part * force * delta, memory


@dataclass(frozen=True, slots=True)
class ThesisContact:
    """Parameters of every contact; `from_restitution` is the usual constructor.

    Attributes
    ----------
    stiffness_n, stiffness_t : float
        k_n and k_t [N/m].
    damping_n, damping_t : float
        gamma_n and gamma_t [1/s].
    diameter : float
        D [m].
    exponent : float
        0: f = 1; 0.5: f = sqrt(delta/D).
    friction : float
        Coulomb coefficient mu [-].
    damping_rolling : float
        Fraction of critical damping of rolling and twisting [-], where a scene has them.
    """

    kernel: ClassVar[str] = "thesis"

    stiffness_n: float
    stiffness_t: float
    damping_n: float
    damping_t: float
    diameter: float
    exponent: float
    friction: float
    damping_rolling: float = 0.25

    def __post_init__(self) -> None:
        check_parameters(
            self,
            {"stiffness_n": "N/m", "diameter": "m"},
            {
                "stiffness_t": "N/m",
                "damping_n": "1/s",
                "damping_t": "1/s",
                "friction": "",
                "damping_rolling": "",
            },
        )
        if self.exponent not in (0.0, 0.5):
            raise ValueError(f"exponent = {self.exponent:g} of delta/D; allowed: 0 (f = 1) or 0.5 (f = sqrt)")

    @classmethod
    def from_restitution(
        cls,
        stiffness_n: float,
        restitution: float,
        friction: float,
        *,
        diameter: float,
        exponent: float,
        m_eff: float,
        speed: float = 1.0,
        stiffness_t: float | None = None,
        damping_t: float | None = None,
    ) -> ThesisContact:
        """Contact with ``restitution`` [-] for ``m_eff`` [kg]; with f = sqrt at ``speed`` [m/s], with f = 1 at any.

        By default k_t = 2/7 k_n and gamma_t = gamma_n/2 (Silbert et al.).

        Raises
        ------
        ValueError
            If a number is out of range.
        """
        check_reference(m_eff, speed)
        zeta = damping_ratio(restitution)
        # validated before the damping is solved with them
        law = cls(stiffness_n, 0.0, 0.0, 0.0, diameter, exponent, friction, zeta)
        if exponent == 0.0:
            gamma = 2.0 * zeta * math.sqrt(stiffness_n / m_eff)
        else:
            depth = (m_eff * speed * speed / law._k) ** 0.4
            gamma = power_law_damping(restitution, 1.5, 0.5) * speed * math.sqrt(diameter) / depth**1.5
        return cls(
            stiffness_n,
            2.0 / 7.0 * stiffness_n if stiffness_t is None else stiffness_t,
            gamma,
            0.5 * gamma if damping_t is None else damping_t,
            diameter,
            exponent,
            friction,
            zeta,
        )

    def restitution_at(self, m_eff: float, speed: float) -> float:
        """Restitution [-] of an impact of the reduced mass ``m_eff`` [kg] at ``speed`` [m/s]."""
        check_reference(m_eff, speed)
        if self.exponent == 0.0:
            return restitution_of(0.5 * self.damping_n * math.sqrt(m_eff / self.stiffness_n))
        depth = (m_eff * speed * speed / self._k) ** 0.4
        return power_law_restitution(self.damping_n * depth**1.5 / (speed * math.sqrt(self.diameter)), 1.5, 0.5)

    def row(self) -> np.ndarray:
        """(k_n, k_t, gamma_n, gamma_t, D, exponent) and the friction, shape (N_LAW,)."""
        damping = [self.damping_n, self.damping_t]
        columns = [self.stiffness_n, self.stiffness_t, *damping, self.diameter, self.exponent]
        return law_row(columns, self.friction, self.damping_rolling)

    def contact_time(self, m_eff: float, r_eff: float, speed: float) -> float:
        """Duration of an undamped impact at ``speed`` [m/s]; any speed for f = 1 [s]."""
        if self.exponent == 0.0:
            return math.pi * math.sqrt(m_eff / self.stiffness_n)
        return impact_time(self._k, m_eff, speed)

    def stiffness_at(self, delta: float, r_eff: float) -> float:
        """k_n for f = 1, 1.5 k_n sqrt(delta/D) for f = sqrt [N/m]."""
        return self.stiffness_n if self.exponent == 0.0 else tangent_stiffness(self._k, delta)

    def overlap_under(self, force: float, m_eff: float, speed: float, r_eff: float) -> float:
        """Depth [m] at rest under ``force`` [N] and hit at ``speed`` [m/s], undamped."""
        if self.exponent == 0.0:
            return force / self.stiffness_n + speed * math.sqrt(m_eff / self.stiffness_n)
        return loaded_depth(self._k, force, m_eff, speed)

    @property
    def _k(self) -> float:
        """F = k delta^1.5 of f = sqrt [N/m^1.5]."""
        return self.stiffness_n / math.sqrt(self.diameter)
