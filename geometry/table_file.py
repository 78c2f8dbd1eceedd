"""Tables of text whose first line names the columns with their units: curves, grains, sizes, measurements.

    # virgin curve, ring core
    H [A/m]; B [T]
    120; 0,31
    1.000; 1,25

Commas, semicolons, tabs or blanks divide the columns; empty lines and lines that begin with # or % are skipped. A unit
is written as in "x [mm]", "x (mm)", "x / mm", "x in mm" or "x_mm", or in a row of units below the names. Where numbers
follow a comment with a name and unit for as many columns, this is the first line. The line <BHPoints> of FEMM is one,
its other lines in <> are skipped.

The decimal mark is a point or a comma, the same in the whole table; the other mark divides thousands, as blanks and
apostrophes do. "1,000" may be 1 or 1000: another number of the table decides, or it is refused.

A column named as an error (`is_error`) belongs to the one before it. A column of entries "7.30 ± 0.15" is read as two.
"""

from __future__ import annotations

import csv
import math
import re
import warnings
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MAX_FILE = 50_000_000
"""Bytes: half a million grains; a larger table is refused before it is read, of which each byte needs twenty."""

_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, **dict.fromkeys(("kg", "kgf", "kp"), 9.80665),
           **dict.fromkeys(("lb", "lbs", "lbf", "pound", "pounds"), 4.4482216152605),
           **dict.fromkeys(("oz", "ozf", "ounce", "ounces"), 4.4482216152605 / 16.0)}  # fmt: skip
_ARMS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "inch": 0.0254, "ft": 0.3048, "foot": 0.3048}
_FLUX_DENSITIES = {"T": 1.0, "mT": 1e-3, "G": 1e-4, "kG": 0.1, "Vs/m2": 1.0, "Wb/m2": 1.0, "tesla": 1.0, "Tesla": 1.0,
                   "gauss": 1e-4, "Gauss": 1e-4, "kGauss": 0.1, "kilogauss": 0.1}  # fmt: skip
_OERSTED = 1e3 / (4.0 * math.pi)
_FIELD_STRENGTHS = {"A/m": 1.0, "kA/m": 1e3, "Oe": _OERSTED, "kOe": 1e3 * _OERSTED, "A/cm": 1e2, "MA/m": 1e6,
                    **dict.fromkeys(("Apermeter", "Ampermeter", "Amp/m", "Amps/m", "Amp/meter", "AT/m"), 1.0),
                    "kApermeter": 1e3, "oersted": _OERSTED, "Oersted": _OERSTED}  # fmt: skip
UNITS: tuple[dict[str, float], ...] = (
    {"1": 1.0, "-": 1.0, "%": 0.01},
    {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "ft": 0.3048},
    {"m3": 1.0, "cm3": 1e-6, "mm3": 1e-9, "l": 1e-3, "ml": 1e-6},
    {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    {"rad/s": 1.0, "deg/s": math.pi / 180.0,
     **dict.fromkeys(("rpm", "1/min", "min-1", "U/min", "r/min", "rev/min"), math.pi / 30.0)},
    {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "kA": 1e3},
    {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    _FIELD_STRENGTHS,
    _FLUX_DENSITIES,
    {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5},
    dict.fromkeys(("Nm", "mNm", "kNm", "Ncm", "Nmm", "lbin", "lbft", "ozin", "kgcm"), 1.0)  # an error lists these first
    | {force + arm: f * a for force, f in _FORCES.items() for arm, a in _ARMS.items()}
    | {arm + force: f * _ARMS[arm] for force, f in _FORCES.items() for arm in ("in", "inch", "ft", "foot")},
)  # fmt: skip
"""Units of one quantity each, with their factor; written as `_plain` makes them."""
_SUFFIXES = {unit.casefold() for units in UNITS for unit in units} - {"1", "-"}
_COMMENTS = "#%<"
_OF_FEMM = re.compile(r"\s*<bhpoints>.*", re.I)
_LISTED = 6  # of the units that are known, in an error
_MARKS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "³": "3", "⁻": "-", "¹": "1", **dict.fromkeys("_·*^()")})
_ERROR = re.compile(
    r"error|\berr\b|fehler|uncertaint|unsicherheit|sigma|σ|\bstd|\bs\.?d\b|deviation|abweichung|±|\+/?-", re.I
)
_PLUS_MINUS = re.compile(r"(.*\d\.?)\s*(?:±|\+/?-)\s*(.+)")
_BLANKS = re.compile(r"\s+(?![\[(])(?![^\[(]*[\])])")  # not before a unit in brackets, nor within one


