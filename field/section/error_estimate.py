"""Error estimates of a solved field in the quantities of interest: flux linkage, field in the gap.

On the same mesh the space of the next order is larger; its solution psi_h + e, a few warm Newton steps away,
gives goal(psi_h + e) - goal(psi_h), a goal's error with its sign, linear or not.  Where the error comes from
follows from the goal's adjoint z, a(v, z) = goal'(v) with the tangent a: the goal's error is a(e, z - z_h) with
z_h the adjoint in the field's own space, and an element's contribution at most |e| |z - z_h| in the norm of a taken
over it (Becker and Rannacher, Acta Numerica 10, 2001).  For the flux linkage of a linear device z is psi itself,
up to a factor, and its relative error that of the energy.

Two things make this an estimate that errs on the side of too much.  The larger space misses something, too: at
a corner of steel psi ~ d^(2/3) (mu_r large), and there the error of a quadratic goal falls with the order p like
p^(-8/3) (Babuska and Suri, SIAM Rev. 36, 1994); where psi is smooth, faster.  So all is divided by
1 - (p/(p + 1))^(8/3): right at corners, up to 1.9 times too large (p = 3) where there are none.  And shares of
both signs may cancel by chance, so an estimate is at least a twentieth of the sum of their magnitudes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from field.factorisation import SymmetricSolver
from field.newton import norm
from field.section.axisymmetric import AxisymmetricProblem
from field.section.interpolation import interpolation
from field.section.magnetic_field import MagneticField
from field.section.powder_state import PowderState
from field.section.section_elements import QUADRATURE_ORDER
from field.sparse_pattern import FixedPattern

# What the surplus of order p + 1 misses at a corner of steel, where the error goes like p^-_CORNER.
_CORNER = 8.0 / 3.0
# How much of the elements' shares is believed to cancel.
_CANCELLING = 0.05
# Residual of the next order's solution relative to what psi_h leaves; and the least that rounding allows.
_STEP = 1e-3
_MIN_RESIDUAL = 1e-11


class Goal(Protocol):
    """A number that the field is solved for."""

    @property
    def name(self) -> str:
        """For tables and messages."""

    def value(self, space: EnrichedSpace, psi: np.ndarray) -> float:
        """Of psi (n_dofs,) of the enriched elements."""

    def slope(self, space: EnrichedSpace, psi: np.ndarray) -> np.ndarray:
        """Derivative by the unknowns, (n_dofs,)."""



@dataclass(frozen=True, slots=True)
class FluxLinkage:
    """Flux through a mean turn of the coil [Wb]."""

    name: str = "flux linkage"

    def value(self, space: EnrichedSpace, psi: np.ndarray) -> float:
        """See `Goal.value`."""
        return float((self.slope(space, psi) * psi).sum())

    def slope(self, space: EnrichedSpace, psi: np.ndarray) -> np.ndarray:
        """See `Goal.slope`."""
        return 2.0 * np.pi * space.richer.coil_load


@dataclass(frozen=True, slots=True)
class MeanFluxDensity:
    """Mean of |B| over the volume of a region [T]."""

    region: str = "powder"

    @property
    def name(self) -> str:
        """See `Goal.name`."""
        return f"mean B in {self.region}"

    def value(self, space: EnrichedSpace, psi: np.ndarray) -> float:
        """See `Goal.value`."""
        gradient, volume = self._parts(space, psi)
        return float(
            (np.hypot(gradient[:, 0], gradient[:, 1]) * space.elements.weight[self._region(space)]).sum() / volume
        )

    def slope(self, space: EnrichedSpace, psi: np.ndarray) -> np.ndarray:
        """See `Goal.slope`."""
        gradient, volume = self._parts(space, psi)
        length = np.hypot(gradient[:, 0], gradient[:, 1])
        flow = np.zeros((len(space.elements.weight), 2, space.elements.n_quadrature))
        flow[self._region(space)] = gradient / (np.where(length > 0.0, length, 1.0)[:, None] * volume)
        return space.elements.divergence(flow)

    def _region(self, space: EnrichedSpace) -> np.ndarray:
        regions = space.problem.mesh.regions
        if self.region not in regions:
            raise ValueError(f"the mesh has no region {self.region!r}; it has {', '.join(sorted(regions))}")
        return regions[self.region]

    def _parts(self, space: EnrichedSpace, psi: np.ndarray) -> tuple[np.ndarray, float]:
        region, elements = self._region(space), space.elements
        return elements.gradient(psi)[region], float((elements.radius * elements.weight)[region].sum())


@dataclass(frozen=True, slots=True)
class GoalError:
    """Estimated error of one goal.

    Attributes
    ----------
    goal : str
    value : float
        The goal's value by the next order, in its unit: better than the field's own.
    relative : float
        Estimated error of the field's own value, relative to `value`.
    """

    goal: str
    value: float
    relative: float


@dataclass(frozen=True, slots=True, eq=False)
class ErrorEstimate:
    """Estimated errors of a field.

    Attributes
    ----------
    goals : tuple of GoalError
    indicators : ndarray (n_goals, n_elements)
        Fraction of each element in each goal's relative error; a goal's fractions add up to its `relative`.
    """

    goals: tuple[GoalError, ...]
    indicators: np.ndarray

    @property
    def worst(self) -> float:
        """Largest relative error of all goals."""
        return max(goal.relative for goal in self.goals)


class EnrichedSpace:
    """The elements of one order more than a problem's, on its mesh.

    Attributes
    ----------
    problem, richer : AxisymmetricProblem
        The problem, and the same one of the next order.
    elements : SectionElements
        Of `richer`.
    embedding : csr_matrix (n_dofs, problem.n_dofs)
        The problem's functions in this space.

    Raises
    ------
    ValueError
        The problem's order is the highest there is.
    """

    def __init__(self, problem: AxisymmetricProblem) -> None:
        order = problem.elements.order + 1
        if order not in QUADRATURE_ORDER:
            raise ValueError(
                f"the error estimate needs elements of one order more than the field's, which are of order "
                f"{order - 1}; solve with `order` = {order - 2} or less"
            )
        powder = problem.powder_region if problem.powder_law is not None else None
        self.problem = problem
        self.richer = AxisymmetricProblem(
            problem.mesh,
            {region: law for region, law in problem.laws.items() if region != powder},
            coil_region=problem.coil_region,
            powder_region=problem.powder_region,
            powder_law=problem.powder_law,
            powder_beyond=problem.powder_beyond,
            order=order,
            open_boundary=problem.exterior is not None,
        )
        self.elements = self.richer.elements
        self.embedding = interpolation(problem.elements, self.elements)

    @cached_property
    def free(self) -> np.ndarray:
        """Unknowns that are not fixed at the axis or at a flux wall, (n_free,)."""
        return _free(self.richer)

    def solve(self, field: MagneticField, boundary_field: float) -> MagneticField:
        """The next order's field, from one of the problem; ValueError with hysteresis, whose history it would lack."""
        if field.history is not None:
            raise ValueError("no error estimate with hysteresis: the field of the next order has another history")
        start = self.embedding @ field.psi
        source = field.ampere_turns * self.richer.coil_load
        exterior = self.richer.exterior
        powder = self.powder_of(field)
        at = self.linearise(start, powder)
        residual = source - self.elements.field_force(at.gradient, at.nu)
        if powder is not None and powder.source is not None:
            residual += self.richer.magnetisation_load(powder.source)
        if exterior is not None:
            source[exterior.dofs] += boundary_field * exterior.uniform_load
            residual[exterior.dofs] += boundary_field * exterior.uniform_load - exterior.force(start)
        scale = norm(source[self.free])
        left = norm(residual[self.free]) / scale if scale > 0.0 else 1e-3
        return self.richer.solve(
            field.ampere_turns,
            powder,
            start,
            tolerance=max(_STEP * left, _MIN_RESIDUAL),
            boundary_field=boundary_field,
        )

    def powder_of(self, field: MagneticField) -> PowderState | None:
        """The field's powder at the next order's quadrature points."""
        if field.powder is None:
            return None
        return field.powder.on_points(field.problem.elements.reference_points, self.elements.reference_points)

    def linearise(self, psi: np.ndarray, powder: PowderState | None) -> Linearisation:
        """Reluctivities at psi (n_dofs,)."""
        gradient, B = self.elements.flux(psi)
        H, slope = self.richer.H_of_B(B, powder)
        here = B > 0.0
        nu = np.where(here, H / np.where(here, B, 1.0), slope)
        return Linearisation(gradient, B, nu, slope)

    def tangent(self, at: Linearisation) -> sp.csc_matrix:
        """Matrix of the form a on the free unknowns."""
        exterior = self.richer.exterior
        clique, dense = (None, None) if exterior is None else (exterior.dofs, exterior.matrix)
        pattern = FixedPattern(self.elements.element_dofs, self.free, self.elements.n_dofs, clique=clique)
        return pattern.assemble(self.elements.field_tangent(at.gradient, at.B, at.nu, at.slope), dense)

    def element_energy(self, at: Linearisation, psi: np.ndarray) -> np.ndarray:
        """a(psi, psi) over each element, shape (n_elements,)."""
        gradient, _ = self.elements.flux(psi)
        length = at.B * self.elements.radius
        along = (gradient * at.gradient).sum(axis=1) / np.where(length > 0.0, length, 1.0)
        density = at.nu * (gradient**2).sum(axis=1) + (at.slope - at.nu) * along**2
        return (density / self.elements.radius * self.elements.weight).sum(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Materials at a field, at the quadrature points.

    Attributes
    ----------
    gradient : ndarray (n_elements, 2, n_quadrature)
        grad psi [Wb/(rad m)].
    B, nu, slope : ndarray (n_elements, n_quadrature)
        |B| [T], H/B and dH/dB [m/H].
    """

    gradient: np.ndarray
    B: np.ndarray
    nu: np.ndarray
    slope: np.ndarray


def next_order_field(field: MagneticField) -> MagneticField:
    """The field of elements of the next order on the same mesh, to a thousandth of what the two differ by.

    Raises
    ------
    ValueError
        Elements of the highest order, or steel with hysteresis: another space has another history.
    ConvergenceError
    """
    space = EnrichedSpace(field.problem)
    return space.solve(field, field.boundary_field)


def estimate_error(field: MagneticField, goals: Sequence[Goal], *, boundary_field: float = 0.0) -> ErrorEstimate:
    """Estimate the discretisation error of goals of a solved field.

    Parameters
    ----------
    field : MagneticField
    goals : sequence of Goal
        At least one, none of them zero in this field.
    boundary_field : float
        As the field was solved with [T].

    Raises
    ------
    ValueError
        No goal, or one whose value is zero: it has no relative error; elements of the highest order.
    ConvergenceError
        The solve of the next order failed.
    """
    if not goals:
        raise ValueError("no goal to estimate the error of; give FluxLinkage(), MeanFluxDensity(region) or both")
    space = EnrichedSpace(field.problem)
    start = space.embedding @ field.psi
    for goal in goals:
        if goal.value(space, start) == 0.0:
            raise ValueError(f"{goal.name} is zero in this field: it has no relative error; drop the goal")
    psi = space.solve(field, boundary_field).psi
    at = space.linearise(psi, space.powder_of(field))
    slopes = np.column_stack([goal.slope(space, psi) for goal in goals])[space.free]
    matrix = space.tangent(at)
    embedding = space.embedding[space.free][:, _free(field.problem)]
    coarse = (embedding.T @ matrix @ embedding).tocsc()
    coarse.sort_indices()
    adjoint = np.zeros((space.elements.n_dofs, len(goals)))
    adjoint[space.free] = SymmetricSolver().solve(matrix, slopes)
    adjoint[space.free] -= embedding @ SymmetricSolver().solve(coarse, embedding.T @ slopes)

    order = field.problem.elements.order
    missed = 1.0 - (order / (order + 1.0)) ** _CORNER
    primal = space.element_energy(at, psi - start)
    errors, indicators = [], np.zeros((len(goals), len(primal)))
    for i, goal in enumerate(goals):
        contribution = np.sqrt(primal * space.element_energy(at, adjoint[:, i]))
        value = goal.value(space, psi)
        error = max(abs(value - goal.value(space, start)), _CANCELLING * float(contribution.sum())) / missed
        indicators[i] = contribution * (error / abs(value) / contribution.sum() if contribution.any() else 0.0)
        errors.append(GoalError(goal.name, value, error / abs(value)))
    return ErrorEstimate(tuple(errors), indicators)


def _free(problem: AxisymmetricProblem) -> np.ndarray:
    fixed = problem.elements.axis_dofs()
    if problem.exterior is None:
        fixed = np.union1d(fixed, problem.elements.boundary_dofs("outer"))
    return np.setdiff1d(np.arange(problem.n_dofs), fixed)
