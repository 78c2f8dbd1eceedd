"""Reflection coefficient of a steel wall, k = (mu_e - 1)/(mu_e + 1), from the permeability of the solved field.

With B across the wall the mirror charges are spread by the differential permeability along B and by the secant one
across it: mu_e = sqrt(mu_n mu_t), mu_n = dB/dH, mu_t = B/H (an anisotropic half-space, Landau and Lifshitz,
Electrodynamics of Continuous Media, §13). A saturated wall mirrors weakly, one that is not magnetic not at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coupling.smear_region import magnetic_regions
from field import MU_0, MagneticField
from field.three_d import Field3D
from geometry import RevolvedWall

ANGLES = 24  # in 3D, over the sector that is meshed
POINTS = 9  # along a wall, at both of its sides
INSIDE = 1e-3  # of a wall's length: how deep in the steel its permeability is read


def steel_walls(
    walls: Sequence, solution: MagneticField | Field3D | None = None, *, steel_only: bool = False
) -> np.ndarray:
    """Rows (w, 6) of `coupling.mirror` for the magnetic surfaces of revolution among `walls`.

    Their k is 1 without a `solution`, else the mean over the wall of what the solution says of the steel behind it,
    with `steel_only` over its teeth without the slots.
    """
    rows = []
    for wall in walls:
        if not (isinstance(wall, RevolvedWall) and wall.magnetic):
            continue
        start, end = np.asarray(wall.start), np.asarray(wall.end)
        length = float(np.hypot(*(end - start)))
        tangent = (end - start) / length
        k = 1.0 if solution is None else _reflection(solution, start, tangent, length, steel_only)
        rows.append([*start, *tangent, length, k])
    return np.array(rows, dtype=float).reshape(-1, 6)


def _reflection(
    solution: MagneticField | Field3D, start: np.ndarray, tangent: np.ndarray, length: float, steel_only: bool
) -> float:
    """Mean k of the steel on that side of the wall where there is more of it, in 3D also over the angle."""
    problem = solution.problem
    along = start + np.outer((np.arange(POINTS) + 0.5) / POINTS * length, tangent)
    normal = np.array([-tangent[1], tangent[0]])
    powder = [problem.mesh.regions["powder"]] if problem.powder_law is not None else []
    magnetic = magnetic_regions(problem.laws)
    best = fraction = 0.0
    for side in (1.0, -1.0):
        points = along + side * INSIDE * length * normal
        points, count = np.ascontiguousarray(points[points[:, 0] >= 0.0]), POINTS
        if isinstance(solution, Field3D):
            points, count = _around(solution, points), POINTS * ANGLES
        element, _ = problem.locator.find(points)
        inside = (element >= 0) & ~np.isin(element, np.concatenate(powder) if powder else [])
        if not inside.any():
            continue
        if isinstance(solution, Field3D):
            B = np.linalg.norm(solution.flux_density(points[inside]), axis=1)
        else:
            B = np.hypot(*solution.problem.elements.flux_density_at(solution.psi, element[inside], points[inside]).T)
        region = problem.mesh.region_of_element()[element[inside]]
        k = np.empty(len(B))
        for name in np.unique(region):
            here = region == name
            H, slope = problem.laws[str(name)].H_of_B(B[here])
            secant = np.divide(B[here], H, out=1.0 / slope, where=H > 0.0) / MU_0
            mu = np.sqrt(np.maximum(secant / (MU_0 * slope), 1.0))
            k[here] = (mu - 1.0) / (mu + 1.0)
        if k.sum() > best * count:
            best, fraction = float(k.sum()) / count, np.count_nonzero(np.isin(region, magnetic)) / count
    return best / fraction if steel_only and fraction > 0.0 else best


def _around(solution: Field3D, points: np.ndarray) -> np.ndarray:
    """Points (k, 2) [m] at angles over the mesh's sector, (k ANGLES, 3)."""
    fold = solution.problem.fold
    angle = fold.first + fold.angle * (np.arange(ANGLES) + 0.5) / ANGLES
    r, z = (np.repeat(x, ANGLES) for x in points.T)
    angle = np.tile(angle, len(points))
    return np.column_stack((r * np.cos(angle), r * np.sin(angle), z))
