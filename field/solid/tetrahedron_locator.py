"""Which tetrahedron is a point in, and where in it: a bucket grid, with Newton's method in curved elements."""

from __future__ import annotations

import numpy as np
from numba import njit

from .solid_elements import SolidElements

# A point this far outside in barycentric coordinates still counts as inside, see `field.locate`.
_MARGIN = 1e-3
_MAX_CELLS = 2_000_000


class SolidPointOutside(ValueError):
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
    elements : SolidElements
    chosen : ndarray (m,)
        The elements that are searched.
    """

    def __init__(self, elements: SolidElements, chosen: np.ndarray) -> None:
        self._nodes = np.ascontiguousarray(elements.element_nodes[chosen])
        self._curved = np.ascontiguousarray(elements.curved[chosen])
        self._points = elements.node_points
        box = self._points[self._nodes]
        low, high = box.min(axis=1), box.max(axis=1)
        # the margin, and in a curved element what a face bulges beyond its nodes
        reach = np.where(self._curved[:, None], 0.1, 4.0 * _MARGIN) * (high - low).max(axis=1, keepdims=True)
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
        _count(first, last, self._cells, self._start)
        np.cumsum(self._start, out=self._start)
        self._items = np.empty(self._start[-1], dtype=np.int32)
        _fill(first, last, self._cells, self._start[:-1].copy(), self._items)

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
        _find(
            np.ascontiguousarray(points, dtype=float),
            self._points,
            self._nodes,
            self._curved,
            self._start,
            self._items,
            self._origin,
            self._inverse_size,
            self._cells,
            _MARGIN,
            element,
            local,
        )
        return element, local


@njit(cache=True, error_model="numpy", nogil=True)
def _count(first, last, cells, start):
    for e in range(first.shape[0]):
        for i in range(first[e, 0], last[e, 0] + 1):
            for j in range(first[e, 1], last[e, 1] + 1):
                for k in range(first[e, 2], last[e, 2] + 1):
                    start[(i * cells[1] + j) * cells[2] + k + 1] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(first, last, cells, at, items):
    for e in range(first.shape[0]):
        for i in range(first[e, 0], last[e, 0] + 1):
            for j in range(first[e, 1], last[e, 1] + 1):
                for k in range(first[e, 2], last[e, 2] + 1):
                    cell = (i * cells[1] + j) * cells[2] + k
                    items[at[cell]] = e
                    at[cell] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def _straight(points, nodes, e, x, y, z):
    """Reference coordinates in the tetrahedron of the corners."""
    p, q, r, s = nodes[e, 0], nodes[e, 1], nodes[e, 2], nodes[e, 3]
    x0, y0, z0 = points[p, 0], points[p, 1], points[p, 2]
    a0, a1, a2 = points[q, 0] - x0, points[q, 1] - y0, points[q, 2] - z0
    b0, b1, b2 = points[r, 0] - x0, points[r, 1] - y0, points[r, 2] - z0
    c0, c1, c2 = points[s, 0] - x0, points[s, 1] - y0, points[s, 2] - z0
    d0, d1, d2 = x - x0, y - y0, z - z0
    n0, n1, n2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
    det = a0 * n0 + a1 * n1 + a2 * n2
    u = (d0 * n0 + d1 * n1 + d2 * n2) / det
    m0, m1, m2 = d1 * a2 - d2 * a1, d2 * a0 - d0 * a2, d0 * a1 - d1 * a0
    v = -(m0 * c0 + m1 * c1 + m2 * c2) / det
    w = (m0 * b0 + m1 * b1 + m2 * b2) / det
    return u, v, w


@njit(cache=True, error_model="numpy", nogil=True)
def _curved(points, nodes, e, x, y, z, u, v, w):
    """Reference coordinates in a quadratic tetrahedron, by Newton's method from those of the straight one."""
    for _ in range(12):
        t = 1.0 - u - v - w
        X = Y = Z = 0.0
        a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = 0.0
        for i in range(10):
            if i == 0:
                N, du, dv, dw = t * (2 * t - 1), 1 - 4 * t, 1 - 4 * t, 1 - 4 * t
            elif i == 1:
                N, du, dv, dw = u * (2 * u - 1), 4 * u - 1, 0.0, 0.0
            elif i == 2:
                N, du, dv, dw = v * (2 * v - 1), 0.0, 4 * v - 1, 0.0
            elif i == 3:
                N, du, dv, dw = w * (2 * w - 1), 0.0, 0.0, 4 * w - 1
            elif i == 4:
                N, du, dv, dw = 4 * t * u, 4 * (t - u), -4 * u, -4 * u
            elif i == 5:
                N, du, dv, dw = 4 * u * v, 4 * v, 4 * u, 0.0
            elif i == 6:
                N, du, dv, dw = 4 * t * v, -4 * v, 4 * (t - v), -4 * v
            elif i == 7:
                N, du, dv, dw = 4 * t * w, -4 * w, -4 * w, 4 * (t - w)
            elif i == 8:
                N, du, dv, dw = 4 * u * w, 4 * w, 0.0, 4 * u
            else:
                N, du, dv, dw = 4 * v * w, 0.0, 4 * w, 4 * v
            p = nodes[e, i]
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            X += N * px
            Y += N * py
            Z += N * pz
            a00 += du * px
            a01 += dv * px
            a02 += dw * px
            a10 += du * py
            a11 += dv * py
            a12 += dw * py
            a20 += du * pz
            a21 += dv * pz
            a22 += dw * pz
        c00, c01, c02 = a11 * a22 - a12 * a21, a02 * a21 - a01 * a22, a01 * a12 - a02 * a11
        c10, c11, c12 = a12 * a20 - a10 * a22, a00 * a22 - a02 * a20, a02 * a10 - a00 * a12
        c20, c21, c22 = a10 * a21 - a11 * a20, a01 * a20 - a00 * a21, a00 * a11 - a01 * a10
        det = a00 * c00 + a01 * c10 + a02 * c20
        d0, d1, d2 = x - X, y - Y, z - Z
        su = (c00 * d0 + c01 * d1 + c02 * d2) / det
        sv = (c10 * d0 + c11 * d1 + c12 * d2) / det
        sw = (c20 * d0 + c21 * d1 + c22 * d2) / det
        u, v, w = u + su, v + sv, w + sw
        if abs(su) + abs(sv) + abs(sw) < 1e-12:
            return True, u, v, w
        if not abs(u) + abs(v) + abs(w) < 10.0:  # far outside, or NaN
            break
    return False, u, v, w


