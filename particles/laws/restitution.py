r"""From restitution to damping, exact for contact forces that are clipped to be non-tensile.

Because the force never pulls, an impact ends when the force vanishes, before the overlap does (Schwager & Poeschel,
Granular Matter 9 (2007) 465). The grain then leaves freely: the spring only weakens, the force stays clipped.

**Linear.** With s = sqrt(1 - zeta^2)

    e(zeta) = exp(-(zeta/s) (pi - atan2(2 zeta s, 1 - 2 zeta^2))),       zeta < 1,

and its continuation beyond critical damping. `damping_ratio` solves e(zeta) = e (the common
-ln e/sqrt(pi^2 + ln^2 e) would give 0.9020, 0.5503, 0.3249 for 0.9, 0.5, 0.2).

**Hertz with Tsuji damping**, m x'' = -(k x^1.5 + alpha sqrt(m k) x^0.25 x'). With y = (2/sqrt 5) x^1.25 (m = k = 1) and
v = x', dy = (sqrt 5/2) x^0.25 dx turns v dv/dx into

    v dv/dy + 2 beta v + y = 0,      beta = alpha/sqrt 5

(the map of Antypov & Elliott, EPL 94 (2011) 50004): in the plane (y, v) it is the linear oscillator with zeta = beta.
The force vanishes where dv/dy does, so the clip falls on the same point of the orbit, and **beta = zeta(e) at every
speed, clip included**.

**F = k x^p + c x^q x'** with other exponents has a restitution that falls with the dimensionless damping

    g = c x_0^(q+1)/(m v),       x_0 = (m v^2/k)^(1/(p+1)),

and so depends on the speed v. With x = s^2 and dt = s d(sigma) the scaled impact x'' + g x^q x' + x^p = 0 is
polynomial,

    ds/d(sigma) = u/2,     du/d(sigma) = -s (s^2p + g s^2q u),

which is integrated to round-off (DOP853) and inverted (Brent). 20 to 50 ms, kept for the session.

e = 0 needs infinite damping. `MIN_RESTITUTION` is the least computed and stands for smaller ones, 0 included: the
impact keeps 1e-4 of its energy.
"""

from __future__ import annotations

import math
from functools import lru_cache

MIN_RESTITUTION = 0.01


def checked_restitution(restitution: float) -> float:
    """``restitution`` [-] in [0, 1], raised to `MIN_RESTITUTION`.

    Raises
    ------
    ValueError
        Outside 0 <= restitution <= 1.
    """
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution = {restitution:g}; allowed: 0 to 1 (speed after / before a head-on impact)")
    return max(restitution, MIN_RESTITUTION)


def check_reference(m_eff: float, speed: float) -> None:
    """Check the impact at which a restitution that depends on it is meant, ``m_eff`` [kg] and ``speed`` [m/s].

    Raises
    ------
    ValueError
        If one of them is not positive and finite.
    """
    for name, value, unit in (("reduced mass", m_eff, "kg"), ("reference speed", speed, "m/s")):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} of the impact = {value:g} {unit}; allowed: more than 0")


def restitution_of(zeta: float) -> float:
    """Restitution e [-] of the clipped linear contact at the damping ratio ``zeta`` [-] (module docstring)."""
    if zeta < 1.0:
        s = math.sqrt(1.0 - zeta * zeta)
        return math.exp(-(zeta / s) * (math.pi - math.atan2(2.0 * zeta * s, 1.0 - 2.0 * zeta * zeta)))
    s = math.sqrt(zeta * zeta - 1.0)
    # s -> 0 is the removable limit e = exp(-2) at critical damping; zeta - s = 1/(zeta + s) without its cancellation
    return math.exp(-2.0) if s < 1e-6 else math.exp(-2.0 * (zeta / s) * math.log(zeta + s))


@lru_cache(maxsize=256)
def damping_ratio(restitution: float) -> float:
    """Damping ratio zeta [-] that gives ``restitution`` [-] in the clipped linear contact, and in Hertz-Tsuji's.

    Raises
    ------
    ValueError
        Outside 0 <= restitution <= 1.
    """
    restitution = checked_restitution(restitution)
    if restitution == 1.0:
        return 0.0
    from scipy.optimize import brentq

    # e falls monotonically from 1 at zeta = 0 to 0.0068 at zeta = 6
    return float(brentq(lambda zeta: restitution_of(zeta) - restitution, 0.0, 6.0, xtol=1e-15, rtol=1e-14))


def power_law_restitution(g: float, elastic: float, damping: float) -> float:
    """Restitution e [-] of the clipped F = k x^p + c x^q x' at the dimensionless damping ``g`` [-].

    Parameters
    ----------
    elastic, damping
        The exponents p and q, multiples of 1/2 with p > q >= 0 (the transformed impact is polynomial then).
    """
    if g == 0.0:
        return 1.0
    from scipy.integrate import solve_ivp

    p2, q2 = round(2.0 * elastic), round(2.0 * damping)

    def force_vanishes(_, y):
        # signed: a last step that overshoots s = 0 at weak damping must not see the force grow again
        return math.copysign(abs(y[0]) ** (p2 - q2), y[0]) + g * y[1]

    force_vanishes.terminal, force_vanishes.direction = True, -1  # type: ignore[attr-defined]
    orbit = solve_ivp(
        lambda _, y: (0.5 * y[1], -y[0] * (y[0] ** p2 + g * y[0] ** q2 * y[1])),
        (0.0, 1e6), (0.0, 1.0), method="DOP853", rtol=1e-12, atol=1e-14, events=force_vanishes,
    )  # fmt: skip
    return -float(orbit.y[1, -1])


@lru_cache(maxsize=256)
def power_law_damping(restitution: float, elastic: float, damping: float) -> float:
    """Dimensionless damping g [-] that gives ``restitution`` [-] in the clipped F = k x^p + c x^q x'.

    Raises
    ------
    ValueError
        Outside 0 <= restitution <= 1.
    """
    restitution = checked_restitution(restitution)
    if restitution == 1.0:
        return 0.0
    from scipy.optimize import brentq

    def excess(log_g: float) -> float:
        return power_law_restitution(math.exp(log_g), elastic, damping) - restitution

    # e falls monotonically in g; for weak damping 1 - e is about 1.2 to 1.8 g
    return math.exp(brentq(excess, math.log(1e-9), math.log(200.0), xtol=1e-13, rtol=1e-13))