class FileFault(ValueError):
    """A file that cannot be used.

    Attributes
    ----------
    path : str or Path
    reason : str
        What is wrong with it and what to do, without its path.
    """

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path, self.reason = path, reason


@dataclass(frozen=True, slots=True)
class TableFile:
    """The columns of a file that are used.

    Attributes
    ----------
    path : Path
    names, units : list of str
        Of each column; the unit is the one in the file, empty where there is none.
    values : ndarray, shape (n, columns)
        In the units of `unit_of`; nan where a cell is empty.
    lines : list of int
        Place of each row in the file, from 1.
    unused : list of (str, str)
        Name and unit of the other columns.
    """

    path: Path
    names: list[str]
    units: list[str]
    values: np.ndarray
    lines: list[int]
    unused: list[tuple[str, str]]

    def warn_of_unused(self) -> None:
        """Warn of the columns that are not used."""
        if self.unused:
            warn_of_unused(self.path, [name for name, _ in self.unused])


def warn_of_unused(path: Path, names: Iterable[str]) -> None:
    """Warn of columns or arrays of a file that are not used."""
    warnings.warn(f"{path}: not used: {', '.join(names)}", UserWarning, stacklevel=2)


def read_table(
    path: str | Path,
    unit_of: Callable[[int, str, str], str | None],
    *,
    gaps: bool = False,
    key: int = 0,
    example: str = "'x [mm], y [mm]'",
) -> TableFile:
    """Read the columns that `unit_of` names.

    Parameters
    ----------
    unit_of : function
        Of a column's place, name and unit: the unit to return it in, "1" for a pure number, "" for one whose unit may
        be missing, None for a column that is not used. A column of errors that has no unit has the unit of the column
        before it, where they are of one quantity.
    gaps : bool
        Whether cells may be empty, but for those of the column at the place `key`.
    example : str
        A first line, for the error of a file that has none.

    Raises
    ------
    FileFault
        The file cannot be read or is no such table, a unit is missing, unknown or of another quantity, or a cell is not
        a number; with the line.
    """
    path = Path(path)
    (line, head), *body = _rows(path, example)
    if _is_numbers(head):
        raise FileFault(path, f"line {line} has numbers but no header; begin with a line such as {example}")
    places, factors, names = [], [], []
    units: list[str] = []
    unused: list[tuple[str, str]] = []
    for place, text in enumerate(head):
        if not text and all(place >= len(row) or not row[place] for _, row in body):
            continue  # a spreadsheet's empty column, or a separator at the end of each line
        name, unit = split_heading(text)
        goal = unit_of(place, name, unit)
        if goal is None:
            unused.append((name, unit))
            continue
        if not unit and units and is_error(name) and is_unit_of(units[-1], goal):
            unit = units[-1]
        if goal and not unit:
            some = ", ".join(f"{name} [{one}]" for one in [*_factors(goal)][:3])
            raise FileFault(
                path, f"line {line}: the column '{name}' has no unit; write the unit of your numbers, e.g. {some}"
            )
        if not is_unit_of(unit, goal):
            known, meant = list(_factors(goal)), units_meant(unit, goal) or units_meant(unit.replace("/", ""), goal)
            hint = f"did you mean {' or '.join(meant)}? " if meant else ""
            raise FileFault(
                path,
                f"line {line}: the column '{name}' is in {unit!r}, which is unknown or of another quantity; {hint}"
                + "known: "
                + ", ".join(known[:_LISTED]),
            )
        factors.append(_factors(goal)[_known(unit, goal)] / _factors(goal)[_plain(goal)])
        places.append(place)
        names.append(name)
        units.append(unit)
    for name, count in Counter(names).items():
        if count > 1 and not is_error(name):
            raise FileFault(path, f"line {line} names {name!r} twice; keep one column, or give each a name of its own")
    for number, row in body:
        while len(row) > len(head) and not row[-1]:
            row.pop()
        if len(row) != len(head) and not places:
            raise FileFault(
                path, f"line {line} names no column of a table; put # in front of a title, and begin with {example}"
            )
        if len(row) != len(head):
            raise FileFault(
                path,
                f"line {number} has {len(row)} entries for {len(head)} columns; complete it, and divide the columns by "
                "';' where decimals have a comma",
            )
    mark = _decimal_mark(path, [(number, [row[place] for place in places]) for number, row in body])
    values = np.full((len(body), len(places)), np.nan)
    for k, (number, row) in enumerate(body):
        for j, place in enumerate(places):
            if row[place] or not gaps or place == key:
                value = _number(row[place], mark)
                if value is None:
                    raise FileFault(path, f"line {number}: {names[j]} = {row[place]!r} is not a number")
                values[k, j] = factors[j] * value
    return TableFile(path, names, units, values, [number for number, _ in body], unused)


