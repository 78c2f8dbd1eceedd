"""Fields along a sweep of the coil's current: each point starts from the secant through the two before it.

psi(I) is smooth, so the predictor's error is of second order in the step of the current; what remains takes
Newton two or three steps a point instead of the eight or nine of a cold start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from field.section.axisymmetric import AxisymmetricProblem
from field.section.magnetic_field import MagneticField
from field.section.steel_history import SteelHistory


def predict(ampere_turns: float, earlier: Sequence[MagneticField]) -> np.ndarray | None:
    """psi (n_dofs,) [Wb/rad] at this current from fields that were solved before, the latest last.

    The secant through the last two with different currents; with one field alone that field in proportion to
    the current; None (a cold start) with no field that carries a current.
    """
    solved = [field for field in earlier if field.ampere_turns != 0.0]
    if not solved:
        return None
    last = solved[-1]
    for before in reversed(earlier[:-1]):
        step = last.ampere_turns - before.ampere_turns
        # beyond five steps of the last difference a secant says less than the last field itself
        if step != 0.0 and abs(ampere_turns - last.ampere_turns) <= 5.0 * abs(step):
            return last.psi + (last.psi - before.psi) * ((ampere_turns - last.ampere_turns) / step)
    return last.psi * (ampere_turns / last.ampere_turns)


def sweep_currents(
    problem: AxisymmetricProblem,
    ampere_turns: Sequence[float] | np.ndarray,
    fill: np.ndarray | None = None,
    *,
    tolerance: float = 1e-8,
    history: SteelHistory | None = None,
) -> Iterator[MagneticField]:
    """Solve for one current after the other, up, down or through zero.

    Parameters
    ----------
    problem : AxisymmetricProblem
    ampere_turns : sequence of float
        N I [A].
    fill : ndarray (n powder elements,) or None
        Solid fraction of the powder.
    tolerance : float
        Residual relative to the drive, of every point.
    history : SteelHistory or None
        Of the steel before the first point; each point begins with that of the one before. None: no hysteresis.

    Raises
    ------
    ConvergenceError
        From the first point that does not converge.
    """
    earlier: list[MagneticField] = []
    for value in ampere_turns:
        guess = predict(float(value), earlier)
        field = problem.solve(float(value), fill, guess=guess, tolerance=tolerance, history=history)
        history = field.later_history
        yield field
        earlier = [*earlier[-1:], field]
