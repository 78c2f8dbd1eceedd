"""Which triangle is a point in: a bucket grid and a barycentric test, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

# A point this far outside in barycentric coordinates still counts as inside: round-off at a wall, or a
# grain centre a thousandth of an element beyond it, is no error and extrapolates harmlessly.
_MARGIN = 1e-3
_MAX_CELLS = 400_000


class PointOutside(ValueError):
    """A point lies outside the region that is sampled.

    Attributes
    ----------
    points : ndarray (k, 2)
        Their (r, z) [m].
    """

    def __init__(self, points: np.ndarray, where: str) -> None:
        shown = ", ".join(f"(r = {r * 1e3:.4f}, z = {z * 1e3:.4f}) mm" for r, z in points[:3])
        more = f" and {len(points) - 3} more" if len(points) > 3 else ""
        super().__init__(
            f"{len(points)} point(s) outside {where}: {shown}{more}; a grain there has left its "
            "chamber (lower the time step) or its walls and the mesh disagree"
        )
        self.points = points


class TriangleLocator:
    """Bucket grid over triangles, with cells about as large as a mean triangle.

    Parameters
    ----------
    points : ndarray (n_points, 2)
        (r, z) [m].
    triangles : ndarray (m, 3)
    """

    def __init__(self, points: np.ndarray, triangles: np.ndarray) -> None:
        corners = np.ascontiguousarray(points[triangles], dtype=float)  # (m, 3, 2)
        self.corners = corners
        low, high = corners.min(axis=1), corners.max(axis=1)
        # the margin in barycentric coordinates reaches at most this far outside a triangle's box
        reach = 3.0 * _MARGIN * (high - low)
        low, high = low - reach, high + reach
        self.origin = low.min(axis=0)
        extent = high.max(axis=0) - self.origin
        size = np.median(np.sqrt((high - low).prod(axis=1)))
        size = max(size, float(np.sqrt(extent.prod() / _MAX_CELLS)))
        self.shape = np.maximum(np.ceil(extent / size).astype(np.int64), 1)
        self.inverse_size = self.shape / extent
        first = np.clip(((low - self.origin) * self.inverse_size).astype(np.int64), 0, self.shape - 1)
        last = np.clip(((high - self.origin) * self.inverse_size).astype(np.int64), 0, self.shape - 1)
        span = last - first + 1
        count = span.prod(axis=1)
        owner = np.repeat(np.arange(len(corners)), count)
        within = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        i, j = within // span[owner, 1], within % span[owner, 1]
        cell = (first[owner, 0] + i) * self.shape[1] + first[owner, 1] + j
        self.items = owner[np.argsort(cell, kind="stable")]
        self.start = np.concatenate(([0], np.cumsum(np.bincount(cell, minlength=int(self.shape.prod())))))

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Element and barycentric coordinates of points (k, 2) [m].

        Returns
        -------
        element : ndarray (k,) int64
            -1 outside.
        barycentric : ndarray (k, 3)
        """
        element = np.empty(len(points), dtype=np.int64)
        barycentric = np.empty((len(points), 3))
        _find(
            points,
            self.corners,
            self.start,
            self.items,
            self.origin,
            self.inverse_size,
            self.shape,
            _MARGIN,
            element,
            barycentric,
        )
        return element, barycentric


@njit(cache=True, error_model="numpy", nogil=True)
def _find(points, corners, start, items, origin, inverse_size, shape, margin, element, barycentric):
    for k in range(points.shape[0]):
        r, z = points[k, 0], points[k, 1]
        found, best = -1, -margin
        b0 = b1 = b2 = 0.0
        u, v = (r - origin[0]) * inverse_size[0], (z - origin[1]) * inverse_size[1]
        # written so that a NaN coordinate is outside
        if u >= 0.0 and v >= 0.0 and u <= shape[0] and v <= shape[1]:
            cell = min(int(u), shape[0] - 1) * shape[1] + min(int(v), shape[1] - 1)
            for s in range(start[cell], start[cell + 1]):
                e = items[s]
                r0, z0 = corners[e, 0, 0], corners[e, 0, 1]
                ur, uz = corners[e, 1, 0] - r0, corners[e, 1, 1] - z0
                vr, vz = corners[e, 2, 0] - r0, corners[e, 2, 1] - z0
                determinant = ur * vz - uz * vr
                l1 = ((r - r0) * vz - (z - z0) * vr) / determinant
                l2 = (ur * (z - z0) - uz * (r - r0)) / determinant
                l0 = 1.0 - l1 - l2
                least = min(l0, l1, l2)
                if least > best:
                    found, best = e, least
                    b0, b1, b2 = l0, l1, l2
                    if least >= 0.0:
                        break
        element[k] = found
        barycentric[k, 0], barycentric[k, 1], barycentric[k, 2] = b0, b1, b2
