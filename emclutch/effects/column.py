"""A column of a history: its name, which knows its unit and its meaning."""

from __future__ import annotations


class Column(str):
    """Name of a column of ``history.csv``, so that ``history[column]`` is the column.

    Attributes
    ----------
    unit : str
        SI; "1" where it has none.
    meaning : str
    """

    __slots__ = ("meaning", "unit")
    unit: str
    meaning: str

    def __new__(cls, name: str, unit: str = "1", meaning: str = "") -> Column:
        """Make the column of a name."""
        column = super().__new__(cls, name)
        column.unit, column.meaning = unit, meaning
        return column