def headings(path: str | Path, example: str) -> list[tuple[str, str]]:
    """Return name and unit of each column; raises as `read_table`."""
    return [split_heading(text) for text in _rows(Path(path), example)[0][1]]


def is_error(name: str) -> bool:
    """Whether a column is named as errors: error, uncertainty, sigma, std, deviation, ±, Fehler, Unsicherheit."""
    return _ERROR.search(name.replace("_", " ")) is not None


def split_heading(text: str) -> tuple[str, str]:
    """Return name and unit of "x [mm]", "x (mm)", "x / mm", "x in mm", "x, mm" or "x_mm"; "" if it is missing."""
    if match := re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", text):
        return match[1], match[2].strip()
    for match in re.finditer(r"\s*(?:/|\(|\bin\s|[\s_,])\s*", text):
        unit = text[match.end() :].strip(" )'\"")
        if _plain(unit).casefold() in _SUFFIXES:
            return text[: match.start()], unit
    return text, ""


def is_unit_of(unit: str, goal: str) -> bool:
    """Whether a unit is one of the quantity of another unit."""
    return _known(unit, goal) in _factors(goal)


def _known(unit: str, goal: str) -> str:
    """Return a unit as `UNITS` writes it, "oe" as "Oe".

    One in m or M has to agree, since mega is not milli, and so has one of another quantity: "Nm" is no "nm".
    """
    plain, like = _plain(unit), units_meant(unit, goal)
    is_exact = plain in _factors(goal) or any(plain in units for units in UNITS)
    return like[0] if not is_exact and len(like) == 1 and plain[0] not in "mM" else plain


def factor_of(unit: str, goal: str) -> float | None:
    """Return a unit over another one of its quantity; None where it is unknown or of another quantity."""
    factors = _factors(goal)
    return factors[_plain(unit)] / factors[_plain(goal)] if _plain(unit) in factors else None


def units_meant(unit: str, goal: str) -> list[str]:
    """Return the units of the quantity of another one that differ from a text in capitals alone."""
    return [one for one in _factors(goal) if one.casefold() == _plain(unit).casefold()]


def _factors(goal: str) -> dict[str, float]:
    """Return the units of a quantity, given by one of them, with their factors."""
    if not goal:
        return {**UNITS[0], "": 1.0}
    return next((units for units in UNITS if _plain(goal) in units), {_plain(goal): 1.0})


def _plain(unit: str) -> str:
    """Return a unit without what parts its factors: "N m", "N·m", "N_m" and "N-m" are "Nm"."""
    return re.sub(r"(?<=[A-Za-z])[-.](?=[A-Za-z])", "", "".join(unit.split()).translate(_MARKS))


def _is_numbers(cells: list[str]) -> bool:
    return all((_number(text, ",") or _number(text, ".")) is not None for text in cells)


def _rows(path: Path, example: str) -> list[tuple[int, list[str]]]:
    """Return the lines that count with their cells, the header first."""
    try:
        if path.exists() and not path.is_file():
            raise FileFault(path, "is a device, a pipe or a folder, not a file; name a text file")
        if path.stat().st_size > MAX_FILE:
            raise FileFault(path, f"is larger than {MAX_FILE // 1_000_000} MB; keep what is needed")
        content = path.read_bytes()
        # spreadsheets write a byte order mark in front, also of their «Unicode text»
        text = content.decode("utf-16" if content[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) else "utf-8-sig")
    except UnicodeDecodeError:
        raise FileFault(path, "is not text in UTF-8; in a spreadsheet save it as «CSV UTF-8»") from None
    except OSError as error:
        reason = error.strerror or error
        raise FileFault(
            path, f"cannot be read ({reason}); check the path (in a scene it is relative to the scene's folder)"
        ) from None
    text = "\n".join(_OF_FEMM.sub("B[T] H[A/m]", row) for row in text.splitlines())
    lines = [(number, row) for number, row in enumerate(text.split("\n"), 1) if row.strip()]
    if lines and lines[0][1].lower().startswith("sep="):  # Excel's
        del lines[0]
    counted = [(number, row) for number, row in lines if row.lstrip()[0] not in _COMMENTS]
    rows = _cells(path, counted)
    if rows and _is_numbers(rows[0][1]):
        comments = [(number, row.lstrip(_COMMENTS + " ")) for number, row in lines if number < rows[0][0]]
        named = _cells(path, [*comments[-1:], *counted])
        if comments and len(named[0][1]) == len(rows[0][1]) and any(split_heading(cell)[1] for cell in named[0][1]):
            rows = named
    if len(rows) > 2 and (units := _row_of_units(rows[1][1])) and len(units) == len(rows[0][1]):
        (line, names), _, *rows = rows
        rows.insert(0, (line, [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]))
    if len(rows) < 2:
        raise FileFault(
            path, f"has no table; a line of names with units, such as {example}, and one of numbers are needed"
        )
    _part_errors(rows)
    return rows


