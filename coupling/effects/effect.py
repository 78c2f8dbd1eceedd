"""Interface of an effect to the staggered loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from coupling.staggered import Simulation


class Effect:
    """Base of the effects: both calls do nothing unless an effect overrides them.

    Attributes
    ----------
    name : str
    of_the_field : bool
        Whether its forces are those of a field that the scene then has: their torque is the field's, in `torque_field`.
        The torque of any other effect is a column of its own, `torque_NAME`.
    """

    name: str = ""
    of_the_field: bool = False

    @property
    def has_lagged_forces(self) -> bool:
        """True if it adds to the lagged forces."""
        return type(self).add_forces is not Effect.add_forces

    def begin_window(self, simulation: Simulation) -> None:
        """Act once at the start of a coupling window."""

    def add_forces(self, simulation: Simulation, force: np.ndarray) -> dict[str, float]:
        """Add to the lagged forces (n, 3) [N]; return torques on the sector's grains [N m] by name."""
        return {}
