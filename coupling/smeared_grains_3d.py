"""Grains spread over the sector of a mesh in 3D: their volume and their moments, with a smooth kernel.

A grain is spread with K(s) = 105/(32 pi a^3) (1 - s^2/a^2)^2 about its centre, what `coupling.pair_fields` takes out of
near pairs. All copies of the simulated grains in the ring are turned, and in a mesh between mirror planes mirrored,
into the one sector that is meshed, and divided by the number of its copies: the field has the mesh's symmetry, and gets
the mean of the grains over it. A moment is mirrored as H is (`field.three_d.sector`), as a polar vector.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from field.three_d import SectorFold

CELLS = 2  # of the grid in which grains are searched, along the width


def smear_3d(
    points: np.ndarray, position: np.ndarray, amounts: np.ndarray, width: float, fold: SectorFold
) -> np.ndarray:
    """Densities (k, p) at points (p, 3) [m] of the meshed sector, of grains at (n, 3) [m] with amounts (n, k).

    The amounts are, say, a volume and a moment (n, 4), the first scalar and the next three a vector, of the meshed
    sector's share: the sum over the ring divided by the number of sectors.
    """
    place, amounts = _in_reach(position, amounts, width, fold)
    out = np.zeros((4, len(points)))
    if not len(place):
        return out
    size = width / CELLS
    low = place.min(axis=0)
    cell = np.floor((place - low) / size).astype(np.int64)
    shape = cell.max(axis=0) + 1
    index = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    order = np.argsort(index, kind="stable")
    start = np.concatenate(([0], np.cumsum(np.bincount(index, minlength=int(shape.prod())))))
    grains = np.ascontiguousarray(np.column_stack((place, amounts))[order].T)
    _smear(np.ascontiguousarray(points), grains, start, low, shape, size, float(width), out)
    return out


def _in_reach(
    position: np.ndarray, amounts: np.ndarray, width: float, fold: SectorFold
) -> tuple[np.ndarray, np.ndarray]:
    """The grains in the meshed sector, and their copies beyond its two sides that reach into it."""
    if fold.whole:
        return position, amounts
    inside, matrix = fold.into_mesh(position)
    assert matrix is not None
    vector = np.einsum("nij,nj->ni", matrix, amounts[:, 1:])
    radius = np.hypot(inside[:, 0], inside[:, 1])
    angle = np.remainder(np.arctan2(inside[:, 1], inside[:, 0]) - fold.first, 2.0 * np.pi)
    angle = np.where(angle > 0.5 * fold.angle + np.pi, angle - 2.0 * np.pi, angle)  # before the first side by round-off
    reach = np.where(radius > width, np.arcsin(np.minimum(width / np.maximum(radius, width), 1.0)), np.pi)
    farthest = int(np.ceil(reach.max() / fold.angle)) + 1
    places, parts = [], []
    for copy in range(-farthest, farthest + 1):
        odd = fold.mirrored and copy % 2 == 1
        there = copy * fold.angle + (fold.angle - angle if odd else angle)
        near = (there > -reach) & (there < fold.angle + reach)
        turn = _turn(copy * fold.angle)
        if odd:
            double = 2.0 * fold.first + fold.angle
            turn = turn @ np.array(
                [[np.cos(double), np.sin(double), 0.0], [np.sin(double), -np.cos(double), 0.0], [0.0, 0.0, 1.0]]
            )
        places.append(inside[near] @ turn.T)
        parts.append(np.column_stack((amounts[near, 0], vector[near] @ turn.T)))
    return np.concatenate(places), np.concatenate(parts)


def _turn(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _smear(points, grains, start, low, shape, size, width, out):
    scale, per_a2 = 105.0 / (32.0 * np.pi * width * width * width), 1.0 / (width * width)
    for p in prange(points.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        i0, j0 = int(np.floor((x - low[0]) / size)), int(np.floor((y - low[1]) / size))
        k0 = int(np.floor((z - low[2]) / size))
        k_low, k_high = max(k0 - CELLS, 0), min(k0 + CELLS, shape[2] - 1)
        v = a = b = c = 0.0
        if k_low <= k_high:
            for i in range(max(i0 - CELLS, 0), min(i0 + CELLS + 1, shape[0])):
                for j in range(max(j0 - CELLS, 0), min(j0 + CELLS + 1, shape[1])):
                    row = (i * shape[1] + j) * shape[2]
                    for g in range(start[row + k_low], start[row + k_high + 1]):
                        dx, dy, dz = x - grains[0, g], y - grains[1, g], z - grains[2, g]
                        left = max(1.0 - (dx * dx + dy * dy + dz * dz) * per_a2, 0.0)
                        w = scale * left * left
                        v += w * grains[3, g]
                        a += w * grains[4, g]
                        b += w * grains[5, g]
                        c += w * grains[6, g]
        out[0, p], out[1, p], out[2, p], out[3, p] = v, a, b, c
