"""Compiled kernels of the search for pairs: rows of partners, grains by the size of their reach, places in grids.

They stand in one file because a cached kernel does not notice a change of a callee in another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from geometry.inner_functions import inner
from particles.neighbours.cells import MARGIN

FEW = 8  # grains on a line of cells: rarely more at two to the cell
SHORT = 32  # partners up to which all are compared with all to sort them
# columns of a grid's row in `Search.grids`; AXIS and COUNT have three
AXIS, COUNT, BEGIN, END, TABLE, NUMBER = 0, 3, 6, 7, 8, 9
# columns of its row in `Search.lengths`; LOW and INVERSE have three
LOW, INVERSE, REACH = 0, 3, 6


class Piece(NamedTuple):
    """Room for some rows of the list.

    Attributes
    ----------
    other, shift : ndarray of int32 and int8, shape (room,)
        Partners and their shifts.
    near, key : ndarray of int32 and float, shape (room,)
        Scratch: candidates of a row, then codes and squared distances [m^2] of its partners.
    rank : ndarray of int64, shape (SHORT,)
        Scratch: places of the partners of a short row.
    """

    other: np.ndarray
    shift: np.ndarray
    near: np.ndarray
    key: np.ndarray
    rank: np.ndarray


class Search(NamedTuple):
    """Grids of cells over each other, one a level of size, and what lies in them: what the kernel needs.

    Attributes
    ----------
    limit : float
        Largest interaction distance [m].
    grids, lengths : ndarray, shapes (g, 10) int64, (g, 7) float64
        A grid a row with the columns named above: those of grains first, then those of ghosts.
    own : int
        Number of grids with grains in them.
    ordered : int
        The grid by whose cells all grains stand in order; -1 if there is none.
    beside_face : ndarray of bool, shape (n,) or (0,)
        Which grains stand near a face of the sector: only these see ghosts.
    slot : ndarray of int32, shape (n,)
        Entry of each grain.
    entry, code : ndarray, shapes (m, 4) float64, (m,) int32
        x, y, z and reach [m] of grains and ghosts, cell by cell; whose image it is: 4 j + 1 + shift.
    table, number : ndarray, shapes (c,) int32, (e,) int64
        Tables of starts one behind the other; cell numbers of the entries of grids that have none.
    """

    limit: float
    grids: np.ndarray
    lengths: np.ndarray
    own: int
    ordered: int
    beside_face: np.ndarray
    slot: np.ndarray
    entry: np.ndarray
    code: np.ndarray
    table: np.ndarray
    number: np.ndarray


@njit(cache=True, error_model="numpy", nogil=True)
def fill_rows(search, row, stop, start, piece):
    """Fill rows from ``row`` on; returns the row at which the room ended, or ``stop``, and the pairs found."""
    limit, grids, lengths, own, ordered, beside_face, slot, entry, code, table, number = search
    other, shift, near, key, rank = piece
    room, found = other.shape[0], 0
    after = 0  # first entry of the ordered grid that has a higher number than i
    if ordered >= 0:
        after = _first_from(4 * row, code, grids[ordered, BEGIN], grids[ordered, END])
    for i in range(row, stop):
        me, last_code = slot[i], 4 * i + 3
        x, y, z, r = entry[me, 0], entry[me, 1], entry[me, 2], entry[me, 3]
        m = 0
        for g in range(grids.shape[0]):
            if g == own and not beside_face[i]:
                break
            begin, end = grids[g, BEGIN], grids[g, END]
            # at least half as wide as a cell, hence twice its margin
            width = (1.0 + 2.0 * MARGIN) * min(limit, r + lengths[g, REACH])
            u0 = entry[me, grids[g, AXIS]] - lengths[g, LOW]
            u1 = entry[me, grids[g, AXIS + 1]] - lengths[g, LOW + 1]
            u2 = entry[me, grids[g, AXIS + 2]] - lengths[g, LOW + 2]
            a0, a1 = _span(u0, width, lengths[g, INVERSE], grids[g, COUNT])
            b0, b1 = _span(u1, width, lengths[g, INVERSE + 1], grids[g, COUNT + 1])
            c0, c1 = _span(u2, width, lengths[g, INVERSE + 2], grids[g, COUNT + 2])
            if a0 == a1 or b0 == b1:
                continue
            first, first_b = begin, b0
            if g == ordered:  # lines before the grain's own hold lower numbers only
                while after < end and code[after] <= last_code:
                    after += 1
                first = after
                c0, first_b = int(u2 * lengths[g, INVERSE + 2]), int(u1 * lengths[g, INVERSE + 1])
            everywhere = (c1 - c0) * (b1 - b0) > end - begin  # more lines than grains: look at all of these
            if everywhere:
                b1, c1 = first_b + 1, c0 + 1
            for c in range(c0, c1):
                for b in range(first_b, b1):
                    line = (c * grids[g, COUNT + 1] + b) * grids[g, COUNT]
                    if everywhere:
                        lo, hi = begin, end
                    elif grids[g, TABLE] >= 0:
                        line += grids[g, TABLE]
                        lo, hi = begin + table[line + a0], begin + table[line + a1]
                    else:
                        shelf = grids[g, NUMBER]
                        lo = _first_from(line + a0, number, shelf, shelf + end - begin)
                        hi = _first_from(line + a1, number, lo, shelf + end - begin) + begin - shelf
                        lo += begin - shelf
                    lo = max(lo, first)
                    length = max(hi - lo, 0)
                    if m + length + FEW > room:
                        return i, found
                    for k in range(FEW):  # mostly enough, and without a branch on the length
                        near[m + k] = lo + k
                    for k in range(FEW, length):
                        near[m + k] = lo + k
                    m += length
                first_b = b0
        if found + m > room:
            return i, found
        partners = 0
        for k in range(m):
            e = near[k]
            dx, dy, dz = entry[e, 0] - x, entry[e, 1] - y, entry[e, 2] - z
            square = dx * dx + dy * dy + dz * dz
            width = min(limit, r + entry[e, 3])
            # written in any case, kept by counting it: a branch would be mispredicted every other time
            near[partners], key[partners] = code[e], square
            partners += 1 if (square < width * width) & (code[e] > last_code) else 0
        if partners > SHORT:
            _heap_sort(key, near, partners)
            for k in range(partners):
                other[found + k] = near[k]
        else:
            for k in range(partners):
                place = 0
                for q in range(k):
                    behind = 1 if (key[q] > key[k]) | ((key[q] == key[k]) & (near[q] > near[k])) else 0
                    rank[q] += behind
                    place += 1 - behind
                rank[k] = place
            for k in range(partners):
                other[found + rank[k]] = near[k]
        if beside_face.shape[0] > 0:
            for k in range(found, found + partners):
                shift[k] = (other[k] & 3) - 1
        for k in range(found, found + partners):
            other[k] >>= 2
        start[i + 1] = partners
        found += partners
    return stop, found


@inner(error_model="numpy")
def _span(u, width, inverse, count):
    """Cells from .. to (exclusive) of one axis that [u - width, u + width] touches; both zero if there are none."""
    low, high = (u - width) * inverse, (u + width) * inverse
    if high < 0.0 or low >= count:
        return 0, 0
    return int(max(low, 0.0)), int(min(high, count - 1.0)) + 1


@inner(error_model="numpy")
def _first_from(value, ascending, begin, end):
    """First place in ``ascending[begin:end]`` that holds ``value`` or more."""
    while begin < end:
        middle = (begin + end) // 2
        if ascending[middle] < value:
            begin = middle + 1
        else:
            end = middle
    return begin


@inner(error_model="numpy")
def _heap_sort(key, near, count):
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


@njit(cache=True, error_model="numpy")
def place(position, reach, code, member, order, entry, entry_code):
    """Entries of a grid's grains in the order of its cells."""
    for k in range(member.shape[0]):
        i = member[order[k]]
        entry[k, 0], entry[k, 1], entry[k, 2] = position[i, 0], position[i, 1], position[i, 2]
        entry[k, 3] = reach[i]
        entry_code[k] = code[i]


@njit(cache=True, error_model="numpy")
def sort_by_level(reach, largest, member, first, top):
    """Grains of level 0, 1, ... one behind the other; ``first`` (levels + 1,), ``top`` (levels,) zero on entry."""
    levels = top.shape[0]
    for turn in range(2):  # count, then place
        for i in range(reach.shape[0]):
            level, bound = 0, 0.5 * largest
            while reach[i] <= bound and level < levels - 1:
                level, bound = level + 1, 0.5 * bound
            if turn == 0:
                first[level + 1] += 1
                top[level] = max(top[level], reach[i])
            else:
                member[first[level]] = i
                first[level] += 1
        if turn == 0:
            for k in range(levels):
                first[k + 1] += first[k]
    for k in range(levels, 0, -1):
        first[k] = first[k - 1]
    first[0] = 0


@njit(cache=True, error_model="numpy")
def transpose(start, other):
    cursor = start[:-1].copy()
    slot = np.empty(other.shape[0], dtype=np.int32)
    for k in range(other.shape[0]):
        j = other[k]
        slot[cursor[j]] = k
        cursor[j] += 1
    return slot
