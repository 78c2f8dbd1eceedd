"""A number of a result, defined once: its key in ``summary.json``, unit, label, and where it is shown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

RPM = 9.549296585513721
"""1/min in 1 rad/s: 30/pi."""
OPERATING_POINT, NUMBERS, BALANCES = "Operating point", "Numbers", "Balances"
"""Tables of the report on a run."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number of ``summary.json``.

    Attributes
    ----------
    key : str
        In the summary; names of nested tables and of their entries are joined by points.
    label : str
        For people; empty where it is not shown by itself.
    unit : str
        Of the value in the summary (SI); empty of a pure number.
    table : str
        Heading of the table of a report that shows it; empty: none.
    column : str
        Of ``study.csv``; empty: it is none.
    shown_in : (str, float)
        Unit for people, and the factor from `unit`; default: `unit`.
    of_last_window : bool
        Whether it is the value at the end of a run, which its label says where the current changes.
    """

    key: str
    label: str = ""
    unit: str = ""
    table: str = ""
    column: str = ""
    shown_in: tuple[str, float] | None = None
    of_last_window: bool = False

    def value(self, summary: Mapping[str, Any]) -> Any:
        """Return its value in a summary; None where that has none."""
        found: Any = summary
        for name in self.key.split("."):
            found = found.get(name) if isinstance(found, Mapping) else None
        return found

    def is_in(self, summary: Mapping[str, Any]) -> bool:
        """Return whether a summary has it, known or not."""
        return self.key.split(".")[0] in summary and (self.value(summary) is not None or "." not in self.key)

    def text(self, summary: Mapping[str, Any]) -> str:
        """Return its value with its unit; empty where it is unknown."""
        value, (unit, factor) = self.value(summary), self.shown_in or (self.unit, 1.0)
        return "" if value is None else f"{factor * value:.4g} {unit}".strip()


@dataclass(frozen=True, slots=True)
class Group:
    """Quantities that one function computes.

    Attributes
    ----------
    of : callable
        Of a finished run; returns the values by their keys, and leaves out what the run does not have.
    quantities : tuple of Quantity
    """

    of: Callable[[Any], dict[str, Any]]
    quantities: tuple[Quantity, ...]


def group(*quantities: Quantity) -> Callable[[Callable[[Any], dict[str, Any]]], Group]:
    """Return a decorator that makes a function the `Group` of the quantities that it computes."""
    return lambda function: Group(function, quantities)


def rows(quantities: Iterable[Quantity], table: str, summary: Mapping[str, Any], note: str = "") -> list[list[str]]:
    """Return label and value of the quantities of a table; `note` is added to the labels of values at a run's end."""
    shown = [one for one in quantities if one.table == table and one.label]
    found = [(f"{one.label}{note if one.of_last_window else ''}", one.text(summary)) for one in shown]
    return [[label, text] for label, text in found if text]
