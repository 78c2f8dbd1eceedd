"""A finite cluster of spheres that magnetise one another in a uniform field, every pair counted whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MIN_GAP, MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import Law


@dataclass(frozen=True, slots=True)
class Cluster:
    """A finite cluster of magnetised spheres: moments (n, 3) [A m^2], forces (n, 3) [N], residual [-], sweeps."""

    moment: np.ndarray
    magnetisation: np.ndarray
    force: np.ndarray
    residual: float
    sweeps: int


def magnetised_cluster(
    centre: np.ndarray,
    radius: np.ndarray | float,
    law: Law | GrainLaw,
    field: np.ndarray,
    *,
    model: str = "near_field",
    smallest_gap: float = MIN_GAP,
    tolerance: float = 1e-12,
    most_sweeps: int = 2000,
) -> Cluster:
    """Moments and forces of spheres in a uniform applied field, every pair counted whole.

    Parameters
    ----------
    centre : array_like (n, 3)
        [m].
    radius : float or array_like (n,)
        [m].
    law : Law or GrainLaw
        Of the grains' material, e.g. ``GrainLaw(chi=999.0, Ms=1.7e6)``.
    field : array_like (3,) or (n, 3)
        Applied field without the spheres [A/m].
    model : 'near_field' or 'mutual'
    smallest_gap : float
        Gap between surfaces that touch [radii].
    tolerance, most_sweeps : float, int
        Of the moments' residual.

    Returns
    -------
    Cluster
        With `magnetisation` (n, 3) = moment over volume [A/m].

    Raises
    ------
    ValueError
        Shapes that do not fit, radii not above 0, numbers that are not finite, see also `grain_table`.
    RuntimeError
        The moments did not converge.
    """
    x = np.array(centre, dtype=float).reshape(-1, 3)
    a = np.array(np.broadcast_to(np.asarray(radius, dtype=float), (len(x),)))
    H = np.array(np.broadcast_to(np.asarray(field, dtype=float), x.shape))
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(H)) and np.all(np.isfinite(a) & (a > 0.0))):
        raise ValueError("`centre`, `radius` and `field` must be finite numbers, radii above 0 [m]")
    # twice beyond the farthest pair: no pair comes near the switch
    span = float(np.linalg.norm(np.ptp(x, axis=0))) if len(x) > 1 else 0.0
    reach = 2.0 * span + 8.0 * float(a.max(initial=1.0))
    solver = MutualMoments(grain_table(law, model), near=model == "near_field", reach=reach, smallest_gap=smallest_gap)
    rows = neighbour_rows(x, reach)
    found = solver.solve(x, a, H, rows, tolerance=tolerance, most_sweeps=most_sweeps)
    if found.residual > tolerance:
        raise RuntimeError(
            f"the moments of {len(x)} spheres did not converge: residual {found.residual:.2g} after {found.sweeps} "
            f"sweeps, asked for {tolerance:g}; raise `tolerance` or `most_sweeps`"
        )
    force, _, _ = solver.forces(x, a, rows, found)
    volume = 4.0 / 3.0 * np.pi * a**3
    return Cluster(found.moment, found.moment / volume[:, None], force, found.residual, found.sweeps)
