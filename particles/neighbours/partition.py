"""Chunks of rows that threads share, and the reactions that pass from one chunk to another.

Rows are consecutive grains, sorted by cells; a chunk ends where its part of the work does. How many there are follows
from the number of grains alone, and never from the threads, so that every sum is the same with any number of them. A
pair whose grains lie in different chunks has its place in a buffer; its second grain is *deferred*: it can only be
moved when the other chunk has written there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function

GRAIN, PAIR, CONTACT, WALL = 1, 2, 7, 12  # measured: a grain, a listed pair, one that touches, a wall near a grain
LAYERS = 4  # of grains in a chunk, at the least: thinner chunks have more interface than inside


class Chunks(NamedTuple):
    """Partition of n rows with p pairs.

    Attributes
    ----------
    start : ndarray of int64, shape (c + 1,)
        Chunk k holds the rows start[k] to start[k + 1].
    cross_start : ndarray of int64, shape (c + 1,)
        First place in the buffer of each chunk's pairs with later chunks, in the order of the list.
    reaction : ndarray, shape (x, 6)
        The buffer: force [N] and torque [N m] of such a pair.
    deferred : ndarray of uint8, shape (n,)
        1 for grains that wait.
    deferred_start, deferred_grain : ndarray of int64, shape (c + 1,) and int32, shape (l,)
        The deferred grains, and an equal part of them for each chunk: the first chunk has none of its own.
    reaction_start, reaction_place : ndarray of int64, shape (l + 1,) and int32, shape (x,)
        Places in the buffer that each deferred grain has to add, in order.
    """

    start: np.ndarray
    cross_start: np.ndarray
    reaction: np.ndarray
    deferred: np.ndarray
    deferred_start: np.ndarray
    deferred_grain: np.ndarray
    reaction_start: np.ndarray
    reaction_place: np.ndarray


def chunk_count(n: int) -> int:
    """Number of chunks of ``n`` rows: one layer of a cube of n grains is the cube root of n squared.

    Even, so that two threads have the same to do.
    """
    return 1 if n < 500 else 2 * max(1, round(0.5 * n ** (1.0 / 3.0) / LAYERS))


def make_chunks(
    pair_start: np.ndarray,
    pair_other: np.ndarray,
    touching: np.ndarray,
    wall_start: np.ndarray,
    start: np.ndarray | None = None,
) -> Chunks:
    """Share out the rows of a half list and of ``wall_start`` (n + 1,).

    Parameters
    ----------
    pair_start, pair_other, touching : ndarray, shapes (n + 1,), (p,), (p,)
        The half list, and which of its pairs touch.
    start : ndarray of int64, shape (c + 1,), optional
        Chunks that were made before, of the same list.
    """
    n = len(pair_start) - 1
    if start is None:
        start = np.empty(min(chunk_count(n), n) + 1, dtype=np.int64)
        _even(pair_start, touching, wall_start, start)
    return _share(pair_start, pair_other, start)


@device_function(without_refcounts=True, error_model="numpy")
def _work_before(i, pair_start, contacts, wall_start):
    """Work of the rows before row i."""
    return GRAIN * i + PAIR * pair_start[i] + CONTACT * contacts[pair_start[i]] + WALL * wall_start[i]


@njit(cache=True, error_model="numpy")
def _even(pair_start, touching, wall_start, start):
    """Fill in the first row of each chunk, so that all have like work."""
    n, parts = pair_start.shape[0] - 1, start.shape[0] - 1
    contacts = np.empty(touching.shape[0] + 1, dtype=np.int64)  # before each slot
    count = contacts[0] = 0
    for k in range(touching.shape[0]):
        count += touching[k]
        contacts[k + 1] = count
    work = _work_before(n, pair_start, contacts, wall_start)
    for c in range(parts + 1):
        target, low, high = work * c / parts, 0, n  # the first grain before which there is so much work
        while low < high:
            middle = (low + high) // 2
            if _work_before(middle, pair_start, contacts, wall_start) < target:
                low = middle + 1
            else:
                high = middle
        start[c] = low
    start[0], start[parts] = 0, n


@njit(cache=True, error_model="numpy")
def _share(pair_start, pair_other, start):
    n, parts = pair_start.shape[0] - 1, start.shape[0] - 1
    cross_start = np.empty(parts + 1, dtype=np.int64)
    crossing, second = np.uint64(0), np.empty(pair_other.shape[0] + 1, dtype=np.int32)
    for c in range(parts):
        cross_start[c] = np.int64(crossing)
        for k in range(pair_start[start[c]], pair_start[start[c + 1]]):
            second[crossing] = pair_other[k]  # written in any case, kept by counting it
            crossing += np.uint64(1) if pair_other[k] >= start[c + 1] else np.uint64(0)
    cross_start[parts] = crossings = np.int64(crossing)
    arrivals = np.zeros(n, dtype=np.int32)
    for k in range(crossings):
        arrivals[second[k]] += 1
    deferred, deferred_start = np.empty(n, dtype=np.uint8), np.empty(parts + 1, dtype=np.int64)
    n_deferred = 0
    for i in range(n):
        deferred[i] = arrivals[i] > 0
        n_deferred += deferred[i]
    deferred_grain, reaction_start = np.empty(n_deferred, dtype=np.int32), np.empty(n_deferred + 1, dtype=np.int64)
    for c in range(parts + 1):
        deferred_start[c] = n_deferred * c // parts
    waiting = before = 0
    for i in range(n):
        if deferred[i] != 0:
            deferred_grain[waiting], reaction_start[waiting] = i, before
            before, arrivals[i] = before + arrivals[i], before  # from here on its next place
            waiting += 1
    reaction_start[n_deferred] = before
    reaction_place = np.empty(crossings, dtype=np.int32)
    for k in range(crossings):
        reaction_place[arrivals[second[k]]] = k
        arrivals[second[k]] += 1
    return Chunks(
        start, cross_start, np.zeros((crossings, 6)), deferred, deferred_start, deferred_grain, reaction_start,
        reaction_place,
    )  # fmt: skip
