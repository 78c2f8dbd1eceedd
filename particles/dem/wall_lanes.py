"""Contacts with walls and pulls of walls in SIMD vectors of eight, and the load of the bodies that they belong to.

The grains of a few rows are asked one after the other what they touch (`particles.dem.wall_contact_kernel`); forces are
found as between grains (`particles.dem.contact_lanes`).
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first, reduce_add, reduce_max, select, splat, to_integers
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
from particles.dem.contact_kernel import Touch, contact_force, rolling_torque, twisting_torque
from particles.dem.contact_lanes import FORCE, SPIN, deepest_of, keep, remember
from particles.dem.kernel_state import Tally
from particles.dem.wall_contact_kernel import touching_walls
from particles.laws.springs import equal
from particles.walls.triangle_kernels import N_FOUND

ROOM = 8 * LANES  # contacts that are found before their forces are
N_NEAR = 6


def wall_scratch(n_chunks: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Scratch of so many chunks whose grains have ``most`` slots: ``found`` and ``near`` of `WallSlots`."""
    return np.zeros((n_chunks, ROOM + most, N_FOUND)), np.zeros((n_chunks, ROOM + most, N_NEAR))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_walls(
    first, until, chunk, dt, law, tables, resistance, energy_column, attraction, grains, slots, walls, totals, tally
):
    """Contacts and pulls of the walls near the grains from ``first`` up to ``until``, added to those on them.

    ``tables`` are the law with one row in vectors, and vectors for the history of a contact. Returns the tally; the
    load of the bodies goes into the chunk's sums.
    """
    found, near = slots.found[chunk], slots.near[chunk]
    left, count, many = tally.left, 0, 0
    for i in range(first, until):
        if slots.start[i + 1] == slots.start[i]:
            continue
        more, many, left = touching_walls(
            i, law, resistance, energy_column, attraction, grains, slots, walls, found[count:], near, many, left
        )
        count += more
        if count >= ROOM:
            tally = _wall_contacts(
                chunk, count, dt, law, tables, resistance, energy_column, grains, slots, walls, totals, tally
            )
            count = 0
        if many >= ROOM:
            _pull_of_walls(many, near, attraction, grains)
            many = 0
    tally = _wall_contacts(
        chunk, count, dt, law, tables, resistance, energy_column, grains, slots, walls, totals, tally
    )
    _pull_of_walls(many, near, attraction, grains)
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, _, deepest, deepest_at = tally
    return Tally(contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _pull_of_walls(many, near, attraction, grains):
    """Add the pulls of the first ``many`` of the walls ``near`` grains to those on the grains."""
    if attraction is None:
        return
    for c in range(0, many, LANES):
        rows = eight_indices(c, min(c + LANES, many) - 1)
        slot, distance, nx, ny = gather_columns(near, rows, 0)
        nz, grain = gather_two_columns(near, rows, 4)
        i = to_integers(grain)
        _, _, _, radius = gather_columns(grains.position_radius, i, 0)
        at_column, amplitude = gather_two_columns(attraction.wall, to_integers(slot), COLUMN)
        pull = pulls_at(attraction, 2.0 * (distance - radius) / radius, at_column, amplitude, 0.0)
        pull = select(mask_of_first(many - c), pull, 0.0)
        scatter_add(attraction.drawn, i, 0, None, None, (pull * nx, pull * ny, pull * nz, splat(0.0)))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _wall_contacts(chunk, count, dt, law, tables, resistance, energy_column, grains, slots, walls, totals, tally):
    """Forces of the first ``count`` contacts found, added to their grains and to the loads; returns the tally."""
    table, kept = tables
    motion, history, record, found = grains.velocity_force, slots.history, slots.record, slots.found[chunk]
    loads = totals.chunk_bodies[chunk]
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at = tally
    for c in range(0, count, LANES):
        rows, there = eight_indices(c, min(c + LANES, count) - 1), mask_of_first(count - c)
        at, distance, nx, ny = gather_columns(found, rows, 0)
        nz, grain = gather_two_columns(found, rows, 4)
        slot, i = to_integers(at), to_integers(grain)
        w = gather(slots.other, slot)
        body = gather(walls.body, w)
        if grains.species.shape[0] > 0:
            kind = gather_2d(walls.law_row, gather(grains.species, i), w)
        else:
            kind = gather(walls.law_row[0], w)
        remember(law.rows, kind, table.rows)
        remember(history, slot, kept)
        x, y, _, radius = gather_columns(grains.position_radius, i, 0)
        vx, vy, vz, wx = gather_columns(motion, i, 0)
        wy, wz = gather_two_columns(motion, i, SPIN + 1)
        m = splat(grains.mass[0]) if equal(law) else gather(grains.mass, i)
        omega = gather(walls.speed, body)
        px, py = x + distance * nx, y + distance * ny
        velocity = (
            vx + distance * (wy * nz - wz * ny) + omega * py,
            vy + distance * (wz * nx - wx * nz) - omega * px,
            vz + distance * (wx * ny - wy * nx),
        )
        touch = Touch(radius - distance, (nx, ny, nz), velocity, None, 0.5 * (wx * nx + wy * ny + (wz + omega) * nz))
        force = contact_force(table, 0, energy_column, m, radius, dt, touch, kept, 0)
        gx, gy, gz = select(there, force.x, 0.0), select(there, force.y, 0.0), select(there, force.z, 0.0)
        tx, ty, tz = distance * (ny * gz - nz * gy), distance * (nz * gx - nx * gz), distance * (nx * gy - ny * gx)
        stored, lost, on_body = force.stored, splat(0.0), splat(0.0)
        if resistance is not None:
            inertia = 0.4 * m * radius * radius
            if resistance.rolling >= 0:
                (hx, hy, hz), e, lost = rolling_torque(
                    table, 0, energy_column, radius, inertia, dt, force, touch, (wx, wy, wz - omega), kept, 0,
                    resistance.rolling,
                )  # fmt: skip
                hx, hy, hz = select(there, hx, 0.0), select(there, hy, 0.0), select(there, hz, 0.0)
                stored, on_body = stored + e, hz
                tx, ty, tz = tx + hx, ty + hy, tz + hz
                if energy_column is not None:
                    lost_r += reduce_add(select(there, lost, 0.0))
            if resistance.twisting >= 0:
                spin = wx * nx + wy * ny + (wz - omega) * nz
                torque, e, lost = twisting_torque(
                    table, 0, energy_column, radius, inertia, dt, force, spin, kept, 0, resistance.twisting
                )
                torque = select(there, torque, 0.0)
                stored, on_body = stored + e, on_body + torque * nz
                tx, ty, tz = tx + torque * nx, ty + torque * ny, tz + torque * nz
                if energy_column is not None:
                    lost_w += reduce_add(select(there, lost, 0.0))
        keep(history, slot, kept)
        scatter_add(motion, i, FORCE, None, None, (gx, gy, gz, tx, ty, tz))
        # the grain presses along n; what is left of the force is tangential
        lever = px * ny - py * nx
        dashpot, both = select(there, force.dashpot, 0.0), select(there, force.repulsion - force.pull, 0.0)
        spring = both - dashpot
        turning = -(px * gy - py * gx + both * lever) - on_body
        sx, sy, sz = -(gx + both * nx), -(gy + both * ny), -(gz + both * nz)
        scatter_add(loads, body, 0, None, None, (spring * lever, dashpot * lever, turning, spring * nx))
        scatter_add(loads, body, 4, None, None, (spring * ny, spring * nz, dashpot * nx, dashpot * ny))
        scatter_add(loads, body, 8, None, None, (dashpot * nz, sx, sy, sz))
        depth = 0.5 * touch.delta / radius
        if reduce_max(depth) > deepest:
            deepest, deepest_at = deepest_of(depth, i, deepest, deepest_at)
        if energy_column is not None:
            elastic += reduce_add(select(there, stored, 0.0))
            lost_n += reduce_add(select(there, force.lost_n, 0.0))
            lost_t += reduce_add(select(there, force.lost_t, 0.0))
            lost_s += reduce_add(select(there, force.lost_s, 0.0))
        if record.shape[0] > 0:
            scatter_column(record, slot, 0, force.x)
            scatter_column(record, slot, 1, force.y)
            scatter_column(record, slot, 2, force.z)
            scatter_column(record, slot, 3, touch.delta)
            scatter_column(record, slot, 4, nx)
            scatter_column(record, slot, 5, ny)
            scatter_column(record, slot, 6, nz)
    return Tally(contacts + count, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)
