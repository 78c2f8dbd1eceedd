"""Reference tetrahedron: linear and quadratic Lagrange shape functions, quadrature with positive weights.

Reference coordinates (x, y, z) >= 0 with x + y + z <= 1; barycentric ones are (1 - x - y - z, x, y, z).
Nodes: the four corners, then the middles of the edges in `EDGES`, as in `geometry.mesh_3d`.
"""

from __future__ import annotations

import numpy as np

EDGES = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
_SLOPES = np.vstack((-np.ones(3), np.eye(3)))  # of the barycentric coordinates


def barycentric(xi: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (k, 4) of reference points (k, 3)."""
    return np.column_stack((1.0 - xi.sum(axis=1), xi))


def shape(xi: np.ndarray, order: int) -> np.ndarray:
    """Shape functions at reference points (k, 3): shape (k, 4) for order 1, (k, 10) for order 2."""
    value = barycentric(xi)
    if order == 1:
        return value
    i, j = EDGES.T
    return np.concatenate((value * (2.0 * value - 1.0), 4.0 * value[:, i] * value[:, j]), axis=1)


def shape_slopes(xi: np.ndarray, order: int) -> np.ndarray:
    """Derivatives of the shape functions at reference points (k, 3): shape (k, 4 or 10, 3)."""
    value = barycentric(xi)
    if order == 1:
        return np.tile(_SLOPES, (len(xi), 1, 1))
    corner = (4.0 * value - 1.0)[:, :, None] * _SLOPES
    i, j = EDGES.T
    middle = 4.0 * (value[:, i, None] * _SLOPES[j] + value[:, j, None] * _SLOPES[i])
    return np.concatenate((corner, middle), axis=1)


def second_order_rule() -> tuple[np.ndarray, np.ndarray]:
    """Four points, exact for quadratics (Hammer and Stroud 1956); points (4, 3), weights (4,)."""
    a = (5.0 - np.sqrt(5.0)) / 20.0
    return _from_barycentric(_corner_orbit(a)), np.full(4, 1.0 / 24.0)


def fifth_order_rule() -> tuple[np.ndarray, np.ndarray]:
    """Fourteen points inside, exact for quintics (Walkington 2000); points (14, 3), weights (14,).

    No point lies on a face, where a plateau source jumps.
    """
    b = 0.045503704125649649492
    edge = np.full((6, 4), b)
    for row, (i, j) in enumerate(EDGES):
        edge[row, [i, j]] = 0.5 - b
    points = np.vstack((_corner_orbit(0.31088591926330060980), _corner_orbit(0.092735250310891226402), edge))
    weights = np.repeat((0.018781320953002641800, 0.012248840519393658257, 0.0070910034628469110730), (4, 4, 6))
    return _from_barycentric(points), weights


def triangle_rule() -> tuple[np.ndarray, np.ndarray]:
    """Twelve points of the reference triangle, exact for sextics (Dunavant 1985); points (12, 2), weights (12,)."""
    rows, weights = [], []
    for a, weight in ((0.249286745170910, 0.116786275726379), (0.063089014491502, 0.050844906370207)):
        rows += [(a, a), (a, 1.0 - 2.0 * a), (1.0 - 2.0 * a, a)]
        weights += [weight] * 3
    a, b = 0.053145049844817, 0.310352451033784
    c = 1.0 - a - b
    rows += [(a, b), (b, a), (a, c), (c, a), (b, c), (c, b)]
    weights += [0.082851075618374] * 6
    return np.array(rows), 0.5 * np.array(weights)


def face_shape(points: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of a face at points (k, 2), and their slopes: (k, 3 or 6), (k, 3 or 6, 2).

    Nodes: the corners, then the middles of the edges (0,1), (1,2), (0,2).
    """
    value = np.column_stack((1.0 - points.sum(axis=1), points))
    slopes = np.vstack((-np.ones(2), np.eye(2)))
    if order == 1:
        return value, np.tile(slopes, (len(points), 1, 1))
    i, j = EDGES[:3].T
    function = np.concatenate((value * (2.0 * value - 1.0), 4.0 * value[:, i] * value[:, j]), axis=1)
    corner = (4.0 * value - 1.0)[:, :, None] * slopes
    middle = 4.0 * (value[:, i, None] * slopes[j] + value[:, j, None] * slopes[i])
    return function, np.concatenate((corner, middle), axis=1)


def _corner_orbit(a: float) -> np.ndarray:
    points = np.full((4, 4), a)
    np.fill_diagonal(points, 1.0 - 3.0 * a)
    return points


def _from_barycentric(points: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(points[:, 1:])
