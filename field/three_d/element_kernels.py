"""Compiled kernels of nodal elements on tetrahedra: measure, gradient, residual and tangent, and the matrix's pattern.

They share `_inverse` and `_position` and stand in one file because a cached kernel does not notice a change of a callee
in another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function


class Tetrahedra(NamedTuple):
    """Nodes in 3D and by element.

    Attributes
    ----------
    points : ndarray, shape (n_nodes, 3)
        [m]
    nodes, unknowns : ndarray, shape (n_elements, 4 or 10)
        Of each element; an unknown is -1 where the node is held at zero.
    """

    points: np.ndarray
    nodes: np.ndarray
    unknowns: np.ndarray


class Quadrature(NamedTuple):
    """Two rules behind one another, and which of them an element has.

    Attributes
    ----------
    slopes : ndarray, shape (n_rules, 4 or 10, 3)
        Gradients of the shape functions on the reference tetrahedron.
    rule : ndarray, shape (n_elements,)
        Row of ``slopes`` at which an element's rule begins.
    start : ndarray, shape (n_elements + 1,)
        First quadrature point of each element.
    weight : ndarray, shape (n_quadrature,)
        [m^3]
    """

    slopes: np.ndarray
    rule: np.ndarray
    start: np.ndarray
    weight: np.ndarray


class Pattern(NamedTuple):
    """Rows of the matrix: first entry of each, and the entries' columns."""

    indptr: np.ndarray
    indices: np.ndarray


@device_function(error_model="numpy")
def _inverse(points, nodes, e, slopes, s, n):
    """Determinant and cofactors of dx/dxi: the nine numbers are the inverse times the determinant."""
    a00 = a01 = a02 = a10 = a11 = a12 = a20 = a21 = a22 = 0.0
    for i in range(n):
        p = nodes[e, i]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        u, v, w = slopes[s, i, 0], slopes[s, i, 1], slopes[s, i, 2]
        a00 += x * u
        a01 += x * v
        a02 += x * w
        a10 += y * u
        a11 += y * v
        a12 += y * w
        a20 += z * u
        a21 += z * v
        a22 += z * w
    c00, c01, c02 = a11 * a22 - a12 * a21, a02 * a21 - a01 * a22, a01 * a12 - a02 * a11
    c10, c11, c12 = a12 * a20 - a10 * a22, a00 * a22 - a02 * a20, a02 * a10 - a00 * a12
    c20, c21, c22 = a10 * a21 - a11 * a20, a01 * a20 - a00 * a21, a00 * a11 - a01 * a10
    det = a00 * c00 + a01 * c10 + a02 * c20
    return det, c00, c01, c02, c10, c11, c12, c20, c21, c22


@njit(cache=True, error_model="numpy", nogil=True)
def measure(elements, quadrature, shape, rule_weight, where):
    """Fill the weights and the places of the quadrature points; the smallest determinant."""
    points, nodes, _ = elements
    slopes, rule, start, weight = quadrature
    worst = 1.0
    n = nodes.shape[1]
    for e in range(nodes.shape[0]):
        for q in range(start[e], start[e + 1]):
            s = rule[e] + q - start[e]
            det = _inverse(points, nodes, e, slopes, s, n)[0]
            worst = min(worst, det)
            weight[q] = det * rule_weight[s]
            for a in range(3):
                value = 0.0
                for i in range(n):
                    value += shape[s, i] * points[nodes[e, i], a]
                where[q, a] = value
    return worst


@njit(cache=True, error_model="numpy", nogil=True)
def gradient(elements, quadrature, phi, out):
    """Gradient of the nodal values ``phi`` at the quadrature points."""
    points, nodes, _ = elements
    slopes, rule, start, _ = quadrature
    n = nodes.shape[1]
    for e in range(nodes.shape[0]):
        for q in range(start[e], start[e + 1]):
            s = rule[e] + q - start[e]
            det, c00, c01, c02, c10, c11, c12, c20, c21, c22 = _inverse(points, nodes, e, slopes, s, n)
            u = v = w = 0.0
            for i in range(n):
                value = phi[nodes[e, i]]
                u += slopes[s, i, 0] * value
                v += slopes[s, i, 1] * value
                w += slopes[s, i, 2] * value
            out[q, 0] = (c00 * u + c10 * v + c20 * w) / det
            out[q, 1] = (c01 * u + c11 * v + c21 * w) / det
            out[q, 2] = (c02 * u + c12 * v + c22 * w) / det


