"""What is wrong with a geometry: one frozen record a fault, so that all of them can be reported at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GeometryFault:
    """One inconsistency of a scene's geometry.

    Attributes
    ----------
    key : str
        The scene's key that is at fault, such as ``"geometry.gap"``.
    value : str
        Its value with unit, such as ``"0.05 mm"``.
    reason, allowed, remedy : str
        Why it cannot be, the range that can, and what to change.
    """

    key: str
    value: str
    reason: str
    allowed: str
    remedy: str

    @property
    def message(self) -> str:
        """Reason, allowed range and remedy in one line (key and value are left to the caller)."""
        return f"{self.reason}; allowed: {self.allowed}; {self.remedy}"

    def __str__(self) -> str:
        return f"`{self.key}` = {self.value}: {self.message}"


class GeometryError(ValueError):
    """A geometry that cannot be built; ``faults`` lists every reason."""

    def __init__(self, faults: Sequence[GeometryFault]) -> None:
        self.faults = list(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


def millimetres(length: float) -> str:
    """A length [m] as people write it in a drawing: ``"0.05 mm"``."""
    return f"{length * 1e3:.4g} mm"
