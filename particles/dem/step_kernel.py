"""The compiled step of the grains: contact forces, kick, drift, shafts; K steps a call.

Leapfrog, kick-drift, with velocities half a step behind positions:

    F = F(x(t), v(t - dt/2));   v(t + dt/2) = v(t - dt/2) + F dt/m;   x(t + dt) = x(t) + v(t + dt/2) dt,

and the same for spins (2/5 m R^2). A step has two parallel stages, each over chunks of rows whose number
follows from the number of grains alone:

1. `_contact_rows`: row i of the half list sums its forces in registers and leaves the reaction on j in
   a buffer with a place for every pair; its walls follow.
2. `_gather_and_move`: every grain gathers the reactions on it through the transposed list, in a
   fixed order, and is integrated. Sums over grains are kept by chunk and added in the order of the chunks.

So nothing depends on the number of threads, bit for bit. Lever arms sum to the distance of centres, and the
two torques are l_i n x F and l_j n x F: angular momentum is conserved to round-off.

Parts that a scene has not (``turn``, ``gravity``, ``external``, ``rolling``) are passed as None: numba prunes their
branches, the compiled code does not contain them.

Everything compiled that shares `_wall_gap` or `_contact` stands in this file: numba's cache of a kernel
does not notice when a function of another file changes.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

# what the kernel answers
DONE, REBUILD, NOT_FINITE, OVERLAP = 0, 1, 2, 3
# columns of a chunk's sums; GRAIN is the row at which the largest overlap was met
CONTACTS, ELASTIC, NORMAL_DAMPING, TANGENTIAL_DAMPING, SLIDING, ROLLING, MAX_OVERLAP, GRAIN = range(8)
CONTACT_WORK, GRAVITY_WORK, EXTERNAL_WORK, MAX_TRAVEL, MAX_SPEED = range(8, 13)
N_SUMS = 13
# columns of a body's sums; the first five are kept by chunk
TORQUE_N, TORQUE_T, FORCE_X, FORCE_Y, FORCE_Z, BODY_WORK, DRIVE_WORK, LOAD_WORK = range(8)
N_BODY_SUMS = 8
# columns of the wall table (`particles.walls.wall_table`)
KIND, R0, Z0, R1, Z1, UR, UZ, OWN0, NR0, NZ0, OWN1, NR1, NZ1 = range(13)
N_WALL = 13


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _wall_gap(wall, w, x, y, z):
    """Distance of the centre to a wall, unit vector towards it (3), and whether this wall owns the point."""
    if wall[w, KIND] == 1.0:  # plane: point in columns 1-3, normal in 4-6
        s = (x - wall[w, 1]) * wall[w, 4] + (y - wall[w, 2]) * wall[w, 5] + (z - wall[w, 3]) * wall[w, 6]
        return s, -wall[w, 4], -wall[w, 5], -wall[w, 6], True
    r = np.sqrt(x * x + y * y)
    owned = True
    a, b = r - wall[w, R0], z - wall[w, Z0]
    if a * wall[w, UR] + b * wall[w, UZ] <= 0.0:  # the start is the closest point
        owned = wall[w, OWN0] != 0.0 and a * wall[w, NR0] + b * wall[w, NZ0] <= 0.0
    else:
        c, d = r - wall[w, R1], z - wall[w, Z1]
        if c * wall[w, UR] + d * wall[w, UZ] >= 0.0:  # the end is
            owned = wall[w, OWN1] != 0.0 and c * wall[w, NR1] + d * wall[w, NZ1] <= 0.0
            a, b = c, d
        else:
            p = b * wall[w, UR] - a * wall[w, UZ]
            a, b = -p * wall[w, UZ], p * wall[w, UR]
    distance = np.sqrt(a * a + b * b)
    inverse = 1.0 / distance if distance > 0.0 else 0.0
    nr, nz = -a * inverse, -b * inverse
    if r > 0.0:
        return distance, nr * x / r, nr * y / r, nz, owned
    return distance, nr, 0.0, nz, owned  # on the axis every half-plane is as good


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _turned(history, slot, first, nx, ny, nz, phi):
    """The spring in columns ``first`` .. first + 2 of ``history[slot]``, turned with its pair.

    Into the new tangent plane, about n by the mean spin ``phi`` of this step, at unchanged length.
    """
    x, y, z = history[slot, first], history[slot, first + 1], history[slot, first + 2]
    before = x * x + y * y + z * z
    if before > 0.0:
        along = x * nx + y * ny + z * nz
        x, y, z = x - along * nx, y - along * ny, z - along * nz
        cx, cy, cz = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
        x, y, z = x + phi * cx, y + phi * cy, z + phi * cz
        after = x * x + y * y + z * z
        scale = np.sqrt(before / after) if after > 0.0 else 0.0
        x, y, z = x * scale, y * scale, z * scale
    return x, y, z


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _contact(law, kind, m_eff, dt, delta, nx, ny, nz, ux, uy, uz, spin_n, history, slot):
    """Force on grain i; n points from i to its partner, u is the velocity of i relative to it at the contact.

    ``history[slot]`` is the spring xi [m] and is updated; ``law[kind]`` the parameters. Returns the force
    (3), the elastic energy [J], and the energy lost in this step [J] to normal damping, tangential damping
    and sliding.
    """
    k_n, k_t, mu = law[kind, 0], law[kind, 1], law[kind, 4]
    unit = 2.0 * np.sqrt(k_n * m_eff)
    closing = ux * nx + uy * ny + uz * nz
    f_n = k_n * delta + law[kind, 2] * unit * closing
    if f_n < 0.0:  # an impact never pulls
        f_n = 0.0
    lost_n = (f_n - k_n * delta) * closing * dt

    xi_x, xi_y, xi_z = _turned(history, slot, 0, nx, ny, nz, spin_n * dt)

    # trial: the whole sliding distance stretches spring and dashpot
    sx, sy, sz = (ux - closing * nx) * dt, (uy - closing * ny) * dt, (uz - closing * nz) * dt
    rate = law[kind, 3] * unit / dt
    tx, ty, tz = (
        k_t * xi_x + (k_t + rate) * sx,
        k_t * xi_y + (k_t + rate) * sy,
        k_t * xi_z + (k_t + rate) * sz,
    )
    trial = np.sqrt(tx * tx + ty * ty + tz * tz)
    limit = mu * f_n
    lost_s = 0.0
    if trial > limit:
        share = limit / trial
        slip = (1.0 - share) / (k_t + rate)  # trial > 0 needs k_t + rate > 0
        sx, sy, sz = sx - slip * tx, sy - slip * ty, sz - slip * tz
        tx, ty, tz = tx * share, ty * share, tz * share
        lost_s = limit * slip * trial
    xi_x, xi_y, xi_z = xi_x + sx, xi_y + sy, xi_z + sz
    history[slot, 0], history[slot, 1], history[slot, 2] = xi_x, xi_y, xi_z
    lost_t = rate * (sx * sx + sy * sy + sz * sz)
    elastic = 0.5 * k_n * delta * delta + 0.5 * k_t * (xi_x * xi_x + xi_y * xi_y + xi_z * xi_z)
    return -f_n * nx - tx, -f_n * ny - ty, -f_n * nz - tz, f_n, elastic, lost_n, lost_t, lost_s


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _rolling_torque(friction, arm, inertia, law, kind, dt, f_n, nx, ny, nz, px, py, pz, spin_n, history, slot):
    """Rolling resistance on grain i (`particles.laws.rolling_friction`); p is its spin relative to the partner's.

    ``history[slot, 3:]`` is the rolling angle theta [rad] and is updated. Returns the torque (3), the elastic
    energy [J] and the energy lost in this step [J].
    """
    k = law[kind, 1] * arm * arm
    rate = 2.0 * law[kind, 2] * np.sqrt(k * inertia) / dt
    x, y, z = _turned(history, slot, 3, nx, ny, nz, spin_n * dt)
    along = px * nx + py * ny + pz * nz
    sx, sy, sz = (px - along * nx) * dt, (py - along * ny) * dt, (pz - along * nz) * dt
    tx, ty, tz = k * x + (k + rate) * sx, k * y + (k + rate) * sy, k * z + (k + rate) * sz
    trial = np.sqrt(tx * tx + ty * ty + tz * tz)
    limit = friction * arm * f_n
    lost = 0.0
    if trial > limit:
        share = limit / trial
        slip = (1.0 - share) / (k + rate)
        sx, sy, sz = sx - slip * tx, sy - slip * ty, sz - slip * tz
        tx, ty, tz = tx * share, ty * share, tz * share
        lost = limit * slip * trial
    x, y, z = x + sx, y + sy, z + sz
    history[slot, 3], history[slot, 4], history[slot, 5] = x, y, z
    lost += rate * (sx * sx + sy * sy + sz * sz)
    return -tx, -ty, -tz, 0.5 * k * (x * x + y * y + z * z), lost


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _contact_rows(
    lo, hi, dt, law, rolling, turn, position, velocity, spin, radius, mass,
    pair_start, pair_other, pair_shift, pair_touching, pair_history, reaction,
    wall, wall_body, body_speed, wall_start, wall_other, wall_touching, wall_history, wall_force,
    net, chunk, chunk_sums, body_chunks,
):  # fmt: skip
    """Stage 1 for rows lo <= i < hi: own forces and torques go into ``net`` (n, 6)."""
    for b in range(body_chunks.shape[1]):
        for column in range(5):
            body_chunks[chunk, b, column] = 0.0
    contacts, elastic, lost_n, lost_t, lost_s, deepest, deepest_at = 0, 0.0, 0.0, 0.0, 0.0, 0.0, -1
    lost_r = 0.0
    for i in range(lo, hi):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
        ri, mi = radius[i], mass[i]
        fx = fy = fz = tx = ty = tz = 0.0
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            jx, jy, jz = position[j, 0], position[j, 1], position[j, 2]
            if turn is not None:
                if pair_shift[k] != 0:
                    jx, jy = turn[0] * jx - turn[1] * jy, turn[1] * jx + turn[0] * jy
            dx, dy, dz = jx - x, jy - y, jz - z
            d2 = dx * dx + dy * dy + dz * dz
            reach = ri + radius[j]
            if d2 >= reach * reach:
                if pair_touching[k] != 0:
                    pair_touching[k] = 0
                    pair_history[k, :] = 0.0
                continue
            pair_touching[k] = 1
            d = np.sqrt(d2)
            inverse = 1.0 / d if d > 0.0 else 0.0
            nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
            ux, uy, uz = velocity[j, 0], velocity[j, 1], velocity[j, 2]
            qx, qy, qz = spin[j, 0], spin[j, 1], spin[j, 2]
            if turn is not None:
                if pair_shift[k] != 0:
                    ux, uy = turn[0] * ux - turn[1] * uy, turn[1] * ux + turn[0] * uy
                    qx, qy = turn[0] * qx - turn[1] * qy, turn[1] * qx + turn[0] * qy
            li = d * ri / reach
            lj = d - li
            ax, ay, az = li * wx + lj * qx, li * wy + lj * qy, li * wz + lj * qz
            gx, gy, gz, f_n, e, a, b, c = _contact(
                law, 0, mi * mass[j] / (mi + mass[j]), dt, reach - d, nx, ny, nz,
                vx - ux + ay * nz - az * ny, vy - uy + az * nx - ax * nz, vz - uz + ax * ny - ay * nx,
                0.5 * ((wx + qx) * nx + (wy + qy) * ny + (wz + qz) * nz), pair_history, k,
            )  # fmt: skip
            contacts += 1
            elastic += e
            lost_n += a
            lost_t += b
            lost_s += c
            overlap = (reach - d) / (2.0 * min(ri, radius[j]))
            if overlap > deepest:
                deepest, deepest_at = overlap, i
            mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            tx, ty, tz = tx + li * mx, ty + li * my, tz + li * mz
            mx, my, mz = lj * mx, lj * my, lj * mz
            if rolling is not None:
                own, others = mi * ri * ri, mass[j] * radius[j] * radius[j]
                hx, hy, hz, e, a = _rolling_torque(
                    rolling[0], ri * radius[j] / reach, 0.4 * own * others / (own + others),
                    law, 0, dt, f_n, nx, ny, nz, wx - qx, wy - qy, wz - qz,
                    0.5 * ((wx + qx) * nx + (wy + qy) * ny + (wz + qz) * nz),
                    pair_history, k,
                )  # fmt: skip
                elastic += e
                lost_r += a
                tx, ty, tz = tx + hx, ty + hy, tz + hz
                mx, my, mz = mx - hx, my - hy, mz - hz
            if turn is not None:
                if pair_shift[k] != 0:  # the reaction goes back through the face
                    gx, gy = turn[0] * gx + turn[1] * gy, turn[0] * gy - turn[1] * gx
                    mx, my = turn[0] * mx + turn[1] * my, turn[0] * my - turn[1] * mx
            reaction[k, 0], reaction[k, 1], reaction[k, 2] = -gx, -gy, -gz
            reaction[k, 3], reaction[k, 4], reaction[k, 5] = mx, my, mz

        first, last = wall_start[i], wall_start[i + 1]
        # a grain that rolls from one face of a body onto the next keeps its spring: it is handed to the new
        # slot
        left = -1
        from_slot = -1
        for k in range(first, last):
            if wall_touching[k] != 0:
                distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], x, y, z)
                if distance >= ri or not owned:
                    left = wall_body[wall_other[k]]
                    from_slot = k
                    wall_touching[k] = 0
                    wall_force[k, 0] = wall_force[k, 1] = wall_force[k, 2] = 0.0
        for k in range(first, last):
            distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], x, y, z)
            if distance >= ri or not owned:
                continue
            body = wall_body[wall_other[k]]
            if wall_touching[k] == 0:
                wall_touching[k] = 1
                wall_history[k, :] = 0.0
                if left == body:
                    wall_history[k, :] = wall_history[from_slot, :]
                    left = -1
            px, py = x + distance * nx, y + distance * ny
            omega = body_speed[body]
            gx, gy, gz, f_n, e, a, b, c = _contact(
                law, 1, mi, dt, ri - distance, nx, ny, nz,
                vx + distance * (wy * nz - wz * ny) + omega * py,
                vy + distance * (wz * nx - wx * nz) - omega * px,
                vz + distance * (wx * ny - wy * nx),
                0.5 * (wx * nx + wy * ny + (wz + omega) * nz), wall_history, k,
            )  # fmt: skip
            contacts += 1
            elastic += e
            lost_n += a
            lost_t += b
            lost_s += c
            overlap = (ri - distance) / (2.0 * ri)
            if overlap > deepest:
                deepest, deepest_at = overlap, i
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            tx += distance * (ny * gz - nz * gy)
            ty += distance * (nz * gx - nx * gz)
            tz += distance * (nx * gy - ny * gx)
            if rolling is not None:
                rx, ry, rz, e, a = _rolling_torque(
                    rolling[1], ri, 0.4 * mi * ri * ri, law, 1, dt, f_n, nx, ny, nz, wx, wy, wz - omega,
                    0.5 * (wx * nx + wy * ny + (wz + omega) * nz), wall_history, k,
                )  # fmt: skip
                elastic += e
                lost_r += a
                tx, ty, tz = tx + rx, ty + ry, tz + rz
                body_chunks[chunk, body, TORQUE_T] -= rz
            normal = f_n * (px * ny - py * nx)
            body_chunks[chunk, body, TORQUE_N] += normal
            body_chunks[chunk, body, TORQUE_T] -= px * gy - py * gx + normal
            body_chunks[chunk, body, FORCE_X] -= gx
            body_chunks[chunk, body, FORCE_Y] -= gy
            body_chunks[chunk, body, FORCE_Z] -= gz
            wall_force[k, 0], wall_force[k, 1], wall_force[k, 2] = gx, gy, gz
        net[i, 0], net[i, 1], net[i, 2] = fx, fy, fz
        net[i, 3], net[i, 4], net[i, 5] = tx, ty, tz
    sums = chunk_sums[chunk]
    sums[CONTACTS], sums[ELASTIC], sums[NORMAL_DAMPING] = contacts, elastic, lost_n
    sums[TANGENTIAL_DAMPING], sums[SLIDING], sums[ROLLING], sums[MAX_OVERLAP], sums[GRAIN] = (
        lost_t,
        lost_s,
        lost_r,
        deepest,
        deepest_at,
    )


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _gather_and_move(
    lo, hi, dt, gravity, external, position, velocity, spin, radius, mass,
    in_start, in_slot, pair_touching, reaction, net, reference, chunk, chunk_sums,
):  # fmt: skip
    """Stage 2 for grains lo <= i < hi: ``net`` becomes the whole contact force and torque; kick and drift."""
    contact_work = gravity_work = external_work = travel = fastest = 0.0
    for i in range(lo, hi):
        fx, fy, fz, tx, ty, tz = net[i, 0], net[i, 1], net[i, 2], net[i, 3], net[i, 4], net[i, 5]
        for q in range(in_start[i], in_start[i + 1]):
            k = in_slot[q]
            if pair_touching[k] != 0:
                fx, fy, fz = fx + reaction[k, 0], fy + reaction[k, 1], fz + reaction[k, 2]
                tx, ty, tz = tx + reaction[k, 3], ty + reaction[k, 4], tz + reaction[k, 5]
        net[i, 0], net[i, 1], net[i, 2] = fx, fy, fz
        net[i, 3], net[i, 4], net[i, 5] = tx, ty, tz
        m = mass[i]
        kick = dt / m
        turn = kick / (0.4 * radius[i] * radius[i])
        # contact alone is kept for the work; the other forces are added after it
        ax, ay, az = fx, fy, fz
        if gravity is not None:
            ax, ay, az = ax + m * gravity[0], ay + m * gravity[1], az + m * gravity[2]
        if external is not None:
            ax, ay, az = ax + external[i, 0], ay + external[i, 1], az + external[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
        bx, by, bz = vx + kick * ax, vy + kick * ay, vz + kick * az
        ox, oy, oz = wx + turn * tx, wy + turn * ty, wz + turn * tz
        velocity[i, 0], velocity[i, 1], velocity[i, 2] = bx, by, bz
        spin[i, 0], spin[i, 1], spin[i, 2] = ox, oy, oz
        # the mean of old and new velocity closes the balance of kinetic energy exactly
        half = 0.5 * dt
        vx, vy, vz = vx + bx, vy + by, vz + bz
        contact_work += half * (fx * vx + fy * vy + fz * vz + tx * (wx + ox) + ty * (wy + oy) + tz * (wz + oz))
        if gravity is not None:
            gravity_work += half * m * (gravity[0] * vx + gravity[1] * vy + gravity[2] * vz)
        if external is not None:
            external_work += half * (external[i, 0] * vx + external[i, 1] * vy + external[i, 2] * vz)
        px, py, pz = position[i, 0] + dt * bx, position[i, 1] + dt * by, position[i, 2] + dt * bz
        position[i, 0], position[i, 1], position[i, 2] = px, py, pz
        dx, dy, dz = px - reference[i, 0], py - reference[i, 1], pz - reference[i, 2]
        d2 = dx * dx + dy * dy + dz * dz + 0.0 * (ox + oy + oz)  # a spin that is not finite shows here too
        if not d2 <= travel:
            travel = d2 if d2 == d2 else np.inf
        fastest = max(fastest, bx * bx + by * by + bz * bz)
    sums = chunk_sums[chunk]
    sums[CONTACT_WORK], sums[GRAVITY_WORK], sums[EXTERNAL_WORK] = contact_work, gravity_work, external_work
    sums[MAX_TRAVEL], sums[MAX_SPEED] = travel, fastest


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _turn_bodies(dt, n_sectors, speeds, step, body_data, body_angle, body_speed, body_chunks, body_totals):
    """Add the chunks in their order, turn the shafts; ``body_data``: free, inertia, drive, load."""
    for b in range(body_speed.shape[0]):
        torque = 0.0
        for column in range(5):
            total = 0.0
            for c in range(body_chunks.shape[0]):
                total += body_chunks[c, b, column]
            body_totals[b, column] += total
            if column <= TORQUE_T:
                torque += total
        mean = body_speed[b]
        if body_data[b, 0] != 0.0:
            old = body_speed[b]
            per = dt / body_data[b, 1]
            new = old + per * (n_sectors * torque + body_data[b, 2])
            held = per * body_data[b, 3]
            # dry friction: shrink the speed, never reverse it
            brake = min(max(new, -held), held)
            new -= brake
            mean = 0.5 * (old + new)
            body_totals[b, DRIVE_WORK] += body_data[b, 2] * mean * dt
            body_totals[b, LOAD_WORK] += brake / per * mean * dt
            body_speed[b] = new
        body_totals[b, BODY_WORK] -= torque * mean * dt
        body_angle[b] += body_speed[b] * dt


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _verdict(chunk_sums, totals, travel_limit, overlap_limit):
    """Add the chunks in their order: energies accumulate, extremes are kept, contacts are the last."""
    contacts = elastic = travel = fastest = 0.0
    for c in range(chunk_sums.shape[0]):
        row = chunk_sums[c]
        contacts += row[CONTACTS]
        elastic += row[ELASTIC]
        for column in range(NORMAL_DAMPING, MAX_OVERLAP):
            totals[column] += row[column]
        for column in range(CONTACT_WORK, MAX_TRAVEL):
            totals[column] += row[column]
        if row[MAX_OVERLAP] > totals[MAX_OVERLAP]:
            totals[MAX_OVERLAP], totals[GRAIN] = row[MAX_OVERLAP], row[GRAIN]
        travel, fastest = max(travel, row[MAX_TRAVEL]), max(fastest, row[MAX_SPEED])
    totals[CONTACTS], totals[ELASTIC] = contacts, elastic
    totals[MAX_TRAVEL], totals[MAX_SPEED] = travel, max(totals[MAX_SPEED], fastest)
    if not travel < np.inf:
        return NOT_FINITE
    if totals[MAX_OVERLAP] > overlap_limit:
        return OVERLAP
    return REBUILD if travel > travel_limit else DONE


@njit(parallel=True, cache=True, error_model="numpy", fastmath={"contract"})
def run_steps(
    n_steps, dt, n_sectors, law, rolling, turn, gravity, external, travel_limit, overlap_limit, chunk,
    position, velocity, spin, radius, mass, reference,
    pair_start, pair_other, pair_shift, pair_touching, pair_history, reaction, in_start, in_slot,
    wall, wall_body, wall_start, wall_other, wall_touching, wall_history, wall_force,
    speeds, body_data, body_angle, body_speed, net, chunk_sums, body_chunks, totals, body_totals,
):  # fmt: skip
    """Up to ``n_steps`` steps; stops early when a list must be rebuilt or a grain is in trouble.

    Returns (answer, steps done); every array is documented where it is made, in `particles.dem.dem`.
    """
    n_chunks = chunk.shape[0] - 1
    for step in range(n_steps):
        for b in range(body_speed.shape[0]):
            if body_data[b, 0] == 0.0:
                body_speed[b] = speeds[step, b]
        for c in prange(n_chunks):
            _contact_rows(
                chunk[c], chunk[c + 1], dt, law, rolling, turn, position, velocity, spin, radius, mass,
                pair_start, pair_other, pair_shift, pair_touching, pair_history, reaction,
                wall, wall_body, body_speed, wall_start, wall_other, wall_touching, wall_history, wall_force,
                net, c, chunk_sums, body_chunks,
            )  # fmt: skip
        for c in prange(n_chunks):
            _gather_and_move(
                chunk[c], chunk[c + 1], dt, gravity, external, position, velocity, spin, radius, mass,
                in_start, in_slot, pair_touching, reaction, net, reference, c, chunk_sums,
            )  # fmt: skip
        _turn_bodies(dt, n_sectors, speeds, step, body_data, body_angle, body_speed, body_chunks, body_totals)
        answer = _verdict(chunk_sums, totals, travel_limit, overlap_limit)
        if answer != DONE:
            return answer, step + 1
    return DONE, n_steps


@njit(cache=True, error_model="numpy")
def near_walls(position, reach, wall, start, other):
    """Fill the rows of walls within ``reach`` (n,) of each centre; returns their number, whatever fits."""
    found = 0
    for i in range(position.shape[0]):
        start[i] = found
        for w in range(wall.shape[0]):
            distance, _, _, _, _ = _wall_gap(wall, w, position[i, 0], position[i, 1], position[i, 2])
            if distance < reach[i]:
                if found < other.shape[0]:
                    other[found] = w
                found += 1
    start[position.shape[0]] = found
    return found


@njit(cache=True, error_model="numpy")
def wall_overlaps(position, radius, wall, row, other):
    """Overlap [m] and unit vector towards the wall of each slot, shape (s, 4); not owned: -inf."""
    result = np.empty((row.shape[0], 4))
    for k in range(row.shape[0]):
        i = row[k]
        distance, nx, ny, nz, owned = _wall_gap(wall, other[k], position[i, 0], position[i, 1], position[i, 2])
        result[k, 0] = radius[i] - distance if owned else -np.inf
        result[k, 1], result[k, 2], result[k, 3] = nx, ny, nz
    return result


@njit(cache=True, error_model="numpy")
def push_off_walls(position, radius, wall):
    """Move each centre out of the walls that it overlaps; returns the largest overlap met [m]."""
    worst = 0.0
    for i in range(position.shape[0]):
        for w in range(wall.shape[0]):
            distance, nx, ny, nz, owned = _wall_gap(wall, w, position[i, 0], position[i, 1], position[i, 2])
            depth = radius[i] - distance
            if depth > 0.0 and owned:
                worst = max(worst, depth)
                position[i, 0] -= depth * nx
                position[i, 1] -= depth * ny
                position[i, 2] -= depth * nz
    return worst
