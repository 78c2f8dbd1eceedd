"""The interface of every source of the field, for the loop, observers and checkpoints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from field import FieldSampler
from field.solved_field import SolvedField

if TYPE_CHECKING:
    from coupling.coil_row import CoilRow
    from coupling.powder_feedback import PowderFeedback
    from particles import Body


class FieldSource(Protocol):
    """Source of H: a coil's field, solved repeatedly, or a given one."""

    @property
    def sampler(self) -> FieldSampler | None:
        """H and grad H at grains; None before the first solve."""

    @property
    def solution(self) -> SolvedField | None:
        """The present solution; None before the first solve, and of a field that is not solved."""

    @property
    def solves(self) -> int:
        """Solves of the field so far."""

    @property
    def carrier(self) -> Body | None:
        """The body that carries the field round because it has slots; None: the field is one of revolution."""

    @property
    def feedback(self) -> PowderFeedback | None:
        """Object that adds the grains' moments to the field; None where the field does not see them."""

    def refresh(self, time: float) -> bool:
        """Bring the field to the time [s] and to the grains; True when it is new."""

    def window_part(self) -> CoilRow | None:
        """Row of the coil for the window that ends with the last `refresh`; None without one."""

    def state(self) -> dict[str, Any] | None:
        """State for a bit-exact continuation; None where there is none."""

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up the state of a checkpoint."""
