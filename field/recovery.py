"""Polynomial-preserving recovery of the derivatives of psi inside one region.

The gradient of a finite element solution is an order worse than the solution, its second derivatives two.
At each vertex of the region a polynomial of degree k+2 is fitted by least squares to the nodal values of
psi on two rings of elements of the same region; its derivatives at the vertex, and the mean of both ends'
derivatives at the middle of an edge, are the recovered ones (Zhang and Naga, SIAM J. Sci. Comput. 26, 2005).
No stencil crosses a material interface, where B and H have kinks and jumps.  All that is linear in psi:
one sparse matrix, built once for a mesh.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .locate import TriangleLocator
from .section_elements import SectionElements

# Least squares with scaled monomials: beyond this condition the fit follows rounding and element noise
# (a one-sided stencil of too few layers); the stencil then gets one more ring, in the end a lower degree.
_MAX_CONDITION = 2e3
_MAX_RINGS = 5
_CHUNK = 1024
DERIVATIVES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class RegionRecovery:
    """Recovery operator on the quadratic nodes (vertices, then edge middles) of a region.

    Attributes
    ----------
    nodes : ndarray (n_nodes, 2)
        (r, z) [m].
    connectivity : ndarray (n_elements, 6)
        Nodes of each element: corners in `triangles`' order, then middles of edges 01, 12, 20.
    """

    def __init__(self, elements: SectionElements, region: np.ndarray) -> None:
        mesh = elements.mesh
        vertices, corner = np.unique(mesh.triangles[region], return_inverse=True)
        corner = corner.reshape(-1, 3)
        n_vertices = vertices.size
        ends = np.sort(corner[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        keys, edge = np.unique(ends[..., 0] * n_vertices + ends[..., 1], return_inverse=True)
        self.edge_ends = np.column_stack((keys // n_vertices, keys % n_vertices))
        self.connectivity = np.concatenate((corner, n_vertices + edge.reshape(-1, 3)), axis=1)
        points = mesh.points[vertices]
        if points[:, 0].min() <= 1e-9 * mesh.points[:, 0].max():
            raise ValueError("a region that touches the axis cannot be sampled: B = grad psi/r is 0/0 there")
        self.locator = TriangleLocator(mesh.points, mesh.triangles[region])
        self.nodes = np.concatenate((points, points[self.edge_ends].mean(axis=1)))
        self._corner = corner
        self._region_dofs = elements.element_dofs[region]
        self._dof_points = elements.dof_points
        self._volume = mesh.element_area()[region] * points[corner, 0].mean(axis=1)
        self._derivatives = self._fit_all(points, elements.order + 2)
        self._average, self._fill_gradient = self._fill_operators(points)

    def derivatives(self, psi: np.ndarray) -> np.ndarray:
        """psi_r, psi_z, psi_rr, psi_rz, psi_zz at the nodes, shape (5, n_nodes)."""
        return (self._derivatives @ psi).reshape(5, -1)

    def smooth_fill(self, fill: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Volume-weighted nodal mean of an elementwise fill, and the gradient of that mean [1/m].

        Returns
        -------
        phi : ndarray (n_nodes,)
        gradient : ndarray (2, n_nodes)
        """
        phi = self._average @ fill
        gradient = np.array([self._average @ (operator @ phi[:self._n_vertices])
                             for operator in self._fill_gradient])
        return phi, gradient

    @property
    def _n_vertices(self) -> int:
        return len(self.nodes) - len(self.edge_ends)

    # --- stencils and fits ---------------------------------------------------------------------------

    def _fit_all(self, points: np.ndarray, degree: int) -> sp.csr_matrix:
        n_vertices, n_elements = len(points), len(self._corner)
        touches = sp.csr_matrix((np.ones(3 * n_elements), (self._corner.ravel(),
                                 np.repeat(np.arange(n_elements), 3))), shape=(n_vertices, n_elements))
        n_basis = self._region_dofs.shape[1]
        holds = sp.csr_matrix((np.ones(n_elements * n_basis), (np.repeat(np.arange(n_elements), n_basis),
                               self._region_dofs.ravel())), shape=(n_elements, len(self._dof_points)))
        patch = ((touches @ touches.T) @ touches).tocsr()  # two rings of elements
        # edges of each vertex: where its polynomial is needed too
        vertex_of = self.edge_ends.ravel()
        order = np.argsort(vertex_of, kind="stable")
        edge_of = np.repeat(np.arange(len(self.edge_ends)), 2)[order]
        edge_start = np.searchsorted(vertex_of[order], np.arange(n_vertices + 1))

        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        waiting = np.arange(n_vertices)
        for rings in range(2, _MAX_RINGS + 1):
            stencil = (patch[waiting] @ holds).tocsr()
            left = []
            for low in range(0, waiting.size, _CHUNK):
                some = slice(low, min(low + _CHUNK, waiting.size))
                left.append(self._fit(waiting[some], stencil[some], points, degree, edge_start, edge_of, parts))
            waiting = np.concatenate(left)
            if waiting.size == 0:
                break
            if rings < _MAX_RINGS:
                patch = ((patch @ touches.T) @ touches).tocsr()
                patch.data[:] = 1.0
        while waiting.size and degree > 1:
            # a region of one element layer carries no higher degree, however many rings
            degree -= 1
            waiting = self._fit(waiting, (patch[waiting] @ holds).tocsr(), points, degree,
                                edge_start, edge_of, parts)
        if waiting.size:
            r, z = points[waiting[0]]
            raise ValueError(f"the field's derivatives cannot be recovered at r = {r:.6g} m, z = {z:.6g} m: too "
                             "few elements in this region; refine its mesh")
        row, column, value = (np.concatenate(part) for part in zip(*parts, strict=True))
        return sp.csr_matrix((value, (row, column)), shape=(5 * len(self.nodes), len(self._dof_points)))

    def _fit(self, vertices: np.ndarray, stencil: sp.csr_matrix, points: np.ndarray, degree: int,
             edge_start: np.ndarray, edge_of: np.ndarray,
             parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
        """Fit at these vertices, append the operator's entries to `parts`, return the ones left undone."""
        powers = [(i, n - i) for n in range(degree + 1) for i in range(n + 1)]
        count = np.diff(stencil.indptr)
        enough = count >= len(powers)
        if not enough.any():
            return vertices
        undone = vertices[~enough]
        vertices, stencil, count = vertices[enough], stencil[np.flatnonzero(enough)], count[enough]
        # padded to the longest stencil; padded rows are zero and carry no weight
        width = int(count.max())
        mask = np.arange(width) < count[:, None]
        dofs = np.zeros(mask.shape, dtype=np.int64)
        dofs[mask] = stencil.indices
        offset = np.where(mask[..., None], self._dof_points[dofs] - points[vertices][:, None, :], 0.0)
        # scaled by the stencil's own extents: a thin gap's elements may be long and flat
        scale = np.abs(offset).max(axis=1)
        x, y = (offset / scale[:, None, :]).transpose(2, 0, 1)
        monomials = np.stack([x**i * y**j for i, j in powers], axis=2) * mask[..., None]
        U, s, Vt = np.linalg.svd(monomials, full_matrices=False)
        good = s[:, -1] * _MAX_CONDITION > s[:, 0]
        undone = np.concatenate((undone, vertices[~good]))
        vertices, mask, dofs, scale = vertices[good], mask[good], dofs[good], scale[good]
        if vertices.size == 0:
            return undone
        inverse = (Vt[good].transpose(0, 2, 1) / s[good][:, None, :]) @ U[good].transpose(0, 2, 1)

        # where each polynomial is evaluated: at its vertex with weight 1, on its edges with weight 1/2
        n_edges = edge_start[vertices + 1] - edge_start[vertices]
        polynomial = np.concatenate((np.arange(vertices.size), np.repeat(np.arange(vertices.size), n_edges)))
        within = np.arange(n_edges.sum()) - np.repeat(np.cumsum(n_edges) - n_edges, n_edges)
        target = np.concatenate((vertices, len(points) + edge_of[np.repeat(edge_start[vertices], n_edges) + within]))
        weight = np.concatenate((np.ones(vertices.size), np.full(n_edges.sum(), 0.5)))
        where = (self.nodes[target] - points[vertices[polynomial]]) / scale[polynomial]
        kept = mask[polynomial]
        for d, (d_r, d_z) in enumerate(DERIVATIVES):
            row = np.stack([_power(where[:, 0], i, d_r) * _power(where[:, 1], j, d_z) for i, j in powers], axis=1)
            row *= (weight / (scale[polynomial, 0] ** d_r * scale[polynomial, 1] ** d_z))[:, None]
            entries = np.einsum("tc,tcm->tm", row, inverse[polynomial])
            rows = np.broadcast_to((d * len(self.nodes) + target)[:, None], entries.shape)
            parts.append((rows[kept], dofs[polynomial][kept], entries[kept]))
        return undone

    def _fill_operators(self, points: np.ndarray) -> tuple[sp.csr_matrix, list[sp.csr_matrix]]:
        """Element values to nodes (volume-weighted), and vertex values to element gradients."""
        n_vertices, n_elements = len(points), len(self._corner)
        element = np.repeat(np.arange(n_elements), 3)
        gather = sp.csr_matrix((np.repeat(self._volume, 3), (self._corner.ravel(), element)),
                               shape=(n_vertices, n_elements))
        gather = sp.diags_array(1.0 / np.asarray(gather.sum(axis=1)).ravel()) @ gather
        n_edges = len(self.edge_ends)
        halves = sp.csr_matrix((np.full(2 * n_edges, 0.5), (np.repeat(np.arange(n_edges), 2),
                                self.edge_ends.ravel())), shape=(n_edges, n_vertices))
        average = sp.vstack((gather, halves @ gather)).tocsr()
        corners = points[self._corner]
        opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        twice_area = (corners[:, 1, 0] - corners[:, 0, 0]) * (corners[:, 2, 1] - corners[:, 0, 1]) - (
            corners[:, 1, 1] - corners[:, 0, 1]) * (corners[:, 2, 0] - corners[:, 0, 0])
        slopes = (-opposite[..., 1] / twice_area[:, None], opposite[..., 0] / twice_area[:, None])
        return average, [sp.csr_matrix((slope.ravel(), (element, self._corner.ravel())),
                                       shape=(n_elements, n_vertices)) for slope in slopes]


def _power(x: np.ndarray, exponent: int, derivative: int) -> np.ndarray:
    """Derivative of x^exponent."""
    factor = 1.0
    for _ in range(derivative):
        factor, exponent = factor * exponent, exponent - 1
    return factor * x ** max(exponent, 0) if factor else np.zeros_like(x)
