"""Point location in tetrahedra: a bucket grid over the elements, searched by compiled kernels."""

from __future__ import annotations

import numpy as np

from geometry.mesh_3d import EDGES

from . import tetrahedron_kernels
from .elements_3d import Elements3D

# A point this far outside in barycentric coordinates still counts as inside, see `field.sampling.locate`.
_MARGIN = 1e-3
_MAX_CELLS = 2_000_000


class PointOutside3D(ValueError):
    """A point lies outside the region that is sampled.

    Attributes
    ----------
    points : ndarray (k, 3)
        Cartesian [m].
    """

    def __init__(self, points: np.ndarray, where: str) -> None:
        shown = ", ".join(f"(x = {x * 1e3:.4f}, y = {y * 1e3:.4f}, z = {z * 1e3:.4f}) mm" for x, y, z in points[:3])
        more = f" and {len(points) - 3} more" if len(points) > 3 else ""
        super().__init__(
            f"{len(points)} point(s) outside {where}: {shown}{more}; a grain there has left its "
            "chamber (lower the time step) or its walls and the mesh disagree"
        )
        self.points = points


class TetrahedronLocator:
    """Bucket grid over some elements of a mesh, with cells about as large as a mean element.

    Parameters
    ----------
    elements : Elements3D
    chosen : ndarray (m,)
        The elements that are searched.
    """

    def __init__(self, elements: Elements3D, chosen: np.ndarray) -> None:
        points = elements.node_points[elements.element_nodes[chosen]]  # (m, 4 or 10, 3)
        corners = points[:, :4]
        inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
        # first corner, and the map from the distance to it to the last three barycentric coordinates
        self._affine = np.ascontiguousarray(np.concatenate((corners[:, 0], inverse.reshape(-1, 9)), axis=1))
        self._bend = np.zeros((len(chosen), 3, 9))
        self._bend[:, np.arange(3), np.arange(3)] = 1.0
        self._reach = np.zeros(len(chosen))
        hull = corners
        curved = elements.curved[chosen]
        if curved.any():
            bulge = points[:, 4:] - points[:, EDGES].mean(axis=2)
            bulge[~curved] = 0.0
            offset = np.einsum("eab,ekb->eak", inverse, bulge)  # (m, 3, 6)
            self._bend += quadratic_form(offset)
            # 4 l_i l_j is at most 1 on each edge: no point's coordinates differ by more from those of the straight one
            every = np.concatenate((offset, -offset.sum(axis=1, keepdims=True)), axis=1)
            self._reach[curved] = np.abs(every[curved]).sum(axis=2).max(axis=1) + 1e-9
            # an element lies in the hull of its corners and of its edges' Bezier points
            hull = np.concatenate((corners, points[:, EDGES].mean(axis=2) + 2.0 * bulge), axis=1)
        low, high = hull.min(axis=1), hull.max(axis=1)
        reach = 4.0 * _MARGIN * (high - low)
        low, high = low - reach, high + reach
        self._origin = low.min(axis=0)
        extent = high.max(axis=0) - self._origin
        size = np.median(np.cbrt((high - low).prod(axis=1)))
        size = max(size, float(np.cbrt(extent.prod() / _MAX_CELLS)))
        self._cells = np.maximum(np.ceil(extent / size).astype(np.int64), 1)
        self._inverse_size = self._cells / extent
        first = np.clip(((low - self._origin) * self._inverse_size).astype(np.int64), 0, self._cells - 1)
        last = np.clip(((high - self._origin) * self._inverse_size).astype(np.int64), 0, self._cells - 1)
        self._start = np.zeros(int(self._cells.prod()) + 1, dtype=np.int64)
        tetrahedron_kernels.count_cells(first, last, self._cells, self._start)
        np.cumsum(self._start, out=self._start)
        self._items = np.empty(self._start[-1], dtype=np.int32)
        tetrahedron_kernels.fill_cells(first, last, self._cells, self._start[:-1].copy(), self._items)

    @property
    def search(self) -> tetrahedron_kernels.TetrahedronSearch:
        """Arrays that the kernels need to find a tetrahedron."""
        return tetrahedron_kernels.TetrahedronSearch(
            self._affine, self._bend, self._reach, self._start, self._items, self._origin, self._inverse_size,
            self._cells, _MARGIN,
        )  # fmt: skip

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Element and reference coordinates of points (k, 3) [m].

        Returns
        -------
        element : ndarray (k,) int64
            Position among the chosen elements; -1 outside.
        local : ndarray (k, 3)
            Reference coordinates, the last three barycentric ones.
        """
        element, local = np.empty(len(points), dtype=np.int64), np.empty((len(points), 3))
        points = np.ascontiguousarray(points, dtype=float)
        tetrahedron_kernels.find(points, self.search, element, local)
        return element, local


def quadratic_form(offset: np.ndarray) -> np.ndarray:
    """Sum over the edges of 4 l_i l_j times their offset (m, 3, 6), by powers u v w uu uv uw vv vw ww; (m, 3, 9)."""
    tu, uv, tv, tw, uw, vw = 4.0 * np.moveaxis(offset, 2, 0)
    return np.stack((tu, tv, tw, -tu, uv - tu - tv, uw - tu - tw, -tv, vw - tv - tw, -tw), axis=2)
