"""The field of a coil at a voltage: its current follows from the circuit and the nonlinear flux linkage."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np

from coupling.coil_field import SolvedCoilField
from coupling.coil_row import CircuitRow
from field.coil.coil_circuit import CircuitState, LinearisedCoil, solve_at_flux_linkage
from geometry.time_profile import TimeProfile


@dataclass
class CircuitCoilField(SolvedCoilField):
    """A coil at a voltage, V(t) = R i + d lambda/dt, with the flux linkage of the field (effect `coil_circuit`).

    The linkage is integrated exactly along a line i(lambda) about the last solve; when the current or the linkage have
    moved beyond their tolerance, or the grains, the field is solved for the linkage reached, which none can make jump.

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
    _booked: CircuitState | None = field(default=None, init=False)
    _into_field_at_solve: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.resistance) and self.resistance > 0.0):
            raise ValueError(f"`resistance` = {self.resistance} ohm of the coil must be a finite number above 0")

    def refresh(self, time: float) -> bool:
        """See `SolvedCoilField.refresh`."""
        begin = perf_counter()
        if self.circuit is None or self.coil is None or time == self._began:
            # at the first instant it is the current that is given; later the linkage, whatever the moments answer
            current = self.voltage(time) / self.resistance if self.begin_steady else 0.0
            if not self.is_stale(current):
                return False
            powder = self._powder(current)
            solution = self.problem.solve(
                self.turns * current, fill=powder, guess=self.solution, tolerance=self.newton_tolerance
            )
            self.circuit = CircuitState(time, self.turns * solution.flux_linkage_per_turn, current)
            self._began, self._booked = time, self.circuit
        else:
            self.circuit = self.coil.advance(self.circuit, time, self.voltage, self.voltage.times)
            linkage = self.circuit.linkage
            self.largest_linkage = max(self.largest_linkage, abs(linkage))
            # where iron opens or closes, the one runs away while the line says that the other hardly moves
            stride = min(self.stride, self.current_tolerance)
            moved = abs(linkage - self.coil.linkage) > stride * self.largest_linkage
            if not self.is_stale(self.circuit.current) and not moved:
                return False
            predicted = self.circuit.current
            solution = solve_at_flux_linkage(
                self.problem,
                self.circuit.linkage / self.turns,
                self._powder(predicted),
                self.solution,
                tolerance=self.newton_tolerance,
            )
            # the line's error is of second order in the stride: keep it at half the tolerance
            miss = abs(predicted - solution.ampere_turns / self.turns) / max(self.largest_current, 1e-300)
            factor = np.sqrt(0.5 * self.current_tolerance / max(miss, 1e-12))
            self.stride = float(np.clip(stride * np.clip(factor, 0.2, 2.0), 1e-4, self.current_tolerance))
        self.coil = LinearisedCoil.about(solution, self.turns, self.resistance)
        self.circuit = replace(self.circuit, current=self.coil.current)
        self._into_field_at_solve = self.circuit.into_field
        self.set_solution(solution, self.coil.current)
        self.solves += 1
        self.seconds += perf_counter() - begin
        return True

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
        assert self.circuit is not None and self._booked is not None, "refresh(time) comes first"
        now, before, energy = self.circuit, self._booked, self.linkage_and_energy()[1]
        self._booked = now
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
        self._booked = self.circuit
        self._into_field_at_solve = float(saved.get("into_field_at_solve", self.circuit.into_field))
        self.coil = LinearisedCoil(
            **{name: float(value) for name, value in saved["coil"].items()}, resistance=self.resistance
        )
