"""Compiled search for pairs: grains by the size of their reach, and their places in a grid for each size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from geometry.inner_functions import inner
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


class Search(NamedTuple):
    """Grids of cells over each other, one a level of size, and what lies in them.

    Attributes
    ----------
    limit : float
        Largest interaction distance [m].
    beside_face : ndarray of bool, shape (n,) or (0,)
        Which grains stand near a face of the sector: only these see ghosts.
    n_grids, own : int
        Number of grids, and of those with grains in them.
    ordered : int
        The grid by whose cells all grains stand in order; -1 if there is none.
    grids, lengths : ndarray, shapes (g, N_GRID) int64, (g, N_LENGTH) float64
        A grid a row with the columns of `particles.neighbours.cells`: those of grains first, then those of ghosts.
    slot : ndarray of int32, shape (n,)
        Entry of each grain.
    entry, code : ndarray, shapes (m, 4) float64, (m,) int32
        x, y, z and reach [m] of grains and ghosts, cell by cell; whose image it is: 4 j + 1 + shift.
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


@inner(error_model="numpy")
def make_search(points, ghosts, ghost_code, limit):
    """Sort grains, and their ghosts beyond the faces, into the cells of their levels.

    Returns whether all coordinates are finite, and what a `Search` has from ``n_grids`` on.
    """
    n, m = points.shape[0], points.shape[0] + ghosts.shape[0]
    grids, lengths = np.empty((2 * LEVELS, N_GRID), dtype=np.int64), np.empty((2 * LEVELS, N_LENGTH))
    entry, code, slot = np.empty((m, 4)), np.empty(m, dtype=np.int32), np.empty(n, dtype=np.int32)
    table, number = np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int64)
    low, high = np.empty(3), np.empty(3)
    member, first, top = np.empty(n, dtype=np.int32), np.empty(LEVELS + 1, dtype=np.int64), np.empty(LEVELS)
    here, order = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    n_grids, own, ordered, begin, finite = 0, 0, -1, 0, True
    for cloud in range(2):
        x = points if cloud == 0 else ghosts
        if x.shape[0] > n:
            member = np.empty(x.shape[0], dtype=np.int32)
            here, order = np.empty(x.shape[0], dtype=np.int64), np.empty(x.shape[0], dtype=np.int64)
        if x.shape[0] > 0:
            finite &= bounds(x, low, high)
            sort_by_level(x[:, 3], member, first, top)
        for level in range(LEVELS):
            inside = first[level + 1] - first[level]
            if x.shape[0] == 0 or inside == 0 or not finite:
                continue
            mine, places, now = member[first[level] : first[level + 1]], order[:inside], here[:inside]
            grid, length = grids[n_grids], lengths[n_grids]
            cells = lay_grid(low, high, min(limit, 2.0 * top[level]), grid, length)
            ascends = number_grains(x, mine, grid, length, now)
            grid[BEGIN], grid[END], grid[TABLE], grid[NUMBER], length[REACH] = begin, begin + inside, -1, -1, top[level]
            if cells <= TABLE_PER_GRAIN * m + FIXED_TABLE:
                grid[TABLE] = table.shape[0]
                table = longer(table, table.shape[0], table.shape[0] + cells + 1)
                counting_sort(now, table[grid[TABLE] :], places)
            else:
                for k in range(inside):
                    places[k] = k
                if not ascends:
                    heap_sort(now, places, inside)
                grid[NUMBER] = number.shape[0]
                number = longer(number, number.shape[0], number.shape[0] + inside)
                for k in range(inside):
                    number[grid[NUMBER] + k] = now[k]
            for k in range(inside):
                i = mine[places[k]]
                for a in range(4):
                    entry[begin + k, a] = x[i, a]
                code[begin + k] = 4 * i + 1 if cloud == 0 else ghost_code[i]
            n_grids, begin = n_grids + 1, begin + inside
            # the last level is the finest: do all grains stand in the order of its cells?
            if cloud == 0 and begin == n and ascends and (n_grids == 1 or number_grains(x, None, grid, length, here)):
                ordered = n_grids - 1
        if cloud == 0:
            own = n_grids
            for k in range(begin):
                slot[code[k] >> 2] = k
    return finite, n_grids, own, ordered, grids, lengths, slot, entry, code, table, number


@inner(error_model="numpy")
def sort_by_level(reach, member, first, top):
    """Grains of like reach, one level behind the other; level k begins at ``first[k]``, its largest is ``top[k]`` [m].

    The largest grains first; within a level grains keep their order. Empty levels have no grains between two firsts.
    """
    largest, smallest = 0.0, np.inf
    for i in range(reach.shape[0]):
        largest, smallest = max(largest, reach[i]), min(smallest, reach[i])
    for level in range(LEVELS):
        first[level], top[level] = 0, 0.0
    first[LEVELS] = 0
    if smallest > 0.5 * largest:
        for level in range(LEVELS):
            first[level + 1] = reach.shape[0]
        for i in range(reach.shape[0]):
            member[i] = i
        top[0] = largest
        return
    for turn in range(2):  # count, then place
        for i in range(reach.shape[0]):
            level, bound = 0, 0.5 * largest
            while reach[i] <= bound and level < LEVELS - 1:
                level, bound = level + 1, 0.5 * bound
            if turn == 0:
                first[level + 1] += 1
                top[level] = max(top[level], reach[i])
            else:
                member[first[level]] = i
                first[level] += 1
        if turn == 0:
            for k in range(LEVELS):
                first[k + 1] += first[k]
    for k in range(LEVELS, 0, -1):
        first[k] = first[k - 1]
    first[0] = 0


@njit(cache=True, error_model="numpy")
def finest_level(reach):
    """The largest reach [m] among the grains of the last level."""
    member, first, top = np.empty(len(reach), dtype=np.int32), np.empty(LEVELS + 1, dtype=np.int64), np.empty(LEVELS)
    sort_by_level(reach, member, first, top)
    finest = 0.0
    for level in range(LEVELS):
        if first[level + 1] > first[level]:
            finest = top[level]
    return finest


@inner(error_model="numpy")
def longer(array, kept, length):
    """A copy of the first ``kept`` places in an array of this length."""
    made = np.empty(length, dtype=array.dtype)
    for k in range(kept):
        made[k] = array[k]
    return made


@inner(error_model="numpy")
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


@inner(error_model="numpy")
def _before(key, whose, other_key, other_whose):
    return key < other_key or (key == other_key and whose < other_whose)
