"""Field, potential and force of two dipoles, whole or less the part that is smeared: inner functions of the kernels.

With n the unit vector from b to a and r their distance, the field of b's moment at a is, on ``4 pi``,

    H = c1 (m_b . n) n - c2 m_b,        potential  p (m_b . n),        U = -mu_0 m_a . H.

- **whole**, ended by the cubic switch s(r) between 0.9 and 1 times the reach: c2 = s/r^3, c1 = 3 c2, p = s/r^2;
- **less the smear** (``smear``): the dipole less one spread out with K(r) = 105/(32 pi a^3) (1 - x^2)^2, x = r/a,
  of which Q(x) = (35 x^3 - 42 x^5 + 15 x^7)/8 lies within r: c2 = (1 - Q)/r^3, c1 = 3 c2 + 4 pi K, p = (1 - Q)/r^2.
  It ends at a exactly, and its mean over an even powder, with the grain's own K(0) m/3, is the Lorentz field.

The force is the gradient of U at fixed moments, so the third law is exact and angular momentum closes with the torque
m x H. Both derivatives follow from Q' = 4 pi r^2 K: c2' = -(4 pi K + 3 c2)/r and c1' = 3 c2' + 4 pi K'.

Distances and moments may be scalars or SIMD vectors (`geometry.kernels.simd`).
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import maximum

MU_0_OVER_4PI = 1e-7
OVER_4PI = 1.0 / (4.0 * np.pi)
SWITCH = 0.9  # of the reach: where a whole dipole begins to end


def self_field_factor(reach: float, smear: bool) -> float:
    """K(0)/3 = 35/(32 pi a^3) [1/m^3]: a smeared grain's own part of the mean field per moment; 0 without smear."""
    return 35.0 / (32.0 * np.pi * reach**3) if smear else 0.0


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _switch(r, reach):
    """The switch s(r) and ds/dr [1/m]."""
    width = (1.0 - SWITCH) * reach
    t = maximum((r - SWITCH * reach) * (1.0 / width), 0.0)
    return 1.0 - t * t * (3.0 - 2.0 * t), -6.0 * t * (1.0 - t) * (1.0 / width)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def field_factors(r, reach, smear):
    """c1, c2 [1/m^3] and p [1/m^2] at distance r < reach."""
    per_r = 1.0 / r
    per_r2 = per_r * per_r
    if smear:
        x = r * (1.0 / reach)
        x2 = x * x
        left = 1.0 - x2
        kernel = 105.0 / (8.0 * reach * reach * reach) * left * left
        outside = 1.0 - 0.125 * x * x2 * (35.0 - x2 * (42.0 - 15.0 * x2))
        c2 = outside * per_r2 * per_r
        return 3.0 * c2 + kernel, c2, outside * per_r2
    switch, _ = _switch(r, reach)
    c2 = switch * per_r2 * per_r
    return 3.0 * c2, c2, switch * per_r2


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def field_slopes(r, reach, smear):
    """dc1/dr and dc2/dr [1/m^4] at distance r < reach."""
    per_r = 1.0 / r
    if smear:
        x = r * (1.0 / reach)
        left = 1.0 - x * x
        scale = 105.0 / (8.0 * reach * reach * reach)
        _, c2, _ = field_factors(r, reach, smear)
        slope = -(scale * left * left + 3.0 * c2) * per_r
        return 3.0 * slope - 4.0 * scale * left * x * (1.0 / reach), slope
    w = per_r * per_r * per_r
    switch, fall = _switch(r, reach)
    slope = w * (fall - 3.0 * switch * per_r)
    return 3.0 * slope, slope


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_force(ax, ay, az, bx, by, bz, nx, ny, nz, r, reach, smear):
    """Force on moment a [A m^2] from moment b, over mu_0/(4 pi) [A^2]; on b it is the opposite."""
    c1, _, _ = field_factors(r, reach, smear)
    c1_r, c2_r = field_slopes(r, reach, smear)
    an = ax * nx + ay * ny + az * nz
    bn = bx * nx + by * ny + bz * nz
    turning = c1 * (1.0 / r)
    along = (c1_r - 2.0 * turning) * an * bn - c2_r * (ax * bx + ay * by + az * bz)
    u, v = turning * bn, turning * an
    return along * nx + u * ax + v * bx, along * ny + u * ay + v * by, along * nz + u * az + v * bz
