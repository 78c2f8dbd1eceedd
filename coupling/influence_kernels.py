"""Compiled influence of grains on each other: what places alone decide of field and potential, found once an update.

Field and potential of a moment are linear in it. Of a pair n, c1, c2 and p are kept (`coupling.pair_fields`), six
numbers from which a sweep of `coupling.moment_kernels` has both; they are the same from either side but for the
direction. A grain's own images, and those of its neighbours in steel, are blocks (3, 4): the part of S_x, S_y, S_z
[1/m^3] and P [1/m^2] that each component of the moment makes, in the neighbour's own frame. With
T = (c1 n n - c2 1)/(4 pi) and P = k (2 u u - 1) the mirror at a wall's normal u, an image adds (T P_j + P_i T)/2 to the
field, the one T from the image of j to i, the other from j to the image of i, and p n . P_j to the potential: see
`coupling.mirror`. The field's part seen from j is the transposed one, because both are derivatives of one energy.
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
def _dipole_block(dx, dy, dz, reach, smear):
    """4 pi T (xx, yy, zz, xy, xz, yz) and 4 pi p n at the distance vector d from a moment; 0 beyond reach."""
    r2 = dx * dx + dy * dy + dz * dz
    if r2 >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = np.sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(r, reach, smear)
    ax, ay, az = c1 * nx, c1 * ny, c1 * nz
    return ax * nx - c2, ay * ny - c2, az * nz - c2, ax * ny, ax * nz, ay * nz, p * nx, p * ny, p * nz


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def pair_influences(model, grains, rows, twin, pair, near, imaged):
    """Numbers (p, 6) of all entries of the rows, 0 beyond reach; see `coupling.kernel_state.Influence`.

    ``twin`` (p,) is where the pair of an entry stands in the row of the other grain, or -1: both entries are found at
    the first of them. ``near`` and ``imaged`` (p,): 1 for partners of `near_pairs` and of `image_influences`, else 0.
    """
    position, radius, height, reach, smear = grains.position, grains.radius, grains.height, model.reach, model.smear
    start, other, shift, turn_cos, turn_sin = rows
    for i in prange(position.shape[0]):
        for q in range(start[i], start[i + 1]):
            t = np.int64(twin[q])
            if 0 <= t < q:
                continue
            j, c, s = np.int64(other[q]), turn_cos[shift[q]], turn_sin[shift[q]]
            dx = position[i, 0] - (c * position[j, 0] - s * position[j, 1])
            dy = position[i, 1] - (s * position[j, 0] + c * position[j, 1])
            dz = position[i, 2] - position[j, 2]
            both = radius[i] + radius[j]
            r2 = dx * dx + dy * dy + dz * dz
            nx = ny = nz = c1 = c2 = p = 0.0
            if r2 < reach * reach:
                r = np.sqrt(r2)
                nx, ny, nz = dx / r, dy / r, dz / r
                c1, c2, p = field_factors(max(r, both), reach, smear)
            c1, c2, p = OVER_4PI * c1, OVER_4PI * c2, OVER_4PI * p
            pair[q, 0], pair[q, 1], pair[q, 2], pair[q, 3], pair[q, 4], pair[q, 5] = nx, ny, nz, c1, c2, p
            near[q] = 1 if model.near and is_near(r2, both, radius[i], radius[j]) else 0
            imaged[q] = 0
            for w in range(height.shape[1]):
                if sees_image(height, i, j, w, radius, reach):
                    imaged[q] = 1
            if t >= 0:
                pair[t, 0], pair[t, 1], pair[t, 2] = -(c * nx + s * ny), s * nx - c * ny, -nz
                pair[t, 3], pair[t, 4], pair[t, 5] = c1, c2, p
                near[t], imaged[t] = near[q], imaged[q]


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def sees_image(height, i, j, w, radius, reach):
    """Whether grain i may be within reach of the image of j in wall ``w``, which is never nearer than both heights."""
    if height[i, w] >= FACES_NO_WALL or height[j, w] >= FACES_NO_WALL or height[i, w] * height[j, w] < 0.0:
        return False
    return abs(pushed(height[i, w], radius[i]) + pushed(height[j, w], radius[j])) < reach


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def image_influences(model, grains, rows, twin, walls, own, place, row, image, itself, own_image):
    """Blocks of images of each entry q that sees some, from place[q] to place[q + 1], and of each grain on itself.

    ``own`` [1/m^3] is a grain's own share of the mean field, ``own_image`` (n, w, 3) [1/m^2] the part of its own image
    in its potential, ``row`` (e,) the entry of each block.
    """
    position, radius, height, reach, smear = grains.position, grains.radius, grains.height, model.reach, model.smear
    start, other, shift, turn_cos, turn_sin = rows
    for i in prange(position.shape[0]):
        xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
        for q in range(start[i] - 1, start[i + 1]):  # itself first
            j, b, t, c, s = np.int64(i), np.int64(-1), np.int64(-1), 1.0, 0.0
            xx = yy = zz = xy = xz = yz = yx = zx = zy = px = py = pz = 0.0  # xy: along x, of a moment along y
            qx = qy = qz = 0.0  # of the potential of i at j
            if q >= start[i]:
                t, b = np.int64(twin[q]), place[q]
                if place[q + 1] == b or 0 <= t < q:
                    continue
                j, c, s = np.int64(other[q]), turn_cos[shift[q]], turn_sin[shift[q]]
            jx, jy, jz = (
                c * position[j, 0] - s * position[j, 1],
                s * position[j, 0] + c * position[j, 1],
                position[j, 2],
            )
            for w in range(walls.shape[0]):
                if b < 0:
                    own_image[i, w, 0] = own_image[i, w, 1] = own_image[i, w, 2] = 0.0
                if not sees_image(height, i, j, w, radius, reach):
                    continue
                hi, h = pushed(height[i, w], radius[i]), pushed(height[j, w], radius[j])
                k = walls[w, 5]
                wx, wy, wz = normal_at(walls, w, xi, yi)
                ux, uy, uz = normal_at(walls, w, jx, jy)
                # at i of the image of j: T P
                axx, ayy, azz, axy, axz, ayz, fx, fy, fz = _dipole_block(
                    xi - (jx - 2.0 * h * ux), yi - (jy - 2.0 * h * uy), zi - (jz - 2.0 * h * uz), reach, smear
                )
                vx, vy, vz = (
                    axx * ux + axy * uy + axz * uz,
                    axy * ux + ayy * uy + ayz * uz,
                    axz * ux + ayz * uy + azz * uz,
                )
                # at the image of i of j: P T
                bxx, byy, bzz, bxy, bxz, byz, gx, gy, gz = _dipole_block(
                    (xi - 2.0 * hi * wx) - jx, (yi - 2.0 * hi * wy) - jy, (zi - 2.0 * hi * wz) - jz, reach, smear
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
                if b < 0:
                    own_image[i, w, 0], own_image[i, w, 1] = OVER_4PI * fx, OVER_4PI * fy
                    own_image[i, w, 2] = OVER_4PI * fz
            c, s = OVER_4PI * c, OVER_4PI * s  # to the frame of j
            block = itself[i] if b < 0 else image[b]
            block[0, 0], block[1, 0], block[2, 0] = c * xx + s * xy, c * xy - s * xx, OVER_4PI * xz
            block[0, 1], block[1, 1], block[2, 1] = c * yx + s * yy, c * yy - s * yx, OVER_4PI * yz
            block[0, 2], block[1, 2], block[2, 2] = c * zx + s * zy, c * zy - s * zx, OVER_4PI * zz
            block[0, 3], block[1, 3], block[2, 3] = c * px + s * py, c * py - s * px, OVER_4PI * pz
            if b < 0:
                block[0, 0], block[1, 1], block[2, 2] = block[0, 0] + own, block[1, 1] + own, block[2, 2] + own
                continue
            row[b] = q
            if t >= 0:
                e = place[t]
                row[e] = t
                for a in range(3):
                    for m in range(3):
                        image[e, a, m] = block[m, a]
                image[e, 0, 3], image[e, 1, 3], image[e, 2, 3] = OVER_4PI * qx, OVER_4PI * qy, OVER_4PI * qz


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
def near_pairs(table, model, grains, rows, twin, place, row, near_twin, near):
    """Near pairs (k, 7), those of an entry q from place[q] to place[q + 1], and their ``row`` (k,): what gives h_ij,

    h = ``MEAN`` - (P_i - P_j) ``PER_R`` + (m_i + m_j).n ``MUTUAL``, at the ``PLACE`` of their gap in the table. Seen
    from j both n and h are the opposite.
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
            row[k], near_twin[k] = q, -1
            if t >= 0:
                g = place[t]
                near_twin[k], near_twin[g] = g, k
                near[g] = near[k]
                near[g, NX], near[g, NY], near[g, NZ] = -(c * nx + s * ny), s * nx - c * ny, -nz
                near[g, MEAN] = -mean
                row[g] = t
