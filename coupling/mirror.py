"""Mirror images of grains in steel walls of revolution: inner functions of the kernels.

A wall is a line in the (r, z) section: row (r0, z0, tangent r, tangent z, length, k). Its normal n is the tangent
turned by +90 degrees; a grain at the signed height h over it has its image at x* = x - 2 h n, in a cylinder at r -> 2 R
- r, n in the grain's own half plane. The image of a moment m [A m^2] is P m = k (2 (m.n) n - m), that of a charge Q
[A m] is -k Q (J. D. Jackson, Classical Electrodynamics, 4.4). `coupling.image_kernels` sums them.

Between two grains and a wall there is one energy, whichever of the two is mirrored. With
E(a, b) = mu_0 [Q_a phi_b(x_a) - m_a . H_b(x_a)], phi_b and H_b of moment and charge of b (`coupling.pair_fields`),

    U_ij* = [E(i, j*) + E(i*, j)]/2,        U_ii* = E(i, i*)/2;

fields are H = -(1/mu_0) dU/dm, potentials phi = (1/mu_0) dU/dQ, forces F = -dU/dx with the images moving along. At a
plane both halves are equal. At a cylinder they are not, and a force from one of them alone would turn the powder by
itself: a spurious torque of d/R.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function

FACES_NO_WALL = 1e30


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def height_over(walls, w, x, y, z, reach):
    """Signed height over the line of wall ``w``, `FACES_NO_WALL` where the foot is off it or beyond reach."""
    dr, dz = np.sqrt(x * x + y * y) - walls[w, 0], z - walls[w, 1]
    along = dr * walls[w, 2] + dz * walls[w, 3]
    h = -dr * walls[w, 3] + dz * walls[w, 2]
    return h if 0.0 <= along <= walls[w, 4] and abs(h) < reach else FACES_NO_WALL


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def normal_at(walls, w, x, y):
    """The normal of wall ``w`` in the half plane of a point."""
    rho = np.sqrt(x * x + y * y)
    if rho == 0.0:
        return 0.0, 0.0, walls[w, 2]
    out = -walls[w, 3] / rho
    return out * x, out * y, walls[w, 2]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mirror_height(h, radius):
    """Height at which a grain is mirrored: at least its radius, its poles do not enter the steel."""
    return max(h, radius) if h > 0.0 else min(h, -radius)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mirror_moment(k, mx, my, mz, nx, ny, nz):
    """Moment P m of the image."""
    twice = 2.0 * (mx * nx + my * ny + mz * nz)
    return k * (twice * nx - mx), k * (twice * ny - my), k * (twice * nz - mz)
