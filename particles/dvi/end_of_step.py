"""The end of a step of rigid grains: impulses kept, work and torque recorded, new velocities, drift."""

from __future__ import annotations

import numpy as np
from numba import prange

from geometry.kernels.device_functions import device_function
from particles.dvi import gauss_seidel as gs
from particles.dvi.compliance import spring_energy
from particles.dvi.gauss_seidel import (
    ARM,
    EX,
    EY,
    EZ,
    LX,
    LY,
    PX,
    PY,
    PZ,
    RX,
    RY,
    RZ,
    VX,
    VY,
    VZ,
)  # fmt: skip
from particles.dvi.sweep_chunks import part_of
from particles.periodic_images import pair_vector_to_image, pair_velocity_to_image

# columns of the totals
(
    CONTACTS, IMPACT, SLIDING, CONTACT_WORK, GRAVITY_WORK, EXTERNAL_WORK, STABILISATION, MAX_OVERLAP, GRAIN, MAX_SPEED,
    SWEEPS, RESIDUAL, MISSED, KEPT, LOADED, VISITS, ACCELERATED, PROJECTIONS, MAX_SWEEPS, ROLLING, TWISTING,
) = range(21)  # fmt: skip
N_SUMS = 21
# columns of a body's sums: torques of the normal and of the tangential impulses, force, and work
TORQUE_N, TORQUE_T, FORCE_X, FORCE_Y, FORCE_Z, BODY_WORK, DRIVE_WORK, LOAD_WORK = range(8)
N_BODY_SUMS = 8
# columns of what `accumulate_work` adds up in a step
LOADED_NOW, KEPT_NOW, IMPACT_NOW, SLIDING_NOW, WORK_NOW, SPRING_N, SPRING_T = range(7)
N_STEP_SUMS = 7


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def accumulate_work(
    part, h, pull, compliance, body_speed, mean_speed, grains, pair_slots, slots, records, sums, body_sums
):
    """Keep the impulses of a part for the next step; add up work and torques with the mean of old and new velocity.

    ``pull``: first column of the pulls, which count with the impulses; 0 without.
    """
    velocity, spin, radius = grains.velocity, grains.spin, grains.radius
    pair_slot, pair_impulse = pair_slots.contact_slot, pair_slots.impulse
    wall_slot, wall_impulse = slots.contact_slot, slots.impulse
    grain, _, pair_index, pair, wall_index, wall = records[:6]
    images, shift = records.images, records.pair_shift
    loaded = kept = 0
    impact = sliding = work = spring_n = spring_t = 0.0
    for k in range(part.p0, part.p1):
        s = pair_slot[k]
        x, y, z = pair[k, RX], pair[k, RY], pair[k, RZ]
        old = pair_impulse[s, 0] != 0.0 or pair_impulse[s, 1] != 0.0 or pair_impulse[s, 2] != 0.0
        pair_impulse[s, 0], pair_impulse[s, 1], pair_impulse[s, 2] = x, y, z
        idle, px, py, pz = x == 0.0 and y == 0.0 and z == 0.0, 0.0, 0.0, 0.0
        if pull > 0:
            px, py, pz = pair_impulse[s, pull], pair_impulse[s, pull + 1], pair_impulse[s, pull + 2]
            idle = idle and px == 0.0 and py == 0.0 and pz == 0.0
            x, y, z = x + px, y + py, z + pz
        if idle:
            if compliance is None:
                continue
            if pair[k, gs.GAP] >= 0.0:  # an overlap that its dashpot has let go still stores energy
                continue
        loaded += not idle
        kept += old and not idle
        i, j = pair_index[k, 0], pair_index[k, 1]
        ex, ey, ez, arm = pair[k, EX], pair[k, EY], pair[k, EZ], pair[k, ARM]
        wx, wy = pair_velocity_to_image(images, shift, k, grain[j, VX], grain[j, VY])
        hx, hy = pair_velocity_to_image(images, shift, k, velocity[j, 0], velocity[j, 1])
        sx, sy = grain[j, PX] + radius[j] * spin[j, 0], grain[j, PY] + radius[j] * spin[j, 1]
        sx, sy = pair_vector_to_image(images, shift, k, sx, sy)
        sx += grain[i, PX] + radius[i] * spin[i, 0]
        sy += grain[i, PY] + radius[i] * spin[i, 1]
        sz = grain[i, PZ] + grain[j, PZ] + radius[i] * spin[i, 2] + radius[j] * spin[j, 2]
        ux = grain[i, VX] - wx + velocity[i, 0] - hx - arm * (sy * ez - sz * ey)
        uy = grain[i, VY] - wy + velocity[i, 1] - hy - arm * (sz * ex - sx * ez)
        uz = grain[i, VZ] - grain[j, VZ] + velocity[i, 2] - velocity[j, 2] - arm * (sx * ey - sy * ex)
        if compliance is not None:
            u_n = (grain[i, VX] - wx) * ex + (grain[i, VY] - wy) * ey + (grain[i, VZ] - grain[j, VZ]) * ez
            gap = pair[k, gs.GAP] + h * u_n
            a, b = spring_energy(compliance, gs.PAIRS, gap, x, y, z, ex, ey, ez)
            # a pull F_c keeps the overlap delta with the energy -F_c delta
            spring_n, spring_t = spring_n + a - min(gap, 0.0) / h * (px * ex + py * ey + pz * ez), spring_t + b
        total = 0.5 * (x * ux + y * uy + z * uz)
        normal = 0.5 * (x * ex + y * ey + z * ez) * (ux * ex + uy * ey + uz * ez)
        impact -= normal
        sliding -= total - normal
        work += total
    for k in range(part.w0, part.w1):
        s = wall_slot[k]
        x, y, z = wall[k, RX], wall[k, RY], wall[k, RZ]
        old = wall_impulse[s, 0] != 0.0 or wall_impulse[s, 1] != 0.0 or wall_impulse[s, 2] != 0.0
        wall_impulse[s, 0], wall_impulse[s, 1], wall_impulse[s, 2] = x, y, z
        idle, px, py, pz = x == 0.0 and y == 0.0 and z == 0.0, 0.0, 0.0, 0.0
        if pull > 0:
            px, py, pz = wall_impulse[s, pull], wall_impulse[s, pull + 1], wall_impulse[s, pull + 2]
            idle = idle and px == 0.0 and py == 0.0 and pz == 0.0
            x, y, z = x + px, y + py, z + pz
        if idle:
            if compliance is None:
                continue
            if wall[k, gs.GAP] >= 0.0:  # an overlap that its dashpot has let go still stores energy
                continue
        loaded += not idle
        kept += old and not idle
        i, b = wall_index[k, 0], wall_index[k, 1]
        ex, ey, ez, arm = wall[k, EX], wall[k, EY], wall[k, EZ], wall[k, ARM]
        sx = grain[i, PX] + radius[i] * spin[i, 0]
        sy = grain[i, PY] + radius[i] * spin[i, 1]
        sz = grain[i, PZ] + radius[i] * spin[i, 2]
        ux = 0.5 * (grain[i, VX] + velocity[i, 0] - arm * (sy * ez - sz * ey))
        uy = 0.5 * (grain[i, VY] + velocity[i, 1] - arm * (sz * ex - sx * ez))
        uz = 0.5 * (grain[i, VZ] + velocity[i, 2] - arm * (sx * ey - sy * ex))
        on_grain = x * ux + y * uy + z * uz
        r_n = x * ex + y * ey + z * ez
        lever_n = wall[k, LX] * ex + wall[k, LY] * ey
        lever = wall[k, LX] * x + wall[k, LY] * y
        omega = mean_speed[b]
        if compliance is not None:
            u_n = grain[i, VX] * ex + grain[i, VY] * ey + grain[i, VZ] * ez - body_speed[b] * lever_n
            gap = wall[k, gs.GAP] + h * u_n
            a, c = spring_energy(compliance, gs.WALLS, gap, x, y, z, ex, ey, ez)
            spring_n, spring_t = spring_n + a - min(gap, 0.0) / h * (px * ex + py * ey + pz * ez), spring_t + c
        normal = r_n * (ux * ex + uy * ey + uz * ez - omega * lever_n)
        impact -= normal
        sliding -= on_grain - omega * lever - normal
        work += on_grain
        body_sums[b, TORQUE_N] -= r_n * lever_n / h
        body_sums[b, TORQUE_T] -= (lever - r_n * lever_n) / h
        body_sums[b, FORCE_X] -= x / h
        body_sums[b, FORCE_Y] -= y / h
        body_sums[b, FORCE_Z] -= z / h
        body_sums[b, BODY_WORK] += omega * lever
    sums[LOADED_NOW], sums[KEPT_NOW], sums[IMPACT_NOW], sums[SLIDING_NOW] = loaded, kept, impact, sliding
    sums[WORK_NOW], sums[SPRING_N], sums[SPRING_T] = work, spring_n, spring_t


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_totals(compliance, sums, totals):
    """Add the energy budget of a step, one row a chunk."""
    run, springs = totals.run, totals.springs
    loaded = impact = sliding = spring_n = spring_t = 0.0
    for c in range(sums.shape[0]):
        loaded += sums[c, LOADED_NOW]
        run[KEPT] += sums[c, KEPT_NOW]
        impact, sliding = impact + sums[c, IMPACT_NOW], sliding + sums[c, SLIDING_NOW]
        run[CONTACT_WORK] += sums[c, WORK_NOW]
        spring_n, spring_t = spring_n + sums[c, SPRING_N], spring_t + sums[c, SPRING_T]
    run[CONTACTS] = loaded
    run[LOADED] += loaded
    if compliance is not None:
        impact, sliding = impact - spring_n + springs[0], sliding - spring_t + springs[1]
        springs[0], springs[1] = spring_n, spring_t
    run[IMPACT] += impact
    run[SLIDING] += sliding


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def accumulate_in_chunks(
    h, pull, compliance, body_speed, mean_speed, grains, pair_slots, slots, records, chunk, body_totals
):
    """`accumulate_work` by chunks."""
    rows, pairs, walls, sums, body_sums = chunk.rows, chunk.pairs, chunk.walls, chunk.sums, chunk.body_sums
    count = rows.shape[0] - 1
    for c in prange(count + 1):
        body_sums[c] = 0.0
        accumulate_work(
            part_of(c, rows, pairs, walls), h, pull, compliance, body_speed, mean_speed, grains, pair_slots, slots,
            records, sums[c], body_sums[c],
        )  # fmt: skip
    for c in range(count + 1):
        for b in range(body_totals.shape[0]):
            for q in range(N_BODY_SUMS):
                body_totals[b, q] += body_sums[c, b, q]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def move(h, drift, rate, strain, step, grains, grain, totals):
    """Take the new velocities and drift; returns the largest squared distance from the list's positions.

    In a sheared box, of the shear ``rate`` [1/s] and the ``strain`` since the list was made at the end of the drift,
    speeds, works and distances are peculiar; elsewhere both are 0.
    """
    position, velocity, spin, radius, mass, gravity, external, reference = grains[:8]
    g = min(step, gravity.shape[0] - 1)
    gravity_work = external_work = travel = fastest = 0.0
    for i in range(mass.shape[0]):
        x, y, z = grain[i, VX], grain[i, VY], grain[i, VZ]
        flow = rate * position[i, 2]
        sx, sy, sz = velocity[i, 0] + x - 2.0 * flow, velocity[i, 1] + y, velocity[i, 2] + z
        if gravity.shape[0] > 0:
            gravity_work += 0.5 * h * mass[i] * (gravity[g, 0] * sx + gravity[g, 1] * sy + gravity[g, 2] * sz)
        if external.shape[0] > 0:
            external_work += 0.5 * h * (external[i, 0] * sx + external[i, 1] * sy + external[i, 2] * sz)
        velocity[i, 0], velocity[i, 1], velocity[i, 2] = x, y, z
        inverse = 1.0 / radius[i]
        spin[i, 0], spin[i, 1], spin[i, 2] = grain[i, PX] * inverse, grain[i, PY] * inverse, grain[i, PZ] * inverse
        position[i, 0] += drift * x
        position[i, 1] += drift * y
        position[i, 2] += drift * z
        dx, dy, dz = (
            position[i, 0] - reference[i, 0],
            position[i, 1] - reference[i, 1],
            position[i, 2] - reference[i, 2],
        )
        dx -= strain * (reference[i, 2] + 0.5 * dz)
        x -= flow
        d2 = dx * dx + dy * dy + dz * dz + 0.0 * (spin[i, 0] + spin[i, 1] + spin[i, 2])
        if not d2 <= travel:
            travel = d2 if d2 == d2 else np.inf
        fastest = max(fastest, x * x + y * y + z * z)
    totals[GRAVITY_WORK] += gravity_work
    totals[EXTERNAL_WORK] += external_work
    totals[MAX_SPEED] = max(totals[MAX_SPEED], np.sqrt(fastest))
    return travel
