"""Sources of H: a coil's finite-element field that follows current and grains, or an imposed field.

Of the coil's field there are three, by what its current follows from: a course in time (`CoilField`), the circuit of
a voltage and the nonlinear flux linkage (`coupling.circuit_coil_field`), and the diffusion of the field into solid
conductors (`coupling.eddy_coil_field`, at a current or at a voltage). The first two may be solved in 3D.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from coupling.coil_row import CoilRow
from coupling.powder_feedback import PowderFeedback
from coupling.turning_sampler import TurningSampler
from field import FieldSampler, MagneticField, PowderState, field_sampler
from field.three_d import Field3D, Problem3D
from geometry.time_profile import TimeProfile
from particles import Body


@dataclass(slots=True)
class ImposedField:
    """A field that nothing in the scene changes; `sampler` has sample(position) -> H, grad H."""

    sampler: FieldSampler
    solution: ClassVar[None] = None
    solves: ClassVar[int] = 0
    carrier: ClassVar[None] = None
    feedback: ClassVar[None] = None

    def refresh(self, time: float) -> bool:
        """Nothing to solve."""
        return False

    def window_part(self) -> None:
        """Return nothing: there is no coil."""

    def state(self) -> dict[str, Any] | None:
        """Nothing to keep."""
        return None

    def restore(self, saved: dict[str, Any]) -> None:
        """Nothing was kept."""


@dataclass
class SolvedCoilField(ABC):
    """A coil's field, solved again when current or grains have moved beyond their tolerances.

    Attributes
    ----------
    problem : AxisymmetricProblem or Problem3D
        Of whose solutions, MagneticField or Field3D, `solution` is the present one.
    turns : float
    carrier : Body or None
        The slotted body, in whose frame a field in 3D stands still; None: the field is one of revolution.
    current_tolerance : float
        Change of the current, relative to the largest so far, that calls for a new solve.
    powder_tolerance : float
        `powder_change` that calls for a new solve.
    feedback : PowderFeedback or None
        Gives the moments of the grains to the field (effect `back_reaction`); None: the field does not see the grains.
    powder_change : float
        How far the moments have left those that the present field was solved with (`PowderFeedback.residual`).
    """

    problem: Any
    turns: float
    carrier: Body | None = field(default=None, kw_only=True)
    newton_tolerance: float = field(default=1e-8, kw_only=True)
    current_tolerance: float = field(default=0.01, kw_only=True)
    powder_tolerance: float = field(default=0.05, kw_only=True)
    feedback: PowderFeedback | None = field(default=None, kw_only=True)
    largest_current: float = field(default=0.0, kw_only=True)
    solution: Any = field(default=None, init=False)
    sampler: FieldSampler | None = field(default=None, init=False)
    solved_current: float = field(default=np.nan, init=False)
    powder_change: float = field(default=0.0, init=False)
    solves: int = field(default=0, init=False)
    seconds: float = field(default=0.0, init=False)
    _measured: tuple[Any, float, float] | None = field(default=None, init=False)

    @abstractmethod
    def current(self, time: float) -> float:
        """Return the current [A] at `time` [s]."""

    @abstractmethod
    def refresh(self, time: float) -> bool:
        """Solve if needed for the current at `time` [s] and the moments of the grains, where they are fed back.

        Returns True when the field is new. Raises field.ConvergenceError when Newton fails.
        """

    def is_stale(self, current: float) -> bool:
        """True if a current [A] or the grains call for a new solve; notes the largest current and the change."""
        self.largest_current = max(self.largest_current, abs(current))
        stale = self.solution is None
        if not stale and abs(current - self.solved_current) > self.current_tolerance * self.largest_current:
            stale = True
        if not stale and (current == 0.0) != (self.solved_current == 0.0):
            stale = True  # switched off is exactly off
        self.powder_change = 0.0
        if self.feedback is not None and self.solution is not None:
            self.powder_change = self.feedback.residual.total
            stale = stale or (self.has_field(current) and self.powder_change > self.powder_tolerance)
        return stale

    def has_field(self, current: float) -> bool:
        """True if there may be a field at a current [A]: without hysteresis there is none at 0 A."""
        return current != 0.0

    def set_solution(self, solution: Any, current: float) -> None:
        """Take a solution (a fresh one, or the one of a checkpoint) as the present field."""
        self.solution, self.solved_current = solution, current
        if self.feedback is not None:
            self.sampler = self.feedback.sampler_after_solve(solution)
        elif isinstance(solution, Field3D):
            assert self.carrier is not None  # of every field in 3D
            self.sampler = TurningSampler(solution.sampler("powder"), self.carrier)
        else:
            self.sampler = field_sampler(solution, "powder")

    def _powder(self, current: float) -> PowderState | None:
        """State of the powder for the next solve."""
        if self.feedback is None:
            return None
        return self.feedback.state(self.solution if self.has_field(current) else None)

    def window_part(self) -> CoilRow:
        """Row of the coil for the window that ends with the last `refresh`: the present field and its own current."""
        return CoilRow(self.solved_current, *self.linkage_and_energy())

    def linkage_and_energy(self) -> tuple[float, float]:
        """Flux linkage [Wb] and energy [J] of the present field, computed once for each solution."""
        if self._measured is None or self._measured[0] is not self.solution:
            self._measured = (self.solution, self.turns * self.solution.flux_linkage_per_turn, self.solution.energy)
        return self._measured[1:]

    def state(self) -> dict[str, Any] | None:
        """State for a bit-exact continuation; None before the first solve."""
        if self.solution is None:
            return None
        saved = {
            **_potential(self.solution),
            "ampere_turns": self.solution.ampere_turns,
            "newton": [list(map(float, x)) for x in self.solution.newton],
            "current": self.solved_current,
            "largest_current": self.largest_current,
            "solves": self.solves,
        }
        if self.feedback is not None:
            powder = self.solution.powder
            assert powder is not None  # of the feedback
            saved |= {"fill": powder.fill, "factor": powder.factor, "source": powder.source}
            saved["feedback"] = self.feedback.checkpoint()
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up the state of a checkpoint."""
        powder = None
        if self.feedback is not None:
            powder = PowderState(saved["fill"], saved["factor"], saved["source"])
        rest = saved["ampere_turns"], powder, [tuple(x) for x in saved["newton"]]
        solution: Any
        if isinstance(self.problem, Problem3D):
            solution = Field3D(self.problem, saved["phi"], *rest)
        else:
            solution = MagneticField(self.problem, saved["psi"], *rest)
        if self.feedback is None:
            self.set_solution(solution, saved["current"])
        else:
            self.solution, self.solved_current = solution, saved["current"]
            self.feedback.restore(saved["feedback"])
            self.sampler = self.feedback.sampler(solution)
        self.largest_current, self.solves = saved["largest_current"], saved["solves"]


