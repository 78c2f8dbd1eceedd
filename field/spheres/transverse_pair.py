"""Two equal linear spheres in a field across their line of centres, by multipoles.

Across, nothing gathers in the neck: the series converges quickly, touching or not, and saturation does little before
the whole sphere is saturated. The potential outside is that of the field H0 along x and of the multipoles

    sum_n B_n P_n^1(cos theta) cos(phi)/r^(n + 1)

about each centre (mirrored: (-1)^(n + 1) B_n about the other). About the other centre, at the distance R, a multipole
is (-1)^(k + 1) (n + k)!/((n - 1)! (k + 1)!) r^k P_k^1/R^(n + k + 1) (Hobson, The Theory of Spherical and Ellipsoidal
Harmonics, 1931, §89), and a sphere answers a field of order k with alpha_k = k (mu - 1)/(k (mu + 1) + 1) of its
strength (Jackson, §4.4). The moment is 4 pi B_1; the force follows from the energy, -mu_0 m H0 for the two at constant
H0: F = mu_0 H0 dm/dR, a repulsion.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

ORDERS = 60
"""Multipoles: forces to 1e-5 for touching spheres of any permeability."""

_STEP = 1e-4  # of the derivative of the moment, radii: central, fourth order


def transverse_moment(permeability: float, gap: float) -> float:
    """Mean magnetisation of each sphere over H0 [-]; gap [radii].

    Raises
    ------
    ValueError
        A permeability below 1, a gap below 0.
    """
    if not (permeability >= 1.0 and gap > -1e-3 and np.isfinite(gap)):
        raise ValueError(f"permeability {permeability} must be at least 1, gap {gap} at least 0")
    k = np.arange(1, ORDERS + 1)
    mu = permeability
    answer = np.ones(ORDERS) if np.isinf(mu) else k * (mu - 1.0) / (k * (mu + 1.0) + 1.0)
    n, row = k[None, :], k[:, None]
    size = gammaln(n + row + 1) - gammaln(n) - gammaln(row + 2) - (n + row + 1) * np.log(2.0 + gap)
    matrix = np.eye(ORDERS) + answer[:, None] * np.exp(size) * (-1.0) ** (n + row)
    source = np.zeros(ORDERS)
    source[0] = answer[0]
    return 3.0 * float(np.linalg.solve(matrix, source)[0])


def transverse_force(permeability: float, gap: float) -> float:
    """Repulsion over mu_0 H0^2 a^2 [-], see `transverse_moment`."""
    near, far = (
        transverse_moment(permeability, gap + s * _STEP) - transverse_moment(permeability, gap - s * _STEP)
        for s in (1, 2)
    )
    return 4.0 / 3.0 * np.pi * (8.0 * near - far) / (12.0 * _STEP)


def transverse_excess(permeability: float, gap: float) -> float:
    """By how much the repulsion is weaker than that of mutual dipoles, over mu_0 H0^2 a^2 [-], at least 0."""
    beta = 1.0 if np.isinf(permeability) else (permeability - 1.0) / (permeability + 2.0)
    R = 2.0 + gap
    mutual = 3.0 * beta / (1.0 + beta / R**3)
    return np.pi / 12.0 * mutual**2 * (2.0 / R) ** 4 - transverse_force(permeability, gap)
