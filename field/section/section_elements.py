"""Finite elements on an axisymmetric section: gradients at quadrature points and element matrices.

The unknown is psi = r A_phi [Wb/rad], so B_r = -(1/r) dpsi/dz, B_z = (1/r) dpsi/dr and |B| = |grad psi|/r;
div B = 0 holds by construction.  All integrals here are over the section, dr dz: those of the machine are
2 pi times as large.  Shape functions, quadrature and numbering of the unknowns come from scikit-fem.  One affine
map an element turns the gradients of the reference triangle into those of the section, and the element matrices
are sums of three fixed matrices a quadrature point.  Elements with an edge on a curve are images of the reference
triangle under maps of second order (`geometry.curved_edges`), with a matrix for each quadrature point; a mesh without
curves pays nothing for them.  The forms stand in scikit-fem's notation in `field.section.weak_forms`.
"""

from __future__ import annotations

import copy
import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from geometry.curved_edges import edge_functions
from geometry.section import SectionMesh

if TYPE_CHECKING:
    from field.section.axis_recovery import AxisRecovery

# Rules of the triangle with positive weights and no point on the edges (never on the axis): the rule of
# order 3 has a negative weight, which made saturated Newton matrices indefinite.
QUADRATURE_ORDER = {1: 2, 2: 4, 3: 6, 4: 8}
_NEWTON_STEPS = 5  # of the inverse of a curved element's map; they square the error, and the first is 1 % of an element


