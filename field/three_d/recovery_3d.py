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

from . import recovery_kernels as kernels
from .current_source import Source
from .elements_3d import Elements3D
from .recovery_kernels import Stencils
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
_CHUNK = 4096


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Least-squares fits of one degree, ready to be applied to nodal values."""

    corners: np.ndarray  # (n,) in the region's numbering
    stencils: Stencils
    difference: np.ndarray  # integral of the unit T0 from the corner to each sample
    factor: np.ndarray  # (n, terms, terms), lower Cholesky factors of the Gram matrices
    terms: _Monomials


@dataclass(frozen=True, slots=True, eq=False)
class _Monomials:
    """Monomials up to a degree: each but the first is an earlier one times a coordinate."""

    exponents: np.ndarray
    parent: np.ndarray
    axis: np.ndarray

    @classmethod
    def up_to(cls, degree: int) -> _Monomials:
        exponents = [
            (i, j, n - i - j) for n in range(degree + 1) for i in range(n, -1, -1) for j in range(n - i, -1, -1)
        ]
        position = {e: k for k, e in enumerate(exponents)}
        parent, axis = np.zeros(len(exponents), dtype=np.int64), np.zeros(len(exponents), dtype=np.int64)
        for k, e in enumerate(exponents[1:], start=1):
            axis[k] = next(a for a in range(3) if e[a] > 0)
            parent[k] = position[tuple(x - (a == axis[k]) for a, x in enumerate(e))]
        return cls(np.array(exponents, dtype=np.int64), parent, axis)


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
        self._source = source
        self._fits: list[_Fits] = []
        self.degrees: dict[int, int] = {}
        self._fit_all(elements.order + 2)

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
        undone = [np.zeros(0, dtype=np.int64)]
        for low in range(0, waiting.size, _CHUNK):
            chunk = waiting[low : low + _CHUNK]
            patch = ring[chunk]
            for _ in range(rings - 2):
                patch = patch @ ring
            stencil = (patch @ touches @ holds).tocsr()
            undone.append(self._fit(chunk, stencil.indptr.astype(np.int64), stencil.indices, degree))
        return np.concatenate(undone)

    def _fit(self, corners: np.ndarray, indptr: np.ndarray, samples: np.ndarray, degree: int) -> np.ndarray:
        terms = _Monomials.up_to(degree)
        n_terms = len(terms.parent)
        count = np.diff(indptr)
        owner = np.repeat(np.arange(corners.size), count)
        centre = np.add.reduceat(self.nodes[samples], indptr[:-1]) / count[:, None]
        offset = self.nodes[samples] - centre[owner]
        # coordinates along the stencil's principal axes, each scaled by its extent: a gap's may be thin and flat
        spread = np.add.reduceat(offset[:, :, None] * offset[:, None, :], indptr[:-1])
        frame = np.linalg.eigh(spread)[1].transpose(0, 2, 1)
        reach = np.maximum.reduceat(np.abs(np.einsum("kab,kb->ka", frame[owner], offset)), indptr[:-1])
        reach = np.maximum(reach, 1e-12 * reach.max(axis=1, keepdims=True))
        frame = np.ascontiguousarray(frame / reach[:, :, None])
        factor = np.empty((corners.size, n_terms, n_terms))
        good = np.empty(corners.size, dtype=bool)
        stencils = Stencils(indptr, samples, centre, frame)
        kernels.factorise(self.nodes, stencils, terms.parent, terms.axis, _MIN_PIVOT, np.empty(n_terms), factor, good)
        good &= count >= n_terms
        at_corner = np.einsum("kab,kb->ka", frame, self.nodes[corners] - centre)
        kernels.limit_noise(at_corner, terms.exponents, factor, count, _MAX_NOISE, np.empty(n_terms), good)
        if good.any():
            kept = good[owner]
            pairs = self.nodes[corners][owner[kept]]
            difference = self._source.potential_difference(pairs, self.nodes[samples[kept]])
            self._fits.append(
                _Fits(
                    corners[good],
                    Stencils(
                        np.concatenate(([0], np.cumsum(count[good]))),
                        np.ascontiguousarray(samples[kept]),
                        np.ascontiguousarray(centre[good]),
                        np.ascontiguousarray(frame[good]),
                    ),
                    difference,
                    np.ascontiguousarray(factor[good]),
                    terms,
                )
            )
            self.degrees[degree] = self.degrees.get(degree, 0) + int(np.count_nonzero(good))
        return corners[~good]

    def nodal(self, field: Field3D) -> np.ndarray:
        """H [A/m] and grad H [A/m^2], rows first, at the nodes: shape (n_nodes, 12)."""
        phi = field.phi[self._global]
        degree = max(self.degrees)
        n_terms = len(_Monomials.up_to(degree).parent)
        coefficients = np.zeros((self._n_corners, n_terms))
        frame, centre = np.empty((self._n_corners, 3, 3)), np.empty((self._n_corners, 3))
        for fit in self._fits:
            stencils, terms = fit.stencils, fit.terms
            values = phi[stencils.samples] - field.ampere_turns * fit.difference
            kernels.apply(
                self.nodes, stencils, terms.parent, terms.axis, fit.factor, values, np.empty(n_terms), coefficients,
                fit.corners,
            )  # fmt: skip
            frame[fit.corners], centre[fit.corners] = stencils.frame, stencils.centre
        nodal = np.zeros((len(self.nodes), 12))
        exponents = _Monomials.up_to(degree).exponents
        every = np.arange(self._n_corners)
        kernels.derive(self.nodes, centre, coefficients, frame, exponents, every, every, 1.0, nodal)
        middle = self._n_corners + np.arange(len(self._edge_ends))
        for end in (0, 1):
            ends = np.ascontiguousarray(self._edge_ends[:, end])
            kernels.derive(self.nodes, centre, coefficients, frame, exponents, ends, middle, 0.5, nodal)
        return nodal
