"""Compiled sweep over rows of the half list: forces on grain i and its later partners, its walls, its kick and drift.

A grain is complete when its row ends, because every pair stands in the row of its first grain: it is integrated there,
while it is in the cache. Only a grain that has a partner in an earlier chunk of rows must wait (``late``): that chunk
runs beside this one, so its reactions come through a buffer with a place for every such pair, and `finish_rows` adds
them in the order of the pairs once all chunks are done. Nothing depends on the number of threads, bit for bit.

A held attraction pulls every pair of the list that it drives, touching or not; its sums go the same way, in places of
their own.

Lever arms sum to the distance of centres, and the two torques are l_i n x F and l_j n x F: angular momentum is
conserved to round-off.
"""

from __future__ import annotations

import numpy as np

from geometry.inner_functions import inner
from particles.dem import sums as column
from particles.dem.attraction_kernel import ACROSS, AMPLITUDE, COLUMN, pull_at
from particles.dem.contact_kernel import contact_force, left_in_springs, rolling_couple, twisting_couple
from particles.laws.columns import DAMPING_ROLLING
from particles.walls.triangle_kernels import LEADER, SLOT, triangle_contacts
from particles.walls.wall_kernels import _wall_gap


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def drift(
    i, dt, ledger, gravity, step, external, attraction, where, motion, m, reference, net, last, fx, fy, fz, tx, ty, tz,
    px, py, pz, row,
):  # fmt: skip
    """Kick and drift of grain i under contact force f and torque t, drawn by p; clears its place for the next step.

    Adds works to the chunk's sums ``row``; returns squared travel from ``reference`` [m^2] and squared speed.
    """
    kick = dt / m
    radius = where[i, 3]
    turn = kick / (0.4 * radius * radius)
    ax, ay, az = fx, fy, fz
    if gravity.shape[0] > 0:
        g = min(step, gravity.shape[0] - 1)
        ax, ay, az = ax + m * gravity[g, 0], ay + m * gravity[g, 1], az + m * gravity[g, 2]
    if external.shape[0] > 0:
        ax, ay, az = ax + external[i, 0], ay + external[i, 1], az + external[i, 2]
    if attraction is not None:
        ax, ay, az = ax + px, ay + py, az + pz
        attraction.drawn[i, 0], attraction.drawn[i, 1], attraction.drawn[i, 2] = 0.0, 0.0, 0.0
    vx, vy, vz = motion[i, 0], motion[i, 1], motion[i, 2]
    wx, wy, wz = motion[i, 3], motion[i, 4], motion[i, 5]
    bx, by, bz = vx + kick * ax, vy + kick * ay, vz + kick * az
    ox, oy, oz = wx + turn * tx, wy + turn * ty, wz + turn * tz
    motion[i, 0], motion[i, 1], motion[i, 2] = bx, by, bz
    motion[i, 3], motion[i, 4], motion[i, 5] = ox, oy, oz
    motion[i, 6], motion[i, 7], motion[i, 8] = 0.0, 0.0, 0.0
    motion[i, 9], motion[i, 10], motion[i, 11] = 0.0, 0.0, 0.0
    if ledger is not None:
        # half a kick with the velocities of the drift before it, half with those of the drift after it: the mean closes
        # the balance of kinetic energy exactly, and by drifts it is the trapezoidal rule
        half = 0.5 * dt
        row[column.CONTACT_WORK] += half * (fx * vx + fy * vy + fz * vz + tx * wx + ty * wy + tz * wz)
        row[column.CONTACT_LATER] += half * (fx * bx + fy * by + fz * bz + tx * ox + ty * oy + tz * oz)
        if gravity.shape[0] > 0:
            g = min(step, gravity.shape[0] - 1)
            row[column.GRAVITY_WORK] += half * m * (gravity[g, 0] * vx + gravity[g, 1] * vy + gravity[g, 2] * vz)
            row[column.GRAVITY_LATER] += half * m * (gravity[g, 0] * bx + gravity[g, 1] * by + gravity[g, 2] * bz)
        if external.shape[0] > 0:
            row[column.EXTERNAL_WORK] += half * (external[i, 0] * vx + external[i, 1] * vy + external[i, 2] * vz)
            row[column.EXTERNAL_LATER] += half * (external[i, 0] * bx + external[i, 1] * by + external[i, 2] * bz)
        if attraction is not None:  # a force of no contact, booked as the held ones are
            row[column.EXTERNAL_WORK] += half * (px * vx + py * vy + pz * vz)
            row[column.EXTERNAL_LATER] += half * (px * bx + py * by + pz * bz)
        if last:  # at the time of the positions that the forces belong to
            row[column.KINETIC] += (
                0.5 * m * (vx * bx + vy * by + vz * bz + 0.4 * radius * radius * (wx * ox + wy * oy + wz * oz))
            )
    x, y, z = where[i, 0] + dt * bx, where[i, 1] + dt * by, where[i, 2] + dt * bz
    where[i, 0], where[i, 1], where[i, 2] = x, y, z
    if last:
        net[i, 0], net[i, 1], net[i, 2] = fx, fy, fz
    dx, dy, dz = x - reference[i, 0], y - reference[i, 1], z - reference[i, 2]
    travel = dx * dx + dy * dy + dz * dz + 0.0 * (ox + oy + oz)  # a spin that is not finite shows here too
    return travel, bx * bx + by * by + bz * bz


