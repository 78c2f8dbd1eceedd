"""Field of a coil with a given current in steel with hysteresis (effect `hysteresis`).

The steel's history goes on from one time to the next; solves at the same time, until powder and field agree, begin with
the same one. At 0 A there is the field that remains.
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

    def has_field(self, current: float) -> bool:
        """See `SolvedCoilField.has_field`: some remains without a current."""
        return True

    def refresh(self, time: float) -> bool:
        """See `SolvedCoilField.refresh`."""
        if time != self._time:
            if self.solution is not None and self.solution.later_history is not None:
                self.history = self.solution.later_history
            self._time, self.heat = time, 0.0
        new = super().refresh(time)
        if new and self.solution is not None:
            self.heat = self.solution.hysteresis_loss
        return new

    def _solved(self, current: float, powder: PowderState | None, guess: MagneticField | None) -> MagneticField:
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
            saved["history"] = {str(i): one.position for i, one in enumerate(self.solution.history.regions)}
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """See `SolvedCoilField.restore`."""
        super().restore(saved)
        assert self.solution is not None
        positions = [np.array(saved["history"][str(i)], dtype=float) for i in range(len(self.history.regions))]
        self.solution.history = self.history.at(positions)
