"""The points of a study as one `xarray.Dataset`: torque, its interval, verdict and cost over the study's values.

A study whose points are every combination of its values is a grid: each key with several values is a dimension. Points
that were sampled are none; they lie along the dimension ``point``, and the keys are coordinates along it. The values of
``scene.seed`` are the dimension ``replica`` of both.

A key's coordinate has numbers where all its entries are numbers, or numbers with one unit, which is the coordinate's
attribute ``units`` then; other entries (``"off"``, tables, several units) stand there as text. Points that are not done
are nan, empty or false, and false in ``done``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.util import find_spec
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.errors import OutputError
from emclutch.results.study_folder import AFTER_VALUES, UNITS

if TYPE_CHECKING:
    import pandas
    import xarray

    from emclutch.results.study_result import StudyResult

REPLICA, POINT, DONE = "replica", "point", "done"
SEED = "scene.seed"
MEANINGS = {
    "torque": "steady torque on the disc",
    "standard_error": "standard error of the torque",
    "low": "lower end of the torque's 95 % interval",
    "high": "upper end of the torque's 95 % interval",
    "drag_torque": "torque on the disc by the drag of seals and bearings, given without an interval of its own",
    "torque_with_drag": "torque on the disc's shaft; its interval is that of the torque, moved by the drag",
    "converged": "whether the steady torque is known",
    "reason": "why it is known, or not",
    "seconds": "wall-clock time of the run",
    "shear_stress": "shear stress of the powder",
    DONE: "whether the point is done",
}
MISSING = {"f": np.nan, "b": False, "O": ""}
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_NUMBER_AND_UNIT = re.compile(rf"({_NUMBER.pattern})(\s*[^\d\s].*)?")


def refuse_without_xarray() -> None:
    """Raise OutputError, with the line that installs it, where there is no xarray."""
    if find_spec("xarray") is None:
        raise OutputError("a study as one object needs the package xarray: pip install 'emclutch[xarray]'")


def dataset_of(study: StudyResult) -> xarray.Dataset:
    """Return the points of a study as one object, see the module.

    Raises
    ------
    OutputError
        There is no xarray.
    """
    refuse_without_xarray()
    import xarray

    table = study.table
    keys = list(table.columns[: list(table.columns).index(AFTER_VALUES)])
    listed = {key: study.values.get(key) or list(dict.fromkeys(table[key])) for key in keys}
    several = [key for key in keys if len(listed[key]) > 1] or keys
    is_grid = prod(len(listed[key]) for key in keys) == (study.total if study.values else len(table))
    along = {REPLICA if key == SEED else key: [key] for key in several}
    if not is_grid:
        replicas = {REPLICA: along.pop(REPLICA)} if REPLICA in along else {}
        along = {POINT: [key for key in several if key != SEED]} | replicas
    entries = {name: list(dict.fromkeys(_rows(table[of]))) for name, of in along.items()}
    if is_grid:  # also what is not done yet, in the study's order
        entries = {name: [(one,) for one in dict.fromkeys(map(_text, listed[key]))] for name, (key,) in along.items()}
    shape = tuple(map(len, entries.values()))
    places = {name: {row: place for place, row in enumerate(rows)} for name, rows in entries.items()}
    where = tuple(np.array([places[name][row] for row in _rows(table[of])], dtype=int) for name, of in along.items())
    columns = {DONE: np.ones(len(table), bool)} | {name: _values_of(table[name]) for name in table.columns[len(keys) :]}
    variables = {}
    for name, values in columns.items():
        whole = np.full(shape, MISSING[values.dtype.kind], dtype=values.dtype)
        whole[where] = values
        attributes = {"units": UNITS.get(name), "long_name": MEANINGS.get(name)}
        variables[name] = (tuple(along), whole, {key: text for key, text in attributes.items() if text})
    coordinates: dict[str, Any] = {}
    for name, of in along.items():
        for key, column in zip(of, zip(*entries[name], strict=True), strict=True):
            coordinates[REPLICA if key == SEED else key] = ((name,), *_coordinate(column))
    for key in keys:
        if key not in several:
            (value,), unit = _coordinate([_text(listed[key][0])])
            coordinates[key] = ((), value, unit)
    return xarray.Dataset(variables, coordinates, {"title": study.title})


def _rows(table: pandas.DataFrame) -> list[tuple[str, ...]]:
    return list(zip(*(map(_text, table[name]) for name in table.columns), strict=True))


def _text(value: Any) -> str:
    """Return an entry as text that is the same for a list's entry and for what a table holds of it."""
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool):
        return f"{float(value):.15g}"
    text = str(value)
    return f"{float(text):.15g}" if _NUMBER.fullmatch(text) else text


def _values_of(column: pandas.Series) -> np.ndarray:
    """Return a column as numbers (float), truth values, or texts."""
    if column.dtype.kind in "iuf":
        return column.to_numpy(dtype=float)
    if column.dtype.kind == "b":
        return column.to_numpy(dtype=bool)
    if not column.notna().any():
        return np.full(len(column), np.nan)
    return np.array(["" if one != one else str(one) for one in column], dtype=object)


def _coordinate(entries: Sequence[str]) -> tuple[np.ndarray, dict[str, str]]:
    """Return entries as numbers with their unit where they have one, else as they are."""
    if (found := number_and_unit(entries)) is None:
        return np.array(entries, dtype=object), {}
    return found[0], {"units": found[1]} if found[1] else {}


def number_and_unit(entries: Sequence[str]) -> tuple[np.ndarray, str] | None:
    """Return entries of a key as numbers, and the unit that they have in common; None where they are none."""
    found = [_NUMBER_AND_UNIT.fullmatch(entry) for entry in entries]
    units = {match and (match[2] or "").strip() for match in found}
    if len(units) != 1 or None in units:
        return None
    return np.array([float(match[1]) for match in found if match]), str(units.pop())
