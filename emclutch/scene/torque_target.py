"""Target precision of the torque, or of a powder's shear stress: ``until = "torque 2 %"``, ``"stress 2 %"``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from emclutch.scene.section import Entry
from emclutch.scene.units import Quantity, number

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler

EXAMPLES = ("torque 2 %", "torque 0.01 N m", "torque 2 % or 0.01 N m", "stress 2 %")
_SHARE = number("2", 0.01, 50.0)
_SIZES = {
    "torque": Quantity("a torque", "N*m", "0.01 N m", 0.0, 1e7, open_minimum=True),
    "stress": Quantity("a stress", "Pa", "100 Pa", 0.0, 1e9, open_minimum=True),
}
_UNITS = {"torque": "N m", "stress": "Pa"}
_BARE = re.compile(r"[\d.eE+-]+")


@dataclass(frozen=True, slots=True)
class TorqueTarget:
    """Half the width of the 95 % interval that is good enough; one of the two suffices.

    Attributes
    ----------
    relative : float or None
        Over the magnitude of the torque, or stress.
    absolute : float or None
        [N m], or [Pa].
    quantity : str
        torque (on the disc), or stress (of a sheared periodic box).
    """

    relative: float | None = None
    absolute: float | None = None
    quantity: str = "torque"

    @property
    def unit(self) -> str:
        """Of the quantity."""
        return _UNITS[self.quantity]

    @property
    def example(self) -> str:
        """An absolute half width with its unit."""
        return _SIZES[self.quantity].example

    @classmethod
    def of_text(cls, text: object) -> TorqueTarget:
        """Read ``torque 2 %``, ``torque 0.01 N m`` or both with ``or`` between; ValueError with the remedy."""
        examples = "write " + ", ".join(f"'{one}'" for one in EXAMPLES)
        match = re.fullmatch(r"\s*(torque|stress)\s+(.+)", text) if isinstance(text, str) else None
        if match is None:
            raise ValueError(f"is not a valid torque target; {examples}")
        quantity, parts = match[1], re.split(r"\s+or\s+", match[2])
        shares = [part.strip().removesuffix("%").strip() for part in parts if part.strip().endswith("%")]
        sizes = [part.strip() for part in parts if not part.strip().endswith("%")]
        if len(shares) > 1 or len(sizes) > 1:
            raise ValueError(f"has two targets of one kind; {examples}")
        if any(_BARE.fullmatch(size) for size in sizes):
            raise ValueError(f"has no unit; {examples}")
        try:
            relative = 0.01 * _SHARE.read(shares[0]) if shares else None
        except ValueError:
            allowed = f"{_SHARE.minimum:g} to {_SHARE.maximum:g} %"
            raise ValueError(f"is out of range; allowed: {allowed}; {examples}") from None
        try:
            absolute = _SIZES[quantity].read(sizes[0]) if sizes else None
        except ValueError as error:
            raise ValueError(f"{error}; {examples}") from None
        return cls(relative, absolute, quantity)

    def half_width(self, mean: float) -> float:
        """The half width that is good enough for a torque [N m], or stress [Pa], of this mean."""
        return max(0.0 if self.relative is None else self.relative * abs(mean), self.absolute or 0.0)

    @property
    def size(self) -> str:
        """The half width as text, without the quantity."""
        share = None if self.relative is None else f"{100.0 * self.relative:.6g} %"
        size = None if self.absolute is None else f"{self.absolute!r} {self.unit}"
        return " or ".join(filter(None, (share, size)))

    def __str__(self) -> str:
        return f"{self.quantity} {self.size}"


class TorqueTargetEntry(Entry):
    """The text of a `TorqueTarget`."""

    STORED = str
    kind_text = "text"
    sample = EXAMPLES[0]

    def needed_for(self, key: str) -> str:
        return f"a target is needed, e.g. {key} = '{self.sample}'"

    def read(self, given: object) -> TorqueTarget:
        """Return the target; ValueError with examples for what is none."""
        return given if isinstance(given, TorqueTarget) else TorqueTarget.of_text(given)

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", "examples": list(EXAMPLES)}
