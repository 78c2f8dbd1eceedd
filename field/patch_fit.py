"""Least-squares polynomials on patches of elements around vertices, as one sparse operator.

The samples may sit at the nodes of the elements (psi) or at their centroids (the fill); what comes out are
values or derivatives at the vertices, and at the middles of the edges as the mean of both ends' polynomials
(Zhang and Naga, SIAM J. Sci. Comput. 26, 2005).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

# Least squares with scaled monomials: beyond this condition the fit follows rounding and element noise
# (a one-sided stencil of too few layers); the stencil then gets one more ring, in the end a lower degree.
_MAX_CONDITION = 2e3
_MAX_RINGS = 5
_CHUNK = 1024


class PatchFit:
    """Patches of a triangulation and the fits on them.

    Parameters
    ----------
    points : ndarray (n_vertices, 2)
        Vertices [m].
    corner : ndarray (n_elements, 3)
        Vertices of each element.
    edge_ends : ndarray (n_edges, 2)
        Vertices of each edge.
    """

    def __init__(self, points: np.ndarray, corner: np.ndarray, edge_ends: np.ndarray) -> None:
        self._points = points
        self._targets = np.concatenate((points, points[edge_ends].mean(axis=1)))
        element = np.repeat(np.arange(len(corner)), 3)
        self._touches = sp.csr_matrix(
            (np.ones(element.size), (corner.ravel(), element)), shape=(len(points), len(corner))
        )
        order = np.argsort(edge_ends.ravel(), kind="stable")
        self._edge_of = np.repeat(np.arange(len(edge_ends)), 2)[order]
        self._edge_start = np.searchsorted(edge_ends.ravel()[order], np.arange(len(points) + 1))

    def operator(
        self, holds: sp.csr_matrix, samples: np.ndarray, degree: int, derivatives: tuple[tuple[int, int], ...]
    ) -> sp.csr_matrix:
        """From sample values to derivatives at vertices and edge middles.

        Parameters
        ----------
        holds : csr_matrix (n_elements, n_samples)
            Nonzero where a sample belongs to an element.
        samples : ndarray (n_samples, 2)
            Where they are [m].
        degree : int
            Of the polynomials; less where the region is too thin for it.
        derivatives : tuple of (int, int)
            Orders in r and z of what is wanted, (0, 0) for the value.

        Returns
        -------
        csr_matrix (len(derivatives) * (n_vertices + n_edges), n_samples)
        """
        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        waiting = np.arange(len(self._points))
        ring = (self._touches @ self._touches.T).tocsr()
        patch = (ring @ self._touches).tocsr()  # two rings of elements
        for _ in range(2, _MAX_RINGS + 1):
            stencil = (patch[waiting] @ holds).tocsr()
            waiting = np.concatenate(
                [
                    self._fit(
                        waiting[low : low + _CHUNK], stencil[low : low + _CHUNK], samples, degree, derivatives, parts
                    )
                    for low in range(0, waiting.size, _CHUNK)
                ]
            )
            if waiting.size == 0:
                break
            patch = (ring @ patch).tocsr()
            patch.data[:] = 1.0
        while waiting.size and degree > 1:
            # a region of one or two element layers carries no higher degree, however many rings
            degree -= 1
            stencil = (patch[waiting] @ holds).tocsr()
            waiting = self._fit(waiting, stencil, samples, degree, derivatives, parts)
        if waiting.size:
            r, z = self._points[waiting[0]]
            raise ValueError(
                f"the field's derivatives cannot be recovered at r = {r:.6g} m, z = {z:.6g} m: "
                "too few elements in this region; refine its mesh"
            )
        row, column, value = (np.concatenate(part) for part in zip(*parts, strict=True))
        return sp.csr_matrix((value, (row, column)), shape=(len(derivatives) * len(self._targets), holds.shape[1]))

    def _fit(
        self,
        vertices: np.ndarray,
        stencil: sp.csr_matrix,
        samples: np.ndarray,
        degree: int,
        derivatives: tuple[tuple[int, int], ...],
        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    ) -> np.ndarray:
        """Fit at these vertices, append the operator's entries to `parts`, return the ones left undone."""
        powers = [(i, n - i) for n in range(degree + 1) for i in range(n + 1)]
        count = np.diff(stencil.indptr)
        enough = count >= len(powers)
        undone = vertices[~enough]
        if not enough.any():
            return undone
        vertices, stencil, count = vertices[enough], stencil[np.flatnonzero(enough)], count[enough]
        # padded to the longest stencil; padded rows are zero and carry no weight
        mask = np.arange(int(count.max())) < count[:, None]
        column = np.zeros(mask.shape, dtype=np.int64)
        column[mask] = stencil.indices
        offset = np.where(mask[..., None], samples[column] - self._points[vertices][:, None, :], 0.0)
        # scaled by the stencil's own extents: a thin gap's elements may be long and flat
        scale = np.abs(offset).max(axis=1)
        x, y = (offset / scale[:, None, :]).transpose(2, 0, 1)
        monomials = np.stack([x**i * y**j for i, j in powers], axis=2) * mask[..., None]
        U, s, Vt = np.linalg.svd(monomials, full_matrices=False)
        good = s[:, -1] * _MAX_CONDITION > s[:, 0]
        undone = np.concatenate((undone, vertices[~good]))
        vertices, mask, column, scale = vertices[good], mask[good], column[good], scale[good]
        if vertices.size == 0:
            return undone
        inverse = (Vt[good].transpose(0, 2, 1) / s[good][:, None, :]) @ U[good].transpose(0, 2, 1)

        # where each polynomial is evaluated: at its vertex with weight 1, on its edges with weight 1/2
        first = self._edge_start[vertices]
        n_edges = self._edge_start[vertices + 1] - first
        within = np.arange(n_edges.sum()) - np.repeat(np.cumsum(n_edges) - n_edges, n_edges)
        edges = self._edge_of[np.repeat(first, n_edges) + within]
        polynomial = np.concatenate((np.arange(vertices.size), np.repeat(np.arange(vertices.size), n_edges)))
        target = np.concatenate((vertices, len(self._points) + edges))
        weight = np.concatenate((np.ones(vertices.size), np.full(n_edges.sum(), 0.5)))
        where = (self._targets[target] - self._points[vertices[polynomial]]) / scale[polynomial]
        kept = mask[polynomial]
        columns = column[polynomial][kept]
        for d, (d_r, d_z) in enumerate(derivatives):
            row = np.stack([_power(where[:, 0], i, d_r) * _power(where[:, 1], j, d_z) for i, j in powers], axis=1)
            row *= (weight / (scale[polynomial, 0] ** d_r * scale[polynomial, 1] ** d_z))[:, None]
            entries = np.einsum("tc,tcm->tm", row, inverse[polynomial])
            rows = np.broadcast_to((d * len(self._targets) + target)[:, None], entries.shape)
            parts.append((rows[kept], columns, entries[kept]))
        return undone


def _power(x: np.ndarray, exponent: int, derivative: int) -> np.ndarray:
    """Derivative of x^exponent."""
    factor = 1.0
    for _ in range(derivative):
        factor, exponent = factor * exponent, exponent - 1
    return factor * x ** max(exponent, 0) if factor else np.zeros_like(x)
