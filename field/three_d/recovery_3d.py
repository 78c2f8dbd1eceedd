"""Recovered H and grad H inside one region of a solid mesh.

At each corner of the region a polynomial of degree k+2 (k the elements' order) is fitted by least squares to
the total potential's nodal values on two rings of elements of the same region (Zhang and Naga, SIAM J. Sci.
Comput. 26, 2005); no stencil crosses a material interface.  Where the region is too thin for the degree the
stencil gets more rings, and in the end a lower degree.  On the middles of edges both ends' polynomials are
averaged; between the nodes the values are interpolated.

The reduced potential itself has kinks where the plateau source jumps.  On a patch without current H is the
gradient of one smooth function all the same, H = -grad(phi - g) with g the integral of T0 from the patch's
corner to the sample: that is what is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from .current_source import Source
from .elements_3d import Elements3D
from .tetrahedron_locator import TetrahedronLocator

if TYPE_CHECKING:
    from .field_3d import Field3D

_MAX_RINGS = 4
# Share of a monomial that the ones before it leave unexplained on the stencil (square of a Cholesky pivot over
# the diagonal): below it the fit follows noise.
_MIN_PIVOT = 2e-4
# Largest change of a derivative at the corner, over the stencil's reach, that noise of size 1 in the samples may
# make.  A good quartic has 30 to 150; where the stencil is a layer or two thick single pivots pass, but their
# errors multiply to 1e4, and the fit then recovers noise.
_MAX_NOISE = 200.0
_SHIFT = 1e-13  # of a Gram matrix's diagonal, so that a singular one has a factor too, with a pivot that is refused
_CHUNK = 256


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Least-squares fits of one degree, in coordinates u = frame (x - centre)."""

    corners: np.ndarray  # (k,) in the region's numbering
    degree: int
    samples: np.ndarray  # (k, s) nodes; rows are as long as the longest stencil
    kept: np.ndarray  # (k, s), False where a row has no more samples
    difference: np.ndarray  # (k, s), integral of the unit T0 from the corner to each sample
    centre: np.ndarray  # (k, 3) of the stencil [m]: a one-sided one is far better conditioned from there
    frame: np.ndarray  # (k, 3, 3)
    gram: np.ndarray  # (k, terms, terms), scalar products of the monomials over the samples