@inner(error_model="numpy", fastmath={"contract"})
def add_left(linear, walton_braun, resisting, law, kind, radius, history, slot, columns, lost):
    """Book what the springs of a wall's slot held when the grain left it."""
    a, b, c, d = left_in_springs(linear, walton_braun, resisting, law, kind, radius, 0.0, history, slot, columns)
    lost[0] += a
    lost[1] += b
    lost[2] += c
    lost[3] += d


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def touching_walls(
    first, end, x, y, z, radius, linear, walton_braun, resisting, ledger, law, wall_row, kind_row, columns,
    wall, triangle, wall_body, body_turn, wall_other, wall_touching, wall_history, found, lost,
):  # fmt: skip
    """What grain i touches among its wall slots first <= k < end: rows (slot, distance, unit vector towards the wall).

    A grain that rolls from one face of a body onto the next keeps its springs: they are handed to the new slot.
    Returns the number of rows in ``found``.
    """
    n_walls = wall.shape[0]
    if end == first + 1 and wall_other[first] < n_walls:  # most grains that have a wall have one
        distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[first], x, y, z)
        if distance < radius and owned:
            wall_touching[first] = 1
            found[0, 0], found[0, 1], found[0, 2], found[0, 3], found[0, 4] = first, distance, nx, ny, nz
            return 1
        if wall_touching[first] != 0:
            wall_touching[first] = 0
            if ledger is not None:
                row = wall_row[kind_row, wall_other[first]]
                add_left(linear, walton_braun, resisting, law, row, radius, wall_history, first, columns, lost)
            for a in range(wall_history.shape[1]):
                wall_history[first, a] = 0.0
        return 0
    count = 0
    k = first
    while k < end:
        w = wall_other[k]
        k += 1
        if w < n_walls:
            distance, nx, ny, nz, owned = _wall_gap(wall, w, x, y, z)
            if distance < radius and owned:
                found[count, 0], found[count, 1] = k - 1, distance
                found[count, 2], found[count, 3], found[count, 4] = nx, ny, nz
                count += 1
        else:  # all triangles of one body at once, in the frame that turns with it
            body = wall_body[w]
            begin = k - 1
            while k < end and wall_body[wall_other[k]] == body:
                k += 1
            c, s = body_turn[body, 0], body_turn[body, 1]
            part = found[count:]
            more, seen = triangle_contacts(
                triangle, wall_other, begin, k, c * x + s * y, c * y - s * x, z, radius, part
            )
            for a in range(more, seen):  # a grain that goes over an edge changes its triangle, not its contact
                old, new = int(part[a, SLOT]), int(part[int(part[a, LEADER]), SLOT])
                if wall_touching[old] != 0:
                    wall_touching[old] = 0
                    if wall_touching[new] != 0 and ledger is not None:  # two contacts have become one
                        row = wall_row[kind_row, wall_other[old]]
                        add_left(linear, walton_braun, resisting, law, row, radius, wall_history, old, columns, lost)
                    if wall_touching[new] == 0:
                        wall_touching[new] = 1
                        for b in range(wall_history.shape[1]):
                            wall_history[new, b] = wall_history[old, b]
                    for b in range(wall_history.shape[1]):
                        wall_history[old, b] = 0.0
            for a in range(more):
                nx, ny = part[a, 2], part[a, 3]
                part[a, 2], part[a, 3] = c * nx - s * ny, s * nx + c * ny
            count += more
    for a in range(count):
        wall_touching[int(found[a, 0])] += 2  # 2: new, 3: as before; what is 1 now has parted
    for k in range(first, end):
        if wall_touching[k] == 1:
            wall_touching[k] = 0
            handed = False
            for a in range(count):
                new = int(found[a, 0])
                if wall_touching[new] == 2 and wall_body[wall_other[new]] == wall_body[wall_other[k]]:
                    for b in range(wall_history.shape[1]):
                        wall_history[new, b] = wall_history[k, b]
                    wall_touching[new] = 3
                    handed = True
                    break
            if ledger is not None and not handed:
                row = wall_row[kind_row, wall_other[k]]
                add_left(linear, walton_braun, resisting, law, row, radius, wall_history, k, columns, lost)
            for b in range(wall_history.shape[1]):
                wall_history[k, b] = 0.0
    for a in range(count):
        wall_touching[int(found[a, 0])] = 1
    return count


