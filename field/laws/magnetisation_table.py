"""A user's magnetisation curve from a text file: two columns with a header that names quantity and unit.

    # virgin curve, ring core, 2024-05-17
    H [A/m], B [T]
    0, 0
    120, 0.31
    ...

Columns stand in any order: `H` in A/m, kA/m, MA/m or Oe, and either `B` in T, mT or G, or the polarisation
`J = B - mu_0 H` in T, mT or G; others are not read.  Commas, semicolons or tabs (or blanks) divide them; with
semicolons or tabs decimals may have a comma.  Lines with # and empty lines are skipped.  Errors are reported with
the number of the line in the file.

A hysteresis loop has the same columns, its rows in the order of the measurement.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from field.laws.magnetisation_curve import TableLaw, last_before_tail, too_flat
from field.laws.major_loop import MajorLoopLaw
from field.laws.reluctivity import MU_0

_UNITS = {
    "H": {"A/m": 1.0, "kA/m": 1e3, "MA/m": 1e6, "A/cm": 1e2, "Oe": 1e3 / (4.0 * np.pi)},
    "B": {"T": 1.0, "mT": 1e-3, "G": 1e-4, "Vs/m^2": 1.0},
}
_UNITS["J"] = _UNITS["B"]
# "H [A/m]", "B (T)", "J / mT", "H in kA/m"
_HEADING = re.compile(r"\s*([A-Za-z]+)\s*(?:\[\s*(.*?)\s*\]|\(\s*(.*?)\s*\)|(?:/|in\s)\s*(\S.*?))?\s*")
_MIN_POINTS = 3
_MAX_FILE = 10_000_000  # bytes: a wrong file is refused before it is read


class TableFault(ValueError):
    """Error in a file of a magnetisation curve, with the line and the remedy."""


@dataclass(frozen=True, slots=True)
class _Row:
    line: int
    cells: list[str]


def read_table(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read H [A/m] and B [T], each of shape (n,), from a file; checked as `TableLaw` checks them, line by line.

    Raises
    ------
    TableFault
        A header without quantity or unit, an entry that is no number, a curve that does not grow, one with
        dB/dH < mu_0 before its saturation, or fewer than three points besides the origin.
    OSError
        The file cannot be read.
    """
    H, B, lines, given = _points(Path(path))
    _check(H, B, lines, given)
    return H, B