@njit(cache=True, error_model="numpy", nogil=True)
def _find(where, points, nodes, curved, start, items, origin, inverse_size, cells, margin, element, local):
    for k in range(where.shape[0]):
        x, y, z = where[k, 0], where[k, 1], where[k, 2]
        found, best = -1, -margin
        bu = bv = bw = 0.0
        i = (x - origin[0]) * inverse_size[0]
        j = (y - origin[1]) * inverse_size[1]
        l = (z - origin[2]) * inverse_size[2]
        # written so that a NaN coordinate is outside
        if i >= 0.0 and j >= 0.0 and l >= 0.0 and i <= cells[0] and j <= cells[1] and l <= cells[2]:
            cell = (min(int(i), cells[0] - 1) * cells[1] + min(int(j), cells[1] - 1)) * cells[2] + min(
                int(l), cells[2] - 1
            )
            for s in range(start[cell], start[cell + 1]):
                e = items[s]
                u, v, w = _straight(points, nodes, e, x, y, z)
                least = min(min(u, v), min(w, 1.0 - u - v - w))
                if curved[e]:
                    if least < -0.5:
                        continue
                    inside, u, v, w = _curved(points, nodes, e, x, y, z, u, v, w)
                    if not inside:
                        continue
                    least = min(min(u, v), min(w, 1.0 - u - v - w))
                if least > best:
                    found, best = e, least
                    bu, bv, bw = u, v, w
                    if least >= 0.0:
                        break
        element[k] = found
        local[k, 0], local[k, 1], local[k, 2] = bu, bv, bw
