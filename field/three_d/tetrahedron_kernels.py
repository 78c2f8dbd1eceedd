"""Compiled kernels on tetrahedra: which one holds a point, and H with grad H interpolated there.

A quadratic tetrahedron is seen from its straight one: with xi the affine coordinates of a point among the four
corners, its reference coordinates u solve  u + q(u) = xi,  q the quadratic that the middles of the edges add.
Newton's method starts at u = xi, always, so that a result does not depend on what was remembered.

They share `_tetrahedron_at` and stand in one file because a cached kernel does not notice a change of a callee
in another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from geometry.kernels.device_functions import device_function

CHUNK = 512  # points a task; each point's result depends on that point alone, so any number would do

# A remembered element is taken only if the point is inside it by this much in barycentric coordinates: then no
# other can hold it, and the result does not depend on what was remembered.
_INSIDE = 1e-9
# Newton's last step: quadratic, so the one after it would be round-off.
_STEP = 1e-8
_MAX_STEPS = 12


class TetrahedronSearch(NamedTuple):
    """Search tables of tetrahedra (`field.three_d.tetrahedron_locator.TetrahedronLocator`).

    Attributes
    ----------
    affine : ndarray, shape (m, 12)
        First corner [m], and the map from the distance to it to the last three barycentric coordinates.
    bend, reach : ndarray, shapes (m, 3, 9), (m,)
        u + q(u) by powers of u, and how far q may carry a point (0: straight).
    start, items : ndarray
        Tetrahedra of each cell of the bucket grid, row by row.
    origin, inverse_size : ndarray, shape (3,)
        Of the grid [m], [1/m].
    cells : ndarray, shape (3,)
        Cells along each axis.
    margin : float
        Barycentric distance outside at which a point still counts as inside.
    """

    affine: np.ndarray
    bend: np.ndarray
    reach: np.ndarray
    start: np.ndarray
    items: np.ndarray
    origin: np.ndarray
    inverse_size: np.ndarray
    cells: np.ndarray
    margin: float


class Copies(NamedTuple):
    """Rotation of the sector's copies into the mesh.

    Attributes
    ----------
    first, sector : float
        Angle at which the mesh begins, and its own; 0: the whole machine [rad].
    lowest : int
        Number of the first copy.
    matrix : ndarray, shape (n, 4)
        By rows in the plane, of the copies from the lowest on.
    """

    first: float
    sector: float
    lowest: int
    matrix: np.ndarray


@device_function(error_model="numpy", inline="always")
def _coordinates(affine, bend, reach, e, x, y, z, margin):
    """Reference coordinates (found, u, v, w) in element e; not found where it is clear that the point is outside."""
    x, y, z = x - affine[e, 0], y - affine[e, 1], z - affine[e, 2]
    a = affine[e, 3] * x + affine[e, 4] * y + affine[e, 5] * z
    b = affine[e, 6] * x + affine[e, 7] * y + affine[e, 8] * z
    c = affine[e, 9] * x + affine[e, 10] * y + affine[e, 11] * z
    # written so that NaN is outside
    if not min(min(a, b), min(c, 1.0 - a - b - c)) > -margin - reach[e]:
        return False, a, b, c
    if reach[e] == 0.0:
        return True, a, b, c
    u, v, w = a, b, c
    for _ in range(_MAX_STEPS):
        a00, a01, a02 = _slopes(bend, e, 0, u, v, w)
        a10, a11, a12 = _slopes(bend, e, 1, u, v, w)
        a20, a21, a22 = _slopes(bend, e, 2, u, v, w)
        # a form without a constant is half the sum of coordinates times (slope + slope at the origin)
        d0 = a - 0.5 * (u * (a00 + bend[e, 0, 0]) + v * (a01 + bend[e, 0, 1]) + w * (a02 + bend[e, 0, 2]))
        d1 = b - 0.5 * (u * (a10 + bend[e, 1, 0]) + v * (a11 + bend[e, 1, 1]) + w * (a12 + bend[e, 1, 2]))
        d2 = c - 0.5 * (u * (a20 + bend[e, 2, 0]) + v * (a21 + bend[e, 2, 1]) + w * (a22 + bend[e, 2, 2]))
        c00, c01, c02 = a11 * a22 - a12 * a21, a02 * a21 - a01 * a22, a01 * a12 - a02 * a11
        c10, c11, c12 = a12 * a20 - a10 * a22, a00 * a22 - a02 * a20, a02 * a10 - a00 * a12
        c20, c21, c22 = a10 * a21 - a11 * a20, a01 * a20 - a00 * a21, a00 * a11 - a01 * a10
        inverse = 1.0 / (a00 * c00 + a01 * c10 + a02 * c20)
        su = (c00 * d0 + c01 * d1 + c02 * d2) * inverse
        sv = (c10 * d0 + c11 * d1 + c12 * d2) * inverse
        sw = (c20 * d0 + c21 * d1 + c22 * d2) * inverse
        u, v, w = u + su, v + sv, w + sw
        if abs(su) + abs(sv) + abs(sw) < _STEP:
            return True, u, v, w
        if not abs(u) + abs(v) + abs(w) < 10.0:  # far outside, or NaN
            break
    return False, u, v, w


@device_function(error_model="numpy", inline="always")
def _slopes(bend, e, i, u, v, w):
    """Derivatives of component i of u + q(u)."""
    return (
        bend[e, i, 0] + 2.0 * bend[e, i, 3] * u + bend[e, i, 4] * v + bend[e, i, 5] * w,
        bend[e, i, 1] + bend[e, i, 4] * u + 2.0 * bend[e, i, 6] * v + bend[e, i, 7] * w,
        bend[e, i, 2] + bend[e, i, 5] * u + bend[e, i, 7] * v + 2.0 * bend[e, i, 8] * w,
    )


@device_function(error_model="numpy")
def _tetrahedron_at(x, y, z, hint, search):
    """Element (-1 outside) and its last three barycentric coordinates."""
    affine, bend, reach, start, items, origin, inverse_size, cells, margin = search
    if hint >= 0:
        good, u, v, w = _coordinates(affine, bend, reach, hint, x, y, z, 0.0)
        if good and u > _INSIDE and v > _INSIDE and w > _INSIDE and 1.0 - u - v - w > _INSIDE:
            return hint, u, v, w
    element, best = -1, -margin
    bu = bv = bw = 0.0
    i, j, k = (x - origin[0]) * inverse_size[0], (y - origin[1]) * inverse_size[1], (z - origin[2]) * inverse_size[2]
    # written so that a NaN coordinate is outside
    if i >= 0.0 and j >= 0.0 and k >= 0.0 and i <= cells[0] and j <= cells[1] and k <= cells[2]:
        row = min(int(i), cells[0] - 1) * cells[1] + min(int(j), cells[1] - 1)
        cell = row * cells[2] + min(int(k), cells[2] - 1)
        for s in range(start[cell], start[cell + 1]):
            e = items[s]
            good, u, v, w = _coordinates(affine, bend, reach, e, x, y, z, margin)
            if not good:
                continue
            least = min(min(u, v), min(w, 1.0 - u - v - w))
            if least > best:
                element, best = e, least
                bu, bv, bw = u, v, w
                if least >= 0.0:
                    break
    return element, bu, bv, bw


@njit(cache=True, error_model="numpy", nogil=True)
def find(points, search, element, local):
    """Element and reference coordinates of each point."""
    for k in range(points.shape[0]):
        e, u, v, w = _tetrahedron_at(points[k, 0], points[k, 1], points[k, 2], -1, search)
        element[k] = e
        local[k, 0], local[k, 1], local[k, 2] = u, v, w


@device_function(error_model="numpy", inline="always")
def _quadratic(powers, e, i, u, v, w):
    return (
        powers[e, i, 0]
        + u * (powers[e, i, 1] + u * powers[e, i, 4] + v * powers[e, i, 5] + w * powers[e, i, 6])
        + v * (powers[e, i, 2] + v * powers[e, i, 7] + w * powers[e, i, 8])
        + w * (powers[e, i, 3] + w * powers[e, i, 9])
    )


@njit(cache=True, error_model="numpy", nogil=True, parallel=True)
def sample(position, hint, copies, search, powers, H, grad):
    """H and grad H at every point; `hint` becomes the elements, -1 for points outside.

    `powers` has nine components: H, then the upper triangle of grad H, which is symmetric.
    """
    n = position.shape[0]
    first, sector, lowest, matrix = copies
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        for k in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            x, y, z = position[k, 0], position[k, 1], position[k, 2]
            c00, c01, c10, c11 = 1.0, 0.0, 0.0, 1.0
            if sector > 0.0:
                copy = np.floor((np.arctan2(y, x) - first) / sector)
                # a NaN stays where it is, and is outside
                i = int(copy) - lowest if abs(copy) < 1e6 else 0
                c00, c01, c10, c11 = matrix[i, 0], matrix[i, 1], matrix[i, 2], matrix[i, 3]
            e, u, v, w = _tetrahedron_at(c00 * x + c01 * y, c10 * x + c11 * y, z, hint[k], search)
            hint[k] = e
            if e < 0:
                continue
            hx, hy = _quadratic(powers, e, 0, u, v, w), _quadratic(powers, e, 1, u, v, w)
            xx, xy = _quadratic(powers, e, 3, u, v, w), _quadratic(powers, e, 4, u, v, w)
            xz, yy = _quadratic(powers, e, 5, u, v, w), _quadratic(powers, e, 6, u, v, w)
            yz = _quadratic(powers, e, 7, u, v, w)
            # back with the transposed matrix
            H[k, 0], H[k, 1], H[k, 2] = c00 * hx + c10 * hy, c01 * hx + c11 * hy, _quadratic(powers, e, 2, u, v, w)
            px, py, qx, qy = xx * c00 + xy * c10, xx * c01 + xy * c11, xy * c00 + yy * c10, xy * c01 + yy * c11
            grad[k, 0, 0], grad[k, 1, 1] = c00 * px + c10 * qx, c01 * py + c11 * qy
            grad[k, 0, 1] = grad[k, 1, 0] = c00 * py + c10 * qy
            grad[k, 0, 2] = grad[k, 2, 0] = c00 * xz + c10 * yz
            grad[k, 1, 2] = grad[k, 2, 1] = c01 * xz + c11 * yz
            grad[k, 2, 2] = _quadratic(powers, e, 8, u, v, w)


@njit(cache=True, error_model="numpy", nogil=True)
def count_cells(first, last, cells, start):
    """Number of boxes that touch each cell, one place further on."""
    for e in range(first.shape[0]):
        for i in range(first[e, 0], last[e, 0] + 1):
            for j in range(first[e, 1], last[e, 1] + 1):
                for k in range(first[e, 2], last[e, 2] + 1):
                    start[(i * cells[1] + j) * cells[2] + k + 1] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def fill_cells(first, last, cells, at, items):
    """The boxes of each cell, in their order."""
    for e in range(first.shape[0]):
        for i in range(first[e, 0], last[e, 0] + 1):
            for j in range(first[e, 1], last[e, 1] + 1):
                for k in range(first[e, 2], last[e, 2] + 1):
                    cell = (i * cells[1] + j) * cells[2] + k
                    items[at[cell]] = e
                    at[cell] += 1
