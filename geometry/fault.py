"""Errors of a geometry: one frozen record each, so that all of them are reported at once."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType


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


class FaultFinder:
    """Collects the faults of a shape.

    Attributes
    ----------
    faults : list of GeometryFault
    """

    def __init__(self, shape: object, defaults: Mapping[str, float] = MappingProxyType({})) -> None:
        self.faults: list[GeometryFault] = []
        self._shape, self._defaults = shape, defaults
        self._broken: frozenset[str] = frozenset()

    def check_lengths(self, *names: str, or_zero: Mapping[str, str] = MappingProxyType({})) -> None:
        """Note sizes that are no positive lengths; `or_zero` has those that may be 0, with what 0 stands for."""
        for name in names:
            value, zero = getattr(self._shape, name), or_zero.get(name)
            right = value is None or 0.0 < value < math.inf or (zero is not None and value == 0.0)
            allowed = "more than 0 mm" if zero is None else f"0 mm ({zero}) or more"
            self.refuse(not right, name, "it is not a positive length", allowed, f"correct `{name}`")

    def judge_relations(self) -> None:
        """From here on, refuse a size only where it and those that it is judged with have no fault so far."""
        self._broken = frozenset(fault.what for fault in self.faults)

    def are_right(self, *names: str) -> bool:
        """True if sizes had no fault when relations began to be judged."""
        return self._broken.isdisjoint(names)

    def refuse(
        self, wrong: bool, name: str, reason: str, allowed: str, remedy: str, *judged_with: str, value: str = ""
    ) -> bool:
        """Note a fault of the size `name` where something is wrong with it; return whether it was noted.

        The value is that of a length where none is given; of a size of None it is the default that follows from others.
        """
        if not wrong or not self.are_right(name, *judged_with):
            return False
        if not value:
            length = getattr(self._shape, name)
            value = millimetres(self._defaults[name] if length is None else length)
        self.faults.append(GeometryFault(name, value, reason, allowed, remedy))
        return True


def millimetres(length: float) -> str:
    """A length [m] as people write it in a drawing: ``"0.05 mm"``."""
    return f"{length * 1e3:.4g} mm"


def with_keys(text: str, key_of: Callable[[str], str]) -> str:
    """Return a text of errors with `key_of(name)` in place of each name between backticks.

    A package that does not know the scene names what is wrong by its own arguments: "raise `gap` or lower
    `grain_diameter`". Whoever knows them under other names puts those in.
    """
    return re.sub(r"`([^`]*)`", lambda match: key_of(match[1]), text)
