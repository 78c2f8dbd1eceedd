"""Reflection coefficient of a steel wall, k = (mu_e - 1)/(mu_e + 1), from the permeability of the solved field.

With B across the wall the mirror charges are spread by the differential permeability along B and by the secant one
across it: mu_e = sqrt(mu_n mu_t), mu_n = dB/dH, mu_t = B/H (an anisotropic half-space, Landau and Lifshitz,
Electrodynamics of Continuous Media, §13). A saturated wall mirrors weakly, one that is not magnetic not at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from field import MU_0, MagneticField
from field.laws.powder_law import PowderLaw
from geometry import RevolvedWall

POINTS = 9  # along a wall, at both of its sides
INSIDE = 1e-3  # of a wall's length: how deep in the steel its permeability is read


def steel_walls(walls: Sequence, solution: MagneticField | None = None) -> np.ndarray:
    """Rows (w, 6) of `coupling.mirror` for the magnetic surfaces of revolution among `walls`.

    Their k is 1 without a `solution`, else the mean over the wall of what the solution says of the steel behind it.
    """
    rows = []
    for wall in walls:
        if not (isinstance(wall, RevolvedWall) and wall.magnetic):
            continue
        start, end = np.asarray(wall.start), np.asarray(wall.end)
        length = float(np.hypot(*(end - start)))
        tangent = (end - start) / length
        k = 1.0 if solution is None else _reflection(solution, start, tangent, length)
        rows.append([*start, *tangent, length, k])
    return np.array(rows, dtype=float).reshape(-1, 6)


def _reflection(solution: MagneticField, start: np.ndarray, tangent: np.ndarray, length: float) -> float:
    """Mean k of the steel on that side of the wall where there is more of it."""
    problem = solution.problem
    along = start + np.outer((np.arange(POINTS) + 0.5) / POINTS * length, tangent)
    normal = np.array([-tangent[1], tangent[0]])
    powder = [problem.mesh.regions[r] for r in problem.mesh.regions if isinstance(problem.law_of(r), PowderLaw)]
    best = 0.0
    for side in (1.0, -1.0):
        points = along + side * INSIDE * length * normal
        points = np.ascontiguousarray(points[points[:, 0] >= 0.0])
        element, _ = problem.locator.find(points)
        inside = (element >= 0) & ~np.isin(element, np.concatenate(powder) if powder else [])
        if not inside.any():
            continue
        B = np.hypot(*solution.problem.elements.flux_density_at(solution.psi, element[inside], points[inside]).T)
        region = problem.mesh.region_of_element()[element[inside]]
        k = np.empty(len(B))
        for name in np.unique(region):
            here = region == name
            H, slope = problem.laws[str(name)].H_of_B(B[here])
            secant = np.divide(B[here], H, out=1.0 / slope, where=H > 0.0) / MU_0
            mu = np.sqrt(np.maximum(secant / (MU_0 * slope), 1.0))
            k[here] = (mu - 1.0) / (mu + 1.0)
        best = max(best, float(k.sum()) / POINTS)
    return best
