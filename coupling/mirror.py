"""Mirror images of grains in steel walls of revolution: inner functions of the kernels.

A wall is a line in the (r, z) section: row (r0, z0, tangent r, tangent z, length, k). Its normal n is the tangent
turned by +90 degrees; a grain at the signed height h over it has its image at x* = x - 2 h n, in a cylinder at r -> 2 R
- r, with the moment P m = k (2 (m.n) n - m), n in the grain's own half plane (`coupling.wall_images`).

Between two grains and a wall there is one energy, whichever of the two is mirrored,

    U_ij* = -(mu_0/2) [m_i . T(x_i - x_j*) P_j m_j + m_j . T(x_j - x_i*) P_i m_i],
    U_ii* = -(mu_0/2) m_i . T(x_i - x_i*) P_i m_i;

fields are H = -(1/mu_0) dU/dm, forces F = -dU/dx with the images moving along. At a plane both halves are equal. At a
cylinder they are not, and a force from one of them alone would turn the powder by itself: a spurious torque of d/R.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coupling.pair_fields import field_factors, pair_force
from geometry.inner_functions import inner

FACES_NO_WALL = 1e30


class AtWall(NamedTuple):
    """A grain over a wall: place [m], height at which it is mirrored [m], the wall's normal there, moment [A m^2]."""

    x: float
    y: float
    z: float
    h: float
    nx: float
    ny: float
    nz: float
    mx: float
    my: float
    mz: float


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def height_over(walls, w, x, y, z, reach):
    """Signed height over the line of wall ``w``, `FACES_NO_WALL` where the foot lies beside or farther than reach."""
    dr, dz = np.sqrt(x * x + y * y) - walls[w, 0], z - walls[w, 1]
    along = dr * walls[w, 2] + dz * walls[w, 3]
    h = -dr * walls[w, 3] + dz * walls[w, 2]
    return h if 0.0 <= along <= walls[w, 4] and abs(h) < reach else FACES_NO_WALL


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def normal_at(walls, w, x, y):
    """The normal of wall ``w`` in the half plane of a point."""
    rho = np.sqrt(x * x + y * y)
    if rho == 0.0:
        return 0.0, 0.0, walls[w, 2]
    out = -walls[w, 3] / rho
    return out * x, out * y, walls[w, 2]


@inner(error_model="numpy", fastmath={"contract"})
def pushed(h, radius):
    """The height at which a grain is mirrored: not nearer than its radius, its poles do not enter the steel."""
    return max(h, radius) if h > 0.0 else min(h, -radius)


@inner(error_model="numpy", fastmath={"contract"})
def mirrored(k, mx, my, mz, nx, ny, nz):
    """P m."""
    twice = 2.0 * (mx * nx + my * ny + mz * nz)
    return k * (twice * nx - mx), k * (twice * ny - my), k * (twice * nz - mz)


@inner(error_model="numpy", fastmath={"contract"})
def dipole_field(mx, my, mz, dx, dy, dz, reach, smear):
    """4 pi times the field, and the potential, of a moment at the distance vector d from it; 0 beyond reach."""
    r2 = dx * dx + dy * dy + dz * dz
    if r2 >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    r = np.sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(r, reach, smear)
    along = mx * nx + my * ny + mz * nz
    return c1 * along * nx - c2 * mx, c1 * along * ny - c2 * my, c1 * along * nz - c2 * mz, p * along


@inner(error_model="numpy", fastmath={"contract"})
def moved_force(ax, ay, az, bx, by, bz, dx, dy, dz, reach, smear):
    """Force on moment a at d from moment b, over mu_0/(4 pi); 0 beyond reach."""
    r2 = dx * dx + dy * dy + dz * dz
    if r2 >= reach * reach:
        return 0.0, 0.0, 0.0
    r = np.sqrt(r2)
    per_r = 1.0 / r
    return pair_force(ax, ay, az, bx, by, bz, dx * per_r, dy * per_r, dz * per_r, r, reach, smear)


@inner(error_model="numpy", fastmath={"contract"})
def image_force(k, own, other, reach, smear):
    """Force on the grain ``own`` of its energy with the image of the ``other``, over mu_0/(4 pi): -dU/dx_i."""
    x, y, z, hx, nx, ny, nz, ax, ay, az = own
    jx, jy, jz, h, ux, uy, uz, mx, my, mz = other
    px, py, pz = mirrored(k, mx, my, mz, ux, uy, uz)
    fx, fy, fz = moved_force(
        ax, ay, az, px, py, pz, x - (jx - 2.0 * h * ux), y - (jy - 2.0 * h * uy), z - (jz - 2.0 * h * uz), reach, smear
    )
    # the other half: j acts on the image of i, which moves with i
    sx, sy, sz = x - 2.0 * hx * nx, y - 2.0 * hx * ny, z - 2.0 * hx * nz
    qx, qy, qz = mirrored(k, ax, ay, az, nx, ny, nz)
    gx, gy, gz = moved_force(qx, qy, qz, mx, my, mz, sx - jx, sy - jy, sz - jz, reach, smear)
    # in the section the image moves mirrored; about the axis by the ratio of radii
    along = 2.0 * (gx * nx + gy * ny + gz * nz)
    gx, gy, gz = gx - along * nx, gy - along * ny, gz - along * nz
    rho = np.sqrt(x * x + y * y)
    if rho > 0.0:
        ex, ey = -y / rho, x / rho
        g_phi = gx * ex + gy * ey
        more = (np.sqrt(sx * sx + sy * sy) / rho - 1.0) * g_phi
        # its moment turns with the half plane: dm*/dphi = z x m* - P (z x m)
        cx, cy, cz, _ = dipole_field(mx, my, mz, sx - jx, sy - jy, sz - jz, reach, smear)
        tx, ty, tz = mirrored(k, -ay, ax, 0.0, nx, ny, nz)
        more += (cx * (-qy - tx) + cy * (qx - ty) - cz * tz) / rho
        gx, gy = gx + more * ex, gy + more * ey
    return 0.5 * (fx + gx), 0.5 * (fy + gy), 0.5 * (fz + gz)
