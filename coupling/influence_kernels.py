"""Compiled influence of grains on each other: what places alone decide of field and potential, found once an update.

Field and potential of a moment are linear in it, so a grain's own images, its neighbours and their images in steel are
blocks (3, 4): the part of S_x, S_y, S_z [1/m^3] and P [1/m^2] that each component of the neighbour's moment makes, in
the neighbour's own frame. The sweeps of `coupling.moment_kernels` only multiply. With T = (c1 n n - c2 1)/(4 pi) and
P = k (2 u u - 1) the mirror at a wall's normal u, an image adds (T P_j + P_i T)/2 to the field, the one T from the
image of j to i, the other from j to the image of i, and p n . P_j to the potential: see `coupling.mirror`.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.grain_law_table import FARTHEST_GAP, gap_place
from coupling.mirror import FACES_NO_WALL, normal_at, pushed
from coupling.pair_fields import OVER_4PI, field_factors
from geometry.inner_functions import inner

# columns of a near pair
NX, NY, NZ, PER_R, MUTUAL, MEAN, PLACE = range(7)


@inner(error_model="numpy", fastmath={"contract"})
def is_near(r2, both, radius_i, radius_j):
    """Whether two grains at the squared distance r2 are more than mutual dipoles; ``both``: sum of their radii."""
    if r2 >= 2.56 * both * both:  # at most (1 + 1.2/2) times the sum of the radii
        return False
    return (np.sqrt(r2) - both) * both < FARTHEST_GAP * 2.0 * radius_i * radius_j


@inner(error_model="numpy", fastmath={"contract"})
def _dipole_block(dx, dy, dz, least, reach, smear):
    """4 pi T (xx, yy, zz, xy, xz, yz) and 4 pi p n at the distance vector d from a moment; 0 beyond reach.

    Nearer than ``least`` [m] it is as at ``least``.
    """
    r2 = dx * dx + dy * dy + dz * dz
    if r2 >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = np.sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(max(r, least), reach, smear)
    ax, ay, az = c1 * nx, c1 * ny, c1 * nz
    return ax * nx - c2, ay * ny - c2, az * nz - c2, ax * ny, ax * nz, ay * nz, p * nx, p * ny, p * nz


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def influences(model, grains, rows, twin, walls, own, block, own_image, near):
    """Blocks (p + n, 3, 4) of all pairs of the rows and, behind them, of each grain on itself; 0 beyond reach.

    ``twin`` (p,) is where the pair of an entry stands in the row of the other grain, or -1: both entries are found at
    the first of them. The field's part of one is that of the other transposed, because both are derivatives of one
    energy. ``own`` [1/m^3] is a grain's own share, ``own_image`` (n, w, 3) [1/m^2] the part of its own image in its
    potential, ``near`` (p,) 1 for partners of `near_pairs`, else 0.
    """
    position, radius, height, reach, smear = grains.position, grains.radius, grains.height, model.reach, model.smear
    start, other, shift, turn_cos, turn_sin = rows
    p = other.shape[0]
    for i in prange(position.shape[0]):
        xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
        for q in range(start[i] - 1, start[i + 1]):  # itself first
            j, b, t, c, s = np.int64(i), np.int64(p + i), np.int64(-1), 1.0, 0.0
            xx = yy = zz = xy = xz = yz = yx = zx = zy = px = py = pz = 0.0  # xy: along x, of a moment along y
            qx = qy = qz = 0.0  # of the potential of i at j
            if q >= start[i]:
                t = np.int64(twin[q])
                if 0 <= t < q:
                    continue
                j, b, c, s = np.int64(other[q]), np.int64(q), turn_cos[shift[q]], turn_sin[shift[q]]
            jx, jy, jz = (
                c * position[j, 0] - s * position[j, 1],
                s * position[j, 0] + c * position[j, 1],
                position[j, 2],
            )
            if q >= start[i]:
                dx, dy, dz = xi - jx, yi - jy, zi - jz
                both = radius[i] + radius[j]
                near[q] = 1 if is_near(dx * dx + dy * dy + dz * dz, both, radius[i], radius[j]) else 0
                xx, yy, zz, xy, xz, yz, px, py, pz = _dipole_block(dx, dy, dz, both, reach, smear)
                yx, zx, zy = xy, xz, yz
                qx, qy, qz = -px, -py, -pz
            for w in range(walls.shape[0]):
                if q < start[i]:
                    own_image[i, w, 0] = own_image[i, w, 1] = own_image[i, w, 2] = 0.0
                if height[i, w] >= FACES_NO_WALL or height[j, w] >= FACES_NO_WALL:
                    continue
                hi, h = pushed(height[i, w], radius[i]), pushed(height[j, w], radius[j])
                if height[j, w] * hi < 0.0 or abs(hi + h) >= reach:  # an image is never nearer than both heights
                    continue
                k = walls[w, 5]
                wx, wy, wz = normal_at(walls, w, xi, yi)
                ux, uy, uz = normal_at(walls, w, jx, jy)
                # at i of the image of j: T P
                axx, ayy, azz, axy, axz, ayz, fx, fy, fz = _dipole_block(
                    xi - (jx - 2.0 * h * ux), yi - (jy - 2.0 * h * uy), zi - (jz - 2.0 * h * uz), 0.0, reach, smear
                )
                vx, vy, vz = (
                    axx * ux + axy * uy + axz * uz,
                    axy * ux + ayy * uy + ayz * uz,
                    axz * ux + ayz * uy + azz * uz,
                )
                # at the image of i of j: P T
                bxx, byy, bzz, bxy, bxz, byz, gx, gy, gz = _dipole_block(
                    (xi - 2.0 * hi * wx) - jx, (yi - 2.0 * hi * wy) - jy, (zi - 2.0 * hi * wz) - jz, 0.0, reach, smear
                )
                tx, ty, tz = (
                    bxx * wx + bxy * wy + bxz * wz,
                    bxy * wx + byy * wy + byz * wz,
                    bxz * wx + byz * wy + bzz * wz,
                )
                xx += k * (vx * ux + wx * tx - 0.5 * (axx + bxx))
                yy += k * (vy * uy + wy * ty - 0.5 * (ayy + byy))
                zz += k * (vz * uz + wz * tz - 0.5 * (azz + bzz))
                axy, axz, ayz = 0.5 * (axy + bxy), 0.5 * (axz + bxz), 0.5 * (ayz + byz)
                xy += k * (vx * uy + wx * ty - axy)
                yx += k * (vy * ux + wy * tx - axy)
                xz += k * (vx * uz + wx * tz - axz)
                zx += k * (vz * ux + wz * tx - axz)
                yz += k * (vy * uz + wy * tz - ayz)
                zy += k * (vz * uy + wz * ty - ayz)
                twice = 2.0 * (fx * ux + fy * uy + fz * uz)
                fx, fy, fz = k * (twice * ux - fx), k * (twice * uy - fy), k * (twice * uz - fz)
                px, py, pz = px + fx, py + fy, pz + fz
                twice = 2.0 * (gx * wx + gy * wy + gz * wz)  # seen from j: against the distance vector
                qx, qy, qz = qx - k * (twice * wx - gx), qy - k * (twice * wy - gy), qz - k * (twice * wz - gz)
                if q < start[i]:
                    own_image[i, w, 0], own_image[i, w, 1] = OVER_4PI * fx, OVER_4PI * fy
                    own_image[i, w, 2] = OVER_4PI * fz
            itself = own if q < start[i] else 0.0
            c, s = OVER_4PI * c, OVER_4PI * s  # to the frame of j
            block[b, 0, 0], block[b, 1, 0], block[b, 2, 0] = c * xx + s * xy + itself, c * xy - s * xx, OVER_4PI * xz
            block[b, 0, 1], block[b, 1, 1], block[b, 2, 1] = c * yx + s * yy, c * yy - s * yx + itself, OVER_4PI * yz
            block[b, 0, 2], block[b, 1, 2], block[b, 2, 2] = c * zx + s * zy, c * zy - s * zx, OVER_4PI * zz + itself
            block[b, 0, 3], block[b, 1, 3], block[b, 2, 3] = c * px + s * py, c * py - s * px, OVER_4PI * pz
            if t >= 0:
                near[t] = near[q]
                for a in range(3):
                    for e in range(3):
                        block[t, a, e] = block[b, e, a]
                block[t, 0, 3], block[t, 1, 3], block[t, 2, 3] = OVER_4PI * qx, OVER_4PI * qy, OVER_4PI * qz


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def slope_along(i, nx, ny, nz, grains):
    """n . grad H . n [A/m^2] of the applied field at grain i, n in the grain's own place."""
    position, slope = grains.position, grains.slope
    x, y = position[i, 0], position[i, 1]
    rho2 = x * x + y * y
    if rho2 == 0.0:
        return slope[i, 2] * nz * nz
    rho = np.sqrt(rho2)
    n_r, n_phi = (nx * x + ny * y) / rho, (ny * x - nx * y) / rho
    return slope[i, 0] * n_r * n_r + slope[i, 1] * n_phi * n_phi + (slope[i, 2] * nz + slope[i, 3] * n_r) * nz


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def near_pairs(table, model, grains, rows, twin, place, row, near):
    """Near pairs (k, 7), those of an entry q from place[q] to place[q + 1], and their ``row`` (k,): what gives h_ij,

    h = ``MEAN`` - (P_i - P_j) ``PER_R`` + (m_i + m_j).n ``MUTUAL``, at the ``PLACE`` of their gap in the table. Seen from
    j both n and h are the opposite.
    """
    position, radius, applied = grains.position, grains.radius, grains.applied
    reach, smear, smallest_gap = model.reach, model.smear, model.smallest_gap
    start, other, shift, turn_cos, turn_sin = rows
    for i in prange(position.shape[0]):
        for q in range(start[i], start[i + 1]):
            k, t = place[q], np.int64(twin[q])
            if place[q + 1] == k or 0 <= t < q:
                continue
            j = other[q]
            c, s = turn_cos[shift[q]], turn_sin[shift[q]]
            dx = position[i, 0] - (c * position[j, 0] - s * position[j, 1])
            dy = position[i, 1] - (s * position[j, 0] + c * position[j, 1])
            dz = position[i, 2] - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            both = radius[i] + radius[j]
            true_r = np.sqrt(r2)
            per_r = 1.0 / true_r
            nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
            r = max(true_r, both)
            gap = max((true_r - both) * both / (2.0 * radius[i] * radius[j]), smallest_gap)
            hx, hy = c * applied[j, 0] - s * applied[j, 1], s * applied[j, 0] + c * applied[j, 1]
            per_r = 1.0 / r
            near[k, NX], near[k, NY], near[k, NZ], near[k, PER_R] = nx, ny, nz, per_r
            if smear:  # the partner's smear, which the applied field holds, is not its drive: Q/(4 pi r^3)
                near[k, MUTUAL] = OVER_4PI * per_r * per_r * per_r
            else:
                _, _, f = field_factors(r, reach, smear)
                near[k, MUTUAL] = OVER_4PI * f * per_r
            mean = 0.5 * ((applied[i, 0] + hx) * nx + (applied[i, 1] + hy) * ny + (applied[i, 2] + applied[j, 2]) * nz)
            if smear:  # the mean of the cubic, see `coupling.moment_kernels.drive_of_pair`
                bend = slope_along(i, nx, ny, nz, grains)
                bend -= slope_along(j, c * nx + s * ny, c * ny - s * nx, nz, grains)
                mean -= r / 12.0 * bend
            near[k, MEAN] = mean
            near[k, PLACE] = gap_place(table, gap)
            row[k] = q
            if t >= 0:
                g = place[t]
                near[g] = near[k]
                near[g, NX], near[g, NY], near[g, NZ] = -(c * nx + s * ny), s * nx - c * ny, -nz
                near[g, MEAN] = -mean
                row[g] = t
