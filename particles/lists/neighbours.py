"""Pairs of grains within a cut-off, by a grid of cells.

The list is a half list in compressed rows (CSR): row i holds its partners in
``other[start[i]:start[i+1]]``, every pair stands in one row only. In a cyclic sector, grains near the low
face get a ghost, turned by +angle, that grains near the high face see: a pair across the faces is (i, j,
shift = 1), its partner at R x_j.

Within a row partners stand in the order of the cells, x fastest: the list depends on the positions alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from particles.sector import CyclicSector


@dataclass(frozen=True, slots=True)
class PairList:
    """Half list of pairs.

    Attributes
    ----------
    start : ndarray of int64, shape (n + 1,)
        Row i is ``start[i]:start[i + 1]``.
    other : ndarray of int32, shape (p,)
        The partner j.
    shift : ndarray of int8, shape (p,)
        The partner's position is R(shift*angle) x_j; all zero without a sector.
    """

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.other)

    def rows(self) -> np.ndarray:
        """The grain i of each pair, int64, shape (p,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def incoming(self) -> tuple[np.ndarray, np.ndarray]:
        """The transposed index: (start (n + 1,), slot (p,)), the slots in which each grain is the partner."""
        start = np.zeros(len(self.start), dtype=np.int64)
        np.cumsum(np.bincount(self.other, minlength=len(self.start) - 1), out=start[1:])
        return start, _transpose(start, self.other)


def find_pairs(
    position: np.ndarray, cutoff: float, sector: CyclicSector | None = None, reach: np.ndarray | None = None
) -> PairList:
    """Every pair nearer than ``cutoff`` [m], once.

    Parameters
    ----------
    position : ndarray, shape (n, 3)
        Centres [m]; in a sector inside the wedge, or not further than a fifth of the cut-off outside.
    cutoff : float
        Largest distance of centres [m].
    sector : CyclicSector, optional
        Adds the pairs across its faces.
    reach : ndarray, shape (n,), optional
        Keeps only pairs nearer than ``reach[i] + reach[j]`` [m] (grains of different size).

    Raises
    ------
    ValueError
        If the cut-off is not positive or the sector is too narrow for it.
    """
    if not 0.0 < cutoff < np.inf:
        raise ValueError(f"cut-off = {cutoff * 1e3:g} mm; allowed: more than 0 and finite")
    n = len(position)
    near = np.full(n, 0.5 * cutoff) if reach is None else reach
    ghost = np.zeros(0, dtype=np.int64)
    everywhere = position
    if sector is not None:
        sector.require_width(position, cutoff)
        # the low face is the half-plane theta = 0: a ghost is needed where the distance y to it is within
        # reach; the fifth is for partners that have drifted out of the high face since they were last
        # wrapped
        ghost = np.flatnonzero((position[:, 1] < 1.2 * cutoff) & (position[:, 0] > 0.0))
        everywhere = np.concatenate([position, position[ghost] @ sector.rotation(1).T])
    order, cell_start, low, size, shape = _cells(everywhere, cutoff)
    start = np.zeros(n + 1, dtype=np.int64)
    capacity = 8 * n
    while True:
        other, shift = np.empty(capacity, dtype=np.int32), np.zeros(capacity, dtype=np.int8)
        found = _collect(n, everywhere, near, cutoff, ghost, order, cell_start, low, size, shape, start, other, shift)
        if found <= capacity:
            return PairList(start, other[:found].copy(), shift[:found].copy())
        capacity = found


def cell_order(position: np.ndarray, size: float) -> np.ndarray:
    """The order in which grains lie cell by cell (edge ``size`` [m]), x fastest; ties keep their order."""
    low = position.min(axis=0)
    cell = np.floor((position - low) / size).astype(np.int64)
    shape = cell.max(axis=0) + 1
    return np.argsort((cell[:, 2] * shape[1] + cell[:, 1]) * shape[0] + cell[:, 0], kind="stable")


def _cells(position: np.ndarray, cutoff: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, np.ndarray]:
    low, extent = position.min(axis=0), np.ptp(position, axis=0)
    size = cutoff * (1.0 + 1e-12)
    # few grains in a vast space: larger cells rather than more memory than the grains themselves need
    while np.prod(np.floor(extent / size) + 1.0) > 8.0 * len(position) + 1000.0:
        size *= 1.3
    shape = np.floor(extent / size).astype(np.int64) + 1
    cell = np.minimum(np.floor((position - low) / size).astype(np.int64), shape - 1)
    number = (cell[:, 2] * shape[1] + cell[:, 1]) * shape[0] + cell[:, 0]
    start = np.zeros(int(np.prod(shape)) + 1, dtype=np.int64)
    np.cumsum(np.bincount(number, minlength=len(start) - 1), out=start[1:])
    return np.argsort(number, kind="stable"), start, low, size, shape


@njit(cache=True, error_model="numpy")
def _collect(n, position, near, cutoff, ghost, order, cell_start, low, size, shape, start, other, shift):
    """Fill the rows; returns the number of pairs, which may exceed the capacity (then only counted)."""
    capacity = other.shape[0]
    found = 0
    for i in range(n):
        start[i] = found
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        cx = min(int((x - low[0]) / size), shape[0] - 1)
        cy = min(int((y - low[1]) / size), shape[1] - 1)
        cz = min(int((z - low[2]) / size), shape[2] - 1)
        for bz in range(max(cz - 1, 0), min(cz + 2, shape[2])):
            for by in range(max(cy - 1, 0), min(cy + 2, shape[1])):
                row = (bz * shape[1] + by) * shape[0]
                # three neighbouring cells along x are one contiguous run
                for k in range(cell_start[row + max(cx - 1, 0)], cell_start[row + min(cx + 2, shape[0])]):
                    g = order[k]
                    if g <= i:
                        continue
                    j = g if g < n else ghost[g - n]
                    dx, dy, dz = position[g, 0] - x, position[g, 1] - y, position[g, 2] - z
                    limit = min(cutoff, near[i] + near[j])
                    if dx * dx + dy * dy + dz * dz < limit * limit:
                        if found < capacity:
                            other[found] = j
                            shift[found] = 0 if g < n else 1
                        found += 1
    start[n] = found
    return found


@njit(cache=True, error_model="numpy")
def _transpose(start, other):
    cursor = start[:-1].copy()
    slot = np.empty(other.shape[0], dtype=np.int32)
    for k in range(other.shape[0]):
        j = other[k]
        slot[cursor[j]] = k
        cursor[j] += 1
    return slot
