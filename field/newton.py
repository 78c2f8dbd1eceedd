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

    def solve(self, matrix: sp.csc_matrix, right: np.ndarray) -> np.ndarray:
        """Solve with a new matrix."""

    def solve_again(self, right: np.ndarray) -> np.ndarray:
        """Solve with the matrix of the last `solve`."""


class Energy(Protocol):
    """A convex functional of the free unknowns.

    A method `cautious_hessian(x)` is taken where there is one, after a step that had to be cut: a matrix that is
    stiffer than the tangent where the material gets softer with the step (the toe of a magnetisation curve).
    """

    def value(self, x: np.ndarray) -> tuple[float, float]:
        """W(x) and the magnitude of the terms that it is the difference of."""

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """dW/dx, the residual."""

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        """Second derivative at x, where `gradient` was called last."""


def _chord_will_do(history: list[tuple[float, float]], tolerance: float) -> bool:
    """Whether a step with the tangent of the iterate before is likely to reach the tolerance.

    A quadratic iteration divides the residual by 1/(C r); one with the tangent of the iterate before contracts
    by about the same factor as the step that has just been made.
    """
    before, (last, length) = history[-2][0], history[-1]
    return length == 1.0 and last * last / before <= 0.3 * tolerance


def _length_to_level(energy: Energy, x: np.ndarray, step: np.ndarray, slope: float, share: float) -> float:
    """Length, at most 1, at which the slope along a step is level to within a share of that at its beginning.

    Regula falsi, kept away from the ends; the energy is convex along the step.
    """

    def slope_at(length: float) -> float:
        return scalar_product(energy.gradient(x + length * step), step)

    low, high, slope_low, slope_high = 0.0, 1.0, slope, slope_at(1.0)
    length, found = high, slope_high
    for _ in range(_MAX_FALSE_POSITIONS):
        if found <= -share * slope and (length == 1.0 or found >= share * slope):
            break
        if found > 0.0:
            high, slope_high = length, found
        else:
            low, slope_low = length, found
        wide = high - low
        length = low - slope_low * wide / (slope_high - slope_low)
        length = min(max(length, low + 0.1 * wide), high - 0.1 * wide)
        found = slope_at(length)
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
    level: float | None = None,
) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Newton with an Armijo line search on the energy.

    The last step may be one with the factor of the iterate before (a chord step), where that is expected to do.

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
    level : float or None
        Shorten a step until the slope along it is within this share of that at its beginning: where a gradient costs
        little beside a linear solve. None: halve it only until the energy falls.

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
        if iteration > 1 and _chord_will_do(history, tolerance):
            # The old factor costs a tenth of a new one, and here its step is expected to be the last.
            trial = x + solver.solve_again(-residual)
            trial_residual = energy.gradient(trial)
            if norm(trial_residual) / scale <= tolerance:
                return trial, [*history, (norm(trial_residual) / scale, 1.0)]
            residual = energy.gradient(x)
        use_first = iteration == 0 and first_matrix is not None
        if use_first and first_matrix is not None:
            matrix = first_matrix()
        elif iteration > 0 and history[-1][1] < 1.0:
            matrix = getattr(energy, "cautious_hessian", energy.hessian)(x)
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
    if history[-1][0] <= tolerance:
        return x, history
    raise ConvergenceError(
        history,
        "raise `max_iterations`, start from the field of a lower current, or check the magnetisation curves for jumps",
    )
