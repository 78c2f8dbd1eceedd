"""A finite element function at other unknowns, and the shape functions' slopes at points: exact, no fit.

Lagrange elements of any order, whatever their local numbering: the shape functions follow from where the unknowns lie
on the reference triangle.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from field.section.section_elements import SectionElements


def interpolation(coarse: SectionElements, fine: SectionElements, parent: np.ndarray | None = None) -> sp.csr_matrix:
    """Functions of `coarse` at the unknowns of `fine`.

    Parameters
    ----------
    coarse, fine : SectionElements
    parent : ndarray (n fine elements,) or None
        Element of `coarse` that each of `fine` lies in; None: the same elements.

    Returns
    -------
    csr_matrix (fine.n_dofs, coarse.n_dofs)
        Exact where every element is of at least its parent's order and lies in it, and the parent has no curved edge.
    """
    # one element that has the unknown is enough, as psi is continuous
    _, first = np.unique(fine.element_dofs, return_index=True)
    owner, number = np.divmod(first, fine.element_dofs.shape[1])
    where = fine.reference_dofs[number]
    if parent is not None:
        owner = parent[owner]
        where = _local(coarse, owner, fine.dof_points)
    value = monomials(where, coarse.order) @ coefficients(coarse)
    value[np.abs(value) < 1e-12] = 0.0  # rounding: keeps the unknowns of other edges out
    column = coarse.element_dofs[owner]
    row = np.repeat(np.arange(fine.n_dofs), column.shape[1])
    matrix = sp.csr_matrix((value.ravel(), (row, column.ravel())), (fine.n_dofs, coarse.n_dofs))
    matrix.eliminate_zeros()
    return matrix


def _corners(elements: SectionElements, element: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    first, second, third = (elements.dof_points[elements.element_dofs[element, i]] for i in range(3))
    return first, second, third


def _local(elements: SectionElements, element: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Coordinates (k, 2) of points on the reference triangle of one element each."""
    corner, second, third = _corners(elements, element)
    matrix = np.stack((second - corner, third - corner), axis=2)
    return np.linalg.solve(matrix, (points - corner)[..., None])[..., 0]


def coefficients(elements: SectionElements) -> np.ndarray:
    """Shape functions by their monomials, (n_monomials, n_basis)."""
    return np.linalg.inv(monomials(elements.reference_dofs, elements.order))


def _exponents(order: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]


def monomials(x: np.ndarray, order: int) -> np.ndarray:
    """x^i y^j with i + j <= order at points (n, 2)."""
    return np.column_stack([x[:, 0] ** i * x[:, 1] ** j for i, j in _exponents(order)])
