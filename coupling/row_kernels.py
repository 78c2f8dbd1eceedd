"""Rows of neighbours, in SIMD vectors of eight entries: which are near, the field that they produce, their forces.

Inner functions of `coupling.influence_kernels` and `coupling.moment_kernels`. Every pair is computed from each of its
grains: that costs less than to scatter the reaction to the partner's row. Functions of the distance are computed
in every sweep, which takes less time than to load them.

Vectors that reach beyond the end of a row repeat its last entry, whose results are discarded.
"""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import FARTHEST_GAP
from coupling.mirror import FACES_NO_WALL
from coupling.pair_fields import MU_0_OVER_4PI, OVER_4PI, charge_factors, charge_force, field_factors, pair_force
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first, maximum, movemask, reduce_add, select, splat
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import eight_indices, gather, gather_column, gather_columns
from particles.periodic_images import images_of_partners, place_to_image, vector_to_image

NEAR, IMAGED = 1, 2  # bits of an entry's kind


@device_function(error_model="numpy")
def columns_of(vector, last):
    """Table (n, 4) of vectors (n, 3) and one number each (n,), whose rows are gathered into lanes at once."""
    table = np.empty((vector.shape[0], 4))
    for i in range(vector.shape[0]):
        table[i, 0], table[i, 1], table[i, 2], table[i, 3] = vector[i, 0], vector[i, 1], vector[i, 2], last[i]
    return table


