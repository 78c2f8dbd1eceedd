"""Compiled contacts of a grain with its later partners in the list, and the pull of those that attract it.

A pair stands in the row of its first grain. Its reaction goes to the second one directly, or, where that lies in a
later chunk of rows, into the chunk's places in the buffer (`particles.neighbours.partition`).

Lever arms sum to the distance of centres, and the two torques are l_i n x F and l_j n x F: angular momentum is
conserved to round-off.
"""

from __future__ import annotations

import numpy as np

from geometry.inner_functions import inner
from particles.dem.attraction_kernel import ACROSS, AMPLITUDE, COLUMN, pull_at
from particles.dem.contact_kernel import Touch, contact_force, left_in_springs, rolling_torque, twisting_torque
from particles.dem.kernel_state import Tally
from particles.laws.springs import equal


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def through_face(turn, shift, k, x, y):
    """Components across the axis of a vector of the partner in slot k, as its image has them."""
    if turn is not None:
        if shift[k] != 0:
            sine = turn[1] * shift[k]
            x, y = turn[0] * x - sine * y, sine * x + turn[0] * y
    return x, y


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def back_through_face(turn, shift, k, x, y):
    """Components across the axis of a reaction on the image in slot k, as the partner itself has them."""
    if turn is not None:
        if shift[k] != 0:
            sine = turn[1] * shift[k]
            x, y = turn[0] * x + sine * y, turn[0] * y - sine * x
    return x, y


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mass_of(law, mass, i):
    """Mass of grain i [kg]; equal grains share one place in the cache."""
    return mass[0] if equal(law) else mass[i]


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pull_of_pair(attraction, pairs, k, j, place, crossing, away, radii, pulled):
    """Add the pull of pair k, which lies ``away`` (3) [m], to that on grain i (3) [N]; its reaction goes to grain j.

    What drives it stands with the slot: near or touching.
    """
    if attraction is None:
        return pulled
    dx, dy, dz = away
    ri, rj = radii
    reach = ri + rj
    d2 = dx * dx + dy * dy + dz * dz
    d, inverse = np.sqrt(d2), 1.0 / d2 if d2 > 0.0 else 0.0  # before any branch: the contact takes them over
    if attraction.pair[k, AMPLITUDE] == 0.0 and attraction.pair[k, ACROSS] == 0.0:
        return pulled
    pull = pull_at(
        attraction,
        (d - reach) * (reach / (2.0 * ri * rj)),  # quotients beside the root, not after it
        attraction.pair[k, COLUMN],
        attraction.pair[k, AMPLITUDE],
        attraction.pair[k, ACROSS],
    )
    pull *= d * inverse
    gx, gy, gz = pull * dx, pull * dy, pull * dz
    drawn = (pulled[0] + gx, pulled[1] + gy, pulled[2] + gz)
    gx, gy = back_through_face(pairs.turn, pairs.shift, k, gx, gy)
    if crossing:
        attraction.cross[place, 0], attraction.cross[place, 1], attraction.cross[place, 2] = gx, gy, gz
    else:
        attraction.drawn[j, 0] -= gx
        attraction.drawn[j, 1] -= gy
        attraction.drawn[j, 2] -= gz
    return drawn


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_forces(i, end, place, dt, law, resistance, energy_column, attraction, grains, pairs, chunks, tally):
    """Contacts of grain i with its partners; those from row ``end`` on belong to later chunks.

    ``place`` is the last place used in the buffer. Returns it, force [N], torque [N m] and pull [N] on the grain (3
    each), and the tally.
    """
    position_radius, velocity_force = grains.position_radius, grains.velocity_force
    mass, species = grains.mass, grains.species
    touching, history, record, cross = pairs.touching, pairs.history, pairs.record, chunks.reaction
    x, y, z, ri = position_radius[i, 0], position_radius[i, 1], position_radius[i, 2], position_radius[i, 3]
    vx, vy, vz = velocity_force[i, 0], velocity_force[i, 1], velocity_force[i, 2]
    wx, wy, wz = velocity_force[i, 3], velocity_force[i, 4], velocity_force[i, 5]
    mi = mass_of(law, mass, i)
    fx = fy = fz = tx = ty = tz = 0.0
    pulled = (0.0, 0.0, 0.0)
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at = tally
    for k in range(pairs.start[i], pairs.start[i + 1]):
        j = pairs.other[k]
        crossing = j >= end
        if crossing:
            place += 1
        jx, jy = through_face(pairs.turn, pairs.shift, k, position_radius[j, 0], position_radius[j, 1])
        rj = position_radius[j, 3]
        dx, dy, dz = jx - x, jy - y, position_radius[j, 2] - z
        d2 = dx * dx + dy * dy + dz * dz
        reach = ri + rj
        pulled = pull_of_pair(attraction, pairs, k, j, place, crossing, (dx, dy, dz), (ri, rj), pulled)
        kind = 0
        if d2 >= reach * reach:
            if touching[k] != 0:
                touching[k] = 0
                if energy_column is not None:
                    if species.shape[0] > 0:
                        kind = pairs.law_row[species[i], species[j]]
                    ux, uy = through_face(pairs.turn, pairs.shift, k, velocity_force[j, 0], velocity_force[j, 1])
                    closing = ((vx - ux) * dx + (vy - uy) * dy + (vz - velocity_force[j, 2]) * dz) / np.sqrt(d2)
                    lost = left_in_springs(
                        law, kind, resistance, energy_column, ri * rj / reach, closing * dt, history, k
                    )  # fmt: skip
                    lost_n, lost_s, lost_r, lost_w = (
                        lost_n + lost[0], lost_s + lost[1], lost_r + lost[2], lost_w + lost[3],
                    )  # fmt: skip
                for a in range(history.shape[1]):
                    history[k, a] = 0.0
                if crossing:
                    for a in range(6):
                        cross[place, a] = 0.0
            continue
        touching[k] = 1
        d = np.sqrt(d2)
        inverse = d * (1.0 / d2) if d2 > 0.0 else 0.0  # beside the root, not after it
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        ux, uy = through_face(pairs.turn, pairs.shift, k, velocity_force[j, 0], velocity_force[j, 1])
        qx, qy = through_face(pairs.turn, pairs.shift, k, velocity_force[j, 3], velocity_force[j, 4])
        uz, qz = velocity_force[j, 2], velocity_force[j, 5]
        if equal(law):
            mj = mi
            li, r_eff, m_eff = 0.5 * d, 0.5 * ri, 0.5 * mi
        else:
            mj = mass[j]
            m_eff = mi * mj / (mi + mj)
            share = ri / reach
            li = d * share
            r_eff = rj * share
            if species.shape[0] > 0:
                kind = pairs.law_row[species[i], species[j]]
        lj = d - li
        delta = reach - d
        ax, ay, az = li * wx + lj * qx, li * wy + lj * qy, li * wz + lj * qz
        # by how much n has turned in the drift that has just ended
        hx, hy, hz = (ux - vx) * dt * inverse, (uy - vy) * dt * inverse, (uz - vz) * dt * inverse
        along = hx * nx + hy * ny + hz * nz
        inverse_last = 1.0 + along  # d/d_last
        touch = Touch(
            delta,
            (nx, ny, nz),
            (vx - ux + ay * nz - az * ny, vy - uy + az * nx - ax * nz, vz - uz + ax * ny - ay * nx),
            ((hx - along * nx) * inverse_last, (hy - along * ny) * inverse_last, (hz - along * nz) * inverse_last),
            0.5 * ((wx + qx) * nx + (wy + qy) * ny + (wz + qz) * nz),
        )
        force = contact_force(law, kind, energy_column, m_eff, r_eff, dt, touch, history, k)
        gx, gy, gz = force.x, force.y, force.z
        contacts += 1
        if equal(law):
            deepest_at = i if delta > deepest else deepest_at
            deepest = max(deepest, delta)  # [m]; made a share of the diameter at the end
        else:
            least = 2.0 * min(ri, rj)
            if delta > deepest * least:
                deepest, deepest_at = delta / least, i
        if energy_column is not None:
            elastic += force.stored
            lost_n += force.lost_n
            lost_t += force.lost_t
            lost_s += force.lost_s
        mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
        fx, fy, fz = fx + gx, fy + gy, fz + gz
        tx, ty, tz = tx + li * mx, ty + li * my, tz + li * mz
        mx, my, mz = lj * mx, lj * my, lj * mz
        if resistance is not None:
            own, others = mi * ri * ri, mj * rj * rj
            inertia = 0.4 * own * others / (own + others)
            if resistance.rolling >= 0:
                (hx, hy, hz), e, lost_1 = rolling_torque(
                    law, kind, energy_column, r_eff, inertia, dt, force, touch, (wx - qx, wy - qy, wz - qz), history, k,
                    resistance.rolling,
                )  # fmt: skip
                elastic += e
                lost_r += lost_1
                tx, ty, tz = tx + hx, ty + hy, tz + hz
                mx, my, mz = mx - hx, my - hy, mz - hz
            if resistance.twisting >= 0:
                spin = (wx - qx) * nx + (wy - qy) * ny + (wz - qz) * nz
                torque, e, lost_1 = twisting_torque(
                    law, kind, energy_column, r_eff, inertia, dt, force, spin, history, k, resistance.twisting
                )
                elastic += e
                lost_w += lost_1
                tx, ty, tz = tx + torque * nx, ty + torque * ny, tz + torque * nz
                mx, my, mz = mx - torque * nx, my - torque * ny, mz - torque * nz
        if record.shape[0] > 0:
            record[k, 0], record[k, 1], record[k, 2] = gx, gy, gz
        gx, gy = back_through_face(pairs.turn, pairs.shift, k, gx, gy)
        mx, my = back_through_face(pairs.turn, pairs.shift, k, mx, my)
        if crossing:
            cross[place, 0], cross[place, 1], cross[place, 2] = gx, gy, gz
            cross[place, 3], cross[place, 4], cross[place, 5] = mx, my, mz
        else:
            velocity_force[j, 6] -= gx
            velocity_force[j, 7] -= gy
            velocity_force[j, 8] -= gz
            velocity_force[j, 9] += mx
            velocity_force[j, 10] += my
            velocity_force[j, 11] += mz
    tally = Tally(contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)
    return place, (fx, fy, fz), (tx, ty, tz), pulled, tally
