"""Flux linkage and inductance of the coil.

    lambda = N phi_turn,      L = lambda/i  (apparent),      L_d = d lambda/d i  (incremental).

L_d needs no second nonlinear solve: with the tangent K at the solution K dpsi/d(N I) = c, c the load of one
ampere-turn, so that L_d = 2 pi N^2 c . dpsi/d(N I).  In saturation L_d < L; at zero current both are the
same.  K is that of the material's curve, so L_d is the slope along the sweep, not that of a minor loop.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from field.newton import scalar_product

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.magnetic_field import MagneticField
    from field.three_d import Field3D


def psi_per_ampere_turn(solution: MagneticField) -> np.ndarray:
    """d psi/d(N I) at constant fill, (n_dofs,) [Wb/(rad A)]: one linear solve with the tangent."""
    problem = solution.problem
    change = np.zeros(problem.n_dofs)
    change[problem._free] = problem.factorise_tangent(solution).solve_again(problem.coil_load[problem._free])
    return change


def incremental_inductance(solution: MagneticField | Field3D, turns: float) -> float:
    """d lambda/d i at constant fill [H]."""
    from field.three_d import Field3D

    if isinstance(solution, Field3D):
        return turns**2 * solution.flux_slope
    _check_coil(solution.problem)
    return 2.0 * math.pi * turns**2 * scalar_product(solution.problem.coil_load, psi_per_ampere_turn(solution))


def apparent_inductance(solution: MagneticField | Field3D, turns: float) -> float:
    """lambda/i [H]; without current its limit, the incremental inductance."""
    if solution.ampere_turns == 0.0:
        return incremental_inductance(solution, turns)
    return turns**2 * solution.flux_linkage_per_turn / solution.ampere_turns


def _check_coil(problem: AxisymmetricProblem) -> None:
    if problem.coil_area == 0.0:
        raise ValueError(
            f"no inductance without a coil: the mesh has no region {problem.coil_region!r}; "
            f"it has {', '.join(sorted(problem.mesh.regions))}"
        )