@device_function(forceinline=True)
def first_present(t, e):
    """Eight rows t, those of e where there are none (-1)."""
    return (
        t[0] if t[0] >= 0 else e[0], t[1] if t[1] >= 0 else e[1], t[2] if t[2] >= 0 else e[2],
        t[3] if t[3] >= 0 else e[3], t[4] if t[4] >= 0 else e[4], t[5] if t[5] >= 0 else e[5],
        t[6] if t[6] >= 0 else e[6], t[7] if t[7] >= 0 else e[7],
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def any_crossing(rows, i):
    """True if a neighbour of grain i stands beyond a periodic face."""
    none, differs = rows.images.shape[0] // 2, 0
    for q in range(rows.start[i], rows.start[i + 1]):
        differs |= np.int64(rows.image[q]) ^ none
    return differs != 0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def kinds_of_row(i, place, height, model, rows, kind):
    """Mark the neighbours of grain i that are a near pair with it, and those with an image that may be within reach.

    ``height`` (n, w) [m]: at which they are mirrored, see `coupling.mirror.mirror_height`.
    """
    x, y, z, ri = place[i, 0], place[i, 1], place[i, 2], place[i, 3]
    stop, crossing = rows.start[i + 1], any_crossing(rows, i)
    for first in range(rows.start[i], stop, LANES):
        slot = eight_indices(first, stop - 1)
        j = gather(rows.other, slot)
        dx, dy, dz, rj = gather_columns(place, j, 0)
        near = imaged = 0
        if model.near:
            if crossing:
                dx, dy, dz = place_to_image(images_of_partners(rows.images, gather(rows.image, slot)), dx, dy, dz)
            dx, dy, dz = x - dx, y - dy, z - dz
            both = ri + rj
            farthest = both + FARTHEST_GAP * 2.0 * ri * rj / both
            near = movemask(dx * dx + dy * dy + dz * dz < farthest * farthest)
        for w in range(height.shape[1]):
            h = height[i, w]
            if abs(h) < FACES_NO_WALL:
                # never nearer than both heights; one that faces no wall is farther than any reach
                others = gather_column(height, j, w)
                imaged |= movemask(abs(h + others) < model.reach) & movemask(others * h >= 0.0)
        for a in range(min(stop - first, LANES)):
            kind[first + a] = ((near >> a) & 1) * NEAR + ((imaged >> a) & 1) * IMAGED


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _eight_neighbours(i, first, stop, crossing, place, source, rows):
    """Grain i from eight neighbours (3) [m], their radii [m], dipoles (3) [A m^2] as grain i sees them, charges [A m].
    """
    slot = eight_indices(first, stop - 1)
    j = gather(rows.other, slot)
    x, y, z, radius = gather_columns(place, j, 0)
    mx, my, mz, q = gather_columns(source, j, 0)
    if crossing:
        image = images_of_partners(rows.images, gather(rows.image, slot))
        x, y, z = place_to_image(image, x, y, z)
        mx, my, mz = vector_to_image(image, mx, my, mz)
    return (place[i, 0] - x, place[i, 1] - y, place[i, 2] - z), radius, (mx, my, mz), q


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def field_of_row(i, place, source, model, rows):
    """Field (3) [A/m] and potential [A] at grain i of its neighbours' dipoles and charges.

    ``place`` (n, 4): centres and radii [m]; ``source`` (n, 4): dipoles [A m^2] and charges [A m].
    """
    reach, smear = model.reach, model.smear
    ri = place[i, 3]
    sx = sy = sz = total = splat(0.0)
    stop, crossing = rows.start[i + 1], any_crossing(rows, i)
    for first in range(rows.start[i], stop, LANES):
        (dx, dy, dz), rj, (ax, ay, az), q = _eight_neighbours(i, first, stop, crossing, place, source, rows)
        r2 = dx * dx + dy * dy + dz * dz
        true_r = sqrt(r2)
        per_r = 1.0 / true_r
        r = maximum(true_r, ri + rj)
        c1, c2, p = field_factors(r, reach, smear)
        within = select(mask_of_first(stop - first), select(r2 < reach * reach, OVER_4PI, 0.0), 0.0)
        nx, ny, nz, c2 = dx * per_r, dy * per_r, dz * per_r, c2 * within
        along = (nx * ax + ny * ay + nz * az) * within
        total = total + p * along
        along = c1 * along
        if model.near:
            q = q * within
            psi, _ = charge_factors(r, reach, smear)
            total = total + psi * q
            along = along + p * q
        sx, sy, sz = sx + (along * nx - c2 * ax), sy + (along * ny - c2 * ay), sz + (along * nz - c2 * az)
    return reduce_add(sx), reduce_add(sy), reduce_add(sz), reduce_add(total)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def force_of_row(i, place, source, model, rows, virial):
    """Force (3) [N] of the neighbours' dipoles and charges on dipole and charge of grain i.

    As `field_of_row`. ``virial`` (n, 9), or None: sums of r_a F_b/2 [N m].
    """
    reach, smear = model.reach, model.smear
    ri = place[i, 3]
    ax, ay, az, qi = source[i, 0], source[i, 1], source[i, 2], source[i, 3]
    total_x = total_y = total_z = splat(0.0)
    xx = xy = xz = yx = yy = yz = zx = zy = zz = splat(0.0)
    stop, crossing = rows.start[i + 1], any_crossing(rows, i)
    for first in range(rows.start[i], stop, LANES):
        (dx, dy, dz), rj, (bx, by, bz), qj = _eight_neighbours(i, first, stop, crossing, place, source, rows)
        r2 = dx * dx + dy * dy + dz * dz
        true_r = sqrt(r2)
        per_r = 1.0 / true_r
        nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
        r = maximum(true_r, ri + rj)
        fx, fy, fz = pair_force(ax, ay, az, bx, by, bz, nx, ny, nz, r, reach, smear)
        if model.near:
            gx, gy, gz = charge_force(ax, ay, az, qi, bx, by, bz, qj, nx, ny, nz, r, reach, smear)
            fx, fy, fz = fx + gx, fy + gy, fz + gz
        # grains that overlap: as at touching, and the torque at the true distance
        lever = select(true_r < r, r * per_r, 1.0)
        along = (1.0 - lever) * (fx * nx + fy * ny + fz * nz)
        within = select(mask_of_first(stop - first), select(r2 < reach * reach, MU_0_OVER_4PI, 0.0), 0.0)
        fx, fy, fz = within * (along * nx + lever * fx), within * (along * ny + lever * fy), within * (
            along * nz + lever * fz
        )  # fmt: skip
        total_x, total_y, total_z = total_x + fx, total_y + fy, total_z + fz
        if virial is not None:
            xx, xy, xz = xx + dx * fx, xy + dx * fy, xz + dx * fz
            yx, yy, yz = yx + dy * fx, yy + dy * fy, yz + dy * fz
            zx, zy, zz = zx + dz * fx, zy + dz * fy, zz + dz * fz
    if virial is not None:
        sums = (
            reduce_add(xx), reduce_add(xy), reduce_add(xz), reduce_add(yx), reduce_add(yy), reduce_add(yz),
            reduce_add(zx), reduce_add(zy), reduce_add(zz),
        )  # fmt: skip
        for a in range(9):
            virial[i, a] = 0.5 * sums[a]
    return reduce_add(total_x), reduce_add(total_y), reduce_add(total_z)
