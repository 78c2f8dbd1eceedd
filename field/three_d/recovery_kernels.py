"""Compiled kernels of the recovery in 3D: least-squares fits of polynomials on stencils, and their derivatives.

They share `_monomials` and `_power` and stand in one file because a cached kernel does not notice a change of a callee
in another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function


class Stencils(NamedTuple):
    """The samples of n fits of one degree, and the coordinates that each is made in.

    Attributes
    ----------
    indptr, samples : ndarray, shapes (n + 1,), (k,)
        Nodes of each fit, row by row.
    centre : ndarray, shape (n, 3)
        Of each stencil [m]: a one-sided one is far better conditioned from there.
    frame : ndarray, shape (n, 3, 3)
        Scaled coordinates are frame @ (x - centre).
    """

    indptr: np.ndarray
    samples: np.ndarray
    centre: np.ndarray
    frame: np.ndarray


@device_function(error_model="numpy")
def _monomials(frame, k, dx, dy, dz, parent, axis, m):
    x = frame[k, 0, 0] * dx + frame[k, 0, 1] * dy + frame[k, 0, 2] * dz
    y = frame[k, 1, 0] * dx + frame[k, 1, 1] * dy + frame[k, 1, 2] * dz
    z = frame[k, 2, 0] * dx + frame[k, 2, 1] * dy + frame[k, 2, 2] * dz
    m[0] = 1.0
    for i in range(1, parent.size):
        m[i] = m[parent[i]] * (x if axis[i] == 0 else (y if axis[i] == 1 else z))


@njit(cache=True, error_model="numpy", nogil=True)
def factorise(nodes, stencils, parent, axis, least, m, factor, good):
    """Cholesky factors of the Gram matrices; not ``good`` where a pivot is not above ``least`` of its diagonal."""
    indptr, samples, centre, frame = stencils
    n = parent.size
    for k in range(centre.shape[0]):
        L = factor[k]
        L[:, :] = 0.0
        for s in range(indptr[k], indptr[k + 1]):
            p = samples[s]
            dx, dy, dz = nodes[p, 0] - centre[k, 0], nodes[p, 1] - centre[k, 1], nodes[p, 2] - centre[k, 2]
            _monomials(frame, k, dx, dy, dz, parent, axis, m)
            for i in range(n):
                for j in range(i + 1):
                    L[i, j] += m[i] * m[j]
        good[k] = True
        for i in range(n):
            diagonal = L[i, i]
            for j in range(i):
                value = L[i, j]
                for l in range(j):
                    value -= L[i, l] * L[j, l]
                L[i, j] = value / L[j, j]
            pivot = diagonal
            for l in range(i):
                pivot -= L[i, l] * L[i, l]
            if not pivot > least * diagonal:
                good[k] = False
                break
            L[i, i] = np.sqrt(pivot)


@device_function(error_model="numpy")
def _power(x, n):
    value = 1.0
    for _ in range(n):
        value *= x
    return value


@njit(cache=True, error_model="numpy", nogil=True)
def limit_noise(at, exponents, factor, count, most, w, good):
    """Reject fits that amplify noise: of samples' weights W for a derivative d, |W|^2 = d . (Gram matrix)^-1 d."""
    n = exponents.shape[0]
    for k in range(at.shape[0]):
        if not good[k]:
            continue
        L = factor[k]
        for axis in range(3):
            square = 0.0
            for i in range(n):
                value = 1.0
                for b in range(3):
                    a = exponents[i, b]
                    if b == axis:
                        value *= a * _power(at[k, b], a - 1)
                    else:
                        value *= _power(at[k, b], a)
                for j in range(i):
                    value -= L[i, j] * w[j]
                w[i] = value / L[i, i]
                square += w[i] * w[i]
            # sqrt(n) |W| bounds the sum of the weights' sizes
            if not square * count[k] < most * most:
                good[k] = False
                break


@njit(cache=True, error_model="numpy", nogil=True)
def apply(nodes, stencils, parent, axis, factor, values, m, coefficients, row):
    """Add the fits of ``values`` (k,) at the samples to the ``row``s of the coefficients."""
    indptr, samples, centre, frame = stencils
    n = parent.size
    for k in range(centre.shape[0]):
        a = coefficients[row[k]]
        L = factor[k]
        for s in range(indptr[k], indptr[k + 1]):
            p = samples[s]
            dx, dy, dz = nodes[p, 0] - centre[k, 0], nodes[p, 1] - centre[k, 1], nodes[p, 2] - centre[k, 2]
            _monomials(frame, k, dx, dy, dz, parent, axis, m)
            for i in range(n):
                a[i] += m[i] * values[s]
        for i in range(n):
            for j in range(i):
                a[i] -= L[i, j] * a[j]
            a[i] /= L[i, i]
        for i in range(n - 1, -1, -1):
            for j in range(i + 1, n):
                a[i] -= L[j, i] * a[j]
            a[i] /= L[i, i]


@njit(cache=True, error_model="numpy", nogil=True)
def derive(nodes, centre, coefficients, frame, exponents, polynomial, target, weight, nodal):
    """Add weight times -(grad, Hessian) of each polynomial at its target to the nodal values."""
    for k in range(polynomial.size):
        c, t = polynomial[k], target[k]
        F = frame[c]
        dx, dy, dz = nodes[t, 0] - centre[c, 0], nodes[t, 1] - centre[c, 1], nodes[t, 2] - centre[c, 2]
        x = F[0, 0] * dx + F[0, 1] * dy + F[0, 2] * dz
        y = F[1, 0] * dx + F[1, 1] * dy + F[1, 2] * dz
        z = F[2, 0] * dx + F[2, 1] * dy + F[2, 2] * dz
        gx = gy = gz = hxx = hyy = hzz = hxy = hxz = hyz = 0.0
        for i in range(exponents.shape[0]):
            a, b, d = exponents[i, 0], exponents[i, 1], exponents[i, 2]
            value = coefficients[c, i]
            if value == 0.0:
                continue
            px, py, pz = _power(x, a), _power(y, b), _power(z, d)
            p1x, p1y, p1z = a * _power(x, a - 1), b * _power(y, b - 1), d * _power(z, d - 1)
            gx += value * p1x * py * pz
            gy += value * px * p1y * pz
            gz += value * px * py * p1z
            hxx += value * a * (a - 1) * _power(x, a - 2) * py * pz
            hyy += value * b * (b - 1) * _power(y, b - 2) * px * pz
            hzz += value * d * (d - 1) * _power(z, d - 2) * px * py
            hxy += value * p1x * p1y * pz
            hxz += value * p1x * py * p1z
            hyz += value * px * p1y * p1z
        for i in range(3):
            nodal[t, i] -= weight * (F[0, i] * gx + F[1, i] * gy + F[2, i] * gz)
            u = F[0, i] * hxx + F[1, i] * hxy + F[2, i] * hxz
            v = F[0, i] * hxy + F[1, i] * hyy + F[2, i] * hyz
            w = F[0, i] * hxz + F[1, i] * hyz + F[2, i] * hzz
            for j in range(3):
                nodal[t, 3 + 3 * i + j] -= weight * (u * F[0, j] + v * F[1, j] + w * F[2, j])
