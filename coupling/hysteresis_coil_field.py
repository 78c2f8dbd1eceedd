"""Field of a coil with a given current in steel with hysteresis (effect `hysteresis`).

The steel's history goes on from one time to the next; solves at the same time, until powder and field agree, begin with
the same one. At 0 A there is the field that remains. Each turn of the current is a step of the history, also where it
lies between two times or has moved the current by less than its tolerance; between turns the branches do not depend on
the steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coupling.coil_field import CoilField
from coupling.coil_row import HysteresisRow
from field import MagneticField, PowderState
from field.section.steel_history import SteelHistory


@dataclass
class HysteresisCoilField(CoilField):
    """The field of a coil with a given current, which depends on the currents before.

    Attributes
    ----------
    history : SteelHistory
        At the beginning of the present step; at first that of demagnetised steel.
    heat : float
        Of the steel in the present step [J].
    """

    history: SteelHistory = field(kw_only=True)
    heat: float = field(default=0.0, init=False)
    _time: float = field(default=np.nan, init=False)
    _turns: list[float] = field(default_factory=list, init=False)
    _heat_of_turns: float = field(default=0.0, init=False)

    def has_field(self, current: float) -> bool:
        """See `SolvedCoilField.has_field`: some remains without a current."""
        return True

    def refresh(self, time: float) -> bool:
        """See `SolvedCoilField.refresh`."""
        if time != self._time:
            if self.solution is not None and self.solution.later_history is not None:
                self.history = self.solution.later_history
            self._turns = self.currents.turning_values(self._time, time)
            self._time, self.heat, self._heat_of_turns = time, 0.0, 0.0
        new = super().refresh(time)
        if new and self.solution is not None:
            self.heat = self._heat_of_turns + self.solution.hysteresis_loss
        return new

    def is_stale(self, current: float) -> bool:
        """See `SolvedCoilField.is_stale`; a turn since the last time calls for a solve."""
        self.largest_current = max([self.largest_current, *map(abs, self._turns)])
        return super().is_stale(current) or bool(self._turns)

    def _solved(self, current: float, powder: PowderState | None, guess: MagneticField | None) -> MagneticField:
        while self._turns:  # with the powder of this time: grains follow no current between two times
            guess = self._step(self._turns.pop(0), powder, guess)
            assert guess.later_history is not None
            self.history = guess.later_history
            self._heat_of_turns += guess.hysteresis_loss
        return self._step(current, powder, guess)

    def _step(self, current: float, powder: PowderState | None, guess: MagneticField | None) -> MagneticField:
        return self.problem.solve(
            self.turns * current, powder, guess, tolerance=self.newton_tolerance, history=self.history
        )

    def window_part(self) -> HysteresisRow:
        """Return the coil, and the heat of the field's step, if the window ends with one."""
        return HysteresisRow(self.solved_current, *self.linkage_and_energy(), self.heat)

    def state(self) -> dict[str, Any] | None:
        """See `SolvedCoilField.state`."""
        saved = super().state()
        if saved is not None:
            assert self.solution is not None and self.solution.history is not None
            saved["time"] = self._time
            saved["history"] = {str(i): one.position for i, one in enumerate(self.solution.history.regions)}
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """See `SolvedCoilField.restore`."""
        super().restore(saved)
        assert self.solution is not None
        positions = [np.array(saved["history"][str(i)], dtype=float) for i in range(len(self.history.regions))]
        self.solution.history = self.history.at(positions)
        self._time = float(saved.get("time", np.nan))
