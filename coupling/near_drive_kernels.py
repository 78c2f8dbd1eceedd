"""Compiled drives of near pairs and walls for the DEM's own list, which computes their pull at every gap.

The pull is that of `coupling.moment_kernels.contact_forces` at the places where moments and mmfs were solved, and goes
from there on with the gap alone, as that of an isolated pair in a constant field (`coupling.isolated_pair`). It is
subtracted from the lagged forces, at those places, so that every near pair counts once.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.grain_law_table import SMALLEST_CAPACITY, bilinear, drive_column, gap_place, mmf_place, neck_scalar
from coupling.influence_kernels import slope_along
from coupling.mirror import normal_at
from coupling.moment_kernels import MU_0, is_near_wall, mmf_at_wall
from geometry.kernels.device_functions import device_function

COLUMN, AMPLITUDE, ACROSS = 0, 1, 2
SHORTEST = 1e-9  # of what lies across: below it nothing is followed


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _drive_of_neck(table, gap, smallest_gap, neck_mmf, capacity, radius):
    """Column of a neck, its amplitude over mu_0 [A^2], and its pull over mu_0 [A^2] at the present gap [radii]."""
    x, below = gap_place(table, gap, smallest_gap)
    place, fraction = mmf_place(table, neck_mmf, capacity, radius)
    rise = neck_scalar(table, x, below, place, fraction)[3] / (table.gap_step * max(gap, smallest_gap))
    pull = neck_mmf * neck_mmf * rise
    if not pull > 0.0:  # also of NaN, which is no index
        return 0.0, 0.0, 0.0
    column = drive_column(table, x, place)
    i, j = min(np.int64(x), table.n_gap - 2), min(np.int64(column), table.n_mmf - 2)
    shape = bilinear(table.pull, i, x - i, j, column - j)
    return (column, pull / shape, pull) if shape > 0.0 else (0.0, 0.0, 0.0)


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def drive_pairs(table, across, model, grains, pairs, drive, lagged):
    """Drives (p, 3) of the pairs of a half list: column, amplitude [N], amplitude across [N].

    ``lagged`` (p, 3) [N]: the pull on the first grain where the fields were solved, against its partner's.
    ``across`` (g,) is the table of the pull across.
    """
    position, radius, dipole, applied, contrast = (
        grains.position, grains.radius, grains.dipole, grains.applied, grains.contrast,
    )  # fmt: skip
    volume, potential = grains.volume, grains.potential
    start, other, image, images = pairs
    for i in prange(position.shape[0]):
        for q in range(start[i], start[i + 1]):
            j = np.int64(other[q])
            drive[q, COLUMN] = drive[q, AMPLITUDE] = drive[q, ACROSS] = 0.0
            lagged[q, 0] = lagged[q, 1] = lagged[q, 2] = 0.0
            motion = images[image[q]]
            c, s = motion[0], motion[1]
            dx = position[i, 0] - (c * position[j, 0] - s * position[j, 1] + motion[2])
            dy = position[i, 1] - (s * position[j, 0] + c * position[j, 1] + motion[3])
            dz = position[i, 2] - position[j, 2] - motion[4]
            r = np.sqrt(dx * dx + dy * dy + dz * dz)
            both = radius[i] + radius[j]
            a = 2.0 * radius[i] * radius[j] / both
            gap = (r - both) / a
            x, _ = gap_place(table, gap, model.smallest_gap)
            if r >= model.reach or not x < table.n_gap - 1.0:
                continue
            nx, ny, nz = dx / r, dy / r, dz / r
            hx, hy = c * applied[j, 0] - s * applied[j, 1], s * applied[j, 0] + c * applied[j, 1]
            mean = 0.5 * ((applied[i, 0] + hx) * nx + (applied[i, 1] + hy) * ny + (applied[i, 2] + applied[j, 2]) * nz)
            if model.smear:
                bend = slope_along(i, nx, ny, nz, grains)
                bend -= slope_along(j, c * nx + s * ny, c * ny - s * nx, nz, grains)
                mean -= r / 12.0 * bend
            neck_mmf = r * mean - (potential[i] - potential[j])
            ax, ay, az = dipole[i, 0], dipole[i, 1], dipole[i, 2]
            bx, by, bz = c * dipole[j, 0] - s * dipole[j, 1], s * dipole[j, 0] + c * dipole[j, 1], dipole[j, 2]
            a_n, b_n = ax * nx + ay * ny + az * nz, bx * nx + by * ny + bz * nz
            sign = -1.0 if neck_mmf < 0.0 else 1.0
            capacity = max(1.0 - 0.5 * sign * (a_n / volume[i] + b_n / volume[j]) / table.scale, SMALLEST_CAPACITY)
            column, amplitude, along = _drive_of_neck(table, gap, model.smallest_gap, neck_mmf, capacity, a)
            drive[q, COLUMN] = column
            drive[q, AMPLITUDE] = MU_0 * amplitude
            product = (ax * bx + ay * by + az * bz - a_n * b_n) * contrast[i, 0] * contrast[j, 0]
            # of equal spheres the table's own; of others what they have at this gap
            per_a4 = 1.0 / (4.0 * np.pi * a**4) * ((2.0 + gap) * a / r) ** 4
            drive[q, ACROSS] = MU_0 * per_a4 * product
            k = min(np.int64(x), table.n_gap - 2)
            sideways = across[k] + (x - k) * (across[k + 1] - across[k])
            pull = MU_0 * along + drive[q, ACROSS] * sideways
            lagged[q, 0], lagged[q, 1], lagged[q, 2] = pull * nx, pull * ny, pull * nz


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def subtract_pulls(pairs, lagged, force):
    """Subtract the pulls of `drive_pairs` from ``force`` (n, 3) [N]."""
    start, other, image, images = pairs
    for i in range(force.shape[0]):
        for q in range(start[i], start[i + 1]):
            j, motion = np.int64(other[q]), images[image[q]]
            c, s = motion[0], motion[1]
            fx, fy, fz = lagged[q, 0], lagged[q, 1], lagged[q, 2]
            force[i, 0] += fx
            force[i, 1] += fy
            force[i, 2] += fz
            force[j, 0] -= c * fx + s * fy
            force[j, 1] -= c * fy - s * fx
            force[j, 2] -= fz


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def drive_walls(table, model, grains, start, steel, walls, drive, force):
    """Drives (s, 2) of wall slots: column, amplitude [N]; ``steel`` (s,) is the row of ``walls`` (w, 6) or -1."""
    position, radius, height = grains.position, grains.radius, grains.height
    for i in range(position.shape[0]):
        for q in range(start[i], start[i + 1]):
            drive[q, COLUMN] = drive[q, AMPLITUDE] = 0.0
            w = steel[q]
            if w < 0 or not is_near_wall(i, w, grains):
                continue
            nx, ny, nz = normal_at(walls, w, position[i, 0], position[i, 1])
            side = 1.0 if height[i, w] > 0.0 else -1.0
            nx, ny, nz = side * nx, side * ny, side * nz
            gap = 2.0 * (abs(height[i, w]) / radius[i] - 1.0)
            neck_mmf = mmf_at_wall(i, w, walls, model, grains)
            m_n = grains.dipole[i, 0] * nx + grains.dipole[i, 1] * ny + grains.dipole[i, 2] * nz
            sign = -1.0 if neck_mmf < 0.0 else 1.0
            capacity = max(1.0 - sign * m_n / (grains.volume[i] * table.scale), SMALLEST_CAPACITY)
            column, amplitude, along = _drive_of_neck(table, gap, model.smallest_gap, neck_mmf, capacity, radius[i])
            drive[q, COLUMN] = column
            drive[q, AMPLITUDE] = MU_0 * walls[w, 5] * amplitude
            pull = MU_0 * walls[w, 5] * along
            force[i, 0] += pull * nx
            force[i, 1] += pull * ny
            force[i, 2] += pull * nz
