"""Finite elements on an axisymmetric section: gradients at quadrature points and a fixed sparsity pattern.

The unknown is psi = r A_phi [Wb/rad], so B_r = -(1/r) dpsi/dz, B_z = (1/r) dpsi/dr and |B| = |grad psi|/r;
div B = 0 holds by construction.  All integrals here are over the section, dr dz: those of the machine are
2 pi times as large.  Shape functions, quadrature and numbering of the unknowns come from scikit-fem; the
element matrices are summed with numpy into a CSC matrix whose pattern is found once, because the staggered
loop solves on the same mesh again and again.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geometry.section import SectionMesh

# Rules of the triangle with positive weights and no point on the edges (never on the axis): the rule of
# order 3 has a negative weight, which made saturated Newton matrices indefinite.
QUADRATURE_ORDER = {1: 2, 2: 4, 3: 6}


class SectionElements:
    """Lagrange elements of order 1 to 3 on the triangles of a section.

    Attributes
    ----------
    dof_points : ndarray (n_dofs, 2)
        Where the unknowns live, (r, z) [m]; the first `n_points` are the mesh's points.
    element_dofs : ndarray (n_elements, n_basis)
        Unknowns of each element.
    gradients : ndarray (n_elements, 2 n_quadrature, n_basis)
        d/dr of the shape functions at each quadrature point, then d/dz [1/m].
    radius, weight : ndarray (n_elements, n_quadrature)
        r [m] and weight [m^2] of the quadrature points.
    """

    def __init__(self, mesh: SectionMesh, order: int = 2) -> None:
        import skfem  # here, because importing it costs a third of a second

        if order not in QUADRATURE_ORDER:
            raise ValueError(f"`order` = {order} of the field's elements must be 1, 2 or 3; 2 is the default")
        element = (skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3)[order - 1]()
        self.mesh = mesh
        self.order = order
        self.skfem_mesh = skfem.MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.triangles.T))
        quadrature = skfem.quadrature.get_quadrature(element, QUADRATURE_ORDER[order])
        basis = skfem.CellBasis(self.skfem_mesh, element, quadrature=quadrature)
        self.n_dofs = int(basis.N)
        self.dof_points = np.ascontiguousarray(basis.doflocs.T)
        self.element_dofs = np.ascontiguousarray(basis.element_dofs.T.astype(np.int64))
        self.shape = np.array([np.asarray(b[0])[0] for b in basis.basis]).T.copy()  # (n_quadrature, n_basis)
        grad = np.array([b[0].grad for b in basis.basis])  # (n_basis, 2, n_elements, n_quadrature)
        n_elements, n_quadrature = basis.dx.shape
        self.gradients = np.ascontiguousarray(grad.transpose(2, 1, 3, 0).reshape(n_elements, 2 * n_quadrature, -1))
        self.radius = np.ascontiguousarray(np.asarray(basis.global_coordinates())[0])
        self.weight = np.ascontiguousarray(basis.dx)
        self.n_quadrature = n_quadrature
        self._basis = basis
        self._element = element

    def boundary_dofs(self, name: str) -> np.ndarray:
        """Unknowns on a boundary that the mesh names."""
        if name not in self.mesh.boundaries:
            raise ValueError(f"the mesh has no boundary {name!r}; it has {', '.join(sorted(self.mesh.boundaries))}")
        pairs = np.sort(np.asarray(self.mesh.boundaries[name], dtype=np.int64), axis=1)
        key = self.skfem_mesh.p.shape[1]
        facets = np.sort(self.skfem_mesh.facets.astype(np.int64), axis=0)
        wanted = np.isin(facets[0] * key + facets[1], pairs[:, 0] * key + pairs[:, 1])
        return np.unique(self._basis.get_dofs(np.flatnonzero(wanted)).flatten())

    def axis_dofs(self) -> np.ndarray:
        """Unknowns at r = 0, where psi = r A_phi vanishes."""
        return np.flatnonzero(self.dof_points[:, 0] <= 1e-12 * self.dof_points[:, 0].max())

    def gradient(self, psi: np.ndarray) -> np.ndarray:
        """grad psi at the quadrature points, shape (n_elements, 2, n_quadrature) [Wb/(rad m)]."""
        flat = self.gradients @ psi[self.element_dofs][:, :, None]
        return flat.reshape(-1, 2, self.n_quadrature)

    def gradient_at(self, psi: np.ndarray, element: np.ndarray, points: np.ndarray) -> np.ndarray:
        """grad psi at one point of each listed element, points (k, 2) as (r, z) [m]; shape (k, 2)."""
        corner, second, third = (self.skfem_mesh.p[:, vertex[element]] for vertex in self.skfem_mesh.t)
        u, v = second - corner, third - corner
        determinant = u[0] * v[1] - u[1] * v[0]
        d = points.T - corner
        local = np.array([d[0] * v[1] - d[1] * v[0], u[0] * d[1] - u[1] * d[0]]) / determinant
        slope = np.zeros((2, len(element)))
        for i, dof in enumerate(self.element_dofs[element].T):
            slope += self._element.lbasis(local, i)[1] * psi[dof]
        return (
            np.column_stack((v[1] * slope[0] - u[1] * slope[1], u[0] * slope[1] - v[0] * slope[0]))
            / determinant[:, None]
        )

    def load(self, density: np.ndarray) -> np.ndarray:
        """Integral of density * v dr dz for every v; density (n_elements,), constant in each element."""
        local = (self.weight @ self.shape) * density[:, None]
        return np.bincount(self.element_dofs.ravel(), local.ravel(), self.n_dofs)

    def divergence(self, flow: np.ndarray) -> np.ndarray:
        """Integral of flow . grad v dr dz for every v; flow (n_elements, 2, n_quadrature)."""
        weighted = (flow * self.weight[:, None, :]).reshape(len(flow), 1, -1)
        local = weighted @ self.gradients
        return np.bincount(self.element_dofs.ravel(), local.ravel(), self.n_dofs)

    def stiffness_blocks(self, isotropic: np.ndarray, along: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Element matrices of the form  a grad u . grad v + c (d . grad u)(d . grad v).

        Parameters
        ----------
        isotropic, along : ndarray (n_elements, n_quadrature)
            a and c.
        direction : ndarray (n_elements, 2, n_quadrature)
            Unit vector d (zero where there is none).

        Returns
        -------
        ndarray (n_elements, n_basis, n_basis)
        """
        a, c = isotropic * self.weight, along * self.weight
        q = self.n_quadrature
        g_r, g_z = self.gradients[:, :q], self.gradients[:, q:]
        d_r, d_z = direction[:, 0], direction[:, 1]
        off = (c * d_r * d_z)[:, :, None]
        turned = np.concatenate(
            ((a + c * d_r * d_r)[:, :, None] * g_r + off * g_z, off * g_r + (a + c * d_z * d_z)[:, :, None] * g_z),
            axis=1,
        )
        return self.gradients.transpose(0, 2, 1) @ turned


