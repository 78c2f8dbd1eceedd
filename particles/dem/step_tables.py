"""Tables in time for the kernel: gravity, prescribed speeds and torques of the bodies at the next steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from particles.bodies import Body
from particles.grain_motion import Gravity, gravity_at
from particles.shafts import drives_at


class StepTables:
    """Tables for ``n_steps`` steps of ``dt`` [s] from number ``first`` on, made once for several calls of the step.

    Attributes
    ----------
    end : int
        Number of the step after the last.
    constants : ndarray, shape (n_bodies, 2)
        As in `particles.shafts.Shafts`.
    """

    def __init__(self, gravity: Gravity | None, bodies: Sequence[Body], first: int, n_steps: int, dt: float) -> None:
        times = (first + np.arange(n_steps)) * dt
        self._first, self.end = first, first + n_steps
        self._gravity, self._turns = gravity_at(gravity, times), callable(gravity)
        self._drives, self.constants = drives_at(bodies, times)

    def gravity(self, step: int) -> np.ndarray:
        """Acceleration [m/s^2] from a step on (k, 3), as `particles.dem.kernel_state.GrainState` has it."""
        return self._gravity[step - self._first :] if self._turns else self._gravity

    def drives(self, step: int) -> np.ndarray:
        """Speeds and torques from a step on (k, n_bodies, 4), as `particles.shafts.Shafts` has them."""
        return self._drives[step - self._first :]
