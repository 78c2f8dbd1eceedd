"""Axial force on a body: Maxwell stress through the air around it, virtual work, and J x B in the coil.

Displace the body by d along z and let the air around it deform with a weight w(r, z), 1 on the body and 0 on
everything that stays.  The field is the stationary point of L(psi) = integral r w_m(|B|) - J psi, so the force
is dL/dd at fixed psi alone (Coulomb 1983; Henrotte and Hameyer 2004):

    F_z = -2 pi integral [ r w_m w_z - (nu/r) psi_z (w_r psi_r + w_z psi_z) ] dr dz,

where w_r, w_z are derivatives of the weight and w_m is the energy density: the Maxwell stress integrated over the
whole shell in which w falls (an «eggshell») instead of over one surface.  In air it is -integral T . grad w.
With w piecewise linear on the mesh the very derivative of the *discrete* energy is taken, so that

- virtual work on the same mesh, (W*(d) - W*(-d))/(2 d) with the nodes moved by w d, agrees to O(d^2);
- the forces on all nodes add up to nothing, to round-off (w = 1 everywhere);
- with a smooth w the force converges as the energy does, at twice the order of the field.

w is s(u) with u the solution of Laplace's equation between body and surroundings and s(u) = u^3 (10 - 15 u + 6 u^2),
whose slope vanishes at both ends: the shell then keeps away from faces and corners of iron, where the field is
singular (u itself has the worst of its slope there).

Only air may deform: of a body that touches iron or powder the shell would cut them, and its force would depend
on where.  Regions through which a force is computed all the same (powder, as a fluid at constant fill) are named in
`yielding`.  Two weights, the smooth one and one that falls within a single layer of elements, must agree: their
difference is the error that is reported.

Radial forces on a ring add up to nothing; the Maxwell torque of an axisymmetric field is zero.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from field.factorisation import SymmetricSolver
from field.laws.reluctivity import NU_0, LinearLaw
from field.section.error_estimate import next_order_field

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.magnetic_field import MagneticField
    from field.section.section_elements import SectionElements
    from geometry.section import SectionMesh

# Virtual work moves nodes by this fraction of what would flatten the worst element: its own error, the square of
# that, is then 1e-4 of the force at most, and differences of the energy keep ten digits.
_FRACTION_OF_ELEMENT = 1e-2
# Of the displaced solves: W* is stationary, what they leave of it is the square.
_TOLERANCE = 1e-6


class UndefinedForce(ValueError):
    """A body on which no force is defined.

    Attributes
    ----------
    reason : str
        Why, without what to do about it in a call of `axial_force`.
    """

    def __init__(self, reason: str, remedy: str) -> None:
        self.reason = reason
        super().__init__(f"{reason}; {remedy}")


@dataclass(frozen=True, slots=True)
class AxialForce:
    """Force on a body along z.

    Attributes
    ----------
    body : tuple of str
        Regions of the body.
    maxwell_stress : float
        Through the smooth shell [N]; the value to use.
    thin_shell : float
        Through a single layer of elements around the body [N].
    virtual_work : float or None
        From the co-energy of the displaced body [N]; None where it was not requested.
    next_order : float or None
        Through the smooth shell in the field of elements of the next order [N]; None where it was not requested.
    weight : ndarray (n_points,)
        Of the smooth shell.
    """

    body: tuple[str, ...]
    maxwell_stress: float
    thin_shell: float
    weight: np.ndarray = dataclasses.field(repr=False, compare=False)
    virtual_work: float | None = None
    next_order: float | None = None

    @property
    def error(self) -> float:
        """Estimate of the error of `maxwell_stress` [N].

        With `next_order` twice the change to it (iron corners hold both orders to the same rate); without, how far
        a rougher shell is off, which does not see how far the whole field is off.
        """
        shells = abs(self.maxwell_stress - self.thin_shell)
        return shells if self.next_order is None else 2.0 * abs(self.next_order - self.maxwell_stress)


def axial_force(
    solution: MagneticField,
    body: str | Sequence[str],
    *,
    yielding: Sequence[str] = (),
    virtual_work: bool = False,
    displacement: float | None = None,
    next_order: bool = False,
) -> AxialForce:
    """Force along z on a body of one or several regions.

    Parameters
    ----------
    body : str or sequence of str
        Regions that move together; the coil may be one.
    yielding : sequence of str
        Regions that are no air and deform nevertheless.
    virtual_work : bool
        Also by two more solves with the body displaced; with one more factorisation for both.
    displacement : float or None
        Half the distance between them [m]; None: a hundredth of what would flatten an element.
    next_order : bool
        Also by a solve with elements of the next order, for an error that knows of the mesh (order 1 to 3).

    Raises
    ------
    UndefinedForce
        A body without room to move, or one that touches what cannot deform.
    ValueError
        An unknown region.
    """
    regions = (body,) if isinstance(body, str) else tuple(body)
    smooth = body_weight(solution.problem, regions, solution, yielding=yielding)
    thin = _thin_weight(solution.problem.mesh, regions, smooth)
    stress = _corner_forces(solution)
    work = force_by_virtual_work(solution, smooth, displacement) if virtual_work else None
    finer = force_of_weight(next_order_field(solution), smooth) if next_order else None
    through = [_weighted_sum(stress, solution.problem.elements, weight) for weight in (smooth, thin)]
    return AxialForce(regions, through[0], through[1], smooth, work, finer)


def force_of_weight(solution: MagneticField, weight: np.ndarray) -> float:
    """F_z [N] on what moves with a weight (n_points,) at the mesh's points, linear between."""
    return _weighted_sum(_corner_forces(solution), solution.problem.elements, weight)


