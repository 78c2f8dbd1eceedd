"""Where H comes from: a coil's finite-element field that follows current and fill, or an imposed field.

Of the coil's field there are three, by what its current follows from: a course in time (`CoilField`), the circuit of
a voltage and the nonlinear flux linkage (`CircuitCoilField`), and the diffusion of the field into solid conductors
(`EddyCoilField`, at a current or at a voltage).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from coupling.powder_feedback import PowderFeedback
from field import AxisymmetricProblem, FieldSampler, MagneticField, PowderState, field_sampler
from field.coil.coil_circuit import CircuitState, LinearisedCoil, solve_at_flux_linkage
from field.newton import norm
from field.section.eddy_currents import CurrentDrive, EddyCurrentProblem, TransientState, VoltageDrive
from field.section.powder_state import Powder


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
    feedback : PowderFeedback or None
        Where it is not the fill but the moments of the grains that couple back: what the powder's state comes from, and
        what decides, in place of the fill, whether the field is still theirs.
    """

    problem: AxisymmetricProblem
    turns: float
    current: Callable[[float], float]
    newton_tolerance: float = 1e-8
    current_tolerance: float = 0.01
    fill_tolerance: float = 0.05
    element_volume: np.ndarray | None = None
    feedback: PowderFeedback | None = None
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
        if not self.is_stale(current, fill):
            return False
        begin = perf_counter()
        guess = self.solution if self.solution is not None and self.solved_current != 0.0 else None
        powder = self._powder(fill, current)
        self.set_solution(
            self.problem.solve(self.turns * current, fill=powder, guess=guess, tolerance=self.newton_tolerance),
            current,
            fill,
        )
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

    def is_stale(self, current: float, fill: np.ndarray | None) -> bool:
        """Whether current [A] or fill have left the present field behind; notes the largest current and the change."""
        self.largest_current = max(self.largest_current, abs(current))
        stale = self.solution is None
        if not stale and abs(current - self.solved_current) > self.current_tolerance * self.largest_current:
            stale = True
        if not stale and (current == 0.0) != (self.solved_current == 0.0):
            stale = True  # switched off is exactly off
        self.fill_change = 0.0
        if self.feedback is not None and self.solution is not None:
            self.fill_change = self.feedback.residual.total
            stale = stale or (current != 0.0 and self.fill_change > self.fill_tolerance)
        elif fill is not None and self.fill is not None:
            volume = self.element_volume
            change = (volume * (fill - self.fill) ** 2).sum() / max((volume * self.fill**2).sum(), 1e-300)
            self.fill_change = float(np.sqrt(change))
            # without current there is no field that the fill could change
            if current != 0.0 and self.fill_change > self.fill_tolerance:
                stale = True
        return stale

    def set_solution(self, solution: MagneticField, current: float, fill: np.ndarray | None) -> None:
        """Take a solution (a fresh one, or the one of a checkpoint) as the present field."""
        self.solution, self.solved_current, self.fill = solution, current, fill
        if self.feedback is not None:
            self.sampler = self.feedback.solved(solution)
        else:
            # a granular fill is never smooth enough for the conservative table
            self.sampler = field_sampler(solution, "powder") if fill is None else solution.sampler("powder")

    def _powder(self, fill: np.ndarray | None, current: float) -> Powder:
        """What the next solve takes of the powder."""
        if self.feedback is None:
            return fill
        return self.feedback.state(self.solution if current != 0.0 else None)

    def window_row(self, time: float) -> dict[str, float]:
        """What a window that ends at `time` [s] adds to the history beside the field's own quantities."""
        return {"current": self.current(time)}

    def state(self) -> dict[str, Any] | None:
        """What a bit-exact continuation needs; None before the first solve."""
        if self.solution is None:
            return None
        saved = {
            "psi": self.solution.psi,
            "ampere_turns": self.solution.ampere_turns,
            "fill": self.fill,
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
        powder = saved["fill"]
        if self.feedback is not None:
            powder = PowderState(powder, saved["factor"], saved["source"])
        solution = MagneticField(
            self.problem, saved["psi"], saved["ampere_turns"], powder, [tuple(x) for x in saved["newton"]]
        )
        if self.feedback is None:
            self.set_solution(solution, saved["current"], saved["fill"])
        else:
            self.solution, self.solved_current = solution, saved["current"]
            self.feedback.restore(saved["feedback"])
            self.sampler = self.feedback.sampler(solution)
        self.largest_current, self.solves = saved["largest_current"], saved["solves"]


def _unset(time: float) -> float:
    raise AssertionError("the source's course in time is set when it is built")


@dataclass(slots=True)
class CircuitCoilField(CoilField):
    """A coil at a voltage, V(t) = R i + d lambda/dt, with the flux linkage of the field (effect `coil_circuit`).

    The linkage is integrated exactly along a line i(lambda) about the last solve; when the current or the linkage have
    moved beyond their tolerance, or the fill, the field is solved for the linkage reached, which none can make jump.

    Attributes
    ----------
    current : callable t [s] -> I [A]
        Not given: from the present circuit, without changing it; for times after the last `refresh`.
    voltage : callable t [s] -> V [V]
    resistance : float
        Of the coil [ohm], > 0.
    breaks : tuple of float
        Instants [s] where the voltage is not smooth.
    begin_steady : bool
        Begin with the field of V(0)/R instead of with none.
    stride : float
        Change of the linkage, relative to the largest so far, that calls for a solve: follows from how far the last
        line missed the current.
    largest_current : float
        The largest |V|/R to come [A]: what the current's tolerance refers to from the start.
    """

    current: Callable[[float], float] = _unset
    voltage: Callable[[float], float] = _unset
    resistance: float = np.nan
    breaks: tuple[float, ...] = ()
    begin_steady: bool = False
    circuit: CircuitState | None = None
    coil: LinearisedCoil | None = None
    largest_linkage: float = 0.0
    stride: float = np.inf
    _began: float = -np.inf

    def __post_init__(self) -> None:
        if not (np.isfinite(self.resistance) and self.resistance > 0.0):
            raise ValueError(f"`resistance` = {self.resistance} ohm of the coil must be a finite number above 0")
        self.current = self._current_at

    def refresh(self, time: float, fill: np.ndarray | None = None) -> bool:
        """See `CoilField.refresh`."""
        begin = perf_counter()
        if self.circuit is None or self.coil is None or time == self._began:
            # at the first instant it is the current that is given; later the linkage, whatever the moments answer
            current = self.voltage(time) / self.resistance if self.begin_steady else 0.0
            if not self.is_stale(current, fill):
                return False
            powder = self._powder(fill, current)
            solution = self.problem.solve(
                self.turns * current, fill=powder, guess=self.solution, tolerance=self.newton_tolerance
            )
            self.circuit = CircuitState(time, self.turns * solution.flux_linkage_per_turn, current)
            self._began = time
        else:
            self.circuit = self.coil.advanced(self.circuit, time, self.voltage, self.breaks)
            linkage = self.circuit.linkage
            self.largest_linkage = max(self.largest_linkage, abs(linkage))
            # where iron opens or closes, the one runs away while the line says that the other hardly moves
            stride = min(self.stride, self.current_tolerance)
            moved = abs(linkage - self.coil.linkage) > stride * self.largest_linkage
            if not self.is_stale(self.circuit.current, fill) and not moved:
                return False
            foretold = self.circuit.current
            solution = solve_at_flux_linkage(
                self.problem,
                self.circuit.linkage / self.turns,
                self._powder(fill, foretold),
                self.solution,
                tolerance=self.newton_tolerance,
            )
            # the line's error is of second order in the stride: keep it at half the tolerance
            miss = abs(foretold - solution.ampere_turns / self.turns) / max(self.largest_current, 1e-300)
            factor = np.sqrt(0.5 * self.current_tolerance / max(miss, 1e-12))
            self.stride = float(np.clip(stride * np.clip(factor, 0.2, 2.0), 1e-4, self.current_tolerance))
        self.coil = LinearisedCoil.about(solution, self.turns, self.resistance)
        self.circuit = replace(self.circuit, current=self.coil.current)
        self.set_solution(solution, self.coil.current, fill)
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

    def _advanced(self, time: float) -> CircuitState:
        assert self.circuit is not None and self.coil is not None, "refresh(time) comes first"
        if time <= self.circuit.time:
            return self.circuit
        return self.coil.advanced(self.circuit, time, self.voltage, self.breaks)

    def _current_at(self, time: float) -> float:
        return self._advanced(time).current

    def window_row(self, time: float) -> dict[str, float]:
        """Circuit at the window's end, and its energies [J] since the window's `refresh`."""
        assert self.circuit is not None, "refresh(time) comes first"
        end = self._advanced(time)
        return {
            "current": end.current,
            "coil_voltage": self.voltage(time),
            "coil_supplied": end.supplied - self.circuit.supplied,
            "copper_loss": end.copper_loss - self.circuit.copper_loss,
            "into_field": end.into_field - self.circuit.into_field,
        }

    def state(self) -> dict[str, Any] | None:
        """See `CoilField.state`."""
        saved = CoilField.state(self)  # super() does not find its class in a dataclass with slots
        if saved is None or self.circuit is None or self.coil is None:
            return saved
        circuit, coil = self.circuit, self.coil
        saved["circuit"] = {
            "time": circuit.time,
            "linkage": circuit.linkage,
            "current": circuit.current,
            "supplied": circuit.supplied,
            "copper_loss": circuit.copper_loss,
        }
        saved["largest_linkage"], saved["stride"] = self.largest_linkage, self.stride
        saved["coil"] = {"linkage": coil.linkage, "current": coil.current, "inductance": coil.inductance}
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """See `CoilField.restore`."""
        CoilField.restore(self, saved)
        self.largest_linkage, self.stride = float(saved["largest_linkage"]), float(saved["stride"])
        self.circuit = CircuitState(**{name: float(value) for name, value in saved["circuit"].items()})
        self.coil = LinearisedCoil(
            **{name: float(value) for name, value in saved["coil"].items()}, resistance=self.resistance
        )


@dataclass(slots=True)
class EddyCoilField(CoilField):
    """The coil's field with eddy currents in solid parts (effect `eddy_currents`), at a current or at a voltage.

    The field takes steps of its own, of one or several windows: as long as it is expected to change by
    `change_tolerance` of its size. It is held between, as by every field of the staggered loop.

    Attributes
    ----------
    current : callable t [s] -> I [A]
        Where the coil has a prescribed current; at a voltage it is not given and follows from the field.
    eddy : EddyCurrentProblem
        With `problem` and `turns`.
    voltage : VoltageDrive or None
        None: at a prescribed current.
    breaks : tuple of float
        Instants [s] where the drive is not smooth: steps end there.
    begin_steady : bool
        Begin with the static field of the drive at the start instead of with none.
    change_tolerance : float
        Change of the field in one of its steps, relative to the largest so far.
    """

    current: Callable[[float], float] = _unset
    eddy: EddyCurrentProblem | None = None
    voltage: VoltageDrive | None = None
    breaks: tuple[float, ...] = ()
    begin_steady: bool = False
    change_tolerance: float = 0.02
    transient: TransientState | None = None
    due: float = -np.inf
    largest: float = 0.0
    _before: TransientState | None = None
    _begun: float = -np.inf
    _base: TransientState | None = None

    def __post_init__(self) -> None:
        if self.eddy is None or self.eddy.problem is not self.problem or self.eddy.turns != self.turns:
            raise ValueError("the eddy-current problem must be one of the same field problem and the same turns")
        if self.voltage is None and self.current is _unset:
            raise ValueError("a field with eddy currents needs its coil's current or a voltage drive")
        if self.voltage is not None:
            self.current = self._current_now

    @property
    def _drive(self) -> VoltageDrive | CurrentDrive:
        return CurrentDrive(self.current) if self.voltage is None else self.voltage

    def refresh(self, time: float, fill: np.ndarray | None = None) -> bool:
        """See `CoilField.refresh`."""
        begin = perf_counter()
        assert self.eddy is not None
        if self.transient is None or (self._base is None and time == self.transient.time):
            current = self._first_current(time)
            if not self.is_stale(current, fill):
                return False
            powder = self._powder(fill, current)
            self.transient = self._before = self._beginning(time, powder)
            self._begun = time
        else:
            if time > self._begun:  # a window with feedback asks again until field and moments agree
                self._before, self._begun = self.transient, time
            current = self.transient.current if self.voltage is not None else self.current(time)
            changed = self.is_stale(current, fill)
            stops = [b for b in self.breaks if self.transient.time < b < time]
            # to within round-off of the windows' sum of steps
            waits = time < self.due - 1e-9 * abs(time) and not changed and not stops
            again = self.feedback is not None and changed and self._base is not None
            if waits or (time <= self.transient.time and not again):
                return False
            powder = self._powder(fill, current)
            if time <= self.transient.time:  # the moments have answered to this step: the same step with them
                assert self._base is not None
                self.transient = self._stepped(self._base, time, powder)
            else:
                for stop in (*sorted(stops), time):
                    self._base = self.transient
                    self.transient = self._stepped(self.transient, stop, powder)
        self.set_solution(self.eddy.field(self.transient, powder), self.transient.current, fill)
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

    def _first_current(self, time: float) -> float:
        """Current [A] of the field that the coil begins with."""
        drive = self._drive
        if not self.begin_steady:
            return 0.0
        return drive.voltage(time) / drive.resistance if isinstance(drive, VoltageDrive) else drive.current(time)

    def _beginning(self, time: float, fill: Powder) -> TransientState:
        assert self.eddy is not None
        if not self.begin_steady:
            return self.eddy.at_rest(time)
        ampere_turns = self.turns * self._first_current(time)
        solution = self.problem.solve(ampere_turns, fill=fill, guess=self.solution, tolerance=self.newton_tolerance)
        return self.eddy.steady(solution, time)

    def _stepped(self, before: TransientState, time: float, fill: Powder) -> TransientState:
        """One step of the field, and when the next one is due."""
        assert self.eddy is not None
        dt = time - before.time
        now = self.eddy.step(before, dt, self._drive, fill, tolerance=self.newton_tolerance)
        self.largest = max(self.largest, norm(now.psi))
        change = norm(now.psi - before.psi) / max(self.largest, 1e-300)
        # a field that rests may take a step four times as long as the last one, one that moves a shorter one
        self.due = time + min(4.0, max(0.2, self.change_tolerance / max(change, 1e-300))) * dt
        return now

    def _current_now(self, time: float) -> float:
        assert self.transient is not None, "refresh(time) comes first"
        return self.transient.current

    def window_row(self, time: float) -> dict[str, float]:
        """The coil, and the energies [J] of the field's step, if the window began with one."""
        assert self.transient is not None and self._before is not None, "refresh(time) comes first"
        now, before = self.transient, self._before
        row = {
            "current": self.current(time),
            "coil_supplied": now.supplied - before.supplied,
            "eddy_loss": now.eddy_loss - before.eddy_loss,
        }
        if self.voltage is not None:
            row |= {"coil_voltage": self.voltage.voltage(time), "copper_loss": now.copper_loss - before.copper_loss}
        return row

    def state(self) -> dict[str, Any] | None:
        """See `CoilField.state`."""
        saved = CoilField.state(self)
        if saved is None or self.transient is None:
            return saved
        now = self.transient
        saved["transient"] = {
            "time": now.time,
            "current": now.current,
            "linkage": now.linkage,
            "eddy_loss": now.eddy_loss,
            "copper_loss": now.copper_loss,
            "supplied": now.supplied,
            "error": now.error,
        }
        saved["due"], saved["largest"] = self.due, self.largest
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """See `CoilField.restore`."""
        CoilField.restore(self, saved)
        assert self.solution is not None
        numbers = {name: float(value) for name, value in saved["transient"].items()}
        self.transient = TransientState(psi=self.solution.psi, newton=self.solution.newton, **numbers)
        self._before = self.transient
        self.due, self.largest = float(saved["due"]), float(saved["largest"])
