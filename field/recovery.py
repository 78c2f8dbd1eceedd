"""Polynomial-preserving recovery of the derivatives of psi, and of a smooth fill, inside one region.

The gradient of a finite element solution is an order worse than the solution, its second derivatives two.
At each vertex of the region a polynomial of degree k+2 is fitted by least squares to the nodal values of
psi on two rings of elements of the same region; its derivatives are the recovered ones.  No stencil crosses
a material interface, where B and H have kinks and jumps.  The fill, one value an element, is fitted by
straight planes through the elements' centroids: second order up to the walls, where a mean is only first.
All that is linear in psi and in the fill: sparse matrices, built once for a mesh.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from .locate import TriangleLocator
from .patch_fit import PatchFit
from .section_elements import SectionElements

_PSI_DERIVATIVES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
_FILL_DERIVATIVES = ((0, 0), (1, 0), (0, 1))


class RegionRecovery:
    """Recovery operators on the quadratic nodes (vertices, then edge middles) of a region.

    Parameters
    ----------
    elements : SectionElements
    region : ndarray (m,)
        Elements of the region; it must not touch the axis.

    Attributes
    ----------
    nodes : ndarray (n_nodes, 2)
        (r, z) [m].
    connectivity : ndarray (m, 6)
        Nodes of each element: corners in `triangles`' order, then middles of edges 01, 12, 20.
    locator : TriangleLocator
        Finds the element (0 to m - 1) of a point.
    """

    def __init__(self, elements: SectionElements, region: np.ndarray) -> None:
        mesh = elements.mesh
        vertices, corner = np.unique(mesh.triangles[region], return_inverse=True)
        corner = corner.reshape(-1, 3)
        points = mesh.points[vertices]
        if points[:, 0].min() <= 1e-9 * mesh.points[:, 0].max():
            raise ValueError("a region that touches the axis cannot be sampled: B = grad psi/r is 0/0 there")
        ends = np.sort(corner[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        keys, edge = np.unique(ends[..., 0] * len(points) + ends[..., 1], return_inverse=True)
        edge_ends = np.column_stack((keys // len(points), keys % len(points)))
        self.connectivity = np.concatenate((corner, len(points) + edge.reshape(-1, 3)), axis=1)
        self.nodes = np.concatenate((points, points[edge_ends].mean(axis=1)))
        self.locator = TriangleLocator(mesh.points, mesh.triangles[region])
        self._centroids = points[corner].mean(axis=1)
        self._patches = PatchFit(points, corner, edge_ends)
        dofs = elements.element_dofs[region]
        owner = np.repeat(np.arange(len(dofs)), dofs.shape[1])
        holds = sp.csr_matrix((np.ones(dofs.size), (owner, dofs.ravel())), shape=(len(dofs), elements.n_dofs))
        self._psi_operator = self._patches.operator(holds, elements.dof_points, elements.order + 2, _PSI_DERIVATIVES)

    def derivatives(self, psi: np.ndarray) -> np.ndarray:
        """psi_r, psi_z, psi_rr, psi_rz, psi_zz at the nodes, shape (5, n_nodes)."""
        return (self._psi_operator @ psi).reshape(5, -1)

    @cached_property
    def _fill_operator(self) -> sp.csr_matrix:
        one_each = sp.identity(len(self._centroids), format="csr")
        return self._patches.operator(one_each, self._centroids, 1, _FILL_DERIVATIVES)

    def smooth_fill(self, fill: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodal values of an elementwise fill, and its gradient [1/m].

        The planes are held within the fill's own extremes (at a wall they extrapolate half an element).

        Returns
        -------
        phi : ndarray (n_nodes,)
        gradient : ndarray (2, n_nodes)
        """
        value, *gradient = (self._fill_operator @ fill).reshape(3, -1)
        return np.clip(value, fill.min(), fill.max()), np.array(gradient)
