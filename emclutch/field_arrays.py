"""A solved section as arrays for ParaView, one value an element or a point."""

from __future__ import annotations

import numpy as np

from field import NU_0, MagneticField


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
        cells["solid_fraction"][mesh.regions["powder"]] = solution.fill
    r = mesh.points[:, 0]
    A = np.divide(solution.point_psi, r, out=np.zeros_like(r), where=r > 0.0)
    return cells, {"vector_potential": A}, names
