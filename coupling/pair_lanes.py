"""Near pairs, in SIMD vectors of eight: their excess over dipoles, and its forces.

Inner functions of `coupling.moment_kernels`. A near pair is found once, for both grains, and put where it stands in
the rows of both (``extra``): no two write to the same place.
"""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import field_index, locate_eight, mean_force
from coupling.influence_kernels import MEAN, MUTUAL, NX, NY, NZ, PER_R, PER_TRUE, PLACE
from coupling.kernel_state import ENTRY, FIRST, SECOND, TWIN
from coupling.pair_fields import OVER_4PI
from coupling.row_lanes import first_present, turn_of
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, maximum, select
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import (
    gather_columns,
    interpolate_bilinear,
    interpolate_linear,
    load,
    scatter_columns,
    store,
)

MU_0 = 4e-7 * np.pi
# numbers that are needed one by one, for the mean over a step: drive, gap, its end, pull
DRIVE, GAP, END, PULL, N_SCRATCH = range(5)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _drive(b, source, rows, known):
    """Of block b: h_ij, cosine and sine of the turn from j to i, n, and the sum of the moments.

    ``source`` (n, 4): moments [A m^2] and potentials [A].
    """
    c, s = turn_of(rows, known.near_once, b)
    mx, my, mz, p = gather_columns(source, load(known.near_once, b, FIRST), 0)
    bx, by, bz, q = gather_columns(source, load(known.near_once, b, SECOND), 0)
    mx, my, mz = mx + (c * bx - s * by), my + (s * bx + c * by), mz + bz
    pair = known.near_pair
    nx, ny, nz = load(pair, b, NX), load(pair, b, NY), load(pair, b, NZ)
    along = mx * nx + my * ny + mz * nz
    h = load(pair, b, MEAN) - (p - q) * load(pair, b, PER_R) + along * load(pair, b, MUTUAL)
    return h, (c, s), (nx, ny, nz), (mx, my, mz)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _scatter_pair(b, known, turn, sign, x, y, z, both, extra):
    """Put a vector of the first grain, ``sign`` times it of the second, and a number of both into ``extra``."""
    e, t = load(known.near_once, b, ENTRY), load(known.near_once, b, TWIN)
    c, s = turn
    scatter_columns(extra, first_present(t, e), 0, sign * (c * x + s * y), sign * (c * y - s * x), sign * z, both)
    scatter_columns(extra, e, 0, x, y, z, both)  # after it: a pair without a twin has one place


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def excess_of_eight(b, table, source, rows, known, extra):
    """Excess of the near pairs in block b: vector and size [A/m] into ``extra`` (k, 4)."""
    h, turn, (nx, ny, nz), _ = _drive(b, source, rows, known)
    row, x, column, y, held, fraction, within = locate_eight(table, load(known.near_pair, b, PLACE), h)
    v = held * fraction * within * interpolate_bilinear(table.moment, row, x, column, y)
    v = select(h < 0.0, -v, v)
    _scatter_pair(b, known, turn, 1.0, v * nx, v * ny, v * nz, v, extra)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _mean_pull(b, table, h, pull, radii, opening, ahead, smallest_gap, known, scratch):
    """Pull over the coming time ``ahead`` [s] where the gap changes in it."""
    ri, rj = radii
    both = ri + rj
    per_a = 0.5 * both / (ri * rj)
    gap = maximum((1.0 / load(known.near_pair, b, PER_TRUE) - both) * per_a, smallest_gap)
    store(scratch, DRIVE, 0, h)
    store(scratch, GAP, 0, gap)
    store(scratch, END, 0, maximum(gap + ahead * opening * per_a, smallest_gap))
    store(scratch, PULL, 0, pull)
    for a in range(LANES):
        h_a, gap_a, end = scratch[DRIVE, a], scratch[GAP, a], scratch[END, a]
        if end != gap_a:
            scratch[PULL, a] = mean_force(table, gap_a, end, field_index(table, h_a), h_a)
    return load(scratch, PULL, 0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def near_forces_of_eight(b, table, model, tables, rows, known, attraction, ahead, scratch, extra):
    """Forces [N] and torque of the field about z [N m] of the near pairs in block b, see `contact_forces`.

    ``tables`` (n, 4): moments and potentials; fields and contrasts; velocities and V times fraction; centres and radii.
    """
    source, seen, moving, place = tables
    i, j = load(known.near_once, b, FIRST), load(known.near_once, b, SECOND)
    h, turn, (nx, ny, nz), (mx, my, mz) = _drive(b, source, rows, known)
    c, s = turn
    row, x, column, y, held, fraction, within = locate_eight(table, load(known.near_pair, b, PLACE), h)
    fraction = held * fraction * within
    excess = fraction * interpolate_bilinear(table.moment, row, x, column, y)
    excess = select(h > 0.0, excess, -excess)
    ix, iy, iz, contrast = gather_columns(seen, i, 0)
    ex, ey, ez, other_contrast = gather_columns(seen, j, 0)
    ex, ey = c * ex - s * ey, s * ex + c * ey
    ux, uy, uz, taken = gather_columns(moving, i, 0)
    wx, wy, wz, other_taken = gather_columns(moving, j, 0)
    per_r, per_true = load(known.near_pair, b, PER_R), load(known.near_pair, b, PER_TRUE)
    pull = 0.0 * h
    if attraction:
        _, _, _, ri = gather_columns(place, i, 0)
        _, _, _, rj = gather_columns(place, j, 0)
        pull = held * fraction * interpolate_bilinear(table.force, row, x, column, y)
        if ahead > 0.0:
            opening = (ux - (c * wx - s * wy)) * nx + (uy - (s * wx + c * wy)) * ny + (uz - wz) * nz
            pull = _mean_pull(b, table, h, pull, (ri, rj), opening, ahead, model.smallest_gap, known, scratch)
        # across: the mean of both fields, less what each makes at the other; at itself each makes nothing
        w3 = OVER_4PI * per_r * per_r * per_r
        hx, hy, hz = 0.5 * (ix + ex + w3 * mx), 0.5 * (iy + ey + w3 * my), 0.5 * (iz + ez + w3 * mz)
        along = hx * nx + hy * ny + hz * nz
        h_t2 = hx * hx + hy * hy + hz * hz - along * along
        size = 2.0 * ri * rj / (ri + rj)
        across = within * interpolate_linear(table.across, row, x)
        pull = MU_0 * size * size * (pull + sqrt(contrast * other_contrast) * h_t2 * across)
    # the near moments lie along n: the field's torque on them acts as opposite forces T/r on the pair
    u, w = MU_0 * excess * taken, MU_0 * excess * other_taken
    ex, ey, ez = u * ix + w * ex, u * iy + w * ey, u * iz + w * ez
    along = ex * nx + ey * ny + ez * nz
    ex, ey, ez = ex - along * nx, ey - along * ny, ez - along * nz
    fx, fy, fz = ex * per_true - pull * nx, ey * per_true - pull * ny, ez * per_true - pull * nz
    _scatter_pair(b, known, turn, -1.0, fx, fy, fz, -0.5 * (nx * ey - ny * ex), extra)
