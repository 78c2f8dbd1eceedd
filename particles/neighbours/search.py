"""Compiled search for pairs: grains by the size of their reach, and their places in a grid for each size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.neighbours.cells import (
    BEGIN,
    END,
    FIXED_TABLE,
    N_GRID,
    N_LENGTH,
    NUMBER,
    REACH,
    TABLE,
    TABLE_PER_GRAIN,
    bounds,
    counting_sort,
    lay_grid,
    number_grains,
)

LEVELS = 31  # of size; grains smaller than 1e-9 of the largest share the last one
# an image of grain j has the code SHIFTS j + MIDDLE + shift
SHIFT_BITS = 6
SHIFTS, MIDDLE = 1 << SHIFT_BITS, 1 << (SHIFT_BITS - 1)
MOST_GRAINS = 2 ** (31 - SHIFT_BITS)


class Search(NamedTuple):
    """Grids of cells over each other, one a level of size, and what lies in them.

    Attributes
    ----------
    limit : float
        Largest interaction distance [m].
    beside_face : ndarray of bool, shape (n,) or (0,)
        Which grains stand near a face where space repeats: only these see ghosts.
    n_grids, own : int
        Number of grids, and of those with grains in them.
    ordered : int
        The grid by whose cells all grains stand in order; -1 if there is none.
    grids, lengths : ndarray, shapes (g, N_GRID) int64, (g, N_LENGTH) float64
        A grid a row with the columns of `particles.neighbours.cells`: those of grains first, then those of ghosts.
    slot : ndarray of int32, shape (n,)
        Entry of each grain.
    entry, code : ndarray, shapes (m, 4) float64, (m,) int32
        x, y, z and reach [m] of grains and ghosts, cell by cell; whose image it is, see SHIFTS.
    table, number : ndarray, shapes (c,) int32, (e,) int64
        Tables of starts one behind the other; cell numbers of the entries of grids that have none.
    """

    limit: float
    beside_face: np.ndarray
    n_grids: int
    own: int
    ordered: int
    grids: np.ndarray
    lengths: np.ndarray
    slot: np.ndarray
    entry: np.ndarray
    code: np.ndarray
    table: np.ndarray
    number: np.ndarray


@device_function(error_model="numpy")
def make_search(points, ghosts, ghost_code, limit):
    """Sort grains, and their ghosts beyond the faces, into the cells of their levels.

    Returns whether all coordinates are finite, and what a `Search` has from ``n_grids`` on.
    """
    n, m = points.shape[0], points.shape[0] + ghosts.shape[0]
    grids, lengths = np.empty((2 * LEVELS, N_GRID), dtype=np.int64), np.empty((2 * LEVELS, N_LENGTH))
    entry, code, slot = np.empty((m, 4)), np.empty(m, dtype=np.int32), np.empty(n, dtype=np.int32)
    here, place = np.empty(max(n, m - n), dtype=np.int64), np.empty(max(n, m - n), dtype=np.int64)
    table, number = np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int64)
    low, high, first, top = np.empty(3), np.empty(3), np.empty(LEVELS + 1, dtype=np.int64), np.empty(LEVELS)
    n_grids, own, ordered, begin, finite = 0, 0, -1, 0, True
    for cloud in range(2):
        these = points if cloud == 0 else ghosts
        if these.shape[0] == 0:
            break
        finite &= bounds(these, low, high)
        if not finite:
            break
        x, member = sort_by_level(these, first, top)
        for level in range(LEVELS):
            a, b = first[level], first[level + 1]
            if a == b:
                continue
            grid, length = grids[n_grids], lengths[n_grids]
            cells = lay_grid(low, high, min(limit, 2.0 * top[level]), grid, length)
            ascends = number_grains(x, a, b, grid, length, here)
            grid[BEGIN], grid[END], grid[TABLE], grid[NUMBER] = begin, begin + b - a, -1, -1
            length[REACH] = top[level]
            if cells <= TABLE_PER_GRAIN * m + FIXED_TABLE:
                grid[TABLE] = table.shape[0]
                table = longer(table, table.shape[0] + cells + 1)
                counting_sort(here, a, b, table, cells, place)
            else:
                grid[NUMBER] = begin
                number = longer(number, m)
                _sort_places(here, a, b, place)
            for k in range(b - a):
                e, i = begin + k, place[a + k]
                entry[e, 0], entry[e, 1], entry[e, 2], entry[e, 3] = x[i, 0], x[i, 1], x[i, 2], x[i, 3]
                code[e] = SHIFTS * member[i] + MIDDLE if cloud == 0 else ghost_code[member[i]]
                if grid[NUMBER] >= 0:
                    number[e] = here[i]
            n_grids, begin = n_grids + 1, begin + b - a
        if cloud == 0:
            own = n_grids
            for k in range(n):
                slot[code[k] >> SHIFT_BITS] = k
            # the last level is the finest: do all grains stand in the order of its cells?
            if ascends and (own == 1 or number_grains(points, 0, n, grid, length, here)):
                ordered = own - 1
    return finite, n_grids, own, ordered, grids, lengths, slot, entry, code, table, number


@device_function(error_model="numpy")
def sort_by_level(points, first, top):
    """Points of like reach, one level behind the other, and which these are.

    Level k begins at ``first[k]``, its largest reach is ``top[k]`` [m]. The largest come first; within a level points
    keep their order.
    """
    n, largest, smallest = points.shape[0], 0.0, np.inf
    for i in range(n):
        largest, smallest = max(largest, points[i, 3]), min(smallest, points[i, 3])
    for level in range(LEVELS):
        first[level], top[level] = 0, 0.0
    first[LEVELS] = 0
    member, ordered_points = np.empty(n, dtype=np.int32), points
    if smallest <= 0.5 * largest:
        ordered_points = np.empty((n, 4))
    for turn in range(2):  # count, then place
        for i in range(n):
            level, bound = 0, 0.5 * largest
            while points[i, 3] <= bound and level < LEVELS - 1:
                level, bound = level + 1, 0.5 * bound
            if turn == 0:
                first[level + 1] += 1
                top[level] = max(top[level], points[i, 3])
            else:
                k = first[level]
                member[k] = i
                ordered_points[k, 0], ordered_points[k, 1], ordered_points[k, 2], ordered_points[k, 3] = (
                    points[i, 0],
                    points[i, 1],
                    points[i, 2],
                    points[i, 3],
                )
                first[level] += 1
        if turn == 0:
            for k in range(LEVELS):
                first[k + 1] += first[k]
    for k in range(LEVELS, 0, -1):
        first[k] = first[k - 1]
    first[0] = 0
    return ordered_points, member


@device_function(error_model="numpy")
def _sort_places(number, begin, end, place):
    """Stable order of ``number[begin:end]``, in the same places of ``place``: shell sort, no table of cells."""
    for k in range(begin, end):
        place[k] = k
    gap = 1
    while 9 * gap < end - begin:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(begin + gap, end):
            now, q = place[k], k - gap
            while q >= begin and (
                number[place[q]] > number[now] or (number[place[q]] == number[now] and place[q] > now)
            ):
                place[q + gap] = place[q]
                q -= gap
            place[q + gap] = now
        gap //= 3


@device_function(error_model="numpy")
def longer(array, length):
    """A copy at the beginning of so many places."""
    made = np.empty(length, dtype=array.dtype)
    for k in range(array.shape[0]):
        made[k] = array[k]
    return made


@device_function(error_model="numpy")
def heap_sort(key, near, count):
    """Sort the first ``count`` of both by key, equal ones by near."""
    for end in range(2 * count - 1, 0, -1):
        # first half of the turns: make a heap from the middle down; second half: its top goes to the end
        if end >= count:
            root, size = (end - count) // 2, count
        else:
            key[0], key[end] = key[end], key[0]
            near[0], near[end] = near[end], near[0]
            root, size = 0, end
        moved, whose = key[root], near[root]
        while True:
            child = 2 * root + 1
            if child >= size:
                break
            if child + 1 < size and _before(key[child], near[child], key[child + 1], near[child + 1]):
                child += 1
            if not _before(moved, whose, key[child], near[child]):
                break
            key[root], near[root] = key[child], near[child]
            root = child
        key[root], near[root] = moved, whose


@device_function(error_model="numpy")
def _before(key, whose, other_key, other_whose):
    return key < other_key or (key == other_key and whose < other_whose)
