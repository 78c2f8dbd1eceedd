"""Field, potential and force of two dipoles and charges, whole or less the part that is smeared, for the kernels.

With n the unit vector from b to a and r their distance, the moment m_b [A m^2] and the charge Q_b [A m] of b make at a,
over ``4 pi``,

    H = c1 (m_b . n) n - c2 m_b + p Q_b n,        potential  p (m_b . n) + psi Q_b,

and U = mu_0 (Q_a phi - m_a . H), the same seen from either:

- **whole**, ended by a switch s(r) between 0.9 and 1 times the reach A: c2 = s/r^3, c1 = 3 c2, p = s/r^2. With
  x = r/A, w = 0.1 and t = (x - 0.9)/w the switch is s = 1 - x^2 t^2 [3 + 2 w - (2 + 2 w) t], for which p = -dpsi/dr has
  the integral psi = 1/r - {1 + w f(1) - w t^3 f(t)}/A, f(t) = (3 + 2 w)/3 - (2 + 2 w) t/4; s, its slope and psi are 0
  at A;
- **less the smear** (``smear``): a dipole less one spread out with K(r) = 105/(32 pi A^3) (1 - x^2)^2, of which
  Q(x) = (35 x^3 - 42 x^5 + 15 x^7)/8 lies within r: c2 = (1 - Q)/r^3, c1 = 3 c2 + 4 pi K, p = (1 - Q)/r^2, and
  psi = 1/r - [1 + (9.5 - 17.5 x^2 + 10.5 x^4 - 2.5 x^6)/8]/A. It ends at A exactly, and the mean over an even powder of
  the dipoles' part, with the grain's own K(0) m/3, is the Lorentz field.

Every interaction ends in its energy, and forces are gradients of U at fixed moments and charges, so the third law is
exact and angular momentum closes with the torque m x H. Less the smear all factors are those of one potential:
c2 = p/r and c1 = c2 - p'. So they are of whole ones below 0.9 A; beyond, c1 = 3 c2 leaves out s', which is large there:
the field of a dipole then fades as its potential does.

The constant in psi is an even charge that ends at A; a charge has it at its own place too (`self_potential_factor`),
so that it cancels among charges whose sum is 0.

Slopes follow from Q' = 4 pi r^2 K: c2' = -(4 pi K + 3 c2)/r and c1' = 3 c2' + 4 pi K'.

Distances, moments and charges may be scalars or SIMD vectors (`geometry.kernels.simd`).
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import maximum

MU_0_OVER_4PI = 1e-7
OVER_4PI = 1.0 / (4.0 * np.pi)
SWITCH = 0.9  # of the reach: where whole dipoles and charges begin to end
_WIDTH = 1.0 - SWITCH
# of the switch and of psi: such that p and its slope are 0 at the reach
_SQUARE, _CUBE = 3.0 + 2.0 * _WIDTH, 2.0 + 2.0 * _WIDTH
_SHIFT = 1.0 + _WIDTH * (_SQUARE / 3.0 - _CUBE / 4.0)


def self_field_factor(reach: float, smear: bool) -> float:
    """K(0)/3 = 35/(32 pi a^3) [1/m^3]: a smeared grain's own part of the mean field per moment; 0 without smear."""
    return 35.0 / (32.0 * np.pi * reach**3) if smear else 0.0


def self_potential_factor(reach: float, smear: bool) -> float:
    """Potential per charge [1/m] of what a grain's own charge is ended by: psi - 1/r at r = 0, over 4 pi."""
    return -(2.1875 if smear else _SHIFT) / (4.0 * np.pi * reach)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _switch(r, reach):
    """The switch s(r) and ds/dr [1/m]."""
    x = r * (1.0 / reach)
    t = maximum((x - SWITCH) * (1.0 / _WIDTH), 0.0)
    fall = x * t * (2.0 * t * (_SQUARE - _CUBE * t) + x * (2.0 * _SQUARE - 3.0 * _CUBE * t) * (1.0 / _WIDTH))
    return 1.0 - x * x * t * t * (_SQUARE - _CUBE * t), -fall * (1.0 / reach)


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
def charge_factors(r, reach, smear):
    """psi [1/m] and dp/dr [1/m^3] at distance r < reach; dpsi/dr is -p."""
    per_r = 1.0 / r
    x = r * (1.0 / reach)
    if smear:
        x2 = x * x
        c1, c2, _ = field_factors(r, reach, smear)
        even = 2.1875 - x2 * (2.1875 - x2 * (1.3125 - 0.3125 * x2))
        return per_r - even * (1.0 / reach), c2 - c1
    t = maximum((x - SWITCH) * (1.0 / _WIDTH), 0.0)
    even = _SHIFT - _WIDTH * t * t * t * (_SQUARE / 3.0 - 0.25 * _CUBE * t)
    switch, fall = _switch(r, reach)
    return per_r - even * (1.0 / reach), (fall - 2.0 * switch * per_r) * per_r * per_r


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


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def charge_force(ax, ay, az, qa, bx, by, bz, qb, nx, ny, nz, r, reach, smear):
    """Force on a, in addition to `pair_force`, of moments [A m^2] and charges [A m] of a and b, as that one.

    With u = Q_b m_a - Q_a m_b it is (p' - p/r) (u . n) n + (p/r) u + p Q_a Q_b n.
    """
    _, _, p = field_factors(r, reach, smear)
    _, p_r = charge_factors(r, reach, smear)
    ux, uy, uz = qb * ax - qa * bx, qb * ay - qa * by, qb * az - qa * bz
    c = p * (1.0 / r)
    along = (p_r - c) * (ux * nx + uy * ny + uz * nz) + p * qa * qb
    return along * nx + c * ux, along * ny + c * uy, along * nz + c * uz
