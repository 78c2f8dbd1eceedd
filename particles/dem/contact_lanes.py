"""Forces of contacts side by side: eight of those that were noted, from their grains and back.

The arithmetic of a contact is long and has hardly a memory access, so it is done for eight contacts at once, in a
processor's wide registers (`geometry.lanes`). Grains, history and parameters come into lanes as short rows and go back
so (`geometry.lane_tables`); the functions of a contact (`particles.dem.contact_kernel`) do not know about it. Which
contacts stand side by side follows from the list and the state alone. A last group that is not full repeats its last
contact, which gives no force then.

A pair stands in the row of its first grain. Its reaction goes to the second one directly, or, where that lies in a
later chunk of rows, into the chunk's places in the buffer (`particles.neighbours.partition`).

Lever arms sum to the distance of centres, and the two torques are l_i n x F and l_j n x F: angular momentum is
conserved to round-off.
"""

from __future__ import annotations

from geometry.inner_functions import inner
from geometry.lane_functions import square_root
from geometry.lane_tables import (
    WIDE,
    add_to_rows,
    columns,
    eight_of,
    entries,
    entries_2d,
    lane_rows,
    put_column,
    put_columns,
    two_columns,
)
from geometry.lanes import LANES, first_lanes, lanes_of, larger, largest_lane, numbers_of, sum_of_lanes, where
from particles.dem.contact_kernel import Touch, contact_force, rolling_torque, twisting_torque
from particles.dem.kernel_state import Tally
from particles.dem.pair_kernel import PLACE, SLOT, through_faces
from particles.laws.columns import N_LAW
from particles.laws.springs import equal, with_rows

MOST_REMEMBERED = 20  # columns of a history, 18 and two empty ones (`particles.dem.contact_columns`)
SPIN, FORCE = 3, 6  # columns of a grain's velocities and forces


@inner(borrows=True, error_model="numpy", forceinline=True)
def law_in_lanes(law, rows):
    """A table of the same law with its first row in lanes: ``rows``, made with `lane_rows`."""
    for a in range(N_LAW):
        rows[0, a] = lanes_of(law.rows[0, a])
    return with_rows(law, rows)


@inner(borrows=True, error_model="numpy", forceinline=True)
def remember(history, slot, kept):
    """Take whole rows of a table into lanes: ``kept``, made with `lane_rows`."""
    for first in range(0, history.shape[1], WIDE):
        four = columns(history, slot, first)
        kept[0, first], kept[0, first + 1], kept[0, first + 2], kept[0, first + 3] = four


@inner(borrows=True, error_model="numpy", forceinline=True)
def keep(history, slot, kept):
    """The opposite of `remember`."""
    for first in range(0, history.shape[1], WIDE):
        put_columns(history, slot, first, kept[0, first], kept[0, first + 1], kept[0, first + 2], kept[0, first + 3])


@inner(borrows=True, error_model="numpy")
def deepest_of(depth, i, deepest, deepest_at):
    """The largest of eight overlaps and ``deepest``, and the grain that has it."""
    depths = numbers_of(depth)
    for q in range(LANES):
        if depths[q] > deepest:
            deepest, deepest_at = depths[q], i[q]
    return deepest, deepest_at


