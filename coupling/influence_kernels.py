"""Compiled influence of grains on each other: what places alone decide of field and potential, found once an update.

Field and potential of a moment are linear in it. Those of a neighbour follow from its distance in every sweep
(`coupling.row_lanes`). A grain's own images, and those of its neighbours in steel, are blocks (3, 4), see
`coupling.image_lanes`; of near pairs, what gives their drive is kept.

Many pairs are found side by side (`geometry.lane_functions`).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.grain_law_table import gap_place
from coupling.image_lanes import (
    IMAGED_CHUNK,
    N_HEIGHTS,
    N_SEEN,
    clear_blocks,
    influences_of_grains,
    influences_of_pairs,
    of_grains,
    of_pairs,
    over_walls,
)
from coupling.pair_fields import OVER_4PI, field_factors
from coupling.row_lanes import beside, kinds_of_row
from geometry.inner_functions import inner
from geometry.lane_functions import LANES, lane_room, one_by_one, square_root

# fields of a pair in the lanes
X, Y, Z, RADIUS_J = range(4)
# columns of a near pair; PER_TRUE: one over the distance, PER_R: where grains that overlap touch
NX, NY, NZ, PER_R, MUTUAL, MEAN, PLACE, PER_TRUE, N_NEAR = range(9)


@njit(cache=True, error_model="numpy")
def take_once(start, twin, once):
    """Fill ``once`` (all + 1, 2) with row and place of every pair that stands at two places, or at one (twin -1)."""
    m = 0
    for i in range(start.shape[0] - 1):
        for k in range(start[i], start[i + 1]):
            t = np.int64(twin[k])
            once[m, 0], once[m, 1] = i, k
            m += 0 if 0 <= t < k else 1
    return m


@njit(cache=True, error_model="numpy")
def choose(start, twin, kind, bit, place, chosen_start, entry, chosen_twin):
    """Fill a `coupling.kernel_state.Chosen` with the entries whose kind holds a bit; how many.

    ``entry`` (p + 1,) has room for all, ``place`` (p,) is scratch.
    """
    k = 0
    for i in range(start.shape[0] - 1):
        chosen_start[i] = k
        for q in range(start[i], start[i + 1]):
            entry[k], place[q] = q, k  # written in any case, kept by counting it
            t = twin[q]
            decides = t if 0 <= t < q else q  # round-off may part the two
            k += 1 if kind[decides] & bit else 0
    chosen_start[-1] = k
    for e in range(k):
        t = twin[entry[e]]
        chosen_twin[e] = place[t] if t >= 0 else -1
    return k


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def pair_kinds(model, grains, rows, kind):
    """Kinds (p,) uint8 of all entries of the rows."""
    place, over = beside(grains.position, grains.radius), over_walls(grains)
    for i in prange(place.shape[0]):
        kinds_of_row(i, place, over[0], model, rows, kind)


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def image_influences(model, grains, rows, imaged, walls, image, itself, own_image):
    """Blocks (k, 12) of images of all entries that see some, and (n, 12) of each grain on itself (added).

    ``own_image`` (n w, 4) [1/m^2] is the part of a grain's own image in its potential, 0 beforehand.
    """
    place, n, n_walls = beside(grains.position, grains.radius), grains.position.shape[0], walls.shape[0]
    count, room = imaged.once.shape[0], n_walls * IMAGED_CHUNK + LANES
    over = over_walls(grains)
    for b in prange((count + IMAGED_CHUNK - 1) // IMAGED_CHUNK):
        first, seen, heights = b * IMAGED_CHUNK, np.empty((N_SEEN, room), np.int32), np.empty((N_HEIGHTS, room))
        until = min(first + IMAGED_CHUNK, count)
        clear_blocks(first, until, imaged, image)
        m = of_pairs(first, until, model.reach, over, rows, imaged, seen, heights)
        influences_of_pairs(m, model, place, rows, walls, seen, heights, image)
    for b in prange((n + IMAGED_CHUNK - 1) // IMAGED_CHUNK if n_walls else 0):
        first, seen, heights = b * IMAGED_CHUNK, np.empty((N_SEEN, room), np.int32), np.empty((N_HEIGHTS, room))
        m = of_grains(first, min(first + IMAGED_CHUNK, n), model.reach, over, seen, heights)
        influences_of_grains(m, model, place, rows, walls, seen, heights, itself, own_image)


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def bend_along(x, y, radial, hoop, axial, mixed, nx, ny, nz):
    """n . grad H . n [A/m^2] at x, y, of the slopes of a field of revolution, see `coupling.mutual_moments`."""
    rho2 = x * x + y * y
    per_rho = 1.0 / square_root(rho2) if rho2 > 0.0 else 0.0
    n_r, n_phi = (nx * x + ny * y) * per_rho, (ny * x - nx * y) * per_rho
    return radial * n_r * n_r + hoop * n_phi * n_phi + (axial * nz + mixed * n_r) * nz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def slope_along(i, nx, ny, nz, grains):
    """n . grad H . n [A/m^2] of the applied field at grain i, n in the grain's own place."""
    slope, position = grains.slope, grains.position
    return bend_along(
        position[i, 0], position[i, 1], slope[i, 0], slope[i, 1], slope[i, 2], slope[i, 3], nx, ny, nz
    )  # fmt: skip


