"""Tables that users have measured: what was set in the first column, what was measured in each further one."""

from __future__ import annotations

import csv
import re
from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError
from emclutch.scene.errors import reason_of
from emclutch.scene.units import factor_between

MEASURED = "measured.csv"
TORQUE_CURVE = "current [A]", "torque [N m]"
"""What the columns of a measured torque curve hold."""
OVER_RATED = "current over the rated one", "torque over the rated one"
"""What those of a curve that is divided by its point at a rated current hold."""
_FORCE, _ARM = r"(?:[mkM]?N|dyn|k?gf?|kp|lbf?|ozf?)", r"(?:[uµmcdk]?m|in|ft)"
_UNITS = {
    "current": "[nuµmk]?A",
    "torque": rf"{_FORCE}[\s_.·*-]?{_ARM}|{_ARM}[\s_.·*-]?{_FORCE}",
    "time": "[nuµm]?s|min|h",
    "speed": r"rpm|rps|Hz|1/(?:min|s)|min(?:\^?-1|⁻¹)|(?:rad|deg)[\s_/]?s",
}
"""How the units of a quantity are written at the end of a name without brackets."""
_TORQUES, _PER_MINUTE = ("mN m", "kN m", "N mm", "N cm"), ("1/min", "min-1", "min^-1", "min⁻¹")
_SPELLINGS = {unit.replace(" ", ""): unit for unit in _TORQUES} | dict.fromkeys(_PER_MINUTE, "rpm")
"""Usual spelling -> one that `factor_between` reads; of 1/min, turns are meant."""


