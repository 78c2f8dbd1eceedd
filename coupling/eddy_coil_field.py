"""The field of a coil amid solid conductors: it diffuses into them, at a current or at a voltage."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from coupling.coil_field import SolvedCoilField
from coupling.coil_row import EddyRow, VoltageEddyRow
from field.newton import norm
from field.section.eddy_currents import SLIVER, CurrentDrive, EddyCurrentProblem, TransientState, VoltageDrive
from field.section.powder_state import Powder
from geometry.time_profile import TimeProfile


@dataclass
class EddyCoilField(SolvedCoilField):
    """The coil's field with eddy currents in solid parts (effect `eddy_currents`), at a current or at a voltage.

    The field takes steps of its own, of one or several windows: as long as field and current are expected to change by
    `change_tolerance` of their size. They stay constant between, as by every field of the staggered loop. A step whose
    local error is larger than that is repeated as several.

    Attributes
    ----------
    eddy : EddyCurrentProblem
        With `problem` and `turns`.
    supply : TimeProfile
        The current [A]; where there is a resistance the voltage [V], and the current follows from the field. A step
        ends at each of its instants, where it is not smooth.
    resistance : float or None
        Of the coil at a voltage [ohm]; None: the current is given.
    begin_steady : bool
        Begin with the static field of the drive at the start instead of with none.
    change_tolerance : float
        Change of the field in one of its steps, relative to the largest so far, and of the current, relative to the
        largest of all; also the local error of a step.
    """

    eddy: EddyCurrentProblem
    supply: TimeProfile
    resistance: float | None = None
    begin_steady: bool = False
    change_tolerance: float = 0.02
    drive: CurrentDrive | VoltageDrive = field(init=False)
    transient: TransientState | None = field(default=None, init=False)
    due: float = field(default=-np.inf, init=False)
    largest: float = field(default=0.0, init=False)
    largest_size: float = field(default=0.0, init=False)  # of all states, by `EddyCurrentProblem.size`
    _before: TransientState | None = field(default=None, init=False)
    _begun: float = field(default=-np.inf, init=False)
    _base: TransientState | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if self.eddy.problem is not self.problem or self.eddy.turns != self.turns:
            raise ValueError("the eddy-current problem must be one of the same field problem and the same turns")
        if self.resistance is None:
            self.drive = CurrentDrive(self.supply)
        else:
            self.drive = VoltageDrive(self.supply, self.resistance)

    def current(self, time: float) -> float:
        """Return the current [A] at `time` [s]; of a voltage that of the present field."""
        if isinstance(self.drive, CurrentDrive):
            return self.drive.current(time)
        assert self.transient is not None, "refresh(time) comes first"
        return self.transient.current

    def refresh(self, time: float) -> bool:
        """See `SolvedCoilField.refresh`."""
        begin = perf_counter()
        if self.transient is None or (self._base is None and time == self.transient.time):
            current = self._first_current(time)
            if not self.is_stale(current):
                return False
            powder = self._powder(current)
            self.transient = self._before = self._beginning(time, powder)
            self._begun = time
            self.solves += 1
        else:
            if time > self._begun:  # a window with feedback asks again until field and moments agree
                self._before, self._begun = self.transient, time
            is_later = time > self.transient.time
            current = self.current(time) if is_later else self.transient.current
            changed = self.is_stale(current)
            bends = any(self.transient.time < b < time for b in self.supply.times)
            # to within round-off of the windows' sum of steps
            waits = time < self.due - 1e-9 * abs(time) and not changed and not bends
            again = self.feedback is not None and changed and self._base is not None
            if waits or not (is_later or again):
                return False
            powder = self._powder(current)
            if is_later:
                self._base = self._stepped(self.transient, time, powder)
            else:  # the moments have answered to this step: the same step with them
                assert self._base is not None
                self._stepped(self._base, time, powder)
        self.set_solution(self.eddy.field(self.transient, powder), self.transient.current)
        self.seconds += perf_counter() - begin
        return True

    def has_field(self, current: float) -> bool:
        """See `SolvedCoilField.has_field`: after the current some remains in the solid parts."""
        return current != 0.0 or (self.transient is not None and bool(np.any(self.transient.psi)))

    def _first_current(self, time: float) -> float:
        """Current [A] of the field that the coil begins with."""
        drive = self.drive
        if not self.begin_steady:
            return 0.0
        return drive.voltage(time) / drive.resistance if isinstance(drive, VoltageDrive) else drive.current(time)

    def _beginning(self, time: float, powder: Powder) -> TransientState:
        if not self.begin_steady:
            return self.eddy.at_rest(time)
        ampere_turns = self.turns * self._first_current(time)
        solution = self.problem.solve(ampere_turns, fill=powder, guess=self.solution, tolerance=self.newton_tolerance)
        return self.eddy.steady(solution, time)

    def _stepped(self, before: TransientState, time: float, powder: Powder) -> TransientState:
        """Take the field from a state to `time` [s]; return the state at the beginning of the last step.

        It is one step where the drive is smooth and the local error of that step is within `change_tolerance`.
        """
        states = self.eddy.run(
            before,
            time,
            self.drive,
            powder,
            tolerance=self.change_tolerance,
            first_step=time - before.time,
            breaks=self.supply.times,
            newton_tolerance=self.newton_tolerance,
            largest=self.largest_size,
        )
        base, now = states[-2:]
        self.largest = max(self.largest, norm(now.psi))
        self.largest_size = max(self.largest_size, self.eddy.size(now.psi, self.drive))
        change = max(
            norm(now.psi - base.psi) / max(self.largest, 1e-300),
            abs(now.current - base.current) / max(self.largest_current, abs(now.current), 1e-300),
        )
        # a field that rests may take a step four times as long as the last one, one that moves a shorter one
        self.due = time + min(4.0, max(0.2, self.change_tolerance / max(change, 1e-300))) * (time - base.time)
        if any(abs(b - time) <= SLIVER * (time - before.time) for b in self.supply.times):
            self.due = time  # the drive bends here
        self.transient = now
        self.solves += len(states) - 1
        return base

    def window_part(self) -> EddyRow:
        """Return the coil at the field's last step, and the energies of its steps that end in the window."""
        assert self.transient is not None and self._before is not None, "refresh(time) comes first"
        now, before = self.transient, self._before
        supplied, loss = now.supplied - before.supplied, now.eddy_loss - before.eddy_loss
        row = (self.solved_current, *self.linkage_and_energy(), supplied, loss)
        if not isinstance(self.drive, VoltageDrive):
            return EddyRow(*row)
        copper_loss = now.copper_loss - before.copper_loss
        return VoltageEddyRow(*row, self.drive.voltage(self._begun), copper_loss)

    def state(self) -> dict[str, Any] | None:
        """See `SolvedCoilField.state`."""
        saved = super().state()
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
        saved["due"], saved["largest"], saved["largest_size"] = self.due, self.largest, self.largest_size
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """See `SolvedCoilField.restore`."""
        super().restore(saved)
        assert self.solution is not None
        numbers = {name: float(value) for name, value in saved["transient"].items()}
        self.transient = TransientState(psi=self.solution.psi, newton=self.solution.newton, **numbers)
        self._before = self.transient
        self.due, self.largest = float(saved["due"]), float(saved["largest"])
        self.largest_size = float(saved.get("largest_size", 0.0))
