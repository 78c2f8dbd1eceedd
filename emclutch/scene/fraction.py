"""A fraction that is written in per cent: ``target = "5 %"``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from emclutch.scene.section import Entry

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler

LEAST, MOST = 0.1, 50.0  # per cent


class Fraction(float):
    """A fraction, 0.05 for 5 %."""

    def __str__(self) -> str:
        return f"{100.0 * self:.6g} %"


class FractionEntry(Entry):
    """The text of a `Fraction`."""

    STORED = str
    kind_text = "percentage"
    range_text = "0.1 % to 50 %"
    sample = "5 %"

    def needed_for(self, key: str) -> str:
        return f"a percentage is needed, e.g. {key} = '{self.sample}'"

    def read(self, given: object) -> Fraction:
        """Return the fraction; ValueError with an example for what is none."""
        if isinstance(given, Fraction):
            return given
        text = given.strip() if isinstance(given, str) else ""
        if not text.endswith("%"):
            raise ValueError(f"is not a percentage; write it as in '{self.sample}'")
        try:
            per_cent = float(text.removesuffix("%"))
        except ValueError:
            raise ValueError(f"is not a percentage; write it as in '{self.sample}'") from None
        if not LEAST <= per_cent <= MOST:
            raise ValueError(f"is out of range; allowed: {self.range_text}, e.g. '{self.sample}'")
        return Fraction(0.01 * per_cent)

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", "examples": [self.sample]}
