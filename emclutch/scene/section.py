"""Base of all sections of a scene: frozen, no unknown keys, entries checked in the user's words.

The model of a table has the table's name with the suffix `Section`, so that nobody takes `FreeShaftSection`, which is
what the file says, for `particles.bodies.FreeShaft`, which turns. Geometries, materials and courses in time are chosen
by a key of their table and have a name of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict
from pydantic_core import PydanticCustomError, core_schema

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler


# Between 0.67, a short key with two letters swapped ("gpa"), and 0.62, names that only share letters ("sphere" and
# "shear_cell"): a wrong guess is worse than none.
_CLOSE = 0.65


class Section(BaseModel):
    """A table of the scene file."""

    model_config = ConfigDict(frozen=True, extra="forbid", hide_input_in_errors=True)


@dataclass(frozen=True, slots=True)
class Choice:
    """One of some names. A planned name is known but not built, and is refused with that reason."""

    available: tuple[str, ...]
    planned: tuple[str, ...] = ()

    def refusal(self, given: object) -> str:
        """Return what is wrong with an entry that is not available."""
        return not_one_of(given, self.available, self.planned)

    def _validate(self, given: object) -> str:
        if isinstance(given, str) and given in self.available:
            return given
        raise PydanticCustomError("choice", "{message}", {"message": self.refusal(given)})

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._validate, serialization=core_schema.plain_serializer_function_ser_schema(str)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", "enum": list(self.available)}


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number within [minimum, maximum]."""

    minimum: int
    maximum: int
    example: str

    def _validate(self, given: object) -> int:
        if isinstance(given, bool) or not isinstance(given, int):
            bare = "write it without a unit and without quotes; " if isinstance(given, str) else ""
            message = f"is not a whole number; {bare}allowed: {self.minimum} to {self.maximum}, e.g. {self.example}"
        elif not self.minimum <= given <= self.maximum:
            message = f"is out of range; allowed: {self.minimum} to {self.maximum}, e.g. {self.example}"
        else:
            return given
        raise PydanticCustomError("whole", "{message}", {"message": message})

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.minimum, "maximum": self.maximum}


class Automatic:
    """Lets ``"auto"`` stand in for an optional entry; it is stored as None, and the program chooses."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(
            lambda given: None if given == "auto" else given, handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"const": "auto"}, handler(schema)]}


def did_you_mean(given: object, names: tuple[str, ...] | list[str]) -> str:
    """Return «did you mean 'gap'? » (with its trailing blank), or nothing where no name is close."""
    close = get_close_matches(str(given), names, n=1, cutoff=_CLOSE)
    return f"did you mean '{close[0]}'? " if close else ""


def not_one_of(given: object, available: tuple[str, ...], planned: tuple[str, ...] = ()) -> str:
    """Say why a name is refused: planned, or unknown with the nearest name; and what there is."""
    listed = "available: " + ", ".join(available)
    if given in planned:
        return f"is planned but not in this version; {listed}"
    return f"is unknown; {did_you_mean(given, list(available))}{listed}"


def refuse(message: str, key: str = "") -> PydanticCustomError:
    """Return the error of a rule between keys of one section; `key` names the one to blame, if any."""
    return PydanticCustomError("rule", "{message}", {"message": message, "key": key})
