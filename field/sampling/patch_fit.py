"""Least-squares polynomials on patches of elements around vertices, as sparse operators.

The samples may sit at the nodes of the elements (psi) or at their centroids (the fill).  Between its three
vertices an element blends their polynomials by its barycentric coordinates (on an edge that is the mean of
both ends' of Zhang and Naga, SIAM J. Sci. Comput. 26, 2005).

`vacuum` narrows the polynomials to those that solve the equation of psi without current in a medium of
constant permeability,

    r (psi_rr + psi_zz) = psi_r,

up to their degree d: 2 d + 1 free coefficients instead of (d + 1)(d + 2)/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.polynomial.legendre import leg2poly, legvander

# Least squares with Legendre polynomials over the stencil's box (whole stencils have conditions of 4 to 120 for
# degrees 2 to 6):
# beyond this one the fit follows rounding and element noise.  The stencil then gets one more ring, and where
# there are too few layers for that to help, a lower degree.
_MAX_CONDITION = 1e3
_MAX_RINGS = 3
_CHUNK = 1024


@dataclass(frozen=True, slots=True)
class PatchPolynomials:
    """A polynomial at each vertex, linear in the samples.

    Attributes
    ----------
    centres, scale : ndarray (n_vertices, 2)
        Middles of the patches [m], and the lengths [m] by which the distance to them is divided.
    degree : int
    free : csr_matrix (n_vertices * n_free, n_samples)
        Free coefficients from samples.
    expand : ndarray (n_vertices, n_powers, n_free) or None
        From free coefficients to those of the powers, in the order of `falling_powers`; None: the same.
    """

    centres: np.ndarray
    scale: np.ndarray
    degree: int
    free: sp.csr_matrix
    expand: np.ndarray | None

    def derivatives(
        self, samples: np.ndarray, points: np.ndarray, vertices: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """Blended polynomials of sample values.

        Parameters
        ----------
        samples : ndarray (n_samples,)
        points : ndarray (n, 2)
            [m]
        vertices, weight : ndarray (n, k)
            Whose polynomials to take with which weight at each point (weight 0: not at all).

        Returns
        -------
        ndarray (6, n)
            Value, d/dr, d/dz, d2/dr2, d2/drdz, d2/dz2.
        """
        coefficients = (self.free @ samples).reshape(len(self.centres), -1)
        if self.expand is not None:
            coefficients = (self.expand @ coefficients[:, :, None])[:, :, 0]
        out = np.zeros((6, len(points)))
        _evaluate(coefficients, self.centres, self.scale, self.degree, points, vertices, weight, out)
        return out


def falling_powers(degree: int) -> list[tuple[int, int]]:
    """Exponents of x^i y^j up to a degree, i falling and then j: the order in which Horner's scheme takes them."""
    return [(degree - i, i - k) for i in range(degree + 1) for k in range(i + 1)]