class SectionElements:
    """Lagrange elements of order 1 to 4 on the triangles of a section.

    Attributes
    ----------
    dof_points : ndarray (n_dofs, 2)
        Where the unknowns live, (r, z) [m]; the first `n_points` are the mesh's points.
    reference_dofs : ndarray (n_basis, 2)
        Where those of an element are on the reference triangle.
    element_dofs : ndarray (n_elements, n_basis)
        Unknowns of each element.
    reference_points : ndarray (n_quadrature, 2)
        Quadrature points on the reference triangle.
    shape : ndarray (n_quadrature, n_basis)
        Shape functions at the quadrature points.
    inverse : ndarray (n_elements, 1 or n_quadrature, 2, 2)
        Inverse transpose of the map's derivative: grad = inverse @ (gradient on the reference triangle); one for all
        quadrature points where no edge of the mesh is curved.
    radius, height, weight : ndarray (n_elements, n_quadrature)
        r and z [m] and weight [m^2] of the quadrature points.
    """

    def __init__(self, mesh: SectionMesh, order: int = 2) -> None:
        import skfem  # here, because importing it costs a third of a second
        from skfem.assembly.dofs import Dofs

        if order not in QUADRATURE_ORDER:
            raise ValueError(f"`order` = {order} of the field's elements must be 1, 2, 3 or 4; 2 is the default")
        element = (skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3, skfem.ElementTriP4)[order - 1]()
        self.mesh = mesh
        self.order = order
        self.curl_free: frozenset[str] = frozenset()  # regions of constant permeability without current
        self.skfem_mesh = skfem.MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.triangles.T))
        self._element = element
        self._dofs = Dofs(self.skfem_mesh, element)
        self.n_dofs = int(self._dofs.N)
        self.element_dofs = np.ascontiguousarray(self._dofs.element_dofs.T.astype(np.int64))
        reference = np.asarray(element.doflocs)
        self.reference_dofs = reference
        self._curved, self._bulge = np.zeros(0, dtype=np.int64), np.zeros((0, 3, 2))
        if mesh.curved is not None:
            self._curved, self._bulge = mesh.curved.of_triangles(self.skfem_mesh.t.T.astype(np.int64))
        quadrature, weights = skfem.quadrature.get_quadrature(element, QUADRATURE_ORDER[order])
        self.n_quadrature = weights.size
        self.reference_points = np.ascontiguousarray(quadrature.T)
        self._quadrature_weights = weights
        values = [element.lbasis(quadrature, i) for i in range(len(reference))]
        self.shape = np.array([np.broadcast_to(v[0], weights.shape) for v in values]).T.copy()
        # (n_quadrature, n_basis, 2): gradients on the reference triangle
        self._slope = np.array([np.broadcast_to(v[1], quadrature.shape) for v in values]).transpose(2, 0, 1).copy()
        self._place()
        rows, columns = np.tril_indices(len(reference))
        gx, gy = self._slope[..., 0], self._slope[..., 1]
        # the element matrix is a sum over quadrature points of D_xx P_0 + D_xy P_1 + D_yy P_2, lower triangles
        self._products = np.ascontiguousarray(
            np.stack(
                (
                    gx[:, rows] * gx[:, columns],
                    gx[:, rows] * gy[:, columns] + gy[:, rows] * gx[:, columns],
                    gy[:, rows] * gy[:, columns],
                ),
                axis=1,
            )
        )

    def _place(self) -> None:
        """Compute all that depends on the positions of the points."""
        corner, second, third = (self.skfem_mesh.p[:, vertex] for vertex in self.skfem_mesh.t)
        u, v = second - corner, third - corner
        determinant = u[0] * v[1] - u[1] * v[0]
        self.inverse = np.ascontiguousarray(
            (np.array([[v[1], -u[1]], [-v[0], u[0]]]) / determinant).transpose(2, 0, 1)[:, None]
        )
        self.dof_points = np.empty((self.n_dofs, 2))
        for i, (x, y) in enumerate(self.reference_dofs):
            self.dof_points[self.element_dofs[:, i]] = (corner + x * u + y * v).T
        x, y = self.reference_points.T
        self.radius = corner[0][:, None] + np.outer(u[0], x) + np.outer(v[0], y)
        self.height = corner[1][:, None] + np.outer(u[1], x) + np.outer(v[1], y)
        self.weight = np.abs(determinant)[:, None] * self._quadrature_weights
        if self._curved.size:
            self._bend()

    def _bend(self) -> None:
        """Correct what `_place` computed for straight triangles in those with a curved edge."""
        own = self._curved
        every = np.arange(own.size)
        self.dof_points[self.element_dofs[own]] = np.stack(
            [self._map(every, np.broadcast_to(x, (own.size, 2)))[0] for x in self.reference_dofs], axis=1
        )
        self.inverse = np.repeat(self.inverse, self.n_quadrature, axis=1)
        for q, x in enumerate(self.reference_points):
            place, slope = self._map(every, np.broadcast_to(x, (own.size, 2)))
            self.radius[own, q], self.height[own, q] = place.T
            self.weight[own, q] = np.abs(np.linalg.det(slope)) * self._quadrature_weights[q]
            self.inverse[own, q] = np.linalg.inv(slope).transpose(0, 2, 1)

    def _map(self, number: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Images (k, 2) of points (k, 2) of the reference triangle in curved elements, and the map's derivatives."""
        corner, second, third = (
            self.skfem_mesh.p[:, vertex].T for vertex in self.skfem_mesh.t[:, self._curved[number]]
        )
        u, v = second - corner, third - corner
        value, slope = edge_functions(x)
        bulge = self._bulge[number]
        place = corner + x[:, :1] * u + x[:, 1:] * v + np.einsum("nk,nki->ni", value, bulge)
        return place, np.stack((u, v), axis=2) + np.einsum("nki,nkj->nij", bulge, slope)

    def local(self, element: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (k, 2) on the reference triangle of one point (r, z) [m] of each element, and `inverse` there."""
        inverse = self.inverse[element, 0]
        corner = self.skfem_mesh.p[:, self.skfem_mesh.t[0][element]].T
        x = np.einsum("kij,ki->kj", inverse, points - corner)
        own = np.flatnonzero(np.isin(element, self._curved))
        number = np.searchsorted(self._curved, element[own])
        for _ in range(_NEWTON_STEPS if own.size else 0):
            place, slope = self._map(number, x[own])
            inverse[own] = np.linalg.inv(slope).transpose(0, 2, 1)
            x[own] += np.einsum("kij,ki->kj", inverse[own], points[own] - place)
        return x, inverse

    def beyond_curves(self, element: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Elements (k,) that hold the points (r, z) [m], from those whose straight triangles do; -1 stays."""
        inside = np.flatnonzero(np.isin(element, self._curved))
        if inside.size == 0:
            return element
        own, element = element[inside], element.copy()
        x, _ = self.local(own, points[inside])
        opposite = np.column_stack((x[:, 1], 1.0 - x.sum(axis=1), x[:, 0]))  # barycentric, to the edges 01, 12, 20
        is_curved = np.any(self._bulge[np.searchsorted(self._curved, own)] != 0.0, axis=2)
        for edge in range(3):
            left = np.flatnonzero(is_curved[:, edge] & (opposite[:, edge] < 0.0))
            here, there = self.skfem_mesh.f2t[:, self.skfem_mesh.t2f[edge, own[left]]]
            element[inside[left]] = np.where(here == own[left], there, here)
        return element

    def with_mesh(self, mesh: SectionMesh) -> SectionElements:
        """The same unknowns on the same triangles with the points elsewhere."""
        other = copy.copy(self)
        for computed in ("gradients", "touches_axis", "axis_recovery"):
            other.__dict__.pop(computed, None)
        other.mesh = mesh
        other.skfem_mesh = dataclasses.replace(self.skfem_mesh, doflocs=np.ascontiguousarray(mesh.points.T))
        other._place()
        return other

    @property
    def n_basis(self) -> int:
        """Unknowns of one element."""
        return self.element_dofs.shape[1]

    @cached_property
    def gradients(self) -> np.ndarray:
        """d/dr of the shape functions at the quadrature points, then d/dz [1/m]: (n_elements, 2 n_quadrature, k)."""
        inverse = np.broadcast_to(self.inverse, (len(self.inverse), self.n_quadrature, 2, 2))
        gradients = np.einsum("eqij,qbj->eiqb", inverse, self._slope)
        return gradients.reshape(len(self.inverse), 2 * self.n_quadrature, self.n_basis)

    def corner_gradients(self) -> np.ndarray:
        """Gradients [1/m] of the barycentric coordinates, as `inverse`: (n_elements, 1 or n_quadrature, 3, 2)."""
        return np.einsum("eqij,cj->eqci", self.inverse, np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]))

    def boundary_dofs(self, name: str) -> np.ndarray:
        """Unknowns on a boundary that the mesh names."""
        if name not in self.mesh.boundaries:
            raise ValueError(f"the mesh has no boundary {name!r}; it has {', '.join(sorted(self.mesh.boundaries))}")
        pairs = np.sort(np.asarray(self.mesh.boundaries[name], dtype=np.int64), axis=1)
        key = self.skfem_mesh.p.shape[1]
        facets = np.sort(self.skfem_mesh.facets.astype(np.int64), axis=0)
        at_edge = np.isin(facets[0] * key + facets[1], pairs[:, 0] * key + pairs[:, 1])
        return np.unique(self._dofs.get_facet_dofs(np.flatnonzero(at_edge)).flatten())

    def axis_dofs(self) -> np.ndarray:
        """Unknowns at r = 0, where psi = r A_phi vanishes."""
        return np.flatnonzero(self.dof_points[:, 0] <= self.axis_width)

    def flux(self, psi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """grad psi (n_elements, 2, n_quadrature) [Wb/(rad m)] and |B| (n_elements, n_quadrature) [T]."""
        n_elements = len(self.element_dofs)
        gradient = np.empty((n_elements, 2, self.n_quadrature))
        B = np.empty((n_elements, self.n_quadrature))
        _flux(
            np.ascontiguousarray(psi, dtype=float),
            self.element_dofs,
            self.inverse,
            self._slope,
            self.radius,
            gradient,
            B,
        )
        return gradient, B

    def gradient(self, psi: np.ndarray) -> np.ndarray:
        """grad psi at the quadrature points, shape (n_elements, 2, n_quadrature) [Wb/(rad m)]."""
        return self.flux(psi)[0]

    def gradient_at(self, psi: np.ndarray, element: np.ndarray, points: np.ndarray) -> np.ndarray:
        """grad psi at one point of each listed element, points (k, 2) as (r, z) [m]; shape (k, 2)."""
        local, inverse = self.local(element, points)
        slope = np.zeros((2, len(element)))
        for i, dof in enumerate(self.element_dofs[element].T):
            slope += self._element.lbasis(local.T, i)[1] * psi[dof]
        return np.einsum("kij,jk->ki", inverse, slope)

    def value_at(self, psi: np.ndarray, element: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Psi (k,) [Wb/rad] at one point of each listed element, points (k, 2) as (r, z) [m]."""
        local, _ = self.local(element, points)
        shapes = (self._element.lbasis(local.T, i)[0] * psi[dof] for i, dof in enumerate(self.element_dofs[element].T))
        return sum(shapes, start=np.zeros(len(element)))

    def flux_density_at(self, psi: np.ndarray, element: np.ndarray, points: np.ndarray) -> np.ndarray:
        """B_r, B_z [T] at one point (r, z) [m] of each listed element, points and result (k, 2).

        Of the elements themselves; in those that touch the axis recovered, see `field.section.axis_recovery`.
        """
        B = np.empty((len(element), 2))
        near = self.touches_axis[element]
        if near.any():
            B[near] = self.axis_recovery.flux_density(psi, element[near], points[near])
        away = ~near
        gradient = self.gradient_at(psi, element[away], points[away])
        B[away] = np.column_stack((-gradient[:, 1], gradient[:, 0])) / points[away, :1]
        return B

    @property
    def axis_width(self) -> float:
        """Distance from the axis [m] that is one of rounding."""
        return 1e-12 * float(self.mesh.points[:, 0].max())

    @cached_property
    def touches_axis(self) -> np.ndarray:
        """True for each element with a corner on the axis, (n_elements,)."""
        return self.mesh.points[self.mesh.triangles, 0].min(axis=1) <= self.axis_width

    @cached_property
    def axis_recovery(self) -> AxisRecovery:
        """B in the elements that touch the axis, built on the first call."""
        from field.section.axis_recovery import AxisRecovery

        return AxisRecovery(self)

    def load(self, density: np.ndarray) -> np.ndarray:
        """Integral of density * v dr dz for every v; density (n_elements,), constant in each element."""
        local = (self.weight @ self.shape) * density[:, None]
        return np.bincount(self.element_dofs.ravel(), local.ravel(), self.n_dofs)

    def divergence(self, flow: np.ndarray) -> np.ndarray:
        """Integral of flow . grad v dr dz for every v; flow (n_elements, 2, n_quadrature)."""
        out = np.zeros(self.n_dofs)
        _divergence(flow * self.weight[:, None, :], self.element_dofs, self.inverse, self._slope, out)
        return out

    def field_force(self, gradient: np.ndarray, nu: np.ndarray) -> np.ndarray:
        """Integral of (nu/r) grad psi . grad v dr dz for every v; nu (n_elements, n_quadrature) [m/H]."""
        out = np.zeros(self.n_dofs)
        _field_force(gradient, nu, self.radius, self.weight, self.element_dofs, self.inverse, self._slope, out)
        return out

    def field_tangent(self, gradient: np.ndarray, B: np.ndarray, nu: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Lower triangles of the element matrices of the derivative of `field_force`.

        Parameters
        ----------
        gradient, B : ndarray
            From `flux`.
        nu, slope : ndarray (n_elements, n_quadrature)
            H/B and dH/dB [m/H].

        Returns
        -------
        ndarray (n_elements, n_basis (n_basis + 1)/2)
            By rows: (0, 0), (1, 0), (1, 1), (2, 0) ...
        """
        packed = np.empty((len(B), self._products.shape[2]))
        _field_tangent(gradient, B, nu, slope, self.radius, self.weight, self.inverse, self._products, packed)
        return packed

    def packed_tangent(self, elements: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Lower triangles of the matrices of integral D (grad u) . (grad v)/r dr dz of some elements (m,).

        D (m, n_quadrature, 3): xx, xy, yy of a symmetric matrix [m/H]. Packed as in `field_tangent`.
        """
        J = self.inverse[elements]
        xx, xy, yy = np.moveaxis(D * (self.weight[elements] / self.radius[elements])[:, :, None], 2, 0)
        (a, b), (c, d) = (J[..., 0, 0], J[..., 0, 1]), (J[..., 1, 0], J[..., 1, 1])
        on_reference = (
            a * a * xx + 2.0 * a * c * xy + c * c * yy,
            a * b * xx + (a * d + b * c) * xy + c * d * yy,
            b * b * xx + 2.0 * b * d * xy + d * d * yy,
        )
        return sum(part @ self._products[:, i] for i, part in enumerate(on_reference))


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def _flux(psi, element_dofs, inverse, slope, radius, gradient, B):
    n_quadrature, n_basis, last = slope.shape[0], slope.shape[1], inverse.shape[1] - 1
    for e in range(element_dofs.shape[0]):
        for q in range(n_quadrature):
            x = y = 0.0
            for i in range(n_basis):
                value = psi[element_dofs[e, i]]
                x += slope[q, i, 0] * value
                y += slope[q, i, 1] * value
            k = min(q, last)
            g_r = inverse[e, k, 0, 0] * x + inverse[e, k, 0, 1] * y
            g_z = inverse[e, k, 1, 0] * x + inverse[e, k, 1, 1] * y
            gradient[e, 0, q], gradient[e, 1, q] = g_r, g_z
            B[e, q] = np.sqrt(g_r * g_r + g_z * g_z) / radius[e, q]


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def _divergence(flow, element_dofs, inverse, slope, out):
    n_quadrature, n_basis, last = slope.shape[0], slope.shape[1], inverse.shape[1] - 1
    for e in range(element_dofs.shape[0]):
        for q in range(n_quadrature):
            k = min(q, last)
            x = inverse[e, k, 0, 0] * flow[e, 0, q] + inverse[e, k, 1, 0] * flow[e, 1, q]
            y = inverse[e, k, 0, 1] * flow[e, 0, q] + inverse[e, k, 1, 1] * flow[e, 1, q]
            for i in range(n_basis):
                out[element_dofs[e, i]] += slope[q, i, 0] * x + slope[q, i, 1] * y


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def _field_force(gradient, nu, radius, weight, element_dofs, inverse, slope, out):
    n_quadrature, n_basis, last = slope.shape[0], slope.shape[1], inverse.shape[1] - 1
    for e in range(element_dofs.shape[0]):
        for q in range(n_quadrature):
            a = nu[e, q] * weight[e, q] / radius[e, q]
            g_r, g_z = a * gradient[e, 0, q], a * gradient[e, 1, q]
            k = min(q, last)
            x = inverse[e, k, 0, 0] * g_r + inverse[e, k, 1, 0] * g_z
            y = inverse[e, k, 0, 1] * g_r + inverse[e, k, 1, 1] * g_z
            for i in range(n_basis):
                out[element_dofs[e, i]] += slope[q, i, 0] * x + slope[q, i, 1] * y


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def _field_tangent(gradient, B, nu, slope, radius, weight, inverse, products, packed):
    # d(nu g)/dg = nu I + (dH/dB - nu) d d^T with d = g/|g|, carried to the reference triangle
    n_quadrature, n_packed = products.shape[0], products.shape[2]
    for e in range(gradient.shape[0]):
        row = packed[e]
        row[:] = 0.0
        for q in range(n_quadrature):
            if q < inverse.shape[1]:
                j00, j01 = inverse[e, q, 0, 0], inverse[e, q, 0, 1]
                j10, j11 = inverse[e, q, 1, 0], inverse[e, q, 1, 1]
                m00, m01, m11 = j00 * j00 + j10 * j10, j00 * j01 + j10 * j11, j01 * j01 + j11 * j11
            a = nu[e, q] * weight[e, q] / radius[e, q]
            length = B[e, q] * radius[e, q]
            if length > 0.0:
                c = (slope[e, q] - nu[e, q]) * weight[e, q] / radius[e, q] / (length * length)
                d0 = j00 * gradient[e, 0, q] + j10 * gradient[e, 1, q]
                d1 = j01 * gradient[e, 0, q] + j11 * gradient[e, 1, q]
            else:
                c = d0 = d1 = 0.0
            xx, xy, yy = a * m00 + c * d0 * d0, a * m01 + c * d0 * d1, a * m11 + c * d1 * d1
            for p in range(n_packed):
                row[p] += xx * products[q, 0, p] + xy * products[q, 1, p] + yy * products[q, 2, p]
