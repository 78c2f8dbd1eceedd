"""Errors of a scene, reported all at once, each with key, entry and remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]")  # all but the line break


def entry_at(data: Any, path: Sequence[str | int]) -> Any:
    """Return the user's entry at a path, or None where there is none."""
    for step in path:
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            return None
    return data


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong with a scene, a study or a command.

    Attributes
    ----------
    key : dotted key, e.g. ``"geometry.gap"``; empty where the fault belongs to no key (an unreadable file)
    value : the entry as the user gave it, ``repr``-like; empty where there is none (a missing key)
    message : what is wrong, what is allowed and what to do; reads on from «key = value»
    """

    key: str
    value: str
    message: str

    def __str__(self) -> str:
        entry = f"{self.key} = {self.value}" if self.key and self.value else self.key
        # as they are written in TOML: a terminal would obey control characters that stand in a key
        return _CONTROL.sub(lambda found: ascii(found[0])[1:-1], f"{entry} {self.message}".strip())


class SceneError(Exception):
    """A scene, a study or an option is not valid. The command line ends with exit code 2.

    Attributes
    ----------
    faults : tuple of Fault
        All faults that were found, each with key, value and remedy.
    source : str
        Name of the file at fault.
    """

    def __init__(self, faults: Iterable[Fault], source: str = "scene") -> None:
        self.faults = tuple(faults)
        self.source = source
        super().__init__(self.report())

    def report(self) -> str:
        """All faults, a line each, under the name of the file."""
        count = "1 error" if len(self.faults) == 1 else f"{len(self.faults)} errors"
        return "\n".join([f"{self.source}: {count}", *(f"  - {fault}" for fault in self.faults)])


def no_argument(name: str, function: str, names: Sequence[str]) -> SceneError:
    """Return the error of an argument that a function does not have, with the nearest of its names."""
    close = get_close_matches(name, names, n=1)
    hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(names)}"
    return SceneError([Fault(name, "", f"is no argument of {function}; {hint}")], "arguments")


@contextmanager
def bad_input_for(file: Path | None) -> Iterator[None]:
    """Take a ValueError for a fault of the scene: the planning functions raise it with a remedy."""
    try:
        yield
    except ValueError as error:
        raise SceneError([Fault("", "", str(error))], "scene" if file is None else str(file)) from error


def shown(value: object, limit: int = 60) -> str:
    """Return an entry as a fault shows it: as in the TOML file, cut where it is long."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        text = "{" + ", ".join(str(key) for key in value) + "}"
    else:
        text = repr(value)
    return text if len(text) <= limit else text[: limit - 4] + " ..."


def reason_of(error: ValueError | OSError) -> str:
    """Return why a file cannot be used, without its path: a fault shows it already."""
    return str(getattr(error, "reason", None) or getattr(error, "strerror", None) or error)
