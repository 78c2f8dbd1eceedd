"""Tables that users have measured: what was set in the first column, what was measured in each further one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError
from geometry.table_file import FileFault, read_table, split_heading

MEASURED = "measured.csv"
TORQUE_CURVE = "current [A]", "torque [N m]"
"""What the columns of a measured torque curve hold."""
OVER_RATED = "current over the rated one", "torque over the rated one"
"""What those of a curve that is divided by its point at a rated current hold."""


def read_measured(path: str | Path, along: str, values: str) -> dict[str, np.ndarray]:
    """Return the curves of a table, each column but the first over the first.

    `geometry.table_file` says how numbers and units may be written. An empty cell is a value that was not measured. A
    column whose name begins with "error" holds the standard errors of the column before it.

    Parameters
    ----------
    path : of the table.
    along, values : what the first column and the others are returned in, with the unit: "time [s]", "speed [rpm]". A
        column in another unit of the same quantity, as "torque [N cm]" or "current_mA", is converted. A speed in 1/min
        is in turns per minute. Without a unit, as in "torque over the rated one", pure numbers are wanted.

    Returns
    -------
    dict
        Name of the column without its unit -> (n, 2) first column and value, by the first column; (n, 3) with standard
        errors, nan where a value has none.

    Raises
    ------
    OutputError
        The file cannot be read or is no such table, as for `read_table`; it has one column, a column of errors that
        follows no measured one, or an error below 0.
    """
    goals = split_heading(along)[1], split_heading(values)[1]
    try:
        table = read_table(path, lambda place, name, unit: goals[place > 0], gaps=True)
    except FileFault as fault:
        raise OutputError(f"{path}: {fault.reason} (wanted: {along}; {values} in each further column)") from None
    if len(table.names) < 2:
        raise OutputError(f"{path} has one column; write {along} and a column of {values} for each curve")
    errors = {place for place, name in enumerate(table.names) if place and name.lower().startswith("error")}
    if any(place - 1 in {0, *errors} for place in errors):
        raise OutputError(f"{path}: a column of errors follows no measured one; write {values} before its errors")
    for place in errors:
        if (below := np.flatnonzero(table.values[:, place] < 0.0)).size:
            raise OutputError(f"{path}, line {table.lines[below[0]]}: an error is below 0; write one of at least 0")
    rows, curves = table.values[np.argsort(table.values[:, 0], kind="stable")], {}
    for place, name in enumerate(table.names):
        if place and place not in errors:
            points = rows[:, [0, place, place + 1] if place + 1 in errors else [0, place]]
            curves[name] = points[np.isfinite(points[:, 1])]
    return curves


def keep_measured(path: str | Path, folder: Path) -> None:
    """Copy a table of torque over current into the folder of a run or a study, whose picture draws it too.

    Raises as `read_measured`.
    """
    read_measured(path, *TORQUE_CURVE)
    replace_text(folder / MEASURED, Path(path).read_text(encoding="utf-8-sig"))


def measured_in(folder: Path) -> dict[str, np.ndarray] | None:
    """Return the curves of ``measured.csv`` of a run or a study, None without one; raises as `read_measured`."""
    return read_measured(folder / MEASURED, *TORQUE_CURVE) if (folder / MEASURED).is_file() else None
