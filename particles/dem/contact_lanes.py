"""Contact forces in SIMD vectors of eight contacts.

The arithmetic of a contact is long and has few memory accesses, so it is done for eight contacts at once
(`geometry.kernels.simd`). Grains, history and parameters are gathered as short rows and scattered back
(`geometry.kernels.simd_tables`); the functions of a contact (`particles.dem.contact_kernel`) take scalars and vectors
alike. Which contacts share a vector follows from the list and the state alone. An incomplete last vector repeats its
last contact, masked.

A pair stands in the row of its first grain. Its reaction goes to the second one directly, or, where that lies in a
later chunk of rows, into the chunk's places in the buffer (`particles.neighbours.partition`).

Lever arms sum to the distance of centres, and the two torques are l_i n x F and l_j n x F: angular momentum is
conserved to round-off.
"""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first, maximum, reduce_add, reduce_max, select, splat, to_tuple
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import (
    WIDE,
    gather,
    gather_2d,
    gather_columns,
    gather_two_columns,
    load,
    scatter_add,
    scatter_column,
    scatter_columns,
    stack_table,
)
from particles.dem.contact_kernel import Touch, contact_force, rolling_torque, twisting_torque
from particles.dem.kernel_state import Tally
from particles.dem.pair_kernel import PLACE, SLOT, through_faces
from particles.laws.columns import N_LAW
from particles.laws.springs import equal, with_rows

MAX_REMEMBERED = 20  # columns of a history, 18 and two empty ones (`particles.dem.contact_columns`)
SPIN, FORCE = 3, 6  # columns of a grain's velocities and forces


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def law_in_lanes(law, rows):
    """A table of the same law whose first row is ``rows``, a `stack_table`."""
    for a in range(N_LAW):
        rows[0, a] = splat(law.rows[0, a])
    return with_rows(law, rows)


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def remember(history, slot, kept):
    """Gather whole rows of a table into ``kept``, a `stack_table`."""
    for first in range(0, history.shape[1], WIDE):
        four = gather_columns(history, slot, first)
        kept[0, first], kept[0, first + 1], kept[0, first + 2], kept[0, first + 3] = four


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def keep(history, slot, kept):
    """The opposite of `remember`."""
    for first in range(0, history.shape[1], WIDE):
        scatter_columns(
            history, slot, first, kept[0, first], kept[0, first + 1], kept[0, first + 2], kept[0, first + 3]
        )


