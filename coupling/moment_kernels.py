"""Compiled sweeps that find the moments of grains which magnetise one another, and the forces of their contacts.

The model is that of `coupling.mutual_moments`. A sweep evaluates all equations at one state, dipoles and mmfs: fluxes
of the necks from the mmfs, charges of the grains from the fluxes, field S and potential of every grain from the
others' dipoles and charges, then the residuals of dipoles and mmfs. Each grain gathers from its row alone
(Jacobi); a pair is computed once and its result put at an entry of each grain. So no bit depends on the number of
threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.grain_law_table import (
    SMALLEST_CAPACITY,
    contrast_of,
    gap_place,
    mean_neck_pull,
    mmf_place,
    neck_scalar,
    sphere_coenergy,
    sphere_ratio,
)
from coupling.image_kernels import (
    IMAGED_CHUNK,
    N_HEIGHTS,
    N_LIST,
    clear_forces,
    columns_twice,
    field_of_images,
    find_forces,
    list_grain_images,
    list_pair_images,
    wall_sides,
)
from coupling.influence_kernels import slope_along
from coupling.kernel_state import FIRST, SECOND, PairSubset
from coupling.mirror import FACES_NO_WALL, height_over, normal_at
from coupling.neck_kernels import (
    CHARGE,
    FIELD,
    MU_0,
    N_SCRATCH,
    mmf_residuals,
    neck_fluxes,
    neck_forces,
    neck_moments,
)
from coupling.pair_fields import OVER_4PI
from coupling.row_kernels import columns_of, field_of_row, force_of_row
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES
from geometry.kernels.simd_math import sqrt

BLOCKS = 32  # of near pairs that one thread takes at once
# columns of what the necks do to a grain: field (3) [A/m], transverse energy over the contrast [A^2 m], and the sums of
# dq/dD/(4 pi a) [-] and of |w_ss|/(2 Ms^2 V) [-], the response of the necks to its mmfs and to its magnetisation
ADDED, TRANSVERSE, MMF_RESPONSE, BEND, N_RESPONSE = 0, 3, 4, 5, 6


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def wall_heights(position, walls, reach, height):
    """Signed heights (n, w) [m] of grains over walls (w, 6), see `coupling.mirror`; `FACES_NO_WALL` where none."""
    for i in prange(position.shape[0]):
        for w in range(walls.shape[0]):
            height[i, w] = height_over(walls, w, position[i, 0], position[i, 1], position[i, 2], reach)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def is_near_wall(i, w, grains):
    """True if a grain has a neck with its own image in a wall: their surfaces are less than 1.2 radii apart."""
    h = abs(grains.height[i, w])
    return h < FACES_NO_WALL and h < 1.6 * grains.radius[i]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def neck_at_wall(i, w, neck_mmf, walls, table, model, grains):
    """Geometry and energy of the neck between a grain and its image, at its mmf [A].

    Normal (3) from the wall to the grain, the gap [radii] between grain and image, y, its derivatives over ln z and
    over the gap's place, place and factor of `mmf_place`, and -w_s ds/d(M.n)/V over mu_0 [A/m].
    """
    nx, ny, nz = normal_at(walls, w, grains.position[i, 0], grains.position[i, 1])
    side = 1.0 if grains.height[i, w] > 0.0 else -1.0
    nx, ny, nz = side * nx, side * ny, side * nz
    a = grains.radius[i]
    gap = 2.0 * (abs(grains.height[i, w]) / a - 1.0)
    sign = -1.0 if neck_mmf < 0.0 else 1.0
    m_n = grains.dipole[i, 0] * nx + grains.dipole[i, 1] * ny + grains.dipole[i, 2] * nz
    capacity = max(1.0 - sign * m_n / (grains.volume[i] * table.scale), SMALLEST_CAPACITY)
    place, fraction = mmf_place(table, neck_mmf, capacity, a)
    x, below = gap_place(table, gap, model.smallest_gap)
    neck = neck_scalar(table, x, below, place, fraction)
    filling = -0.5 * a * neck_mmf * neck_mmf * neck[1] * sign / (capacity * table.scale * grains.volume[i])
    return (nx, ny, nz), gap, neck, (place, fraction), filling


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def find_fluxes(
    table, model, grains, rows, walls, known, neck_mmf, wall_mmf, contrast, neck, wall_neck, charge, response,
    near_field,
):  # fmt: skip
    """Contrasts (n, 3), fluxes of all necks at their mmfs, charges (n,) [A m], and the ``response`` (n, N_RESPONSE).

    ``neck_mmf`` (blocks, 8), ``wall_mmf`` (n, w) [A]; ``neck`` (blocks, N_NECK, 8), ``wall_neck`` (n, w, 2): flux [A m]
    and energy w + q D over mu_0 [A^2 m], of a wall half of the mirrored pair's, times the wall's strength.
    ``near_field`` (k, 8) is scratch, with room for all near entries.
    """
    source = columns_of(grains.dipole, grains.volume)
    near_start, radius, near = known.near_start, grains.radius, model.near
    for i in prange(radius.shape[0]):
        size = sqrt(source[i, 0] ** 2 + source[i, 1] ** 2 + source[i, 2] ** 2)
        contrast[i, 0], contrast[i, 1], contrast[i, 2] = contrast_of(table, size / source[i, 3])
    for b in prange(known.near_unique.shape[0]):
        neck_fluxes(b, table, source, contrast, rows, known, neck_mmf, neck, near_field)
    for i in prange(radius.shape[0]):
        hx = hy = hz = across = total = stiffness = bend = 0.0
        for k in range(near_start[i], near_start[i + 1]):
            hx, hy, hz = hx + near_field[k, FIELD], hy + near_field[k, FIELD + 1], hz + near_field[k, FIELD + 2]
            across += near_field[k, FIELD + 3]
            total += near_field[k, CHARGE]
            stiffness += near_field[k, CHARGE + 1]
            bend += near_field[k, CHARGE + 2]
        for w in range(walls.shape[0]):
            wall_neck[i, w, 0] = wall_neck[i, w, 1] = 0.0
            if near and is_near_wall(i, w, grains):
                D, strength, a = wall_mmf[i, w], walls[w, 5], radius[i]
                (nx, ny, nz), _, (y, y1, y2, _), _, filling = neck_at_wall(i, w, D, walls, table, model, grains)
                q = -a * D * (2.0 * y + y1)
                wall_neck[i, w, 0] = strength * q
                wall_neck[i, w, 1] = 0.5 * strength * (a * D * D * y + q * D)
                hx, hy, hz = hx + strength * filling * nx, hy + strength * filling * ny, hz + strength * filling * nz
                total += strength * q
                stiffness -= strength * a * (2.0 * y + 3.0 * y1 + y2)
        charge[i] = total
        response[i, ADDED], response[i, ADDED + 1], response[i, ADDED + 2] = hx, hy, hz
        response[i, TRANSVERSE] = across
        response[i, MMF_RESPONSE] = stiffness * OVER_4PI / radius[i]
        response[i, BEND] = bend


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def gather_fields(model, grains, rows, known, field, potential):
    """Field S (n, 3) [A/m], applied + own + that of all others within reach, and potential (n,) [A]; with images."""
    dipole, charge, applied = grains.dipole, grains.charge, grains.applied
    itself, image, image_start, image_entry, other = (
        known.itself, known.image, known.image_start, known.image_entry, rows.other,
    )  # fmt: skip
    place, source = columns_of(grains.position, grains.radius), columns_of(dipole, charge)
    twice = columns_twice(dipole, charge)
    blocks = image.reshape(image.shape[0], 4 * image.shape[1])
    for i in prange(dipole.shape[0]):
        mx, my, mz, q = source[i, 0], source[i, 1], source[i, 2], source[i, 3]
        own = itself[i]
        sx = applied[i, 0] + own[0, 0] * mx + own[0, 1] * my + own[0, 2] * mz + own[0, 3] * q
        sy = applied[i, 1] + own[1, 0] * mx + own[1, 1] * my + own[1, 2] * mz + own[1, 3] * q
        sz = applied[i, 2] + own[2, 0] * mx + own[2, 1] * my + own[2, 2] * mz + own[2, 3] * q
        total = own[3, 0] * mx + own[3, 1] * my + own[3, 2] * mz + own[3, 3] * q if model.near else 0.0
        qx, qy, qz, u = field_of_row(i, place, source, model, rows)
        sx, sy, sz, total = sx + qx, sy + qy, sz + qz, total + u
        qx, qy, qz, u = field_of_images(i, image_start, image_entry, other, blocks, twice)
        sx, sy, sz, total = sx + qx, sy + qy, sz + qz, total + u
        field[i, 0], field[i, 1], field[i, 2], potential[i] = sx, sy, sz, total


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def dipole_residual(table, grains, response, step, squares):
    """Residual steps (n, 3) [A m^2] of the dipoles: to their law in ``field`` and in what the necks add to it.

    A step is divided by the response of the necks to it (``BEND``). ``squares`` (n, 2): of the undivided step and of
    the magnetisation by the law [A^2/m^2].
    """
    field, dipole, volume = grains.field, grains.dipole, grains.volume
    contrast = grains.contrast
    for i in prange(dipole.shape[0]):
        V = volume[i]
        ox, oy, oz = dipole[i, 0] / V, dipole[i, 1] / V, dipole[i, 2] / V
        size = sqrt(ox * ox + oy * oy + oz * oz)
        # energy across depends on how far the grain is saturated
        more = response[i, TRANSVERSE] * contrast[i, 1] / (V * size) if size > 0.0 else 0.0
        hx = field[i, 0] + response[i, ADDED] + more * ox
        hy = field[i, 1] + response[i, ADDED + 1] + more * oy
        hz = field[i, 2] + response[i, ADDED + 2] + more * oz
        strength = sqrt(hx * hx + hy * hy + hz * hz)
        ratio, tangent = sphere_ratio(table, strength)
        dx, dy, dz = ratio * hx - ox, ratio * hy - oy, ratio * hz - oz
        squares[i, 0] = dx * dx + dy * dy + dz * dz
        squares[i, 1] = ratio * ratio * strength * strength
        # what a capacity takes from a magnetisation comes back through the necks
        part = V / (1.0 + max(tangent, contrast[i, 2]) * response[i, BEND])
        step[i, 0], step[i, 1], step[i, 2] = part * dx, part * dy, part * dz


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def mmf_residual(model, grains, walls, known, response, neck_mmf, wall_mmf, step, wall_step, squares, wall_squares):
    """Residual steps [A] of the mmfs to the potentials, see `coupling.neck_kernels.mmf_residuals`.

    ``squares`` (blocks, 2), ``wall_squares`` (n, 2): of the step and of the mmfs [A^2].
    """
    potential = np.empty((grains.potential.shape[0], 2))
    for i in range(grains.potential.shape[0]):
        potential[i, 0], potential[i, 1] = grains.potential[i], response[i, MMF_RESPONSE]
    near = model.near
    for b in prange(known.near_unique.shape[0]):
        squares[b, 0], squares[b, 1] = mmf_residuals(b, potential, known, neck_mmf, step)
    for i in prange(wall_mmf.shape[0]):
        residual_2 = mmf_2 = 0.0
        for w in range(walls.shape[0]):
            wall_step[i, w] = 0.0
            if near and is_near_wall(i, w, grains):
                residual = mmf_at_wall(i, w, walls, model, grains) - wall_mmf[i, w]
                residual = residual / (1.0 + response[i, MMF_RESPONSE])
                wall_step[i, w] = residual
                residual_2 += residual * residual
                mmf_2 += wall_mmf[i, w] ** 2
        wall_squares[i, 0], wall_squares[i, 1] = residual_2, mmf_2


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def applied_at_wall(i, w, walls, model, grains):
    """Mmf [A] of the applied field between a grain and its image, twice that between grain and wall."""
    applied, h = grains.applied, grains.height[i, w]
    nx, ny, nz = normal_at(walls, w, grains.position[i, 0], grains.position[i, 1])
    mean = applied[i, 0] * nx + applied[i, 1] * ny + applied[i, 2] * nz
    if model.smear:
        mean -= h / 3.0 * slope_along(i, nx, ny, nz, grains)  # the cubic; the image's side is the mirrored one
    return 2.0 * h * mean


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mmf_at_wall(i, w, walls, model, grains):
    """Mmf [A] between a grain and its image."""
    return applied_at_wall(i, w, walls, model, grains) - 2.0 * grains.potential[i]


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def wall_drives(model, grains, walls, neck_mmf):
    """Mmfs (n, w) [A] of the applied field over the necks of grains at walls; 0 where there is none."""
    for i in prange(neck_mmf.shape[0]):
        for w in range(walls.shape[0]):
            neck_mmf[i, w] = applied_at_wall(i, w, walls, model, grains) if is_near_wall(i, w, grains) else 0.0


@njit(cache=True, error_model="numpy")
def begin_mmf(unique, number, potential, pair_before, mmf_before, neck_mmf):
    """Set the ``neck_mmf`` (blocks, 8) [A] of near pairs, which holds the applied field's, to that of an earlier solve.

    ``unique``: see `coupling.kernel_state.PairSubset`. ``number`` (n,): of the grains; ``potential`` [A] and
    ``pair_before`` (k, 2) are by number, ``mmf_before`` (k,) [A] is from the second grain to the first. A pair that was
    not among them has the applied field's mmf less the difference of the potentials.
    """
    start = np.zeros(potential.shape[0] + 1, np.int64)
    for k in range(pair_before.shape[0]):
        start[min(pair_before[k, 0], pair_before[k, 1]) + 1] += 1
    for a in range(potential.shape[0]):
        start[a + 1] += start[a]
    place, order = start[:-1].copy(), np.empty(pair_before.shape[0], np.int64)
    for k in range(pair_before.shape[0]):
        low = min(pair_before[k, 0], pair_before[k, 1])
        order[place[low]] = k
        place[low] += 1
    for g in range(LANES * unique.shape[0]):
        b, a = g // LANES, g % LANES
        i, j = number[unique[b, FIRST, a]], number[unique[b, SECOND, a]]
        low, high = min(i, j), max(i, j)
        mmf = neck_mmf[b, a] - (potential[i] - potential[j])
        for q in range(start[low], start[low + 1]):
            k = order[q]
            if max(pair_before[k, 0], pair_before[k, 1]) == high:
                mmf = mmf_before[k] if pair_before[k, 0] == i else -mmf_before[k]
                break
        neck_mmf[b, a] = mmf


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def add_charge_moments(rows, grains, walls, known, neck, wall_neck, moment, near_moment):
    """Add the moments of the necks' charges, of q r n the part up to the neck, to ``moment`` (n, 3) [A m^2]."""
    near_start = known.near_start
    position, height = grains.position, grains.height
    place = columns_of(position, grains.radius)
    for b in prange(known.near_unique.shape[0]):
        neck_moments(b, place, rows, known, neck, near_moment)
    for i in prange(position.shape[0]):
        mx = my = mz = 0.0
        for k in range(near_start[i], near_start[i + 1]):
            mx, my, mz = mx + near_moment[k, 0], my + near_moment[k, 1], mz + near_moment[k, 2]
        for w in range(walls.shape[0]):
            if wall_neck[i, w, 0] != 0.0:
                nx, ny, nz = normal_at(walls, w, position[i, 0], position[i, 1])
                arm = wall_neck[i, w, 0] * height[i, w]
                mx, my, mz = mx + arm * nx, my + arm * ny, mz + arm * nz
        moment[i, 0] += mx
        moment[i, 1] += my
        moment[i, 2] += mz


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def grain_energies(table, grains, energy):
    """Energy of each grain over mu_0 (n,) [A^2 m]: V u(M) - m.(H + S)/2 + Q phi/2, at the law's own M.

    u(M) is the work of magnetising a lone sphere, dM against its field.
    """
    for i in prange(grains.radius.shape[0]):
        mx, my, mz = grains.dipole[i, 0], grains.dipole[i, 1], grains.dipole[i, 2]
        V = grains.volume[i]
        M = sqrt(mx * mx + my * my + mz * mz) / V
        energy[i] = V * sphere_energy(table, M)
        energy[i] -= 0.5 * (
            mx * (grains.applied[i, 0] + grains.field[i, 0])
            + my * (grains.applied[i, 1] + grains.field[i, 1])
            + mz * (grains.applied[i, 2] + grains.field[i, 2])
        )
        energy[i] += 0.5 * grains.charge[i] * grains.potential[i]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def sphere_energy(table, M):
    """Integral of the field of a lone sphere over dM from 0 to M [A/m], in A^2/m^2."""
    if M <= 0.0:
        return 0.0
    first = table.sphere[0, 0]
    low, high = M / first, M / first
    for _ in range(200):  # the field that has this M: bracketed, then halved in the logarithm
        ratio, _ = sphere_ratio(table, high)
        if ratio * high >= M or high > 1e6 * table.scale:
            break
        low, high = high, 1.5 * high
    for _ in range(60):
        middle = sqrt(low * high)
        ratio, _ = sphere_ratio(table, middle)
        if ratio * middle < M:
            low = middle
        else:
            high = middle
    h = sqrt(low * high)
    return h * M - sphere_coenergy(table, h)


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def contact_forces(
    table, model, grains, rows, walls, known, neck_mmf, wall_mmf, attraction, velocity, ahead, force, torque,
    near_force, virial, near_virial,
):  # fmt: skip
    """Forces (n, 3) [N], added: of dipoles, charges and necks at constant dipoles, charges and mmfs.

    The pull of necks along the lines of centres only with ``attraction``; with ``ahead`` > 0 [s] it is its mean over
    that time at the present ``velocity`` (n, 3) [m/s]: a step of rigid grains is longer than its range. Images in the
    walls (w, 6) included, and the applied field's force on the charges. ``torque`` (n, 2): z-components [N m] of x x F
    of the pairs, and of images and walls; without the applied field's. ``near_force`` (k, 8) is scratch, with room
    for all near entries and all that see images. ``virial`` (n, 9) and ``near_virial`` (blocks, 9, 8): r_a F_b [N m],
    of half of each grain's pairs and of each neck; or None.
    """
    position, radius = grains.position, grains.radius
    near = model.near
    near_start, image_start = known.near_start, known.image_start
    n, n_near = position.shape[0], known.near_entry.shape[0]
    place, source = columns_of(position, radius), columns_of(grains.dipole, grains.charge)
    tables = columns_of(grains.dipole, grains.volume), grains.contrast, columns_of(velocity, radius)
    charge, applied = grains.charge, grains.applied
    for b in prange((known.near_unique.shape[0] + BLOCKS - 1) // BLOCKS):
        scratch = np.empty((N_SCRATCH, LANES))
        for k in range(b * BLOCKS, min((b + 1) * BLOCKS, known.near_unique.shape[0])):
            neck_forces(
                k, table, model, tables, rows, known, neck_mmf, attraction, ahead, scratch, near_force, near_virial
            )
    image, own_image = near_force[n_near:], np.zeros((n, 8))
    imaged = PairSubset(known.image_start, known.image_entry, known.image_twin, known.image_unique, known.image_pairs)
    count, room = known.image_pairs, walls.shape[0] * IMAGED_CHUNK + LANES
    faces = wall_sides(grains)
    for b in prange((count + IMAGED_CHUNK - 1) // IMAGED_CHUNK):
        first, image_list, heights = b * IMAGED_CHUNK, np.empty((N_LIST, room), np.int32), np.empty((N_HEIGHTS, room))
        clear_forces(first, min(first + IMAGED_CHUNK, count), imaged, image)
        m = list_pair_images(first, min(first + IMAGED_CHUNK, count), model.reach, faces, imaged, image_list, heights)
        find_forces(m, model, place, source, rows, walls, image_list, heights, image)
    for b in prange((n + IMAGED_CHUNK - 1) // IMAGED_CHUNK if walls.shape[0] else 0):
        first, image_list, heights = b * IMAGED_CHUNK, np.empty((N_LIST, room), np.int32), np.empty((N_HEIGHTS, room))
        m = list_grain_images(first, min(first + IMAGED_CHUNK, n), model.reach, faces, rows, image_list, heights)
        find_forces(m, model, place, source, rows, walls, image_list, heights, own_image)
    for i in prange(n):
        xi, yi = position[i, 0], position[i, 1]
        fx, fy, fz = force_of_row(i, place, source, model, rows, virial)
        for k in range(near_start[i], near_start[i + 1]):
            fx, fy, fz = fx + near_force[k, 0], fy + near_force[k, 1], fz + near_force[k, 2]
        torque[i, 0] = xi * fy - yi * fx
        gx, gy, gz = own_image[i, 0], own_image[i, 1], own_image[i, 2]
        for b in range(image_start[i], image_start[i + 1]):
            gx, gy, gz = gx + image[b, 0], gy + image[b, 1], gz + image[b, 2]
        for w in range(walls.shape[0]):
            if not (near and is_near_wall(i, w, grains)):
                continue
            D, strength, a = wall_mmf[i, w], walls[w, 5], radius[i]
            (nx, ny, nz), gap, (y, y1, _, y_i), at, filling = neck_at_wall(i, w, D, walls, table, model, grains)
            # the flux into a wall sees the applied field across it alone
            hx, hy, hz = applied[i, 0], applied[i, 1], applied[i, 2]
            across, q = hx * nx + hy * ny + hz * nz, MU_0 * strength * a * D * (2.0 * y + y1)
            gx, gy, gz = gx + q * (hx - across * nx), gy + q * (hy - across * ny), gz + q * (hz - across * nz)
            if attraction:
                rise = y_i / (max(gap, model.smallest_gap) * table.gap_step)
                if ahead > 0.0:
                    opening = velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz
                    rise = mean_neck_pull(table, gap, gap + 2.0 * ahead * opening / a, model.smallest_gap, at[0], at[1])
                pull = MU_0 * strength * D * D * rise
                gx, gy, gz = gx - pull * nx, gy - pull * ny, gz - pull * nz
            # the normal turns with the grain's place about the axis: the capacity for its moment, the applied mmf
            rho2 = xi * xi + yi * yi
            if rho2 > 0.0:
                turn = MU_0 * strength * filling * (nx * grains.dipole[i, 1] - ny * grains.dipole[i, 0])
                turn = (turn - q * abs(grains.height[i, w]) * (nx * hy - ny * hx)) / rho2
                gx, gy = gx - turn * yi, gy + turn * xi
        torque[i, 1] = xi * gy - yi * gx
        q = MU_0 * charge[i]
        force[i, 0] += fx + gx + q * applied[i, 0]
        force[i, 1] += fy + gy + q * applied[i, 1]
        force[i, 2] += fz + gz + q * applied[i, 2]
