"""Compiled search for contacts among the pairs of the list, and the pulls of those that attract each other.

The slots of a chunk are looked through one after the other. Contacts are noted, and computed side by side when there is
room for no more (`particles.dem.contact_lanes`); what a pair has pulled goes to its grains at once.
"""

from __future__ import annotations

import numpy as np

from geometry.inner_functions import inner
from geometry.lane_functions import prefetch_row, square_root
from geometry.lane_tables import eight_of, put_eight
from geometry.lanes import LANES, where
from particles.dem.attraction_kernel import ACROSS, AMPLITUDE, COLUMN, place_of_gap, pull_at
from particles.dem.contact_kernel import left_in_springs
from particles.laws.springs import equal

ROOM = 4 * LANES  # contacts noted, or pairs looked through, at a time
# rows of what is noted of a contact: slot in the list, place in the buffer of reactions (-1 without)
SLOT, PLACE, N_NOTED = range(3)
# rows of a pair that may pull: centre of j from that of i (3) [m], radii [m]; 1/distance [1/m], gap [radii], its place
AWAY, RADIUS_I, RADIUS_J, INVERSE, GAP, GAP_PLACE, N_APART = 0, 3, 4, 5, 6, 7, 8


def pair_scratch(n_chunks: int) -> tuple[np.ndarray, np.ndarray]:
    """Scratch of so many chunks: ``apart`` and ``noted`` of `particles.dem.kernel_state.PairSlots`."""
    return np.ones((n_chunks, N_APART, ROOM)), np.zeros((n_chunks, N_NOTED, ROOM), dtype=np.int32)


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def through_face(turn, shift, k, x, y):
    """Components across the axis of a vector of the partner in slot k, as its image has them."""
    if turn is not None:
        if shift[k] != 0:
            sine = turn[1] * shift[k]
            x, y = turn[0] * x - sine * y, sine * x + turn[0] * y
    return x, y


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def back_through_face(turn, shift, k, x, y):
    """Components across the axis of a reaction on the image in slot k, as the partner itself has them."""
    if turn is not None:
        if shift[k] != 0:
            sine = turn[1] * shift[k]
            x, y = turn[0] * x + sine * y, turn[0] * y - sine * x
    return x, y


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mass_of(law, mass, i):
    """Mass of grain i [kg]; equal grains share one place in the cache."""
    return mass[0] if equal(law) else mass[i]


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _gaps(count, law, radius, held, apart):
    """Gaps of the first ``count`` pairs, eight side by side, and where they lie in the table of the attraction.

    ``radius`` [m] is that of grains that are all equal.
    """
    for c in range(0, count, LANES):
        dx, dy, dz = eight_of(apart, AWAY, c), eight_of(apart, AWAY + 1, c), eight_of(apart, AWAY + 2, c)
        d2 = dx * dx + dy * dy + dz * dz
        d = square_root(d2)
        if equal(law):
            gap = (d - 2.0 * radius) / radius
        else:
            ri, rj = eight_of(apart, RADIUS_I, c), eight_of(apart, RADIUS_J, c)
            gap = (d - (ri + rj)) * (ri + rj) / (2.0 * ri * rj)
        put_eight(apart, INVERSE, c, where(d2 > 0.0, d * (1.0 / d2), 0.0))
        put_eight(apart, GAP, c, gap)
        put_eight(apart, GAP_PLACE, c, place_of_gap(held, gap))


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def pull_pairs(chunk, first, until, place, law, attraction, grains, pairs, chunks):
    """Add the pulls of the slots ``first`` up to ``until``, whose vectors stand in ``apart``, to those on their grains.

    ``place`` is the last place in the buffer of reactions that was used before them.
    """
    apart, end = pairs.apart[chunk], chunks.start[chunk + 1]
    _gaps(until - first, law, grains.position_radius[0, 3], attraction, apart)
    for p in range(first, until):
        c, k = p - first, np.uint32(p)
        i, j = pairs.row[k], pairs.other[k]
        crossing = j >= end
        place += 1 if crossing else 0
        drive = attraction.pair
        pull = apart[INVERSE, c] * pull_at(
            attraction, apart[GAP, c], apart[GAP_PLACE, c], drive[k, COLUMN], drive[k, AMPLITUDE], drive[k, ACROSS]
        )
        gx, gy, gz = pull * apart[AWAY, c], pull * apart[AWAY + 1, c], pull * apart[AWAY + 2, c]
        attraction.drawn[i, 0] += gx
        attraction.drawn[i, 1] += gy
        attraction.drawn[i, 2] += gz
        gx, gy = back_through_face(pairs.turn, pairs.shift, k, gx, gy)
        if crossing:
            attraction.cross[place, 0], attraction.cross[place, 1], attraction.cross[place, 2] = gx, gy, gz
        else:
            attraction.drawn[j, 0] -= gx
            attraction.drawn[j, 1] -= gy
            attraction.drawn[j, 2] -= gz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def left_by_pair(i, k, away, dt, law, resistance, energy_column, grains, pairs):
    """What the springs of pair k, which has parted and lies ``away`` (4: vector and its square) [m, m^2], held [J]."""
    position_radius, velocity_force, species = grains.position_radius, grains.velocity_force, grains.species
    j, kind = pairs.other[k], 0
    if species.shape[0] > 0:
        kind = pairs.law_row[species[i], species[j]]
    dx, dy, dz, d2 = away
    ri, rj = position_radius[i, 3], position_radius[j, 3]
    ux, uy = through_face(pairs.turn, pairs.shift, k, velocity_force[j, 0], velocity_force[j, 1])
    ux, uy, uz = velocity_force[i, 0] - ux, velocity_force[i, 1] - uy, velocity_force[i, 2] - velocity_force[j, 2]
    closing = (ux * dx + uy * dy + uz * dz) / square_root(d2)
    return left_in_springs(law, kind, resistance, energy_column, ri * rj / (ri + rj), closing * dt, pairs.history, k)


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def find_contacts(chunk, cursor, dt, law, resistance, energy_column, attraction, grains, pairs, chunks, left):
    """Note contacts from the slot ``cursor[0]`` on, until the batch is full or the chunk ends; pulls are found besides.

    Returns the new cursor, how many contacts were noted, and ``left`` (4) [J] with what pairs that parted have lost.
    ``cursor`` is a slot and the last place used in the buffer of reactions.
    """
    position_radius, touching, history = grains.position_radius, pairs.touching, pairs.history
    noted = pairs.noted[chunk]
    k, place = cursor
    end, count = chunks.start[chunk + 1], 0
    stop = pairs.start[end]
    radius = position_radius[0, 3]
    alike = 4.0 * radius * radius
    while k < stop and count < ROOM:
        until, before_these = min(stop, k + ROOM - count), place
        for p in range(k, until):
            q = np.uint32(p)
            i, j = pairs.row[q], pairs.other[q]
            crossing = j >= end
            place += 1 if crossing else 0
            jx, jy = through_face(pairs.turn, pairs.shift, q, position_radius[j, 0], position_radius[j, 1])
            dx, dy = jx - position_radius[i, 0], jy - position_radius[i, 1]
            dz = position_radius[j, 2] - position_radius[i, 2]
            d2 = dx * dx + dy * dy + dz * dz
            reach2 = alike
            if not equal(law):
                reach2 = (position_radius[i, 3] + position_radius[j, 3]) ** 2
            if attraction is not None:
                apart, n = pairs.apart[chunk], np.uint32(p - k)
                apart[AWAY, n], apart[AWAY + 1, n], apart[AWAY + 2, n] = dx, dy, dz
                if not equal(law):
                    apart[RADIUS_I, n], apart[RADIUS_J, n] = position_radius[i, 3], position_radius[j, 3]
            before, now = touching[q], 1 if d2 < reach2 else 0
            touching[q] = now
            # written in any case, kept by counting it: a branch would often be mispredicted
            prefetch_row(history, p)  # what the contact remembers is needed soon, and is in no cache of a large scene
            c = np.uint32(count)
            noted[SLOT, c], noted[PLACE, c] = q, place if crossing else -1
            count += now
            if before > now:
                if energy_column is not None:
                    lost = left_by_pair(i, q, (dx, dy, dz, d2), dt, law, resistance, energy_column, grains, pairs)
                    left = left[0] + lost[0], left[1] + lost[1], left[2] + lost[2], left[3] + lost[3]
                for a in range(history.shape[1]):
                    history[q, a] = 0.0
        if attraction is not None:
            pull_pairs(chunk, k, until, before_these, law, attraction, grains, pairs, chunks)
        k = until
    return (k, place), count, left
