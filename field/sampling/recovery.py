"""Polynomial-preserving recovery of the derivatives of psi, and of a smooth fill, inside one region.

The gradient of a finite element solution is an order worse than the solution, its second derivatives two.
At each vertex of the region a polynomial of higher degree is fitted by least squares to the nodal values of
psi on two rings of elements of the same region; its derivatives are the recovered ones.  In a region without
current and with constant permeability the polynomials are solutions of the equation of psi themselves: fewer
coefficients, so that a one-sided patch at a wall follows noise less, and a higher degree pays.  No stencil
crosses a material interface, where B and H have kinks and jumps.  The fill, one value an element, is fitted
by straight planes through the elements' centroids: second order up to the walls, where a mean is only first.
All that is linear in psi and in the fill, and its matrices are built once for a mesh.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from field.sampling.locate import TriangleLocator
from field.sampling.patch_fit import PatchFit, PatchPolynomials
from field.section.section_elements import SectionElements

if TYPE_CHECKING:
    from field.sampling.table_grid import TableGrid

# Degree of the polynomials by the order of the elements: of those tried (order + 1 to order + 4) the best in H
# and grad H up to the walls, on the air coil.  One-sided patches at a wall amplify noise with every degree more,
# and with odd degrees of P1 to P3 more than they gain inside.
_DEGREE = {1: 2, 2: 4, 3: 6, 4: 7}
_VACUUM_DEGREE = {1: 3, 2: 5, 3: 7, 4: 8}


class RegionRecovery:
    """Recovery operators on the interpolation nodes of a region.

    Parameters
    ----------
    elements : SectionElements
    region : ndarray (m,)
        Elements of the region; it must not touch the axis.

    Attributes
    ----------
    points, triangles : ndarray (n_vertices, 2) [m], (m, 3)
        The region's own mesh.
    order : int
        Of the interpolation between the nodes.
    nodes : ndarray (n_nodes, 2)
        (r, z) [m], those of Lagrange elements of this order.
    connectivity : ndarray (m, (order + 1)(order + 2)/2)
        Nodes of each element, in the order of `lattice`.
    centroids : ndarray (m, 2)
        Of the elements [m].
    locator : TriangleLocator
        Finds the element (0 to m - 1) of a point.
    """

    def __init__(self, elements: SectionElements, region: np.ndarray) -> None:
        mesh = elements.mesh
        vertices, corner = np.unique(mesh.triangles[region], return_inverse=True)
        corner = corner.reshape(-1, 3)
        points = mesh.points[vertices]
        self.points, self.triangles = points, corner
        if points[:, 0].min() <= 1e-9 * mesh.points[:, 0].max():
            raise ValueError("a region that touches the axis cannot be sampled: B = grad psi/r is 0/0 there")
        self.order = max(3, elements.order)
        self.connectivity, self._corners, self._weight = shared_nodes(corner, self.order)
        self.nodes = np.einsum("nk,nki->ni", self._weight, points[self._corners])
        self.locator = TriangleLocator(mesh.points, mesh.triangles[region])
        self.centroids = points[corner].mean(axis=1)
        self._patches = PatchFit(points, corner)
        self._dofs = elements.element_dofs[region]
        self._dof_points = elements.dof_points
        self._order = elements.order

    def derivatives(self, psi: np.ndarray, *, vacuum: bool = False) -> np.ndarray:
        """psi_r, psi_z, psi_rr, psi_rz, psi_zz at the nodes, shape (5, n_nodes).

        `vacuum`: the region has no current and a constant permeability, and the fits may use it.
        """
        fit = self._vacuum_fit if vacuum else self._general_fit
        return fit.derivatives(psi, self.nodes, self._corners, self._weight)[1:]

    @cached_property
    def _general_fit(self) -> PatchPolynomials:
        return self._fit_psi(_DEGREE[self._order], vacuum=False)

    @cached_property
    def _vacuum_fit(self) -> PatchPolynomials:
        return self._fit_psi(_VACUUM_DEGREE[self._order], vacuum=True)

    def _fit_psi(self, degree: int, *, vacuum: bool) -> PatchPolynomials:
        n_elements, n_basis = self._dofs.shape
        owner = np.repeat(np.arange(n_elements), n_basis)
        shape = (n_elements, len(self._dof_points))
        holds = sp.csr_matrix((np.ones(owner.size), (owner, self._dofs.ravel())), shape=shape)
        return self._patches.fit(holds, self._dof_points, degree, vacuum=vacuum)

    @cached_property
    def _fill_fit(self) -> PatchPolynomials:
        one_each = sp.identity(len(self.centroids), format="csr")
        return self._patches.fit(one_each, self.centroids, 1)

    @cached_property
    def table_grid(self) -> TableGrid:
        """The grid on which `TableSampler` tabulates fields of this region; NoTable where there can be none."""
        from field.sampling.table_grid import TableGrid

        return TableGrid(self)

    def smooth_fill(self, fill: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodal values of an elementwise fill, and its gradient [1/m].

        The planes are held within the fill's own extremes (at a wall they extrapolate half an element).

        Returns
        -------
        phi : ndarray (n_nodes,)
        gradient : ndarray (2, n_nodes)
        """
        value, *gradient = self._fill_fit.derivatives(fill, self.nodes, self._corners, self._weight)[:3]
        return np.clip(value, fill.min(), fill.max()), np.array(gradient)


def lattice(order: int) -> np.ndarray:
    """Barycentric coordinates times `order` of the nodes of a triangle, integers, ((order+1)(order+2)/2, 3)."""
    return np.array([(order - i - j, i, j) for i in range(order + 1) for j in range(order + 1 - i)])


def shared_nodes(corner: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number the nodes of all elements with vertices `corner` (m, 3), common ones once.

    Returns
    -------
    connectivity : ndarray (m, n)
    corners : ndarray (n_nodes, 3)
        Vertices of an element that holds the node.
    weight : ndarray (n_nodes, 3)
        Its barycentric coordinates there.
    """
    fraction = np.broadcast_to(lattice(order), (len(corner), *lattice(order).shape)).reshape(-1, 3)
    vertex = np.repeat(corner, len(lattice(order)), axis=0)
    # a node is known by the vertices that it lies between, and by its fraction of each
    name = np.where(fraction > 0, vertex * (order + 1) + fraction, -1)
    _, first, number = np.unique(np.sort(name, axis=1), axis=0, return_index=True, return_inverse=True)
    return number.reshape(len(corner), -1), vertex[first], fraction[first] / order
