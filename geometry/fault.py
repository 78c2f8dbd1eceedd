"""Errors of a geometry: one frozen record each, so that all of them are reported at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GeometryFault:
    """One inconsistency of a shape.

    Attributes
    ----------
    what : str
        The size that is at fault, as the shape calls it: ``"gap"``, ``"disc_slots.depth"``.
    value : str
        Its value with unit, such as ``"0.05 mm"``.
    reason, allowed, remedy : str
        Why it cannot be, the range that can, and what to change; sizes are named between backticks, and a grain's as
        ``grain_diameter``.
    """

    what: str
    value: str
    reason: str
    allowed: str
    remedy: str

    @property
    def message(self) -> str:
        """Reason, allowed range and remedy in one line (size and value are left to the caller)."""
        return f"{self.reason}; allowed: {self.allowed}; {self.remedy}"

    def message_with(self, key_of: Callable[[str], str]) -> str:
        """Return the message with the caller's keys of the sizes in it."""
        return with_keys(self.message, key_of)

    def __str__(self) -> str:
        return f"`{self.what}` = {self.value}: {self.message}"


class GeometryError(ValueError):
    """A geometry that cannot be built; ``faults`` lists every reason."""

    def __init__(self, faults: Sequence[GeometryFault]) -> None:
        self.faults = list(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


def millimetres(length: float) -> str:
    """A length [m] as people write it in a drawing: ``"0.05 mm"``."""
    return f"{length * 1e3:.4g} mm"


def with_keys(text: str, key_of: Callable[[str], str]) -> str:
    """Return a text of errors with `key_of(name)` in place of each name between backticks.

    A package that does not know the scene names what is wrong by its own arguments: "raise `gap` or lower
    `grain_diameter`". Whoever knows them under other names puts those in.
    """
    return re.sub(r"`([^`]*)`", lambda found: key_of(found[1]), text)
