r"""Hysteretic contact of Walton & Braun (J. Rheol. 30 (1986) 949): it loads softly and unloads stiffly, no dashpot.

    first loading     F = k_1 delta
    below the peak    F = max(0, k_2 (delta - delta_0)),     delta_0 = (1 - k_1/k_2) delta_peak,

k_2 > k_1; reloading follows the unloading line up to the peak, which is the memory of the contact and ends with it. The
work k_1 delta_peak^2/2 comes back by the fraction k_1/k_2 through the triangle of height k_1 delta_peak, so

    e = sqrt(k_1/k_2)

exactly, at every speed and mass. The energy that can be recovered is F^2/(2 k_2); (1 - k_1/k_2) k_1 delta_peak^2/2 has
been lost. A wall and a grain remember no dent once they part (the dents of repeated impacts do not add up).
Tangential spring and dashpot are those of the linear law, with gamma_t = 2 zeta_t sqrt(k_1 m_eff).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geometry.kernels.device_functions import njit_without_refcounts
from geometry.kernels.simd import maximum
from geometry.kernels.simd_math import sqrt
from particles.laws.columns import DAMPING_T, STIFFNESS_N, STIFFNESS_T, UNLOADING
from particles.laws.contact_law import LinearImpact, check_parameters, law_row
from particles.laws.restitution import checked_restitution, damping_ratio


@njit_without_refcounts(error_model="numpy", fastmath={"contract"})
def walton_braun_spring(rows, kind, delta, m_eff, r_eff, memory):
    """Spring of `WaltonBraun` (signature: `particles.laws.contact_law`); ``memory`` is the peak overlap [m]."""
    k_1, k_2 = rows[kind, STIFFNESS_N], rows[kind, UNLOADING]
    peak = maximum(memory, delta)
    f = maximum(k_1 * peak - k_2 * (peak - delta), 0.0)
    gamma_t = 2.0 * rows[kind, DAMPING_T] * sqrt(k_1 * m_eff)
    return f, rows[kind, STIFFNESS_T], 0.0, gamma_t, 0.5 * f * f / k_2, peak


@dataclass(frozen=True, slots=True)
class WaltonBraun(LinearImpact):
    """Parameters of every contact; `from_restitution` is the usual constructor.

    Attributes
    ----------
    stiffness_n, unloading_stiffness, stiffness_t : float
        k_1, k_2 and k_t [N/m].
    damping_t : float
        Tangential fraction of critical damping zeta_t [-].
    friction : float
        Coulomb coefficient mu [-].
    damping_rolling : float
        Fraction of critical damping of rolling and twisting [-], where a scene has them.
    """

    kernel: ClassVar[str] = "walton_braun"

    stiffness_n: float
    unloading_stiffness: float
    stiffness_t: float
    damping_t: float
    friction: float
    damping_rolling: float = 0.25

    def __post_init__(self) -> None:
        check_parameters(
            self,
            {"stiffness_n": "N/m", "unloading_stiffness": "N/m"},
            {"stiffness_t": "N/m", "damping_t": "", "friction": "", "damping_rolling": ""},
        )
        if self.unloading_stiffness < self.stiffness_n:
            raise ValueError(
                f"unloading_stiffness = {self.unloading_stiffness:g} N/m; allowed: stiffness_n = "
                f"{self.stiffness_n:g} N/m or more (restitution is the root of their ratio)"
            )

    @classmethod
    def from_restitution(
        cls,
        stiffness_n: float,
        restitution: float,
        friction: float,
        *,
        stiffness_t: float | None = None,
        damping_t: float | None = None,
    ) -> WaltonBraun:
        """Contact that loads with ``stiffness_n`` [N/m] and has ``restitution`` [-]; k_t = 2/7 k_1 unless given."""
        zeta = damping_ratio(restitution)
        return cls(
            stiffness_n,
            stiffness_n / checked_restitution(restitution) ** 2,
            2.0 / 7.0 * stiffness_n if stiffness_t is None else stiffness_t,
            0.5 * zeta if damping_t is None else damping_t,
            friction,
            zeta,
        )

    @property
    def restitution(self) -> float:
        """sqrt(k_1/k_2) [-]."""
        return math.sqrt(self.stiffness_n / self.unloading_stiffness)

    def row(self) -> np.ndarray:
        """(k_1, k_t, k_2, zeta_t) and the friction, shape (N_LAW,)."""
        columns = [self.stiffness_n, self.stiffness_t, self.unloading_stiffness, self.damping_t]
        return law_row(columns, self.friction, self.damping_rolling)

    def contact_time(self, m_eff: float, r_eff: float, speed: float) -> float:
        """A quarter period of each spring, (pi/2)(sqrt(m/k_1) + sqrt(m/k_2)) [s], at every speed."""
        return 0.5 * math.pi * (math.sqrt(m_eff / self.stiffness_n) + math.sqrt(m_eff / self.unloading_stiffness))

    def stiffness_at(self, delta: float, r_eff: float) -> float:
        """k_2 [N/m], on which a loaded contact vibrates."""
        return self.unloading_stiffness
