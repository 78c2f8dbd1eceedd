"""A measured torque curve from a text file: drive and torque, with or without the torque's error.

    # B15, rising branch
    current [mA], torque [N m], error [N m]
    82, 0.092, 0.005
    ...

The first column is the drive, the second the torque, the third, where there is one, its standard error; the header
names their units. Lines with # and empty lines are skipped.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.units import Quantity
from emclutch.studies.torque_fit import MeasuredTorques

TORQUE = Quantity("a torque", "N*m", "12 N m")
_UNIT = re.compile(r".*[\[(]\s*(\S.*?)\s*[\])]\s*")
_MAX_FILE = 1_000_000


def read_measured(path: Path, drive: Quantity) -> tuple[MeasuredTorques, int]:
    """Read a curve, and how many of its points are left out: those with a drive or a torque of 0.

    Raises
    ------
    SceneError
        The file cannot be read; a header without units; an entry that is no number; an error that is not above 0; no
        point with a drive and a torque above 0.
    """

    def fault(message: str, value: str = "", key: str = "--to") -> SceneError:
        return SceneError([Fault(key, value and shown(value), message)], str(path))

    try:
        if path.stat().st_size > _MAX_FILE:
            raise fault("is larger than 1 MB, which no measured curve is")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise fault("is not text in UTF-8; export the table as CSV") from None
    except OSError as error:
        raise fault(f"cannot be read ({error.strerror}); check the path") from None
    counted = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"]
    rows = list(csv.reader(line for _, line in counted))
    if len(rows) < 2 or len(rows[0]) < 2:
        raise fault("has no curve; begin with a header as 'current [A], torque [N m]', then a line for each point")
    factors = []
    for cell, quantity in zip(rows[0], (drive, TORQUE, TORQUE), strict=False):
        unit = _UNIT.fullmatch(cell)
        if unit is None:
            message = "has no unit; write the header as in 'current [A], torque [N m]'"
            raise fault(message, cell.strip(), "column")
        try:
            factors.append(quantity.read(f"1 {unit[1]}"))
        except ValueError as error:
            raise fault(f"is in {unit[1]}, which {error}", cell.strip(), "column") from None
    table = []
    for (number, line), row in zip(counted[1:], rows[1:], strict=True):
        try:
            values = [float(cell) * factor for cell, factor in zip(row[: len(factors)], factors, strict=True)]
        except ValueError:
            message = f"does not have {len(factors)} numbers, as the header has columns"
            raise fault(message, line.strip(), f"line {number}") from None
        if not np.isfinite(values).all() or (len(values) == 3 and not values[2] > 0.0):
            message = "has a number that is not finite, or an error that is not above 0"
            raise fault(message, line.strip(), f"line {number}")
        table.append(values)
    columns = np.array(table).T
    used = (columns[0] > 0.0) & (columns[1] > 0.0)  # both are fitted by their logarithms
    if not used.any():
        raise fault("has no point with a drive and a torque above 0")
    columns = columns[:, used][:, np.argsort(columns[0, used])]
    return MeasuredTorques(*columns), int((~used).sum())