@inner(error_model="numpy", fastmath={"contract"})
def sweep_rows(
    chunk, lo, hi, dt, step, last,
    linear, hertz_mindlin, hertz, thesis, walton_braun, law, pair_row, wall_row, species, equal, columns,
    cohesive, resisting, ledger, turn, gravity, external, attraction,
    where, motion, mass, reference, net, late,
    pair_start, pair_other, pair_shift, pair_touching, pair_history, pair_record, cross_start, cross,
    wall, triangle, wall_body, body_speed, body_turn,
    wall_start, wall_other, wall_touching, wall_history, wall_record, scratch,
    sums, body_chunks,
):  # fmt: skip
    """Rows lo <= i < hi of chunk ``chunk``."""
    for b in range(body_chunks.shape[1]):
        for a in range(column.N_CHUNK_BODY):
            body_chunks[chunk, b, a] = 0.0
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    deepest, deepest_at, travel, fastest = 0.0, -1, 0.0, 0.0
    totals = sums[chunk]
    totals[:] = 0.0
    lost = np.zeros(4)  # to normal damping, sliding, rolling and twisting where a grain leaves a wall
    inv_dt = 1.0 / dt
    q = cross_start[chunk] - 1
    found = scratch[chunk]
    books = columns[2]
    mi = mj = mass[0]
    m_eff = 0.5 * mi
    for i in range(lo, hi):
        x, y, z, ri = where[i, 0], where[i, 1], where[i, 2], where[i, 3]
        vx, vy, vz = motion[i, 0], motion[i, 1], motion[i, 2]
        wx, wy, wz = motion[i, 3], motion[i, 4], motion[i, 5]
        if equal is None:
            mi = mass[i]
        fx = fy = fz = tx = ty = tz = drawn_x = drawn_y = drawn_z = 0.0
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            crossing = j >= hi
            if crossing:
                q += 1
            jx, jy, jz, rj = where[j, 0], where[j, 1], where[j, 2], where[j, 3]
            sine = 0.0
            if turn is not None:
                if pair_shift[k] != 0:
                    sine = turn[1] * pair_shift[k]
                    jx, jy = turn[0] * jx - sine * jy, sine * jx + turn[0] * jy
            dx, dy, dz = jx - x, jy - y, jz - z
            d2 = dx * dx + dy * dy + dz * dz
            reach = ri + rj
            if attraction is not None:  # near or touching; what it drives stands with the slot
                if attraction.pair[k, AMPLITUDE] != 0.0 or attraction.pair[k, ACROSS] != 0.0:
                    d = np.sqrt(d2)
                    pull = pull_at(
                        attraction,
                        (d - reach) * (reach / (2.0 * ri * rj)),  # quotients beside the root, not after it
                        attraction.pair[k, COLUMN],
                        attraction.pair[k, AMPLITUDE],
                        attraction.pair[k, ACROSS],
                    )
                    pull *= d * (1.0 / d2) if d2 > 0.0 else 0.0
                    gx, gy, gz = pull * dx, pull * dy, pull * dz
                    drawn_x, drawn_y, drawn_z = drawn_x + gx, drawn_y + gy, drawn_z + gz
                    if turn is not None:
                        if pair_shift[k] != 0:  # the reaction goes back through the face
                            gx, gy = turn[0] * gx + sine * gy, turn[0] * gy - sine * gx
                    if crossing:
                        attraction.cross[q, 0], attraction.cross[q, 1], attraction.cross[q, 2] = gx, gy, gz
                    else:
                        attraction.drawn[j, 0] -= gx
                        attraction.drawn[j, 1] -= gy
                        attraction.drawn[j, 2] -= gz
            if d2 >= reach * reach:
                if pair_touching[k] != 0:
                    pair_touching[k] = 0
                    if ledger is not None:
                        d = np.sqrt(d2)
                        kind = 0
                        if equal is None:
                            if species.shape[0] > 0:
                                kind = pair_row[species[i], species[j]]
                        ux, uy = motion[j, 0], motion[j, 1]
                        if turn is not None:
                            if pair_shift[k] != 0:
                                ux, uy = turn[0] * ux - sine * uy, sine * ux + turn[0] * uy
                        closing = ((vx - ux) * dx + (vy - uy) * dy + (vz - motion[j, 2]) * dz) / d
                        arm = ri * rj / reach
                        lost_1, lost_2, lost_3, lost_4 = left_in_springs(
                            linear,
                            walton_braun,
                            resisting,
                            law,
                            kind,
                            arm,
                            closing * dt,
                            pair_history,
                            k,
                            columns,
                        )
                        lost_n += lost_1
                        lost_s += lost_2
                        lost_r += lost_3
                        lost_w += lost_4
                    for a in range(pair_history.shape[1]):
                        pair_history[k, a] = 0.0
                    if crossing:
                        for a in range(6):
                            cross[q, a] = 0.0
                continue
            pair_touching[k] = 1
            d = np.sqrt(d2)
            inverse = d * (1.0 / d2) if d2 > 0.0 else 0.0  # beside the root, not after it
            nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
            ux, uy, uz = motion[j, 0], motion[j, 1], motion[j, 2]
            qx, qy, qz = motion[j, 3], motion[j, 4], motion[j, 5]
            if turn is not None:
                if pair_shift[k] != 0:
                    ux, uy = turn[0] * ux - sine * uy, sine * ux + turn[0] * uy
                    qx, qy = turn[0] * qx - sine * qy, sine * qx + turn[0] * qy
            if equal is not None:
                li = 0.5 * d
                r_eff = 0.5 * ri
            else:
                mj = mass[j]
                m_eff = mi * mj / (mi + mj)
                share = ri / reach
                li = d * share
                r_eff = rj * share
            lj = d - li
            kind = 0
            if equal is None:
                if species.shape[0] > 0:
                    kind = pair_row[species[i], species[j]]
            delta = reach - d
            ax, ay, az = li * wx + lj * qx, li * wy + lj * qy, li * wz + lj * qz
            # by how much n has turned in the drift that has just ended
            hx, hy, hz = (ux - vx) * dt * inverse, (uy - vy) * dt * inverse, (uz - vz) * dt * inverse
            share = hx * nx + hy * ny + hz * nz
            inverse_last = 1.0 + share  # d/d_last
            hx, hy, hz = (
                (hx - share * nx) * inverse_last,
                (hy - share * ny) * inverse_last,
                (hz - share * nz) * inverse_last,
            )
            spin_n = 0.5 * ((wx + qx) * nx + (wy + qy) * ny + (wz + qz) * nz)
            gx, gy, gz, f_rep, dashpot, pull, k_t, e, lost_1, lost_2, lost_3, k_last = contact_force(
                linear, hertz_mindlin, hertz, thesis, walton_braun, law, kind, equal, cohesive, ledger, True,
                m_eff, r_eff, dt, inv_dt, delta, nx, ny, nz,
                vx - ux + ay * nz - az * ny, vy - uy + az * nx - ax * nz, vz - uz + ax * ny - ay * nx,
                hx, hy, hz, spin_n, pair_history, k, books,
            )  # fmt: skip
            contacts += 1
            if equal is not None:
                deepest_at = i if delta > deepest else deepest_at
                deepest = max(deepest, delta)  # [m]; made a share of the diameter at the end
            else:
                least = 2.0 * min(ri, rj)
                if delta > deepest * least:
                    deepest, deepest_at = delta / least, i
            if ledger is not None:
                elastic += e
                lost_n += lost_1
                lost_t += lost_2
                lost_s += lost_3
            mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            tx, ty, tz = tx + li * mx, ty + li * my, tz + li * mz
            mx, my, mz = lj * mx, lj * my, lj * mz
            if resisting is not None:
                own, others = mi * ri * ri, mj * rj * rj
                inertia = 0.4 * own * others / (own + others)
                damping = law[kind, DAMPING_ROLLING]
                if columns[0] >= 0:
                    hx, hy, hz, e, lost_1 = rolling_couple(
                        law, kind, ledger, True, r_eff, inertia, k_t, k_last, damping, dt, f_rep, nx, ny, nz,
                        wx - qx, wy - qy, wz - qz, hx, hy, hz, spin_n, pair_history, k, columns[0], books,
                    )  # fmt: skip
                    elastic += e
                    lost_r += lost_1
                    tx, ty, tz = tx + hx, ty + hy, tz + hz
                    mx, my, mz = mx - hx, my - hy, mz - hz
                if columns[1] >= 0:
                    couple, e, lost_1 = twisting_couple(
                        law, kind, ledger, r_eff, inertia, k_t, k_last, damping, dt, f_rep,
                        (wx - qx) * nx + (wy - qy) * ny + (wz - qz) * nz, pair_history, k, columns[1], books,
                    )  # fmt: skip
                    elastic += e
                    lost_w += lost_1
                    tx, ty, tz = tx + couple * nx, ty + couple * ny, tz + couple * nz
                    mx, my, mz = mx - couple * nx, my - couple * ny, mz - couple * nz
            if pair_record.shape[0] > 0:
                pair_record[k, 0], pair_record[k, 1], pair_record[k, 2] = gx, gy, gz
            if turn is not None:
                if pair_shift[k] != 0:  # the reaction goes back through the face
                    gx, gy = turn[0] * gx + sine * gy, turn[0] * gy - sine * gx
                    mx, my = turn[0] * mx + sine * my, turn[0] * my - sine * mx
            if crossing:
                cross[q, 0], cross[q, 1], cross[q, 2] = gx, gy, gz
                cross[q, 3], cross[q, 4], cross[q, 5] = mx, my, mz
            else:
                motion[j, 6] -= gx
                motion[j, 7] -= gy
                motion[j, 8] -= gz
                motion[j, 9] += mx
                motion[j, 10] += my
                motion[j, 11] += mz

        first, end = wall_start[i], wall_start[i + 1]
        if attraction is not None:
            for k in range(first, end):
                if attraction.wall[k, AMPLITUDE] != 0.0:
                    distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], x, y, z)
                    if owned:
                        pull = pull_at(
                            attraction,
                            2.0 * (distance - ri) / ri,
                            attraction.wall[k, COLUMN],
                            attraction.wall[k, AMPLITUDE],
                            0.0,
                        )
                        drawn_x, drawn_y, drawn_z = drawn_x + pull * nx, drawn_y + pull * ny, drawn_z + pull * nz
        if end > first:
            kind_row = 0
            if equal is None:
                if species.shape[0] > 0:
                    kind_row = species[i]
            count = touching_walls(
                first, end, x, y, z, ri, linear, walton_braun, resisting, ledger, law, wall_row, kind_row,
                columns, wall, triangle, wall_body, body_turn, wall_other, wall_touching, wall_history, found, lost,
            )  # fmt: skip
            for a in range(count):
                k, distance = int(found[a, 0]), found[a, 1]
                nx, ny, nz = found[a, 2], found[a, 3], found[a, 4]
                w = wall_other[k]
                body = wall_body[w]
                kind = wall_row[kind_row, w]
                px, py = x + distance * nx, y + distance * ny
                omega = body_speed[body]
                spin_n = 0.5 * (wx * nx + wy * ny + (wz + omega) * nz)
                delta = ri - distance
                gx, gy, gz, f_rep, dashpot, pull, k_t, e, lost_1, lost_2, lost_3, k_last = contact_force(
                    linear, hertz_mindlin, hertz, thesis, walton_braun, law, kind, equal, cohesive, ledger, None,
                    mi, ri, dt, inv_dt, delta, nx, ny, nz,
                    vx + distance * (wy * nz - wz * ny) + omega * py,
                    vy + distance * (wz * nx - wx * nz) - omega * px,
                    vz + distance * (wx * ny - wy * nx),
                    0.0, 0.0, 0.0, spin_n, wall_history, k, books,
                )  # fmt: skip
                contacts += 1
                if equal is not None:
                    deepest_at = i if delta > deepest else deepest_at
                    deepest = max(deepest, delta)
                elif delta > deepest * 2.0 * ri:
                    deepest, deepest_at = delta / (2.0 * ri), i
                if ledger is not None:
                    elastic += e
                    lost_n += lost_1
                    lost_t += lost_2
                    lost_s += lost_3
                fx, fy, fz = fx + gx, fy + gy, fz + gz
                tx += distance * (ny * gz - nz * gy)
                ty += distance * (nz * gx - nx * gz)
                tz += distance * (nx * gy - ny * gx)
                row = body_chunks[chunk, body]
                if resisting is not None:
                    inertia = 0.4 * mi * ri * ri
                    damping = law[kind, DAMPING_ROLLING]
                    if columns[0] >= 0:
                        hx, hy, hz, e, lost_1 = rolling_couple(
                            law, kind, ledger, None, ri, inertia, k_t, k_last, damping, dt, f_rep, nx, ny, nz,
                            wx, wy, wz - omega, 0.0, 0.0, 0.0, spin_n, wall_history, k, columns[0], books,
                        )  # fmt: skip
                        elastic += e
                        lost_r += lost_1
                        tx, ty, tz = tx + hx, ty + hy, tz + hz
                        row[column.TORQUE_T] -= hz
                    if columns[1] >= 0:
                        couple, e, lost_1 = twisting_couple(
                            law, kind, ledger, ri, inertia, k_t, k_last, damping, dt, f_rep,
                            wx * nx + wy * ny + (wz - omega) * nz, wall_history, k, columns[1], books,
                        )  # fmt: skip
                        elastic += e
                        lost_w += lost_1
                        tx, ty, tz = tx + couple * nx, ty + couple * ny, tz + couple * nz
                        row[column.TORQUE_T] -= couple * nz
                # on the body: the grain presses along n; what is left of the force is tangential
                lever = px * ny - py * nx
                spring = f_rep - dashpot - pull
                both = f_rep - pull
                row[column.TORQUE_N] += spring * lever
                row[column.TORQUE_D] += dashpot * lever
                row[column.TORQUE_T] -= px * gy - py * gx + both * lever
                row[column.FORCE_N] += spring * nx
                row[column.FORCE_N + 1] += spring * ny
                row[column.FORCE_N + 2] += spring * nz
                row[column.FORCE_D] += dashpot * nx
                row[column.FORCE_D + 1] += dashpot * ny
                row[column.FORCE_D + 2] += dashpot * nz
                row[column.FORCE_T] -= gx + both * nx
                row[column.FORCE_T + 1] -= gy + both * ny
                row[column.FORCE_T + 2] -= gz + both * nz
                if wall_record.shape[0] > 0:
                    wall_record[k, 0], wall_record[k, 1], wall_record[k, 2], wall_record[k, 3] = gx, gy, gz, delta
                    wall_record[k, 4], wall_record[k, 5], wall_record[k, 6] = nx, ny, nz
        fx, fy, fz = fx + motion[i, 6], fy + motion[i, 7], fz + motion[i, 8]
        tx, ty, tz = tx + motion[i, 9], ty + motion[i, 10], tz + motion[i, 11]
        if attraction is not None:
            drawn_x += attraction.drawn[i, 0]
            drawn_y += attraction.drawn[i, 1]
            drawn_z += attraction.drawn[i, 2]
        if late[i] != 0:
            motion[i, 6], motion[i, 7], motion[i, 8] = fx, fy, fz
            motion[i, 9], motion[i, 10], motion[i, 11] = tx, ty, tz
            if attraction is not None:
                attraction.drawn[i, 0], attraction.drawn[i, 1], attraction.drawn[i, 2] = drawn_x, drawn_y, drawn_z
            continue
        d2, speed2 = drift(
            i,
            dt,
            ledger,
            gravity,
            step,
            external,
            attraction,
            where,
            motion,
            mi,
            reference,
            net,
            last,
            fx,
            fy,
            fz,
            tx,
            ty,
            tz,
            drawn_x,
            drawn_y,
            drawn_z,
            totals,
        )
        if not d2 <= travel:
            travel = d2 if d2 == d2 else np.inf
        fastest = max(fastest, speed2)
    if equal is not None:
        deepest /= 2.0 * where[0, 3]
    lost_n, lost_s, lost_r, lost_w = lost_n + lost[0], lost_s + lost[1], lost_r + lost[2], lost_w + lost[3]
    totals[column.CONTACTS], totals[column.ELASTIC], totals[column.NORMAL_DAMPING] = contacts, elastic, lost_n
    totals[column.TANGENTIAL_DAMPING], totals[column.SLIDING] = lost_t, lost_s
    totals[column.ROLLING], totals[column.TWISTING] = lost_r, lost_w
    totals[column.MAX_OVERLAP], totals[column.GRAIN] = deepest, deepest_at
    totals[column.MAX_TRAVEL], totals[column.MAX_SPEED] = travel, fastest


