"""Compiled kernels on triangles: which one holds a point, and H with grad H interpolated there.

They share `_triangle_at` and stand in one file because a cached kernel does not notice a change of a callee
in another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from geometry.kernels.device_functions import device_function

CHUNK = 1024  # points a task; each point's result depends on that point alone, so any number would do

# A remembered triangle is taken only if the point is inside it by this much in barycentric coordinates:
# then no other can hold it, and the result does not depend on what was remembered.
_INSIDE = 1e-9


class TriangleSearch(NamedTuple):
    """Search tables of triangles (`field.sampling.locate.TriangleLocator`).

    Attributes
    ----------
    affine : ndarray, shape (m, 6)
        First corner [m], and the map from the distance to it to the last two barycentric coordinates.
    start, items : ndarray
        Triangles of each cell of the bucket grid, row by row.
    origin, inverse_size : ndarray, shape (2,)
        Of the grid [m], [1/m].
    shape : ndarray, shape (2,)
        Cells along r and z.
    margin : float
        Barycentric distance outside at which a point still counts as inside.
    """

    affine: np.ndarray
    start: np.ndarray
    items: np.ndarray
    origin: np.ndarray
    inverse_size: np.ndarray
    shape: np.ndarray
    margin: float


@device_function(error_model="numpy", inline="always")
def _triangle_at(r, z, hint, affine, start, items, origin, inverse_size, shape, margin):
    """Element (-1 outside) and its last two barycentric coordinates."""
    element, best = -1, -margin
    b1 = b2 = 0.0
    if hint >= 0:
        x, y = r - affine[hint, 0], z - affine[hint, 1]
        l1 = affine[hint, 2] * x + affine[hint, 3] * y
        l2 = affine[hint, 4] * x + affine[hint, 5] * y
        if l1 > _INSIDE and l2 > _INSIDE and 1.0 - l1 - l2 > _INSIDE:
            return hint, l1, l2
    u, v = (r - origin[0]) * inverse_size[0], (z - origin[1]) * inverse_size[1]
    # written so that a NaN coordinate is outside
    if u >= 0.0 and v >= 0.0 and u <= shape[0] and v <= shape[1]:
        cell = min(int(u), shape[0] - 1) * shape[1] + min(int(v), shape[1] - 1)
        for s in range(start[cell], start[cell + 1]):
            e = items[s]
            x, y = r - affine[e, 0], z - affine[e, 1]
            l1 = affine[e, 2] * x + affine[e, 3] * y
            l2 = affine[e, 4] * x + affine[e, 5] * y
            least = min(l1, l2, 1.0 - l1 - l2)
            if least > best:
                element, best, b1, b2 = e, least, l1, l2
                if least >= 0.0:
                    break
    return element, b1, b2


@njit(cache=True, error_model="numpy", nogil=True)
def find(points, search, element, barycentric):
    """Element and barycentric coordinates of each point."""
    affine, start, items, origin, inverse_size, shape, margin = search
    for k in range(points.shape[0]):
        e, l1, l2 = _triangle_at(
            points[k, 0], points[k, 1], -1, affine, start, items, origin, inverse_size, shape, margin
        )
        element[k] = e
        barycentric[k, 0], barycentric[k, 1], barycentric[k, 2] = 1.0 - l1 - l2, l1, l2


@njit(cache=True, error_model="numpy", nogil=True, parallel=True)
def sample(position, hint, search, order, powers, H, grad):
    """H and grad H at every point; `hint` becomes the elements, -1 for points outside.

    Parallel for one thread as well: without numba's knowledge that the arrays do not overlap it takes half as
    long again.
    """
    n = position.shape[0]
    # a tuple within the parallel loop would cost a sixth
    affine, start, items, origin, inverse_size, shape, margin = search
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        for k in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            x, y, z = position[k, 0], position[k, 1], position[k, 2]
            r = np.sqrt(x * x + y * y)
            e, l1, l2 = _triangle_at(r, z, hint[k], affine, start, items, origin, inverse_size, shape, margin)
            hint[k] = e
            if e < 0:
                continue
            # nested Horner scheme: powers of l1 outside, of l2 inside, both from the highest down
            h_r = h_z = rr = rz = zr = zz = 0.0
            row = 0
            for i in range(order + 1):
                c0, c1, c2 = powers[e, row, 0], powers[e, row, 1], powers[e, row, 2]
                c3, c4, c5 = powers[e, row, 3], powers[e, row, 4], powers[e, row, 5]
                row += 1
                for _ in range(i):
                    c0, c1, c2 = c0 * l2 + powers[e, row, 0], c1 * l2 + powers[e, row, 1], c2 * l2 + powers[e, row, 2]
                    c3, c4, c5 = c3 * l2 + powers[e, row, 3], c4 * l2 + powers[e, row, 4], c5 * l2 + powers[e, row, 5]
                    row += 1
                h_r, h_z, rr = h_r * l1 + c0, h_z * l1 + c1, rr * l1 + c2
                rz, zr, zz = rz * l1 + c3, zr * l1 + c4, zz * l1 + c5
            cos, sin, hoop = x / r, y / r, h_r / r
            H[k, 0], H[k, 1], H[k, 2] = cos * h_r, sin * h_r, h_z
            grad[k, 0, 0] = cos * cos * rr + sin * sin * hoop
            grad[k, 1, 1] = sin * sin * rr + cos * cos * hoop
            grad[k, 0, 1] = grad[k, 1, 0] = cos * sin * (rr - hoop)
            grad[k, 0, 2], grad[k, 1, 2] = cos * rz, sin * rz
            grad[k, 2, 0], grad[k, 2, 1] = cos * zr, sin * zr
            grad[k, 2, 2] = zz