class Recovery3D:
    """Fits of the total potential on a region's corners.

    Parameters
    ----------
    elements : Elements3D
    region : ndarray (m,)
        Elements without current.
    source : Source

    Attributes
    ----------
    nodes : ndarray (n_nodes, 3)
        [m], corners first, then (quadratic elements) middles of edges.
    connectivity : ndarray (m, 4 or 10)
    degrees : dict of int to int
        Number of corners fitted with each degree.
    locator : TetrahedronLocator
    """

    def __init__(self, elements: Elements3D, region: np.ndarray, source: Source) -> None:
        element_nodes = elements.element_nodes[region]
        self._global, flat = np.unique(element_nodes, return_inverse=True)  # corners come first
        self.connectivity = np.ascontiguousarray(flat.reshape(element_nodes.shape))
        self.nodes = np.ascontiguousarray(elements.node_points[self._global])
        self._n_corners = int(np.count_nonzero(self._global < elements.n_corners))
        self._edge_ends = (
            np.searchsorted(self._global, elements.edge_ends[self._global[self._n_corners :] - elements.n_corners])
            if elements.order == 2
            else np.zeros((0, 2), dtype=np.int64)
        )
        self.locator = TetrahedronLocator(elements, region)
        self._source, self._degree = source, elements.order + 2
        self._fits: list[_Fits] = []
        self.degrees: dict[int, int] = {}
        self._fit_all(self._degree)

    def _fit_all(self, degree: int) -> None:
        m, n = self.connectivity.shape
        owner = np.repeat(np.arange(m), 4)
        touches = sp.csr_matrix(
            (np.ones(owner.size, dtype=np.float32), (self.connectivity[:, :4].ravel(), owner)),
            shape=(self._n_corners, m),
        )
        holds = sp.csr_matrix(
            (np.ones(m * n, dtype=np.float32), (np.repeat(np.arange(m), n), self.connectivity.ravel())),
            shape=(m, len(self.nodes)),
        )
        ring = (touches @ touches.T).tocsr()
        waiting = np.arange(self._n_corners)
        for rings in range(2, _MAX_RINGS + 1):
            waiting = self._fit_chunks(waiting, rings, ring, touches, holds, degree)
        while waiting.size and degree > 1:
            # a region of one or two element layers carries no higher degree, however many rings
            degree -= 1
            waiting = self._fit_chunks(waiting, 3, ring, touches, holds, degree)
        if waiting.size:
            x, y, z = self.nodes[waiting[0]]
            raise ValueError(
                f"the field's derivatives cannot be recovered at x = {x:.6g} m, y = {y:.6g} m, z = {z:.6g} m: "
                "too few elements in this region; refine its mesh"
            )

    def _fit_chunks(
        self,
        waiting: np.ndarray,
        rings: int,
        ring: sp.csr_matrix,
        touches: sp.csr_matrix,
        holds: sp.csr_matrix,
        degree: int,
    ) -> np.ndarray:
        """Fit these corners with stencils of so many rings of elements; return the ones left undone."""
        if waiting.size == 0:
            return waiting
        patch = ring[waiting]
        for _ in range(rings - 2):
            patch = patch @ ring
        stencil = (patch @ touches @ holds).tocsr()
        order = np.argsort(np.diff(stencil.indptr), kind="stable")  # stencils of like size together: less padding
        parts = np.split(order, range(_CHUNK, order.size, _CHUNK))
        return np.concatenate([self._fit(waiting[part], stencil[part], degree) for part in parts])

    def _fit(self, corners: np.ndarray, stencil: sp.csr_matrix, degree: int) -> np.ndarray:
        exponents = _exponents(degree)
        count = np.diff(stencil.indptr)
        kept = np.arange(int(count.max())) < count[:, None]
        samples = np.zeros(kept.shape, dtype=np.int64)
        samples[kept] = stencil.indices
        where = self.nodes[samples]
        centre = (where * kept[..., None]).sum(axis=1) / count[:, None]
        offset = (where - centre[:, None]) * kept[..., None]
        # coordinates along the stencil's principal axes, each scaled by its extent: a gap's may be thin and flat
        frame = np.linalg.eigh(offset.transpose(0, 2, 1) @ offset)[1].transpose(0, 2, 1)
        u = offset @ frame.transpose(0, 2, 1)
        reach = np.abs(u).max(axis=1)
        reach = np.maximum(reach, 1e-12 * reach.max(axis=1, keepdims=True))
        frame = frame / reach[:, :, None]
        terms = _monomials(u / reach[:, None], exponents) * kept[..., None]
        gram = terms.transpose(0, 2, 1) @ terms
        each = np.arange(len(exponents))
        diagonal = gram[:, each, each]
        shifted = gram.copy()
        shifted[:, each, each] *= 1.0 + _SHIFT
        factor = np.linalg.cholesky(shifted)
        good = (count >= len(exponents)) & np.all(factor[:, each, each] ** 2 > _MIN_PIVOT * diagonal, axis=1)
        # of samples' weights W for a derivative d, |W|^2 = d . (Gram matrix)^-1 d, and sqrt(n) |W| bounds the sum of
        # their sizes
        at_corner = np.einsum("kab,kb->ka", frame, self.nodes[corners] - centre)
        d = np.stack([_monomials(at_corner, exponents, (axis,)) for axis in range(3)], axis=2)
        square = (d * np.linalg.solve(shifted, d)).sum(axis=1)
        good &= np.all(square * count[:, None] < _MAX_NOISE**2, axis=1)
        if good.any():
            start = np.broadcast_to(self.nodes[corners][:, None], where.shape)
            paths = start[good].reshape(-1, 3), where[good].reshape(-1, 3)
            difference = self._source.potential_difference(*paths).reshape(-1, kept.shape[1])
            self._fits.append(
                _Fits(
                    corners[good], degree, samples[good], kept[good], difference, centre[good], frame[good],
                    gram[good],
                )
            )  # fmt: skip
            self.degrees[degree] = self.degrees.get(degree, 0) + int(np.count_nonzero(good))
        return corners[~good]

    def nodal(self, field: Field3D) -> np.ndarray:
        """H [A/m] and grad H [A/m^2], rows first, at the nodes: shape (n_nodes, 12)."""
        phi = field.phi[self._global]
        exponents = _exponents(self._degree)
        coefficients = np.zeros((self._n_corners, len(exponents)))
        frame, centre = np.empty((self._n_corners, 3, 3)), np.empty((self._n_corners, 3))
        for fit in self._fits:
            frame[fit.corners], centre[fit.corners] = fit.frame, fit.centre
            u = (self.nodes[fit.samples] - fit.centre[:, None]) @ fit.frame.transpose(0, 2, 1)
            values = np.where(fit.kept, phi[fit.samples] - field.ampere_turns * fit.difference, 0.0)
            right = values[:, None] @ _monomials(u, _exponents(fit.degree))
            solved = np.linalg.solve(fit.gram, right.transpose(0, 2, 1))[:, :, 0]
            coefficients[fit.corners, : solved.shape[1]] = solved
        nodal = np.zeros((len(self.nodes), 12))
        every = np.arange(self._n_corners)
        middle = self._n_corners + np.arange(len(self._edge_ends))
        for target, corner, weight in ((every, every, 1.0), *((middle, ends, 0.5) for ends in self._edge_ends.T)):
            F, a = frame[corner], coefficients[corner]
            u = np.einsum("kab,kb->ka", F, self.nodes[target] - centre[corner])

            def slope(*axes: int, u: np.ndarray = u, a: np.ndarray = a) -> np.ndarray:
                return (_monomials(u, exponents, axes) * a).sum(axis=1)

            first = np.stack([slope(i) for i in range(3)], axis=1)
            second = np.empty((len(target), 3, 3))
            for i in range(3):
                for j in range(i + 1):
                    second[:, i, j] = second[:, j, i] = slope(i, j)
            nodal[target, :3] -= weight * np.einsum("kai,ka->ki", F, first)
            nodal[target, 3:] -= weight * (F.transpose(0, 2, 1) @ second @ F).reshape(-1, 9)
        return nodal


def _exponents(degree: int) -> np.ndarray:
    """Of x^i y^j z^k up to a degree, the lower degrees first, shape (n, 3)."""
    return np.array(
        [(i, j, n - i - j) for n in range(degree + 1) for i in range(n, -1, -1) for j in range(n - i, -1, -1)]
    )


def _monomials(u: np.ndarray, exponents: np.ndarray, axes: tuple[int, ...] = ()) -> np.ndarray:
    """Monomials at points (..., 3), differentiated along these axes one after the other: shape (..., n)."""
    factor, exponents = np.ones(len(exponents)), exponents.copy()
    for axis in axes:
        factor *= exponents[:, axis]
        exponents[:, axis] = np.maximum(exponents[:, axis] - 1, 0)
    powers = np.ones((int(exponents.max()) + 1, *u.shape))
    for n in range(1, len(powers)):
        powers[n] = powers[n - 1] * u
    i, j, k = exponents.T
    product = powers[i, ..., 0] * powers[j, ..., 1] * powers[k, ..., 2]  # (n, ...)
    return np.moveaxis(product, 0, -1) * factor
