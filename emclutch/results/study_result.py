"""Results of a study, read from its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.errors import OutputError
from emclutch.results.result import Result, load_result
from emclutch.results.study_folder import read_study
from emclutch.results.text import format_duration, format_mean
from emclutch.results.torque_curves import BEST_ESTIMATE

if TYPE_CHECKING:
    import pandas
    import xarray


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

    def _repr_html_(self) -> str:
        from emclutch.results.report.content import study_page  # local, as below
        from emclutch.results.report.render import fragment

        return fragment(study_page(read_study(self.folder), lambda result: ()).short())

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


def point_lines(folder: Path, most: int = 40) -> list[str]:
    """Return a line a point that is done: values, torque, verdict, duration; of more than `most` points none."""
    study = read_study(folder)
    if not 0 < len(study.table) <= most:
        return []
    cells = []
    for label, (_, row) in zip(study.labels(), study.table.astype(object).iterrows(), strict=True):
        torque, low, high, stress = (float(row.get(name, nan)) for name in ("torque", "low", "high", "shear_stress"))
        shown = format_mean(None if isnan(torque) else torque, None if isnan(low + high) else (low, high))
        if isnan(torque) and not isnan(stress):  # of a sheared box
            shown = f"{stress:.4g} Pa"
        verdict = "converged" if str(row["converged"]) == "True" else "not converged"
        cells.append((label, shown, verdict, format_duration(float(row["seconds"]))))
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(one.ljust(width) for one, width in zip(line, widths, strict=True)).rstrip() for line in cells]


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
        f"The settings, coarse grains among them, change the raw torque of {points} by {share}: use the best estimates "
        f"({', '.join(BEST_ESTIMATE)} of study.csv)."
    ]


def grain_size_lines(folder: Path) -> list[str]:
    """Return the laws of the grain size of a study in words; none where its grains have one size."""
    return [line for curve in _grain_size_curves(folder) for line in curve["reason"].split("\n")]


def _grain_size_curves(folder: Path) -> list[dict[str, Any]]:
    path = folder / "grain_size.json"
    return json.loads(path.read_text(encoding="utf-8"))["curves"] if path.is_file() else []