def _potential(solution: MagneticField | Field3D) -> dict[str, np.ndarray]:
    return {"phi": solution.phi} if isinstance(solution, Field3D) else {"psi": solution.psi}


@dataclass
class CoilField(SolvedCoilField):
    """The field of a coil with a given current; one that changes no more is solved for exactly.

    Attributes
    ----------
    currents : TimeProfile
        [A].
    known : Field3D or None
        A field of this problem that was solved for from nothing, to the same tolerance: it is not solved for again
        where the first current is its own.
    """

    currents: TimeProfile
    known: Field3D | None = field(default=None, kw_only=True)

    def current(self, time: float) -> float:
        """See `SolvedCoilField.current`."""
        return self.currents(time)

    def refresh(self, time: float) -> bool:
        """See `SolvedCoilField.refresh`."""
        current = self.current(time)
        settled = current != self.solved_current and self.currents.is_constant_after(time)
        if not self.is_stale(current) and not settled:
            return False
        begin = perf_counter()
        guess = self.solution if self.solution is not None and self.has_field(self.solved_current) else None
        self.set_solution(self._solved(current, self._powder(current), guess), current)
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

    def _solved(self, current: float, powder: PowderState | None, guess: Any) -> MagneticField | Field3D:
        ampere_turns, known = self.turns * current, self.known
        if guess is None and powder is None and known is not None and known.ampere_turns == ampere_turns:
            return known
        return self.problem.solve(ampere_turns, fill=powder, guess=guess, tolerance=self.newton_tolerance)