class PatchFit:
    """Patches of a triangulation and the fits on them.

    Parameters
    ----------
    points : ndarray (n_vertices, 2)
        Vertices [m].
    corner : ndarray (n_elements, 3)
        Vertices of each element.
    """

    def __init__(self, points: np.ndarray, corner: np.ndarray) -> None:
        self._points = points
        element = np.repeat(np.arange(len(corner)), 3)
        self._touches = sp.csr_matrix(
            (np.ones(element.size), (corner.ravel(), element)), shape=(len(points), len(corner))
        )

    def fit(self, holds: sp.csr_matrix, samples: np.ndarray, degree: int, *, vacuum: bool = False) -> PatchPolynomials:
        """The polynomials of all vertices.

        Parameters
        ----------
        holds : csr_matrix (n_elements, n_samples)
            Nonzero where a sample belongs to an element.
        samples : ndarray (n_samples, 2)
            Where they are [m].
        degree : int
            Of the polynomials; less where the region is too thin for it.
        vacuum : bool
            Only solutions of the source-free equation of psi.

        Raises
        ------
        ValueError
            Too few elements for even a plane.
        """
        highest, n_powers = degree, (degree + 1) * (degree + 2) // 2
        n_free = 2 * degree + 1 if vacuum else n_powers
        expand = np.zeros((len(self._points), n_powers, n_free)) if vacuum else None
        centres, scale = self._points.copy(), np.ones_like(self._points)
        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        waiting = np.arange(len(self._points))
        ring = (self._touches @ self._touches.T).tocsr()
        patch = (ring @ self._touches).tocsr()  # two rings of elements

        def attempt(degree: int) -> np.ndarray:
            stencil = (patch[waiting] @ holds).tocsr()
            # stencils of like size together: less padding
            order = np.argsort(np.diff(stencil.indptr), kind="stable")
            undone = [
                self._fit_some(waiting[rows], stencil[rows], samples, degree, highest, expand, centres, scale, parts)
                for rows in np.split(order, range(_CHUNK, order.size, _CHUNK))
            ]
            return np.concatenate(undone)

        for _ in range(2, _MAX_RINGS + 1):
            waiting = attempt(degree)
            if waiting.size == 0:
                break
            patch = (ring @ patch).tocsr()
            patch.data[:] = 1.0
        while waiting.size and degree > 1:
            # a region of one or two element layers carries no higher degree, however many rings
            degree -= 1
            waiting = attempt(degree)
        if waiting.size:
            r, z = self._points[waiting[0]]
            raise ValueError(
                f"the field's derivatives cannot be recovered at r = {r:.6g} m, z = {z:.6g} m: "
                "too few elements in this region; refine its mesh"
            )
        row, column, value = (np.concatenate(part) for part in zip(*parts, strict=True))
        shape = (len(self._points) * n_free, holds.shape[1])
        return PatchPolynomials(centres, scale, highest, sp.csr_matrix((value, (row, column)), shape=shape), expand)

    def _fit_some(
        self,
        vertices: np.ndarray,
        stencil: sp.csr_matrix,
        samples: np.ndarray,
        degree: int,
        highest: int,
        expand: np.ndarray | None,
        centres: np.ndarray,
        scale: np.ndarray,
        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    ) -> np.ndarray:
        """Fit at these vertices, append the coefficients to `parts`, return the vertices left undone."""
        powers = falling_powers(degree)
        count = np.diff(stencil.indptr)
        enough = count >= (len(powers) if expand is None else 2 * degree + 1)
        undone = vertices[~enough]
        if not enough.any():
            return undone
        vertices, stencil, count = vertices[enough], stencil[np.flatnonzero(enough)], count[enough]
        # padded to the longest stencil; padded rows are zero and carry no weight
        mask = np.arange(int(count.max())) < count[:, None]
        column = np.zeros(mask.shape, dtype=np.int64)
        column[mask] = stencil.indices
        where = samples[column]
        highest_corner = np.where(mask[..., None], where, -np.inf).max(axis=1)
        lowest_corner = np.where(mask[..., None], where, np.inf).min(axis=1)
        # about the middle of the stencil and scaled by its extents (a thin gap's elements may be long and flat)
        middle, extent = 0.5 * (highest_corner + lowest_corner), 0.5 * (highest_corner - lowest_corner)
        # samples in one line are no stencil: their condition will say so, without a division by zero
        extent = np.maximum(extent, 1e-6 * extent.max(axis=1, keepdims=True))
        if expand is not None:
            # the equation of psi wants both directions scaled alike
            extent[:] = extent.max(axis=1, keepdims=True)
        x, y = (np.where(mask[..., None], where - middle[:, None, :], 0.0) / extent[:, None, :]).transpose(2, 0, 1)
        x_basis, y_basis = legvander(x, degree) * mask[..., None], legvander(y, degree)
        terms = np.stack([x_basis[..., i] * y_basis[..., j] for i, j in powers], axis=2)
        monomials = _legendre_to_powers(powers)
        if expand is not None:
            solutions = _vacuum_polynomials(extent[:, 0] / middle[:, 0], degree, powers)
            terms = terms @ (np.linalg.inv(monomials) @ solutions)
        # eigenvalues of the normal matrix: the condition's square, still far from the limits of double precision
        transposed = np.ascontiguousarray(terms.transpose(0, 2, 1))
        values, vectors = np.linalg.eigh(transposed @ terms)
        good = values[:, 0] * _MAX_CONDITION**2 > values[:, -1]
        undone = np.concatenate((undone, vertices[~good]))
        vertices, mask, column = vertices[good], mask[good], column[good]
        if vertices.size == 0:
            return undone
        vectors = vectors[good]
        inverse = (vectors / values[good][:, None, :]) @ vectors.transpose(0, 2, 1) @ transposed[good]
        centres[vertices], scale[vertices] = middle[good], extent[good]
        if expand is None:
            inverse = monomials @ inverse
        everything = falling_powers(highest)
        slot = np.array([everything.index(power) for power in powers])
        if expand is None:
            rows = vertices[:, None, None] * len(everything) + slot[:, None]
        else:
            # a lower degree leaves the last free coefficients unused
            rows = vertices[:, None, None] * expand.shape[2] + np.arange(terms.shape[2])[:, None]
            expand[vertices[:, None, None], slot[:, None], np.arange(terms.shape[2])] = solutions[good]
        kept = np.broadcast_to(mask[:, None, :], inverse.shape)
        parts.append(
            (
                np.broadcast_to(rows, inverse.shape)[kept],
                np.broadcast_to(column[:, None, :], inverse.shape)[kept],
                inverse[kept],
            )
        )
        return undone


