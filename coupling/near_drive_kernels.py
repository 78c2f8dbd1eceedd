"""Compiled drives of near pairs and walls for the DEM's own list, which computes their pull at every gap.

The pull is that of `coupling.moment_kernels.contact_forces` with everything but the gap constant. It is
subtracted from the held forces, at the places where these were found, so that every near pair counts once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from coupling.grain_law_table import bilinear, locate
from coupling.mirror import FACES_NO_WALL, mirror_height, normal_at
from coupling.moment_kernels import MU_0, drive_at_wall, drive_of_pair
from coupling.pair_fields import OVER_4PI

COLUMN, AMPLITUDE, ACROSS = 0, 1, 2


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def drive_pairs(table, model, grains, pairs, drive, force):
    """Drives (p, 3) of the pairs of a half list: column, amplitude [N], amplitude across [N]; their pull out of force.

    Fields and ``force`` (n, 3) [N] were found where the grains are.
    """
    position, radius, moment, field, contrast = (
        grains.position, grains.radius, grains.moment, grains.field, grains.contrast,
    )  # fmt: skip
    start, other, shift, turn_cos, turn_sin = pairs
    reach, smallest_gap = model.reach, model.smallest_gap
    for i in range(position.shape[0]):
        for q in range(start[i], start[i + 1]):
            j = np.int64(other[q])
            drive[q, COLUMN] = drive[q, AMPLITUDE] = drive[q, ACROSS] = 0.0
            c, s = turn_cos[shift[q]], turn_sin[shift[q]]
            dx = position[i, 0] - (c * position[j, 0] - s * position[j, 1])
            dy = position[i, 1] - (s * position[j, 0] + c * position[j, 1])
            dz = position[i, 2] - position[j, 2]
            true_r = np.sqrt(dx * dx + dy * dy + dz * dz)
            both = radius[i] + radius[j]
            if true_r >= reach or true_r >= 1.6 * both:
                continue
            a = 2.0 * radius[i] * radius[j] / both
            gap = max((true_r - both) / a, smallest_gap)
            nx, ny, nz = dx / true_r, dy / true_r, dz / true_r
            r = max(true_r, both)
            h = drive_of_pair(i, j, c, s, nx, ny, nz, r, model, grains)
            k, x, l, y, size, fraction = locate(table, gap, h)
            if k < 0:
                continue
            w3 = OVER_4PI / (r * r * r)
            bx, by = c * moment[j, 0] - s * moment[j, 1], s * moment[j, 0] + c * moment[j, 1]
            ex, ey = c * field[j, 0] - s * field[j, 1], s * field[j, 0] + c * field[j, 1]
            hx = 0.5 * (field[i, 0] + ex + w3 * (moment[i, 0] + bx))
            hy = 0.5 * (field[i, 1] + ey + w3 * (moment[i, 1] + by))
            hz = 0.5 * (field[i, 2] + field[j, 2] + w3 * (moment[i, 2] + moment[j, 2]))
            along = hx * nx + hy * ny + hz * nz
            across = np.sqrt(contrast[i] * contrast[j]) * (hx * hx + hy * hy + hz * hz - along * along)
            drive[q, COLUMN] = l + y
            drive[q, AMPLITUDE] = MU_0 * a * a * size * size * fraction
            drive[q, ACROSS] = MU_0 * a * a * across
            pull = drive[q, AMPLITUDE] * bilinear(table.force, k, x, l, y)
            pull += drive[q, ACROSS] * (table.across[k] + x * (table.across[k + 1] - table.across[k]))
            fx, fy, fz = pull * nx, pull * ny, pull * nz
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
            if w < 0 or height[i, w] >= FACES_NO_WALL or abs(height[i, w]) >= 1.6 * radius[i]:
                continue
            nx, ny, nz = normal_at(walls, w, position[i, 0], position[i, 1])
            gap = max(2.0 * (abs(height[i, w]) / radius[i] - 1.0), model.smallest_gap)
            at = mirror_height(height[i, w], radius[i])
            h = drive_at_wall(i, w, nx, ny, nz, at, walls, model, grains)
            k, x, l, y, size, fraction = locate(table, gap, h)
            if k < 0:
                continue
            drive[q, COLUMN] = l + y
            drive[q, AMPLITUDE] = MU_0 * walls[w, 5] * radius[i] * radius[i] * size * size * fraction
            pull = drive[q, AMPLITUDE] * bilinear(table.force, k, x, l, y)
            pull = pull if at > 0.0 else -pull
            force[i, 0] += pull * nx
            force[i, 1] += pull * ny
            force[i, 2] += pull * nz