@inner(borrows=True, error_model="numpy", forceinline=True)
def _laws_of_species(law, table, law_row, species, i, j):
    """Put the rows of eight pairs of materials into the lanes of ``table``."""
    remember(law.rows, entries_2d(law_row, entries(species, i), entries(species, j)), table.rows)


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def contacts_in_lanes(chunk, count, dt, law, table, resistance, energy_column, grains, pairs, chunks, tally):
    """Find and hand over the forces of the first ``count`` contacts noted; ``table`` is `law_in_lanes`.

    Returns the tally.
    """
    position_radius, velocity_force = grains.position_radius, grains.velocity_force
    noted, history, record = pairs.noted[chunk], pairs.history, pairs.record
    kept = lane_rows(MOST_REMEMBERED)
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at = tally
    sums = lanes_of(0.0), lanes_of(0.0), lanes_of(0.0), lanes_of(0.0), lanes_of(0.0), lanes_of(0.0)
    for c in range(count, LANES * ((count + LANES - 1) // LANES)):
        noted[SLOT, c], noted[PLACE, c] = noted[SLOT, count - 1], noted[PLACE, count - 1]
    for c in range(0, count, LANES):
        slot, place = eight_of(noted, SLOT, c), eight_of(noted, PLACE, c)
        i, j = entries(pairs.row, slot), entries(pairs.other, slot)
        xi, yi, zi, ri = columns(position_radius, i, 0)
        dx, dy, dz, rj = columns(position_radius, j, 0)
        dx, dy = through_faces(pairs, slot, 1.0, dx, dy)
        dx, dy, dz = dx - xi, dy - yi, dz - zi
        vx, vy, vz, px = columns(velocity_force, i, 0)
        py, pz = two_columns(velocity_force, i, SPIN + 1)
        ux, uy, uz, qx = columns(velocity_force, j, 0)
        qy, qz = two_columns(velocity_force, j, SPIN + 1)
        ux, uy = through_faces(pairs, slot, 1.0, ux, uy)
        qx, qy = through_faces(pairs, slot, 1.0, qx, qy)
        ux, uy, uz = vx - ux, vy - uy, vz - uz
        sx, sy, sz = px + qx, py + qy, pz + qz
        px, py, pz = px - qx, py - qy, pz - qz
        remember(history, slot, kept)
        d2 = dx * dx + dy * dy + dz * dz
        d = square_root(d2)
        inverse = where(d2 > 0.0, d * (1.0 / d2), 0.0)  # beside the root, not after it
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        if equal(law):
            r, m = position_radius[0, 3], grains.mass[0]
            reach, per_diameter = lanes_of(2.0 * r), lanes_of(0.5 / r)
            lj = li = 0.5 * d
            r_eff, m_eff, inertia = lanes_of(0.5 * r), lanes_of(0.5 * m), lanes_of(0.2 * m * r * r)
            ax, ay, az = li * sx, li * sy, li * sz
        else:
            if grains.species.shape[0] > 0:
                _laws_of_species(law, table, pairs.law_row, grains.species, i, j)
            mi, mj = entries(grains.mass, i), entries(grains.mass, j)
            reach, m_eff = ri + rj, mi * mj / (mi + mj)
            per_diameter = 0.5 / where(rj < ri, rj, ri)
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
            larger(reach - d, 0.0),  # not less by round-off
            (nx, ny, nz),
            (ux + ay * nz - az * ny, uy + az * nx - ax * nz, uz + ax * ny - ay * nx),
            ((hx - along * nx) * inverse_last, (hy - along * ny) * inverse_last, (hz - along * nz) * inverse_last),
            0.5 * (sx * nx + sy * ny + sz * nz),
        )
        there = first_lanes(count - c)
        force = contact_force(table, 0, energy_column, m_eff, r_eff, dt, touch, kept, 0)
        stored, rolled, twisted = force.stored, lanes_of(0.0), lanes_of(0.0)
        gx, gy, gz = where(there, force.x, 0.0), where(there, force.y, 0.0), where(there, force.z, 0.0)
        mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
        tx, ty, tz = li * mx, li * my, li * mz
        mx, my, mz = lj * mx, lj * my, lj * mz
        if resistance is not None:
            if resistance.rolling >= 0:
                (hx, hy, hz), e, rolled = rolling_torque(
                    table, 0, energy_column, r_eff, inertia, dt, force, touch, (px, py, pz), kept, 0, resistance.rolling
                )
                stored = stored + e
                hx, hy, hz = where(there, hx, 0.0), where(there, hy, 0.0), where(there, hz, 0.0)
                tx, ty, tz = tx + hx, ty + hy, tz + hz
                mx, my, mz = mx - hx, my - hy, mz - hz
            if resistance.twisting >= 0:
                spin = px * nx + py * ny + pz * nz
                torque, e, twisted = twisting_torque(
                    table, 0, energy_column, r_eff, inertia, dt, force, spin, kept, 0, resistance.twisting
                )
                stored = stored + e
                torque = where(there, torque, 0.0)
                tx, ty, tz = tx + torque * nx, ty + torque * ny, tz + torque * nz
                mx, my, mz = mx - torque * nx, my - torque * ny, mz - torque * nz
        keep(history, slot, kept)
        if record.shape[0] > 0:
            put_column(record, slot, 0, force.x)
            put_column(record, slot, 1, force.y)
            put_column(record, slot, 2, force.z)
        add_to_rows(velocity_force, i, FORCE, None, None, (gx, gy, gz, tx, ty, tz))
        gx, gy = through_faces(pairs, slot, -1.0, gx, gy)
        mx, my = through_faces(pairs, slot, -1.0, mx, my)
        add_to_rows(velocity_force, j, FORCE, chunks.reaction, place, (-gx, -gy, -gz, mx, my, mz))
        depth = touch.delta * per_diameter
        if largest_lane(depth) > deepest:
            deepest, deepest_at = deepest_of(depth, i, deepest, deepest_at)
        if energy_column is not None:
            sums = (
                sums[0] + where(there, stored, 0.0), sums[1] + where(there, force.lost_n, 0.0),
                sums[2] + where(there, force.lost_t, 0.0), sums[3] + where(there, force.lost_s, 0.0),
                sums[4] + where(there, rolled, 0.0), sums[5] + where(there, twisted, 0.0),
            )  # fmt: skip
    if energy_column is not None:
        elastic, lost_n = elastic + sum_of_lanes(sums[0]), lost_n + sum_of_lanes(sums[1])
        lost_t, lost_s = lost_t + sum_of_lanes(sums[2]), lost_s + sum_of_lanes(sums[3])
        if resistance is not None:
            lost_r, lost_w = lost_r + sum_of_lanes(sums[4]), lost_w + sum_of_lanes(sums[5])
    return Tally(contacts + count, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)
