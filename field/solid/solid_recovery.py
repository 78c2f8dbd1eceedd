"""Recovered H and grad H inside one region of a solid mesh, and the sampler of them.

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
from numba import njit

from field.sampling.thread_count import shared_by
from geometry.inner_functions import inner

from . import tetrahedron_kernels
from .quadratic_tetrahedron import EDGES
from .solid_elements import SolidElements
from .source_field import Source
from .tetrahedron_locator import SolidPointOutside, TetrahedronLocator, quadratic_form

if TYPE_CHECKING:
    from .solid_field import SolidField

_MAX_RINGS = 4
# Share of a monomial that the ones before it leave unexplained on the stencil (square of a Cholesky pivot over
# the diagonal): below it the fit follows noise.
_LEAST_PIVOT = 2e-4
# Largest change of a derivative at the corner, over the stencil's reach, that noise of size 1 in the samples may
# make.  A good quartic has 30 to 150; where the stencil is a layer or two thick single pivots pass, but their
# errors multiply to 1e4, and the fit then recovers noise.
_MOST_NOISE = 200.0
_CHUNK = 4096
# Of the nodal values, H and the upper triangle of grad H: it is a second derivative.
_UPPER = np.array([0, 1, 2, 3, 4, 5, 7, 8, 11])


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Least-squares fits of one degree, ready to be applied to nodal values."""

    corners: np.ndarray  # (n,) in the region's numbering
    indptr: np.ndarray  # samples of each corner
    samples: np.ndarray
    difference: np.ndarray  # integral of the unit T0 from the corner to each sample
    centre: np.ndarray  # (n, 3) of each stencil: a one-sided one is far better conditioned from there
    frame: np.ndarray  # (n, 3, 3): scaled coordinates are frame @ (x - centre)
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


class SolidRecovery:
    """Fits of the total potential on a region's corners.

    Parameters
    ----------
    elements : SolidElements
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

    def __init__(self, elements: SolidElements, region: np.ndarray, source: Source) -> None:
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
        _factorise(
            centre,
            self.nodes,
            indptr,
            samples,
            frame,
            terms.parent,
            terms.axis,
            _LEAST_PIVOT,
            np.empty(n_terms),
            factor,
            good,
        )
        good &= count >= n_terms
        at_corner = np.einsum("kab,kb->ka", frame, self.nodes[corners] - centre)
        _limit_noise(at_corner, terms.exponents, factor, count, _MOST_NOISE, np.empty(n_terms), good)
        if good.any():
            kept = good[owner]
            pairs = self.nodes[corners][owner[kept]]
            difference = self._source.potential_difference(pairs, self.nodes[samples[kept]])
            self._fits.append(
                _Fits(
                    corners[good],
                    np.concatenate(([0], np.cumsum(count[good]))),
                    np.ascontiguousarray(samples[kept]),
                    difference,
                    np.ascontiguousarray(centre[good]),
                    np.ascontiguousarray(frame[good]),
                    np.ascontiguousarray(factor[good]),
                    terms,
                )
            )
            self.degrees[degree] = self.degrees.get(degree, 0) + int(np.count_nonzero(good))
        return corners[~good]

    def nodal(self, field: SolidField) -> np.ndarray:
        """H [A/m] and grad H [A/m^2], rows first, at the nodes: shape (n_nodes, 12)."""
        phi = field.phi[self._global]
        degree = max(self.degrees)
        n_terms = len(_Monomials.up_to(degree).parent)
        coefficients = np.zeros((self._n_corners, n_terms))
        frame, centre = np.empty((self._n_corners, 3, 3)), np.empty((self._n_corners, 3))
        for fit in self._fits:
            _apply(
                fit.centre,
                self.nodes,
                fit.indptr,
                fit.samples,
                fit.frame,
                fit.terms.parent,
                fit.terms.axis,
                fit.factor,
                phi,
                field.ampere_turns * fit.difference,
                np.empty(n_terms),
                coefficients,
                fit.corners,
            )
            frame[fit.corners], centre[fit.corners] = fit.frame, fit.centre
        nodal = np.zeros((len(self.nodes), 12))
        exponents = _Monomials.up_to(degree).exponents
        every = np.arange(self._n_corners)
        _derive(self.nodes, centre, coefficients, frame, exponents, every, every, 1.0, nodal)
        middle = self._n_corners + np.arange(len(self._edge_ends))
        for end in (0, 1):
            _derive(
                self.nodes,
                centre,
                coefficients,
                frame,
                exponents,
                np.ascontiguousarray(self._edge_ends[:, end]),
                middle,
                0.5,
                nodal,
            )
        return nodal


class SolidSampler:
    """H and grad H of a solved 3D field inside one region, anywhere in the machine: a `FieldSampler`.

    The element of each row of `position` is remembered for the next call (a grain seldom changes it); the result
    does not depend on that.

    Attributes
    ----------
    nodal : ndarray (n_nodes, 12)
        H [A/m], then dH_i/dx_j [A/m^2] row by row, at `recovery.nodes`.
    """

    def __init__(self, field: SolidField, region: str) -> None:
        self.region = region
        self.recovery = field.problem.recovery(region)
        self.nodal = self.recovery.nodal(field)
        self._fold = field.problem.fold
        self._powers = _power_coefficients(self.nodal[:, _UPPER], self.recovery.connectivity)
        self._hint = np.zeros(0, dtype=np.int64)

    def sample(
        self, position: np.ndarray, out: tuple[np.ndarray, np.ndarray] | None = None, threads: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`; `out` and `threads` as of the axisymmetric samplers.

        Raises
        ------
        SolidPointOutside
            A point outside the region.
        """
        position = np.ascontiguousarray(position, dtype=float)
        H, grad = out or (np.empty((len(position), 3)), np.empty((len(position), 3, 3)))
        if len(self._hint) != len(position):
            self._hint = np.full(len(position), -1, dtype=np.int64)
        search = self.recovery.locator.search_arguments
        with shared_by(threads, len(position)):
            tetrahedron_kernels.sample(  # type: ignore[call-arg]
                position, self._hint, *self._fold.copy_arguments, *search, self._powers, H, grad
            )
        if len(position) and self._hint.min() < 0:
            raise SolidPointOutside(position[self._hint < 0], f"region {self.region!r}")
        return H, grad


