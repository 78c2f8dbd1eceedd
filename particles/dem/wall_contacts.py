"""Contacts with walls and pulls of walls in SIMD vectors of eight, and the load of the bodies that they belong to.

The grains of a few rows are asked one after the other what they touch (`particles.dem.wall_search`); forces are contact
as between grains (`particles.dem.contact_kinematics`).
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first, select, splat, to_integers
from geometry.kernels.simd_tables import (
    eight_indices,
    gather,
    gather_2d,
    gather_columns,
    gather_two_columns,
    scatter_add,
    scatter_column,
)
from particles.dem.attraction_kernel import COLUMN, pulls_at
from particles.dem.contact_kinematics import add_sums, contact_loads, lane_max, load_rows, store_rows, wall_kinematics
from particles.dem.kernel_state import Tally
from particles.dem.motion_columns import FORCE, SPIN
from particles.dem.wall_search import touching_walls
from particles.laws.springs import equal
from particles.walls.triangle_kernels import N_CONTACT

ROOM = 8 * LANES  # contacts that are contact before their forces are
N_NEAR = 6


def wall_scratch(n_chunks: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return scratch of so many chunks whose grains have ``most`` slots: ``contact`` and ``near`` of `WallSlots`."""
    return np.zeros((n_chunks, ROOM + most, N_CONTACT)), np.zeros((n_chunks, ROOM + most, N_NEAR))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_walls(
    first, end, chunk, dt, law, tables, resistance, energy_column, attraction, grains, slots, walls, totals, tally
):
    """Add contacts and pulls of the walls near the grains from ``first`` up to ``end`` to those on them.

    ``tables`` are the law with one row in vectors, and vectors for the history of a contact. Returns the tally; the
    load of the bodies goes into the chunk's sums.
    """
    contact, near = slots.contact[chunk], slots.near[chunk]
    released, count, n_near = tally.released_energy, 0, 0
    for i in range(first, end):
        if slots.start[i + 1] == slots.start[i]:
            continue
        new, n_near, released = touching_walls(
            i, law, resistance, energy_column, attraction, grains, slots, walls, contact[count:], near, n_near, released
        )
        count += new
        if count >= ROOM:
            tally = _wall_contacts(
                chunk, count, dt, law, tables, resistance, energy_column, grains, slots, walls, totals, tally
            )
            count = 0
        if n_near >= ROOM:
            _pull_of_walls(n_near, near, attraction, grains)
            n_near = 0
    tally = _wall_contacts(
        chunk, count, dt, law, tables, resistance, energy_column, grains, slots, walls, totals, tally
    )
    _pull_of_walls(n_near, near, attraction, grains)
    return Tally(tally.contacts, tally.energies, released, tally.max_overlap, tally.argmax_overlap)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _pull_of_walls(count, near, attraction, grains):
    """Add the pulls of the first ``count`` of the walls ``near`` grains to those on the grains."""
    if attraction is None:
        return
    for c in range(0, count, LANES):
        rows = eight_indices(c, min(c + LANES, count) - 1)
        slot, distance, nx, ny = gather_columns(near, rows, 0)
        nz, grain = gather_two_columns(near, rows, 4)
        i = to_integers(grain)
        _, _, _, radius = gather_columns(grains.position_radius, i, 0)
        at_column, amplitude = gather_two_columns(attraction.wall, to_integers(slot), COLUMN)
        pull = pulls_at(attraction, 2.0 * (distance - radius) / radius, at_column, amplitude, 0.0)
        pull = select(mask_of_first(count - c), pull, 0.0)
        scatter_add(attraction.force, i, 0, None, None, (pull * nx, pull * ny, pull * nz, splat(0.0)))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _wall_contacts(chunk, count, dt, law, tables, resistance, energy_column, grains, slots, walls, totals, tally):
    """Add the forces of the first ``count`` contacts contact to their grains and to the loads; returns the tally."""
    table, memory = tables
    motion, history, record, contact = grains.velocity_force, slots.history, slots.record, slots.contact[chunk]
    bodies = totals.chunk_bodies[chunk]
    energies, max_overlap, argmax_overlap = tally.energies, tally.max_overlap, tally.argmax_overlap
    for c in range(0, count, LANES):
        rows, active = eight_indices(c, min(c + LANES, count) - 1), mask_of_first(count - c)
        slot_number, distance, nx, ny = gather_columns(contact, rows, 0)
        nz, grain = gather_two_columns(contact, rows, 4)
        slot, i = to_integers(slot_number), to_integers(grain)
        w = gather(slots.other, slot)
        body = gather(walls.body, w)
        if grains.species.shape[0] > 0:
            kind = gather_2d(walls.law_row, gather(grains.species, i), w)
        else:
            kind = gather(walls.law_row[0], w)
        load_rows(law.rows, kind, table.rows)
        load_rows(history, slot, memory)
        x, y, _, radius = gather_columns(grains.position_radius, i, 0)
        vx, vy, vz, wx = gather_columns(motion, i, 0)
        wy, wz = gather_two_columns(motion, i, SPIN + 1)
        m = splat(grains.mass[0]) if equal(law) else gather(grains.mass, i)
        omega = gather(walls.speed, body)
        px, py = x + distance * nx, y + distance * ny
        kinematics = wall_kinematics(
            radius - distance, (nx, ny, nz), distance, (vx, vy, vz), (wx, wy, wz), omega, (px, py)
        )
        loads = contact_loads(
            table, resistance, energy_column, m, radius, 0.4 * m * radius * radius, dt, kinematics, distance, None,
            (wx, wy, wz - omega), active, memory,
        )  # fmt: skip
        store_rows(history, slot, memory)
        force, (gx, gy, gz), (tx, ty, tz), (_, _, on_body) = loads.law, loads.force, loads.torque, loads.reaction
        scatter_add(motion, i, FORCE, None, None, (gx, gy, gz, tx, ty, tz))
        # the grain presses along n; what is left of the force is tangential
        lever = px * ny - py * nx
        dashpot, normal = select(active, force.dashpot, 0.0), select(active, force.repulsion - force.pull, 0.0)
        spring = normal - dashpot
        turning = -(px * gy - py * gx + normal * lever) + on_body
        sx, sy, sz = -(gx + normal * nx), -(gy + normal * ny), -(gz + normal * nz)
        scatter_add(bodies, body, 0, None, None, (spring * lever, dashpot * lever, turning, spring * nx))
        scatter_add(bodies, body, 4, None, None, (spring * ny, spring * nz, dashpot * nx, dashpot * ny))
        scatter_add(bodies, body, 8, None, None, (dashpot * nz, sx, sy, sz))
        max_overlap, argmax_overlap = lane_max(0.5 * kinematics.delta / radius, i, max_overlap, argmax_overlap)
        if energy_column is not None:
            energies = add_sums(energies, loads.energies)
        if record.shape[0] > 0:
            scatter_column(record, slot, 0, force.x)
            scatter_column(record, slot, 1, force.y)
            scatter_column(record, slot, 2, force.z)
            scatter_column(record, slot, 3, kinematics.delta)
            scatter_column(record, slot, 4, nx)
            scatter_column(record, slot, 5, ny)
            scatter_column(record, slot, 6, nz)
    return Tally(tally.contacts + count, energies, tally.released_energy, max_overlap, argmax_overlap)
