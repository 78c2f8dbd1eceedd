"""Compiled influence of grains on each other: all that positions alone determine, computed once an update.

Field and potential of a moment are linear in it. Those of a neighbour follow from its distance in every sweep
(`coupling.row_kernels`). A grain's own images, and those of its neighbours in steel, are blocks (4, 4), see
`coupling.image_kernels`; of near pairs, what gives their drive is kept.

Eight pairs are computed at a time (`geometry.kernels.simd`).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.grain_law_table import cubic_between, gap_place
from coupling.image_kernels import (
    IMAGED_CHUNK,
    N_HEIGHTS,
    N_LIST,
    clear_blocks,
    influences_of_grains,
    influences_of_pairs,
    list_grain_images,
    list_pair_images,
    wall_sides,
)
from coupling.kernel_state import ENTRY, FIRST, IMAGE, SECOND, TWIN
from coupling.pair_fields import OVER_4PI
from coupling.row_kernels import columns_of, kinds_of_row
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, from_integers, maximum, select, to_integers
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import gather_columns, gather_two_columns, load, store
from particles.periodic_images import images_of_partners, place_to_image, vector_from_image, vector_to_image

# columns of a near pair: n; 1/r [1/m]; mmf of the applied field [A]; gap [radii], its place in the table and how far
# below (`gap_place`); radius [m]; kappa/(4 pi r^3) of the part across and its derivative over r
NX, NY, NZ, PER_TRUE, APPLIED, GAP, PLACE, BELOW, SIZE, ACROSS, ACROSS_SLOPE, N_NEAR = range(12)


@njit(cache=True, error_model="numpy")
def select_pairs(rows, twin, kind, bit, place, start, entry, subset_twin, unique):
    """Fill a `coupling.kernel_state.PairSubset` with the entries whose kind holds a bit; how many entries and pairs.

    Of a pair both entries are taken or none: round-off may part the two. ``entry`` (p + 1,), ``subset_twin`` (p,) and
    ``unique`` have room for all, ``place`` (p,) is scratch. What the last block has too many repeats the last pair.
    """
    k = np.uint64(0)
    for i in range(rows.start.shape[0] - 1):
        start[i] = first = k
        for q in range(np.uint64(rows.start[i]), np.uint64(rows.start[i + 1])):
            entry[k] = q  # written in any case, kept by counting it
            k += np.uint64(1 if kind[q] & bit else 0)
        end, k = k, first
        for o in range(np.int64(first), np.int64(end)):
            here = np.uint64(entry[o])
            there = np.uint64(twin[here]) if twin[here] >= 0 else here
            entry[k], place[here] = here, k
            k += np.uint64(1 if kind[there] & bit else 0)
    start[-1] = k
    m = np.uint64(0)
    for i in range(rows.start.shape[0] - 1):
        for o in range(start[i], start[i + 1]):
            e = np.uint64(o)
            here = np.uint64(entry[e])
            t = np.int64(place[np.uint64(twin[here])]) if twin[here] >= 0 else np.int64(-1)
            subset_twin[e] = t
            b, a = m >> np.uint64(3), m & np.uint64(7)
            unique[b, FIRST, a], unique[b, SECOND, a], unique[b, IMAGE, a] = i, rows.other[here], rows.image[here]
            unique[b, ENTRY, a], unique[b, TWIN, a] = e, t
            m += np.uint64(0 if 0 <= t < o else 1)
    pairs = np.int64(m)
    for g in range(pairs, LANES * ((pairs + LANES - 1) // LANES)):
        unique[g // LANES, :, g % LANES] = unique[(pairs - 1) // LANES, :, (pairs - 1) % LANES]
    return np.int64(k), pairs


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def pair_kinds(model, grains, rows, kind):
    """Kinds (p,) uint8 of all entries of the rows."""
    place, faces = columns_of(grains.position, grains.radius), wall_sides(grains)
    for i in prange(place.shape[0]):
        kinds_of_row(i, place, faces[0], model, rows, kind)


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def image_influences(model, grains, rows, imaged, walls, image, itself):
    """Blocks (k, 16) of images of all entries that see some, and (n, 16) of each grain on itself (added); or 12."""
    place, n, n_walls = columns_of(grains.position, grains.radius), grains.position.shape[0], walls.shape[0]
    count, room = imaged.pairs, n_walls * IMAGED_CHUNK + LANES
    faces = wall_sides(grains)
    for b in prange((count + IMAGED_CHUNK - 1) // IMAGED_CHUNK):
        first, image_list, heights = b * IMAGED_CHUNK, np.empty((N_LIST, room), np.int32), np.empty((N_HEIGHTS, room))
        until = min(first + IMAGED_CHUNK, count)
        clear_blocks(first, until, imaged, image)
        m = list_pair_images(first, until, model.reach, faces, imaged, image_list, heights)
        influences_of_pairs(m, model, place, rows, walls, image_list, heights, image)
    for b in prange((n + IMAGED_CHUNK - 1) // IMAGED_CHUNK if n_walls else 0):
        first, image_list, heights = b * IMAGED_CHUNK, np.empty((N_LIST, room), np.int32), np.empty((N_HEIGHTS, room))
        m = list_grain_images(first, min(first + IMAGED_CHUNK, n), model.reach, faces, rows, image_list, heights)
        influences_of_grains(m, model, place, rows, walls, image_list, heights, itself)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def bend_along(x, y, radial, hoop, axial, mixed, nx, ny, nz):
    """n . grad H . n [A/m^2] at x, y, of the slopes of a field of revolution, see `coupling.mutual_moments`."""
    rho2 = x * x + y * y
    per_rho = select(rho2 > 0.0, 1.0 / sqrt(rho2), 0.0)
    n_r, n_phi = (nx * x + ny * y) * per_rho, (ny * x - nx * y) * per_rho
    return radial * n_r * n_r + hoop * n_phi * n_phi + (axial * nz + mixed * n_r) * nz


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def slope_along(i, nx, ny, nz, grains):
    """n . grad H . n [A/m^2] of the applied field at grain i, n in the grain's own place."""
    slope, position = grains.slope, grains.position
    return bend_along(
        position[i, 0], position[i, 1], slope[i, 0], slope[i, 1], slope[i, 2], slope[i, 3], nx, ny, nz
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _near_eight(b, table, model, place, drive, slope, rows, near, near_pair):
    i, j = load(near.unique, b, FIRST), load(near.unique, b, SECOND)
    image = images_of_partners(rows.images, load(near.unique, b, IMAGE))
    xi, yi, zi, ri = gather_columns(place, i, 0)
    xj, yj, zj, rj = gather_columns(place, j, 0)
    hx, hy, hz, _ = gather_columns(drive, i, 0)
    gx, gy, gz, _ = gather_columns(drive, j, 0)
    gx, gy, gz = vector_to_image(image, gx, gy, gz)
    x, y, z = place_to_image(image, xj, yj, zj)
    dx, dy, dz = xi - x, yi - y, zi - z
    both = ri + rj
    r = sqrt(dx * dx + dy * dy + dz * dz)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    size = 2.0 * ri * rj / both
    gap = (r - both) / size
    # the applied field between the centres: the cubic through its values and slopes at both
    mean = 0.5 * ((hx + gx) * nx + (hy + gy) * ny + (hz + gz) * nz)
    if model.smear:  # only then it holds the near grains, spread out, and bends
        radial, hoop, axial, mixed = gather_columns(slope, i, 0)
        bend = bend_along(xi, yi, radial, hoop, axial, mixed, nx, ny, nz)
        radial, hoop, axial, mixed = gather_columns(slope, j, 0)
        there_x, there_y, _ = vector_from_image(image, nx, ny, nz)
        bend = bend - bend_along(xj, yj, radial, hoop, axial, mixed, there_x, there_y, nz)
        mean = mean - r * (1.0 / 12.0) * bend
    at, below = gap_place(table, gap, model.smallest_gap)
    row = to_integers(select(at < table.n_gap - 2.0, at, table.n_gap - 2.0))
    part = select(at < table.n_gap - 1.0, at - from_integers(row), 1.0)
    k, k_i = gather_two_columns(table.across, row, 0)
    k_next, k_i_next = gather_two_columns(table.across[1:], row, 0)
    kappa, rise = cubic_between(k, k_next, k_i, k_i_next, part)
    touching = maximum(r, both)
    per_cube = OVER_4PI / (touching * touching * touching)
    rise = rise / (table.gap_step * maximum(gap, model.smallest_gap) * size)
    store(near_pair, b, NX, nx)
    store(near_pair, b, NY, ny)
    store(near_pair, b, NZ, nz)
    store(near_pair, b, PER_TRUE, per_r)
    store(near_pair, b, APPLIED, r * mean)
    store(near_pair, b, GAP, gap)
    store(near_pair, b, PLACE, at)
    store(near_pair, b, BELOW, below)
    store(near_pair, b, SIZE, size)
    store(near_pair, b, ACROSS, per_cube * kappa)
    store(near_pair, b, ACROSS_SLOPE, per_cube * (rise - 3.0 * kappa / touching))


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def near_pairs(table, model, grains, rows, near, near_pair):
    """Near pairs (blocks, N_NEAR, 8), eight of `PairSubset.unique` each. From the other grain n and the mmf are the
    opposite."""
    slope = grains.slope
    place, drive = columns_of(grains.position, grains.radius), columns_of(grains.applied, grains.radius)
    for b in prange(near.unique.shape[0]):
        _near_eight(b, table, model, place, drive, slope, rows, near, near_pair)
