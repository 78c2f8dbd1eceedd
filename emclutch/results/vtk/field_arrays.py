"""A solved field as arrays for ParaView, one value an element or a point.

B and H jump at the faces between materials. At the points of a section they are therefore given once for each region
that meets there: a point on a face stands in the file as often as regions touch it, and colours run smoothly inside a
region and jump at its faces, as the field does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field import MU_0, MagneticField
from field.three_d import Field3D


@dataclass(frozen=True, slots=True)
class SectionArrays:
    """A solved section.

    Attributes
    ----------
    points : (n, 2) r, z [m]; those on faces between regions once for each region.
    triangles : (k, 3) their corners among the points.
    cell_arrays, point_arrays : (k,) or (k, 2), (n,) or (n, 2) by name.
    region_names : names that the numbers of the cell array `region` stand for.
    """

    points: np.ndarray
    triangles: np.ndarray
    cell_arrays: dict[str, np.ndarray]
    point_arrays: dict[str, np.ndarray]
    region_names: list[str]


def field_arrays(solution: MagneticField) -> SectionArrays:
    """The arrays of a section: B and H at the elements' centroids, and at the points from the elements around."""
    problem, mesh = solution.problem, solution.problem.mesh
    B = solution.flux_density()
    names = sorted(mesh.regions)
    region = np.zeros(len(mesh.triangles), dtype=np.int32)
    for number, name in enumerate(names):
        region[mesh.regions[name]] = number
    J = np.zeros(len(mesh.triangles))
    J[mesh.regions["coil"]] = solution.ampere_turns / problem.coil_area
    cells = {
        "flux_density": B,
        "field_strength": _field_strength(solution, B[:, None])[:, 0],
        "relative_permeability": solution.relative_permeability(),
        "region": region,
        "current_density": J,
    }
    if solution.fill is not None:
        cells["solid_fraction"] = np.zeros(len(mesh.triangles))
        cells["solid_fraction"][problem.powder_elements] = solution.fill
    original, triangles = _split_by_region(mesh.triangles, region)
    r = mesh.points[:, 0]
    A = np.divide(solution.point_psi, r, out=np.zeros_like(r), where=r > 0.0)
    at_corners = solution.corner_flux_density()
    weight = np.repeat(mesh.element_area(), 3)
    around = np.bincount(triangles.ravel(), weight)

    def mean(values: np.ndarray) -> np.ndarray:
        parts = [np.bincount(triangles.ravel(), weight * part) / around for part in values.reshape(-1, 2).T]
        return np.column_stack(parts)

    at_points = {
        "flux_density": mean(at_corners),
        "field_strength": mean(_field_strength(solution, at_corners)),
        "vector_potential": A[original],
    }
    return SectionArrays(mesh.points[original], triangles, cells, at_points, names)


def _field_strength(solution: MagneticField, B: np.ndarray) -> np.ndarray:
    """H [A/m] where the flux density is B [T], (k, q, 2) at q places of each element; see `PowderState.source`."""
    size = np.linalg.norm(B, axis=2)
    H, slope = solution.problem.H_of_B(size, solution.powder)
    nu = np.where(size > 0.0, H / np.where(size > 0.0, size, 1.0), slope)
    strength = nu[:, :, None] * B
    if solution.powder is not None and solution.powder.source is not None:
        strength[solution.problem.powder_elements] -= solution.powder.source.mean(axis=2)[:, None]
    if (added := solution.history_field_strength()) is not None:
        strength += added[:, None]
    return strength


def _split_by_region(triangles: np.ndarray, region: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The old point of each new one (n,), and triangles (k, 3) of the new points, which no two regions share."""
    pairs = np.column_stack([np.repeat(region, 3), triangles.ravel()])
    new, number = np.unique(pairs, axis=0, return_inverse=True)
    return new[:, 1], number.reshape(triangles.shape)


def field_arrays_3d(solution: Field3D) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Corner points (n, 3), tetrahedra (k, 4) and cell arrays of a field in 3D, at the tetrahedra's centroids."""
    mesh = solution.problem.mesh
    element = solution.problem.elements.element_of_quadrature
    weight = solution.problem.elements.weight
    volume = np.bincount(element, weight)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.bincount(element, weight * part) for part in values.T]) / volume[:, None]

    B, H = mean(solution.B_at_quadrature), mean(solution.H_at_quadrature)
    size = np.linalg.norm(H, axis=1)
    mu_r = np.divide(np.linalg.norm(B, axis=1), MU_0 * size, out=np.ones_like(size), where=size > 0.0)
    region = np.zeros(len(mesh.tetrahedra), dtype=np.int32)
    for number, name in enumerate(sorted(mesh.regions)):
        region[mesh.regions[name]] = number
    cells = {"flux_density": B, "field_strength": H, "relative_permeability": mu_r, "region": region}
    return mesh.points[: mesh.n_corners], mesh.tetrahedra, cells
