"""Compiled search for contacts among the pairs of the list, and the pulls of those that attract each other.

The slots of a chunk are looked through eight at a time. Contacts are noted, and computed eight at a time when there is
room for no more (`particles.dem.pair_contacts`); what a pair has pulled goes to its grains at once. Incomplete
vectors repeat the last slot; their results are masked.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, from_integers, mask_of_first, movemask, select, splat
from geometry.kernels.simd_math import prefetch_rows, sqrt
from geometry.kernels.simd_tables import (
    eight_indices,
    gather,
    gather_column,
    gather_columns,
    gather_two_columns,
    load,
    movemask_at_least,
    scatter_add,
)
from particles.dem.attraction_kernel import ACROSS, COLUMN, pulls_at
from particles.dem.box_kernel import (
    add_pull_virial,
    moved_to_image,
    moved_to_images,
    swept_to_image,
    swept_to_images,
)
from particles.dem.contact_kernel import released_by_springs
from particles.laws.springs import equal

ROOM = 24 * LANES  # contacts that are noted at a time: with few, the last eight are often not full
# rows of what is noted of a contact: slot in the list, place in the buffer of reactions (-1 without); and the places of
# the eight pairs that are being looked at
SLOT, PLACE, PLACE_OF_PAIR, N_NOTED = range(4)


def pair_scratch(n_chunks: int) -> np.ndarray:
    """Return scratch of so many chunks: ``noted`` of `particles.dem.kernel_state.PairSlots`."""
    return np.zeros((n_chunks, N_NOTED, ROOM), dtype=np.int32)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def through_faces(pairs, slot, sign, x, y):
    """Components across the axis of eight vectors, rotated to the images of a sector (sign 1.0) or back (-1.0).

    Those of the partners in the slots ``slot`` come as their images have them; reactions on images go back.
    """
    return _rotate_to_images(pairs.turn, pairs.shift, slot, sign, x, y)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def image_places(pairs, slot, x, y, z):
    """Positions [m] of eight partners in the slots ``slot``, where their images stand."""
    x, y = _rotate_to_images(pairs.turn, pairs.shift, slot, 1.0, x, y)
    return moved_to_images(pairs.images, pairs.shift, slot, x, y, z)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def image_velocities(pairs, slot, x, y):
    """Velocities [m/s] across the axis, or along x and y, of eight partners as their images have them."""
    x, y = _rotate_to_images(pairs.turn, pairs.shift, slot, 1.0, x, y)
    return swept_to_images(pairs.images, pairs.shift, slot, x), y


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _rotate_to_images(turn, shift, slot, sign, x, y):
    if turn is not None:
        crossed = from_integers(gather(shift, slot))
        cosine, sine = select(crossed * crossed > 0.0, turn[0], 1.0), sign * turn[1] * crossed
        x, y = cosine * x - sine * y, sine * x + cosine * y
    return x, y


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _through_face(turn, shift, k, x, y):
    """As `through_faces`, of the partner in slot k alone."""
    if turn is not None:
        if shift[k] != 0:
            sine = turn[1] * shift[k]
            x, y = turn[0] * x - sine * y, sine * x + turn[0] * y
    return x, y


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _pull_eight(chunk, active, slot, place, i, j, away, sizes, law, attraction, grains, pairs):
    """Add the pulls of eight pairs of a chunk to those on their grains.

    ``away`` (3) are the centres of j from those of i [m], ``sizes`` (2) their radii [m].
    """
    dx, dy, dz = away
    d2 = dx * dx + dy * dy + dz * dz
    d = sqrt(d2)
    ri, rj = sizes
    if equal(law):
        gap = (d - 2.0 * ri) / ri
    else:
        gap = (d - (ri + rj)) * (ri + rj) / (2.0 * ri * rj)
    at_column, amplitude = gather_two_columns(attraction.pair, slot, COLUMN)
    pull = pulls_at(attraction, gap, at_column, amplitude, gather_column(attraction.pair, slot, ACROSS))
    pull = select(active, pull * select(d2 > 0.0, d * (1.0 / d2), 0.0), 0.0)
    gx, gy, gz, none = pull * dx, pull * dy, pull * dz, splat(0.0)
    scatter_add(attraction.force, i, 0, None, None, (gx, gy, gz, none))
    add_pull_virial(grains.virial, chunk, away, (gx, gy, gz))
    gx, gy = through_faces(pairs, slot, -1.0, gx, gy)
    scatter_add(attraction.force, j, 0, attraction.reaction, place, (-gx, -gy, -gz, none))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _released_by_pair(k, dt, law, resistance, energy_column, grains, pairs):
    """Energy released by the springs of pair k, which has separated [J] (4)."""
    position_radius, velocity_force, species = grains.position_radius, grains.velocity_force, grains.species
    i, j, kind = pairs.row[k], pairs.other[k], 0
    if species.shape[0] > 0:
        kind = pairs.law_row[species[i], species[j]]
    dx, dy = _through_face(pairs.turn, pairs.shift, k, position_radius[j, 0], position_radius[j, 1])
    dx, dy, dz = moved_to_image(pairs.images, pairs.shift, k, dx, dy, position_radius[j, 2])
    dx, dy, dz = dx - position_radius[i, 0], dy - position_radius[i, 1], dz - position_radius[i, 2]
    ri, rj = position_radius[i, 3], position_radius[j, 3]
    ux, uy = _through_face(pairs.turn, pairs.shift, k, velocity_force[j, 0], velocity_force[j, 1])
    ux = swept_to_image(pairs.images, pairs.shift, k, ux)
    ux, uy, uz = velocity_force[i, 0] - ux, velocity_force[i, 1] - uy, velocity_force[i, 2] - velocity_force[j, 2]
    closing = (ux * dx + uy * dy + uz * dz) / sqrt(dx * dx + dy * dy + dz * dz)
    arm, closing = ri * rj / (ri + rj), closing * dt
    return released_by_springs(law, kind, resistance, energy_column, arm, closing, pairs.history, k)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _change(k, bits, changed, dt, law, resistance, energy_column, grains, pairs, released):
    """Pairs from slot k on that have met or separated, by their bits; adds the loss of the latter to ``released``."""
    for q in range(LANES):
        if (changed >> q) & 1:
            p = np.uint32(k + q)
            pairs.touching[p] = (bits >> q) & 1
            if pairs.touching[p] == 0:
                if energy_column is not None:
                    n, s, r, t = _released_by_pair(p, dt, law, resistance, energy_column, grains, pairs)
                    released = released[0] + n, released[1] + s, released[2] + r, released[3] + t
                for a in range(pairs.history.shape[1]):
                    pairs.history[p, a] = 0.0
    return released


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _bits_at(array, k, bound, n_slots):
    """Return which of the first ``n_slots`` of eight entries from k on are ``bound`` or more, as bits."""
    if n_slots == LANES:
        return movemask_at_least(array, k, bound)
    bits = 0
    for q in range(n_slots):
        bits |= (1 if array[np.uint32(k + q)] >= bound else 0) << q
    return bits


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def find_pair_contacts(chunk, cursor, dt, law, resistance, energy_column, attraction, grains, pairs, chunks, released):
    """Note contacts from the slot ``cursor[0]`` on, until the batch is full or the chunk ends; compute the pulls too.

    ``cursor`` is a slot and the last place used in the buffer of reactions. Returns the new one, how many contacts were
    noted, and ``released`` (4) [J] with the losses of the pairs that separated.
    """
    position_radius, touching, history = grains.position_radius, pairs.touching, pairs.history
    noted = pairs.noted[chunk]
    k, place = cursor
    end, count = chunks.start[chunk + 1], 0
    stop = pairs.start[end]
    last = stop - 1
    radius = position_radius[0, 3]
    alike = 4.0 * radius * radius
    while k < stop and count <= ROOM - LANES:
        slot = eight_indices(k, last)
        n_slots = min(stop - k, LANES)
        i, j = gather(pairs.row, slot), gather(pairs.other, slot)
        xi, yi, zi, ri = gather_columns(position_radius, i, 0)
        dx, dy, dz, rj = gather_columns(position_radius, j, 0)
        dx, dy, dz = image_places(pairs, slot, dx, dy, dz)
        dx, dy, dz = dx - xi, dy - yi, dz - zi
        reach2 = splat(alike)
        if not equal(law):
            reach2 = (ri + rj) * (ri + rj)
        now = movemask(dx * dx + dy * dy + dz * dz < reach2) & ((1 << n_slots) - 1)
        prefetch_rows(history, k, LANES)  # needed soon, and in no cache of a large scene
        # written in any case, kept by counting it: a branch would often be mispredicted
        crossing = _bits_at(pairs.other, k, end, n_slots)
        if crossing == 0:
            for q in range(LANES):
                c = np.uint32(count)
                noted[SLOT, c], noted[PLACE, c] = k + q, -1
                count += (now >> q) & 1
                if attraction is not None:
                    noted[PLACE_OF_PAIR, q] = -1
        else:
            for q in range(LANES):
                place += (crossing >> q) & 1
                c, here = np.uint32(count), place if (crossing >> q) & 1 else -1
                noted[SLOT, c], noted[PLACE, c], noted[PLACE_OF_PAIR, q] = k + q, here, here
                count += (now >> q) & 1
        changed = now ^ _bits_at(touching, k, 1, n_slots)
        if changed != 0:
            released = _change(k, now, changed, dt, law, resistance, energy_column, grains, pairs, released)
        if attraction is not None:
            for q in range(n_slots, LANES):  # what is repeated goes where the last one does: nobody else adds there
                noted[PLACE_OF_PAIR, q] = noted[PLACE_OF_PAIR, n_slots - 1]
            _pull_eight(
                chunk, mask_of_first(n_slots), slot, load(noted, PLACE_OF_PAIR, 0), i, j, (dx, dy, dz), (ri, rj), law,
                attraction, grains, pairs,
            )  # fmt: skip
        k += n_slots
    return (k, place), count, released