@inner(error_model="numpy", fastmath={"contract"})
def finish_rows(
    chunk, dt, step, last, equal, ledger, gravity, external, attraction, where, motion, mass, reference, net,
    late_start, late_grain, in_start, in_slot, cross, sums,
):  # fmt: skip
    """The late grains of a chunk: reactions from earlier chunks, then kick and drift."""
    totals = sums[chunk]
    travel, fastest = totals[column.MAX_TRAVEL], totals[column.MAX_SPEED]
    m = mass[0]
    for a in range(late_start[chunk], late_start[chunk + 1]):
        i = np.int64(late_grain[a])
        if equal is None:
            m = mass[i]
        fx, fy, fz = motion[i, 6], motion[i, 7], motion[i, 8]
        tx, ty, tz = motion[i, 9], motion[i, 10], motion[i, 11]
        for p in range(in_start[a], in_start[a + 1]):
            q = in_slot[p]
            fx, fy, fz = fx - cross[q, 0], fy - cross[q, 1], fz - cross[q, 2]
            tx, ty, tz = tx + cross[q, 3], ty + cross[q, 4], tz + cross[q, 5]
        drawn_x = drawn_y = drawn_z = 0.0
        if attraction is not None:
            drawn_x, drawn_y, drawn_z = attraction.drawn[i, 0], attraction.drawn[i, 1], attraction.drawn[i, 2]
            for p in range(in_start[a], in_start[a + 1]):
                q = in_slot[p]
                drawn_x -= attraction.cross[q, 0]
                drawn_y -= attraction.cross[q, 1]
                drawn_z -= attraction.cross[q, 2]
        d2, speed2 = drift(
            i,
            dt,
            ledger,
            gravity,
            step,
            external,
            attraction,
            where,
            motion,
            m,
            reference,
            net,
            last,
            fx,
            fy,
            fz,
            tx,
            ty,
            tz,
            drawn_x,
            drawn_y,
            drawn_z,
            totals,
        )
        if not d2 <= travel:
            travel = d2 if d2 == d2 else np.inf
        fastest = max(fastest, speed2)
    totals[column.MAX_TRAVEL], totals[column.MAX_SPEED] = travel, fastest
