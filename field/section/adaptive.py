"""Adaptivity to a tolerance: solve, estimate, mark, refine, start from the last field, until it is good enough.

Marked is the smallest set of elements that carries a fraction `marking` of the errors of all goals that are not
yet within the tolerance (Doerfler, SIAM J. Numer. Anal. 33, 1996).  At a corner of steel that grades the mesh so
that the errors fall with the number of unknowns n as if there were no corner: n^-p for the flux linkage.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from field.section.axisymmetric import AxisymmetricProblem
from field.section.error_estimate import ErrorEstimate, FluxLinkage, Goal, GoalError, estimate_error
from field.section.interpolation import interpolation
from field.section.magnetic_field import MagneticField
from geometry.refinement import refine
from geometry.section import SectionMesh

# Every round refines where the error is, so an estimate that has not come down by then never will.
_MAX_ROUNDS = 60
# Of the error that elements at a corner of steel carry, psi ~ d^(2/3), halving them takes 1 - 2^(-4/3) away.
_GAIN = 0.6
_MIN_MARKING = 0.1


@dataclass(frozen=True, slots=True)
class AdaptiveStep:
    """One round.

    Attributes
    ----------
    dofs, elements : int
    goals : tuple of GoalError
    newton_iterations : int
    seconds : float
        Of solve and estimate.
    """

    dofs: int
    elements: int
    goals: tuple[GoalError, ...]
    newton_iterations: int
    seconds: float

    @property
    def worst(self) -> float:
        """Largest estimated relative error of all goals."""
        return max((goal.relative for goal in self.goals), default=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class AdaptiveResult:
    """Result of `adapt`.

    Attributes
    ----------
    problem : AxisymmetricProblem
        On the final mesh, to be solved for other currents and fills.
    field : MagneticField
    estimate : ErrorEstimate or None
        None without a field, that is without current.
    history : tuple of AdaptiveStep
        The coarsest first.
    tolerance : float
    converged : bool
        Whether every estimated error is within the tolerance; if not, one more refinement would have taken
        more than `max_dofs` unknowns, or the rounds ran out.
    """

    problem: AxisymmetricProblem
    field: MagneticField
    estimate: ErrorEstimate | None
    history: tuple[AdaptiveStep, ...]
    tolerance: float
    converged: bool

    @property
    def mesh(self) -> SectionMesh:
        """The final mesh."""
        return self.problem.mesh

    def summary(self) -> str:
        """One line on how it ended."""
        last = self.history[-1]
        errors = ", ".join(f"{goal.goal} {goal.relative:.1e}" for goal in last.goals) or "no field"
        end = "within" if self.converged else "NOT within"
        remedy = "" if self.converged else "; raise `max_dofs`, the tolerance or the order"
        return (
            f"{last.dofs} unknowns after {len(self.history)} rounds, estimated relative error: {errors}: "
            f"{end} {self.tolerance:g}{remedy}"
        )


def adapt(
    make_problem: Callable[[SectionMesh], AxisymmetricProblem],
    mesh: SectionMesh,
    ampere_turns: float,
    *,
    goals: Sequence[Goal] = (FluxLinkage(),),
    tolerance: float = 1e-3,
    max_dofs: int = 100_000,
    fill: Callable[[SectionMesh], np.ndarray] | None = None,
    boundary_field: float = 0.0,
    marking: float = 0.5,
    newton_tolerance: float = 1e-8,
) -> AdaptiveResult:
    """Refine a mesh until the goals' estimated relative errors are within a tolerance.

    A device that is solved many times adapts once, at its largest current and with its powder spread evenly, and
    keeps the mesh: where the steel's corners are does not change.

    Parameters
    ----------
    make_problem : callable
        Materials on a mesh, e.g. ``lambda mesh: AxisymmetricProblem(mesh, laws, open_boundary=True)``.
    mesh : SectionMesh
        The coarsest.
    ampere_turns : float
        [A]
    goals : sequence of Goal
    tolerance : float
        Relative, above 0.
    max_dofs : int
        No refined mesh with more unknowns is solved; the result is then not `converged`.
    fill : callable or None
        Solid fraction of the powder's elements of a mesh (n powder elements,); None: no powder.
    boundary_field : float
        As for `AxisymmetricProblem.solve` [T].
    marking : float
        Largest fraction of the error that the refined elements carry, in (0, 1]; small: more rounds, fewer unknowns.
    newton_tolerance : float
        Relative residual of each solve; well below `tolerance`.

    Raises
    ------
    ValueError
        A tolerance or marking out of range, a goal that is zero in this field.
    ConvergenceError
        A solve failed.
    """
    if not tolerance > 0.0:
        raise ValueError(f"`tolerance` = {tolerance:g} must be above 0; 1e-3 is a good start")
    if not 0.0 < marking <= 1.0:
        raise ValueError(f"`marking` = {marking:g} must be above 0 and at most 1; 0.5 is the default")
    problem, guess = make_problem(mesh), None
    history: list[AdaptiveStep] = []
    while True:
        start = time.perf_counter()
        field = problem.solve(
            ampere_turns,
            None if fill is None else fill(problem.mesh),
            guess,
            tolerance=newton_tolerance,
            boundary_field=boundary_field,
        )
        without_field = ampere_turns == 0.0 and boundary_field == 0.0
        estimate = None if without_field else estimate_error(field, goals, boundary_field=boundary_field)
        errors = () if estimate is None else estimate.goals
        spent = time.perf_counter() - start
        history.append(AdaptiveStep(problem.n_dofs, len(problem.mesh.triangles), errors, len(field.newton) - 1, spent))
        converged = history[-1].worst <= tolerance
        if converged or estimate is None or len(history) == _MAX_ROUNDS:
            break
        missing = np.array([goal.relative > tolerance for goal in estimate.goals])
        # near the tolerance no more than what is still needed
        needed = (1.0 - tolerance / history[-1].worst) / _GAIN
        fraction = min(marking, max(needed, _MIN_MARKING))
        refined = refine(problem.mesh, mark(estimate.indicators[missing].sum(axis=0), fraction))
        finer = make_problem(refined.mesh)
        if finer.n_dofs > max_dofs:
            break
        guess = interpolation(problem.elements, finer.elements, refined.parent) @ field.psi
        problem = finer
    return AdaptiveResult(problem, field, estimate, tuple(history), tolerance, converged)


def mark(indicators: np.ndarray, fraction: float) -> np.ndarray:
    """The fewest elements whose indicators (n_elements,) >= 0 add up to a fraction of all, the largest first."""
    order = np.argsort(-indicators, kind="stable")
    summed = np.cumsum(indicators[order])
    return order[: int(np.searchsorted(summed, fraction * summed[-1] * (1.0 - 1e-12))) + 1]
