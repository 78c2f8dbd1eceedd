"""Target precision of the torque: ``until = "torque 2 %"``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from emclutch.scene.section import Entry
from emclutch.scene.units import Quantity, number

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler

EXAMPLES = ("torque 2 %", "torque 0.01 N m", "torque 2 % or 0.01 N m")
_SHARE = number("2", 0.01, 50.0)
_TORQUE = Quantity("a torque", "N*m", "0.01 N m", 0.0, 1e7, open_minimum=True)
_BARE = re.compile(r"[\d.eE+-]+")


@dataclass(frozen=True, slots=True)
class TorqueTarget:
    """Half the width of the torque's 95 % interval that is good enough; one of the two suffices.

    Attributes
    ----------
    relative : float or None
        Over the torque's magnitude.
    absolute : float or None
        [N m].
    """

    relative: float | None = None
    absolute: float | None = None

    @classmethod
    def of_text(cls, text: object) -> TorqueTarget:
        """Read ``torque 2 %``, ``torque 0.01 N m`` or both with ``or`` between; ValueError with the remedy."""
        examples = "write " + ", ".join(f"'{one}'" for one in EXAMPLES)
        match = re.fullmatch(r"\s*torque\s+(.+)", text) if isinstance(text, str) else None
        if match is None:
            raise ValueError(f"is not a valid torque target; {examples}")
        parts = re.split(r"\s+or\s+", match[1])
        shares = [part.strip().removesuffix("%").strip() for part in parts if part.strip().endswith("%")]
        torques = [part.strip() for part in parts if not part.strip().endswith("%")]
        if len(shares) > 1 or len(torques) > 1:
            raise ValueError(f"has two targets of one kind; {examples}")
        if any(_BARE.fullmatch(torque) for torque in torques):
            raise ValueError(f"has no unit; {examples}")
        try:
            relative = 0.01 * _SHARE.read(shares[0]) if shares else None
            absolute = _TORQUE.read(torques[0]) if torques else None
        except ValueError as error:
            raise ValueError(f"{error}; {examples}") from None
        return cls(relative, absolute)

    def half_width(self, mean: float) -> float:
        """The half width [N m] that is good enough for a torque of this mean [N m]."""
        return max(0.0 if self.relative is None else self.relative * abs(mean), self.absolute or 0.0)

    def __str__(self) -> str:
        share = None if self.relative is None else f"{100.0 * self.relative:.6g} %"
        torque = None if self.absolute is None else f"{self.absolute!r} N m"
        return "torque " + " or ".join(filter(None, (share, torque)))


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
