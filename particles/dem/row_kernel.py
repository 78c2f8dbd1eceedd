"""Compiled sweep over rows of the half list: forces on grain i and its later partners, its walls, its kick and drift.

Contacts are found, computed and handed to their grains a batch at a time (`particles.dem.contact_lanes`). A grain is
complete when its row has ended, because every pair stands in the row of its first grain: it is integrated after the
batch in which that happens, while it is in the cache. Only a grain that has a partner in an earlier chunk of rows must
wait (``late``): that chunk runs beside this one, so its reactions come through a buffer with a place for every such
pair, and `finish_rows` adds them in the order of the pairs once all chunks are done. Nothing depends on the number of
threads, bit for bit.

A held attraction pulls every pair of the list that it drives, touching or not; its sums go the same way, in places of
their own.
"""

from __future__ import annotations

import numpy as np

from geometry.inner_functions import inner
from geometry.lane_tables import lane_rows
from particles.dem import total_columns as column
from particles.dem.contact_lanes import contacts_in_lanes, law_in_lanes
from particles.dem.kernel_state import Tally
from particles.dem.pair_kernel import find_contacts, mass_of
from particles.dem.wall_contact_kernel import pull_of_walls, wall_forces
from particles.laws.columns import N_LAW


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def drift(i, m, force, torque, pulled, now, energy_column, attraction, grains, row):
    """Kick and drift of grain i of mass m under contacts, pulled by ``pulled``; clears its place for the next step.

    Adds works to the chunk's sums ``row``; returns squared travel from ``reference`` [m^2] and squared speed.
    """
    position_radius, velocity_force = grains.position_radius, grains.velocity_force
    gravity, external = grains.gravity, grains.external
    fx, fy, fz = force
    tx, ty, tz = torque
    px, py, pz = pulled
    dt = now.dt
    kick = dt / m
    radius = position_radius[i, 3]
    turn = kick / (0.4 * radius * radius)
    ax, ay, az = fx, fy, fz
    if gravity.shape[0] > 0:
        g = min(now.step, gravity.shape[0] - 1)
        ax, ay, az = ax + m * gravity[g, 0], ay + m * gravity[g, 1], az + m * gravity[g, 2]
    if external.shape[0] > 0:
        ax, ay, az = ax + external[i, 0], ay + external[i, 1], az + external[i, 2]
    if attraction is not None:
        ax, ay, az = ax + px, ay + py, az + pz
        attraction.drawn[i, 0], attraction.drawn[i, 1], attraction.drawn[i, 2] = 0.0, 0.0, 0.0
    vx, vy, vz = velocity_force[i, 0], velocity_force[i, 1], velocity_force[i, 2]
    wx, wy, wz = velocity_force[i, 3], velocity_force[i, 4], velocity_force[i, 5]
    bx, by, bz = vx + kick * ax, vy + kick * ay, vz + kick * az
    ox, oy, oz = wx + turn * tx, wy + turn * ty, wz + turn * tz
    velocity_force[i, 0], velocity_force[i, 1], velocity_force[i, 2] = bx, by, bz
    velocity_force[i, 3], velocity_force[i, 4], velocity_force[i, 5] = ox, oy, oz
    velocity_force[i, 6], velocity_force[i, 7], velocity_force[i, 8] = 0.0, 0.0, 0.0
    velocity_force[i, 9], velocity_force[i, 10], velocity_force[i, 11] = 0.0, 0.0, 0.0
    if energy_column is not None:
        # half a kick with the velocities of the drift before it, half with those of the drift after it: the mean closes
        # the balance of kinetic energy exactly, and by drifts it is the trapezoidal rule
        half = 0.5 * dt
        row[column.CONTACT_WORK] += half * (fx * vx + fy * vy + fz * vz + tx * wx + ty * wy + tz * wz)
        row[column.CONTACT_LATER] += half * (fx * bx + fy * by + fz * bz + tx * ox + ty * oy + tz * oz)
        if gravity.shape[0] > 0:
            g = min(now.step, gravity.shape[0] - 1)
            row[column.GRAVITY_WORK] += half * m * (gravity[g, 0] * vx + gravity[g, 1] * vy + gravity[g, 2] * vz)
            row[column.GRAVITY_LATER] += half * m * (gravity[g, 0] * bx + gravity[g, 1] * by + gravity[g, 2] * bz)
        if external.shape[0] > 0:
            row[column.EXTERNAL_WORK] += half * (external[i, 0] * vx + external[i, 1] * vy + external[i, 2] * vz)
            row[column.EXTERNAL_LATER] += half * (external[i, 0] * bx + external[i, 1] * by + external[i, 2] * bz)
        if attraction is not None:  # a force of no contact, booked as the held ones are
            row[column.EXTERNAL_WORK] += half * (px * vx + py * vy + pz * vz)
            row[column.EXTERNAL_LATER] += half * (px * bx + py * by + pz * bz)
        if now.last:  # at the time of the positions that the forces belong to
            row[column.KINETIC] += (
                0.5 * m * (vx * bx + vy * by + vz * bz + 0.4 * radius * radius * (wx * ox + wy * oy + wz * oz))
            )
    x, y, z = position_radius[i, 0] + dt * bx, position_radius[i, 1] + dt * by, position_radius[i, 2] + dt * bz
    position_radius[i, 0], position_radius[i, 1], position_radius[i, 2] = x, y, z
    if now.last:
        grains.net[i, 0], grains.net[i, 1], grains.net[i, 2] = fx, fy, fz
    reference = grains.reference
    dx, dy, dz = x - reference[i, 0], y - reference[i, 1], z - reference[i, 2]
    travel = dx * dx + dy * dy + dz * dz + 0.0 * (ox + oy + oz)  # a spin that is not finite shows here too
    return travel, bx * bx + by * by + bz * bz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_waiting(i, force, torque, pulled, attraction, velocity_force):
    """Force, torque and pull of grain i (3 each) with what earlier rows have left at its place."""
    force = (force[0] + velocity_force[i, 6], force[1] + velocity_force[i, 7], force[2] + velocity_force[i, 8])
    torque = (torque[0] + velocity_force[i, 9], torque[1] + velocity_force[i, 10], torque[2] + velocity_force[i, 11])
    if attraction is not None:
        drawn = attraction.drawn
        pulled = (pulled[0] + drawn[i, 0], pulled[1] + drawn[i, 1], pulled[2] + drawn[i, 2])
    return force, torque, pulled


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def keep_waiting(i, force, torque, pulled, attraction, velocity_force):
    """Leave force, torque and pull of the late grain i at its place."""
    velocity_force[i, 6], velocity_force[i, 7], velocity_force[i, 8] = force
    velocity_force[i, 9], velocity_force[i, 10], velocity_force[i, 11] = torque
    if attraction is not None:
        attraction.drawn[i, 0], attraction.drawn[i, 1], attraction.drawn[i, 2] = pulled


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def sweep_rows(chunk, now, law, resistance, energy_column, attraction, grains, pairs, slots, walls, chunks, totals):
    """Rows of a chunk: contacts of each grain, then its kick and drift where no other chunk has a say."""
    for b in range(totals.chunk_bodies.shape[1]):
        for a in range(column.N_CHUNK_BODY):
            totals.chunk_bodies[chunk, b, a] = 0.0
    row = totals.chunk[chunk]
    row[:] = 0.0
    late, velocity_force = chunks.late, grains.velocity_force
    tally = Tally(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0), 0.0, -1)
    travel = fastest = 0.0
    done, end = chunks.start[chunk], chunks.start[chunk + 1]
    cursor = pairs.start[done], chunks.cross_start[chunk] - 1
    none = (0.0, 0.0, 0.0)
    gone = (0.0, 0.0, 0.0, 0.0)  # what pairs that parted have lost
    table = law_in_lanes(law, lane_rows(N_LAW))
    while done < end:
        cursor, count, gone = find_contacts(
            chunk, cursor, now.dt, law, resistance, energy_column, attraction, grains, pairs, chunks, gone
        )
        tally = contacts_in_lanes(
            chunk, count, now.dt, law, table, resistance, energy_column, grains, pairs, chunks, tally
        )
        ended = np.int64(pairs.row[cursor[0]]) if cursor[0] < pairs.start[end] else end
        for i in range(done, ended):  # grains whose rows have ended
            pulled = pull_of_walls(i, attraction, grains, slots, walls, none)
            force, torque, tally = wall_forces(
                i, chunk, now.dt, law, resistance, energy_column, grains, slots, walls, totals, (none, none), tally
            )
            force, torque, pulled = add_waiting(i, force, torque, pulled, attraction, velocity_force)
            if late[i] != 0:
                keep_waiting(i, force, torque, pulled, attraction, velocity_force)
                continue
            m = mass_of(law, grains.mass, i)
            d2, speed2 = drift(i, m, force, torque, pulled, now, energy_column, attraction, grains, row)
            if not d2 <= travel:
                travel = d2 if d2 == d2 else np.inf
            fastest = max(fastest, speed2)
        done = ended
    left = tally.left
    row[column.CONTACTS], row[column.ELASTIC] = tally.contacts, tally.elastic
    row[column.NORMAL_DAMPING], row[column.TANGENTIAL_DAMPING] = tally.normal + left[0] + gone[0], tally.tangential
    row[column.SLIDING] = tally.sliding + left[1] + gone[1]
    row[column.ROLLING], row[column.TWISTING] = tally.rolling + left[2] + gone[2], tally.twisting + left[3] + gone[3]
    row[column.MAX_OVERLAP], row[column.GRAIN] = tally.deepest, tally.deepest_at
    row[column.MAX_TRAVEL], row[column.MAX_SPEED] = travel, fastest


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def finish_rows(chunk, now, law, energy_column, attraction, grains, chunks, totals):
    """The late grains of a chunk: reactions from earlier chunks, then kick and drift."""
    row, velocity_force, cross, in_slot = totals.chunk[chunk], grains.velocity_force, chunks.reaction, chunks.in_slot
    travel, fastest = row[column.MAX_TRAVEL], row[column.MAX_SPEED]
    for a in range(chunks.late_start[chunk], chunks.late_start[chunk + 1]):
        i = np.int64(chunks.late_grain[a])
        m = mass_of(law, grains.mass, i)
        fx, fy, fz = velocity_force[i, 6], velocity_force[i, 7], velocity_force[i, 8]
        tx, ty, tz = velocity_force[i, 9], velocity_force[i, 10], velocity_force[i, 11]
        for p in range(chunks.in_start[a], chunks.in_start[a + 1]):
            q = in_slot[p]
            fx, fy, fz = fx + cross[q, 0], fy + cross[q, 1], fz + cross[q, 2]
            tx, ty, tz = tx + cross[q, 3], ty + cross[q, 4], tz + cross[q, 5]
            cross[q, 0] = cross[q, 1] = cross[q, 2] = cross[q, 3] = cross[q, 4] = cross[q, 5] = 0.0  # for the next step
        px = py = pz = 0.0
        if attraction is not None:
            px, py, pz = attraction.drawn[i, 0], attraction.drawn[i, 1], attraction.drawn[i, 2]
            for p in range(chunks.in_start[a], chunks.in_start[a + 1]):
                q = in_slot[p]
                px -= attraction.cross[q, 0]
                py -= attraction.cross[q, 1]
                pz -= attraction.cross[q, 2]
        force, torque, pulled = (fx, fy, fz), (tx, ty, tz), (px, py, pz)
        d2, speed2 = drift(i, m, force, torque, pulled, now, energy_column, attraction, grains, row)
        if not d2 <= travel:
            travel = d2 if d2 == d2 else np.inf
        fastest = max(fastest, speed2)
    row[column.MAX_TRAVEL], row[column.MAX_SPEED] = travel, fastest
