"""Spheres that magnetise one another in a uniform field: a finite cluster, or a cell that repeats in all directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MIN_GAP, LaggedForces, Magnetisation, MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field import MU_0
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import Law
from particles import ShearedBox

SPACINGS = 6.0
"""Mean distances of spheres within which `magnetised_cell` counts pairs: where the sum over shells has settled."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """Magnetised spheres.

    Attributes
    ----------
    moment : ndarray (n, 3)
        [A m^2].
    magnetisation : ndarray (n, 3)
        Moment over volume [A/m].
    force : ndarray (n, 3)
        [N].
    energy : float
        Of the spheres in the field, see `coupling.mutual_moments` [J].
    residual : float
        Of the moments [-].
    sweeps : int
    """

    moment: np.ndarray
    magnetisation: np.ndarray
    force: np.ndarray
    energy: float
    residual: float
    sweeps: int


@dataclass(frozen=True, slots=True)
class Cell(Cluster):
    """Magnetised spheres of a cell that repeats; moments, forces and energy are those of one cell.

    Attributes
    ----------
    stress : ndarray (3, 3)
        Force along the second axis on a plane across the first one over its area, of the spheres alone, positive where
        they pull [Pa]: -(sum of r_a F_b over pairs)/volume - mu_0 P_a^2/2 of the normal, with P the mean magnetisation.
    """

    stress: np.ndarray


def magnetised_cluster(
    centre: np.ndarray,
    radius: np.ndarray | float,
    law: Law | GrainLaw,
    field: np.ndarray,
    *,
    model: str = "near_field",
    smallest_gap: float = MIN_GAP,
    tolerance: float = 1e-12,
    max_sweeps: int = 2000,
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
    tolerance, max_sweeps : float, int
        Of the moments' residual.

    Raises
    ------
    ValueError
        Shapes that do not fit, radii not above 0, numbers that are not finite, see also `grain_table`.
    RuntimeError
        The moments did not converge.
    """
    x, a, H = _spheres(centre, radius, field)
    # twice beyond the farthest pair: no pair comes near the switch
    span = float(np.linalg.norm(np.ptp(x, axis=0))) if len(x) > 1 else 0.0
    reach = 2.0 * span + 8.0 * float(a.max(initial=1.0))
    solver = MutualMoments(grain_table(law, model), near=model == "near_field", reach=reach, smallest_gap=smallest_gap)
    state, lagged = _solve(solver, x, a, H, None, tolerance, max_sweeps)
    moment = state.moment
    volume = 4.0 / 3.0 * np.pi * a**3
    energy = solver.energy(x, a, state)
    return Cluster(moment, moment / volume[:, None], lagged.force, energy, state.residual, state.sweeps)


def magnetised_cell(
    centre: np.ndarray,
    radius: np.ndarray | float,
    box: np.ndarray,
    law: Law | GrainLaw,
    field: np.ndarray,
    *,
    model: str = "near_field",
    reach: float = 5.0,
    smallest_gap: float = MIN_GAP,
    tolerance: float = 1e-10,
    max_sweeps: int = 2000,
) -> Cell:
    """Moments, forces and stress of spheres that repeat in all directions, in a macroscopic field.

    Pairs within ``reach``, and within `SPACINGS` mean distances of the spheres, are counted one by one, the rest as an
    even powder (`coupling.pair_fields`), which changes the stress of a simple cubic lattice by at most 1.1 %.

    Parameters
    ----------
    centre, radius, law, model, smallest_gap, tolerance, max_sweeps
        See `magnetised_cluster`.
    box : array_like (3,)
        Edges of the cell [m]; a cell smaller than two reaches is repeated.
    field : array_like (3,)
        Macroscopic field H, the mean over all space [A/m].
    reach : float
        [largest radii], at least 5; a longer one costs its third power in memory and time.

    Raises
    ------
    ValueError
        As `magnetised_cluster`; edges that are not above 0, a reach below 5.
    RuntimeError
        The moments did not converge.
    """
    x, a, H = _spheres(centre, radius, np.asarray(field, dtype=float).reshape(3))
    edges = np.asarray(box, dtype=float).reshape(-1)
    if edges.shape != (3,) or not (np.isfinite(edges).all() and edges.min() > 0.0):
        raise ValueError(f"`box` = {edges.tolist()}; allowed: three edges above 0 [m]")
    if not (np.isfinite(reach) and reach >= 5.0):
        raise ValueError(f"`reach` = {reach}; allowed: 5 largest radii or more")
    n, spacing = len(x), float(np.prod(edges) / max(len(x), 1)) ** (1 / 3)
    far = max(reach * float(a.max(initial=1e-300)), SPACINGS * spacing if n else 0.0)
    times = np.maximum(np.ceil(2.0 * far / edges), 1).astype(int)
    copies = np.stack(np.meshgrid(*(np.arange(k) for k in times), indexing="ij"), axis=-1).reshape(-1, 3) * edges
    many = len(copies)
    everywhere = (np.mod(x, edges)[None, :, :] + copies[:, None, :]).reshape(-1, 3)
    solver = MutualMoments(
        grain_table(law, model), near=model == "near_field", reach=far, smear=True, smallest_gap=smallest_gap
    )
    radii = np.tile(a, many)
    state, lagged = _solve(
        solver, everywhere, radii, np.tile(H, (many, 1)), ShearedBox(edges * times), tolerance, max_sweeps
    )
    moment, volume = state.moment[:n], 4.0 / 3.0 * np.pi * a**3
    mean = moment.sum(axis=0) / np.prod(edges)
    assert lagged.virial is not None
    stress = -lagged.virial / (many * np.prod(edges)) - 0.5 * MU_0 * np.diag(mean**2)
    energy = solver.energy(everywhere, radii, state) / many
    return Cell(moment, moment / volume[:, None], lagged.force[:n], energy, state.residual, state.sweeps, stress)


def _spheres(centre, radius, field) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x = np.array(centre, dtype=float).reshape(-1, 3)
    a = np.array(np.broadcast_to(np.asarray(radius, dtype=float), (len(x),)))
    H = np.array(np.broadcast_to(np.asarray(field, dtype=float), x.shape))
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(H)) and np.all(np.isfinite(a) & (a > 0.0))):
        raise ValueError("`centre`, `radius` and `field` must be finite numbers, radii above 0 [m]")
    return x, a, H


def _solve(
    solver: MutualMoments, x: np.ndarray, a: np.ndarray, H: np.ndarray, box: ShearedBox | None, tolerance: float,
    max_sweeps: int,
) -> tuple[Magnetisation, LaggedForces]:  # fmt: skip
    rows = neighbour_rows(x, solver.reach, box)
    state = solver.solve(x, a, H, rows, tolerance=tolerance, max_sweeps=max_sweeps)
    if state.residual > tolerance:
        raise RuntimeError(
            f"the moments of {len(x)} spheres did not converge: residual {state.residual:.2g} after {state.sweeps} "
            f"sweeps, above `tolerance` = {tolerance:g}; raise `tolerance` or `max_sweeps`"
        )
    return state, solver.forces(x, a, rows, state, virial=box is not None)
