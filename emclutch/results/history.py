"""``history.csv``: one row a coupling window, written as it is computed.

`emclutch.results.column_table` has all columns. A value that is undefined in one window is an empty cell.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.column_table import COLUMNS, units_of
from emclutch.results.columns import TIME
from emclutch.results.errors import OutputError

if TYPE_CHECKING:
    import pandas

MAX_ROW = 8192  # bytes; a row has some sixty columns of at most 25


class HistoryWriter:
    """Writer of a history file; every row is on disk when `append` returns.

    The first row fixes the columns, in the order of `COLUMNS`.

    Parameters
    ----------
    path : the file. A new run starts it again.
    resume_time : time of the checkpoint [s] that a run resumes from: the rows up to it are kept, later
        ones and a last row that was cut off are removed.

    Raises
    ------
    OutputError : the rows up to `resume_time` are not all there; nothing was changed.
    """

    def __init__(self, path: str | Path, *, resume_time: float | None = None) -> None:
        self.path = Path(path)
        self.columns: list[str] | None = None
        if resume_time is not None:
            kept = rows_until(self.path, resume_time)
            replace_text(self.path, "".join(",".join(row) + "\n" for row in kept))
            self.columns = kept[0]
        self._file = self.path.open("a" if self.columns else "w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")

    def append(self, row: Mapping[str, Any]) -> None:
        """Write one row; None leaves a cell empty.

        Raises
        ------
        OutputError : an unknown column, columns other than those of the first row, a value that is not
            a finite number.
        """
        if self.columns is None:
            unknown = [name for name in row if name not in COLUMNS]
            if unknown:
                raise OutputError(f"no column {', '.join(unknown)} in a history; declare it in its effect's columns")
            self.columns = [name for name in COLUMNS if name in row]
            self._writer.writerow(self.columns)
        if row.keys() != set(self.columns):
            changed = sorted(row.keys() ^ set(self.columns))
            raise OutputError(f"{self.path}: columns changed within a run: {', '.join(changed)}")
        self._writer.writerow([_cell(name, row[name], row) for name in self.columns])
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def rows_until(path: Path, end: float) -> list[list[str]]:
    """Return the rows of a history up to the time `end` [s] of a checkpoint, the columns' names first.

    Raises
    ------
    OutputError : they are not all there.
    """
    rows = _rows_of(path) if path.is_file() else []
    kept, reached = rows[:1], 0.0
    slack = 1e-12 * abs(end)  # round-off of a time that was added up again
    for row in rows[1:]:
        time = _time_of(row, rows[0])
        if time is None or not time <= end + slack:
            break
        kept.append(row)
        reached = time
    if len(kept) < 2 or reached < end - slack:
        there = "holds no row that can be read" if len(kept) < 2 else f"can be read to t = {reached:.6g} s"
        raise OutputError(
            f"{path} {there}, and the checkpoint is at t = {end:.6g} s: the rows in between are missing; put the file "
            "back as the run left it, or start again in another folder with --out"
        )
    return kept


def read_history(path: str | Path) -> pandas.DataFrame:
    """Return a history as a table; ``attrs["units"]`` holds the unit of each column.

    Raises
    ------
    OutputError : it is none, or damaged.
    """
    import pandas

    # Not read_csv: only its newest default returns each float exactly, and the option for it is deprecated.
    header, *rows = _rows_of(Path(path)) or [[TIME]]
    try:
        if TIME not in header:
            raise ValueError("it has no column time")
        cells = zip(*rows, strict=True) if rows else ([] for _ in header)
        table = pandas.DataFrame({name: _numbers(column) for name, column in zip(header, cells, strict=True)})
    except ValueError as error:
        raise OutputError(f"{path} is not the history of a run, or damaged ({error}); name another run") from error
    table.attrs["units"] = units_of(table.columns)
    return table


def _rows_of(path: Path) -> list[list[str]]:
    """Return all whole rows, the columns' names first; a run that was killed may have left half a row."""
    try:
        text = path.read_text(encoding="utf-8")
        return list(csv.reader(io.StringIO(text[: text.rfind("\n") + 1])))
    except (UnicodeDecodeError, csv.Error) as error:
        raise OutputError(f"{path} is not the history of a run, or damaged ({error}); name another run") from error


def _time_of(row: list[str], header: list[str]) -> float | None:
    """Return the time of a row [s]; None where it has other columns."""
    try:
        return float(row[header.index(TIME)]) if len(row) == len(header) else None
    except ValueError:
        return None


def whole_rows(path: Path) -> int:
    """Return the number of windows that a history has; 0 where there is none."""
    try:
        with path.open("rb") as file:
            return max(0, sum(line.endswith(b"\n") for line in file) - 1)
    except OSError:
        return 0


def last_time(path: Path) -> float | None:
    """Return the time [s] of the last whole row of a history that may be growing; None where there is none yet."""
    try:
        with path.open("rb") as file:
            file.seek(0, io.SEEK_END)
            file.seek(max(0, file.tell() - MAX_ROW))
            lines = file.read().split(b"\n")
        return float(lines[-2].split(b",", 1)[0])  # after the last line's end nothing whole stands; time comes first
    except (OSError, IndexError, ValueError):  # no file, no line, the names alone
        return None


def _numbers(cells: Sequence[str]) -> np.ndarray:
    """Return integers where all cells are; otherwise floats, with nan (pandas' mark) for an empty cell."""
    try:
        return np.array([int(cell) for cell in cells], dtype=np.int64)
    except ValueError:
        return np.array([float(cell) if cell else np.nan for cell in cells])


def _cell(name: str, value: Any, row: Mapping[str, Any]) -> str:
    if value is None:
        return ""
    number = value.item() if hasattr(value, "item") else value
    if not math.isfinite(number):
        unit = COLUMNS[name].unit
        raise OutputError(f"{name} = {number} {unit} at t = {row.get(TIME)} s is not a number: the run is broken")
    return repr(number) if isinstance(number, float) else str(int(number))