@njit(cache=True, error_model="numpy", nogil=True)
def divergence(elements, quadrature, flow, out):
    """Add the integral of flow . grad v for every unknown's v."""
    points, nodes, unknowns = elements
    slopes, rule, start, weight = quadrature
    n = nodes.shape[1]
    for e in range(nodes.shape[0]):
        for q in range(start[e], start[e + 1]):
            s = rule[e] + q - start[e]
            det, c00, c01, c02, c10, c11, c12, c20, c21, c22 = _inverse(points, nodes, e, slopes, s, n)
            factor = weight[q] / det
            x, y, z = flow[q, 0] * factor, flow[q, 1] * factor, flow[q, 2] * factor
            u, v, w = c00 * x + c01 * y + c02 * z, c10 * x + c11 * y + c12 * z, c20 * x + c21 * y + c22 * z
            for i in range(n):
                k = unknowns[e, i]
                if k >= 0:
                    out[k] += slopes[s, i, 0] * u + slopes[s, i, 1] * v + slopes[s, i, 2] * w


@device_function(error_model="numpy")
def _position(indptr, indices, row, column):
    low, high = indptr[row], indptr[row + 1]
    while high - low > 1:
        middle = (low + high) >> 1
        if indices[middle] <= column:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, error_model="numpy", nogil=True)
def tangent(elements, quadrature, pattern, a, c, d, scratch, data):
    """Add  integral of  a grad u . grad v + c (d . grad u)(d . grad v)  to the pattern's data; d of any length.

    ``scratch``: two arrays (n, 3) and one (n, n), n the nodes of an element.
    """
    points, nodes, unknowns = elements
    slopes, rule, start, weight = quadrature
    indptr, indices = pattern
    G, D, block = scratch
    n = nodes.shape[1]
    for e in range(nodes.shape[0]):
        for i in range(n):
            for j in range(i, n):
                block[i, j] = 0.0
        for q in range(start[e], start[e + 1]):
            s = rule[e] + q - start[e]
            det, c00, c01, c02, c10, c11, c12, c20, c21, c22 = _inverse(points, nodes, e, slopes, s, n)
            x, y, z = d[q, 0], d[q, 1], d[q, 2]
            square = x * x + y * y + z * z
            wa = a[q] * weight[q]
            wc = c[q] * weight[q] / square if square > 0.0 else 0.0
            for i in range(n):
                u, v, w = slopes[s, i, 0], slopes[s, i, 1], slopes[s, i, 2]
                g0 = (c00 * u + c10 * v + c20 * w) / det
                g1 = (c01 * u + c11 * v + c21 * w) / det
                g2 = (c02 * u + c12 * v + c22 * w) / det
                along = wc * (x * g0 + y * g1 + z * g2)
                G[i, 0], G[i, 1], G[i, 2] = g0, g1, g2
                D[i, 0], D[i, 1], D[i, 2] = wa * g0 + along * x, wa * g1 + along * y, wa * g2 + along * z
            for i in range(n):
                for j in range(i, n):
                    block[i, j] += G[i, 0] * D[j, 0] + G[i, 1] * D[j, 1] + G[i, 2] * D[j, 2]
        for i in range(n):
            row = unknowns[e, i]
            if row < 0:
                continue
            for j in range(n):
                column = unknowns[e, j]
                if column >= 0:
                    data[_position(indptr, indices, row, column)] += block[min(i, j), max(i, j)]


@njit(cache=True, error_model="numpy", nogil=True)
def scatter(unknowns, blocks, pattern, data):
    """Add small matrices (k, n, n) between unknowns (k, n) to the pattern's data."""
    indptr, indices = pattern
    for k in range(unknowns.shape[0]):
        for i in range(unknowns.shape[1]):
            row = unknowns[k, i]
            if row < 0:
                continue
            for j in range(unknowns.shape[1]):
                column = unknowns[k, j]
                if column >= 0:
                    data[_position(indptr, indices, row, column)] += blocks[k, i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def count_rows(first, elements, unknowns, marker, count):
    """Entries of each row, one place further on; row i is of the elements ``first[i]`` to ``first[i + 1]``."""
    for row in range(first.size - 1):
        n = 0
        for k in range(first[row], first[row + 1]):
            e = elements[k]
            for j in range(unknowns.shape[1]):
                column = unknowns[e, j]
                if column >= 0 and marker[column] != row:
                    marker[column] = row
                    n += 1
        count[row + 1] = n


@njit(cache=True, error_model="numpy", nogil=True)
def fill_rows(first, elements, unknowns, marker, indptr, indices):
    """Columns of each row, sorted."""
    for row in range(first.size - 1):
        n = indptr[row]
        for k in range(first[row], first[row + 1]):
            e = elements[k]
            for j in range(unknowns.shape[1]):
                column = unknowns[e, j]
                if column >= 0 and marker[column] != row:
                    marker[column] = row
                    indices[n] = column
                    n += 1
        indices[indptr[row] : n].sort()
