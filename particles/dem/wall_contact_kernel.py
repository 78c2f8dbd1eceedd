"""Compiled contacts of a grain with the walls near it: which it touches, its forces, the load of the bodies."""

from __future__ import annotations

from geometry.inner_functions import inner
from particles.dem import total_columns as column
from particles.dem.attraction_kernel import AMPLITUDE, COLUMN, place_of_gap, pull_at
from particles.dem.contact_kernel import Touch, contact_force, left_in_springs, rolling_torque, twisting_torque
from particles.dem.kernel_state import Tally
from particles.dem.pair_kernel import mass_of
from particles.walls.triangle_kernels import LEADER, SLOT, triangle_contacts
from particles.walls.wall_kernels import _wall_gap


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def add_left(law, kind, resistance, energy_column, radius, slots, slot, left):
    """Add to ``left`` (4) [J] what the springs of a wall's slot held when the grain left it."""
    a, b, c, d = left_in_springs(law, kind, resistance, energy_column, radius, 0.0, slots.history, slot)
    return left[0] + a, left[1] + b, left[2] + c, left[3] + d


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def touching_walls(i, kind_row, law, resistance, energy_column, grains, slots, walls, found, left):
    """What grain i touches among its wall slots: rows (slot, distance, unit vector towards the wall) of ``found``.

    A grain that rolls from one face of a body onto the next keeps its springs: they are handed to the new slot.
    Returns the number of rows, and ``left`` (4) [J] with what those that parted have lost.
    """
    position_radius, other, touching, history = grains.position_radius, slots.other, slots.touching, slots.history
    wall, body_of, law_row = walls.smooth, walls.body, walls.law_row
    x, y, z, radius = position_radius[i, 0], position_radius[i, 1], position_radius[i, 2], position_radius[i, 3]
    first, end = slots.start[i], slots.start[i + 1]
    n_walls = wall.shape[0]
    if end == first + 1 and other[first] < n_walls:  # most grains that have a wall have one
        distance, nx, ny, nz, owned = _wall_gap(wall, other[first], x, y, z)
        if distance < radius and owned:
            touching[first] = 1
            found[0, 0], found[0, 1], found[0, 2], found[0, 3], found[0, 4] = first, distance, nx, ny, nz
            return 1, left
        if touching[first] != 0:
            touching[first] = 0
            if energy_column is not None:
                row = law_row[kind_row, other[first]]
                left = add_left(law, row, resistance, energy_column, radius, slots, first, left)
            for a in range(history.shape[1]):
                history[first, a] = 0.0
        return 0, left
    count = 0
    k = first
    while k < end:
        w = other[k]
        k += 1
        if w < n_walls:
            distance, nx, ny, nz, owned = _wall_gap(wall, w, x, y, z)
            if distance < radius and owned:
                found[count, 0], found[count, 1] = k - 1, distance
                found[count, 2], found[count, 3], found[count, 4] = nx, ny, nz
                count += 1
        else:  # all triangles of one body at once, in the frame that turns with it
            body = body_of[w]
            begin = k - 1
            while k < end and body_of[other[k]] == body:
                k += 1
            c, s = walls.turn[body, 0], walls.turn[body, 1]
            part = found[count:]
            more, seen = triangle_contacts(
                walls.triangle, other, begin, k, c * x + s * y, c * y - s * x, z, radius, part
            )
            for a in range(more, seen):  # a grain that goes over an edge changes its triangle, not its contact
                old, new = int(part[a, SLOT]), int(part[int(part[a, LEADER]), SLOT])
                if touching[old] != 0:
                    touching[old] = 0
                    if touching[new] != 0 and energy_column is not None:  # two contacts have become one
                        row = law_row[kind_row, other[old]]
                        left = add_left(law, row, resistance, energy_column, radius, slots, old, left)
                    if touching[new] == 0:
                        touching[new] = 1
                        for b in range(history.shape[1]):
                            history[new, b] = history[old, b]
                    for b in range(history.shape[1]):
                        history[old, b] = 0.0
            for a in range(more):
                nx, ny = part[a, 2], part[a, 3]
                part[a, 2], part[a, 3] = c * nx - s * ny, s * nx + c * ny
            count += more
    for a in range(count):
        touching[int(found[a, 0])] += 2  # 2: new, 3: as before; what is 1 now has parted
    for k in range(first, end):
        if touching[k] == 1:
            touching[k] = 0
            handed = False
            for a in range(count):
                new = int(found[a, 0])
                if touching[new] == 2 and body_of[other[new]] == body_of[other[k]]:
                    for b in range(history.shape[1]):
                        history[new, b] = history[k, b]
                    touching[new] = 3
                    handed = True
                    break
            if energy_column is not None and not handed:
                row = law_row[kind_row, other[k]]
                left = add_left(law, row, resistance, energy_column, radius, slots, k, left)
            for b in range(history.shape[1]):
                history[k, b] = 0.0
    for a in range(count):
        touching[int(found[a, 0])] = 1
    return count, left


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_pull_of_walls(i, attraction, grains, slots, walls):
    """Add the pulls of the walls near grain i to those on it."""
    if attraction is None:
        return
    position_radius = grains.position_radius
    x, y, z, radius = position_radius[i, 0], position_radius[i, 1], position_radius[i, 2], position_radius[i, 3]
    px = py = pz = 0.0
    for k in range(slots.start[i], slots.start[i + 1]):
        if attraction.wall[k, AMPLITUDE] != 0.0:
            distance, nx, ny, nz, owned = _wall_gap(walls.smooth, slots.other[k], x, y, z)
            if owned:
                gap = 2.0 * (distance - radius) / radius
                place = place_of_gap(attraction, gap)
                pull = pull_at(attraction, gap, place, attraction.wall[k, COLUMN], attraction.wall[k, AMPLITUDE], 0.0)
                px, py, pz = px + pull * nx, py + pull * ny, pz + pull * nz
    drawn = attraction.drawn
    drawn[i, 0], drawn[i, 1], drawn[i, 2] = drawn[i, 0] + px, drawn[i, 1] + py, drawn[i, 2] + pz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_load(row, force, touch, at):
    """Book the force on a body, touched at ``at`` (2) [m], in its ``row`` of sums.

    The grain presses along n; what is left of the force is tangential.
    """
    nx, ny, nz = touch.normal
    px, py = at
    lever = px * ny - py * nx
    spring = force.repulsion - force.dashpot - force.pull
    both = force.repulsion - force.pull
    row[column.TORQUE_N] += spring * lever
    row[column.TORQUE_D] += force.dashpot * lever
    row[column.TORQUE_T] -= px * force.y - py * force.x + both * lever
    row[column.FORCE_N] += spring * nx
    row[column.FORCE_N + 1] += spring * ny
    row[column.FORCE_N + 2] += spring * nz
    row[column.FORCE_D] += force.dashpot * nx
    row[column.FORCE_D + 1] += force.dashpot * ny
    row[column.FORCE_D + 2] += force.dashpot * nz
    row[column.FORCE_T] -= force.x + both * nx
    row[column.FORCE_T + 1] -= force.y + both * ny
    row[column.FORCE_T + 2] -= force.z + both * nz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_wall_forces(i, chunk, dt, law, resistance, energy_column, grains, slots, walls, totals, tally):
    """Contacts of grain i with its walls, added to its force and torque.

    Returns the tally; the load of the bodies goes into the chunk's sums.
    """
    position_radius, velocity_force = grains.position_radius, grains.velocity_force
    found, record = slots.found[chunk], slots.record
    x, y, radius = position_radius[i, 0], position_radius[i, 1], position_radius[i, 3]
    vx, vy, vz = velocity_force[i, 0], velocity_force[i, 1], velocity_force[i, 2]
    wx, wy, wz = velocity_force[i, 3], velocity_force[i, 4], velocity_force[i, 5]
    mass = mass_of(law, grains.mass, i)
    fx = fy = fz = tx = ty = tz = 0.0
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at = tally
    kind_row = 0
    if grains.species.shape[0] > 0:
        kind_row = grains.species[i]
    count, left = touching_walls(i, kind_row, law, resistance, energy_column, grains, slots, walls, found, left)
    for a in range(count):
        k, distance = int(found[a, 0]), found[a, 1]
        nx, ny, nz = found[a, 2], found[a, 3], found[a, 4]
        w = slots.other[k]
        body = walls.body[w]
        kind = walls.law_row[kind_row, w]
        px, py = x + distance * nx, y + distance * ny
        omega = walls.speed[body]
        delta = radius - distance
        velocity = (
            vx + distance * (wy * nz - wz * ny) + omega * py,
            vy + distance * (wz * nx - wx * nz) - omega * px,
            vz + distance * (wx * ny - wy * nx),
        )
        touch = Touch(delta, (nx, ny, nz), velocity, None, 0.5 * (wx * nx + wy * ny + (wz + omega) * nz))
        force = contact_force(law, kind, energy_column, mass, radius, dt, touch, slots.history, k)
        gx, gy, gz = force.x, force.y, force.z
        contacts += 1
        if delta > deepest * 2.0 * radius:
            deepest, deepest_at = delta / (2.0 * radius), i
        if energy_column is not None:
            elastic += force.stored
            lost_n += force.lost_n
            lost_t += force.lost_t
            lost_s += force.lost_s
        fx, fy, fz = fx + gx, fy + gy, fz + gz
        tx += distance * (ny * gz - nz * gy)
        ty += distance * (nz * gx - nx * gz)
        tz += distance * (nx * gy - ny * gx)
        row = totals.chunk_bodies[chunk, body]
        if resistance is not None:
            inertia = 0.4 * mass * radius * radius
            if resistance.rolling >= 0:
                (hx, hy, hz), e, lost = rolling_torque(
                    law, kind, energy_column, radius, inertia, dt, force, touch, (wx, wy, wz - omega), slots.history, k,
                    resistance.rolling,
                )  # fmt: skip
                elastic += e
                lost_r += lost
                tx, ty, tz = tx + hx, ty + hy, tz + hz
                row[column.TORQUE_T] -= hz
            if resistance.twisting >= 0:
                spin = wx * nx + wy * ny + (wz - omega) * nz
                torque, e, lost = twisting_torque(
                    law, kind, energy_column, radius, inertia, dt, force, spin, slots.history, k, resistance.twisting
                )
                elastic += e
                lost_w += lost
                tx, ty, tz = tx + torque * nx, ty + torque * ny, tz + torque * nz
                row[column.TORQUE_T] -= torque * nz
        add_load(row, force, touch, (px, py))
        if record.shape[0] > 0:
            record[k, 0], record[k, 1], record[k, 2], record[k, 3] = gx, gy, gz, delta
            record[k, 4], record[k, 5], record[k, 6] = nx, ny, nz
    tally = Tally(contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)
    motion = grains.velocity_force
    motion[i, 6], motion[i, 7], motion[i, 8] = motion[i, 6] + fx, motion[i, 7] + fy, motion[i, 8] + fz
    motion[i, 9], motion[i, 10], motion[i, 11] = motion[i, 9] + tx, motion[i, 10] + ty, motion[i, 11] + tz
    return tally
