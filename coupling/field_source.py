"""What every source of the field offers to the loop, and to those who watch and keep it.

Optional, asked for by name: `solves` (how many so far: the column `field_solves`), `carrier` (the body that carries the
field round), `feedback` (what gives the grains' moments to it).
"""

from __future__ import annotations

from typing import Any, Protocol

from field import FieldSampler
from field.solved_field import SolvedField


class FieldSource(Protocol):
    """Where H comes from: a coil's field, solved again and again, or one that is given."""

    @property
    def sampler(self) -> FieldSampler | None:
        """H and grad H at grains; None before the first solve."""

    @property
    def solution(self) -> SolvedField | None:
        """The present solution; None before the first solve, and of a field that is not solved."""

    def refresh(self, time: float) -> bool:
        """Bring the field to the time [s] and to the grains; True when it is new."""

    def window_row(self, time: float) -> dict[str, float]:
        """What a window that ends at `time` [s] adds to the history beside the field's own quantities."""

    def state(self) -> dict[str, Any] | None:
        """What a bit-exact continuation needs; None where that is nothing."""

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up the state of a checkpoint."""
