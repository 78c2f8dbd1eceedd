"""Compiled sweeps that find the moments of grains which magnetise one another, and the forces of their contacts.

The model is that of `coupling.mutual_moments`. A sweep has two stages, because a near pair must know the potentials
of both its grains: first every grain's field S and potential P of all others, then its magnetisation. Each grain
gathers from its row alone (Jacobi); what is found once for a pair is put at an entry of each of its grains. So no bit
depends on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.grain_law_table import excess_moment, field_index, gap_index, mean_force, near_excess, sphere_ratio
from coupling.image_lanes import (
    IMAGED_CHUNK,
    N_HEIGHTS,
    N_SEEN,
    clear_forces,
    columns_twice,
    field_of_images,
    find_forces,
    list_grain_images,
    list_pair_images,
    wall_sides,
)
from coupling.influence_kernels import slope_along
from coupling.kernel_state import Chosen
from coupling.mirror import FACES_NO_WALL, height_over, mirror_height, normal_at
from coupling.pair_fields import OVER_4PI, field_factors
from coupling.pair_lanes import MU_0, N_SCRATCH, excess_of_eight, near_forces_of_eight
from coupling.row_lanes import columns_of, dipole_force, field_of_row
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES
from geometry.kernels.simd_math import sqrt

CONTRAST_POWER = 1.2
BLOCKS = 32  # of near pairs that one thread takes at once


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def wall_heights(position, walls, reach, height):
    """Signed heights (n, w) [m] of grains over walls (w, 6), see `coupling.mirror`; `FACES_NO_WALL` where none."""
    for i in prange(position.shape[0]):
        for w in range(walls.shape[0]):
            height[i, w] = height_over(walls, w, position[i, 0], position[i, 1], position[i, 2], reach)


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def gather_fields(model, grains, rows, known, field, potential, own_image):
    """Stage 1: field S (n, 3) [A/m], applied + own + that of all others within reach, and potential P (n,) [A].

    Images in the walls included; ``own_image`` (n, w) [A]: the part of the potential that a grain's own image makes.
    """
    moment, applied = grains.moment, grains.applied
    itself, image, image_start, image_entry, other = (
        known.itself, known.image, known.image_start, known.image_entry, rows.other,
    )  # fmt: skip
    place, source = columns_of(grains.position, grains.radius), columns_of(moment, grains.potential)
    twice = columns_twice(moment, np.zeros(moment.shape[0]))
    blocks = image.reshape(image.shape[0], 4 * image.shape[1])
    for i in prange(moment.shape[0]):
        mx, my, mz = moment[i, 0], moment[i, 1], moment[i, 2]
        sx = applied[i, 0] + itself[i, 0, 0] * mx + itself[i, 0, 1] * my + itself[i, 0, 2] * mz
        sy = applied[i, 1] + itself[i, 1, 0] * mx + itself[i, 1, 1] * my + itself[i, 1, 2] * mz
        sz = applied[i, 2] + itself[i, 2, 0] * mx + itself[i, 2, 1] * my + itself[i, 2, 2] * mz
        total = itself[i, 3, 0] * mx + itself[i, 3, 1] * my + itself[i, 3, 2] * mz if model.near else 0.0
        qx, qy, qz, u = field_of_row(i, place, source, model, rows)
        sx, sy, sz, total = sx + qx, sy + qy, sz + qz, total + u
        qx, qy, qz, u = field_of_images(i, image_start, image_entry, other, blocks, twice)
        sx, sy, sz, total = sx + qx, sy + qy, sz + qz, total + u
        field[i, 0], field[i, 1], field[i, 2], potential[i] = sx, sy, sz, total
        for w in range(own_image.shape[1]):
            own_image[i, w] = (
                known.own_image[i, w, 0] * mx + known.own_image[i, w, 1] * my + known.own_image[i, w, 2] * mz
            )


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def drive_of_pair(i, j, c, s, nx, ny, nz, r, model, grains):
    """Mean field h [A/m] along n between the centres of i and j, without what each makes at the other.

    The applied field's mean is that of the cubic through its values and slopes at both ends: with `smear` it holds the
    near grains spread out, and bends between two centres.
    """
    moment, applied, potential, reach, smear = (
        grains.moment, grains.applied, grains.potential, model.reach, model.smear,
    )  # fmt: skip
    bx, by = c * moment[j, 0] - s * moment[j, 1], s * moment[j, 0] + c * moment[j, 1]
    a_n = moment[i, 0] * nx + moment[i, 1] * ny + moment[i, 2] * nz
    b_n = bx * nx + by * ny + moment[j, 2] * nz
    hx, hy = c * applied[j, 0] - s * applied[j, 1], s * applied[j, 0] + c * applied[j, 1]
    mean = 0.5 * ((applied[i, 0] + hx) * nx + (applied[i, 1] + hy) * ny + (applied[i, 2] + applied[j, 2]) * nz)
    _, _, p = field_factors(r, reach, smear)
    p *= OVER_4PI
    h = mean - ((potential[i] - p * b_n) - (potential[j] + p * a_n)) / r
    if smear:  # the partner's smear, which the applied field holds, is not its drive: Q/(4 pi r^3)
        bend = slope_along(i, nx, ny, nz, grains)
        bend -= slope_along(j, c * nx + s * ny, c * ny - s * nx, nz, grains)
        h -= r / 12.0 * bend
        h += (OVER_4PI / (r * r) - p) / r * (a_n + b_n)
    return h


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def drive_at_wall(i, w, nx, ny, nz, h, walls, model, grains):
    """Mean field [A/m] along the wall's normal between a grain and its image, without what each makes at the other."""
    moment, applied, potential, own_image = grains.moment, grains.applied, grains.potential, grains.own_image
    reach, smear = model.reach, model.smear
    drive = applied[i, 0] * nx + applied[i, 1] * ny + applied[i, 2] * nz - (potential[i] - own_image[i, w]) / h
    if smear and 2.0 * abs(h) < reach:
        r = 2.0 * abs(h)
        drive -= h / 3.0 * slope_along(i, nx, ny, nz, grains)  # the image's side is the mirrored one
        _, _, p = field_factors(r, reach, smear)
        m_n = moment[i, 0] * nx + moment[i, 1] * ny + moment[i, 2] * nz
        drive += OVER_4PI * (1.0 / (r * r) - p) / r * (1.0 + walls[w, 5]) * m_n
    return drive


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def magnetise(table, model, grains, rows, walls, known, damping, fraction, contrast, new, squares, extra):
    """Stage 2: moments ``new`` (n, 3) [A m^2] after a damped step towards the law in ``field`` and ``potential``.

    Near pairs are those of `near_pairs` (with ``near``).
    ``fraction`` (n,) [-]: the part of the plain sum of its pairs' excesses that a grain takes; ``contrast`` (n,) [-]:
    what saturation leaves of its answer across (`coupling.grain_law_table`). ``squares`` (n, 2): of the
    undamped step and of the magnetisation [A^2/m^2]. ``extra`` (k, 4) is scratch, with room for all near entries.
    """
    position, radius, volume, moment = grains.position, grains.radius, grains.volume, grains.moment
    field, height = grains.field, grains.height
    near_start, near, smallest_gap = known.near_start, model.near, model.smallest_gap
    source = columns_of(moment, grains.potential)
    for b in prange(known.near_once.shape[0]):
        excess_of_eight(b, table, source, rows, known, extra)
    for i in prange(position.shape[0]):
        strength = sqrt(field[i, 0] ** 2 + field[i, 1] ** 2 + field[i, 2] ** 2)
        ratio, steepness = sphere_ratio(table, strength)
        contrast[i] = max(ratio * steepness / 9.0, 0.0) ** CONTRAST_POWER  # the slope's rounding may be negative
        vx = vy = vz = square = sum_v = 0.0
        if near:
            for k in range(near_start[i], near_start[i + 1]):
                vx, vy, vz, v = vx + extra[k, 0], vy + extra[k, 1], vz + extra[k, 2], extra[k, 3]
                square += v * v
                sum_v += abs(v)
            for w in range(walls.shape[0]):
                if height[i, w] >= FACES_NO_WALL or abs(height[i, w]) >= 1.6 * radius[i]:
                    continue
                nx, ny, nz = normal_at(walls, w, position[i, 0], position[i, 1])
                gap = max(2.0 * (abs(height[i, w]) / radius[i] - 1.0), smallest_gap)
                at = mirror_height(height[i, w], radius[i])
                h = drive_at_wall(i, w, nx, ny, nz, at, walls, model, grains)
                v = walls[w, 5] * excess_moment(table, gap, h)
                vx, vy, vz = vx + v * nx, vy + v * ny, vz + v * nz
                square += v * v
                sum_v += abs(v)
        part = sqrt(square) / sum_v if sum_v > 0.0 else 0.0
        mx = ratio * field[i, 0] + part * vx
        my = ratio * field[i, 1] + part * vy
        mz = ratio * field[i, 2] + part * vz
        most = sqrt(mx * mx + my * my + mz * mz)
        if near and most > table.scale:
            cut = table.scale / most
            mx, my, mz, part = cut * mx, cut * my, cut * mz, cut * part
        V = volume[i]
        ox, oy, oz = moment[i, 0] / V, moment[i, 1] / V, moment[i, 2] / V
        squares[i, 0] = (mx - ox) ** 2 + (my - oy) ** 2 + (mz - oz) ** 2
        squares[i, 1] = mx * mx + my * my + mz * mz
        new[i, 0] = V * (ox + damping * (mx - ox))
        new[i, 1] = V * (oy + damping * (my - oy))
        new[i, 2] = V * (oz + damping * (mz - oz))
        fraction[i] = part


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def contact_forces(table, model, grains, rows, walls, known, attraction, velocity, ahead, force, torque, extra):
    """Forces (n, 3) [N], added: of the dipoles, of the near excess (if ``attraction``) and of its torque.

    With ``ahead`` > 0 [s] the near excess is its mean over that time at the present ``velocity`` (n, 3) [m/s]: a step
    of rigid grains is longer than its range. Images in the walls (w, 6) included. For the balance, z-components [N m]:
    ``torque`` (n, 2) of the field on each grain that its neighbours make, and of the forces of images and walls about
    the axis. ``extra`` (k, 4) is scratch, with room for all near entries and all that see images.
    """
    position, radius, volume = grains.position, grains.radius, grains.volume
    field, fraction, height = grains.field, grains.fraction, grains.height
    near, smallest_gap = model.near, model.smallest_gap
    near_start, image_start = known.near_start, known.image_start
    n, n_near = position.shape[0], known.near_entry.shape[0]
    place, source = columns_of(position, radius), columns_of(grains.moment, grains.potential)
    charged = columns_of(grains.moment, np.zeros(n))
    tables = source, columns_of(field, grains.contrast), columns_of(velocity, volume * fraction), place
    for b in prange((known.near_once.shape[0] + BLOCKS - 1) // BLOCKS):
        scratch = np.empty((N_SCRATCH, LANES))
        for k in range(b * BLOCKS, min((b + 1) * BLOCKS, known.near_once.shape[0])):
            near_forces_of_eight(k, table, model, tables, rows, known, attraction, ahead, scratch, extra)
    image, own_image = extra[n_near:], np.zeros((n, 4))
    imaged = Chosen(known.image_start, known.image_entry, known.image_twin, known.image_once, known.image_pairs)
    count, room = known.image_pairs, walls.shape[0] * IMAGED_CHUNK + LANES
    faces = wall_sides(grains)
    for b in prange((count + IMAGED_CHUNK - 1) // IMAGED_CHUNK):
        first, seen, heights = b * IMAGED_CHUNK, np.empty((N_SEEN, room), np.int32), np.empty((N_HEIGHTS, room))
        clear_forces(first, min(first + IMAGED_CHUNK, count), imaged, image)
        m = list_pair_images(first, min(first + IMAGED_CHUNK, count), model.reach, faces, imaged, seen, heights)
        find_forces(m, model, place, charged, rows, walls, seen, heights, image)
    for b in prange((n + IMAGED_CHUNK - 1) // IMAGED_CHUNK if walls.shape[0] else 0):
        first, seen, heights = b * IMAGED_CHUNK, np.empty((N_SEEN, room), np.int32), np.empty((N_HEIGHTS, room))
        m = list_grain_images(first, min(first + IMAGED_CHUNK, n), model.reach, faces, seen, heights)
        find_forces(m, model, place, charged, rows, walls, seen, heights, own_image)
    for i in prange(position.shape[0]):
        fx, fy, fz, tz = dipole_force(i, place, source, model, rows)
        for k in range(near_start[i], near_start[i + 1]):
            fx, fy, fz, tz = fx + extra[k, 0], fy + extra[k, 1], fz + extra[k, 2], tz + extra[k, 3]
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        torque[i, 0] = tz
        fx, fy, fz = own_image[i, 0], own_image[i, 1], own_image[i, 2]
        for b in range(image_start[i], image_start[i + 1]):
            fx, fy, fz = fx + image[b, 0], fy + image[b, 1], fz + image[b, 2]
        xi, yi = position[i, 0], position[i, 1]
        for w in range(walls.shape[0]):
            if height[i, w] >= FACES_NO_WALL:
                continue
            hi = mirror_height(height[i, w], radius[i])
            nx, ny, nz = normal_at(walls, w, xi, yi)
            if near and abs(height[i, w]) < 1.6 * radius[i]:
                gap = max(2.0 * (abs(height[i, w]) / radius[i] - 1.0), smallest_gap)
                h = drive_at_wall(i, w, nx, ny, nz, hi, walls, model, grains)
                end = gap
                if ahead > 0.0:
                    opening = velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz
                    end = max(gap + (2.0 if hi > 0.0 else -2.0) * ahead * opening / radius[i], smallest_gap)
                at = field_index(table, h)
                pull, v, _ = near_excess(table, gap_index(table, gap), at, h)
                if end != gap:
                    pull = mean_force(table, gap, end, at, h)
                if attraction:
                    pull *= MU_0 * walls[w, 5]
                    pull *= radius[i] ** 2 if hi > 0.0 else -(radius[i] ** 2)
                    fx, fy, fz = fx - pull * nx, fy - pull * ny, fz - pull * nz
                # the near moment lies along n, which turns with the grain's place about the axis
                turn = MU_0 * walls[w, 5] * v * volume[i] * fraction[i] * (nx * field[i, 1] - ny * field[i, 0])
                rho2 = xi * xi + yi * yi
                if rho2 > 0.0:
                    fx, fy = fx - turn * yi / rho2, fy + turn * xi / rho2
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        torque[i, 1] = xi * fy - yi * fx
