"""Results of a study, read from its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from emclutch.results.errors import OutputError
from emclutch.results.result import Result, load_result
from emclutch.results.study_folder import read_study

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class StudyResult:
    """The points of a study that are done.

    Attributes
    ----------
    folder : Path
    table : pandas.DataFrame
        study.csv: a row a point in the study's order, its values, then torque, standard_error, low, high [N m], ...
    points : tuple of Result
        The runs of the rows, in the same order.
    seeds : pandas.DataFrame or None
        seeds.csv, means over `scene.seed`, of a study that varies it.
    """

    folder: Path
    table: pandas.DataFrame
    points: tuple[Result, ...]
    seeds: pandas.DataFrame | None = None


def load_study(folder: str | Path) -> StudyResult:
    """Table and runs of the study in a folder, as far as it has come.

    Raises
    ------
    OutputError
        There is no ``study.csv`` in it, or a point's run is gone.
    """
    import pandas

    folder = Path(folder)
    if folder.is_file():
        raise OutputError(f"{folder} is a file, no folder of a study; read a study's file with emclutch.read_study")
    table, seeds = read_study(folder).table, folder / "seeds.csv"
    points = tuple(load_result(folder / name) for name in table["folder"].astype(str))
    return StudyResult(folder, table, points, pandas.read_csv(seeds) if seeds.is_file() else None)
