"""Near pairs, in SIMD vectors of eight: the flux through their necks, its response, and their forces.

Inner functions of `coupling.moment_kernels`; the model is that of `coupling.mutual_moments`. A near pair is
computed once, for both grains, and put where it stands in the rows of both: no two write to the same place.
"""

from __future__ import annotations

import numpy as np

from coupling.grain_law_table import SMALLEST_CAPACITY, mean_neck_pull, mmf_place, neck_simd
from coupling.influence_kernels import (
    ACROSS,
    ACROSS_SLOPE,
    APPLIED,
    BELOW,
    GAP,
    NX,
    NY,
    NZ,
    PER_TRUE,
    PLACE,
    SIZE,
)
from coupling.kernel_state import ENTRY, FIRST, IMAGE, SECOND, TWIN
from coupling.row_kernels import first_present
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first, maximum, reduce_add, select
from geometry.kernels.simd_tables import (
    gather_column,
    gather_columns,
    gather_two_columns,
    load,
    scatter_columns,
    store,
)
from particles.periodic_images import images_of_partners, vector_from_image, vector_to_image
from particles.periodicity import DU

MU_0 = 4e-7 * np.pi
# columns of the results of a pair: flux [A m], energy w + q D and that across [A^2 m]
FLUX, ENERGY, N_NECK = range(3)
# columns of ``near_field``: field on the grain (3) [A/m] and transverse energy over its contrast; charge, dq/dD, and
# |w_ss|/(2 Ms^2 V), of the capacity's response to the magnetisation
FIELD, CHARGE = 0, 4
# numbers that are needed one by one, for the mean over a step
GAP_THEN, GAP_END, PLACE_OF_MMF, FRACTION, PULL, N_SCRATCH = range(6)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _ends_of_pair(b, source, rows, known):
    """Of block b: both grains, the image that the second is seen in, and n; of both dipole, volume and m.n.

    ``source`` (n, 4): dipoles [A m^2] and volumes [m^3]; all in the place of the first grain.
    """
    i, j = load(known.near_unique, b, FIRST), load(known.near_unique, b, SECOND)
    turn = images_of_partners(rows.images, load(known.near_unique, b, IMAGE))
    ax, ay, az, V_i = gather_columns(source, i, 0)
    bx, by, bz, V_j = gather_columns(source, j, 0)
    bx, by, bz = vector_to_image(turn, bx, by, bz)
    nx, ny, nz = load(known.near_pair, b, NX), load(known.near_pair, b, NY), load(known.near_pair, b, NZ)
    a_n, b_n = ax * nx + ay * ny + az * nz, bx * nx + by * ny + bz * nz
    return (i, j), turn, (nx, ny, nz), (ax, ay, az), (bx, by, bz), (a_n, b_n), (V_i, V_j)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _place_of_mmf(table, D, along, volumes, size):
    """Sign of the mmf [A], capacity s = 1 - sign (M_i + M_j).n/(2 Ms), and `mmf_place`."""
    sign = select(D < 0.0, -1.0, 1.0)
    filled = along[0] / volumes[0] + along[1] / volumes[1]
    capacity = maximum(1.0 - 0.5 * sign * filled * (1.0 / table.scale), SMALLEST_CAPACITY)
    place, fraction = mmf_place(table, D, capacity, size)
    return sign, capacity, place, fraction


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def neck_fluxes(b, table, source, contrast, rows, known, neck_mmf, neck, near_field):
    """Fluxes through the near pairs of block b, and what they do to both grains, into ``near_field`` (k, 8).

    ``source``: see `_ends_of_pair`; ``contrast`` (n, 2); ``neck_mmf`` (blocks, 8) [A]; ``neck`` (blocks, N_NECK, 8).
    """
    (i, j), turn, (nx, ny, nz), (ax, ay, az), (bx, by, bz), along, (V_i, V_j) = _ends_of_pair(b, source, rows, known)
    pair = known.near_pair
    D, size = load(neck_mmf, b, 0), load(pair, b, SIZE)
    sign, capacity, place, fraction = _place_of_mmf(table, D, along, (V_i, V_j), size)
    y, y1, y2, _ = neck_simd(table, load(pair, b, PLACE), load(pair, b, BELOW), place, fraction)
    q = -size * D * (2.0 * y + y1)
    stiffness = -size * (2.0 * y + 3.0 * y1 + y2)
    per_s = 1.0 / (capacity * table.scale)
    filling = -0.5 * size * D * D * y1 * sign * per_s  # -w_s ds/dM.n
    bend = 0.5 * size * abs(D * D * (y1 + y2)) * per_s * per_s  # |w_ss|/2 over Ms^2
    c_i, _ = gather_two_columns(contrast, i, 0)
    c_j, _ = gather_two_columns(contrast, j, 0)
    across = load(pair, b, ACROSS)
    both = across * c_i * c_j
    product = ax * bx + ay * by + az * bz - along[0] * along[1]
    store(neck, b, FLUX, q)
    store(neck, b, ENERGY, size * D * D * y + q * D - both * product)
    # the second grain first: a pair without a twin has one place
    e, t = load(known.near_unique, b, ENTRY), load(known.near_unique, b, TWIN)
    there = first_present(t, e)
    along_n = filling / V_j - both * along[0]
    x, y, z = vector_from_image(turn, both * ax + along_n * nx, both * ay + along_n * ny, both * az + along_n * nz)
    scatter_columns(near_field, there, FIELD, x, y, z, across * c_i * product)
    scatter_columns(near_field, there, CHARGE, -q, stiffness, bend / V_j, 0.0 * q)
    along_n = filling / V_i - both * along[1]
    scatter_columns(
        near_field, e, FIELD, both * bx + along_n * nx, both * by + along_n * ny, both * bz + along_n * nz,
        across * c_j * product,
    )  # fmt: skip
    scatter_columns(near_field, e, CHARGE, q, stiffness, bend / V_i, 0.0 * q)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mmf_residuals(b, potential, known, neck_mmf, step):
    """Residual steps (blocks, 8) [A] of the mmfs of block b to the potentials; returns their squares and the mmfs'.

    ``potential`` (n, 2): [A], and the sum of dq/dD/(4 pi a) over the grain's necks, by which the step is divided:
    what an mmf moves comes back through the charges of both grains.
    """
    p, response = gather_two_columns(potential, load(known.near_unique, b, FIRST), 0)
    p_other, response_other = gather_two_columns(potential, load(known.near_unique, b, SECOND), 0)
    D = load(neck_mmf, b, 0)
    residual = load(known.near_pair, b, APPLIED) - (p - p_other) - D
    residual = residual / (1.0 + 0.5 * (response + response_other))
    store(step, b, 0, residual)
    valid = mask_of_first(known.near_pairs - LANES * b)
    return reduce_add(select(valid, residual * residual, 0.0)), reduce_add(select(valid, D * D, 0.0))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def neck_moments(b, place, rows, known, neck, near_moment):
    """Moments [A m^2] that the near pairs of block b add to both grains, into ``near_moment`` (k, 8).

    Of q r n each grain has the part up to the neck, by its radius. ``place`` (n, 4): centres and radii [m].
    """
    pair = known.near_pair
    _, _, _, ri = gather_columns(place, load(known.near_unique, b, FIRST), 0)
    _, _, _, rj = gather_columns(place, load(known.near_unique, b, SECOND), 0)
    per_radius = load(neck, b, FLUX) / (load(pair, b, PER_TRUE) * (ri + rj))
    nx, ny, nz = load(pair, b, NX), load(pair, b, NY), load(pair, b, NZ)
    own, others = per_radius * ri, per_radius * rj
    e, t = load(known.near_unique, b, ENTRY), load(known.near_unique, b, TWIN)
    image = images_of_partners(rows.images, load(known.near_unique, b, IMAGE))
    x, y, z = vector_from_image(image, others * nx, others * ny, others * nz)
    scatter_columns(near_moment, first_present(t, e), 0, x, y, z, 0.0 * z)
    scatter_columns(near_moment, e, 0, own * nx, own * ny, own * nz, 0.0 * nz)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _mean_of_step(b, table, model, gap, opening, ahead, place, fraction, scratch):
    """dy/dg over the coming time ``ahead`` [s] in which gaps open by ``opening`` [radii/s]."""
    store(scratch, GAP_THEN, 0, gap)
    store(scratch, GAP_END, 0, gap + ahead * opening)
    store(scratch, PLACE_OF_MMF, 0, place)
    store(scratch, FRACTION, 0, fraction)
    for a in range(LANES):
        scratch[PULL, a] = mean_neck_pull(
            table, scratch[GAP_THEN, a], scratch[GAP_END, a], model.smallest_gap, scratch[PLACE_OF_MMF, a],
            scratch[FRACTION, a],
        )  # fmt: skip
    return load(scratch, PULL, 0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def neck_forces(
    b, table, model, tables, rows, known, neck_mmf, attraction, ahead, scratch, near_force, virial
):  # fmt: skip
    """Forces [N] on the near pairs in block b at constant mmfs and moments, into ``near_force`` (k, 8).

    ``tables``: `_ends_of_pair`'s; contrasts (n, 2); velocities (n, 4). Without ``attraction`` what lies along the line
    of centres is left out. ``virial`` (blocks, 9, 8): r_a F_b [N m], or None.
    """
    source, contrast, moving = tables
    (i, j), turn, (nx, ny, nz), (ax, ay, az), (bx, by, bz), along, volumes = _ends_of_pair(b, source, rows, known)
    pair = known.near_pair
    D, size, gap, per_r = load(neck_mmf, b, 0), load(pair, b, SIZE), load(pair, b, GAP), load(pair, b, PER_TRUE)
    sign, capacity, place, fraction = _place_of_mmf(table, D, along, volumes, size)
    x, below = load(pair, b, PLACE), load(pair, b, BELOW)
    _, y1, _, y_i = neck_simd(table, x, below, place, fraction)
    c_i, _ = gather_two_columns(contrast, i, 0)
    c_j, _ = gather_two_columns(contrast, j, 0)
    both = c_i * c_j
    pull = 0.0 * D
    if attraction:
        rise = y_i / (maximum(gap, model.smallest_gap) * table.gap_step)
        if ahead > 0.0:
            ux, uy, uz, _ = gather_columns(moving, i, 0)
            wx, wy, wz, _ = gather_columns(moving, j, 0)
            wx, wy, wz = vector_to_image(turn, wx, wy, wz)
            wx = wx + gather_column(rows.images, load(known.near_unique, b, IMAGE), DU)
            opening = ((ux - wx) * nx + (uy - wy) * ny + (uz - wz) * nz) / size
            rise = _mean_of_step(b, table, model, gap, opening, ahead, place, fraction, scratch)
        product = ax * bx + ay * by + az * bz - along[0] * along[1]
        pull = D * D * rise - both * load(pair, b, ACROSS_SLOPE) * product
    # the line of centres turns: capacity and transverse part
    filling = -0.5 * size * D * D * y1 * sign / (capacity * table.scale) * per_r
    turning = both * load(pair, b, ACROSS) * per_r
    u, v = filling / volumes[0] - turning * along[1], filling / volumes[1] - turning * along[0]
    back = -pull - u * along[0] - v * along[1]
    fx, fy, fz = MU_0 * (u * ax + v * bx + back * nx), MU_0 * (u * ay + v * by + back * ny), MU_0 * (
        u * az + v * bz + back * nz
    )  # fmt: skip
    if virial is not None:
        r = 1.0 / per_r
        rx, ry, rz = r * nx, r * ny, r * nz
        store(virial, b, 0, rx * fx)
        store(virial, b, 1, rx * fy)
        store(virial, b, 2, rx * fz)
        store(virial, b, 3, ry * fx)
        store(virial, b, 4, ry * fy)
        store(virial, b, 5, ry * fz)
        store(virial, b, 6, rz * fx)
        store(virial, b, 7, rz * fy)
        store(virial, b, 8, rz * fz)
    e, t = load(known.near_unique, b, ENTRY), load(known.near_unique, b, TWIN)
    gx, gy, gz = vector_from_image(turn, -fx, -fy, -fz)
    scatter_columns(near_force, first_present(t, e), 0, gx, gy, gz, 0.0 * fz)
    scatter_columns(near_force, e, 0, fx, fy, fz, 0.0 * fz)
