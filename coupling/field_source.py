"""Where H comes from: a coil's finite-element field that follows current and fill, or an imposed field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from field import AxisymmetricProblem, FieldSampler, MagneticField


@dataclass(slots=True)
class ImposedField:
    """A field that nothing in the scene changes; `sampler` has sample(position) -> H, grad H."""

    sampler: FieldSampler

    def refresh(self, time: float, fill: np.ndarray | None = None) -> bool:
        """Nothing to solve."""
        return False


@dataclass(slots=True)
class CoilField:
    """The coil's field, solved again when current or fill have moved beyond their tolerances.

    Attributes
    ----------
    problem : AxisymmetricProblem
    turns : float
    current : callable t [s] -> I [A]
    current_tolerance : float
        Change of the current, relative to the largest so far, that calls for a new solve.
    fill_tolerance : float
        Change of the fill, sqrt(sum V (phi - phi_0)^2/sum V phi_0^2), that calls for a new solve.
    element_volume : (e,) float64 or None
        V of the powder's elements [m^3], needed when fills are given.
    """

    problem: AxisymmetricProblem
    turns: float
    current: Callable[[float], float]
    newton_tolerance: float = 1e-8
    current_tolerance: float = 0.01
    fill_tolerance: float = 0.05
    element_volume: np.ndarray | None = None
    solution: MagneticField | None = None
    sampler: FieldSampler | None = None
    fill: np.ndarray | None = None
    solved_current: float = np.nan
    largest_current: float = 0.0
    fill_change: float = 0.0
    solves: int = 0
    seconds: float = 0.0

    def refresh(self, time: float, fill: np.ndarray | None = None) -> bool:
        """Solve if needed for the current at `time` [s] and the solid fraction (e,) of the powder's elements.

        Returns True when the field is new. Raises field.ConvergenceError when Newton fails.
        """
        current = self.current(time)
        self.largest_current = max(self.largest_current, abs(current))
        stale = self.solution is None
        if not stale and abs(current - self.solved_current) > self.current_tolerance * self.largest_current:
            stale = True
        if not stale and (current == 0.0) != (self.solved_current == 0.0):
            stale = True  # switched off is exactly off
        self.fill_change = 0.0
        if fill is not None and self.fill is not None:
            volume = self.element_volume
            change = (volume * (fill - self.fill) ** 2).sum() / max((volume * self.fill**2).sum(), 1e-300)
            self.fill_change = float(np.sqrt(change))
            # without current there is no field that the fill could change
            if current != 0.0 and self.fill_change > self.fill_tolerance:
                stale = True
        if not stale:
            return False
        begin = perf_counter()
        guess = self.solution if self.solution is not None and self.solved_current != 0.0 else None
        self.set_solution(
            self.problem.solve(self.turns * current, fill=fill, guess=guess, tolerance=self.newton_tolerance),
            current,
            fill,
        )
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

    def set_solution(self, solution: MagneticField, current: float, fill: np.ndarray | None) -> None:
        """Take a solution (a fresh one, or the one of a checkpoint) as the present field."""
        self.solution, self.solved_current, self.fill = solution, current, fill
        self.sampler = solution.sampler("powder")
