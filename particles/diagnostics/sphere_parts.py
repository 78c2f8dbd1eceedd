"""Volumes of parts of spheres: cut by a plane, and by a cylinder about the z axis.

**Plane.** The cap below height h over the centre, -R <= h <= R, has the volume pi (R + h)^2 (2 R - h)/3: exact.

**Cylinder.** The section of the sphere at height z is a circle of radius c = sqrt(R^2 - z^2); what of it lies within
the cylinder r < rho is a lens of two circular segments, known in closed form. Its integral over z is an elliptic one
(Lamarche & Leroy, Comput. Phys. Commun. 59 (1990) 359) whose terms cancel to (R/rho)^3 for a small grain at a large
radius, the case of a clutch. It is therefore integrated by Gauss-Legendre quadrature between the heights where the lens
changes its form; the substitution z ~ cos theta takes the half-integer powers out of these ends. With `NODES` points a
piece the volume is right to 1e-9 of the sphere's. A slab of heights is cut out at no further cost.
"""

from __future__ import annotations

import numpy as np

NODES = 16


def cap_volume(radius: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Volume [m^3] of spheres of ``radius`` below ``height`` [m] over their centres; any height."""
    h = np.clip(height, -radius, radius)
    return np.pi / 3.0 * (radius + h) ** 2 * (2.0 * radius - h)


def volume_in_cylinder(
    distance: np.ndarray,
    radius: np.ndarray,
    cylinder: float,
    low: np.ndarray | float = -np.inf,
    high: np.ndarray | float = np.inf,
) -> np.ndarray:
    """Volume of spheres within r < ``cylinder`` and ``low`` < z - z_centre < ``high``.

    Parameters
    ----------
    distance, radius : ndarray, shape (n,)
        Distance of the centres from the axis, radius of the spheres [m].
    cylinder : float
        Radius of the cylinder [m].
    low, high : float or ndarray, shape (n,)
        Heights relative to each centre [m].

    Returns
    -------
    ndarray, shape (n,)
        [m^3]
    """
    low, high = (np.broadcast_to(np.asarray(value, dtype=float), radius.shape) for value in (low, high))
    whole = cap_volume(radius, high) - cap_volume(radius, low)
    inside = np.where(distance + radius <= cylinder, whole, 0.0)
    cut = np.flatnonzero((np.abs(distance - cylinder) < radius) & (whole > 0.0))
    if len(cut) == 0 or cylinder <= 0.0:
        return inside
    b, R = distance[cut], radius[cut]
    inner, outer = (np.sqrt(np.maximum(R**2 - c**2, 0.0)) for c in (cylinder + b, np.abs(cylinder - b)))
    breaks = np.stack([-R, -outer, -inner, inner, outer, R], axis=1)
    breaks = np.clip(breaks, np.maximum(low[cut], -R)[:, None], np.minimum(high[cut], R)[:, None])
    node, weight = np.polynomial.legendre.leggauss(NODES)
    theta = 0.5 * np.pi * (node + 1.0)
    step = 0.5 * np.diff(breaks, axis=1)[:, :, None]
    z = breaks[:, :-1, None] + step * (1.0 - np.cos(theta))
    area = _lens(b[:, None, None], np.sqrt(np.maximum(R[:, None, None] ** 2 - z**2, 0.0)), cylinder)
    inside[cut] = np.sum(step * area * (0.5 * np.pi * weight * np.sin(theta)), axis=(1, 2))
    return inside


def _lens(b: np.ndarray, c: np.ndarray, rho: float) -> np.ndarray:
    """Area common to two circles of radii ``c`` and ``rho`` whose centres are ``b`` apart."""
    b, c = np.broadcast_arrays(b, c)
    smaller = np.minimum(c, rho)
    area = np.where(b <= np.abs(rho - c), np.pi * smaller**2, 0.0)
    part = (b > np.abs(rho - c)) & (b < rho + c)
    b, c = b[part], c[part]
    # distance of the common chord from the centre of c; the factored difference keeps its digits for b ~ rho >> c
    x = ((b - rho) * (b + rho) + c**2) / (2.0 * b)
    half = np.sqrt(np.maximum((c - x) * (c + x), 0.0))
    area[part] = c**2 * np.arctan2(half, x) + rho**2 * np.arctan2(half, b - x) - b * half
    return area
