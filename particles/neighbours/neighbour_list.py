"""Pairs of grains near each other, by a hierarchy of cell grids.

The list is a half list in compressed rows (CSR): row i holds its partners j > i in
``other[start[i]:start[i+1]]``, nearest first. Every pair stands in one row only, also across the faces where
space repeats (`particles.periodicity`): there grains near a face get ghosts beyond the other one, and only a grain
of lower number sees these.

Grains of like size, to a factor of two of their reach, share a grid with cells as long as their largest
interaction (V. Ogarko, S. Luding, Comput. Phys. Commun. 183 (2012) 931, with levels of fixed ratio). Grain i
looks for partners j > i in the grids of all levels, its own, coarser and finer ones, in the cells that the sum
of the reaches covers. The row of i is thus complete after one visit, and rows do not depend on each other:
blocks of them may be filled by several threads, with the same result.

Grains may stand in any order. Sorted by `cell_order` with `finest_cell` they are searched about twice as fast,
because cells before a grain's own hold lower numbers only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from particles.neighbours import neighbour_kernels as kernels
from particles.neighbours.cells import cell_order, not_finite
from particles.neighbours.search import LEVELS, MIDDLE, MOST_GRAINS, SHIFTS
from particles.periodicity import Periodicity
from particles.threads import at_most

__all__ = ["PairList", "cell_order", "find_pairs", "finest_cell"]

BLOCK = 2048  # rows, at the most, that a thread fills at once
WORTH_SHARING = 500  # grains from which on a second thread is worth waking
BESIDE_FACE = 1.2  # cut-offs from a face within which a grain gets a ghost: the fifth is drift past the face


@dataclass(frozen=True, slots=True)
class PairList:
    """Half list of pairs.

    Attributes
    ----------
    start : ndarray of int64, shape (n + 1,)
        Row i is ``start[i]:start[i + 1]``.
    other : ndarray of int32, shape (p,)
        The partner j > i; within a row sorted by distance, equal ones by j.
    shift : ndarray of int8, shape (p,)
        Which image of the partner it is (`particles.periodicity`); all zero where space does not repeat.
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


def find_pairs(
    position: np.ndarray,
    cutoff: float | None = None,
    periodicity: Periodicity | None = None,
    reach: np.ndarray | None = None,
) -> PairList:
    """Every pair nearer than ``cutoff`` and than the sum of the two reaches, once.

    Parameters
    ----------
    position : ndarray, shape (n, 3)
        Centres [m], in any order and memory layout; where space repeats inside its copy, or not further than a
        fifth of the largest interaction distance outside.
    cutoff : float, optional
        Largest distance of centres [m].
    periodicity : Periodicity, optional
        Adds the pairs across the faces of its copy.
    reach : ndarray, shape (n,), optional
        Keeps only pairs nearer than ``reach[i] + reach[j]`` [m] (grains of different size).

    Raises
    ------
    ValueError
        If there is neither cut-off nor reach, one of them is out of range, a position is not finite, the copy of
        space is too narrow, or it has more grains than can be numbered.
    """
    position = np.asarray(position, dtype=float)
    limit, near = _limits(len(position), cutoff, reach)
    start = np.zeros(len(position) + 1, dtype=np.int64)
    if periodicity is not None and len(position):
        periodicity.require_width(position, limit)
    if len(position) > MOST_GRAINS:
        raise ValueError(f"{len(position)} grains; allowed: at most {MOST_GRAINS}")
    if len(position) < 2 or limit == 0.0:
        return PairList(start, np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8))
    points = np.empty((len(position), 4))
    points[:, :3], points[:, 3] = position, near
    ordered, other, shift = _rows(points, limit, periodicity, start)
    if ordered == kernels.NOT_FINITE:
        raise not_finite(points)
    return PairList(start, other, np.zeros(len(other), dtype=np.int8) if periodicity is None else shift)


def finest_cell(reach: np.ndarray, cutoff: float | None = None) -> float:
    """Edge [m] of the finest cells that `find_pairs` makes for these reaches (n,) [m]: what to sort grains by."""
    limit, near = _limits(len(reach), cutoff, reach)
    lowest, bound = float(near.min()), float(near.max())
    if lowest > 0.5 * bound:
        return min(limit, 2.0 * bound)
    for _ in range(LEVELS - 1):
        if lowest > 0.5 * bound:
            break
        bound *= 0.5
    return min(limit, 2.0 * float(near[near <= bound].max()))


def _limits(n: int, cutoff: float | None, reach: np.ndarray | None) -> tuple[float, np.ndarray]:
    """The largest interaction distance [m], and everybody's reach (n,) [m]."""
    if cutoff is not None and not 0.0 < cutoff < np.inf:
        raise ValueError(f"cut-off = {cutoff * 1e3:g} mm; allowed: more than 0 and finite")
    if reach is None:
        if cutoff is None:
            raise ValueError("neither a cut-off nor a reach is given; pass the largest distance of a pair, or radii")
        return cutoff, np.full(n, 0.5 * cutoff)
    near = np.ascontiguousarray(reach, dtype=float)
    if near.shape != (n,):
        raise ValueError(f"reach has shape {near.shape}; it must be ({n},), one for each grain")
    largest = float(near.max(initial=0.0))
    if not (near.min(initial=0.0) >= 0.0 and largest < np.inf):
        raise ValueError("a reach is negative or not a finite number; pass radii plus half the skin [m]")
    return min(2.0 * largest, np.inf if cutoff is None else cutoff), near


def _rows(
    points: np.ndarray, limit: float, periodicity: Periodicity | None, start: np.ndarray
) -> tuple[int, np.ndarray, np.ndarray]:
    """Status, partners and shifts of `neighbour_kernels.find` for points and reaches (n, 4) [m]; fills ``start``."""
    images = _ghosts(points, BESIDE_FACE * limit, periodicity)
    with at_most(numba.get_num_threads() if len(points) >= WORTH_SHARING else 1):
        return kernels.find(points, *images, limit, BLOCK, start)


def _ghosts(
    points: np.ndarray, margin: float, periodicity: Periodicity | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Images of the grains within ``margin`` [m] of a face: points (g, 4), codes (g,), which grains these are (n,)."""
    if periodicity is None:
        return np.zeros((0, 4)), np.zeros(0, dtype=np.int32), np.zeros(0, dtype=bool)
    images = periodicity.images_near(points[:, :3], margin)
    ghosts = points[images.grain]
    ghosts[:, :3] = images.position
    return ghosts, (SHIFTS * images.grain + MIDDLE + images.shift).astype(np.int32), images.beside_face
