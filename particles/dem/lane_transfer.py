"""Compiled traffic between grains and lanes: contacts are gathered, and their forces scattered to both grains.

A pair stands in the row of its first grain. Its reaction goes to the second one directly, or, where that lies in a
later chunk of rows, into the chunk's places in the buffer (`particles.neighbours.partition`).

Lever arms sum to the distance of centres, and the two torques are l_i n x F and l_j n x F: angular momentum is
conserved to round-off.
"""

from __future__ import annotations

import numpy as np

from geometry.inner_functions import inner
from particles.dem import lane_fields as at
from particles.dem.contact_kernel import LAST_ROLLING, LAST_TWISTING
from particles.dem.contact_lanes import by_lane
from particles.dem.kernel_state import Tally
from particles.dem.pair_kernel import back_through_face, through_face
from particles.laws.columns import N_LAW
from particles.laws.springs import equal, varies


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def fill_law(chunk, kind, c, law, blocks):
    """Put the law's row ``kind`` beside contact c of the batch."""
    lane = by_lane(blocks, chunk, c >> at.SHIFT, at.LAW)
    for a in range(N_LAW):
        lane[c & at.LAST, a] = law.rows[kind, a]


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def gather_contacts(chunk, count, law, resistance, energy_column, grains, pairs):
    """Lay grains and history of the noted contacts into the lanes of the batch."""
    position_radius, velocity_force, species = grains.position_radius, grains.velocity_force, grains.species
    noted, blocks, history = pairs.noted[chunk], pairs.blocks, pairs.history
    for c in range(count):
        lane, q = by_lane(blocks, chunk, c >> at.SHIFT, 0), c & at.LAST
        k = np.uint32(noted[at.SLOT, c])
        i = pairs.row[k]
        j = pairs.other[k]
        x, y = through_face(pairs.turn, pairs.shift, k, position_radius[j, 0], position_radius[j, 1])
        lane[q, at.CENTRE] = x - position_radius[i, 0]
        lane[q, at.CENTRE + 1] = y - position_radius[i, 1]
        lane[q, at.CENTRE + 2] = position_radius[j, 2] - position_radius[i, 2]
        x, y = through_face(pairs.turn, pairs.shift, k, velocity_force[j, 0], velocity_force[j, 1])
        lane[q, at.VELOCITY] = velocity_force[i, 0] - x
        lane[q, at.VELOCITY + 1] = velocity_force[i, 1] - y
        lane[q, at.VELOCITY + 2] = velocity_force[i, 2] - velocity_force[j, 2]
        x, y = through_face(pairs.turn, pairs.shift, k, velocity_force[j, 3], velocity_force[j, 4])
        z = velocity_force[j, 5]
        lane[q, at.SPINS] = velocity_force[i, 3] + x
        lane[q, at.SPINS + 1] = velocity_force[i, 4] + y
        lane[q, at.SPINS + 2] = velocity_force[i, 5] + z
        if resistance is not None or not equal(law):
            lane[q, at.TURNING] = velocity_force[i, 3] - x
            lane[q, at.TURNING + 1] = velocity_force[i, 4] - y
            lane[q, at.TURNING + 2] = velocity_force[i, 5] - z
        if not equal(law):
            lane[q, at.RADIUS_I], lane[q, at.RADIUS_J] = position_radius[i, 3], position_radius[j, 3]
            lane[q, at.MASS_I], lane[q, at.MASS_J] = grains.mass[i], grains.mass[j]
            if species.shape[0] > 0:
                fill_law(chunk, pairs.law_row[species[i], species[j]], c, law, blocks)
        kept = by_lane(blocks, chunk, c >> at.SHIFT, at.HISTORY)
        copy_history(law, resistance, energy_column, history, k, kept, q, True)


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def copy_history(law, resistance, energy_column, history, k, kept, q, gather):
    """Copy what contact k remembers from its slot to its lane, or back; each has columns of its own."""
    _copy(history, k, 0, kept, q, 0, 3, gather)
    if varies(law):
        _copy(history, k, 3, kept, q, 3, 3, gather)
    if resistance is not None:
        if resistance.rolling >= 0:
            _copy(history, k, resistance.rolling, kept, q, at.ROLLING_COLUMN, 3, gather)
        if resistance.twisting >= 0:
            _copy(history, k, resistance.twisting, kept, q, at.TWISTING_COLUMN, 1, gather)
    if energy_column is not None:
        _copy(history, k, energy_column, kept, q, at.ENERGY_COLUMN, 4, gather)
        if resistance is not None:
            if resistance.rolling >= 0:
                _copy(history, k, energy_column + LAST_ROLLING, kept, q, at.ENERGY_COLUMN + LAST_ROLLING, 3, gather)
            if resistance.twisting >= 0:
                _copy(history, k, energy_column + LAST_TWISTING, kept, q, at.ENERGY_COLUMN + LAST_TWISTING, 1, gather)


