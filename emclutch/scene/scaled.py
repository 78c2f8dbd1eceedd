"""Entries that are a quantity, or a multiple of something that the scene itself has: ``end = "strain 20"``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from emclutch.scene.units import Angle, Instant, Quantity, Time, number

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler

STRAIN, DIAMETERS = "strain {}", "{} diameters"


@dataclass(frozen=True, slots=True)
class Scaled:
    """A multiple of something of the scene, as the user wrote it.

    Attributes
    ----------
    value : float
    form : str
        `STRAIN`: shear strain of the sheared gap, slip times mean radius over width, integrated over time; `DIAMETERS`:
        of the largest grain.
    """

    value: float
    form: str

    def __rmul__(self, factor: float) -> Scaled:
        return Scaled(factor * self.value, self.form)

    def __str__(self) -> str:
        return self.form.format(f"{self.value:.12g}")


_FACTOR = number("20", 0.0, 1e6, above=True)


@dataclass(frozen=True)
class QuantityOrScaled(Quantity):
    """A quantity, or a multiple in its place.

    Attributes
    ----------
    form : str
        Of the multiple.
    factor : Quantity
        Range and example of its number.
    words : str
        For the reference.
    """

    form: str = STRAIN
    factor: Quantity = _FACTOR
    words: str = "a shear strain"

    @property
    def kind_text(self) -> str:
        """See `Entry.kind_text`."""
        return f'{super().kind_text}, or {self.words} as `"{self.scaled_example}"`'

    @property
    def scaled_example(self) -> str:
        """A multiple as a user would type it."""
        return self.form.format(self.factor.example)

    def written(self, value: float | Scaled) -> float | str:
        """See `Entry.written`."""
        return str(value) if isinstance(value, Scaled) else super().written(value)

    def read(self, given: object) -> Any:
        """Return the quantity in SI, or the `Scaled`; ValueError as of `Quantity.read`."""
        if isinstance(given, Scaled) and given.form == self.form:
            return given
        match = re.fullmatch(self.form.format(r"(\S+)"), " ".join(given.split())) if isinstance(given, str) else None
        if match is None:
            if isinstance(given, str) and self.form.replace("{}", "").strip().removesuffix("s") in given.lower():
                numbers = re.findall(r"[\d.]+(?:e[+-]?\d+)?", given.lower()) or [self.factor.example]
                raise ValueError(f"is not {self.words}; write '{self.form.format(numbers[0])}'")
            return super().read(given)
        try:
            return Scaled(self.factor.read(match[1]), self.form)
        except ValueError as error:
            raise ValueError(f"{error}; write it as in '{self.scaled_example}'") from None

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the schema of the quantity with the multiple as another text."""
        found = super().__get_pydantic_json_schema__(schema, handler)
        scaled = {"type": "string", "description": self.words, "examples": [self.scaled_example]}
        return {"anyOf": [scaled, *found["anyOf"]]}


def _or_scaled(of: Any, form: str, factor: Quantity, words: str) -> QuantityOrScaled:
    (quantity,) = of.__metadata__
    return QuantityOrScaled(**vars(quantity), form=form, factor=factor, words=words)


_OF_STRAIN = STRAIN, _FACTOR, "a shear strain"
TimeOrStrain = Annotated[float | Scaled, _or_scaled(Time, *_OF_STRAIN)]
InstantOrStrain = Annotated[float | Scaled, _or_scaled(Instant, *_OF_STRAIN)]
SectorAngle = Annotated[float, _or_scaled(Angle, DIAMETERS, number("6", 0.0, 1e6, above=True), "a width in diameters")]
"""Of a checked scene always the angle, see `emclutch.scene.sector_checks.with_sector_angle`."""
