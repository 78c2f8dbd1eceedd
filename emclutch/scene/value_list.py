"""Values of a quantity as text: one, a list, a range."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Annotated, Any

from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.units import Quantity, quantity_of

RANGE_POINTS = 16
"""Values of a range without a count."""
_DECIMAL_COMMA = re.compile(r"(?:^|[\s,:])([+-]?\d+),(\d+)")
"""A whole number and digits beyond a comma: 0,5 of "0,5 A", or two numbers of a list, which nobody can tell."""
_WallTime = Annotated[float, Quantity("a time", "s", "20 min", 0.0, 1e8, open_minimum=True)]


def number_or_text(text: str) -> str | float:
    """Return a bare number, which is in SI as in a scene, or the text with its unit."""
    try:
        return float(text)
    except ValueError:
        return text.strip()


def split_list(text: str, option: str, source: str = "command line") -> list[str]:
    """Return the entries between the commas of a text; SceneError where one may be a decimal comma."""
    if found := _DECIMAL_COMMA.search(text):
        whole, digits = found.groups()
        message = f"has a decimal comma; decimals follow a point: {whole}.{digits}; "
        message += "in a list a number has a unit, or a blank after its comma"
        raise SceneError([Fault(option, shown(text), message)], source)
    return text.split(",")


def read_list(
    text: str, quantity: Quantity, option: str, count: int | None = None, source: str = "command line"
) -> list[float]:
    """Return numbers in SI of a list ``18 kA/m, 80 kA/m``, in which ranges ``first : last : count`` may stand.

    With `count` a text may be a range ``first : last`` of so many.

    Raises
    ------
    SceneError
        With every entry that cannot be read.
    """
    parts = split_list(text, option, source)
    if len(parts) > 1 and ":" in text:
        return [value for part in parts for value in read_list(part, quantity, option, source=source)]
    if ":" not in text:
        return read_all(parts, quantity, option, source)
    first, *others = text.split(":")
    if count is not None and len(others) == 1:
        others.append(str(count))
    if len(others) != 2 or not others[1].strip().isdigit() or int(others[1]) < 2:
        message = f"is not a list or a range; write '{quantity.example}, ...' or first : last : count"
        raise SceneError([Fault(option, shown(text), message)], source)
    import numpy as np

    low, high = read_all([first, others[0]], quantity, option, source)
    return np.linspace(low, high, int(others[1])).tolist()


def values_of(given: float | str | Iterable[float | str], kind: Any, name: str) -> list[float]:
    """Return an argument `name` of a function in SI: one or several numbers in SI, or texts with a unit.

    One text may be a list or a range, as of `read_list`. `kind` is an annotated type of `emclutch.scene.units`, or a
    Quantity. SceneError with every entry that cannot be read.
    """
    quantity = kind if isinstance(kind, Quantity) else quantity_of(kind)
    if isinstance(given, str):
        return read_list(given, quantity, name, source="arguments")
    entries = list(given) if isinstance(given, Iterable) else [given]
    if not entries:
        message = f"is empty; give a value such as {quantity.example!r}"
        raise SceneError([Fault(name, shown(given), message)], "arguments")
    return read_all([str(one) for one in entries], quantity, name, "arguments")


def seconds_of(given: float | str | None, name: str) -> float | None:
    """Return an argument `name` that is a time, such as 1200 or "20 min", in seconds; None stays None."""
    return None if given is None else values_of(given, _WallTime, name)[0]


def read_all(entries: list[str], quantity: Quantity, option: str, source: str = "command line") -> list[float]:
    """Return entries in SI; SceneError with every one that cannot be read."""
    values, faults = [], []
    for entry in entries:
        try:
            values.append(quantity.read(number_or_text(entry)))
        except ValueError as error:
            faults.append(Fault(option, shown(entry.strip()), str(error)))
    if faults:
        raise SceneError(faults, source)
    return values
