"""Chunks of rows that threads share, and the reactions that pass from one chunk to another.

Rows are consecutive grains, sorted by cells; a chunk ends where its share of the work does. How many there are follows
from the number of grains alone, and never from the threads, so that every sum is the same with any number of them. A
pair whose grains lie in different chunks has its place in a buffer; its second grain is *late*: it can only be moved
when the other chunk has written there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

LAYERS = 4  # of grains in a chunk, at the least: thinner chunks have more interface than inside


class Chunks(NamedTuple):
    """How n rows with p pairs are shared out.

    Attributes
    ----------
    start : ndarray of int64, shape (c + 1,)
        Chunk k holds the rows start[k] to start[k + 1].
    cross_start : ndarray of int64, shape (c + 1,)
        First place in the buffer of each chunk's pairs with later chunks, in the order of the list.
    reaction : ndarray, shape (x, 6)
        The buffer: force [N] and torque [N m] of such a pair.
    late : ndarray of uint8, shape (n,)
        1 for grains that wait.
    late_start, late_grain : ndarray of int64, shape (c + 1,) and int32, shape (l,)
        The late grains of each chunk.
    in_start, in_slot : ndarray of int64, shape (l + 1,) and int32, shape (x,)
        Places in the buffer that each late grain has to add, in order.
    """

    start: np.ndarray
    cross_start: np.ndarray
    reaction: np.ndarray
    late: np.ndarray
    late_start: np.ndarray
    late_grain: np.ndarray
    in_start: np.ndarray
    in_slot: np.ndarray


def chunk_count(n: int) -> int:
    """Number of chunks of ``n`` rows: one layer of a cube of n grains is the cube root of n squared.

    Even, so that two threads have the same to do.
    """
    return 1 if n < 500 else 2 * max(1, round(0.5 * n ** (1.0 / 3.0) / LAYERS))


def make_chunks(pair_start: np.ndarray, pair_other: np.ndarray, wall_start: np.ndarray) -> Chunks:
    """Share out the rows of a half list ``pair_start`` (n + 1,), ``pair_other`` (p,), and ``wall_start`` (n + 1,)."""
    n = len(pair_start) - 1
    parts = min(chunk_count(n), n)
    # a grain costs about as much as two of its pairs, a wall as much as four
    work = pair_start + 4 * wall_start + 2 * np.arange(n + 1)
    start = np.searchsorted(work, work[-1] * np.arange(parts + 1) / parts).astype(np.int64)
    start[0], start[-1] = 0, n
    cross_start = np.zeros(parts + 1, dtype=np.int64)
    arrivals = np.zeros(n, dtype=np.int32)
    _count(start, pair_start, pair_other, cross_start, arrivals)
    crossing = int(cross_start[-1])
    late_grain = np.flatnonzero(arrivals).astype(np.int32)
    in_start = np.zeros(len(late_grain) + 1, dtype=np.int64)
    np.cumsum(arrivals[late_grain], out=in_start[1:])
    in_slot = np.empty(crossing, dtype=np.int32)
    place = np.zeros(n if crossing else 1, dtype=np.int32)
    place[late_grain] = in_start[:-1]
    _fill(start, pair_start, pair_other, cross_start, place, in_slot)
    late_start = np.searchsorted(late_grain, start).astype(np.int64)
    late = (arrivals > 0).astype(np.uint8)
    return Chunks(start, cross_start, np.zeros((crossing, 6)), late, late_start, late_grain, in_start, in_slot)


@njit(cache=True, error_model="numpy")
def _count(chunk, start, other, cross_start, arrivals):
    crossing = 0
    for c in range(chunk.shape[0] - 1):
        cross_start[c] = crossing
        for k in range(start[chunk[c]], start[chunk[c + 1]]):
            if other[k] >= chunk[c + 1]:
                crossing += 1
                arrivals[other[k]] += 1
    cross_start[chunk.shape[0] - 1] = crossing


@njit(cache=True, error_model="numpy")
def _fill(chunk, start, other, cross_start, place, in_slot):
    for c in range(chunk.shape[0] - 1):
        crossing = cross_start[c]
        for k in range(start[chunk[c]], start[chunk[c + 1]]):
            if other[k] >= chunk[c + 1]:
                in_slot[place[other[k]]] = crossing
                place[other[k]] += 1
                crossing += 1
