"""Rows of neighbours, in SIMD vectors of eight entries: which are near, the field that they produce, their forces.

Inner functions of `coupling.influence_kernels` and `coupling.moment_kernels`. Every pair is found from each of its
grains: that costs less than to scatter the reaction to the partner's row. Functions of the distance are computed
in every sweep, which takes less time than to load them.

Vectors that reach beyond the end of a row repeat its last entry, whose results are discarded.
"""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import FARTHEST_GAP
from coupling.kernel_state import SHIFT
from coupling.mirror import FACES_NO_WALL
from coupling.pair_fields import MU_0_OVER_4PI, OVER_4PI, field_factors, pair_force
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, from_integers, mask_of_first, maximum, movemask, reduce_add, select, splat
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import eight_indices, gather, gather_column, gather_columns, load

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
    """True if a neighbour of grain i stands beyond a face of the sector."""
    found = 0
    for q in range(rows.start[i], rows.start[i + 1]):
        found |= rows.shift[q]
    return found != 0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def turn_of(rows, once, b):
    """Cosine and sine of the turns from the second grains to the first of the pairs in a block of `Chosen.once`."""
    return _turn(rows, from_integers(load(once, b, SHIFT)))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _turn(rows, crossed):
    return select(crossed * crossed > 0.0, rows.turn_cos[1], 1.0), rows.turn_sin[1] * crossed


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def motion_of_partners(rows, shift):
    """How eight partners stand to the grains that see them, of the shifts of their pairs: cosine and sine of a turn."""
    return _turn(rows, from_integers(shift))


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def place_of_partner(motion, x, y, z):
    """Place [m] at which a grain sees its partner, which stands at x, y, z."""
    return vector_of_partner(motion, x, y, z)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def vector_of_partner(motion, x, y, z):
    """Vector that a grain sees at its partner, which has x, y, z itself."""
    c, s = motion
    return c * x - s * y, s * x + c * y, z


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def vector_to_partner(motion, x, y, z):
    """Vector that the partner has itself, of what a grain sees there; and components on it as on columns."""
    c, s = motion
    return c * x + s * y, c * y - s * x, z


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
                c, s = _turn(rows, from_integers(gather(rows.shift, slot)))
                dx, dy = c * dx - s * dy, s * dx + c * dy
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
    """Grain i from eight neighbours (3) [m], their radii [m] and moments (3) [A m^2], as grain i sees them."""
    slot = eight_indices(first, stop - 1)
    j = gather(rows.other, slot)
    x, y, z, radius = gather_columns(place, j, 0)
    mx, my, mz, _ = gather_columns(source, j, 0)
    if crossing:
        c, s = _turn(rows, from_integers(gather(rows.shift, slot)))
        x, y, mx, my = c * x - s * y, s * x + c * y, c * mx - s * my, s * mx + c * my
    return (place[i, 0] - x, place[i, 1] - y, place[i, 2] - z), radius, (mx, my, mz)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def field_of_row(i, place, source, model, rows):
    """Field (3) [A/m] and potential [A] at grain i of its neighbours' moments.

    ``place`` (n, 4): centres and radii [m]; ``source`` (n, 4): moments [A m^2].
    """
    reach, smear = model.reach, model.smear
    ri = place[i, 3]
    sx = sy = sz = total = splat(0.0)
    stop, crossing = rows.start[i + 1], any_crossing(rows, i)
    for first in range(rows.start[i], stop, LANES):
        (dx, dy, dz), rj, (ax, ay, az) = _eight_neighbours(i, first, stop, crossing, place, source, rows)
        r2 = dx * dx + dy * dy + dz * dz
        r = sqrt(r2)
        per_r = 1.0 / r
        c1, c2, p = field_factors(maximum(r, ri + rj), reach, smear)
        within = select(mask_of_first(stop - first), select(r2 < reach * reach, OVER_4PI, 0.0), 0.0)
        nx, ny, nz, c2 = dx * per_r, dy * per_r, dz * per_r, c2 * within
        along = (nx * ax + ny * ay + nz * az) * within
        total = total + p * along
        along = c1 * along
        sx, sy, sz = sx + (along * nx - c2 * ax), sy + (along * ny - c2 * ay), sz + (along * nz - c2 * az)
    return reduce_add(sx), reduce_add(sy), reduce_add(sz), reduce_add(total)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def dipole_force(i, place, source, model, rows):
    """Force (3) [N] of the neighbours' dipoles on grain i, and the torque of their field about z [N m].

    As `field_of_row`.
    """
    reach, smear = model.reach, model.smear
    ri = place[i, 3]
    ax, ay, az = source[i, 0], source[i, 1], source[i, 2]
    total_x = total_y = total_z = total_t = splat(0.0)
    stop, crossing = rows.start[i + 1], any_crossing(rows, i)
    for first in range(rows.start[i], stop, LANES):
        (dx, dy, dz), rj, (bx, by, bz) = _eight_neighbours(i, first, stop, crossing, place, source, rows)
        r2 = dx * dx + dy * dy + dz * dz
        true_r = sqrt(r2)
        per_r = 1.0 / true_r
        nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
        r = maximum(true_r, ri + rj)
        fx, fy, fz = pair_force(ax, ay, az, bx, by, bz, nx, ny, nz, r, reach, smear)
        # grains that overlap: dipoles at touching, and their torque at the true distance
        lever = select(true_r < r, r * per_r, 1.0)
        along = (1.0 - lever) * (fx * nx + fy * ny + fz * nz)
        within = select(mask_of_first(stop - first), select(r2 < reach * reach, MU_0_OVER_4PI, 0.0), 0.0)
        total_x = total_x + within * (along * nx + lever * fx)
        total_y = total_y + within * (along * ny + lever * fy)
        total_z = total_z + within * (along * nz + lever * fz)
        c1, c2, _ = field_factors(r, reach, smear)  # m x B of the neighbour
        turning = c1 * (bx * nx + by * ny + bz * nz) * (ax * ny - ay * nx) - c2 * (ax * by - ay * bx)
        total_t = total_t + within * turning
    return reduce_add(total_x), reduce_add(total_y), reduce_add(total_z), reduce_add(total_t)
