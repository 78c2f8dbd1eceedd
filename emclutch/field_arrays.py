"""A solved section as arrays for ParaView, one value an element or a point."""

from __future__ import annotations

import numpy as np

from field import MU_0, NU_0, MagneticField
from field.solid import SolidField


def field_arrays(solution: MagneticField) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], list[str]]:
    """Cell arrays, point arrays, and the names that the numbers of the cell array `region` stand for."""
    problem, mesh = solution.problem, solution.problem.mesh
    B = solution.flux_density()
    mu_r = solution.relative_permeability()
    names = sorted(mesh.regions)
    region = np.zeros(len(mesh.triangles), dtype=np.int32)
    for number, name in enumerate(names):
        region[mesh.regions[name]] = number
    J = np.zeros(len(mesh.triangles))
    J[mesh.regions["coil"]] = solution.ampere_turns / problem.coil_area
    cells = {
        "flux_density": B,
        "field_strength": NU_0 * B / mu_r[:, None],
        "relative_permeability": mu_r,
        "region": region,
        "current_density": J,
    }
    if solution.fill is not None:
        cells["solid_fraction"] = np.zeros(len(mesh.triangles))
        cells["solid_fraction"][problem.powder_elements] = solution.fill
    r = mesh.points[:, 0]
    A = np.divide(solution.point_psi, r, out=np.zeros_like(r), where=r > 0.0)
    return cells, {"vector_potential": A}, names


def solid_field_arrays(solution: SolidField) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Corner points (n, 3), tetrahedra (k, 4) and cell arrays of a field in space, at the tetrahedra's centroids."""
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
