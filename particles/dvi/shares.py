"""Shares of the contacts that threads sweep at the same time, with the same result for any number of threads.

Grains are stored cell by cell, layer upon layer along the longest side of the cloud. Shares are consecutive rows of
the list, thick enough for a row to have its partners in its own share and in the next one only. Those with even
numbers then touch no grain in common, nor do the odd ones: a sweep first does all even shares side by side, pairs and
walls of bodies of prescribed speed, then the odd ones, and at the end, alone, the walls of the free shafts, which all
grains share. It stays a Gauss-Seidel sweep, in another order.

The shares follow from the list alone, and sums are kept by share and added in the order of shares: no bit depends on
the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from geometry.inner_functions import inner
from particles.dvi.couples import couple_residual, sweep_couples
from particles.dvi.gauss_seidel import IJ, residual, sweep_loads, sweep_pairs, sweep_walls
from particles.dvi.history import N_PRODUCTS, extrapolate, gather, remember

WORTH_SHARING = 2000  # grains; for fewer the gain is small beside the longer compilation
COUNTS = (64, 48, 32, 24, 16, 12, 8, 4, 1)  # of shares: as many even as odd ones, for two threads or four
N_SUMS = 16  # whole lines of the cache


class Shares(NamedTuple):
    """c shares of the rows.

    Attributes
    ----------
    rows : ndarray of int64, shape (c + 1,)
        Share k holds the rows rows[k] to rows[k + 1].
    pairs, walls : ndarray of int64, shapes (c + 1,), (c + 2,)
        The same for the contacts of a step; the last share of walls is that of the free shafts.
    sums, body_sums : ndarray, shapes (c + 1, N_SUMS), (c + 1, n_bodies, N_BODY_SUMS)
        What each share has added up or found.
    near : ndarray of uint8, shape (p,)
        1 for pairs of the list that are contacts of the step.
    met_index, met_slot, met : ndarray
        Wall contacts as the shares meet them, from their first slot in the list on.
    ends : ndarray of int64, shape (c,)
        Where those of each share end.
    """

    rows: np.ndarray
    pairs: np.ndarray
    walls: np.ndarray
    sums: np.ndarray
    body_sums: np.ndarray
    near: np.ndarray
    met_index: np.ndarray
    met_slot: np.ndarray
    met: np.ndarray
    ends: np.ndarray


def make_shares(
    pair_start: np.ndarray, pair_other: np.ndarray, wall_start: np.ndarray, body_sums: tuple[int, int], columns: int
) -> Shares | None:
    """Shares of a half list ``pair_start`` (n + 1,), ``pair_other`` (p,) with ``wall_start`` (n + 1,).

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
    return Shares(
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


@inner(error_model="numpy", fastmath={"contract"})
def sort_walls(rows, walls, first, ends, body, from_index, from_slot, from_row, index, slot, row):
    """Put wall contacts in the order of shares, those of free shafts last; returns how many there are.

    Share c has met those from first[rows[c]] to ends[c].
    """
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


@inner(error_model="numpy", fastmath={"contract"})
def _sweep(p0, p1, w0, w1, convex, relax, soft, couples, grain, body, pair_index, pair, wall_index, wall):
    """Impulses of pairs p0 to p1 and walls w0 to w1, then their couples; returns the largest change [m/s]."""
    a = sweep_pairs(p0, p1, convex, relax, soft, grain, pair_index, pair)
    b = sweep_walls(w0, w1, convex, relax, soft, grain, body, wall_index, wall)
    change = np.sqrt(max(a, b))
    if couples[0].shape[0] > 0:
        turned = sweep_couples(
            relax, soft, grain, body, pair_index[p0:p1], pair[p0:p1], wall_index[w0:w1], wall[w0:w1],
            couples[1][p0:p1], couples[2][w0:w1],
        )  # fmt: skip
        change = max(change, turned)
    return change


@inner(parallel=True, error_model="numpy", fastmath={"contract"})
def sweep_shares(convex, relax, soft, couples, grain, body, pair_index, pair, wall_index, wall, pairs, walls, sums):
    """One sweep over everything; returns the largest change [m/s]."""
    count = pairs.shape[0] - 1
    for odd in range(2):
        for half in prange((count + 1 - odd) // 2):
            c = 2 * half + odd
            sums[c, 0] = _sweep(
                pairs[c], pairs[c + 1], walls[c], walls[c + 1], convex, relax, soft, couples,
                grain, body, pair_index, pair, wall_index, wall,
            )  # fmt: skip
    largest = _sweep(
        0, 0, walls[count], walls[count + 1], convex, relax, soft, couples,
        grain, body, pair_index, pair, wall_index, wall,
    )  # fmt: skip
    sweep_loads(body)
    for c in range(count):
        largest = max(largest, sums[c, 0])
    return largest


@inner(parallel=True, error_model="numpy", fastmath={"contract"})
def residual_of_shares(convex, soft, couples, grain, body, pair_index, pair, wall_index, wall, pairs, walls, sums):
    """Largest natural map over all contacts [m/s], all at the same velocities."""
    count = pairs.shape[0] - 1
    for c in prange(count + 1):
        p0, p1 = pairs[c], pairs[min(c + 1, count)]
        w0, w1 = walls[c], walls[c + 1]
        worst = residual(convex, soft, grain, body, pair_index[p0:p1], pair[p0:p1], wall_index[w0:w1], wall[w0:w1])
        if couples[0].shape[0] > 0:
            turning = couple_residual(
                soft, grain, body, pair_index[p0:p1], pair[p0:p1], wall_index[w0:w1], wall[w0:w1],
                couples[1][p0:p1], couples[2][w0:w1],
            )  # fmt: skip
            worst = max(worst, turning)
        sums[c, 0] = worst
    largest = 0.0
    for c in range(count + 1):
        largest = max(largest, sums[c, 0])
    return largest


@inner(error_model="numpy", fastmath={"contract"})
def _part(c, rows, pairs, walls):
    """What share c has of the vectors of `particles.dvi.history`; c = number of shares: the free shafts."""
    count = rows.shape[0] - 1
    after = min(c + 1, count)
    return pairs[c], pairs[after], walls[c], walls[c + 1], rows[c], rows[after], 1 if c == count else 0


@inner(error_model="numpy", fastmath={"contract"})
def _add_products(products, sums):
    for q in range(N_PRODUCTS):
        products[q] = 0.0
        for c in range(sums.shape[0]):
            products[q] += sums[c, q]


@inner(parallel=True, error_model="numpy", fastmath={"contract"})
def gather_shares(g, r, weight, f, products, grain, body, pair, wall, couples, rows, pairs, walls, sums):
    """`gather` by shares."""
    for c in prange(rows.shape[0]):
        gather(_part(c, rows, pairs, walls), g, r, weight, f, sums[c], grain, body, pair, wall, couples)
    _add_products(products, sums)


@inner(parallel=True, error_model="numpy", fastmath={"contract"})
def remember_shares(
    better, first, slot, known, g, old_g, best_g, f, old_f, d_g, d_f, products, grain, body, pair, wall, couples,
    rows, pairs, walls, sums,
):  # fmt: skip
    """`remember` by shares."""
    for c in prange(rows.shape[0]):
        remember(
            _part(c, rows, pairs, walls), better, first, slot, known, g, old_g, best_g, f, old_f, d_g, d_f, sums[c],
            grain, body, pair, wall, couples,
        )  # fmt: skip
    _add_products(products, sums)


@inner(parallel=True, error_model="numpy", fastmath={"contract"})
def extrapolate_shares(r, g, c, known, d_g, grain, body, pair, wall, couples, rows, pairs, walls):
    """`extrapolate` by shares."""
    for k in prange(rows.shape[0]):
        extrapolate(_part(k, rows, pairs, walls), r, g, c, known, d_g, grain, body, pair, wall, couples)