def _weighted_sum(corner_forces: np.ndarray, elements: SectionElements, weight: np.ndarray) -> float:
    return float(-2.0 * math.pi * (weight[elements.element_dofs[:, :3]] * corner_forces).sum())


def _corner_forces(solution: MagneticField) -> np.ndarray:
    """dL/dz of the corners of every element, its first three unknowns, per radian, (n_elements, 3) [N/rad]."""
    problem, elements = solution.problem, solution.problem.elements
    g = elements.gradient(solution.psi)
    r = elements.radius
    B = np.hypot(g[:, 0], g[:, 1]) / r
    H, slope = problem.H_of_B(B, solution.powder)
    nu = np.where(B > 0.0, H / np.where(B > 0.0, B, 1.0), slope)
    energy = problem.energy_density(B, solution.powder)
    stress_r = -nu / r * g[:, 1] * g[:, 0] * elements.weight
    stress_z = (r * energy - nu / r * g[:, 1] ** 2) * elements.weight
    slopes = np.broadcast_to(elements.corner_gradients(), (*B.shape, 3, 2))
    return np.einsum("eq,eqc->ec", stress_r, slopes[..., 0]) + np.einsum("eq,eqc->ec", stress_z, slopes[..., 1])


def _corner_gradients(mesh: SectionMesh) -> np.ndarray:
    """Gradients of the linear shape functions of straight triangles, (n_elements, 3, 2) [1/m]."""
    corners = mesh.points[mesh.triangles]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    turned = np.stack((-opposite[:, :, 1], opposite[:, :, 0]), axis=2)
    return turned / (2.0 * mesh.element_area())[:, None, None]


