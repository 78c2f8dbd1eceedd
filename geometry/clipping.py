"""Part of a triangle's solid of revolution that lies in rectangles of the section."""

from __future__ import annotations

import numpy as np

from geometry.walls import AnnularBox


def share_in_boxes(corners: np.ndarray, boxes: list[AnnularBox]) -> np.ndarray:
    """Share of each triangle's volume of revolution inside boxes that do not overlap, shape (k,), 0 to 1.

    Parameters
    ----------
    corners : ndarray (k, 3, 2)
        (r, z) [m].
    """
    share = np.zeros(len(corners))
    for box in boxes:
        low, high = np.array([box.r0, box.z0]), np.array([box.r1, box.z1])
        slack = 1e-9 * (high - low)
        inside = np.all((corners >= low - slack) & (corners <= high + slack), axis=(1, 2))
        apart = np.any((corners.max(axis=1) <= low + slack) | (corners.min(axis=1) >= high - slack), axis=1)
        share[inside] += 1.0
        for k in np.flatnonzero(~inside & ~apart):
            share[k] += _moment(_clipped(corners[k], low, high)) / _moment(corners[k])
    return np.minimum(share, 1.0)


def _moment(polygon: np.ndarray) -> float:
    """Integral of r over a polygon (m, 2), by its absolute value: 1/(2 pi) of the volume of revolution (Pappus)."""
    if len(polygon) < 3:
        return 0.0
    (r, z), (r1, z1) = polygon.T, np.roll(polygon, -1, axis=0).T
    return abs(float(((r + r1) * (r * z1 - r1 * z)).sum())) / 6.0


def _clipped(polygon: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The part of a convex polygon inside a rectangle (Sutherland and Hodgman 1974)."""
    for axis, bound, sign in ((0, low[0], 1.0), (0, high[0], -1.0), (1, low[1], 1.0), (1, high[1], -1.0)):
        kept: list[np.ndarray] = []
        for here, following in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            a, b = sign * (here[axis] - bound), sign * (following[axis] - bound)
            if a >= 0.0:
                kept.append(here)
            if a * b < 0.0:
                kept.append(here + (following - here) * (a / (a - b)))
        if not kept:
            return np.empty((0, 2))
        polygon = np.array(kept)
    return polygon
