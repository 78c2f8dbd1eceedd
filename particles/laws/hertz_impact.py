"""Undamped impact and rest of a contact F = k delta^1.5 (Hertz): depth, duration, stiffness.

Energy gives the depth x_0 = (5 m v^2/(4 k))^(2/5) of an impact at speed v, and its duration

    T = (2 x_0/v) int_0^1 du/sqrt(1 - u^(5/2)) = (2 sqrt(pi) Gamma(7/5)/Gamma(9/10)) x_0/v = 2.94328 x_0/v

(Landau & Lifshitz, Theory of Elasticity, section 9; their k is 4/5 of this one).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

IMPACT = 2.0 * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)  # 2.94328


def impact_depth(k: float, m_eff: float, speed: float) -> float:
    """Depth x_0 [m] for ``k`` [N/m^1.5], reduced mass [kg] and speed [m/s]."""
    return float((1.25 * m_eff * speed * speed / k) ** 0.4)


def impact_time(k: float, m_eff: float, speed: float) -> float:
    """Duration T [s]; infinite at rest."""
    return IMPACT * impact_depth(k, m_eff, speed) / speed if speed > 0.0 else math.inf


def tangent_stiffness(k: float, delta: float) -> float:
    """1.5 k sqrt(delta) [N/m]."""
    return 1.5 * k * math.sqrt(delta)


def loaded_depth(k: float, force: float, m_eff: float, speed: float) -> float:
    """Depth [m] of a contact that rests under ``force`` [N] and is hit at ``speed`` [m/s].

    From the energy m v^2/2 = U(x) - U(x_s) - force (x - x_s), U = 0.4 k x^2.5, with x_s the depth at rest; it is at
    most x_s plus the depth of the impact alone, for the spring stiffens.
    """
    rest = float((force / k) ** (2.0 / 3.0))
    alone = impact_depth(k, m_eff, speed)
    if rest == 0.0 or alone == 0.0:
        return rest + alone
    if alone < 1e-4 * rest:  # a vibration about the rest, whose energy is lost in the round-off of the load's
        return rest + speed * math.sqrt(m_eff / tangent_stiffness(k, rest))
    from scipy.optimize import brentq

    def surplus(x: float) -> float:  # in units of the impact's energy
        stored = 0.4 * k * ((rest + x) ** 2.5 - rest**2.5) - force * x
        return stored / (0.5 * m_eff * speed * speed) - 1.0

    # the upper end may fall short by round-off where the impact dwarfs the load
    return rest + float(brentq(surplus, 0.0, alone * (1.0 + 1e-9), xtol=1e-15 * (rest + alone), rtol=1e-12))


class HertzianImpact(ABC):
    """Scales of a law whose normal spring is F = k delta^1.5; the law gives k [N/m^1.5] at an effective radius [m]."""

    __slots__ = ()

    @abstractmethod
    def hertzian_stiffness(self, r_eff: float) -> float:
        """Return k [N/m^1.5]."""

    def contact_time(self, m_eff: float, r_eff: float, speed: float) -> float:
        """Duration [s] of an undamped impact at ``speed`` [m/s]."""
        return impact_time(self.hertzian_stiffness(r_eff), m_eff, speed)

    def stiffness_at(self, delta: float, r_eff: float) -> float:
        """1.5 k sqrt(delta) [N/m]."""
        return tangent_stiffness(self.hertzian_stiffness(r_eff), delta)

    def overlap_under(self, force: float, m_eff: float, speed: float, r_eff: float) -> float:
        """Depth [m] at rest under ``force`` [N] and hit at ``speed`` [m/s], undamped."""
        return loaded_depth(self.hertzian_stiffness(r_eff), force, m_eff, speed)


def stiffness_for_depth(depth: float, force: float, m_eff: float, speed: float) -> float:
    """k [N/m^1.5] at which a contact under ``force`` [N], hit at ``speed`` [m/s], is ``depth`` [m] deep at most.

    Load and impact add up: k = F/x_F^1.5 and k = 1.25 m v^2/x_v^2.5 with x_F + x_v = depth, a bound of `loaded_depth`.

    Raises
    ------
    ValueError
        If neither force nor impact is positive.
    """
    from scipy.optimize import brentq

    impact = 1.25 * m_eff * speed * speed
    if force == 0.0 and impact == 0.0:
        raise ValueError("neither a force nor an impact presses the contact, so no stiffness follows; give one")
    if force == 0.0 or impact == 0.0:
        return float(force / depth**1.5 + impact / depth**2.5)

    def excess(log_k: float) -> float:
        k = math.exp(log_k)
        return ((force / k) ** (2.0 / 3.0) + (impact / k) ** 0.4) / depth - 1.0

    lowest = math.log(max(force / depth**1.5, impact / depth**2.5))
    return math.exp(brentq(excess, lowest, lowest + 10.0, xtol=1e-14, rtol=1e-14))