# fields of a near pair in the lanes: distance vector, radius of j and of i, sum of the applied fields, and of both
# grains place across the axis, slopes of the applied field; cosine and sine between their frames; the pair's columns
RADIUS_I, SUM_H, AT_I, AT_J, TURN, FOUND = 4, 5, 8, 14, 20, 22
NEAR_FIELDS = 22 + 8


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _near_in_lanes(first, table, model, grains, rows, near, near_pair):
    position, radius, applied, slope = grains.position, grains.radius, grains.applied, grains.slope
    reach, smear, smallest_gap = model.reach, model.smear, model.smallest_gap
    lane = lane_room(NEAR_FIELDS)
    count = min(LANES, near.once.shape[0] - first)
    for a in range(count):
        one_by_one()
        i, q = near.once[first + a, 0], near.entry[near.once[first + a, 1]]
        j = rows.other[q]
        c, s = rows.turn_cos[rows.shift[q]], rows.turn_sin[rows.shift[q]]
        lane[a, X] = position[i, 0] - (c * position[j, 0] - s * position[j, 1])
        lane[a, Y] = position[i, 1] - (s * position[j, 0] + c * position[j, 1])
        lane[a, Z] = position[i, 2] - position[j, 2]
        lane[a, RADIUS_I], lane[a, RADIUS_J] = radius[i], radius[j]
        lane[a, SUM_H] = applied[i, 0] + (c * applied[j, 0] - s * applied[j, 1])
        lane[a, SUM_H + 1] = applied[i, 1] + (s * applied[j, 0] + c * applied[j, 1])
        lane[a, SUM_H + 2] = applied[i, 2] + applied[j, 2]
        lane[a, TURN], lane[a, TURN + 1] = c, s
        lane[a, AT_I], lane[a, AT_I + 1] = position[i, 0], position[i, 1]
        lane[a, AT_J], lane[a, AT_J + 1] = position[j, 0], position[j, 1]
        for b in range(4):
            lane[a, AT_I + 2 + b], lane[a, AT_J + 2 + b] = slope[i, b], slope[j, b]
    for a in range(LANES):
        dx, dy, dz, ri, rj = lane[a, X], lane[a, Y], lane[a, Z], lane[a, RADIUS_I], lane[a, RADIUS_J]
        both = ri + rj
        true_r = square_root(dx * dx + dy * dy + dz * dz)
        per_true = 1.0 / true_r
        nx, ny, nz = dx * per_true, dy * per_true, dz * per_true
        r = max(true_r, both)
        per_r = 1.0 / r
        gap = max((true_r - both) * both / (2.0 * ri * rj), smallest_gap)
        mean = 0.5 * (lane[a, SUM_H] * nx + lane[a, SUM_H + 1] * ny + lane[a, SUM_H + 2] * nz)
        _, _, p = field_factors(r, reach, smear)
        if smear:  # the partner's smear, which the applied field holds, is not its drive: Q/(4 pi r^3)
            p = per_r * per_r
            # the mean of the cubic, see `coupling.moment_kernels.drive_of_pair`
            bend = bend_along(
                lane[a, AT_I], lane[a, AT_I + 1], lane[a, AT_I + 2], lane[a, AT_I + 3], lane[a, AT_I + 4],
                lane[a, AT_I + 5], nx, ny, nz,
            )  # fmt: skip
            c, s = lane[a, TURN], lane[a, TURN + 1]
            bend -= bend_along(
                lane[a, AT_J], lane[a, AT_J + 1], lane[a, AT_J + 2], lane[a, AT_J + 3], lane[a, AT_J + 4],
                lane[a, AT_J + 5], c * nx + s * ny, c * ny - s * nx, nz,
            )  # fmt: skip
            mean -= r / 12.0 * bend
        lane[a, FOUND + NX], lane[a, FOUND + NY], lane[a, FOUND + NZ] = nx, ny, nz
        lane[a, FOUND + PER_R], lane[a, FOUND + PER_TRUE] = per_r, per_true
        lane[a, FOUND + MUTUAL], lane[a, FOUND + MEAN] = OVER_4PI * p * per_r, mean
        lane[a, FOUND + PLACE] = gap_place(table, gap)
    for a in range(count):
        one_by_one()
        k = near.once[first + a, 1]
        g = near.twin[k]
        for b in range(N_NEAR):
            near_pair[k, b] = lane[a, FOUND + b]
        if g >= 0:
            nx, ny = lane[a, FOUND + NX], lane[a, FOUND + NY]
            c, s = lane[a, TURN], lane[a, TURN + 1]
            for b in range(N_NEAR):
                near_pair[g, b] = lane[a, FOUND + b]
            near_pair[g, NX], near_pair[g, NY] = -(c * nx + s * ny), s * nx - c * ny
            near_pair[g, NZ], near_pair[g, MEAN] = -near_pair[k, NZ], -near_pair[k, MEAN]


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def near_pairs(table, model, grains, rows, near, near_pair):
    """Near pairs (k, 8): what gives h_ij,

    h = ``MEAN`` - (P_i - P_j) ``PER_R`` + (m_i + m_j).n ``MUTUAL``, at the ``PLACE`` of their gap in the table. Seen
    from j both n and h are the opposite.
    """
    for b in prange((near.once.shape[0] + LANES - 1) // LANES):
        _near_in_lanes(b * LANES, table, model, grains, rows, near, near_pair)
