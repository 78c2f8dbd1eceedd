"""A user's magnetisation curve from a text file: two columns with a header that names quantity and unit.

    # virgin curve, ring core, 2024-05-17
    H [A/m], B [T]
    0, 0
    120, 0.31
    ...

Columns stand in any order: `H` in A/m, kA/m, MA/m, A/cm, Oe or kOe, and either `B` in T, mT, G or kG, or the
polarisation `J = B - mu_0 H` in one of these; `Magnetizing Force H`, `Flux Density` and other names of `_NAMES` mean
them too. A warning names the others, which are not used. The rows of a curve ascend with H, or descend.
`geometry.table_file` says how numbers and units may be written. Errors are reported with the number of the line in the
file.

A hysteresis loop has the same columns, its rows in the order of the measurement.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from field.laws.magnetisation_curve import TableLaw, last_before_tail, too_flat
from field.laws.major_loop import MajorLoopLaw
from field.laws.reluctivity import MU_0
from geometry import table_file

_UNITS = {"H": "A/m", "B": "T", "J": "T"}
_NAMES = {
    "J": r"j|ji|bi|b ?[-−] ?([µμ]|mu_?)0 ?\*? ?h|4 ?[*·]? ?(pi|π) ?[*·]? ?m"
    r"|((magnetic )?polari[sz]ation|intrinsic induction)( ji?| bi)?|\w+ ji?",
    "H": r"h|(applied |magnetic |magneti[sz]ing )?(force|field( strength| intensity)?)( h)?|\w+ h",
    "B": r"b|(magnetic )?(flux density|induction)( b)?|\w+ b",
}
"""Names of the columns, in upper or lower case."""
_EXAMPLE = "'H [A/m], B [T]', or, over a table as FEMM keeps it, 'B [T], H [A/m]'"
_MIN_POINTS = 3
TableFault = table_file.FileFault
"""Error in a file of a magnetisation curve, with the line and the remedy."""


def read_table(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read H [A/m] and B [T], each of shape (n,), from a file; checked as `TableLaw` checks them, line by line.

    Raises
    ------
    TableFault
        A header without quantity or unit, an entry that is no number, a curve that does not grow, one with
        dB/dH < mu_0 before its saturation, or fewer than three points besides the origin.
    """
    H, B, lines, given = _points(Path(path))
    if (H >= 0.0).all() and (np.diff(H) < 0.0).all():  # from saturation down
        H, B, lines = H[::-1], B[::-1], lines[::-1]
    _check(Path(path), H, B, lines, given)
    _law(Path(path), H, B)
    return H, B


def read_loop(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read H [A/m] and B [T] (n,) of a hysteresis loop from a file of the same format, in the order of its rows.

    Raises
    ------
    TableFault
        A header without quantity or unit, or an entry that is no number; the branches are checked by `MajorLoopLaw`.
    """
    H, B, _, _ = _points(Path(path))
    return H, B


def _points(path: Path) -> tuple[np.ndarray, np.ndarray, list[int], str]:
    """H [A/m] and B [T] of a file's rows, their lines, and whether B or J was given."""
    table = table_file.read_table(path, lambda place, name, unit: _UNITS.get(_symbol(name, unit)), example=_EXAMPLE)
    columns = {
        _symbol(name, unit): column for name, unit, column in zip(table.names, table.units, table.values.T, strict=True)
    }
    if columns.keys() not in ({"H", "B"}, {"H", "J"}) or len(table.names) > 2:
        given = ", ".join(filter(None, table.names + [name for name, _ in table.unused]))
        if columns.keys() == {"H", "B", "J"}:
            raise TableFault(path, f"has the columns {given}, so both B and J; remove one of these")
        raise TableFault(
            path,
            f"has the columns {given}; needed are H and either B or the polarisation J (B - H or 4 pi M in G), as in "
            "'H [A/m], B [T]'; put # in front of a title",
        )
    table.warn_of_unused()
    H = columns["H"]
    return (H, columns["B"], table.lines, "B") if "B" in columns else (H, columns["J"] + MU_0 * H, table.lines, "J")


def _symbol(name: str, unit: str) -> str:
    """Quantity of a column, H, B or J; empty of another. In gauss B - H is the polarisation."""
    if re.fullmatch(r"b ?[-−] ?h", name.lower()) and unit.lower() in ("g", "kg", "gauss", "kgauss"):
        return "J"
    return next((symbol for symbol, names in _NAMES.items() if re.fullmatch(names, name.lower())), "")


def file_law(path: str | Path) -> TableLaw | MajorLoopLaw:
    """The law of a file's curve, or of a loop where some H is negative, named after the file.

    Raises
    ------
    TableFault
        As `read_table`, or a loop that is none (`MajorLoopLaw`).
    """
    path = Path(path)
    H, B, lines, _ = _points(path)
    if (H >= 0.0).all():
        return table_law(path)
    try:
        return MajorLoopLaw(H, B, path.stem, f"file {path.name}")
    except ValueError as error:
        first = int(np.argmax(H < 0.0))
        raise TableFault(
            path,
            f"line {lines[first]}: H = {H[first]:.4g} A/m makes the table a hysteresis loop, and {error}; for a curve "
            "remove the rows with H < 0",
        ) from None


def table_law(path: str | Path) -> TableLaw:
    """The law of a file's curve, named after the file; raises as `read_table` does."""
    return _law(Path(path), *read_table(path))


def _law(path: Path, H: np.ndarray, B: np.ndarray) -> TableLaw:
    try:
        return TableLaw(H, B, path.stem, f"file {path.name}")
    except ValueError as error:  # of J beyond any material's, where a unit is wrong
        raise TableFault(path, str(error).removeprefix(f"the table of {path.stem!r} ")) from None


def _check(path: Path, H: np.ndarray, B: np.ndarray, lines: list[int], given: str) -> None:
    """Check the conditions of `TableLaw`; errors name the file's lines."""
    if np.count_nonzero(H) < _MIN_POINTS:
        raise TableFault(
            path,
            f"has {np.count_nonzero(H)} points besides the origin; a curve needs at least {_MIN_POINTS}, better 10 "
            "up to saturation",
        )
    if (H[0] != 0.0 or B[0] != 0.0) and not (H[0] > 0.0 and B[0] > 0.0):
        raise TableFault(
            path,
            f"line {lines[0]}: the curve starts at H = {H[0]:g} A/m, B = {B[0]:g} T; it must start at the origin (no "
            "hysteresis here: give the virgin curve, or the middle of both branches)",
        )
    for values, symbol, unit in ((H, "H", "A/m"), (B, "B", "T")):
        back = np.diff(values) <= 0.0
        if np.any(back):
            i = int(np.argmax(back))
            raise TableFault(
                path,
                f"line {lines[i + 1]}: not monotone, {symbol} goes from {values[i]:g} to {values[i + 1]:g} {unit}; "
                + (
                    "sort the rows by H, and remove repeated points and the returning branch of a loop"
                    if symbol == "H"
                    else f"H rises there from {H[i]:g} to {H[i + 1]:g} A/m: correct the point"
                ),
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
            path,
            f"line {lines[i + 1]}: dB/dH = {(B[i + 1] - B[i]) / (H[i + 1] - H[i]):.3g} H/m is below "
            f"mu_0 = {MU_0:.4g} H/m, which no material does; {remedy}",
        )
