"""Point location in triangles: a bucket grid and a barycentric test, compiled.

The triangles of a bucket are tried in the order of how well they hold its centre: with buckets a quarter as
wide as a triangle the first test mostly finds the point.
"""

from __future__ import annotations

import numpy as np

from field.sampling import element_kernels

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

    @classmethod
    def at(cls, position: np.ndarray, where: str) -> PointOutside:
        """From Cartesian positions (k, 3) [m]."""
        return cls(np.column_stack((np.hypot(position[:, 0], position[:, 1]), position[:, 2])), where)


class TriangleLocator:
    """Bucket grid over triangles.

    Parameters
    ----------
    points : ndarray (n_points, 2)
        (r, z) [m].
    triangles : ndarray (m, 3)
    """

    def __init__(self, points: np.ndarray, triangles: np.ndarray) -> None:
        corners = np.ascontiguousarray(points[triangles], dtype=float)  # (m, 3, 2)
        u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        determinant = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])[:, None]
        # first corner, and the map from the distance to it to the last two barycentric coordinates
        self._affine = np.ascontiguousarray(
            np.concatenate(
                (corners[:, 0], np.column_stack((v[:, 1], -v[:, 0], -u[:, 1], u[:, 0])) / determinant), axis=1
            )
        )
        low, high = corners.min(axis=1), corners.max(axis=1)
        # the margin in barycentric coordinates reaches at most this far outside a triangle's box
        reach = 3.0 * _MARGIN * (high - low)
        low, high = low - reach, high + reach
        self.origin = low.min(axis=0)
        extent = high.max(axis=0) - self.origin
        size = 0.25 * np.median(np.sqrt((high - low).prod(axis=1)))
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
        centre = self.origin + (np.column_stack((first[owner, 0] + i, first[owner, 1] + j)) + 0.5) / self.inverse_size
        l1, l2 = self._coordinates(owner, centre)
        depth = np.minimum(np.minimum(l1, l2), 1.0 - l1 - l2)
        self.items = owner[np.lexsort((-depth, cell))]
        self.start = np.concatenate(([0], np.cumsum(np.bincount(cell, minlength=int(self.shape.prod())))))

    def _coordinates(self, element: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Last two barycentric coordinates of one point in each of the elements."""
        x, y = (points - self._affine[element, :2]).T
        a, b, c, d = self._affine[element, 2:].T
        return a * x + b * y, c * x + d * y

    @property
    def search(self) -> element_kernels.TriangleSearch:
        """Arrays that the kernels need to find a triangle."""
        return element_kernels.TriangleSearch(
            self._affine, self.start, self.items, self.origin, self.inverse_size, self.shape, _MARGIN
        )

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
        element_kernels.find(points, self.search, element, barycentric)
        return element, barycentric
