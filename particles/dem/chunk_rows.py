"""Compiled sweep over rows of the half list: forces on grain i and its later partners, its walls, its kick and drift.

Contacts are searched, computed and added to their grains a batch at a time (`particles.dem.pair_contacts`). A grain is
complete when its row has ended, because every pair stands in the row of its first grain: it is integrated after the
batch in which that happens, while it is in the cache. Only a grain that has a partner in an earlier chunk of rows is
``deferred``: other threads sweep that chunk at the same time, so its reactions come through a buffer with a place for
every such pair, and `finish_rows` adds them in the order of the pairs once all chunks are swept. Nothing depends on the
number of threads, bit for bit.

A lagged attraction pulls every pair of the list that it drives, touching or not; its sums are treated alike, in places
of their own.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first
from geometry.kernels.simd_tables import eight_indices, gather, stack_table
from particles.dem import total_columns as column
from particles.dem.box_kernel import clear_virial
from particles.dem.contact_kinematics import MAX_REMEMBERED
from particles.dem.drift_kernel import add_drifted, drift_eight, none_drifted
from particles.dem.kernel_state import Tally
from particles.dem.motion_columns import FORCE, TORQUE
from particles.dem.pair_contacts import broadcast_law, pair_contacts
from particles.dem.pair_search import find_pair_contacts
from particles.dem.wall_contacts import add_walls
from particles.laws.columns import N_LAW
from particles.laws.springs import with_rows


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep_rows(chunk, now, law, resistance, energy_column, attraction, grains, pairs, slots, walls, chunks, totals):
    """Rows of a chunk: forces on each grain, then its kick and drift unless it is deferred."""
    for b in range(totals.chunk_bodies.shape[1]):
        for a in range(column.N_CHUNK_BODY):
            totals.chunk_bodies[chunk, b, a] = 0.0
    totals.chunk[chunk][:] = 0.0
    clear_virial(grains.virial, chunk)
    tally, drifted = Tally(0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), 0.0, -1), none_drifted()
    released = (0.0, 0.0, 0.0, 0.0)  # lost with pairs that have separated
    table = broadcast_law(law, stack_table(N_LAW))
    wall_tables = with_rows(law, stack_table(N_LAW)), stack_table(MAX_REMEMBERED)
    done, end = chunks.start[chunk], chunks.start[chunk + 1]
    cursor = pairs.start[done], chunks.cross_start[chunk] - 1
    while done < end:
        # pairs, and their attraction: as many contacts as there is room for
        cursor, count, released = find_pair_contacts(
            chunk, cursor, now.dt, law, resistance, energy_column, attraction, grains, pairs, chunks, released
        )
        tally = pair_contacts(chunk, count, now.dt, law, table, resistance, energy_column, grains, pairs, chunks, tally)
        # walls, then kick and drift, of the grains whose rows have ended
        ended = np.int64(pairs.row[cursor[0]]) if cursor[0] < pairs.start[end] else end
        tally = add_walls(
            done, ended, chunk, now.dt, law, wall_tables, resistance, energy_column, attraction,
            grains, slots, walls, totals, tally,
        )  # fmt: skip
        drifted = _drift_rows(done, ended, now, law, energy_column, attraction, grains, chunks.deferred, drifted)
        done = ended
    _add_tally(tally, released, totals.chunk[chunk])
    add_drifted(chunk, drifted, energy_column, grains, totals.chunk[chunk])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def finish_rows(chunk, now, law, energy_column, attraction, grains, chunks, totals):
    """The deferred grains of a chunk: reactions from earlier chunks, then kick and drift."""
    motion, reaction, start, place = (
        grains.velocity_force,
        chunks.reaction,
        chunks.reaction_start,
        chunks.reaction_place,
    )
    first, end = chunks.deferred_start[chunk], chunks.deferred_start[chunk + 1]
    for a in range(first, end):
        i = np.int64(chunks.deferred_grain[a])
        fx, fy, fz = motion[i, FORCE], motion[i, FORCE + 1], motion[i, FORCE + 2]
        tx, ty, tz = motion[i, TORQUE], motion[i, TORQUE + 1], motion[i, TORQUE + 2]
        for p in range(start[a], start[a + 1]):
            q = place[p]
            fx, fy, fz = fx + reaction[q, 0], fy + reaction[q, 1], fz + reaction[q, 2]
            tx, ty, tz = tx + reaction[q, 3], ty + reaction[q, 4], tz + reaction[q, 5]
            for b in range(6):
                reaction[q, b] = 0.0  # for the next step
        motion[i, FORCE], motion[i, FORCE + 1], motion[i, FORCE + 2] = fx, fy, fz
        motion[i, TORQUE], motion[i, TORQUE + 1], motion[i, TORQUE + 2] = tx, ty, tz
        if attraction is not None:
            for p in range(start[a], start[a + 1]):
                for b in range(3):
                    attraction.force[i, b] += attraction.reaction[place[p], b]
                    attraction.reaction[place[p], b] = 0.0
    drifted = none_drifted()
    for a in range(first, end, LANES):
        count = min(end - a, LANES)
        rows = gather(chunks.deferred_grain, eight_indices(a, a + count - 1))
        drifted = drift_eight(rows, mask_of_first(count), now, law, energy_column, attraction, grains, drifted)
    add_drifted(chunk, drifted, energy_column, grains, totals.chunk[chunk])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _drift_rows(first, end, now, law, energy_column, attraction, grains, deferred, drifted):
    """Kick and drift of the grains from ``first`` up to ``end`` that are not deferred; returns ``drifted``."""
    i = first
    while i < end:
        # as many as stand in a row without a deferred one, eight at most
        count = 0
        while count < LANES and i + count < end and deferred[np.uint32(i + count)] == 0:
            count += 1
        if count > 0:
            rows, active = eight_indices(i, i + count - 1), mask_of_first(count)
            drifted = drift_eight(rows, active, now, law, energy_column, attraction, grains, drifted)
        i += max(count, 1)
    return drifted


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _add_tally(tally, released, row):
    """Put the energies and losses of the contacts of a chunk into the chunk's sums ``row``."""
    energies, walls = tally.energies, tally.released_energy
    row[column.CONTACTS], row[column.ELASTIC] = tally.contacts, energies[0]
    row[column.NORMAL_DAMPING], row[column.TANGENTIAL_DAMPING] = energies[1] + walls[0] + released[0], energies[2]
    row[column.SLIDING] = energies[3] + walls[1] + released[1]
    row[column.ROLLING] = energies[4] + walls[2] + released[2]
    row[column.TWISTING] = energies[5] + walls[3] + released[3]
    row[column.MAX_OVERLAP], row[column.GRAIN] = tally.max_overlap, tally.argmax_overlap
