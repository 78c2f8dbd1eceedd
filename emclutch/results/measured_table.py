"""Tables that users have measured: what was set in one column, what was measured in others, with their errors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from emclutch.results.atomic_file import replace_bytes
from emclutch.results.errors import OutputError
from geometry.table_file import (
    FileFault,
    TableFile,
    headings,
    is_error,
    is_unit_of,
    read_table,
    split_heading,
    units_meant,
)

MEASURED = "measured.csv"
TORQUE_CURVE = "current [A]", "torque [N m]"
"""What the columns of a measured torque curve hold."""
OVER_RATED = "current over the rated one", "torque over the rated one"
"""What those of a curve that is divided by its point at a rated current hold."""
_ALONG = re.compile(r"\b(current|strom|time|zeit|speed|drehzahl|drive|[iIt])\b", re.I)
_EXPANDED = re.compile(r"\b9[59]|\b[23] ?(sigma|σ|std|sd)|\bk ?= ?[23]|expanded|erweitert", re.I)


def read_measured(path: str | Path, along: str, values: str) -> dict[str, np.ndarray]:
    """Return the curves of a table, each column of `values` over the one of `along`; warn of columns that are not used.

    `geometry.table_file` says how numbers and units may be written. The columns are found by their units, in any order.
    An empty cell is a value that was not measured. A column that is named as an error (`geometry.table_file.is_error`)
    holds the standard errors, one sigma, of the nearest measured column before it, or these in per cent of its values.

    Parameters
    ----------
    path : of the table.
    along, values : what the columns are returned in, with the unit: "time [s]", "speed [rpm]". A column in another unit
        of the same quantity, as "torque [N cm]" or "current_mA", is converted. A speed in 1/min is in turns per minute.
        Without a unit, as in "torque over the rated one", pure numbers are wanted, those of `along` first.

    Returns
    -------
    dict
        Name of the column without its unit -> (n, 2) along and value, ascending; (n, 3) with standard errors, nan where
        a value has none.

    Raises
    ------
    OutputError
        The file cannot be read or is no such table, as for `read_table`; it has no column of values, errors that follow
        none or are below 0, or errors that are expanded, as those of 95 %.
    """
    curves, table = _read(path, along, values)
    table.warn_of_unused()
    return curves


def _read(path: str | Path, along: str, values: str) -> tuple[dict[str, np.ndarray], TableFile]:
    """Return the curves, and the table that they are read from."""
    goals = split_heading(along)[1], split_heading(values)[1]
    example = f"'{along}; {values}'"
    try:
        heads = headings(path, example)
        first, errors, used = _columns(path, heads, goals)
        table = read_table(path, lambda place, *_: used.get(place), gaps=True, key=first, example=example)
    except FileFault as fault:
        raise OutputError(f"{path}: {fault.reason} (wanted: {along}; {values} in each further column)") from None
    if len(used) < 2:
        raise OutputError(f"{path} has one column; write {along} and a column of {values} for each curve")
    column = {place: table.values[:, k] for k, place in enumerate(sorted(used))}
    x, curves = column.pop(first), {}
    order = np.argsort(x, kind="stable")
    for place in sorted(column.keys() - {one for one, _ in errors.values()}):
        columns = [x, column[place]]
        if place in errors:
            at, is_relative = errors[place]
            error = column[at] * np.abs(column[place]) if is_relative else column[at]
            if (below := np.flatnonzero(error < 0.0)).size:
                raise OutputError(f"{path}, line {table.lines[below[0]]}: an error is below 0; write one of at least 0")
            columns.append(error)
        points = np.column_stack(columns)[order]
        curves[heads[place][0]] = points[np.isfinite(points[:, 1])]
    return curves, table


def _columns(
    path: str | Path, heads: list[tuple[str, str]], goals: tuple[str, str]
) -> tuple[int, dict[int, tuple[int, bool]], dict[int, str]]:
    """Return the place of what was set, of each column with errors theirs and whether they are relative, and all units.

    A column in a wrong unit is among those with a unit where there were none otherwise, to be refused.
    """
    along, goal = goals

    def holds(place: int, wanted: str) -> bool:
        name, unit = heads[place]
        return bool(name and (is_unit_of(unit, wanted) or units_meant(unit, wanted)))

    places = [place for place, (name, _) in enumerate(heads) if name]
    named = [place for place in places if _ALONG.search(heads[place][0].replace("_", " "))]
    found = [place for place in places if along and holds(place, along) and not is_error(heads[place][0])]
    first = next(iter([*(k for k in found if k in named), *found, *(named if along else []), *places]), 0)
    used, errors, last = {first: along}, {}, -1
    for place, (name, unit) in enumerate(heads):
        if place == first or not (holds(place, goal) or (is_error(name) and (not unit or is_unit_of(unit, "1")))):
            continue
        if not is_error(name):
            last, used[place] = place, goal
            continue
        shown = f"{path}: '{name}'"
        if _EXPANDED.search(name.replace("_", " ")):
            name = f"error [{goal}]" if goal else "error"
            remedy = f"divide its values by 1.96, or by its factor k, and name the column '{name}'"
            raise OutputError(f"{shown} is no standard error (one sigma); {remedy}")
        if last < 0 or last in errors:
            reason = "is a second column of errors" if last in errors else "has errors but follows no measured column"
            bare = [one for one, unit in heads[1:place] if one and not unit and not is_error(one)]
            remedy = f"write the unit of '{bare[-1]}', e.g. '{bare[-1]} [{goal}]'" if bare and goal else (
                "write each measured column before its errors")  # fmt: skip
            raise OutputError(f"{shown} {reason}; {remedy}")
        of_value = is_unit_of(unit, "1") if goal else unit == "%" != heads[last][1]
        errors[last] = place, bool(unit and of_value) or (not unit and name.lower().startswith("rel"))
        used[place] = "1" if errors[last][1] else goal
    if len(used) == 1 and len(places) > 1:
        used[next(place for place in places if place != first)] = goal
    return first, errors, used


def keep_measured(path: str | Path, folder: Path) -> None:
    """Copy a table of torque over current into the folder of a run or a study, whose picture draws it too.

    Raises as `read_measured`.
    """
    _read(path, *TORQUE_CURVE)
    replace_bytes(folder / MEASURED, Path(path).read_bytes())


def measured_in(folder: Path) -> dict[str, np.ndarray] | None:
    """Return the curves of ``measured.csv`` of a run or a study, None without one; raises as `read_measured`."""
    return _read(folder / MEASURED, *TORQUE_CURVE)[0] if (folder / MEASURED).is_file() else None
