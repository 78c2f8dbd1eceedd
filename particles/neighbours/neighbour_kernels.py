"""Compiled rows of partners: for each grain those that come after it and are near enough, nearest first."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from geometry.kernels.device_functions import device_function
from particles.neighbours.cells import AXIS, BEGIN, COUNT, END, INVERSE, LOW, MARGIN, NUMBER, REACH, TABLE
from particles.neighbours.search import MIDDLE, SHIFT_BITS, SHIFTS, Search, heap_sort, longer, make_search

SAMPLE = 8  # rows of a block that are looked at to know how many pairs a row has
FEW = 8  # grains on a line of cells: rarely more at two to the cell
SHORT = 32  # partners up to which all are compared with all to sort them
NOT_FINITE = -2  # a status of `find`


@njit(parallel=True, cache=True, error_model="numpy")
def find(points, ghosts, ghost_code, beside_face, limit, most, start):
    """Rows of partners of all grains; threads share blocks of them.

    Parameters
    ----------
    points, ghosts : ndarray, shapes (n, 4), (g, 4)
        Position and reach [m] of grains and of their images where space repeats.
    ghost_code, beside_face : ndarray, shapes (g,) int32, (n,) or (0,) bool
        As in `Search`.
    limit : float
        Largest interaction distance [m].
    most : int
        Rows that a thread fills at once.
    start : ndarray of int64, shape (n + 1,)
        Becomes the first pair of each row.

    Returns
    -------
    ordered : int
        As in `Search`; NOT_FINITE, and no rows, where a coordinate is not.
    other, shift : ndarray of int32 and int8, shapes (p,), (p,) or (0,)
        Partners and, with ``beside_face``, their shifts.
    """
    n = points.shape[0]
    finite, n_grids, own, ordered, grids, lengths, slot, entry, code, table, number = make_search(
        points, ghosts, ghost_code, limit
    )
    # made here, and flat: numba hands no other tuple to the threads
    search = Search(limit, beside_face, n_grids, own, ordered, grids, lengths, slot, entry, code, table, number)
    if not finite:
        return NOT_FINITE, np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int8)
    blocks = 2 * ((n + 2 * most - 1) // (2 * most))  # even: two threads have the same to do
    faces = 1 if beside_face.shape[0] > 0 else 0
    room = 0  # for the pairs of a block
    count = np.empty(blocks, dtype=np.int64)
    scratch = other = np.empty(0, dtype=np.int32)
    scratch_shift = shift = np.empty(0, dtype=np.int8)
    for turn in range(3):  # look at a few rows to know how long they are; fill them; put them together
        if turn == 1:
            sample = 0
            for b in range(blocks):
                sample += count[b]
            room = (n // blocks + 1) * (3 * sample // (2 * SAMPLE * blocks) + 4)
            scratch, scratch_shift = np.empty(blocks * room, dtype=np.int32), np.empty(faces * blocks * room, np.int8)
        elif turn == 2:
            start[0] = 0
            for i in range(n):
                start[i + 1] += start[i]
            other, shift = np.empty(start[n], dtype=np.int32), np.empty(faces * start[n], dtype=np.int8)
        for b in prange(blocks):
            block = np.int64(b)  # numba's own index is unsigned, and everything would be compiled for both
            row, stop = block * n // blocks, (block + 1) * n // blocks
            if turn == 2 and count[block] <= room:
                place = start[row]
                for k in range(count[block]):
                    other[place + k] = scratch[block * room + k]
                for k in range(faces * count[block]):
                    shift[place + k] = scratch_shift[block * room + k]
                continue
            # where there was no room for all: once more, now that it is known
            again = turn == 2
            begin, space = (start[row], count[block]) if again else (block * room, room)
            rows = (other, shift) if again else (scratch, scratch_shift)
            lengths = np.empty(n + 1, dtype=np.int64) if again else start
            stop = min(stop, row + SAMPLE) if turn == 0 else stop
            count[block] = fill_rows(search, row, stop, lengths, rows, begin, space)
    return ordered, other, shift


@device_function(error_model="numpy")
def fill_rows(search, row, stop, start, pairs, begin, room):
    """Rows from ``row`` to ``stop``, from place ``begin`` of ``pairs`` (partners, shifts) on; returns their pairs.

    The length of row i goes into ``start[i + 1]``. Rows that find no room are counted only.
    """
    limit, beside_face, n_grids, own, ordered, grids, lengths, slot, entry, code, table, number = search
    other, shift = pairs
    near, key, rank = np.empty(256, dtype=np.int32), np.empty(256), np.empty(SHORT, dtype=np.int64)
    total = np.int64(0)
    after = 0  # first entry of the ordered grid that has a higher number than i
    if ordered >= 0:
        after = _first_from(SHIFTS * row, code, grids[ordered, BEGIN], grids[ordered, END])
    for i in range(row, stop):
        me, last_code = slot[i], SHIFTS * i + SHIFTS - 1
        x, y, z, r = entry[me, 0], entry[me, 1], entry[me, 2], entry[me, 3]
        m = 0
        for g in range(n_grids):
            if g == own and not beside_face[i]:
                break
            first_entry, end = grids[g, BEGIN], grids[g, END]
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
            first, first_b = first_entry, b0
            if g == ordered:  # lines before the grain's own hold lower numbers only
                while after < end and code[after] <= last_code:
                    after += 1
                first = after
                c0, first_b = int(u2 * lengths[g, INVERSE + 2]), int(u1 * lengths[g, INVERSE + 1])
            everywhere = (c1 - c0) * (b1 - b0) > end - first_entry  # more lines than grains: look at all of these
            if everywhere:
                b1, c1 = first_b + 1, c0 + 1
            for c in range(c0, c1):
                for b in range(first_b, b1):
                    line = (c * grids[g, COUNT + 1] + b) * grids[g, COUNT]
                    if everywhere:
                        lo, hi = first_entry, end
                    elif grids[g, TABLE] >= 0:
                        line += grids[g, TABLE]
                        lo, hi = first_entry + table[line + a0], first_entry + table[line + a1]
                    else:
                        shelf = grids[g, NUMBER]
                        lo = _first_from(line + a0, number, shelf, shelf + end - first_entry)
                        hi = _first_from(line + a1, number, lo, shelf + end - first_entry) + first_entry - shelf
                        lo += first_entry - shelf
                    lo = max(lo, first)
                    length = max(hi - lo, 0)
                    if m + length + FEW > near.shape[0]:
                        near = longer(near, 2 * (m + length + FEW))
                    for k in range(FEW):  # mostly enough, and without a branch on the length
                        near[m + k] = lo + k
                    for k in range(FEW, length):
                        near[m + k] = lo + k
                    m += length
                first_b = b0
        if key.shape[0] < near.shape[0]:
            key = np.empty(near.shape[0])
        kept = np.uint64(0)  # unsigned places are not asked whether they count from the end
        for k in range(m):
            e = np.uint64(near[k])
            dx, dy, dz = entry[e, 0] - x, entry[e, 1] - y, entry[e, 2] - z
            square = dx * dx + dy * dy + dz * dz
            width = min(limit, r + entry[e, 3])
            now = code[e]
            # written in any case, kept by counting it: a branch would be mispredicted every other time
            near[kept], key[kept] = now, square
            kept += np.uint64((square < width * width) & (now > last_code))
        partners = np.int64(kept)
        start[i + 1] = partners
        total += partners
        if total > room:
            continue
        place = begin + total - partners
        if partners > SHORT:
            heap_sort(key, near, partners)
            for k in range(partners):
                other[place + k] = near[k]
        else:
            for k in range(partners):
                before = 0
                for q in range(k):
                    behind = 1 if (key[q] > key[k]) | ((key[q] == key[k]) & (near[q] > near[k])) else 0
                    rank[q] += behind
                    before += 1 - behind
                rank[k] = before
            for k in range(partners):
                other[place + rank[k]] = near[k]
        if beside_face.shape[0] > 0:
            for k in range(place, place + partners):
                shift[k] = (other[k] & (SHIFTS - 1)) - MIDDLE
        for k in range(place, place + partners):
            other[k] >>= SHIFT_BITS
    return total


@device_function(error_model="numpy")
def _span(u, width, inverse, count):
    """Cells from .. to (exclusive) of one axis that [u - width, u + width] touches; both zero if there are none."""
    low, high = (u - width) * inverse, (u + width) * inverse
    if high < 0.0 or low >= count:
        return 0, 0
    return int(max(low, 0.0)), int(min(high, count - 1.0)) + 1


@device_function(error_model="numpy")
def _first_from(value, ascending, begin, end):
    """First place in ``ascending[begin:end]`` that holds ``value`` or more."""
    while begin < end:
        middle = (begin + end) // 2
        if ascending[middle] < value:
            begin = middle + 1
        else:
            end = middle
    return begin
