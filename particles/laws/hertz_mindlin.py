r"""Hertz-Mindlin contact with Tsuji's damping: elastic spheres, restitution independent of the speed.

With a = sqrt(r_eff delta), the radius of the contact, and v_n the closing speed

    F_n = (4/3) E* sqrt(r_eff) delta^1.5 + gamma_n v_n,     S_n = dF/d(delta) = 2 E* a,
    k_t = S_t = 8 G* a,                                      gamma = 2 sqrt(5/6) beta sqrt(S m_eff),

E* and G* of both partners (`particles.laws.elastic`). Normal: Tsuji, Tanaka & Ishida, Powder Technology 71 (1992) 239,
whose alpha is sqrt(5) beta; beta = zeta(e) of the clipped linear contact, exact at every speed
(`particles.laws.restitution`). Tangential: Mindlin, J. Appl. Mech. 16 (1949) 259, no slip; gamma_t has its own S_t and
beta_t. The micro-slip of Mindlin & Deresiewicz is left out. Valid for delta well below r_eff.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geometry.kernels.device_functions import njit_without_refcounts
from geometry.kernels.simd_math import sqrt
from particles.laws.columns import DAMPING_N, DAMPING_T, SHEAR, YOUNG
from particles.laws.contact_law import check_parameters, law_row
from particles.laws.elastic import Elastic, effective_modulus, effective_shear_modulus
from particles.laws.hertz_impact import HertzianImpact
from particles.laws.restitution import damping_ratio, restitution_of


@njit_without_refcounts(error_model="numpy", fastmath={"contract"})
def hertz_mindlin_spring(rows, kind, delta, m_eff, r_eff, memory):
    """Spring and dashpots of `HertzMindlin` (signature: `particles.laws.contact_law`)."""
    a = sqrt(r_eff * delta)
    f = 4.0 / 3.0 * rows[kind, YOUNG] * a * delta
    unit = sqrt(m_eff * a)
    k_t = 8.0 * rows[kind, SHEAR] * a
    return f, k_t, rows[kind, DAMPING_N] * unit, rows[kind, DAMPING_T] * unit, 0.4 * f * delta, memory


@dataclass(frozen=True, slots=True)
class HertzMindlin(HertzianImpact):
    """Contact of two elastic materials; `from_restitution` is the usual constructor.

    Attributes
    ----------
    grain, partner : Elastic
        Of the grain and of what it touches.
    damping_n, damping_t : float
        beta and beta_t [-].
    friction : float
        Coulomb coefficient mu [-].
    """

    kernel: ClassVar[str] = "hertz_mindlin"

    grain: Elastic
    partner: Elastic
    damping_n: float
    damping_t: float
    friction: float

    def __post_init__(self) -> None:
        check_parameters(self, {}, {"damping_n": "", "damping_t": "", "friction": ""})

    @classmethod
    def from_restitution(
        cls,
        grain: Elastic,
        restitution: float,
        friction: float,
        *,
        partner: Elastic | None = None,
        damping_t: float | None = None,
    ) -> HertzMindlin:
        """Contact whose impacts have ``restitution`` [-] at every speed; ``partner``: as ``grain`` unless given.

        ``damping_t`` is half of beta by default, as in the linear law.
        """
        beta = damping_ratio(restitution)
        return cls(
            grain,
            grain if partner is None else partner,
            beta,
            0.5 * beta if damping_t is None else damping_t,
            friction,
        )

    @property
    def restitution(self) -> float:
        """Restitution [-] of every impact."""
        return restitution_of(self.damping_n)

    @property
    def modulus(self) -> float:
        """E* [Pa]."""
        return effective_modulus(self.grain, self.partner)

    @property
    def shear_modulus(self) -> float:
        """G* [Pa]."""
        return effective_shear_modulus(self.grain, self.partner)

    def row(self) -> np.ndarray:
        """E*, G*, gamma_n and gamma_t over sqrt(m_eff a), and the friction, shape (N_LAW,)."""
        E, G = self.modulus, self.shear_modulus
        unit = 2.0 * math.sqrt(5.0 / 6.0)
        damping = [unit * self.damping_n * math.sqrt(2.0 * E), unit * self.damping_t * math.sqrt(8.0 * G)]
        return law_row([E, G, *damping], self.friction, self.damping_n)

    def hertzian_stiffness(self, r_eff: float) -> float:
        """Return k = (4/3) E* sqrt(r_eff) [N/m^1.5]."""
        return 4.0 / 3.0 * self.modulus * math.sqrt(r_eff)
