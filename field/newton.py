"""Newton's method on a convex energy: Armijo line search, symmetric linear systems, an honest end.

The nonlinear field equation is the minimum of W(psi) = integral of w(|B|) - J psi over the section.
H(B) grows, so W is strictly convex: the tangent is symmetric positive definite, its step points downhill,
and with W as the merit function the iteration converges from any start (Dennis and Schnabel 1983, ch. 6).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from field.factorisation import NotPositiveDefinite

# Sufficient decrease of the line search; the textbook's value (Dennis and Schnabel).
_ARMIJO = 1e-4
_MAX_HALVINGS = 30
_MAX_FALSE_POSITIONS = 8
# Of the residual: what a step with an old factor, a fifth of the price of a new one, may leave.
_SECANT_FRACTION = 0.2


def scalar_product(a: np.ndarray, b: np.ndarray) -> float:
    """Sum of a b in an order that does not depend on the number of threads, as that of BLAS' dot does."""
    return float((a * b).sum())


def norm(a: np.ndarray) -> float:
    """Euclidean norm, see `scalar_product`."""
    return math.sqrt(scalar_product(a, a))


class ConvergenceError(RuntimeError):
    """The nonlinear field solve did not reach its tolerance.

    Attributes
    ----------
    history : list of (relative residual, step length)
    remedy : str
    """

    def __init__(self, history: list[tuple[float, float]], remedy: str, message: str | None = None) -> None:
        """``message`` is the whole text of an iteration that is not Newton's; None: that of the field's solve."""
        last = history[-1][0] if history else float("nan")
        super().__init__(
            message
            or f"the field did not converge: relative residual {last:.2e} after "
            f"{max(len(history) - 1, 0)} Newton steps; {remedy}"
        )
        self.history = history
        self.remedy = remedy


class LinearSolver(Protocol):
    """Solves with symmetric positive definite matrices of one sparsity pattern, one after the other."""

    @property
    def again_is_cheap(self) -> bool:
        """True if `solve_again` costs little compared with `solve`: a factor does that, iterations do not."""

    def solve(self, matrix: sp.csc_matrix, right: np.ndarray) -> np.ndarray:
        """Solve with a new matrix."""

    def solve_again(self, right: np.ndarray) -> np.ndarray:
        """Solve with the matrix of the last `solve`."""


class Energy(Protocol):
    """A convex functional of the free unknowns.

    A method `chord_hessian(x)` is used where there is one, after a step that had to be cut: a matrix that is
    stiffer than the tangent where the material gets softer with the step (the toe of a magnetisation curve).
    """

    def value(self, x: np.ndarray) -> tuple[float, float]:
        """W(x) and the magnitude of the terms that it is the difference of."""

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """dW/dx, the residual."""

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        """Second derivative at x, where `gradient` was called last."""