def read_loop(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read H [A/m] and B [T] (n,) of a hysteresis loop from a file of the same format, in the order of its rows.

    Raises
    ------
    TableFault
        A header without quantity or unit, or an entry that is no number; the branches are checked by `MajorLoopLaw`.
    OSError
        The file cannot be read.
    """
    H, B, _, _ = _points(Path(path))
    return H, B


def _points(path: Path) -> tuple[np.ndarray, np.ndarray, list[int], str]:
    """H [A/m] and B [T] of a file's rows, their lines, and whether B or J was given."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise TableFault("is a device or a pipe, not a file; name a text file")
    if path.stat().st_size > _MAX_FILE:
        raise TableFault(f"is larger than {_MAX_FILE // 1_000_000} MB, which no magnetisation curve is")
    try:
        # utf-8-sig: spreadsheets write a byte order mark in front
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise TableFault("is not text in UTF-8; export the table as CSV") from None
    rows, comma_is_decimal = _rows(lines)
    columns = _columns(rows[0])
    points = [_point(row, columns, len(rows[0].cells), comma_is_decimal) for row in rows[1:]]
    H, B = np.array([point[0] for point in points]), np.array([point[1] for point in points])
    return H, B, [row.line for row in rows[1:]], "J" if "J" in columns else "B"


def file_law(path: str | Path) -> TableLaw | MajorLoopLaw:
    """The law of a file's curve, or of a loop where some H is negative, named after the file.

    Raises
    ------
    TableFault
        As `read_table`, or a loop that is none (`MajorLoopLaw`).
    OSError
        The file cannot be read.
    """
    path = Path(path)
    H, B = read_loop(path)
    if (H >= 0.0).all():
        return table_law(path)
    try:
        return MajorLoopLaw(H, B, path.stem, f"file {path.name}")
    except ValueError as error:
        raise TableFault(str(error)) from None


def table_law(path: str | Path) -> TableLaw:
    """The law of a file's curve, named after the file; raises as `read_table` does."""
    H, B = read_table(path)
    return TableLaw(H, B, Path(path).stem, f"file {Path(path).name}")


def _rows(lines: list[str]) -> tuple[list[_Row], bool]:
    """The lines that count, cut at the divider of the header; and whether a comma is a decimal mark."""
    counted = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"]
    if not counted:
        raise TableFault("is empty; give a header such as 'H [A/m], B [T]' and a row for each point")
    header = counted[0][1]
    divider = next((mark for mark in (";", "\t", ",") if mark in header), None)
    return [_Row(number, _split(line, divider)) for number, line in counted], divider in (";", "\t")


def _split(line: str, divider: str | None) -> list[str]:
    # blanks divide numbers, but stand within a heading: "H [A/m]  B [T]"
    cells = re.split(r"\s+(?![\[(])", line.strip()) if divider is None else line.split(divider)
    return [cell.strip().strip('"').strip() for cell in cells]


def _columns(header: _Row) -> dict[str, tuple[int, float]]:
    """Place and factor to SI of every quantity that the header names."""
    where = f"line {header.line}"
    if all(_number(cell, True) is not None for cell in header.cells):
        raise TableFault(f"{where} has numbers but no header; begin with a line such as 'H [A/m], B [T]'")
    columns: dict[str, tuple[int, float]] = {}
    for place, cell in enumerate(header.cells):
        match = _HEADING.fullmatch(cell)
        quantity = match[1].upper() if match is not None else ""
        if match is None or quantity not in _UNITS:
            continue
        if quantity in columns:
            raise TableFault(f"{where} names {quantity} twice; keep one column of it")
        unit = match[2] or match[3] or match[4]
        if not unit:
            raise TableFault(f"{where}: the column {cell!r} has no unit; write {quantity} [{_first(quantity)}]")
        factors = _UNITS[quantity]
        plain = unit.strip("()").replace("²", "^2").replace(" ", "")
        if plain not in factors:
            raise TableFault(
                f"{where}: the column {cell!r} has the unknown unit {unit!r}; "
                f"known for {quantity}: {', '.join(factors)}"
            )
        columns[quantity] = place, factors[plain]
    if "H" not in columns or not {"B", "J"} & set(columns):
        raise TableFault(
            f"{where} ({', '.join(header.cells)!r}) does not name the columns; "
            "write e.g. 'H [A/m], B [T]', or J [T] for the polarisation"
        )
    if {"B", "J"} <= set(columns):
        raise TableFault(f"{where} names both B and J = B - mu_0 H; keep one of them")
    return columns


def _first(quantity: str) -> str:
    return next(iter(_UNITS[quantity]))


def _point(row: _Row, columns: dict[str, tuple[int, float]], width: int, comma_is_decimal: bool) -> tuple[float, float]:
    """H [A/m] and B [T] of one row."""
    values = {}
    if len([cell for cell in row.cells if cell]) > width:
        raise TableFault(
            f"line {row.line} has {len(row.cells)} entries for {width} columns; decimals follow a point, or divide the "
            "columns by ';'"
        )
    for quantity, (place, factor) in columns.items():
        if place >= len(row.cells):
            raise TableFault(
                f"line {row.line} has {len(row.cells)} entries, and {quantity} is number {place + 1}; "
                "complete the row or remove it"
            )
        number = _number(row.cells[place], comma_is_decimal)
        if number is None:
            hint = "; decimals follow a point, or divide the columns by ';'" if "," in row.cells[place] else ""
            raise TableFault(f"line {row.line}: {quantity} = {row.cells[place]!r} is not a number{hint}")
        values[quantity] = number * factor
    return values["H"], values["B"] if "B" in values else values["J"] + MU_0 * values["H"]


def _number(text: str, comma_is_decimal: bool) -> float | None:
    """The number that a cell holds; None where it is none, or not finite."""
    try:
        value = float(text.replace(",", ".") if comma_is_decimal else text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _check(H: np.ndarray, B: np.ndarray, lines: list[int], given: str) -> None:
    """Check the conditions of `TableLaw`; errors name the file's lines."""
    if np.count_nonzero(H) < _MIN_POINTS:
        raise TableFault(
            f"has {np.count_nonzero(H)} points besides the origin; a curve needs at least {_MIN_POINTS}, better 10 "
            "up to saturation"
        )
    if (H[0] != 0.0 or B[0] != 0.0) and not (H[0] > 0.0 and B[0] > 0.0):
        raise TableFault(
            f"line {lines[0]}: the curve starts at H = {H[0]:g} A/m, B = {B[0]:g} T; it must start at the origin (no "
            "hysteresis here: give the virgin curve, or the middle of both branches)"
        )
    for values, symbol, unit in ((H, "H", "A/m"), (B, "B", "T")):
        back = np.diff(values) <= 0.0
        if np.any(back):
            i = int(np.argmax(back))
            raise TableFault(
                f"line {lines[i + 1]}: not monotone, {symbol} goes from {values[i]:g} to {values[i + 1]:g} {unit}; "
                "sort the rows by H, and remove repeated points and the returning branch of a loop"
            )
    if H[0] > 0.0:
        H, B, lines = np.append(0.0, H), np.append(0.0, B), [lines[0], *lines]
    flat = too_flat(H, B)
    if np.any(flat) and last_before_tail(H, B) is None:
        i = int(np.argmax(flat))
        # a polarisation that falls is not mended by giving B
        remedy = (
            "J must not fall with H; check the units and the last digits"
            if given == "J"
            else "check the units, and that B, not M or J = mu_0 M, is given (a column of J is named J [T])"
        )
        raise TableFault(
            f"line {lines[i + 1]}: dB/dH = {(B[i + 1] - B[i]) / (H[i + 1] - H[i]):.3g} H/m is below "
            f"mu_0 = {MU_0:.4g} H/m, which no material does; {remedy}"
        )
