"""Tables that users have measured: what was set in the first column, what was measured in each further one."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError
from emclutch.scene.errors import reason_of

MEASURED = "measured.csv"
TORQUE_CURVE = "current [A]", "torque [N m]"
"""What the columns of a measured torque curve hold."""
_FORCE, _ARM = r"(?:[mkM]?N|dyn|k?gf?|kp|lbf?|ozf?)", r"(?:[uµmcdk]?m|in|ft)"
_UNITS = {
    "current": "[nuµmk]?A",
    "torque": rf"{_FORCE}[\s_.·*-]?{_ARM}|{_ARM}[\s_.·*-]?{_FORCE}",
    "time": "[nuµm]?s|min|h",
    "speed": r"rpm|rps|Hz|1/(?:min|s)|(?:rad|deg)[\s_/]?s",
}
"""How the units of a quantity are written at the end of a name without brackets."""


def read_measured(path: str | Path, along: str, values: str) -> dict[str, np.ndarray]:
    """Return the curves of a table, each column but the first over the first.

    The first line holds the columns' names; lines before it that begin with # are comments. Columns are parted by
    commas, semicolons or tabs; with the latter two a comma may be the decimal sign. An empty cell is a value that was
    not measured. A column whose name begins with "error" holds the standard errors of the column before it.

    Parameters
    ----------
    path : of the table.
    along, values : what the first column and the others hold, with the unit: "time [s]", "speed [rpm]".

    Returns
    -------
    dict
        Name of the column -> (n, 2) first column and value, by the first column; (n, 3) with standard errors, nan where
        a value has none.

    Raises
    ------
    OutputError
        The file cannot be read; the table has no names, fewer than two columns, a name that ends in another unit, as
        "torque [N cm]" or "torque_Ncm" do, a cell that is no number, or an error below 0; with the line.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise OutputError(f"{path} cannot be read ({reason_of(error)}); name a measured table (.csv)") from None
    head = next((number for number, line in enumerate(lines) if not line.startswith("#")), len(lines))
    first = lines[head] if head < len(lines) else ""
    separator = next((mark for mark in ";\t" if mark in first), ",")
    rows = list(csv.reader(io.StringIO("\n".join(lines[head:])), delimiter=separator))
    names = [name.strip() for name in rows[0]] if rows else []
    if len(names) < 2 or any(_number(name, separator) is not None for name in names):
        raise OutputError(
            f"{path}: the first line is '{first.strip()}'; it must name the columns, e.g. {along}{separator}first"
            f"{separator}second, with each {values} below its name"
        )
    for name, wanted in zip(names, [along] + [values] * (len(names) - 1), strict=True):
        quantity = wanted.split()[0]
        unit = _unit(name, quantity)
        if unit is not None and _letters(unit) != _letters(_unit(wanted, quantity) or ""):
            raise OutputError(f"{path}: column {name!r} is in {unit}; it must be {wanted}: convert it, and its name")
    errors = {number for number, name in enumerate(names) if number and name.lower().startswith("error")}
    if any(number - 1 in {0, *errors} for number in errors):
        raise OutputError(f"{path}: a column of errors follows no measured one; write {values} before its errors")
    found: dict[str, list[tuple[float, ...]]] = {name: [] for k, name in enumerate(names) if k and k not in errors}
    for line, row in enumerate(rows[1:], start=head + 2):
        if not any(cell.strip() for cell in row):
            continue
        numbers = [_number(cell, separator) for cell in row]
        if len(row) != len(names) or numbers[0] is None:
            wanted = f"{along} and {len(names) - 1} values of {values}"
            raise OutputError(f"{path}, line {line}: {separator.join(row)!r} is not a {wanted}")
        for number, (name, cell, value) in enumerate(zip(names, row, numbers, strict=True)):
            if cell.strip() and (value is None or (number in errors and value < 0.0)):
                wanted = "an error of at least 0" if number in errors else "a number"
                raise OutputError(f"{path}, line {line}: {cell.strip()!r} in column {name!r} is not {wanted}")
            if name in found and value is not None:
                own = numbers[number + 1 : number + 2] if number + 1 in errors else []
                found[name].append((numbers[0], value, *(np.nan if one is None else one for one in own)))
    width = {name: 3 if number + 1 in errors else 2 for number, name in enumerate(names)}
    return {name: np.array(sorted(points)).reshape(-1, width[name]) for name, points in found.items()}


def read_band(path: str | Path) -> np.ndarray:
    """Return a predicted band, (n, 4): current [A], and low, middle and high torque [N m], by the current.

    The table is one of `read_measured` whose columns after the current are low, middle and high.

    Raises
    ------
    OutputError
        As `read_measured`; other columns, fewer than two currents, ends that are not in order.
    """
    along, values = "current [A]", "torque [N m]"
    found = {name.partition("[")[0].strip(): points for name, points in read_measured(path, along, values).items()}
    names = ("low", "middle", "high")
    if set(found) != set(names) or len({len(found[name]) for name in names}) > 1 or len(found["low"]) < 2:
        raise OutputError(f"{path}: a band has the columns {along}, {', '.join(names)}, each with two currents or more")
    band = np.column_stack([found["low"], *(found[name][:, 1] for name in names[1:])])
    wrong = np.flatnonzero((band[:, 1] > band[:, 2]) | (band[:, 2] > band[:, 3]))
    if wrong.size:
        low, middle, high = band[wrong[0], 1:]
        raise OutputError(
            f"{path}: at {band[wrong[0], 0]:g} A low, middle and high are {low:g}, {middle:g}, {high:g} N m; they must "
            "not fall"
        )
    return band


def keep_measured(path: str | Path, folder: Path) -> None:
    """Copy a table of torque over current into a study's folder, whose picture lays it over; raises as `read_measured`.
    """
    read_measured(path, *TORQUE_CURVE)
    replace_text(folder / MEASURED, Path(path).read_text(encoding="utf-8-sig"))


def measured_in(folder: Path) -> dict[str, np.ndarray] | None:
    """Return the curves of a study's ``measured.csv``; None where it has none. Raises as `read_measured`."""
    return read_measured(folder / MEASURED, *TORQUE_CURVE) if (folder / MEASURED).is_file() else None


def _unit(name: str, quantity: str) -> str | None:
    """Return the unit of "torque [N m]", "torque_Nm" or "torque (N m)"; None where none of the quantity ends the name.

    A torque named "brake_A" is that of brake A.
    """
    found = re.search(r"\[([^\]]*)\]\s*$", name)
    if found is None:
        found = re.search(rf"(?:^|[\s_(])({_UNITS[quantity]})\)?$", name, re.IGNORECASE)
    return None if found is None else found[1].strip()


def _letters(unit: str) -> str:
    """Return a unit without what parts its factors and without capitals: "N m", "N_m" and "Nm" are one."""
    return re.sub(r"[\s_.·*-]", "", unit).lower()


def _number(cell: str, separator: str) -> float | None:
    try:
        value = float(cell if separator == "," else cell.replace(",", "."))
    except ValueError:
        return None
    return value if np.isfinite(value) else None
