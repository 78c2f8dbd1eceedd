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

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, mask_of_first
from geometry.kernels.simd_tables import eight_indices, gather, stack_table
from particles.dem import total_columns as column
from particles.dem.contact_lanes import MAX_REMEMBERED, contacts_in_lanes, law_in_lanes
from particles.dem.drift_kernel import add_drifted, drift_eight, none_drifted
from particles.dem.kernel_state import Tally
from particles.dem.pair_kernel import find_contacts
from particles.dem.wall_lanes import add_walls
from particles.laws.columns import N_LAW
from particles.laws.springs import with_rows


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def drift_rows(first, until, now, law, energy_column, attraction, grains, late, drifted):
    """Kick and drift of the grains from ``first`` up to ``until`` that are not ``late``; returns ``drifted``."""
    i = first
    while i < until:
        # as many as stand in a row without a late one, eight at most
        many = 0
        while many < LANES and i + many < until and late[np.uint32(i + many)] == 0:
            many += 1
        if many > 0:
            rows, there = eight_indices(i, i + many - 1), mask_of_first(many)
            drifted = drift_eight(rows, there, now, law, energy_column, attraction, grains, drifted)
        i += max(many, 1)
    return drifted


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep_rows(chunk, now, law, resistance, energy_column, attraction, grains, pairs, slots, walls, chunks, totals):
    """Rows of a chunk: contacts of each grain, then its kick and drift where no other chunk has a say."""
    for b in range(totals.chunk_bodies.shape[1]):
        for a in range(column.N_CHUNK_BODY):
            totals.chunk_bodies[chunk, b, a] = 0.0
    row = totals.chunk[chunk]
    row[:] = 0.0
    tally = Tally(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0), 0.0, -1)
    drifted = none_drifted()
    done, end = chunks.start[chunk], chunks.start[chunk + 1]
    cursor = pairs.start[done], chunks.cross_start[chunk] - 1
    gone = (0.0, 0.0, 0.0, 0.0)  # what pairs that parted have lost
    table = law_in_lanes(law, stack_table(N_LAW))
    wall_tables = with_rows(law, stack_table(N_LAW)), stack_table(MAX_REMEMBERED)
    while done < end:
        cursor, count, gone = find_contacts(
            chunk, cursor, now.dt, law, resistance, energy_column, attraction, grains, pairs, chunks, gone
        )
        tally = contacts_in_lanes(
            chunk, count, now.dt, law, table, resistance, energy_column, grains, pairs, chunks, tally
        )
        # grains whose rows have ended
        ended = np.int64(pairs.row[cursor[0]]) if cursor[0] < pairs.start[end] else end
        tally = add_walls(
            done, ended, chunk, now.dt, law, wall_tables, resistance, energy_column, attraction,
            grains, slots, walls, totals, tally,
        )  # fmt: skip
        drifted = drift_rows(done, ended, now, law, energy_column, attraction, grains, chunks.late, drifted)
        done = ended
    left = tally.left
    row[column.CONTACTS], row[column.ELASTIC] = tally.contacts, tally.elastic
    row[column.NORMAL_DAMPING], row[column.TANGENTIAL_DAMPING] = tally.normal + left[0] + gone[0], tally.tangential
    row[column.SLIDING] = tally.sliding + left[1] + gone[1]
    row[column.ROLLING], row[column.TWISTING] = tally.rolling + left[2] + gone[2], tally.twisting + left[3] + gone[3]
    row[column.MAX_OVERLAP], row[column.GRAIN] = tally.deepest, tally.deepest_at
    add_drifted(drifted, energy_column, row)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def finish_rows(chunk, now, law, energy_column, attraction, grains, chunks, totals):
    """The late grains of a chunk: reactions from earlier chunks, then kick and drift."""
    motion, cross, in_slot = grains.velocity_force, chunks.reaction, chunks.in_slot
    drifted = none_drifted()
    first, until = chunks.late_start[chunk], chunks.late_start[chunk + 1]
    for a in range(first, until):
        i = np.int64(chunks.late_grain[a])
        fx, fy, fz = motion[i, 6], motion[i, 7], motion[i, 8]
        tx, ty, tz = motion[i, 9], motion[i, 10], motion[i, 11]
        for p in range(chunks.in_start[a], chunks.in_start[a + 1]):
            q = in_slot[p]
            fx, fy, fz = fx + cross[q, 0], fy + cross[q, 1], fz + cross[q, 2]
            tx, ty, tz = tx + cross[q, 3], ty + cross[q, 4], tz + cross[q, 5]
            cross[q, 0] = cross[q, 1] = cross[q, 2] = cross[q, 3] = cross[q, 4] = cross[q, 5] = 0.0  # for the next step
        motion[i, 6], motion[i, 7], motion[i, 8] = fx, fy, fz
        motion[i, 9], motion[i, 10], motion[i, 11] = tx, ty, tz
        if attraction is not None:
            drawn, pulls = attraction.drawn, attraction.cross
            for p in range(chunks.in_start[a], chunks.in_start[a + 1]):
                q = in_slot[p]
                for b in range(3):
                    drawn[i, b] += pulls[q, b]
                    pulls[q, b] = 0.0
    for a in range(first, until, LANES):
        many = min(until - a, LANES)
        rows = gather(chunks.late_grain, eight_indices(a, a + many - 1))
        drifted = drift_eight(rows, mask_of_first(many), now, law, energy_column, attraction, grains, drifted)
    add_drifted(drifted, energy_column, totals.chunk[chunk])
