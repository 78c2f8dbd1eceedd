"""A column of a history: its name, which knows its unit, its meaning and the instant or interval that it is of."""

from __future__ import annotations

from enum import Enum


class When(Enum):
    """What a column of a window's row is of; the value is how the reference says it."""

    END = "instant: end of the window"
    FIELD = "instant: last solve of the field"
    MOMENTS = "instant: last evaluation of the moments"
    MEAN = "mean over the window"
    SUM = "sum over the window"
    LARGEST = "largest of the window"


class Column(str):
    """Name of a column of ``history.csv``, so that ``history[column]`` is the column.

    Attributes
    ----------
    unit : str
        SI; "1" where it has none.
    meaning : str
    when : When
    """

    __slots__ = ("meaning", "unit", "when")
    unit: str
    meaning: str
    when: When

    def __new__(cls, name: str, unit: str = "1", meaning: str = "", when: When = When.END) -> Column:
        """Make the column of a name."""
        column = super().__new__(cls, name)
        column.unit, column.meaning, column.when = unit, meaning, when
        return column
