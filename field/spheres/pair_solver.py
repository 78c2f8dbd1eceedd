"""Two equal spheres on the axis in a uniform axial field, by the project's own axisymmetric solver.

The spheres have radius 1 m (every result is given in units without it), the gap between them is in radii. By symmetry
the upper half is solved: on the plane between them the field stands at right angles, and around them is the open
boundary.  Force and moment are

    F  = stress through the air between the sphere and the plane (`maxwell_force.force_of_weight`), attraction > 0,
         the derivative of the discrete energy,
    M  = mean over the sphere of B/mu_0 - H,

F in mu_0 Ms^2 a^2 and M in Ms; both converge with the fourth power of the element size, which is the polygon's error.
By the plane of symmetry itself, F = (mu_0/2) integral of (H_z - h)^2 dA: there the cross term mu_0 h (H_z - h) adds up
to nothing, because no net flux returns through an infinite plane; the tests check the one against the other.

Fields are solved upwards, each from the straight line through the two before: psi is linear in h far below and far
beyond saturation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import MU_0, NU_0, Law
from field.section.axisymmetric import AxisymmetricProblem
from field.section.magnetic_field import MagneticField
from field.section.maxwell_force import _harmonic, force_of_weight
from field.spheres.lone_sphere import bulk_law, saturation
from field.spheres.pair_mesh import pair_mesh

# Relative residual of Newton: forces agree to 1e-6 with those at 1e-10.
_TOLERANCE = 1e-7
_SPHERE_VOLUME = 4.0 / 3.0 * math.pi


@dataclass(frozen=True, slots=True)
class PairSolution:
    """Force and moment of a pair at some fields.

    Attributes
    ----------
    field : ndarray (n,)
        Uniform field without the spheres [Ms].
    force : ndarray (n,)
        On one sphere, attraction > 0 [mu_0 Ms^2 a^2].
    moment : ndarray (n,)
        Mean magnetisation of a sphere [Ms].
    """

    field: np.ndarray
    force: np.ndarray
    moment: np.ndarray


class SpherePair:
    """Two spheres at one gap, meshed once.

    Parameters
    ----------
    law : Law or GrainLaw
        Bulk law of the spheres.
    gap : float
        In radii, 1e-5 to 10.
    resolution : float
        Divides every element size; 1 is good to some 1e-4 of force with order 3.
    order : int
        Of the elements, 1 to 4.

    Raises
    ------
    ValueError
        A gap out of range.
    """

    def __init__(self, law: Law | GrainLaw, gap: float, *, resolution: float = 1.0, order: int = 3) -> None:
        if not 1e-5 <= gap <= 10.0:
            raise ValueError(f"`gap` = {gap:g} radii: allowed are 1e-5 to 10")
        self.gap = gap
        self.law = bulk_law(law)
        mesh = pair_mesh(gap, resolution)
        self.problem = AxisymmetricProblem(mesh, {"sphere": self.law}, order=order, open_boundary=True)
        moving = np.zeros(len(mesh.points), dtype=bool)
        moving[mesh.triangles[mesh.regions["sphere"]]] = True
        standing = np.zeros(len(mesh.points), dtype=bool)
        standing[np.unique(mesh.boundaries["outer"])] = True
        standing[np.unique(mesh.boundaries["mirror"])] = True
        u = np.clip(_harmonic(mesh, moving, standing), 0.0, 1.0)
        self._weight = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

    def solve(self, h: float, guess: np.ndarray | None = None) -> MagneticField:
        """The field of the pair in the uniform field h [A/m]."""
        return self.problem.solve(0.0, guess=guess, boundary_field=MU_0 * h, tolerance=_TOLERANCE)

    def force(self, solution: MagneticField) -> float:
        """Force on a sphere of radius 1 m, attraction > 0 [N]."""
        return -force_of_weight(solution, self._weight)

    def magnetisation(self, solution: MagneticField) -> float:
        """Mean magnetisation of a sphere along the axis [A/m]."""
        elements, sphere = self.problem.elements, self.problem.mesh.regions["sphere"]
        gradient, B = elements.flux(solution.psi)
        B = B[sphere]
        nu = self.law.H_of_B(B)[0] / np.where(B > 0.0, B, 1.0)
        M_z = (NU_0 - nu) * gradient[sphere, 0]  # times r
        return float(2.0 * math.pi * (M_z * elements.weight[sphere]).sum() / _SPHERE_VOLUME)


def solve_pair(
    law: Law | GrainLaw,
    gap: float,
    field: Sequence[float] | np.ndarray,
    *,
    resolution: float = 1.0,
    done: Callable[[], None] | None = None,
) -> PairSolution:
    """Force and moment of a pair of a saturating material at growing fields.

    Parameters
    ----------
    law : Law or GrainLaw
    gap : float
        In radii.
    field : sequence of float
        Uniform fields [Ms], above 0 and strictly growing.
    resolution : float
        See `SpherePair`.
    done : callable or None
        Called after each field.

    Raises
    ------
    ValueError
        A law without saturation, fields that do not grow.
    ConvergenceError
        A solve failed.
    """
    h = np.asarray(field, dtype=float)
    if h.ndim != 1 or not np.all(np.isfinite(h) & (h > 0.0)) or np.any(np.diff(h) <= 0.0):
        raise ValueError("`field` must hold numbers above 0 that grow, in units of Ms")
    Ms = saturation(law)
    pair = SpherePair(law, gap, resolution=resolution)
    force, moment = np.empty(h.size), np.empty(h.size)
    last: list[tuple[float, np.ndarray]] = [(0.0, np.zeros(pair.problem.n_dofs))]
    for i, one in enumerate(h):
        guess = None
        if len(last) > 1:
            (h1, psi1), (h2, psi2) = last[-2:]
            guess = psi2 + (psi2 - psi1) * ((one - h2) / (h2 - h1))
        solution = pair.solve(one * Ms, guess)
        last = [last[-1], (float(one), solution.psi)]
        force[i] = pair.force(solution) / (MU_0 * Ms**2)
        moment[i] = pair.magnetisation(solution) / Ms
        if done is not None:
            done()
    return PairSolution(h, force, moment)