@inner(borrows=True, error_model="numpy", forceinline=True)
def _copy(history, k, column, kept, q, lane_column, many, gather):
    for a in range(many):
        if gather:
            kept[q, lane_column + a] = history[k, column + a]
        else:
            history[k, column + a] = kept[q, lane_column + a]


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def scatter_contacts(chunk, count, law, resistance, energy_column, grains, pairs, chunks, tally):
    """Give the forces in the lanes to the grains, in the order of the pairs; returns the tally."""
    velocity_force, record, cross, radius = grains.velocity_force, pairs.record, chunks.reaction, grains.position_radius
    noted, blocks, history = pairs.noted[chunk], pairs.blocks, pairs.history
    contacts, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at = tally
    for c in range(count):
        lane, q = by_lane(blocks, chunk, c >> at.SHIFT, 0), c & at.LAST
        k, place = np.uint32(noted[at.SLOT, c]), noted[at.PLACE, c]
        i = pairs.row[k]
        j = pairs.other[k]
        gx, gy, gz = lane[q, at.FORCE], lane[q, at.FORCE + 1], lane[q, at.FORCE + 2]
        tx, ty, tz = lane[q, at.TORQUE_I], lane[q, at.TORQUE_I + 1], lane[q, at.TORQUE_I + 2]
        if resistance is None and equal(law):
            mx, my, mz = tx, ty, tz
        else:
            mx, my, mz = lane[q, at.TORQUE_J], lane[q, at.TORQUE_J + 1], lane[q, at.TORQUE_J + 2]
        delta = lane[q, at.OVERLAP]
        if equal(law):
            deepest_at = i if delta > deepest else deepest_at
            deepest = max(deepest, delta)  # [m]; made a share of the diameter at the end
        else:
            least = 2.0 * min(radius[i, 3], radius[j, 3])
            if delta > deepest * least:
                deepest, deepest_at = delta / least, i
        if energy_column is not None:
            elastic += lane[q, at.STORED]
            lost_n += lane[q, at.LOST_N]
            lost_t += lane[q, at.LOST_T]
            lost_s += lane[q, at.LOST_S]
            if resistance is not None:
                lost_r += lane[q, at.LOST_R]
                lost_w += lane[q, at.LOST_W]
        copy_history(
            law, resistance, energy_column, history, k, by_lane(blocks, chunk, c >> at.SHIFT, at.HISTORY), q, False
        )
        if record.shape[0] > 0:
            record[k, 0], record[k, 1], record[k, 2] = gx, gy, gz
        velocity_force[i, 6] += gx
        velocity_force[i, 7] += gy
        velocity_force[i, 8] += gz
        velocity_force[i, 9] += tx
        velocity_force[i, 10] += ty
        velocity_force[i, 11] += tz
        gx, gy = back_through_face(pairs.turn, pairs.shift, k, gx, gy)
        mx, my = back_through_face(pairs.turn, pairs.shift, k, mx, my)
        if place >= 0:
            cross[place, 0], cross[place, 1], cross[place, 2] = gx, gy, gz
            cross[place, 3], cross[place, 4], cross[place, 5] = mx, my, mz
        else:
            velocity_force[j, 6] -= gx
            velocity_force[j, 7] -= gy
            velocity_force[j, 8] -= gz
            velocity_force[j, 9] += mx
            velocity_force[j, 10] += my
            velocity_force[j, 11] += mz
    return Tally(contacts + count, elastic, lost_n, lost_t, lost_s, lost_r, lost_w, left, deepest, deepest_at)
