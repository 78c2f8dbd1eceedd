"""Results of a study, read from its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.errors import OutputError
from emclutch.results.report.render import Reported
from emclutch.results.report.report import Report
from emclutch.results.result import Result, load_result
from emclutch.results.study_folder import read_study
from emclutch.results.torque_curves import BEST_ESTIMATE

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclass(frozen=True)
class StudyResult(Reported):
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
    grain_size : pandas.DataFrame or None
        grain_size.csv, torque over the grains per gap, of a study that varies their size.
    grain_size_laws : list of dict
        Of each of its curves, as `GrainSizeLaw.as_dict` says: other `values`, `law` or None, `reason` in words.
    """

    folder: Path
    table: pandas.DataFrame
    points: tuple[Result, ...]
    seeds: pandas.DataFrame | None = None
    grain_size: pandas.DataFrame | None = None
    grain_size_laws: list[dict[str, Any]] = field(default_factory=list)

    def report(self) -> Report:
        """Return the report on the study, with the verdict on each point."""
        from emclutch.results.report.study_report import study_report  # local: it imports this module

        return study_report(read_study(self.folder), lambda result: ())

    def to_xarray(self) -> xarray.Dataset:
        """Return the table as one object over the study's values and replicas, with units as attributes.

        A study over listed values is a grid; a sample has the dimension ``point``
        (`emclutch.results.study_dataset`). ``to_netcdf(path, engine="scipy")`` writes it.

        Raises
        ------
        OutputError
            There is no package xarray.
        """
        from emclutch.results.study_dataset import dataset_of  # local: xarray takes a second to import

        return dataset_of(read_study(self.folder))


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
    table = read_study(folder).table
    points = tuple(load_result(folder / name) for name in table["folder"].astype(str))
    seeds, sizes = (
        pandas.read_csv(path) if path.is_file() else None for path in (folder / "seeds.csv", folder / "grain_size.csv")
    )
    return StudyResult(folder, table, points, seeds, sizes, _grain_size_curves(folder))


def best_estimate_lines(folder: Path) -> list[str]:
    """Return how far a study's raw torques are from their best estimates, in words; empty where they are the same."""
    table = read_study(folder).table
    name = BEST_ESTIMATE[0]
    if name not in table:
        return []
    known = table[table[name].notna() & table["torque"].notna()]
    known = known[known[name] != 0.0]
    excess = sorted({f"{100.0 * ratio - 100.0:+.2g}" for ratio in known["torque"] / known[name]}, key=float)
    if not excess:
        return []
    share = f"{excess[0]} %" if len(excess) == 1 else f"{excess[0]} to {excess[-1]} %"
    points = "all points" if len(known) == len(table) else f"{len(known)} of {len(table)} points"
    return [
        f"Numerical settings and coarse grains change the raw torque of {points} by {share}, which is corrected in the "
        f"best estimates ({BEST_ESTIMATE[0]} of study.csv)."
    ]


def grain_size_lines(folder: Path) -> list[str]:
    """Return the laws of the grain size of a study in words; none where its grains have one size."""
    return [line for curve in _grain_size_curves(folder) for line in curve["reason"].split("\n")]


def _grain_size_curves(folder: Path) -> list[dict[str, Any]]:
    path = folder / "grain_size.json"
    return json.loads(path.read_text(encoding="utf-8"))["curves"] if path.is_file() else []