def read_measured(path: str | Path, along: str, values: str, *, needs_units: bool = False) -> dict[str, np.ndarray]:
    """Return the curves of a table, each column but the first over the first.

    The first line holds the columns' names; empty lines, and those that begin with #, are skipped. Columns are parted
    by commas, semicolons or tabs; with the latter two a comma may be the decimal sign. An empty cell is a value that
    was not measured. A column whose name begins with "error" holds the standard errors of the column before it.

    Parameters
    ----------
    path : of the table.
    along, values : what the first column and the others are returned in, with the unit: "time [s]", "speed [rpm]". A
        column whose name has another unit of the same quantity, as "torque [N cm]" or "current_mA", is converted; one
        without a unit is taken as it is, and errors without one are in the unit of their column. A speed in 1/min is in
        turns per minute.
    needs_units : whether a name without a unit is refused.

    Returns
    -------
    dict
        Name of the column, with the unit that it is returned in -> (n, 2) first column and value, by the first column;
        (n, 3) with standard errors, nan where a value has none.

    Raises
    ------
    OutputError
        The file cannot be read; the table has no names, fewer than two columns, two of one name and unit, a name that
        ends in the unit of another quantity, in none that is known, as "torque_lbin" does, or in one with wrong
        capitals, as "current_MA" does, a cell that is no number, or an error below 0; with the line.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise OutputError(f"{path} cannot be read ({reason_of(error)}); name a measured table (.csv)") from None
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"]
    first = numbered[0][1] if numbered else ""
    separator = next((mark for mark in ";\t" if mark in first), ",")
    reader, begins = csv.reader((line + "\n" for _, line in numbered), delimiter=separator, strict=True), [0]
    rows = []
    try:
        for row in reader:  # of several lines where quotes hold a line break
            rows.append(row)
            begins.append(reader.line_num)
    except csv.Error as error:
        raise OutputError(
            f"{path}, line {numbered[begins[-1]][0]}: {error}; look for a quote that is not closed"
        ) from None
    names = [" ".join(name.split()) for name in rows[0]] if rows else []
    if len(names) < 2 or any(_number(name, separator) is not None for name in names):
        raise OutputError(
            f"{path}: the first line is '{first.strip()}'; it must name the columns, e.g. {along}{separator}first"
            f"{separator}second, with each {values} below its name"
        )
    factors = [1.0] * len(names)
    for number, wanted in enumerate([along] + [values] * (len(names) - 1)):
        factor, names[number] = _in_unit_of(path, names[number], wanted, needs_units)
        of_column = factors[number - 1] if number and names[number].lower().startswith("error") else 1.0
        factors[number] = of_column if factor is None else factor
    errors = {number for number, name in enumerate(names) if number and name.lower().startswith("error")}
    if any(number - 1 in {0, *errors} for number in errors):
        raise OutputError(f"{path}: a column of errors follows no measured one; write {values} before its errors")
    curves = [name for number, name in enumerate(names) if number and number not in errors]
    repeated = [name for name, count in Counter(curves).items() if name and count > 1]
    if repeated:
        raise OutputError(f"{path}: several columns are {repeated[0]!r}; give each a name of its own, besides its unit")
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in curves}
    for begin, row in zip(begins[1:], rows[1:], strict=False):
        line, text = numbered[begin]
        numbers = [_number(cell, separator) for cell in row]
        if len(row) != len(names) or numbers[0] is None:
            if not any(cell.strip() for cell in row):
                continue
            wanted = f"{along} and {len(names) - 1} values of {values}"
            raise OutputError(f"{path}, line {line}: {text!r} is not a {wanted}")
        for number, (name, cell, value) in enumerate(zip(names, row, numbers, strict=True)):
            if cell.strip() and (value is None or (number in errors and value < 0.0)):
                wanted = "an error of at least 0" if number in errors else "a number"
                raise OutputError(f"{path}, line {line}: {cell.strip()!r} in column {name!r} is not {wanted}")
        x = factors[0] * numbers[0]
        scaled = [None if one is None else factor * one for one, factor in zip(numbers, factors, strict=True)]
        for number, (name, value) in enumerate(zip(names, scaled, strict=True)):
            if name in found and value is not None:
                own = scaled[number + 1 : number + 2] if number + 1 in errors else []
                found[name].append((x, value, *(np.nan if one is None else one for one in own)))
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
    """Copy a table of torque over current into the folder of a run or a study, whose picture draws it too.

    Raises as `read_measured`.
    """
    read_measured(path, *TORQUE_CURVE)
    replace_text(folder / MEASURED, Path(path).read_text(encoding="utf-8-sig"))


def measured_in(folder: Path) -> dict[str, np.ndarray] | None:
    """Return the curves of ``measured.csv`` of a run or a study, None without one; raises as `read_measured`."""
    return read_measured(folder / MEASURED, *TORQUE_CURVE) if (folder / MEASURED).is_file() else None


def _in_unit_of(path: str | Path, name: str, wanted: str, needs_units: bool) -> tuple[float | None, str]:
    """Return what a column's numbers are multiplied by to be what is `wanted`, as "torque [N m]", and its name then.

    The factor of a name without a unit is None.
    """
    quantity = wanted.split()[0]  # of "torque over the rated one" as well: its unit is refused
    unit, goal = _unit(name, quantity, needs_units), _unit(wanted, quantity, False) or ""
    if unit is None:
        if needs_units and goal:
            raise OutputError(f"{path}: column {name!r} has no unit; write it in brackets, as in {wanted}")
        return None, name
    if _letters(unit) == _letters(goal):
        return 1.0, name
    if goal and (usual := _with_usual_capitals(unit, goal)):
        raise OutputError(
            f"{path}: column {name!r} is in {unit}, whose capitals are unusual; write {' or '.join(usual)}"
        )
    try:
        before, _, after = name.rpartition(unit)
        spelled = _SPELLINGS.get(re.sub(r"[\s_.·*]", "", unit), unit)
        return factor_between(spelled, goal), f"{before}{goal}{after}"
    except ValueError as error:
        remedy = f": it {error}; convert it, and its name" if goal else ": convert it, and its name"
        raise OutputError(f"{path}: column {name!r} is in {unit}; it must be {wanted}{remedy}") from None


def _with_usual_capitals(unit: str, goal: str) -> list[str]:
    """Return how a unit of the goal's quantity may be meant that is a unit but for its capitals: "mA" for "MA"."""
    for pattern in _UNITS.values():
        if re.fullmatch(pattern, goal) and re.fullmatch(pattern, unit, re.IGNORECASE):
            meant = ("".join(letters) for letters in product(*(sorted({mark.lower(), mark.upper()}) for mark in unit)))
            return [] if re.fullmatch(pattern, unit) else [one for one in meant if re.fullmatch(pattern, one)]
    return []


def _unit(name: str, quantity: str, in_parentheses: bool) -> str | None:
    """Return the unit of "torque [N m]", "torque_Nm" or "torque (N m)"; None where none of the quantity ends the name.

    A torque named "brake_A" is that of brake A, and "torque (cold)" one of a cold brake, unless `in_parentheses` are
    units alone.
    """
    found = re.search(r"\[([^\]]*)\]\s*$", name)
    if found is None and quantity in _UNITS:
        found = re.search(rf"(?:^|[\s_(])({_UNITS[quantity]})\)?$", name, re.IGNORECASE)
    if found is None and in_parentheses:
        found = re.search(r"\(([^)]*)\)\s*$", name)
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
