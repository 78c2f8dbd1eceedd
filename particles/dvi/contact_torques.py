"""Rolling and twisting friction in DVI: a torque with the impulse of each contact.

With the coefficients and R_eff of `particles.laws.rolling_friction` and `particles.laws.twisting_friction`
(1/R_eff = 1/R_i + 1/R_j, R_i at a wall), a contact with the normal impulse r_n also transmits the angular impulse
R_eff c, to i and its opposite to j; c is an impulse [N s], dual to the velocity w = R_eff (omega_i - omega_j):

    |c_t| <= mu_r r_n,   c_t opposite to w_t where it is equal;      |c_n| <= mu_w r_n,   c_n opposite to w_n.

A torque below its limit allows no w at all; of compliant contacts (`particles.dvi.compliance`) its spring has the
stiffness k_t R_eff^2 of DEM, without the dashpot: w' + c_t (c' - c) = 0, with the c_t of the tangential spring, c the
torque of the step before, and energy c_t c^2/2. With q_i = R_eff/R_i and the scaled
spins p = R omega of `particles.dvi.gauss_seidel`,

    w = q_i p_i - q_j p_j,    dp_i = (5/2) q_i c/m_i,    dp_j = -(5/2) q_j c/m_j,

so that W = (5/2)(q_i^2/m_i + q_j^2/m_j) times the identity: the nearest point of the disc and of the interval to
c - w/W solves one torque alone. At a wall w = p_i - R_i omega_b e_z, and a free shaft adds R_i^2/J e_z e_z^T to W:
twisting is solved first, then rolling on the axes of its 2 x 2 block, by the secular equation of the disc.

A sweep visits the torques after all impulses, with their present r_n. The bounds follow r_n, but r_n does not see the
torques' law: it is the same with exact Coulomb friction and with the convex relaxation.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.dvi import gauss_seidel as gs
from particles.dvi.gauss_seidel import (
    EX,
    EY,
    EZ,
    GAP,
    IJ,
    IM,
    PAIRS,
    PX,
    PY,
    PZ,
    RX,
    RY,
    RZ,
    SPEED,
    TANGENTIAL,
    WALLS,
)  # fmt: skip
from particles.dvi.local_problem import in_disc
from particles.dvi.solver_state import Torques, all_of
from particles.dvi.triangle_contacts import COS_STEP, SIN_STEP
from particles.periodic_images import pair_vector_from_image, pair_vector_to_image

# columns of a torque: c, R_eff/R_i, R_eff/R_j (at a wall R_i itself), 1/W (the largest W), mu_r, mu_w; with springs
# also c_t and the offset of w
CX, CY, CZ, QI, QJ, IW, ROLL, TWIST, GIVE, OX, OY, OZ = range(12)
N_TORQUE = 8
N_SPRING_TORQUE = 12


def no_contact_torques() -> Torques:
    """The torques of contacts that resist neither rolling nor twisting: no rows, for which nothing is done."""
    return Torques(np.zeros((0, 2)), np.zeros((0, N_TORQUE)), np.zeros((0, N_TORQUE)))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def begin_contact_torques(compliance, radius, pairs, slots, walls, records, contact_torques):
    """Fill the records of the torques, those of the last step first in line, and let them act on the velocities.

    Columns 3 to 5 of the slots hold the last c; they are cleared. On triangles c turns with the body, as impulses do.
    """
    law, pair_torque, wall_torque = contact_torques
    grain, body, pair_index, pair, wall_index, wall = records[:6]
    pair_slot, pair_impulse = pairs.contact_slot, pairs.impulse
    wall_slot, wall_impulse = slots.contact_slot, slots.impulse
    n_smooth, wall_other, turn = walls.smooth.shape[0], slots.other, walls.turn
    for k in range(pair.shape[0]):
        row, s = pair_torque[k], pair_slot[k]
        i, j = pair_index[k, 0], pair_index[k, 1]
        row[QI] = radius[j] / (radius[i] + radius[j])
        row[QJ] = 1.0 - row[QI]
        row[IW] = 1.0 / (2.5 * (grain[i, IM] * row[QI] * row[QI] + grain[j, IM] * row[QJ] * row[QJ]))
        row[ROLL], row[TWIST] = law[0, 0], law[0, 1]
        loaded = pair[k, RX] != 0.0 or pair[k, RY] != 0.0 or pair[k, RZ] != 0.0
        for a in range(3):
            row[CX + a] = pair_impulse[s, 3 + a] if loaded else 0.0
        if compliance is not None:
            _set_spring(compliance[PAIRS, TANGENTIAL], pair[k, GAP], row)
    for k in range(wall.shape[0]):
        row, s = wall_torque[k], wall_slot[k]
        i, b = wall_index[k, 0], wall_index[k, 1]
        row[QI], row[QJ] = 1.0, radius[i]
        row[IW] = 1.0 / (2.5 * grain[i, IM] + body[b, IJ] * radius[i] * radius[i])
        row[ROLL], row[TWIST] = law[1, 0], law[1, 1]
        loaded = wall[k, RX] != 0.0 or wall[k, RY] != 0.0 or wall[k, RZ] != 0.0
        for a in range(3):
            row[CX + a] = wall_impulse[s, 3 + a] if loaded else 0.0
        if turn.shape[0] > 0:
            if wall_other[s] >= n_smooth:
                x, y = row[CX], row[CY]
                row[CX] = turn[b, COS_STEP] * x - turn[b, SIN_STEP] * y
                row[CY] = turn[b, SIN_STEP] * x + turn[b, COS_STEP] * y
        if compliance is not None:
            _set_spring(compliance[WALLS, TANGENTIAL], wall[k, GAP], row)
    pair_impulse[:, 3:6] = 0.0
    wall_impulse[:, 3:6] = 0.0
    apply_contact_torques(1.0, records, contact_torques)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _set_spring(give, gap, row):
    """Put the spring into a torque's row, which holds the torque of the step before."""
    row[GIVE] = give
    row[IW] = 1.0 / (1.0 / row[IW] + give)
    for a in range(3):
        row[OX + a] = -give * row[CX + a] if gap <= 0.0 else 0.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def apply_contact_torques(sign, records, contact_torques):
    """Add to the spins ``sign`` times what the torques in the records do."""
    grain, body, pair_index, wall_index = records.grain, records.body, records.pair_index, records.wall_index
    pair_torque, wall_torque = contact_torques.pair, contact_torques.wall
    for k in range(pair_index.shape[0]):
        _turn_pair(
            records, k, pair_torque[k],
            sign * pair_torque[k, CX], sign * pair_torque[k, CY], sign * pair_torque[k, CZ],
        )  # fmt: skip
    for k in range(wall_index.shape[0]):
        _turn_at_wall(
            grain, body, wall_index[k, 0], wall_index[k, 1], wall_torque[k],
            sign * wall_torque[k, CX], sign * wall_torque[k, CY], sign * wall_torque[k, CZ],
        )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _turn_pair(records, k, row, x, y, z):
    """Add the torque (x, y, z) of pair k to the spins of its grains."""
    grain, i, j = records.grain, records.pair_index[k, 0], records.pair_index[k, 1]
    a, b = 2.5 * row[QI] * grain[i, IM], 2.5 * row[QJ] * grain[j, IM]
    grain[i, PX] += a * x
    grain[i, PY] += a * y
    grain[i, PZ] += a * z
    x, y = pair_vector_from_image(records.images, records.pair_shift, k, x, y)
    grain[j, PX] -= b * x
    grain[j, PY] -= b * y
    grain[j, PZ] -= b * z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _turn_at_wall(grain, body, i, b, row, x, y, z):
    """The same for a grain and a body."""
    a = 2.5 * grain[i, IM]
    grain[i, PX] += a * x
    grain[i, PY] += a * y
    grain[i, PZ] += a * z
    if body[b, IJ] > 0.0:  # several threads share a body of prescribed speed
        body[b, SPEED] -= body[b, IJ] * row[QJ] * z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _admissible(row, r_n, ex, ey, ez, x, y, z):
    """The nearest torque to (x, y, z) that the contact bears under the normal impulse r_n."""
    load = max(r_n, 0.0)
    along = x * ex + y * ey + z * ez
    x, y, z = x - along * ex, y - along * ey, z - along * ez
    size2, limit = x * x + y * y + z * z, row[ROLL] * load
    if size2 > limit * limit:
        scale = limit / np.sqrt(size2)
        x, y, z = scale * x, scale * y, scale * z
    limit = row[TWIST] * load
    along = min(max(along, -limit), limit)
    return x + along * ex, y + along * ey, z + along * ez


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _pair_velocity(compliance, records, k, row):
    """w [m/s] of pair k, and what its spring gives."""
    grain, i, j = records.grain, records.pair_index[k, 0], records.pair_index[k, 1]
    a, b = row[QI], row[QJ]
    x, y = pair_vector_to_image(records.images, records.pair_shift, k, grain[j, PX], grain[j, PY])
    x, y, z = a * grain[i, PX] - b * x, a * grain[i, PY] - b * y, a * grain[i, PZ] - b * grain[j, PZ]
    if compliance is not None:
        c = row[GIVE]
        x, y, z = x + row[OX] + c * row[CX], y + row[OY] + c * row[CY], z + row[OZ] + c * row[CZ]
    return x, y, z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _wall_velocity(compliance, grain, body, i, b, row):
    """The same of a grain at a body."""
    x, y, z = grain[i, PX], grain[i, PY], grain[i, PZ] - row[QJ] * body[b, SPEED]
    if compliance is not None:
        c = row[GIVE]
        x, y, z = x + row[OX] + c * row[CX], y + row[OY] + c * row[CY], z + row[OZ] + c * row[CZ]
    return x, y, z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep_contact_torques(part, relax, compliance, records, contact_torques):
    """Visit every torque of a part once; returns the largest change of a torque times W [m/s]."""
    grain, body, _, pair, wall_index, wall = records[:6]
    pair_torque, wall_torque = contact_torques.pair, contact_torques.wall
    largest = 0.0
    over = relax if relax > 0.0 else 1.0
    for k in range(part.p0, part.p1):
        row = pair_torque[k]
        ex, ey, ez = pair[k, EX], pair[k, EY], pair[k, EZ]
        r_n = pair[k, RX] * ex + pair[k, RY] * ey + pair[k, RZ] * ez
        cx, cy, cz = row[CX], row[CY], row[CZ]
        if r_n <= 0.0 and cx == 0.0 and cy == 0.0 and cz == 0.0:
            continue
        step = over * row[IW]
        x, y, z = _pair_velocity(compliance, records, k, row)
        x, y, z = _admissible(row, r_n, ex, ey, ez, cx - step * x, cy - step * y, cz - step * z)
        row[CX], row[CY], row[CZ] = x, y, z
        x, y, z = x - cx, y - cy, z - cz
        largest = max(largest, (x * x + y * y + z * z) / (row[IW] * row[IW]))
        _turn_pair(records, k, row, x, y, z)
    for k in range(part.w0, part.w1):
        row = wall_torque[k]
        ex, ey, ez = wall[k, EX], wall[k, EY], wall[k, EZ]
        r_n = wall[k, RX] * ex + wall[k, RY] * ey + wall[k, RZ] * ez
        cx, cy, cz = row[CX], row[CY], row[CZ]
        if r_n <= 0.0 and cx == 0.0 and cy == 0.0 and cz == 0.0:
            continue
        i, b = wall_index[k, 0], wall_index[k, 1]
        x, y, z = _wall_velocity(compliance, grain, body, i, b, row)
        if body[b, IJ] > 0.0:
            own = 2.5 * grain[i, IM]
            if compliance is not None:
                own += row[GIVE]
            x, y, z = _at_free_shaft(own, body[b, IJ], row, r_n, ex, ey, ez, x, y, z)
        else:
            step = over * row[IW]
            x, y, z = _admissible(row, r_n, ex, ey, ez, cx - step * x, cy - step * y, cz - step * z)
        row[CX], row[CY], row[CZ] = x, y, z
        x, y, z = x - cx, y - cy, z - cz
        largest = max(largest, (x * x + y * y + z * z) / (row[IW] * row[IW]))
        _turn_at_wall(grain, body, i, b, row, x, y, z)
    return np.sqrt(largest)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _at_free_shaft(own, free, row, r_n, ex, ey, ez, wx, wy, wz):
    """The new torque at a body that its z-component turns: W = own + free R^2 e_z e_z^T; (wx, wy, wz) is w."""
    load = max(r_n, 0.0)
    added = free * row[QJ] * row[QJ]
    cx, cy, cz = row[CX], row[CY], row[CZ]
    was = cx * ex + cy * ey + cz * ez
    limit = row[TWIST] * load
    twist = was - (wx * ex + wy * ey + wz * ez) / (own + added * ez * ez)
    twist = min(max(twist, -limit), limit)
    # rolling sees what twisting has changed
    wz += added * ez * (twist - was)
    # axes of the tangent plane: what is left of e_z, and across
    size = np.sqrt(ex * ex + ey * ey)  # 1 - e_z^2 would lose a normal along z to round-off
    if size > 1e-12:
        fx, fy, fz = -ez * ex / size, -ez * ey / size, size
    else:  # W is the same in all directions of the plane
        fx, fy, fz, size = 1.0, 0.0, 0.0, 0.0
    gx, gy, gz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    big = own + added * size * size
    f = big * (cx * fx + cy * fy + cz * fz) - (wx * fx + wy * fy + wz * fz)
    g = own * (cx * gx + cy * gy + cz * gz) - (wx * gx + wy * gy + wz * gz)
    f, g = in_disc(big, own, row[ROLL] * load, f, g)
    return twist * ex + f * fx + g * gx, twist * ey + f * fy + g * gy, twist * ez + f * fz + g * gz


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def contact_torque_residual(part, compliance, records, contact_torques):
    """Largest natural map |c - P(c - w/W)| W over the torques of a part [m/s], P the nearest admissible one."""
    grain, body, _, pair, wall_index, wall = records[:6]
    pair_torque, wall_torque = contact_torques.pair, contact_torques.wall
    worst = 0.0
    for k in range(part.p0, part.p1):
        x, y, z = _pair_velocity(compliance, records, k, pair_torque[k])
        worst = max(worst, _violation(pair_torque[k], pair, k, x, y, z))
    for k in range(part.w0, part.w1):
        x, y, z = _wall_velocity(compliance, grain, body, wall_index[k, 0], wall_index[k, 1], wall_torque[k])
        worst = max(worst, _violation(wall_torque[k], wall, k, x, y, z))
    return worst


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _violation(row, contact, k, wx, wy, wz):
    ex, ey, ez = contact[k, EX], contact[k, EY], contact[k, EZ]
    r_n = contact[k, RX] * ex + contact[k, RY] * ey + contact[k, RZ] * ez
    step = row[IW]
    x, y, z = _admissible(row, r_n, ex, ey, ez, row[CX] - step * wx, row[CY] - step * wy, row[CZ] - step * wz)
    x, y, z = row[CX] - x, row[CY] - y, row[CZ] - z
    return np.sqrt(x * x + y * y + z * z) / step


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep(convex, relax, compliance, records, contact_torques):
    """One sweep over impulses and, where there are ``torques``, these; returns the largest change [m/s]."""
    change = gs.sweep(convex, relax, compliance, records)
    if contact_torques.law.shape[0] > 0:
        change = max(change, sweep_contact_torques(all_of(records), relax, compliance, records, contact_torques))
    return change


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def residual(part, convex, compliance, records, contact_torques):
    """The honest residual of a part of the impulses and, where there are ``torques``, of these [m/s]."""
    worst = gs.residual(part, convex, compliance, records)
    if contact_torques.law.shape[0] > 0:
        worst = max(worst, contact_torque_residual(part, compliance, records, contact_torques))
    return worst


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def weigh_contact_torques(weight, first, pairs, walls, contact_torques):
    """sqrt(W) of so many pairs and walls, from place ``first`` on."""
    for k in range(pairs):
        weight[first + 3 * k : first + 3 * k + 3] = 1.0 / np.sqrt(contact_torques.pair[k, IW])
    first += 3 * pairs
    for k in range(walls):
        weight[first + 3 * k : first + 3 * k + 3] = 1.0 / np.sqrt(contact_torques.wall[k, IW])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def accumulate_torque_work(
    h, compliance, mean_speed, grains, pairs, slots, records, contact_torques, totals, torque, body_work
):
    """Keep the torques for the next step; add up work and torques with the mean of old and new spin.

    Returns the losses to rolling and to twisting and the work on the grains [J]; ``torque``, ``body_work``: columns of
    the bodies' totals. The energy in the springs is renewed.
    """
    grain, _, pair_index, pair, wall_index, wall = records[:6]
    spin, radius, springs, body_totals = grains.spin, grains.radius, totals.springs, totals.bodies
    pair_slot, pair_impulse = pairs.contact_slot, pairs.impulse
    wall_slot, wall_impulse = slots.contact_slot, slots.impulse
    pair_torque, wall_torque = contact_torques.pair, contact_torques.wall
    rolling = twisting = work = spring_r = spring_w = 0.0
    for k in range(pair.shape[0]):
        row, s = pair_torque[k], pair_slot[k]
        x, y, z = row[CX], row[CY], row[CZ]
        pair_impulse[s, 3], pair_impulse[s, 4], pair_impulse[s, 5] = x, y, z
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        i, j = pair_index[k, 0], pair_index[k, 1]
        a, b = 0.5 * row[QI], 0.5 * row[QJ]
        wx, wy = grain[j, PX] + radius[j] * spin[j, 0], grain[j, PY] + radius[j] * spin[j, 1]
        wx, wy = pair_vector_to_image(records.images, records.pair_shift, k, wx, wy)
        wx = a * (grain[i, PX] + radius[i] * spin[i, 0]) - b * wx
        wy = a * (grain[i, PY] + radius[i] * spin[i, 1]) - b * wy
        wz = a * (grain[i, PZ] + radius[i] * spin[i, 2]) - b * (grain[j, PZ] + radius[j] * spin[j, 2])
        ex, ey, ez = pair[k, EX], pair[k, EY], pair[k, EZ]
        total = x * wx + y * wy + z * wz
        c_n = x * ex + y * ey + z * ez
        along = c_n * (wx * ex + wy * ey + wz * ez)
        if compliance is not None:
            spring_r += 0.5 * row[GIVE] * max(x * x + y * y + z * z - c_n * c_n, 0.0)
            spring_w += 0.5 * row[GIVE] * c_n * c_n
        rolling -= total - along
        twisting -= along
        work += total
    for k in range(wall.shape[0]):
        row, s = wall_torque[k], wall_slot[k]
        x, y, z = row[CX], row[CY], row[CZ]
        wall_impulse[s, 3], wall_impulse[s, 4], wall_impulse[s, 5] = x, y, z
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        i, b = wall_index[k, 0], wall_index[k, 1]
        wx = 0.5 * (grain[i, PX] + radius[i] * spin[i, 0])
        wy = 0.5 * (grain[i, PY] + radius[i] * spin[i, 1])
        wz = 0.5 * (grain[i, PZ] + radius[i] * spin[i, 2])
        work += x * wx + y * wy + z * wz
        wz -= row[QJ] * mean_speed[b]
        ex, ey, ez = wall[k, EX], wall[k, EY], wall[k, EZ]
        total = x * wx + y * wy + z * wz
        c_n = x * ex + y * ey + z * ez
        along = c_n * (wx * ex + wy * ey + wz * ez)
        if compliance is not None:
            spring_r += 0.5 * row[GIVE] * max(x * x + y * y + z * z - c_n * c_n, 0.0)
            spring_w += 0.5 * row[GIVE] * c_n * c_n
        rolling -= total - along
        twisting -= along
        body_totals[b, torque] -= row[QJ] * z / h
        body_totals[b, body_work] += row[QJ] * z * mean_speed[b]
    if compliance is not None:
        rolling, twisting = rolling - spring_r + springs[2], twisting - spring_w + springs[3]
        springs[2], springs[3] = spring_r, spring_w
    return rolling, twisting, work