class FixedPattern:
    """The sparsity pattern of the free unknowns, found once: element matrices go straight to CSC data.

    Parameters
    ----------
    element_dofs : ndarray (n_elements, n_basis)
    free : ndarray (n_free,)
        Unknowns that are solved for, in the order of the matrix's columns.
    n_dofs : int
    """

    def __init__(self, element_dofs: np.ndarray, free: np.ndarray, n_dofs: int) -> None:
        n_basis = element_dofs.shape[1]
        number = np.full(n_dofs, -1, dtype=np.int64)
        number[free] = np.arange(free.size)
        row = np.repeat(number[element_dofs], n_basis, axis=1).ravel()
        column = np.tile(number[element_dofs], (1, n_basis)).ravel()
        self._kept = np.flatnonzero((row >= 0) & (column >= 0))
        keys, self._slot = np.unique(column[self._kept] * free.size + row[self._kept], return_inverse=True)
        self.size = free.size
        self._indices = (keys % free.size).astype(np.int32)
        self._indptr = np.searchsorted(keys, np.arange(free.size + 1) * free.size).astype(np.int32)

    def matrix(self, blocks: np.ndarray) -> sp.csc_matrix:
        """Sum element matrices (n_elements, n_basis, n_basis) into CSC."""
        data = np.bincount(self._slot, blocks.ravel()[self._kept], self._indices.size)
        return sp.csc_matrix((data, self._indices, self._indptr), shape=(self.size, self.size))
