"""Files over all points of a study: its table with units, its title and values."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.results.quantities import QUANTITIES
from emclutch.results.torque_curves import BEST_ESTIMATE

TABLE, ABOUT = "study.csv", "study.json"
AFTER_VALUES = "end_time"
"""Column of `study.csv` that follows those of the study's values."""
UNITS = {one.column: one.unit or "1" for one in QUANTITIES if one.column} | {
    "end_time": "s",
    **dict.fromkeys(("torque", "standard_error", "low", "high", *BEST_ESTIMATE), "N m"),
    "rotor_speed": "rad/s",
    "output_start_time": "s",
    "output_start_speed": "rad/s",
}
"""Of the columns after the study's values."""


def is_study(path: Path) -> bool:
    """True if a folder is that of a study with a point that is done, or one that has failed."""
    return (path / TABLE).is_file()


def write_about(folder: Path, title: str, values: dict[str, Any], points: int) -> None:
    """Write ``study.json``: title, values, number of points and units of columns, which the tables do not say."""
    replace_json(folder / ABOUT, {"title": title, "values": values, "points": points, "units": UNITS})


def write_empty_table(folder: Path, values: Iterable[str]) -> None:
    """Write ``study.csv`` of a study over these keys of which no point is done, so that it can be read as any other."""
    replace_text(folder / TABLE, ",".join((*values, AFTER_VALUES, "torque", "folder")) + "\n")
