"""Two equal linear spheres in a field across their line of centres, by multipoles.

Across, nothing gathers in the neck: the series converges quickly, touching or not, and saturation does little before
the whole sphere is saturated. The potential outside is that of the field H0 along x and of the multipoles

    sum_n B_n P_n^1(cos theta) cos(phi)/r^(n + 1)

about each centre (mirrored: (-1)^(n + 1) B_n about the other). About the other centre, at the distance R, a multipole
is (-1)^(k + 1) (n + k)!/((n - 1)! (k + 1)!) r^k P_k^1/R^(n + k + 1) (Hobson, The Theory of Spherical and Ellipsoidal
Harmonics, 1931, §89), and a sphere responds to a field of order k with alpha_k = k (mu - 1)/(k (mu + 1) + 1) of its
strength (Jackson, §4.4). The moment is 4 pi B_1; the force follows from the energy, -mu_0 m H0 for the two at constant
H0: F = mu_0 H0 dm/dR, a repulsion.

**As a part of an energy.** Two dipoles of the magnetisations M across their line repel each other with the energy
V^2 M_i.M_j/(4 pi R^3), V = 4 pi/3, beside which the multipoles leave

    W_t = -(V^2/(4 pi R^3)) kappa(g) c_i c_j M_i.M_j,        1 - kappa = 3 R^3 (1/m - 1/3),

m the moment over H0 of a pair of infinite permeability: a fraction kappa of the dipoles' energy is missing. Neighbours
on opposite sides of a grain cancel each other's even orders, one neighbour alone does not: in packings kappa comes from
a pair with odd orders only, a third of the whole (an isolated pair across its field then has 1.2 times its repulsion).
A sphere of finite permeability responds by c = (beta_s beta_d)^0.6 less, with beta = M/(3 h) and (dM/dh)/3 of the lone
sphere in its field h: within 6 % of the multipoles from a permeability of 4 on, and nothing far in saturation.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import gammaln

from field.spheres.pair_table import fade, fade_slope

ORDERS = 60
"""Multipoles: forces to 1e-5 for touching spheres of any permeability."""
_RESPONSE_POWER = 0.6
_GAPS = np.geomspace(1e-4, 1.3, 200)


def transverse_moment(permeability: float, gap: float, *, odd: bool = False) -> float:
    """Mean magnetisation of each sphere over H0 [-]; gap [radii]; of multipoles of odd order only with `odd`.

    Raises
    ------
    ValueError
        A permeability below 1, a gap below 0.
    """
    if not (permeability >= 1.0 and gap > -1e-3 and np.isfinite(gap)):
        raise ValueError(f"permeability {permeability} must be at least 1, gap {gap} at least 0")
    k = np.arange(1, ORDERS + 1, 2 if odd else 1)
    mu = permeability
    response = np.ones(k.size) if np.isinf(mu) else k * (mu - 1.0) / (k * (mu + 1.0) + 1.0)
    n, row = k[None, :], k[:, None]
    size = gammaln(n + row + 1) - gammaln(n) - gammaln(row + 2) - (n + row + 1) * np.log(2.0 + gap)
    matrix = np.eye(k.size) + response[:, None] * np.exp(size) * (-1.0) ** (n + row)
    source = np.zeros(k.size)
    source[0] = response[0]
    return 3.0 * float(np.linalg.solve(matrix, source)[0])


def transverse_fraction(gap: np.ndarray | float, *, odd: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """kappa and d kappa/dg at gaps [radii], faded to zero like the neck's energy; see the module.

    Splines of ln g, from 1e-4 on, below which kappa is constant.
    """
    g = np.asarray(gap, dtype=float)
    spline = _fraction_spline(odd)
    x = np.log(np.clip(g, _GAPS[0], _GAPS[-1]))
    fraction, slope = spline(x), np.where((g > _GAPS[0]) & (g < _GAPS[-1]), spline(x, 1) / np.exp(x), 0.0)
    return fraction * fade(g), slope * fade(g) + fraction * fade_slope(g)


@lru_cache(maxsize=2)
def _fraction_spline(odd: bool) -> CubicSpline:
    moments = np.array([transverse_moment(np.inf, gap, odd=odd) for gap in _GAPS])
    return CubicSpline(np.log(_GAPS), 1.0 - 3.0 * (2.0 + _GAPS) ** 3 * (1.0 / moments - 1.0 / 3.0))


def transverse_response(secant: np.ndarray | float, tangent: np.ndarray | float) -> np.ndarray:
    """c of a sphere in W_t from M/h and dM/dh of the lone sphere; 1 for infinite permeability, see the module.

    For Froehlich's law at the magnetisation M [Ms] it is [(1 + 3/(chi (1 - M))) (1 + 3/(chi (1 - M)^2))]^-0.6.
    """
    return (np.asarray(secant) * np.asarray(tangent) / 9.0) ** _RESPONSE_POWER