def _part_errors(rows: list[tuple[int, list[str]]]) -> None:
    """Make two columns of one with entries "7.3 ± 0.15", the second named as its errors."""
    (_, head), *body = rows
    for place in reversed(range(len(head))):
        parts = [_PLUS_MINUS.fullmatch(row[place]) if place < len(row) else None for _, row in body]
        if any(parts):
            name, unit = split_heading(head[place])
            head[place : place + 1] = [f"{re.split('±|[+]/?-', name)[0].strip()} [{unit}]", "error"]
            for (_, row), part in zip(body, parts, strict=True):
                row[place : place + 1] = part.groups() if part else [*row[place : place + 1], ""]


def _row_of_units(cells: list[str]) -> list[str]:
    """Return the units that a row below the names consists of; none where it is another."""
    units = [cell.strip("[]()") for cell in cells]
    known = [not unit or unit == "-" or _plain(unit).casefold() in _SUFFIXES for unit in units]
    return units if all(known) and any(units) else []


def _cells(path: Path, lines: list[tuple[int, str]]) -> list[tuple[int, list[str]]]:
    """Return the cells of lines, of which the first says what divides the columns."""
    separator = next((mark for mark in ";\t," if lines and mark in lines[0][1]), None)
    if separator is None:
        rows = [(number, [cell.strip('"') for cell in _BLANKS.split(row.strip())]) for number, row in lines]
        return [(number, row) for number, row in rows if any(row)]
    texts = (re.sub(rf'" +(?={separator})', '"', row) + "\n" for _, row in lines)  # as Maxwell writes its names
    reader = csv.reader(texts, delimiter=separator, skipinitialspace=True, strict=True)
    rows, begin = [], 0
    try:
        for cells in reader:  # of several lines where quotes hold a line break
            rows.append((lines[begin][0], [" ".join(cell.split()) for cell in cells]))
            begin = reader.line_num
    except csv.Error as error:
        raise FileFault(path, f"line {lines[begin][0]}: {error}; look for a quote that is not closed") from None
    return [(number, row) for number, row in rows if any(row)]


def _decimal_mark(path: Path, rows: list[tuple[int, list[str]]]) -> str:
    """Return the decimal mark, a point or a comma, that the numbers of a table agree on."""
    if not any("," in cell or cell.count(".") > 1 for _, row in rows for cell in row):
        return "."
    marked: dict[str, tuple[int, str]] = {}
    for line, cell in ((line, cell) for line, row in rows for cell in row):
        if _number(cell, ",") is None and _number(cell, ".") is None:
            continue  # no number at all, which is said where it is read
        marks = [mark for mark in cell if mark in ",."]
        if marks and not re.fullmatch(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", cell):
            thousands = len(marks) > 1 and len(set(marks)) == 1
            marked.setdefault({",": ".", ".": ","}[marks[0]] if thousands else marks[-1], (line, cell))
        elif "," in marks:
            marked.setdefault("?", (line, cell))
    if len(marked.keys() & {",", "."}) == 2:
        (first, one), (second, other) = marked[","], marked["."]
        raise FileFault(
            path,
            f"line {first} has {one!r}, line {second} {other!r}; write all decimals with a point, or all with a comma",
        )
    if marked.keys() == {"?"}:
        line, cell = marked["?"]
        choices = f"{cell.replace(',', '')} or {cell.replace(',', '.')}"
        raise FileFault(path, f"line {line}: {cell!r} may be {choices}; write one of them")
    return "," if "," in marked else "."


def _number(cell: str, mark: str) -> float | None:
    """Return the number of a cell; None where it is none, or not finite."""
    if "_" in cell:  # Python's own sign between thousands
        return None
    other = "." if mark == "," else ","
    if not cell.isascii() or " " in cell or "'" in cell:
        cell = re.sub(r"(?<=\d)['’ ](?=\d{3}(?!\d))", "", cell)
    if other in cell and re.fullmatch(rf"[+-]?\d{{1,3}}(?:\{other}\d{{3}})+(?:\{mark}\d*)?", cell):
        cell = cell.replace(other, "")
    try:
        value = math.nan if other in cell else float(cell.replace(mark, "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None
