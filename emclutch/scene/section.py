"""Base of all sections of a scene: frozen, no unknown keys, entries checked in the user's words.

The model of a table has the table's name with the suffix `Section`, so that nobody takes `FreeShaftSection`, which is
what the file says, for `particles.bodies.FreeShaft`, which turns. Geometries, materials and courses in time are chosen
by a key of their table and have a name of their own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, ClassVar

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
    file_keys: ClassVar[tuple[str, ...]] = ()
    """Keys that name a file, in place of others that are read from it."""


class Entry(ABC):
    """Mark on the type of a key: reads the user's entry and describes what may stand there.

    Errors, the reference of all keys and commented scenes ask it; they know none of its kinds by name.
    """

    STORED: ClassVar[type]
    """Type of the value as it is stored."""

    @property
    @abstractmethod
    def kind_text(self) -> str:
        """Kind of entry, for the reference: ``length [m]``."""

    @property
    def range_text(self) -> str:
        """Allowed range; empty where there is none."""
        return ""

    @property
    @abstractmethod
    def sample(self) -> Any:
        """A valid entry, as TOML reads it."""

    @abstractmethod
    def needed_for(self, key: str) -> str:
        """Return what to write where the key is missing."""

    @abstractmethod
    def read(self, given: object) -> Any:
        """Return an entry as it is stored.

        Raises
        ------
        ValueError
            It is not allowed. The message follows on the key and the entry, as in ``geometry.gap = '3 kg' is a mass;
            a length is needed, e.g. '1 mm'``.
        """

    def written(self, value: Any) -> Any:
        """Return a value as it stands in the file of a resolved scene."""
        return self.STORED(value)

    def _validate(self, given: object) -> Any:
        try:
            return self.read(given)
        except ValueError as error:
            raise refuse(str(error)) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._validate, serialization=core_schema.plain_serializer_function_ser_schema(self.written)
        )


@dataclass(frozen=True)
class Choice(Entry):
    """One of some names.

    Attributes
    ----------
    available : what may be chosen
    planned : known but not built; refused with that reason
    elsewhere : (name, why it is refused) of names that belong to another key, or of former ones
    """

    available: tuple[str, ...]
    planned: tuple[str, ...] = ()
    elsewhere: tuple[tuple[str, str], ...] = ()

    STORED = str

    @property
    def kind_text(self) -> str:
        return "one of " + ", ".join(f'`"{name}"`' for name in self.available)

    @property
    def sample(self) -> str:
        return self.available[0]

    def needed_for(self, key: str) -> str:
        return f"give one of {', '.join(self.available)}"

    def read(self, given: object) -> str:
        """Return the name; ValueError for one that is not available."""
        if isinstance(given, str) and given in self.available:
            return given
        for name, reason in self.elsewhere:
            if str(given).lower() == name:
                raise ValueError(f"{reason}; available: {', '.join(self.available)}")
        raise ValueError(not_one_of(given, self.available, self.planned))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", "enum": list(self.available)}


@dataclass(frozen=True)
class Integer(Entry):
    """A whole number within [minimum, maximum]."""

    minimum: int
    maximum: int
    example: str

    STORED = int
    kind_text = "whole number"

    @property
    def range_text(self) -> str:
        return f"{self.minimum} to {self.maximum}"

    @property
    def sample(self) -> int:
        return int(self.example)

    def needed_for(self, key: str) -> str:
        return f"a whole number is needed, e.g. {key} = {self.example}"

    def read(self, given: object) -> int:
        """Return the number; ValueError for anything else, and outside of the range."""
        if isinstance(given, bool) or not isinstance(given, int):
            bare = "write it without a unit and without quotes; " if isinstance(given, str) else ""
            raise ValueError(f"is not a whole number; {bare}allowed: {self.range_text}, e.g. {self.example}")
        if not self.minimum <= given <= self.maximum:
            raise ValueError(f"is out of range; allowed: {self.range_text}, e.g. {self.example}")
        return given

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


def value_or_table(given: Any) -> str:
    """Discriminate a union of an entry, tagged ``value``, and a model in its place, tagged ``table``."""
    return "table" if isinstance(given, (dict, BaseModel)) else "value"


def did_you_mean(given: object, names: tuple[str, ...] | list[str]) -> str:
    """Return «did you mean 'gap'? » (with its trailing blank), or nothing where no name is close."""
    close = get_close_matches(str(given), names, n=1, cutoff=_CLOSE)
    return f"did you mean '{close[0]}'? " if close else ""


_FACES = "a disc between the rotor's faces is kind 'clutch', "
OTHER_WORDS = {
    "disc": ("clutch", f"{_FACES}a disc with powder at its rim alone kind 'drum'; "),
    "disk": ("clutch", f"{_FACES}a disc with powder at its rim alone kind 'drum'; "),
    "brake": ("clutch", "a brake is kind 'clutch' (or 'drum') with [motion.disc] speed = 0; "),
}
"""Words for the shape of a device: its kind, and what to write in a scene, where the word is refused."""


def not_one_of(given: object, available: tuple[str, ...], planned: tuple[str, ...] = ()) -> str:
    """Say why a name is refused: planned, or unknown with the nearest name; and what there is."""
    listed = "available: " + ", ".join(available)
    if given in planned:
        return f"is planned but not in this version; {listed}"
    kind, words = OTHER_WORDS.get(str(given).lower(), ("", ""))
    hint = words if kind in available else did_you_mean(given, list(available))
    return f"is unknown; {hint}{listed}"


def refuse(message: str, key: str = "") -> PydanticCustomError:
    """Return the error of a rule between keys of one section; `key` names the one to blame, if any."""
    return PydanticCustomError("rule", "{message}", {"message": message, "key": key})
