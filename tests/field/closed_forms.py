"""Closed forms of coils in air, to test against: circular loop, rectangular coil of loops, solenoid; inductances.

Loop: W. R. Smythe, Static and Dynamic Electricity, 3rd ed., sec. 7.10 (curl of its vector potential),
with complete elliptic integrals K(m), E(m) of the parameter m = k^2 = 4 R r/((R + r)^2 + z^2).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ellipe, ellipk

from field import MU_0


def loop_field(R: float, current: float, r: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """H of a circular current loop in the plane z = 0.

    Parameters
    ----------
    R : float
        Radius of the loop [m].
    current : float
        [A], positive along +phi.
    r, z : ndarray
        Cylindrical coordinates of the points [m], not on the wire.

    Returns
    -------
    H_r, H_z : ndarray
        Field strength [A/m].
    """
    r, z = np.broadcast_arrays(np.asarray(r, dtype=float), np.asarray(z, dtype=float))
    outer = (R + r) ** 2 + z**2
    inner = (R - r) ** 2 + z**2
    m = 4.0 * R * r / outer
    K, E = ellipk(m), ellipe(m)
    factor = current / (2.0 * math.pi * np.sqrt(outer))
    H_z = factor * (K + (R**2 - r**2 - z**2) / inner * E)
    # near the axis -K + ... E cancels; there H_r = (3/4) I R^2 z r/(R^2 + z^2)^(5/2)
    near = m < 1e-6
    general = factor * z / np.where(near, 1.0, r) * (-K + (R**2 + r**2 + z**2) / inner * E)
    H_r = np.where(near, 0.75 * current * R**2 * z * r / (R**2 + z**2) ** 2.5, general)
    return H_r, H_z


def mutual_inductance_of_loops(a: float, b: float, distance: float) -> float:
    """Mutual inductance [H] of coaxial circles of radii a, b [m] (Maxwell, A Treatise, 1873, art. 701)."""
    k = np.sqrt(4.0 * a * b / ((a + b) ** 2 + distance**2))
    return float(MU_0 * np.sqrt(a * b) * ((2.0 / k - k) * ellipk(k**2) - 2.0 / k * ellipe(k**2)))


def self_inductance_of_ring(radius: float, width: float, height: float) -> float:
    """Inductance [H] of a thin ring of rectangular section, of even current density.

    mu_0 a (ln(8 a/g) - 2) with g = 0.2235 (w + h) (Rosa and Grover, Bulletin of the Bureau of Standards 8, 1912).
    """
    return float(MU_0 * radius * (np.log(8.0 * radius / (0.2235 * (width + height))) - 2.0))


def rectangular_coil_field(
    r_range: tuple[float, float],
    z_range: tuple[float, float],
    ampere_turns: float,
    r: np.ndarray,
    z: np.ndarray,
    n: int = 24,
) -> tuple[np.ndarray, np.ndarray]:
    """H of a coil of rectangular section with uniform current density, by n x n Gauss-Legendre loops.

    Converges exponentially with n at points outside the section.

    Parameters
    ----------
    r_range, z_range : tuple of float
        The section [m].
    ampere_turns : float
        N I [A].
    r, z : ndarray
        Points [m].

    Returns
    -------
    H_r, H_z : ndarray
        [A/m]
    """
    node, weight = np.polynomial.legendre.leggauss(n)
    radii = 0.5 * (r_range[0] + r_range[1]) + 0.5 * (r_range[1] - r_range[0]) * node
    heights = 0.5 * (z_range[0] + z_range[1]) + 0.5 * (z_range[1] - z_range[0]) * node
    r, z = np.broadcast_arrays(np.asarray(r, dtype=float), np.asarray(z, dtype=float))
    H_r, H_z = np.zeros(r.shape), np.zeros(r.shape)
    for R, w_r in zip(radii, weight, strict=True):
        for height, w_z in zip(heights, weight, strict=True):
            dH_r, dH_z = loop_field(float(R), float(0.25 * ampere_turns * w_r * w_z), r, z - height)
            H_r += dH_r
            H_z += dH_z
    return H_r, H_z


def solenoid_axis_field(R: float, length: float, ampere_turns: float, z: np.ndarray) -> np.ndarray:
    """H_z [A/m] on the axis of a cylindrical current sheet centred at z = 0.

    H_z = (N I/2 L) [ (z + L/2)/sqrt((z + L/2)^2 + R^2) - (z - L/2)/sqrt((z - L/2)^2 + R^2) ].
    """
    z = np.asarray(z, dtype=float)
    up, down = z + 0.5 * length, z - 0.5 * length
    return ampere_turns / (2.0 * length) * (up / np.hypot(up, R) - down / np.hypot(down, R))