def _secant_steps(
    energy: Energy, x: np.ndarray, residual: np.ndarray, solver: LinearSolver, goal: float
) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Steps with the matrix that was factorised last, corrected by what each step taught of the curvature (BFGS).

    They continue while each leaves at most a fifth of the residual: such a step costs that fraction of a Newton step.

    Source: Matthies and Strang, Int. J. Numer. Methods Eng. 14, 1979; Nocedal and Wright, 2006, algorithm 7.4.

    Returns
    -------
    x, residual : ndarray (n,)
        The last point that a step led to, and its gradient.
    sizes : list of float
        Norms of the gradient after each step that counted.
    """
    pairs: list[tuple[np.ndarray, np.ndarray, float]] = []
    size, sizes = norm(residual), []
    while size > goal:
        right, along = -residual, []
        for step, change, scale in reversed(pairs):
            along.append(scalar_product(step, right) / scale)
            right = right - along[-1] * change
        step = solver.solve_again(right)
        for (before, change, scale), fraction in zip(pairs, reversed(along), strict=True):
            step = step + (fraction - scalar_product(change, step) / scale) * before
        trial = x + step
        new = energy.gradient(trial)
        new_size = norm(new)
        change, scale = new - residual, scalar_product(step, new - residual)
        if not (new_size <= _SECANT_FRACTION * size and scale > 0.0):
            break
        pairs.append((step, change, scale))
        x, residual, size = trial, new, new_size
        sizes.append(size)
    return x, residual, sizes


def _length_to_level(energy: Energy, x: np.ndarray, step: np.ndarray, slope: float, fraction: float) -> float:
    """Length, at most 1, at which the slope along a step is level to within a fraction of that at its beginning.

    Regula falsi, kept away from the ends; the energy is convex along the step.
    """

    def slope_at(length: float) -> float:
        return scalar_product(energy.gradient(x + length * step), step)

    low, high, slope_low, slope_high = 0.0, 1.0, slope, slope_at(1.0)
    length, here = high, slope_high
    for _ in range(_MAX_FALSE_POSITIONS):
        if here <= -fraction * slope and (length == 1.0 or here >= fraction * slope):
            break
        if here > 0.0:
            high, slope_high = length, here
        else:
            low, slope_low = length, here
        wide = high - low
        length = low - slope_low * wide / (slope_high - slope_low)
        length = min(max(length, low + 0.1 * wide), high - 0.1 * wide)
        here = slope_at(length)
    return length


def minimise(
    energy: Energy,
    x: np.ndarray,
    scale: float,
    *,
    solver: LinearSolver,
    tolerance: float,
    max_iterations: int,
    first_matrix: Callable[[], sp.csc_matrix] | None = None,
    factorised: bool = False,
    level: float | None = None,
) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Newton with an Armijo line search on the energy.

    Where a step has brought the residual down well, secant steps with its factor follow for as long as they do too, if
    the solver's second solve is cheap.

    Parameters
    ----------
    energy : Energy
    x : ndarray (n,)
        Start.
    scale : float
        Norm of the driving term; the residual is relative to it.
    tolerance : float
        Relative residual at which the iteration stops.
    first_matrix : callable or None
        Replaces the tangent in the first step (any symmetric positive definite matrix will do): a cold
        start at psi = 0 would take the steel for as soft as it is at B = 0 and overshoot far.
    factorised : bool
        Whether `solver` holds the factor of a matrix near the tangent at the start.
    level : float or None
        Shorten a step until the slope along it is within this fraction of that at its beginning: where a gradient costs
        little compared with a linear solve. None: halve it only until the energy falls.

    Returns
    -------
    x : ndarray (n,)
    history : list of (relative residual, length of the step that led to it)

    Raises
    ------
    ConvergenceError
        Tolerance not reached, or no downhill step found.
    """
    residual = energy.gradient(x)
    history = [(norm(residual) / scale, 0.0)]
    value, magnitude = energy.value(x)
    for iteration in range(max_iterations):
        if history[-1][0] <= tolerance:
            return x, history
        if factorised:
            x, residual, sizes = _secant_steps(energy, x, residual, solver, tolerance * scale)
            history += [(size / scale, 1.0) for size in sizes]
            if history[-1][0] <= tolerance:
                return x, history
            residual = energy.gradient(x)
            value, magnitude = energy.value(x)
        use_first = iteration == 0 and first_matrix is not None
        if use_first and first_matrix is not None:
            matrix = first_matrix()
        elif iteration > 0 and history[-1][1] < 1.0:
            matrix = getattr(energy, "chord_hessian", energy.hessian)(x)
        else:
            matrix = energy.hessian(x)
        try:
            step = solver.solve(matrix, -residual)
            slope = scalar_product(residual, step)
        except NotPositiveDefinite:
            slope = math.nan
        if not np.isfinite(slope) or slope >= 0.0:
            raise ConvergenceError(
                history,
                "the tangent is not positive definite: H of one of the materials "
                "does not grow with B, or an element of the mesh is degenerate",
            )
        length = 1.0 if level is None else _length_to_level(energy, x, step, slope, level)
        for _ in range(_MAX_HALVINGS):
            trial = x + length * step
            new_value, magnitude = energy.value(trial)
            # near the minimum W is the same to round-off: a full step is then right
            if new_value <= value + _ARMIJO * length * slope + 1e-13 * magnitude:
                break
            length *= 0.5
        else:
            raise ConvergenceError(
                history,
                "no step along the Newton direction lowers the energy; the "
                "tolerance is below what round-off allows, raise it",
            )
        x, value = trial, new_value
        residual = energy.gradient(x)
        history.append((norm(residual) / scale, length))
        well = length == 1.0 and history[-1][0] <= _SECANT_FRACTION * history[-2][0]
        factorised = well and not use_first and solver.again_is_cheap
    if history[-1][0] <= tolerance:
        return x, history
    raise ConvergenceError(
        history,
        "raise `max_iterations`, start from the field of a lower current, or check the magnetisation curves for jumps",
    )
