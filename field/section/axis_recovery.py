"""B in the elements that touch the axis, from polynomials of psi about the axis.

B_z = (1/r) dpsi/dr is 0/0 on the axis. psi of the elements does not fall with r^2 there as it must, and the error of B
in these elements is one order worse than elsewhere. So psi is fitted by least squares, on two or three rings of
elements of the same region around each vertex of the axis, to the fields of air that are regular there,

    psi = r^2 (f/2 - r^2 f''/16 + r^4 f''''/384 - ...),        f(z) = B_z on the axis,

with f a polynomial of one degree more than the elements; the sum is the expansion of a solenoidal field without
curl (Jackson, Classical Electrodynamics, 3rd ed., problem 5.4). Only in regions of constant permeability without
current (`SectionElements.curl_free`): elsewhere, in saturating steel or in conductors, each term r^(2 + 2i) z^j has a
coefficient of its own, and the stencil is one ring smaller. Elements between two vertices of the axis blend their
polynomials. The fits are linear in psi and computed once for a mesh.

Elements of order 1 hold no r^2: psi and B near the axis stay some 10 % off, however fine the mesh.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

if TYPE_CHECKING:
    from field.section.section_elements import SectionElements

# Rings of elements by their order: with fewer, the noise of psi of order 2 leaves an error of first order on the axis;
# with more, a coarse mesh is worse than the elements themselves.
_RINGS = {1: 3, 2: 3, 3: 2, 4: 2}
# Of the fit's matrix with lengths over the stencil's reach; beyond it the degree is lowered.
_MAX_CONDITION = 1e4


class AxisRecovery:
    """The fits of a mesh, one for each vertex of the axis and each region that it touches.

    Parameters
    ----------
    elements : SectionElements
    """

    def __init__(self, elements: SectionElements) -> None:
        mesh = elements.mesh
        triangles = mesh.triangles
        n_elements, n_points = len(triangles), len(mesh.points)
        self._degree = elements.order + 1
        self._corners = mesh.points[triangles]
        self._on_axis = mesh.points[triangles, 0] <= elements.axis_width
        region = np.empty(n_elements, dtype=np.int64)
        for number, own in enumerate(mesh.regions.values()):
            region[own] = number
        vertex = triangles + n_points * region[:, None]  # another one in each region
        patches, index = np.unique(vertex[self._on_axis], return_inverse=True)
        self._patch = np.zeros((n_elements, 3), dtype=np.int64)
        self._patch[self._on_axis] = index
        touches = sp.csr_matrix(
            (np.ones(vertex.size), (vertex.ravel(), np.repeat(np.arange(n_elements), 3))),
            shape=(n_points * len(mesh.regions), n_elements),
        )
        without_curl = np.array([name in elements.curl_free for name in mesh.regions])[patches // n_points]
        smaller = touches[patches]
        for _ in range(_RINGS[elements.order] - 2):
            smaller = smaller @ touches.T @ touches
        larger = smaller @ touches.T @ touches
        self._height, self._reach = mesh.points[patches % n_points, 1], np.empty(len(patches))
        rows, columns, values = [], [], []
        powers = _powers(self._degree)
        for k in range(len(patches)):
            rings = larger if without_curl[k] else smaller
            own = rings.indices[rings.indptr[k] : rings.indptr[k + 1]]
            dofs = np.unique(elements.element_dofs[own])
            dofs = dofs[elements.dof_points[dofs, 0] > elements.axis_width]
            where = elements.dof_points[dofs] - (0.0, self._height[k])
            self._reach[k] = np.abs(where).max()
            fit = _fit(where / self._reach[k], self._degree, bool(without_curl[k]))
            rows.append(np.repeat(k * len(powers) + np.arange(len(powers)), dofs.size))
            columns.append(np.tile(dofs, len(powers)))
            values.append(fit.ravel())
        place = (np.concatenate(rows), np.concatenate(columns))
        self._fits = sp.csr_matrix((np.concatenate(values), place), shape=(len(patches) * len(powers), elements.n_dofs))

    def flux_density(self, psi: np.ndarray, element: np.ndarray, points: np.ndarray) -> np.ndarray:
        """B_r, B_z [T], shape (k, 2), at one point (r, z) [m] of each listed element; these touch the axis."""
        powers = _powers(self._degree)
        coefficients = (self._fits @ psi).reshape(-1, len(powers))
        on_axis = self._on_axis[element]
        # the least weight matters opposite to a lone vertex of the axis, where its own vanishes
        weight = on_axis * np.maximum(_barycentric(self._corners[element], points), 1e-9)
        weight /= weight.sum(axis=1, keepdims=True)
        B = np.zeros((len(element), 2))
        for corner in range(3):
            patch = self._patch[element, corner]
            reach = self._reach[patch]
            r, z = points[:, 0] / reach, (points[:, 1] - self._height[patch]) / reach
            for (i, j), factor in zip(powers, coefficients[patch].T, strict=True):
                part = weight[:, corner] * factor / reach**2
                B[:, 1] += part * (2 * i + 2) * r ** (2 * i) * z**j
                if j > 0:
                    B[:, 0] -= part * j * r ** (2 * i + 1) * z ** (j - 1)
        return B


def _powers(degree: int) -> list[tuple[int, int]]:
    """i, j of the terms r^(2 + 2i) z^j up to a degree of f."""
    return [(i, j) for i in range(degree // 2 + 1) for j in range(degree - 2 * i + 1)]


def _air_fields(degree: int) -> np.ndarray:
    """Coefficients of `_powers` of psi with f = 1, z, z^2 ... z^degree, shape (n_powers, degree + 1)."""
    powers = _powers(degree)
    fields = np.zeros((len(powers), degree + 1))
    for n in range(degree + 1):
        for i in range(n // 2 + 1):
            falling = math.factorial(n) / math.factorial(n - 2 * i)  # of the derivative of order 2i of z^n
            factor = (-1) ** i / (2 ** (2 * i + 1) * math.factorial(i) * math.factorial(i + 1))
            fields[powers.index((i, n - 2 * i)), n] = factor * falling
    return fields


def _fit(where: np.ndarray, degree: int, without_curl: bool) -> np.ndarray:
    """Coefficients of `_powers` from psi at points (n, 2), shape (n_powers, n); a lower degree on too few points."""
    r, z = where.T
    powers = _powers(degree)
    rising = sorted(range(len(powers)), key=lambda k: 2 * powers[k][0] + powers[k][1])
    fields = _air_fields(degree) if without_curl else np.eye(len(powers))[:, rising]
    terms = np.column_stack([r ** (2 + 2 * i) * z**j for i, j in powers]) @ fields
    while terms.shape[1] > 1 and (len(r) < terms.shape[1] or np.linalg.cond(terms) > _MAX_CONDITION):
        terms, fields = terms[:, :-1], fields[:, :-1]
    return fields @ np.linalg.pinv(terms)


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (k, 3) of a point in each of k triangles."""
    a, b, c = np.moveaxis(corners, 1, 0)
    (u, v, w) = b - a, c - a, points - a
    second = w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]
    third = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    double_area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return np.column_stack((double_area - second - third, second, third)) / double_area[:, None]
