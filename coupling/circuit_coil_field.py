"""The field of a coil at a voltage: its current follows from the circuit and the nonlinear flux linkage."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np

from coupling.coil_field import SolvedCoilField
from coupling.coil_row import CircuitRow
from field import PowderState
from field.coil.coil_circuit import CircuitState, LinearisedCoil, solve_at_flux_linkage
from geometry.time_profile import TimeProfile


@dataclass
class CircuitCoilField(SolvedCoilField):
    """A coil at a voltage, V(t) = R i + d lambda/dt, with the flux linkage of the field (effect `coil_circuit`).

    The linkage is integrated exactly along a line i(lambda) about the last solve; when the current or the linkage have
    moved beyond their tolerance, or the grains, the field is solved for the linkage reached, which none can make jump.
    Where the line has missed the current of the solve by more than the tolerance, the time since the last step is
    divided, so that a window may be of any length.

    Attributes
    ----------
    voltage : TimeProfile
        [V].
    resistance : float
        Of the coil [ohm], > 0.
    begin_steady : bool
        Begin with the field of V(0)/R instead of with none.
    stride : float
        Change of the linkage, relative to the largest so far, that calls for a solve: follows from how far the last
        line missed the current.
    largest_current : float
        The largest |V|/R to come [A]: what the current's tolerance refers to from the start.
    """

    voltage: TimeProfile
    resistance: float
    begin_steady: bool = False
    circuit: CircuitState | None = field(default=None, init=False)
    coil: LinearisedCoil | None = field(default=None, init=False)
    largest_linkage: float = field(default=0.0, init=False)
    stride: float = field(default=np.inf, init=False)
    _began: float = field(default=-np.inf, init=False)
    _at_last_window: CircuitState | None = field(default=None, init=False)
    _into_field_at_solve: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.resistance) and self.resistance > 0.0):
            raise ValueError(f"`resistance` = {self.resistance} ohm of the coil must be a finite number above 0")

    def refresh(self, time: float) -> bool:
        """See `SolvedCoilField.refresh`."""
        begin = perf_counter()
        if self.circuit is None or self.coil is None or time == self._began:
            # at the first instant it is the current that is given; later the linkage, whatever the moments do
            current = self.voltage(time) / self.resistance if self.begin_steady else 0.0
            if not self.is_stale(current):
                return False
            powder = self._powder(current)
            solution = self.problem.solve(
                self.turns * current, fill=powder, guess=self.solution, tolerance=self.newton_tolerance
            )
            self.solves += 1
            self.circuit = CircuitState(time, self.turns * solution.flux_linkage_per_turn, current)
            self._began, self._at_last_window = time, self.circuit
        else:
            followed = self._followed(time)
            if followed is None:
                return False
            solution = followed
        self._linearise(solution)
        self._into_field_at_solve = self.circuit.into_field
        self.set_solution(solution, self.circuit.current)
        self.seconds += perf_counter() - begin
        return True

    def _followed(self, time: float) -> Any:
        """Take the circuit to `time` [s], by steps that end where the voltage bends; the field there, None: as before.

        The grains are those of the last field until `time`.
        """
        assert self.coil is not None and self.circuit is not None
        before, guess, solution = self.circuit, self.solution, None
        former, powder = self.solution.powder, None
        stops = [*(b for b in self.voltage.times if before.time < b < time), time]
        length, shortest = np.inf, 1e-6 * (time - before.time)
        while stops:
            end = stops[0] if stops[0] - before.time < 1.1 * length else before.time + length
            after = self.coil.advance(before, end, self.voltage)
            largest = max(self.largest_linkage, abs(after.linkage))
            # where iron opens or closes, the one runs away while the line says that the other hardly moves
            stride = min(self.stride, self.current_tolerance)
            stale = abs(after.linkage - self.coil.linkage) > stride * largest
            stale |= abs(after.current - self.coil.current) > self.current_tolerance * self.largest_current
            if end == time:
                stale |= self.is_stale(after.current) or guess is not self.solution
            factor, solution = 2.0, None
            if stale:
                if powder is None and end == time:
                    powder = self._powder(after.current)
                solution = self._at_linkage(after, powder if end == time else former, guess)
                miss = self._miss(after, solution)
                if miss > self.current_tolerance and end - before.time > shortest:
                    if former is not None and end == time:  # what the grains have changed is no miss of the line
                        miss = self._miss(after, self._at_linkage(after, former, solution))
                    if miss > self.current_tolerance:
                        if length == np.inf:  # the first such step: a line about its beginning
                            self.circuit, guess = before, self._at_linkage(before, former, guess)
                            self._linearise(guess)
                            before = self.circuit
                        length = (end - before.time) * min(self._factor(miss), 0.5)
                        continue
                factor = self._factor(miss)
                self.stride = float(np.clip(stride * factor, 1e-4, self.current_tolerance))
            self.circuit, self.largest_linkage = after, largest
            length *= factor
            if end == stops[0]:
                stops.pop(0)
            if solution is not None and stops:
                guess = self._linearise(solution)
            before = self.circuit
        return solution

    def _at_linkage(self, circuit: CircuitState, powder: PowderState | None, guess: Any) -> Any:
        """Solve the field of a circuit's linkage."""
        self.solves += 1
        linkage = circuit.linkage / self.turns
        return solve_at_flux_linkage(self.problem, linkage, powder, guess, tolerance=self.newton_tolerance)

    def _miss(self, circuit: CircuitState, solution: Any) -> float:
        """How far a circuit's current is off that of a field [-]."""
        return abs(circuit.current - solution.ampere_turns / self.turns) / max(self.largest_current, 1e-300)

    def _factor(self, miss: float) -> float:
        """Factor of the next step: the line's error is of second order, and is kept at half the tolerance."""
        return float(np.clip(np.sqrt(0.5 * self.current_tolerance / max(miss, 1e-12)), 0.2, 2.0))

    def _linearise(self, solution: Any) -> Any:
        """Take the line about a solved field, and its current as that of the circuit; return the field."""
        assert self.circuit is not None
        self.coil = LinearisedCoil.about(solution, self.turns, self.resistance)
        self.circuit = replace(self.circuit, current=self.coil.current)
        return solution

    def _advanced(self, time: float) -> CircuitState:
        assert self.circuit is not None and self.coil is not None, "refresh(time) comes first"
        if time <= self.circuit.time:
            return self.circuit
        return self.coil.advance(self.circuit, time, self.voltage, self.voltage.times)

    def current(self, time: float) -> float:
        """Return the current [A] at `time` [s] from the present circuit; of times after the last `refresh`."""
        return self._advanced(time).current

    def window_part(self) -> CircuitRow:
        """Return the circuit at the last `refresh`, and its energies since the row before.

        Linkage and energy of the field go on from its last solve as those of the circuit do.
        """
        assert self.circuit is not None and self._at_last_window is not None, "refresh(time) comes first"
        now, before, energy = self.circuit, self._at_last_window, self.linkage_and_energy()[1]
        self._at_last_window = now
        return CircuitRow(
            current=now.current,
            flux_linkage=now.linkage,
            field_energy=energy + now.into_field - self._into_field_at_solve,
            coil_voltage=self.voltage(now.time),
            coil_supplied=now.supplied - before.supplied,
            copper_loss=now.copper_loss - before.copper_loss,
            into_field=now.into_field - before.into_field,
        )

    def state(self) -> dict[str, Any] | None:
        """See `SolvedCoilField.state`."""
        saved = super().state()
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
        saved["into_field_at_solve"] = self._into_field_at_solve
        saved["coil"] = {"linkage": coil.linkage, "current": coil.current, "inductance": coil.inductance}
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """See `SolvedCoilField.restore`."""
        super().restore(saved)
        self.largest_linkage, self.stride = float(saved["largest_linkage"]), float(saved["stride"])
        self.circuit = CircuitState(**{name: float(value) for name, value in saved["circuit"].items()})
        self._at_last_window = self.circuit
        self._into_field_at_solve = float(saved.get("into_field_at_solve", self.circuit.into_field))
        self.coil = LinearisedCoil(
            **{name: float(value) for name, value in saved["coil"].items()}, resistance=self.resistance
        )
