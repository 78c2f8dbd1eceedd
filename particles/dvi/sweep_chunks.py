"""Chunks of the contacts that threads sweep at the same time, with the same result for any number of threads.

Grains are stored cell by cell, layer upon layer along the longest side of the cloud. Chunks are consecutive rows of
the list, thick enough for a row to have its partners in its own chunk and in the next one only. Those with even
numbers then touch no grain in common, nor do the odd ones: a sweep first does all even chunks at the same time, pairs
and walls of bodies of prescribed speed, then the odd ones, and at the end, alone, the walls of the free shafts, which
all grains share. It stays a Gauss-Seidel sweep, in another order.

The chunks follow from the list alone, and sums are kept by chunk and added in the order of chunks: no bit depends on
the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from geometry.kernels.device_functions import device_function
from particles.dvi.anderson_vectors import N_PRODUCTS, extrapolate, gather, store_change
from particles.dvi.contact_groups import group_contacts
from particles.dvi.contact_torques import residual, sweep_contact_torques
from particles.dvi.gauss_seidel import IJ, sweep_loads, sweep_pairs, sweep_walls
from particles.dvi.solver_state import Part

WORTH_SHARING = 2000  # grains; for fewer the gain is small against the longer compilation
COUNTS = (64, 48, 32, 24, 16, 12, 8, 4, 1)  # of chunks: as many even as odd ones, for two threads or four
N_SUMS = 16  # full lines of the cache


class SweepChunks(NamedTuple):
    """c chunks of the rows.

    Attributes
    ----------
    rows : ndarray of int64, shape (c + 1,)
        Chunk k holds the rows rows[k] to rows[k + 1].
    pairs, walls : ndarray of int64, shapes (c + 1,), (c + 2,)
        The same for the contacts of a step; the last chunk of walls is that of the free shafts.
    sums, body_sums : ndarray, shapes (c + 1, N_SUMS), (c + 1, n_bodies, N_BODY_SUMS)
        Sums and extremes of each chunk.
    near : ndarray of uint8, shape (p,)
        1 for pairs of the list that are contacts of the step.
    unsorted_index, unsorted_slot, unsorted_row : ndarray
        Wall contacts as the chunks find them, from their first slot in the list on.
    ends : ndarray of int64, shape (c,)
        Where those of each chunk end.
    """

    rows: np.ndarray
    pairs: np.ndarray
    walls: np.ndarray
    sums: np.ndarray
    body_sums: np.ndarray
    near: np.ndarray
    unsorted_index: np.ndarray
    unsorted_slot: np.ndarray
    unsorted_row: np.ndarray
    ends: np.ndarray


def make_sweep_chunks(
    pair_start: np.ndarray, pair_other: np.ndarray, wall_start: np.ndarray, body_sums: tuple[int, int], columns: int
) -> SweepChunks | None:
    """Return chunks of a half list ``pair_start`` (n + 1,), ``pair_other`` (p,) with ``wall_start`` (n + 1,).

    ``body_sums``: numbers of bodies and of their sums; ``columns``: of a wall contact. None where there are too few
    grains to share.
    """
    n = len(pair_start) - 1
    if n < WORTH_SHARING:
        return None
    furthest = np.empty(n, dtype=np.int64)
    _furthest(pair_start, pair_other, furthest)
    work = pair_start + wall_start
    for count in COUNTS:
        rows = np.searchsorted(work, work[-1] * np.arange(count + 1) / count).astype(np.int64)
        rows[0], rows[-1] = 0, n
        if np.all(furthest[rows[1:-1] - 1] < rows[2:]) and np.all(rows[1:] > rows[:-1]):
            break
    s = int(wall_start[-1])
    return SweepChunks(
        rows, np.zeros(count + 1, dtype=np.int64), np.zeros(count + 2, dtype=np.int64),
        np.zeros((count + 1, N_SUMS)), np.zeros((count + 1, *body_sums)), np.zeros(len(pair_other), dtype=np.uint8),
        np.zeros((s, 2), dtype=np.int32), np.zeros(s, dtype=np.int32), np.zeros((s, columns)),
        np.zeros(count, dtype=np.int64),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _furthest(start, other, furthest):
    """The last partner of all rows up to each."""
    last = -1
    for i in range(furthest.shape[0]):
        for k in range(start[i], start[i + 1]):
            last = max(last, other[k])
        furthest[i] = last


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sort_walls(chunk, slots, records):
    """Sort the wall contacts of the chunks, those of free shafts last; returns how many."""
    rows, walls, ends, from_index, from_slot, from_row = (
        chunk.rows, chunk.walls, chunk.ends, chunk.unsorted_index, chunk.unsorted_slot, chunk.unsorted_row,
    )  # fmt: skip
    first, slot, body, index, row = slots.start, slots.contact_slot, records.body, records.wall_index, records.wall
    to, count = 0, rows.shape[0] - 1
    for last in range(2):
        for c in range(count):
            if last == 0:
                walls[c] = to
            for k in range(first[rows[c]], ends[c]):
                if (body[from_index[k, 1], IJ] > 0.0) == (last == 1):
                    index[to, 0], index[to, 1], slot[to] = from_index[k, 0], from_index[k, 1], from_slot[k]
                    for q in range(row.shape[1]):
                        row[to, q] = from_row[k, q]
                    to += 1
        walls[count + last] = to
    return to


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def part_of(c, rows, pairs, walls):
    """Return what chunk c has of contacts and grains; c = number of chunks: what belongs to the free shafts."""
    count = rows.shape[0] - 1
    after = min(c + 1, count)
    return Part(pairs[c], pairs[after], walls[c], walls[c + 1], rows[c], rows[after], 1 if c == count else 0)


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def group_chunks(records, chunk):
    """`group_contacts` by chunks."""
    rows, pairs, walls = chunk.rows, chunk.pairs, chunk.walls
    count = rows.shape[0] - 1
    for odd in range(2):
        for half in prange((count + 1 - odd) // 2):
            group_contacts(part_of(2 * half + odd, rows, pairs, walls), records.body, IJ, records)
    group_contacts(part_of(count, rows, pairs, walls), records.body, IJ, records)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _sweep_part(part, convex, relax, compliance, records, contact_torques):
    """Impulses of a part, then its torques; returns the largest change [m/s]."""
    a = sweep_pairs(part.p0, part.p1, convex, relax, compliance, records)
    b = sweep_walls(part.w0, part.w1, convex, relax, compliance, records)
    change = np.sqrt(max(a, b))
    if contact_torques.law.shape[0] > 0:
        change = max(change, sweep_contact_torques(part, relax, compliance, records, contact_torques))
    return change


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def sweep_chunks(convex, relax, compliance, records, contact_torques, chunk):
    """One sweep over everything; returns the largest change [m/s]."""
    rows, pairs, walls, sums = chunk.rows, chunk.pairs, chunk.walls, chunk.sums
    count = rows.shape[0] - 1
    for odd in range(2):
        for half in prange((count + 1 - odd) // 2):
            c = 2 * half + odd
            part = part_of(c, rows, pairs, walls)
            sums[c, 0] = _sweep_part(part, convex, relax, compliance, records, contact_torques)
    largest = _sweep_part(part_of(count, rows, pairs, walls), convex, relax, compliance, records, contact_torques)
    sweep_loads(records.body)
    for c in range(count):
        largest = max(largest, sums[c, 0])
    return largest


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def residual_of_chunks(convex, compliance, records, contact_torques, chunk):
    """Largest natural map over all contacts [m/s], all at the same velocities."""
    rows, pairs, walls, sums = chunk.rows, chunk.pairs, chunk.walls, chunk.sums
    for c in prange(rows.shape[0]):
        sums[c, 0] = residual(part_of(c, rows, pairs, walls), convex, compliance, records, contact_torques)
    largest = 0.0
    for c in range(rows.shape[0]):
        largest = max(largest, sums[c, 0])
    return largest


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _add_products(products, sums):
    for q in range(N_PRODUCTS):
        products[q] = 0.0
        for c in range(sums.shape[0]):
            products[q] += sums[c, q]


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def gather_chunks(g, vectors, records, contact_torques, chunk):
    """`gather` by chunks."""
    rows, pairs, walls, sums = chunk.rows, chunk.pairs, chunk.walls, chunk.sums
    for c in prange(rows.shape[0]):
        gather(part_of(c, rows, pairs, walls), g, vectors, sums[c], records, contact_torques)
    _add_products(vectors.products, sums)


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def store_chunks(better, first, slot, known, vectors, records, contact_torques, chunk):
    """`store_change` by chunks."""
    rows, pairs, walls, sums = chunk.rows, chunk.pairs, chunk.walls, chunk.sums
    for c in prange(rows.shape[0]):
        part = part_of(c, rows, pairs, walls)
        store_change(part, better, first, slot, known, vectors, sums[c], records, contact_torques)
    _add_products(vectors.products, sums)


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def extrapolate_chunks(g, c, known, vectors, records, contact_torques, chunk):
    """`extrapolate` by chunks."""
    rows, pairs, walls = chunk.rows, chunk.pairs, chunk.walls
    for k in prange(rows.shape[0]):
        extrapolate(part_of(k, rows, pairs, walls), g, c, known, vectors, records, contact_torques)
