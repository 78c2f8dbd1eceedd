"""The solved field for pictures: B without its jumps between elements, and psi on a subdivision of the section.

psi = r A_phi of the finite elements is continuous, and of their order inside an element: on a subdivision its level
lines are as smooth as the solution is. Its gradient is not continuous, so that |B| plotted element by element is
faceted. Here B at the nodes of Lagrange elements of the same order is the mean over the elements that meet there;
elements of different regions are not mixed, as B jumps where the permeability does. For what is computed from the field
take the solution itself or the recovery of `field.sampling`: a mean is only as accurate as what it is of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field.sampling.recovery import lattice, shared_nodes
from field.section.interpolation import coefficients, monomials
from field.section.section_elements import SectionElements


@dataclass(frozen=True, slots=True)
class FineSection:
    """Elements of a section, subdivided; points on the border of two regions are there once for each.

    Attributes
    ----------
    points : ndarray (n, 2)
        (r, z) [m].
    triangles : ndarray (k, 3)
    psi : ndarray (n,)
        r A_phi [Wb/rad].
    B : ndarray (n, 2)
        B_r, B_z [T].
    """

    points: np.ndarray
    triangles: np.ndarray
    psi: np.ndarray
    B: np.ndarray


class SmoothField:
    """B of a solution without its jumps inside a region.

    Parameters
    ----------
    elements : SectionElements
    psi : ndarray (n_dofs,)
        r A_phi [Wb/rad].
    """

    def __init__(self, elements: SectionElements, psi: np.ndarray) -> None:
        self.elements, self.psi = elements, psi
        corner = elements.skfem_mesh.t.T.astype(np.int64)  # whose order the shape functions follow
        points = elements.mesh.points
        region = np.zeros(len(corner), dtype=np.int64)
        for number, own in enumerate(elements.mesh.regions.values()):
            region[own] = number
        self._corner = corner + len(points) * region[:, None]  # a vertex is another one in each region
        self._nodes, owner, weight = shared_nodes(self._corner, elements.order)
        where = np.einsum("nk,nki->ni", weight, points[owner % len(points)])
        node = self._nodes.ravel()
        element = np.repeat(np.arange(len(corner)), self._nodes.shape[1])
        B = elements.flux_density_at(psi, element, where[node])
        meeting = np.bincount(node)
        self._B = np.column_stack([np.bincount(node, part) / meeting for part in B.T])

    @property
    def range(self) -> tuple[float, float]:
        """Least and largest psi [Wb/rad]."""
        return float(self.psi.min()), float(self.psi.max())

    def central_magnitude(self) -> np.ndarray:
        """|B| of the solution itself at the centroid of every element (n_elements,) [T]."""
        mesh = self.elements.mesh
        centroid = mesh.points[mesh.triangles].mean(axis=1)
        return np.linalg.norm(self.elements.flux_density_at(self.psi, np.arange(len(centroid)), centroid), axis=1)

    def subdivide(self, chosen: np.ndarray, parts: int) -> FineSection:
        """Some elements, numbers (m,), each edge cut into `parts`."""
        order = self.elements.order
        inside = lattice(parts)[:, 1:] / parts
        of_nodes = monomials(inside, order) @ np.linalg.inv(monomials(lattice(order)[:, 1:] / order, order))
        of_dofs = monomials(inside, order) @ coefficients(self.elements)
        number, owner, weight = shared_nodes(self._corner[chosen], parts)
        mesh_points = self.elements.mesh.points
        psi, B = np.empty(len(owner)), np.empty((len(owner), 2))
        psi[number] = self.psi[self.elements.element_dofs[chosen]] @ of_dofs.T
        B[number] = np.einsum("lb,ebi->eli", of_nodes, self._B[self._nodes[chosen]])
        return FineSection(
            np.einsum("nk,nki->ni", weight, mesh_points[owner % len(mesh_points)]),
            number[:, _small_triangles(parts)].reshape(-1, 3),
            psi,
            B,
        )


def _small_triangles(parts: int) -> np.ndarray:
    """Nodes of the parts^2 triangles between the nodes of `lattice(parts)`, (parts^2, 3)."""
    number = {(i, j): k for k, (_, i, j) in enumerate(lattice(parts).tolist())}
    upright = [((i, j), (i + 1, j), (i, j + 1)) for i, j in number if i + j < parts]
    turned = [((i + 1, j), (i + 1, j + 1), (i, j + 1)) for i, j in number if i + j < parts - 1]
    return np.array([[number[node] for node in triangle] for triangle in upright + turned])
