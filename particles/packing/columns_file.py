"""Tables of text with a unit in the head of each column: ``x [mm], y [mm], z [mm], diameter [mm]``."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np

from particles.errors import FileFault

MAX_FILE = 50_000_000
"""Bytes: half a million grains; a larger table is refused before it is read, of which each byte takes twenty."""

_HEAD = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_]*)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")
_UNITS = {
    "": 1.0, "-": 1.0, "1": 1.0, "%": 0.01,
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6,
    "m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3,
    "rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0,
    "kg": 1.0, "g": 1e-3, "mg": 1e-6,
}  # fmt: skip


def read_columns(path: str | Path) -> dict[str, np.ndarray]:
    """Columns of a CSV file by name, in SI; a head without a unit is in SI already.

    The first line names the columns; later lines that are empty or begin with # are passed over.

    Raises
    ------
    ValueError
        If the file is no such table; the message has the line.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    if not path.is_file():
        raise FileFault(path, "does not exist; check the path")
    if path.stat().st_size > MAX_FILE:
        raise FileFault(
            path,
            f"is larger than {MAX_FILE // 1_000_000} MB; keep what is needed, a packing of many grains in "
            "an npz archive",
        )
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileFault(path, "is not text in UTF-8; a table is a CSV file with a line of names") from None
    rows = [
        (number, row)
        for number, row in enumerate(csv.reader(lines), start=1)
        if any(entry.strip() for entry in row) and not row[0].lstrip().startswith("#")
    ]
    if len(rows) < 2:
        raise FileFault(path, "has no table; a line with names and units, then a line for each entry, is needed")
    (head_line, head), *body = rows
    names, factors = [], []
    for entry in head:
        match = _HEAD.fullmatch(entry)
        if match is None:
            raise FileFault(path, f"line {head_line}: '{entry.strip()}' names no column; write e.g. 'x [mm]'")
        unit = match[2] or ""
        if unit not in _UNITS:
            known = ", ".join(u for u in _UNITS if u)
            raise FileFault(path, f"line {head_line}: the unit '{unit}' of {match[1]} is unknown; known: {known}")
        names.append(match[1].lower())
        factors.append(_UNITS[unit])
    if len(set(names)) < len(names):
        raise FileFault(path, f"line {head_line}: a column stands twice among {', '.join(names)}")
    values = np.empty((len(body), len(names)))
    for k, (number, row) in enumerate(body):
        if len(row) != len(names):
            raise FileFault(path, f"line {number}: {len(row)} entries, but {len(names)} columns are named")
        try:
            values[k] = [float(entry) for entry in row]
        except ValueError:
            raise FileFault(path, f"line {number}: {', '.join(row)} are not all numbers") from None
    return {name: factor * values[:, k] for k, (name, factor) in enumerate(zip(names, factors, strict=True))}
