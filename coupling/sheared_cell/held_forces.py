# mypy: ignore-errors
"""Magnetic forces of the pairs of a sheared cell: what is held between two looks at the moments, and its stress.

The forces are those of `coupling.moment_kernels.contact_forces`, pair by pair and once each, because the stress needs
every pair's distance. Of a near pair the attraction beyond the dipoles is left to the grains' own loop, which takes it
from the gap of every step: here only what drives it is found (`coupling.sheared_cell.near_pull`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from coupling.grain_law_table import excess_moment
from coupling.kernel_state import PairModel
from coupling.moment_kernels import MU_0, drive_of_pair
from coupling.pair_fields import MU_0_OVER_4PI, OVER_4PI, pair_force
from coupling.sheared_cell.near_pull import take_grip

NEAR = 1.6  # diameters: where two equal spheres become mutual dipoles


class HeldPairs(NamedTuple):
    """Pairs of a cell, each once.

    Attributes
    ----------
    first, second : ndarray, shape (p,)
    shift : ndarray, shape (p, 3)
        From the second grain to its place next to the first [m].
    near_slot : ndarray of int32, shape (p,)
        A pair's place among the near ones, or -1.
    """

    first: np.ndarray
    second: np.ndarray
    shift: np.ndarray
    near_slot: np.ndarray


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def held_forces(table, model, grains, pairs, force, grip, stress):
    """Forces (n, 3) [N], added; ``grip`` (q, N_GRIP) of near pairs (`near_pull`); ``stress`` (3, 3) [N m], added.

    All grains are of one size. ``stress[a, b]`` sums r_a F_b, F on the grain at r from its partner.
    """
    position, moment, field, share, contrast = (
        grains.position, grains.moment, grains.field, grains.fraction, grains.contrast,
    )  # fmt: skip
    radius, volume = grains.radius[0], grains.volume[0]
    reach, _, near, smallest_gap = model
    split = PairModel(reach, True, near, smallest_gap)  # as the model is; a constant leaves out the other branch
    first, second, shift, near_slot = pairs
    touching = 2.0 * radius
    for k in range(first.shape[0]):
        i, j = first[k], second[k]
        dx = position[i, 0] - (position[j, 0] + shift[k, 0])
        dy = position[i, 1] - (position[j, 1] + shift[k, 1])
        dz = position[i, 2] - (position[j, 2] + shift[k, 2])
        q = near_slot[k]
        if q >= 0:
            grip[q] = 0.0
        r2 = dx * dx + dy * dy + dz * dz
        if r2 >= reach * reach:
            continue
        true_r = np.sqrt(r2)
        nx, ny, nz = dx / true_r, dy / true_r, dz / true_r
        r = max(true_r, touching)
        bx, by, bz = moment[j, 0], moment[j, 1], moment[j, 2]
        gx, gy, gz = pair_force(moment[i, 0], moment[i, 1], moment[i, 2], bx, by, bz, nx, ny, nz, r, reach, True)
        if true_r < r:  # grains that overlap: dipoles at touching, and their torque at the true distance
            along = gx * nx + gy * ny + gz * nz
            lever = r / true_r
            gx = along * nx + lever * (gx - along * nx)
            gy = along * ny + lever * (gy - along * ny)
            gz = along * nz + lever * (gz - along * nz)
        fx, fy, fz = MU_0_OVER_4PI * gx, MU_0_OVER_4PI * gy, MU_0_OVER_4PI * gz
        if near and q >= 0 and true_r < NEAR * touching:
            gap = max((true_r - touching) / radius, smallest_gap)
            h = drive_of_pair(i, j, 1.0, 0.0, nx, ny, nz, r, split, grains)
            w3 = OVER_4PI / (r * r * r)
            ex, ey, ez = field[j, 0], field[j, 1], field[j, 2]
            tx = 0.5 * (field[i, 0] + ex + w3 * (moment[i, 0] + bx))
            ty = 0.5 * (field[i, 1] + ey + w3 * (moment[i, 1] + by))
            tz = 0.5 * (field[i, 2] + ez + w3 * (moment[i, 2] + bz))
            along = tx * nx + ty * ny + tz * nz
            h_t2 = tx * tx + ty * ty + tz * tz - along * along
            take_grip(table, gap, h, np.sqrt(contrast[i] * contrast[j]) * h_t2, radius, grip, q)
            v = MU_0 * volume * excess_moment(table, gap, h)
            u, w = v * share[i], v * share[j]
            ex, ey, ez = u * field[i, 0] + w * ex, u * field[i, 1] + w * ey, u * field[i, 2] + w * ez
            along = ex * nx + ey * ny + ez * nz
            fx += (ex - along * nx) / true_r
            fy += (ey - along * ny) / true_r
            fz += (ez - along * nz) / true_r
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        force[j, 0] -= fx
        force[j, 1] -= fy
        force[j, 2] -= fz
        stress[0, 0] += dx * fx
        stress[0, 1] += dx * fy
        stress[0, 2] += dx * fz
        stress[1, 0] += dy * fx
        stress[1, 1] += dy * fy
        stress[1, 2] += dy * fz
        stress[2, 0] += dz * fx
        stress[2, 1] += dz * fy
        stress[2, 2] += dz * fz