@device_function(without_refcounts=True, error_model="numpy")
def deepest_of(depth, i, deepest, deepest_at):
    """The largest of eight overlaps and ``deepest``, and the grain that has it."""
    depths = to_tuple(depth)
    for q in range(LANES):
        if depths[q] > deepest:
            deepest, deepest_at = depths[q], i[q]
    return deepest, deepest_at


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _laws_of_species(law, table, law_row, species, i, j):
    """Gather the rows of eight pairs of materials into ``table``."""
    remember(law.rows, gather_2d(law_row, gather(species, i), gather(species, j)), table.rows)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def contacts_in_lanes(chunk, count, dt, law, table, resistance, energy_column, grains, pairs, chunks, tally):
    """Find and hand over the forces of the first ``count`` contacts noted; ``table`` is `law_in_lanes`.

    Returns the tally.
    """
    position_radius, velocity_force = grains.position_radius, grains.velocity_force
    noted, history, record = pairs.noted[chunk], pairs.history, pairs.record
    kept = stack_table(MAX_REMEMBERED)
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at = tally
    sums = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    for c in range(count, LANES * ((count + LANES - 1) // LANES)):
        noted[SLOT, c], noted[PLACE, c] = noted[SLOT, count - 1], noted[PLACE, count - 1]
    for c in range(0, count, LANES):
        slot, place = load(noted, SLOT, c), load(noted, PLACE, c)
        i, j = gather(pairs.row, slot), gather(pairs.other, slot)
        xi, yi, zi, ri = gather_columns(position_radius, i, 0)
        dx, dy, dz, rj = gather_columns(position_radius, j, 0)
        dx, dy = through_faces(pairs, slot, 1.0, dx, dy)
        dx, dy, dz = dx - xi, dy - yi, dz - zi
        vx, vy, vz, px = gather_columns(velocity_force, i, 0)
        py, pz = gather_two_columns(velocity_force, i, SPIN + 1)
        ux, uy, uz, qx = gather_columns(velocity_force, j, 0)
        qy, qz = gather_two_columns(velocity_force, j, SPIN + 1)
        ux, uy = through_faces(pairs, slot, 1.0, ux, uy)
        qx, qy = through_faces(pairs, slot, 1.0, qx, qy)
        ux, uy, uz = vx - ux, vy - uy, vz - uz
        sx, sy, sz = px + qx, py + qy, pz + qz
        px, py, pz = px - qx, py - qy, pz - qz
        remember(history, slot, kept)
        d2 = dx * dx + dy * dy + dz * dz
        d = sqrt(d2)
        inverse = select(d2 > 0.0, d * (1.0 / d2), 0.0)  # beside the root, not after it
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        if equal(law):
            r, m = position_radius[0, 3], grains.mass[0]
            reach, per_diameter = splat(2.0 * r), splat(0.5 / r)
            lj = li = 0.5 * d
            r_eff, m_eff, inertia = splat(0.5 * r), splat(0.5 * m), splat(0.2 * m * r * r)
            ax, ay, az = li * sx, li * sy, li * sz
        else:
            if grains.species.shape[0] > 0:
                _laws_of_species(law, table, pairs.law_row, grains.species, i, j)
            mi, mj = gather(grains.mass, i), gather(grains.mass, j)
            reach, m_eff = ri + rj, mi * mj / (mi + mj)
            per_diameter = 0.5 / select(rj < ri, rj, ri)
            share = ri / reach
            li, r_eff = d * share, rj * share
            lj = d - li
            own, others = mi * ri * ri, mj * rj * rj
            inertia = 0.4 * own * others / (own + others)
            half, rest = 0.5 * d, 0.5 * (li - lj)
            ax, ay, az = half * sx + rest * px, half * sy + rest * py, half * sz + rest * pz
        # by how much n has turned in the drift that has just ended
        hx, hy, hz = -ux * dt * inverse, -uy * dt * inverse, -uz * dt * inverse
        along = hx * nx + hy * ny + hz * nz
        inverse_last = 1.0 + along  # d/d_last
        touch = Touch(
            maximum(reach - d, 0.0),  # not less by round-off
            (nx, ny, nz),
            (ux + ay * nz - az * ny, uy + az * nx - ax * nz, uz + ax * ny - ay * nx),
            ((hx - along * nx) * inverse_last, (hy - along * ny) * inverse_last, (hz - along * nz) * inverse_last),
            0.5 * (sx * nx + sy * ny + sz * nz),
        )
        there = mask_of_first(count - c)
        force = contact_force(table, 0, energy_column, m_eff, r_eff, dt, touch, kept, 0)
        stored, rolled, twisted = force.stored, splat(0.0), splat(0.0)
        gx, gy, gz = select(there, force.x, 0.0), select(there, force.y, 0.0), select(there, force.z, 0.0)
        mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
        tx, ty, tz = li * mx, li * my, li * mz
        mx, my, mz = lj * mx, lj * my, lj * mz
        if resistance is not None:
            if resistance.rolling >= 0:
                (hx, hy, hz), e, rolled = rolling_torque(
                    table, 0, energy_column, r_eff, inertia, dt, force, touch, (px, py, pz), kept, 0, resistance.rolling
                )
                stored = stored + e
                hx, hy, hz = select(there, hx, 0.0), select(there, hy, 0.0), select(there, hz, 0.0)
                tx, ty, tz = tx + hx, ty + hy, tz + hz
                mx, my, mz = mx - hx, my - hy, mz - hz
            if resistance.twisting >= 0:
                spin = px * nx + py * ny + pz * nz
                torque, e, twisted = twisting_torque(
                    table, 0, energy_column, r_eff, inertia, dt, force, spin, kept, 0, resistance.twisting
                )
                stored = stored + e
                torque = select(there, torque, 0.0)
                tx, ty, tz = tx + torque * nx, ty + torque * ny, tz + torque * nz
                mx, my, mz = mx - torque * nx, my - torque * ny, mz - torque * nz
        keep(history, slot, kept)
        if record.shape[0] > 0:
            scatter_column(record, slot, 0, force.x)
            scatter_column(record, slot, 1, force.y)
            scatter_column(record, slot, 2, force.z)
        scatter_add(velocity_force, i, FORCE, None, None, (gx, gy, gz, tx, ty, tz))
        gx, gy = through_faces(pairs, slot, -1.0, gx, gy)
        mx, my = through_faces(pairs, slot, -1.0, mx, my)
        scatter_add(velocity_force, j, FORCE, chunks.reaction, place, (-gx, -gy, -gz, mx, my, mz))
        depth = touch.delta * per_diameter
        if reduce_max(depth) > deepest:
            deepest, deepest_at = deepest_of(depth, i, deepest, deepest_at)
        if energy_column is not None:
            sums = (
                sums[0] + select(there, stored, 0.0), sums[1] + select(there, force.lost_n, 0.0),
                sums[2] + select(there, force.lost_t, 0.0), sums[3] + select(there, force.lost_s, 0.0),
                sums[4] + select(there, rolled, 0.0), sums[5] + select(there, twisted, 0.0),
            )  # fmt: skip
    if energy_column is not None:
        elastic, lost_n = elastic + reduce_add(sums[0]), lost_n + reduce_add(sums[1])
        lost_t, lost_s = lost_t + reduce_add(sums[2]), lost_s + reduce_add(sums[3])
        if resistance is not None:
            lost_r, lost_w = lost_r + reduce_add(sums[4]), lost_w + reduce_add(sums[5])
    return Tally(contacts + count, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)