def body_weight(
    problem: AxisymmetricProblem,
    body: Sequence[str],
    solution: MagneticField | None = None,
    *,
    yielding: Sequence[str] = (),
) -> np.ndarray:
    """Smooth weight (n_points,): 1 on the body, 0 on all else that is no air and on the outer boundary.

    Raises ValueError, see `axial_force`.
    """
    mesh = problem.mesh
    unknown = [name for name in (*body, *yielding) if name not in mesh.regions]
    if unknown or not body:
        raise ValueError(
            f"no region {', '.join(map(repr, unknown)) or 'at all'} to take the force on; "
            f"the mesh has {', '.join(sorted(mesh.regions))}"
        )
    others = set(mesh.regions) - set(body)
    soft = {name for name in others if name in yielding or is_deformable(problem, name, solution)}
    moving = _points_of(mesh, body)
    standing = _points_of(mesh, [name for name in mesh.regions if name not in body and name not in soft])
    touching = [
        name
        for name in mesh.regions
        if name not in body and name not in soft and np.any(moving & _points_of(mesh, [name]))
    ]
    if touching:
        raise UndefinedForce(
            f"the body {', '.join(body)} touches {', '.join(sorted(touching))}, and a force is defined across air or "
            "powder only: draw a gap of air between them",
            "or take them as one body, or name the region in `yielding`",
        )
    standing[np.unique(mesh.boundaries["outer"])] = True
    if np.any(moving & standing):
        raise UndefinedForce(f"the body {', '.join(body)} reaches the outer boundary", "enlarge the air around it")
    u = np.clip(_harmonic(mesh, moving, standing), 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def is_deformable(problem: AxisymmetricProblem, name: str, solution: MagneticField | None) -> bool:
    """True if a region is equivalent to air: no iron, no current, no powder in it."""
    if name == problem.coil_region:
        return False
    if problem.powder_law is not None and name == problem.powder_region:
        return solution is not None and (solution.fill is None or not solution.fill.any())
    law = problem.laws[name]
    return isinstance(law, LinearLaw) and law.mu_r == 1.0


def _points_of(mesh: SectionMesh, regions: Sequence[str]) -> np.ndarray:
    chosen = np.zeros(len(mesh.points), dtype=bool)
    for name in regions:
        chosen[mesh.triangles[mesh.regions[name]]] = True
    return chosen


def _harmonic(mesh: SectionMesh, one: np.ndarray, zero: np.ndarray) -> np.ndarray:
    """Linear finite elements for integral r grad w . grad v = 0 with w = 1 and w = 0 given, on the air between."""
    slopes = _corner_gradients(mesh)
    volume = mesh.element_area() * mesh.centroid()[:, 0]
    blocks = np.einsum("eik,ejk,e->eij", slopes, slopes, volume)
    rows, columns = np.repeat(mesh.triangles, 3, axis=1).ravel(), np.tile(mesh.triangles, (1, 3)).ravel()
    matrix = sp.csr_matrix((blocks.ravel(), (rows, columns)), shape=(len(mesh.points),) * 2)
    weight = one.astype(float)
    free = np.flatnonzero(~(one | zero))
    if free.size:
        inner = matrix[free][:, free].tocsc()
        inner.sort_indices()
        weight[free] = SymmetricSolver("superlu").solve(inner, -(matrix @ weight)[free])
    return weight


def _thin_weight(mesh: SectionMesh, body: Sequence[str], smooth: np.ndarray) -> np.ndarray:
    """1 on the body and on air that only the body borders, 0 beyond the first layer of elements around it."""
    moving = _points_of(mesh, body).astype(float)
    # air that is shut in by the body moves with it
    return np.where(smooth > 1.0 - 1e-9, 1.0, moving)


def force_by_virtual_work(solution: MagneticField, weight: np.ndarray, displacement: float | None = None) -> float:
    """F_z [N] = d W*/dd at constant current, central difference of two solves on the mesh moved by d w.

    W* = N I lambda_turn - W: the co-energy, also where a field is imposed on the outer boundary. Both solves begin at
    the body's own place with the tangent factorised there.
    """
    if solution.history is not None:
        raise ValueError("no virtual work with hysteresis: it has no co-energy; the Maxwell stress gives the force")
    mesh = solution.problem.mesh
    if displacement is None:
        stretch = np.abs(np.einsum("ei,ei->e", weight[mesh.triangles], _corner_gradients(mesh)[:, :, 1])).max()
        displacement = _FRACTION_OF_ELEMENT / stretch
    if not (math.isfinite(displacement) and displacement > 0.0):
        raise ValueError(f"`displacement` = {displacement} m must be a finite number above 0")
    solution.problem.factorise_tangent(solution)
    values = []
    for sign in (1.0, -1.0):
        points = mesh.points.copy()
        points[:, 1] += sign * displacement * weight
        moved = solution.problem.with_points(points).solve(
            solution.ampere_turns,
            solution.powder,
            solution.psi,
            tolerance=_TOLERANCE,
            boundary_field=solution.boundary_field,
            factorised=True,
        )
        values.append(solution.ampere_turns * moved.flux_linkage_per_turn - moved.energy)
    return (values[0] - values[1]) / (2.0 * displacement)


def lorentz_force(solution: MagneticField) -> float:
    """Axial force on the coil by J x B [N]: F_z = -integral J B_r dV = 2 pi J integral dpsi/dz dr dz."""
    problem = solution.problem
    if problem.coil_area == 0.0:
        raise ValueError(
            f"no force on a coil: the mesh has no region {problem.coil_region!r}; "
            f"it has {', '.join(sorted(problem.mesh.regions))}"
        )
    coil = problem.mesh.regions[problem.coil_region]
    psi_z = problem.elements.gradient(solution.psi)[coil, 1]
    J = solution.ampere_turns / problem.coil_area
    return float(2.0 * math.pi * J * (psi_z * problem.elements.weight[coil]).sum())


def pole_pressure(B: np.ndarray | float) -> np.ndarray:
    """Tension B^2/(2 mu_0) [Pa] of ideal iron's face towards air, B [T] normal to it."""
    return 0.5 * NU_0 * np.asarray(B, dtype=float) ** 2
