"""Grains that overlap are pushed apart: Gauss-Seidel on positions, no forces, no time.

Each sweep visits the pairs in the order of the neighbour list and moves both partners by half their overlap (shares by
volume were tried: they reach less), then pushes grains out of the walls. The result depends on the start alone, not on
the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.neighbours.neighbour_list import PairList, cell_order, find_pairs
from particles.packing.space import Near, Space

TOLERANCE = 0.01  # overlap that is left, as a fraction of the smaller diameter
_SKIN = 0.3  # of the pair list, in smallest diameters
_CORNER_ROUNDS = 4  # in a corner one wall pushes a grain into the other
_SWEEPS_A_THROW = 2


class Crowd:
    """Grains that are being pushed apart.

    Parameters
    ----------
    position : ndarray, shape (n, 3)
        Centres [m].
    radius : ndarray, shape (n,)
        Full-grown [m].
    space : Space
        Its walls push, its sector closes the ring.

    Attributes
    ----------
    position, radius : ndarray
        As given, but sorted by cells in the process, both alike.
    order : ndarray of int64, shape (n,)
        Which of the grains given stands in each place.
    worst : float
        Largest overlap of two grains met in the last check, as a fraction of the smaller diameter.
    """

    def __init__(self, position: np.ndarray, radius: np.ndarray, space: Space):
        self.position, self.radius, self.space = np.ascontiguousarray(position), radius, space
        self.order = np.arange(len(radius))
        self.worst = math.inf
        sector = space.sector
        self._smallest = 2.0 * float(radius.min())
        self._skin = _SKIN * self._smallest
        self._pairs: PairList | None = None
        self._near: Near | None = None
        self._reference = self.position
        self._turn = np.array([1.0, 0.0] if sector is None else [math.cos(sector.angle), math.sin(sector.angle)])

    def part(self, scale: float, sweeps: int, *, tolerance: float = TOLERANCE) -> bool:
        """Push apart at ``scale`` times the full size, at most ``sweeps`` times; whether ``tolerance`` was reached."""
        self._pairs = None
        for _ in range(sweeps):
            self._push(scale)
            self.worst = self._swept(scale, 0.0)
            if self.worst < 0.9 * tolerance:
                break
        return self.worst < tolerance

    def shake(self, scale: float, rounds: int, amplitude: float, rng: np.random.Generator) -> None:
        """Throw each grain by up to ``amplitude`` of its diameter and push it back, ``rounds`` times."""
        self._pairs = None
        for _ in range(rounds):
            self.position += (2.0 * amplitude) * self.radius[:, None] * rng.uniform(-1.0, 1.0, self.position.shape)
            for _ in range(_SWEEPS_A_THROW):
                self._push(scale)

    def wrap(self) -> None:
        """Bring every grain back into the sector."""
        sector = self.space.sector
        if sector is not None:
            self.position = sector.turn(self.position, sector.wraps(self.position))

    def _push(self, scale: float) -> None:
        """One sweep over the pairs, and off the walls."""
        if self._pairs is None or self._farthest() > 0.5 * self._skin:
            self._list_pairs(scale)
        self._swept(scale, 1.0)
        for _ in range(_CORNER_ROUNDS):
            if self.space.push_off(self.position, scale * self.radius, self._near) <= 1e-6 * self._smallest:
                break

    def _swept(self, scale: float, push: float) -> float:
        pairs = self._pairs
        assert pairs is not None  # made by the push before
        radius = scale * self.radius
        return float(_push_pairs(pairs.start, pairs.other, pairs.shift, self.position, radius, self._turn, push))

    def _farthest(self) -> float:
        return float(np.sqrt(np.max(np.sum((self.position - self._reference) ** 2, axis=1))))

    def _list_pairs(self, scale: float) -> None:
        self.wrap()
        order = cell_order(self.position, 2.0 * float(self.radius.max()))
        self.position = np.ascontiguousarray(self.position[order])
        self.radius, self.order = self.radius[order], self.order[order]
        radius = scale * self.radius
        cutoff = 2.0 * float(radius.max()) + self._skin
        self._pairs = find_pairs(self.position, cutoff, self.space.sector, radius + 0.5 * self._skin)
        self._near = self.space.triangles_near(self.position, radius + self._skin)
        self._reference = self.position.copy()


@njit(cache=True, error_model="numpy")
def _push_pairs(start, other, shift, position, radius, turn, push):
    """Push pairs apart by ``push`` of their overlap; returns the largest met, as a fraction of the diameter."""
    worst = 0.0
    for i in range(radius.shape[0]):
        for k in range(start[i], start[i + 1]):
            j = other[k]
            jx, jy = position[j, 0], position[j, 1]
            sine = turn[1] * shift[k]
            if shift[k] != 0:
                jx, jy = turn[0] * jx - sine * jy, sine * jx + turn[0] * jy
            dx, dy, dz = jx - position[i, 0], jy - position[i, 1], position[j, 2] - position[i, 2]
            d = np.sqrt(dx * dx + dy * dy + dz * dz)
            smaller = min(radius[i], radius[j])
            depth = radius[i] + radius[j] - d
            if depth <= 0.0:
                continue
            worst = max(worst, depth / (2.0 * smaller))
            if d == 0.0:
                dx, d = 1.0, 1.0  # two on one spot: any direction parts them
            # each by half the overlap, never by more than a third of a radius at once: whom a neighbour pushes far
            # may land behind the next
            step = min(0.5 * push * depth, 0.33 * smaller) / d
            dx, dy, dz = step * dx, step * dy, step * dz
            position[i, 0] -= dx
            position[i, 1] -= dy
            position[i, 2] -= dz
            if shift[k] != 0:
                dx, dy = turn[0] * dx + sine * dy, turn[0] * dy - sine * dx
            position[j, 0] += dx
            position[j, 1] += dy
            position[j, 2] += dz
    return worst