def _legendre_to_powers(powers: list[tuple[int, int]]) -> np.ndarray:
    """Coefficients of x^i y^j from those of the products P_i(x) P_j(y), both in the order of `powers`."""
    degree = max(i + j for i, j in powers)
    series = np.zeros((degree + 1, degree + 1))
    for i in range(degree + 1):
        series[: i + 1, i] = leg2poly(np.eye(degree + 1)[i])[: i + 1]
    return np.array([[series[i, k] * series[j, m] for k, m in powers] for i, j in powers])


def _vacuum_polynomials(ratio: np.ndarray, degree: int, powers: list[tuple[int, int]]) -> np.ndarray:
    """Polynomials in x = (r - r_0)/s, y = (z - z_0)/s that solve the source-free equation up to their degree.

    With ratio = s/r_0:  (1 + ratio x)(psi_xx + psi_yy) = ratio psi_x.  The coefficients of y^j and x y^j are
    free, the others follow by recursion in the power of x.

    Returns
    -------
    ndarray (n, len(powers), 2 degree + 1)
    """
    a = np.zeros((ratio.size, degree + 1, degree + 1, 2 * degree + 1))  # of x^i y^j
    for j in range(degree + 1):
        a[:, 0, j, j] = 1.0
    for j in range(degree):
        a[:, 1, j, degree + 1 + j] = 1.0
    e = ratio[:, None]
    for i in range(degree - 1):
        for j in range(degree - 1 - i):
            right = -(j + 2) * (j + 1) * a[:, i, j + 2] - e * (i + 1) * (i - 1) * a[:, i + 1, j]
            if i > 0:
                right = right - e * (j + 2) * (j + 1) * a[:, i - 1, j + 2]
            a[:, i + 2, j] = right / ((i + 2) * (i + 1))
    return np.stack([a[:, i, j] for i, j in powers], axis=1)


@njit(cache=True, error_model="numpy", nogil=True)
def _evaluate(coefficients, centres, scale, degree, points, vertices, weight, out):
    for n in range(points.shape[0]):
        for m in range(vertices.shape[1]):
            fraction = weight[n, m]
            if fraction == 0.0:
                continue
            v = vertices[n, m]
            x, y = (points[n, 0] - centres[v, 0]) / scale[v, 0], (points[n, 1] - centres[v, 1]) / scale[v, 1]
            # Horner with derivatives: value, first, and half the second one, in y inside and in x outside
            a0 = a1 = a2 = b0 = b1 = c0 = 0.0
            row = 0
            for i in range(degree + 1):
                p0 = p1 = p2 = 0.0
                for _ in range(i + 1):
                    p2 = p2 * y + p1
                    p1 = p1 * y + p0
                    p0 = p0 * y + coefficients[v, row]
                    row += 1
                a2 = a2 * x + a1
                a1 = a1 * x + a0
                a0 = a0 * x + p0
                b1 = b1 * x + b0
                b0 = b0 * x + p1
                c0 = c0 * x + p2
            out[0, n] += fraction * a0
            out[1, n] += fraction * a1 / scale[v, 0]
            out[2, n] += fraction * b0 / scale[v, 1]
            out[3, n] += fraction * 2.0 * a2 / scale[v, 0] ** 2
            out[4, n] += fraction * b1 / (scale[v, 0] * scale[v, 1])
            out[5, n] += fraction * 2.0 * c0 / scale[v, 1] ** 2
