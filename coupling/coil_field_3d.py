"""The coil's field in 3D, of a device with slots or teeth in one of its bodies.

The slotted body is the only part that is not a body of revolution: seen from it, the field stands still while the
rest turns.  So one solve per current is enough; grains sample it in the frame that turns with that body.  The torque
that this field exerts on the grains has its reaction on the slotted body alone, because an isotropic body of
revolution without hysteresis takes no torque about its axis: it is booked there, and drives a free shaft.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from coupling.coil_row import CoilRow
from field import FieldSampler
from field.three_d import Field3D, Problem3D
from geometry.time_profile import TimeProfile
from particles import Body


@dataclass(frozen=True, slots=True)
class TurningSampler:
    """A field that turns with a body.

    Parameters
    ----------
    sampler : FieldSampler
        The field in the body's frame, whose angle is 0 at the start.
    carrier : Body
        The body; its present angle is taken at every call.
    """

    sampler: FieldSampler
    carrier: Body

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`."""
        cos, sin = np.cos(self.carrier.angle), np.sin(self.carrier.angle)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        H, grad = self.sampler.sample(np.asarray(position, dtype=float) @ turn)
        return H @ turn.T, turn @ grad @ turn.T


@dataclass(slots=True)
class CoilField3D:
    """The coil's field in 3D, solved again when the current has moved beyond its tolerance.

    Attributes
    ----------
    problem : Problem3D
    turns : float
    currents : TimeProfile
        [A].
    carrier : Body
        The slotted body.
    newton_tolerance, current_tolerance : float
        As in `SolvedCoilField`.
    known : Field3D or None
        A field of this problem that was solved for from nothing, to the same tolerance: it is not solved for again
        where the first current is its own.
    """

    problem: Problem3D
    turns: float
    currents: TimeProfile
    carrier: Body
    newton_tolerance: float = 1e-8
    current_tolerance: float = 0.01
    known: Field3D | None = None
    feedback: ClassVar[None] = None
    solution: Field3D | None = None
    sampler: FieldSampler | None = None
    solved_current: float = np.nan
    largest_current: float = 0.0
    solves: int = 0
    seconds: float = 0.0

    def refresh(self, time: float) -> bool:
        """Solve if needed for the current at `time` [s]; True when the field is new. Raises ConvergenceError."""
        current = self.currents(time)
        self.largest_current = max(self.largest_current, abs(current))
        moved = abs(current - self.solved_current) > self.current_tolerance * self.largest_current
        if self.solution is not None and not moved and (current == 0.0) == (self.solved_current == 0.0):
            return False
        begin = perf_counter()
        guess = self.solution if self.solution is not None and self.solved_current != 0.0 else None
        self._take(self._solved(self.turns * current, guess), current)
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

    def _solved(self, ampere_turns: float, guess: Field3D | None) -> Field3D:
        if guess is None and self.known is not None and self.known.ampere_turns == ampere_turns:
            return self.known
        return self.problem.solve(ampere_turns, guess, tolerance=self.newton_tolerance)

    def _take(self, solution: Field3D, current: float) -> None:
        self.solution, self.solved_current = solution, current
        self.sampler = TurningSampler(solution.sampler("powder"), self.carrier)

    def window_part(self, time: float) -> CoilRow:
        """Row of the coil for a window that ends at `time` [s]."""
        return CoilRow(self.currents(time))

    def state(self) -> dict[str, Any] | None:
        """State for a bit-exact continuation; None before the first solve."""
        if self.solution is None:
            return None
        return {
            "phi": self.solution.phi,
            "ampere_turns": self.solution.ampere_turns,
            "newton": [list(map(float, x)) for x in self.solution.newton],
            "current": self.solved_current,
            "largest_current": self.largest_current,
            "solves": self.solves,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up the state of a checkpoint."""
        history = [tuple(x) for x in saved["newton"]]
        self._take(Field3D(self.problem, saved["phi"], saved["ampere_turns"], history), saved["current"])
        self.largest_current, self.solves = saved["largest_current"], saved["solves"]
