"""The folder of a study: its values, its points and their results."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.results.errors import OutputError
from emclutch.results.quantities import QUANTITIES
from emclutch.results.result import Result, load_result
from emclutch.results.run_end import seconds_of
from emclutch.results.run_folder import Failure, RunFolder
from emclutch.results.torque_curves import BEST_ESTIMATE

if TYPE_CHECKING:
    import pandas

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


@dataclass(frozen=True, slots=True)
class StudyFolder:
    """A study with the points that are done.

    Attributes
    ----------
    path : Path
    title : str
    points : int or None
        Of the whole study; None where its folder does not say.
    table : DataFrame
        ``study.csv``: a row a point that is done; values first.
    values : dict of str to list
        Entries of each of the study's keys; of a sample that of every point. Empty where its folder does not say.
    """

    path: Path
    title: str
    points: int | None
    table: pandas.DataFrame
    values: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def varied(self) -> list[str]:
        """Return the keys in whose values the points differ."""
        keys = list(self.table.columns[: list(self.table.columns).index(AFTER_VALUES)])
        return [key for key in keys if self.table[key].astype(str).nunique() > 1]

    def outdated(self) -> list[str]:
        """Folders of points whose runs are no longer those of the table: resumed alone, or finished since."""
        names = self.table["folder"].astype(str).tolist()
        changed = []
        for name, (_, row) in zip(names, self.table.iterrows(), strict=True):
            torque = (RunFolder(self.path / name).read_summary().get("torque") or {}).get("mean")
            written = None if row["torque"] != row["torque"] else float(row["torque"])  # nan: none
            same = torque == written or (torque is not None and written is not None and _is_same(torque, written))
            end = _end_of(self.path / name)
            if not same or not (end is None or _is_same(end, row[AFTER_VALUES])):
                changed.append(name)
        done = {path.parent.name for path in self.path.glob("point-*/summary.json") if path.parent.name[6:].isdigit()}
        return [*changed, *sorted(done - set(names))]

    def failures(self) -> dict[str, Failure]:
        """Return the failures of points that failed for their scene, by the name of their folder."""
        folders = sorted(path.parent for path in self.path.glob("point-*/failure.json"))
        found = {path.name: RunFolder(path).read_failure() for path in folders}
        return {name: failure for name, failure in found.items() if failure is not None}

    def labels(self) -> list[str]:
        """Return of each point the values in which it differs from the others."""
        texts = [", ".join(f"{key.rpartition('.')[2].replace('_', ' ')} {row[key]}" for key in self.varied)
                 for _, row in self.table.iterrows()]  # fmt: skip
        names = self.table["folder"].astype(str)
        return [text or name for text, name in zip(texts, names, strict=True)]

    def results(self) -> dict[str, Result]:
        """The points' results by their labels, in the study's order."""
        names = self.table["folder"].astype(str)
        return {label: load_result(self.path / name) for label, name in zip(self.labels(), names, strict=True)}


def refresh_in_words(study: StudyFolder) -> str:
    """Return a warning where tables and pictures are older than their points, and how they are renewed; else empty."""
    old = study.outdated()
    if not old:
        return ""
    return (
        f"the table and the pictures in the study's folder are older than {', '.join(old)}; renew them with: "
        f"emclutch sweep STUDY.toml --out {study.path} --resume"
    )


def _is_same(number: float, written: float) -> bool:
    """True if a number is that of a table, which has fewer digits."""
    return isclose(number, written, rel_tol=1e-6)


def _end_of(folder: Path) -> float | None:
    """Return the end [s] of a run's scene; None where it has none, or a shear strain without a plan."""
    run = RunFolder(folder)
    end = run.read_scene().get("time", {}).get("end")
    return None if end is None else seconds_of(end, run)


def is_study(path: Path) -> bool:
    """True if a folder is that of a study with a point that is done, or one that has failed."""
    return (path / TABLE).is_file()


def write_about(folder: Path, title: str, values: dict[str, Any], points: int) -> None:
    """Write ``study.json``: title, values, number of points and units of columns, which the tables do not say."""
    replace_json(folder / ABOUT, {"title": title, "values": values, "points": points, "units": UNITS})


def write_empty_table(folder: Path, values: Iterable[str]) -> None:
    """Write ``study.csv`` of a study over these keys of which no point is done, so that it can be read as any other."""
    replace_text(folder / TABLE, ",".join((*values, AFTER_VALUES, "torque", "folder")) + "\n")


def read_study(path: Path) -> StudyFolder:
    """The study in a folder.

    Raises
    ------
    OutputError
        There is none, or its table is damaged.
    """
    import pandas

    if not is_study(path):
        raise OutputError(f"{path} has no {TABLE}; name the folder of a study of which a point is done")
    try:
        table = pandas.read_csv(path / TABLE)
        about = json.loads((path / ABOUT).read_text(encoding="utf-8")) if (path / ABOUT).is_file() else {}
    except (OSError, ValueError) as error:
        raise OutputError(f"{path} has a {TABLE} or {ABOUT} that cannot be read: {error}; resume the study") from error
    if not {AFTER_VALUES, "folder", "torque"} <= set(table.columns):
        raise OutputError(f"{path / TABLE} is none that a study writes; name the folder of a study")
    title = about.get("title") or path.resolve().name
    return StudyFolder(path, title, about.get("points"), table, about.get("values") or {})