def _power_coefficients(nodal: np.ndarray, connectivity: np.ndarray) -> np.ndarray:
    """Interpolants of nodal values (n_nodes, c) as polynomials, coefficients of 1 u v w uu uv uw vv vw ww.

    Returns
    -------
    ndarray (m, c, 10)
    """
    powers = np.zeros((len(connectivity), nodal.shape[1], 10))
    corner = nodal[connectivity[:, :4]].transpose(0, 2, 1)
    powers[:, :, 0] = corner[:, :, 0]
    powers[:, :, 1:4] = corner[:, :, 1:] - corner[:, :, :1]
    if connectivity.shape[1] == 10:
        middle = nodal[connectivity[:, 4:]].transpose(0, 2, 1)
        powers[:, :, 1:] += quadratic_form(middle - corner[:, :, EDGES].mean(axis=3))
    return powers


@inner(error_model="numpy")
def _monomials(frame, k, dx, dy, dz, parent, axis, m):
    x = frame[k, 0, 0] * dx + frame[k, 0, 1] * dy + frame[k, 0, 2] * dz
    y = frame[k, 1, 0] * dx + frame[k, 1, 1] * dy + frame[k, 1, 2] * dz
    z = frame[k, 2, 0] * dx + frame[k, 2, 1] * dy + frame[k, 2, 2] * dz
    m[0] = 1.0
    for i in range(1, parent.size):
        m[i] = m[parent[i]] * (x if axis[i] == 0 else (y if axis[i] == 1 else z))


@njit(cache=True, error_model="numpy", nogil=True)
def _factorise(centre, nodes, indptr, samples, frame, parent, axis, least, m, factor, good):
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


@inner(error_model="numpy")
def _power(x, n):
    value = 1.0
    for _ in range(n):
        value *= x
    return value


@njit(cache=True, error_model="numpy", nogil=True)
def _limit_noise(at, exponents, factor, count, most, w, good):
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
def _apply(centre, nodes, indptr, samples, frame, parent, axis, factor, phi, difference, m, coefficients, row):
    n = parent.size
    for k in range(centre.shape[0]):
        a = coefficients[row[k]]
        L = factor[k]
        for s in range(indptr[k], indptr[k + 1]):
            p = samples[s]
            dx, dy, dz = nodes[p, 0] - centre[k, 0], nodes[p, 1] - centre[k, 1], nodes[p, 2] - centre[k, 2]
            _monomials(frame, k, dx, dy, dz, parent, axis, m)
            value = phi[p] - difference[s]
            for i in range(n):
                a[i] += m[i] * value
        for i in range(n):
            for j in range(i):
                a[i] -= L[i, j] * a[j]
            a[i] /= L[i, i]
        for i in range(n - 1, -1, -1):
            for j in range(i + 1, n):
                a[i] -= L[j, i] * a[j]
            a[i] /= L[i, i]


@njit(cache=True, error_model="numpy", nogil=True)
def _derive(nodes, centre, coefficients, frame, exponents, polynomial, target, weight, nodal):
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
