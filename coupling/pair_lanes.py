"""Near pairs, many side by side: their excess over dipoles, and its forces.

Inner functions of `coupling.moment_kernels`. A near pair is found once, for both grains.
"""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import field_place, mean_force, moment_at, near_excess
from coupling.influence_kernels import MEAN, MUTUAL, N_NEAR, NX, NY, NZ, PER_R, PER_TRUE, PLACE
from coupling.pair_fields import OVER_4PI
from geometry.inner_functions import inner
from geometry.lane_functions import LANES, lane_room, one_by_one, square_root

MU_0 = 4e-7 * np.pi


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def turned(vector, j, c, s):
    """Vector of grain j, turned about z."""
    x, y = vector[j, 0], vector[j, 1]
    return c * x - s * y, s * x + c * y, vector[j, 2]


# fields of a near pair in the lanes: its columns in `near_pairs`; then what drives it (drop of the potential, sum of
# the moments), the field along n and its place in the table
DROP, SUM_M, DRIVE, FIELD_PLACE, DRIVE_FIELDS = 8, 9, 12, 13, 14
# what else its force needs: both fields and radii, product of the contrasts, V share of both, speed of opening, pull
# and excess moment in the table's units, weakening across; and what comes out
FIELD_I, FIELD_J, RADIUS_I, RADIUS_J, CONTRAST, TAKEN_I, TAKEN_J, OPENING, PULL, EXCESS, ACROSS = (
    14, 17, 20, 21, 22, 23, 24, 25, 26, 27, 28
)  # fmt: skip
FORCE, TURNING, NEAR_FIELDS = 29, 32, 33


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def gather_drive(lane, a, number, grains, rows, known):
    """Lay the near pair of this number into lane ``a``; returns i, j, and cosine and sine of the turn from j to i."""
    moment, potential = grains.moment, grains.potential
    i, k = known.near_once[number, 0], known.near_once[number, 1]
    q = known.near_entry[k]
    j, c, s = rows.other[q], rows.turn_cos[rows.shift[q]], rows.turn_sin[rows.shift[q]]
    for b in range(N_NEAR):
        lane[a, b] = known.near_pair[k, b]
    bx, by, bz = turned(moment, j, c, s)
    lane[a, SUM_M], lane[a, SUM_M + 1], lane[a, SUM_M + 2] = moment[i, 0] + bx, moment[i, 1] + by, moment[i, 2] + bz
    lane[a, DROP] = potential[i] - potential[j]
    return i, j, c, s


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def find_drive(lane, a, table):
    """h_ij of the pair in lane ``a``, and its place."""
    along = lane[a, SUM_M] * lane[a, NX] + lane[a, SUM_M + 1] * lane[a, NY] + lane[a, SUM_M + 2] * lane[a, NZ]
    h = lane[a, MEAN] - lane[a, DROP] * lane[a, PER_R] + along * lane[a, MUTUAL]
    lane[a, DRIVE], lane[a, FIELD_PLACE] = h, field_place(table, h)


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def excesses_in_lanes(first, table, grains, rows, known, excess):
    """Excess (k,) [A/m] of near pairs."""
    lane = lane_room(DRIVE_FIELDS)
    count = min(LANES, known.near_once.shape[0] - first)
    for a in range(count):
        one_by_one()
        gather_drive(lane, a, first + a, grains, rows, known)
    for a in range(LANES):
        find_drive(lane, a, table)
    for a in range(count):
        one_by_one()
        k = known.near_once[first + a, 1]
        v = moment_at(table, lane[a, PLACE], lane[a, FIELD_PLACE], lane[a, DRIVE])
        excess[k] = v
        if known.near_twin[k] >= 0:
            excess[known.near_twin[k]] = -v


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def near_forces_in_lanes(first, table, model, grains, rows, known, attraction, velocity, ahead, excess):
    """Forces [N] and torque of the field about z [N m] (k, 4) of near pairs, see `contact_forces`."""
    radius, volume, share, contrast = grains.radius, grains.volume, grains.share, grains.contrast
    field, lane = grains.field, lane_room(NEAR_FIELDS)
    count = min(LANES, known.near_once.shape[0] - first)
    for a in range(count):
        one_by_one()
        i, j, c, s = gather_drive(lane, a, first + a, grains, rows, known)
        lane[a, FIELD_I], lane[a, FIELD_I + 1], lane[a, FIELD_I + 2] = field[i, 0], field[i, 1], field[i, 2]
        lane[a, FIELD_J], lane[a, FIELD_J + 1], lane[a, FIELD_J + 2] = turned(field, j, c, s)
        lane[a, RADIUS_I], lane[a, RADIUS_J], lane[a, CONTRAST] = radius[i], radius[j], contrast[i] * contrast[j]
        lane[a, TAKEN_I], lane[a, TAKEN_J] = volume[i] * share[i], volume[j] * share[j]
        if ahead > 0.0:
            ux, uy, uz = turned(velocity, j, c, s)
            lane[a, OPENING] = (velocity[i, 0] - ux) * lane[a, NX] + (velocity[i, 1] - uy) * lane[a, NY]
            lane[a, OPENING] += (velocity[i, 2] - uz) * lane[a, NZ]
    for a in range(LANES):
        find_drive(lane, a, table)
    for a in range(count):
        one_by_one()
        h, place = lane[a, DRIVE], lane[a, FIELD_PLACE]
        pull, v, across = near_excess(table, lane[a, PLACE], place, h)
        if ahead > 0.0:
            both = lane[a, RADIUS_I] + lane[a, RADIUS_J]
            per_a = 0.5 * both / (lane[a, RADIUS_I] * lane[a, RADIUS_J])
            gap = max((1.0 / lane[a, PER_TRUE] - both) * per_a, model.smallest_gap)
            end = max(gap + ahead * lane[a, OPENING] * per_a, model.smallest_gap)
            if end != gap:
                pull = mean_force(table, gap, end, place, h)
        lane[a, PULL], lane[a, EXCESS], lane[a, ACROSS] = pull, v, across
    for a in range(LANES):
        nx, ny, nz, per_r, per_true = lane[a, NX], lane[a, NY], lane[a, NZ], lane[a, PER_R], lane[a, PER_TRUE]
        ix, iy, iz = lane[a, FIELD_I], lane[a, FIELD_I + 1], lane[a, FIELD_I + 2]
        ex, ey, ez = lane[a, FIELD_J], lane[a, FIELD_J + 1], lane[a, FIELD_J + 2]
        pull = 0.0
        if attraction:
            # across: the mean of both fields, less what each makes at the other; at itself each makes nothing
            w3 = OVER_4PI * per_r * per_r * per_r
            hx, hy = 0.5 * (ix + ex + w3 * lane[a, SUM_M]), 0.5 * (iy + ey + w3 * lane[a, SUM_M + 1])
            hz = 0.5 * (iz + ez + w3 * lane[a, SUM_M + 2])
            along = hx * nx + hy * ny + hz * nz
            h_t2 = hx * hx + hy * hy + hz * hz - along * along
            size = 2.0 * lane[a, RADIUS_I] * lane[a, RADIUS_J] / (lane[a, RADIUS_I] + lane[a, RADIUS_J])
            pull = MU_0 * size * size * (lane[a, PULL] + square_root(lane[a, CONTRAST]) * h_t2 * lane[a, ACROSS])
        # the near moments lie along n: the field's torque on them acts as opposite forces T/r on the pair
        u, w = MU_0 * lane[a, EXCESS] * lane[a, TAKEN_I], MU_0 * lane[a, EXCESS] * lane[a, TAKEN_J]
        ex, ey, ez = u * ix + w * ex, u * iy + w * ey, u * iz + w * ez
        along = ex * nx + ey * ny + ez * nz
        ex, ey, ez = ex - along * nx, ey - along * ny, ez - along * nz
        lane[a, FORCE], lane[a, FORCE + 1] = ex * per_true - pull * nx, ey * per_true - pull * ny
        lane[a, FORCE + 2] = ez * per_true - pull * nz
        lane[a, TURNING] = -0.5 * (nx * ey - ny * ex)
    for a in range(count):
        one_by_one()
        k = known.near_once[first + a, 1]
        g, q = known.near_twin[k], known.near_entry[k]
        fx, fy, fz = lane[a, FORCE], lane[a, FORCE + 1], lane[a, FORCE + 2]
        excess[k, 0], excess[k, 1], excess[k, 2], excess[k, 3] = fx, fy, fz, lane[a, TURNING]
        if g >= 0:
            c, s = rows.turn_cos[rows.shift[q]], rows.turn_sin[rows.shift[q]]
            excess[g, 0], excess[g, 1], excess[g, 2] = -(c * fx + s * fy), s * fx - c * fy, -fz
            excess[g, 3] = lane[a, TURNING]
