"""A study read from its folder: table, points and reports."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.errors import OutputError
from emclutch.results.report.render import Reported
from emclutch.results.report.report import Report
from emclutch.results.report.run_report import OmittedEffectsOf, run_report
from emclutch.results.report.study_report import grain_size_curves, study_report
from emclutch.results.result import Result, load_result
from emclutch.results.run_end import seconds_of
from emclutch.results.run_folder import Failure, RunFolder
from emclutch.results.study_folder import ABOUT, AFTER_VALUES, TABLE, is_study

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclass(frozen=True)
class StudyResult(Reported):
    """A study as far as it has come. `load_study` returns it.

    Attributes
    ----------
    folder : Path
    table : pandas.DataFrame
        study.csv, a row for each point that is done: its values, then torque, standard_error, low, high [N m], and
        further results in SI.
    title : str
    total : int or None
        Number of points of the whole study; None where its folder does not say.
    values : dict of str to list
        Values of each key that the study varies; of a sample those of every point. Empty where its folder does not say.
    """

    folder: Path
    table: pandas.DataFrame
    title: str
    total: int | None
    values: dict[str, list[Any]] = field(default_factory=dict)

    @cached_property
    def points(self) -> tuple[Result, ...]:
        """Runs of the rows of `table`, in the same order. Raises OutputError where a run was removed."""
        return tuple(load_result(self.folder / name) for name in self.table["folder"].astype(str))

    @cached_property
    def seeds(self) -> pandas.DataFrame | None:
        """Return seeds.csv, means over `scene.seed`, of a study that varies it."""
        return self._read("seeds.csv")

    @cached_property
    def grain_size(self) -> pandas.DataFrame | None:
        """Return grain_size.csv, torque over the grains per gap, of a study that varies their size."""
        return self._read("grain_size.csv")

    @property
    def grain_size_laws(self) -> list[dict[str, Any]]:
        """Return the curves of grain_size.json: other `values`, `law` (`GrainSizeLaw.as_dict`) or None, `reason`."""
        return grain_size_curves(self.folder)

    def _read(self, name: str) -> pandas.DataFrame | None:
        import pandas

        return pandas.read_csv(self.folder / name) if (self.folder / name).is_file() else None

    @property
    def varied(self) -> list[str]:
        """Keys that the study varies."""
        keys = list(self.table.columns[: list(self.table.columns).index(AFTER_VALUES)])
        return [key for key in keys if self.table[key].astype(str).nunique() > 1]

    def outdated(self) -> list[str]:
        """Return the folders of points that were resumed or finished since the table was written."""
        names = self.table["folder"].astype(str).tolist()
        changed = []
        for name, (_, row) in zip(names, self.table.iterrows(), strict=True):
            torque = (RunFolder(self.folder / name).read_summary().get("torque") or {}).get("mean")
            written = None if row["torque"] != row["torque"] else float(row["torque"])  # nan: none
            same = torque == written or (torque is not None and written is not None and _is_same(torque, written))
            end = _end_of(self.folder / name)
            if not same or not (end is None or _is_same(end, row[AFTER_VALUES])):
                changed.append(name)
        done = {path.parent.name for path in self.folder.glob("*/row.json") if (path.parent / "summary.json").is_file()}
        return [*changed, *sorted(done - set(names))]

    def failures(self) -> dict[str, Failure]:
        """Return the failures of points that failed, by the name of their folder."""
        folders = sorted(path.parent for path in self.folder.glob("*/failure.json"))
        found = {path.name: RunFolder(path).read_failure() for path in folders}
        return {name: failure for name, failure in found.items() if failure is not None}

    def labels(self) -> list[str]:
        """Return a label for each point: the values that the study varies."""
        texts = [", ".join(f"{key.rpartition('.')[2].replace('_', ' ')} {row[key]}" for key in self.varied)
                 for _, row in self.table.iterrows()]  # fmt: skip
        names = self.table["folder"].astype(str)
        return [text or name for text, name in zip(texts, names, strict=True)]

    def results(self) -> dict[str, Result]:
        """Return the points' results by their labels, in the study's order."""
        return dict(zip(self.labels(), self.points, strict=True))

    def refresh_in_words(self) -> str:
        """Return a warning where table and pictures are older than their points, with the remedy; else empty."""
        if not (old := self.outdated()):
            return ""
        return (
            f"the table and the pictures in the study's folder are older than {', '.join(old)}; renew them with: "
            f"emclutch sweep STUDY.toml --out {self.folder} --resume"
        )

    def report(self, omitted_of: OmittedEffectsOf = lambda result: ()) -> Report:
        """Return the report on the study, with the verdict on each point."""
        return study_report(self, omitted_of)

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

        return dataset_of(self)


def load_study(folder: str | Path) -> StudyResult:
    """Read the study in a folder, as far as it has come.

    Raises
    ------
    OutputError
        There is no ``study.csv`` in it, or it is damaged.
    """
    import pandas

    folder = Path(folder)
    if folder.is_file():
        raise OutputError(f"{folder} is a file, no folder of a study; read a study's file with emclutch.read_study")
    if not is_study(folder):
        raise OutputError(f"{folder} has no {TABLE}; name the folder of a study of which a point is done")
    about: dict[str, Any] = {}
    path = folder / ABOUT
    try:
        table = pandas.read_csv(folder / TABLE)
        about = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except (OSError, ValueError) as error:
        what = f"{folder} has a {TABLE} or {ABOUT} that cannot be read"
        raise OutputError(f"{what}: {error}; resume the study") from error
    if not {AFTER_VALUES, "folder", "torque"} <= set(table.columns):
        raise OutputError(f"{folder / TABLE} is none that a study writes; name the folder of a study")
    title = about.get("title") or folder.resolve().name
    return StudyResult(folder, table, title, about.get("points"), about.get("values") or {})


def report_on(folder: Path, omitted_of: OmittedEffectsOf) -> Report:
    """Return the report on the run or the study in a folder; OutputError where there is neither."""
    if is_study(folder):
        return load_study(folder).report(omitted_of)
    result = load_result(folder)
    return run_report(result, omitted_of(result))


def _is_same(number: float, written: float) -> bool:
    """True if a number is that of a table, which has fewer digits."""
    return isclose(number, written, rel_tol=1e-6)


def _end_of(folder: Path) -> float | None:
    """Return the end [s] of a run's scene; None where it has none, or a shear strain without a plan."""
    run = RunFolder(folder)
    end = run.read_scene().get("time", {}).get("end")
    return None if end is None else seconds_of(end, run)
