"""Contacts of grain pairs in SIMD vectors of eight.

The arithmetic of a contact is long and has few memory accesses, so it is done for eight contacts at once
(`geometry.kernels.simd`). Grains, history and parameters are gathered as short rows and scattered back
(`geometry.kernels.simd_tables`). Which contacts share a vector follows from the list and the state alone. An incomplete
last vector repeats its last contact, masked.

A pair stands in the row of its first grain. Its reaction goes to the second one directly, or, where that lies in a
later chunk of rows, into the chunk's places in the buffer (`particles.neighbours.partition`).
"""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first, maximum, select, splat
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import (
    gather,
    gather_2d,
    gather_columns,
    gather_two_columns,
    load,
    scatter_add,
    scatter_column,
    stack_table,
)
from particles.dem.box_kernel import add_contact_virial
from particles.dem.contact_kinematics import (
    MAX_REMEMBERED,
    add_sums,
    contact_loads,
    lane_max,
    load_rows,
    pair_kinematics,
    store_rows,
)
from particles.dem.kernel_state import Tally
from particles.dem.motion_columns import FORCE, SPIN
from particles.dem.pair_search import PLACE, SLOT, image_places, image_velocities, through_faces
from particles.laws.columns import N_LAW
from particles.laws.springs import equal, with_rows


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def broadcast_law(law, rows):
    """Return a table of the same law whose first row is ``rows``, a `stack_table`."""
    for a in range(N_LAW):
        rows[0, a] = splat(law.rows[0, a])
    return with_rows(law, rows)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def pair_contacts(chunk, count, dt, law, table, resistance, energy_column, grains, pairs, chunks, tally):
    """Add the forces of the first ``count`` contacts noted to their grains; ``table`` is `broadcast_law`.

    Returns the tally.
    """
    position_radius, motion = grains.position_radius, grains.velocity_force
    noted, history, record = pairs.noted[chunk], pairs.history, pairs.record
    memory = stack_table(MAX_REMEMBERED)
    max_overlap, argmax_overlap = tally.max_overlap, tally.argmax_overlap
    sums = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    for c in range(count, LANES * ((count + LANES - 1) // LANES)):
        noted[SLOT, c], noted[PLACE, c] = noted[SLOT, count - 1], noted[PLACE, count - 1]
    for c in range(0, count, LANES):
        slot, place = load(noted, SLOT, c), load(noted, PLACE, c)
        i, j = gather(pairs.row, slot), gather(pairs.other, slot)
        xi, yi, zi, ri = gather_columns(position_radius, i, 0)
        dx, dy, dz, rj = gather_columns(position_radius, j, 0)
        dx, dy, dz = image_places(pairs, slot, dx, dy, dz)
        dx, dy, dz = dx - xi, dy - yi, dz - zi
        vx, vy, vz, px = gather_columns(motion, i, 0)
        py, pz = gather_two_columns(motion, i, SPIN + 1)
        ux, uy, uz, qx = gather_columns(motion, j, 0)
        qy, qz = gather_two_columns(motion, j, SPIN + 1)
        ux, uy = image_velocities(pairs, slot, ux, uy)
        qx, qy = through_faces(pairs, slot, 1.0, qx, qy)
        ux, uy, uz = vx - ux, vy - uy, vz - uz
        sx, sy, sz = px + qx, py + qy, pz + qz
        px, py, pz = px - qx, py - qy, pz - qz
        load_rows(history, slot, memory)
        d2 = dx * dx + dy * dy + dz * dz
        d = sqrt(d2)
        inverse = select(d2 > 0.0, d * (1.0 / d2), 0.0)  # a quotient in parallel with the root
        if equal(law):
            r, m = position_radius[0, 3], grains.mass[0]
            reach, per_diameter = splat(2.0 * r), splat(0.5 / r)
            lj = li = 0.5 * d
            r_eff, m_eff, inertia = splat(0.5 * r), splat(0.5 * m), splat(0.2 * m * r * r)
            surface_velocity = li * sx, li * sy, li * sz
        else:
            if grains.species.shape[0] > 0:
                rows = gather_2d(pairs.law_row, gather(grains.species, i), gather(grains.species, j))
                load_rows(law.rows, rows, table.rows)
            mi, mj = gather(grains.mass, i), gather(grains.mass, j)
            reach, m_eff = ri + rj, mi * mj / (mi + mj)
            per_diameter = 0.5 / select(rj < ri, rj, ri)
            fraction = ri / reach
            li, r_eff = d * fraction, rj * fraction
            lj = d - li
            own, others = mi * ri * ri, mj * rj * rj
            inertia = 0.4 * own * others / (own + others)
            half, rest = 0.5 * d, 0.5 * (li - lj)
            surface_velocity = half * sx + rest * px, half * sy + rest * py, half * sz + rest * pz
        kinematics = pair_kinematics(
            maximum(reach - d, 0.0),  # not less by round-off
            (dx * inverse, dy * inverse, dz * inverse),
            inverse, (ux, uy, uz), surface_velocity, (sx, sy, sz), dt,
        )  # fmt: skip
        loads = contact_loads(
            table, resistance, energy_column, m_eff, r_eff, inertia, dt, kinematics, li, lj, (px, py, pz),
            mask_of_first(count - c), memory,
        )  # fmt: skip
        store_rows(history, slot, memory)
        if record.shape[0] > 0:
            scatter_column(record, slot, 0, loads.law.x)
            scatter_column(record, slot, 1, loads.law.y)
            scatter_column(record, slot, 2, loads.law.z)
        (gx, gy, gz), (tx, ty, tz), (mx, my, mz) = loads.force, loads.torque, loads.reaction
        add_contact_virial(grains.virial, chunk, (dx, dy, dz), loads.force)
        scatter_add(motion, i, FORCE, None, None, (gx, gy, gz, tx, ty, tz))
        gx, gy = through_faces(pairs, slot, -1.0, gx, gy)
        mx, my = through_faces(pairs, slot, -1.0, mx, my)
        scatter_add(motion, j, FORCE, chunks.reaction, place, (-gx, -gy, -gz, mx, my, mz))
        max_overlap, argmax_overlap = lane_max(kinematics.delta * per_diameter, i, max_overlap, argmax_overlap)
        if energy_column is not None:
            e = loads.energies
            sums = sums[0] + e[0], sums[1] + e[1], sums[2] + e[2], sums[3] + e[3], sums[4] + e[4], sums[5] + e[5]
    energies = tally.energies
    if energy_column is not None:
        energies = add_sums(energies, sums)
    return Tally(tally.contacts + count, energies, tally.released_energy, max_overlap, argmax_overlap)
