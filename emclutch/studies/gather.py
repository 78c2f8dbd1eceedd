"""Tables and pictures of a whole study from the folders of its points, whoever has run them.

Nothing is run and no point is changed; every file is replaced in one step by what follows from the points that are
done, so that gathering again, at any time and beside parts that run, does no harm.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from emclutch.results import OutputError, RunFolder
from emclutch.results.lease import lease_holder
from emclutch.results.report.render import write_index
from emclutch.results.report.study_report import StudyState, state_report
from emclutch.results.study_table import DONE, FAILED, RUNNING, WAITING, PointRow
from emclutch.results.torque_curves import best_of
from emclutch.scene.study import StudySection, read_study
from emclutch.studies.accuracy.target import cases_of
from emclutch.studies.point_index import PARTS, PointIndex, lease_of, parts_in
from emclutch.studies.points import POINT, PointFolder, folders_of_points, unclaimed
from emclutch.studies.tables import DonePoint, label_of, write_failures, write_tables

SHOWN = 20
"""Points that are named in a line; a study may lack thousands."""


@dataclass(frozen=True, slots=True)
class OpenPoint:
    """A point that is not done.

    Attributes
    ----------
    number : its number in the study, from 0.
    folder : name of its folder, which may not exist.
    values : of the point.
    failure : why it has failed; empty where it has not.
    holder : the process that runs it, on another machine perhaps one that was killed; empty where none does.
    begun : whether it has a checkpoint to continue from.
    """

    number: int
    folder: str
    values: dict[str, Any]
    failure: str
    holder: str
    begun: bool


@dataclass(frozen=True, slots=True)
class GatheredStudy:
    """How far a study has come.

    Attributes
    ----------
    folder : Path
    done : int
        Points that are done: they are in the tables.
    failed, missing : tuple of OpenPoint
        Those that have failed, and all others that are not done.
    parts : str
        Parts that have points to do, as a list for a job array; empty where the study was not run in parts, or in more
        than one way.
    """

    folder: Path
    done: int
    failed: tuple[OpenPoint, ...]
    missing: tuple[OpenPoint, ...]
    parts: str

    @property
    def complete(self) -> bool:
        """True if every point is done."""
        return not self.failed and not self.missing

    def lines(self) -> list[str]:
        """What is done, what has failed and why, what is missing."""
        total = self.done + len(self.failed) + len(self.missing)
        lines = [f"{self.done} of {total} points are done, {len(self.failed)} failed, {len(self.missing)} missing"]
        for point in self.failed[:SHOWN]:
            values = ", ".join(f"{key} = {value}" for key, value in point.values.items())
            lines.append(f"failed: {point.folder} ({values}): {point.failure}")
        if len(self.failed) > SHOWN:
            lines.append(f"failed: {len(self.failed) - SHOWN} more, in {self.folder / 'failures.csv'}")
        held = [f"{point.folder} (by {point.holder})" for point in self.missing if point.holder]
        groups = {
            "running": held,
            "begun": [point.folder for point in self.missing if point.begun and not point.holder],
            "not begun": [point.folder for point in self.missing if not point.begun and not point.holder],
        }
        lines += [f"missing, {name}: {_in_short(names)}" for name, names in groups.items() if names]
        if self.parts:
            lines.append(f"parts with points to do, to run again with --resume: {self.parts}")
        return lines


def gather(study: StudySection | str | Path, out: str | Path) -> GatheredStudy:
    """Write tables and pictures of all points of a study that are done, and return which are not.

    Parameters
    ----------
    study : a study, or the path of its file.
    out : folder of the study, that of `emclutch.sweep` with parts or without.

    Raises
    ------
    SceneError
        The study has faults.
    OutputError
        The folder is none of this study, it cannot be written, or the input files of a point have changed since.
    """
    study = study if isinstance(study, StudySection) else read_study(study)
    folder = Path(out)
    points = list(cases_of(study))
    if not folder.is_dir() or not (any(folder.glob(f"{POINT}*")) or (folder / PARTS).is_dir()):
        raise OutputError(f"{folder} holds no points of a study; name the folder that --out named for its parts")
    index = PointIndex(folder, folder)
    targets = folders_of_points(folder, [case for _, case in points], fixed=study.values, index=index)
    others = unclaimed(folder, targets)
    if others and not any(target.path.exists() for target in targets):
        raise OutputError(
            f"{folder} holds {_in_short(others)}, none of them a point of {study.path}; name this study's folder, or "
            "the study's file as it was"
        )
    done, indexed = [], []
    for (values, case), target in zip(points, targets, strict=True):
        if target.is_done:
            target.refuse_changed_files(case)
            indexed.append(found := index.point(target.path))
            done.append(DonePoint(values, target.path, found.row, found.speeds_vary))
    index.rewrite(indexed)
    failures = _failures(folder)
    unfinished = [
        _open_point(number, values, target, failures)
        for number, ((values, _), target) in enumerate(zip(points, targets, strict=True))
        if not target.is_done
    ]
    write_tables(folder, study, done)
    failed = tuple(point for point in unfinished if point.failure)
    write_failures(folder, [(point.folder, point.values, point.failure) for point in failed])
    missing = tuple(point for point in unfinished if not point.failure)
    _write_page(folder, study, [target.path.name for target in targets], done, unfinished)
    return GatheredStudy(folder, len(done), failed, missing, _parts_to_run(study, folder, unfinished))


def _write_page(
    folder: Path,
    study: StudySection,
    names: Sequence[str],
    done: Sequence[DonePoint],
    unfinished: Sequence[OpenPoint],
) -> None:
    found = {point.folder.name: point for point in done}
    left = {point.folder: point for point in unfinished}
    points = {}
    for name in names:
        label = label_of(study, (found.get(name) or left[name]).values) or name
        if name in found:
            row = found[name].row
            points[name] = PointRow(label, DONE, 1.0, *best_of(row), row["converged"], row["seconds"])
        else:
            one = left[name]
            points[name] = PointRow(label, FAILED if one.failure else RUNNING if one.holder else WAITING)
    failures = {one.folder: one.failure for one in unfinished if one.failure}
    with suppress(OSError):  # as in a study that runs
        write_index(state_report(StudyState(folder, study.title, points, failures)))


def _open_point(number: int, values: dict[str, Any], target: PointFolder, failures: dict[str, str]) -> OpenPoint:
    run = RunFolder(target.path)
    holder = lease_holder(lease_of(target.path)) or ""
    own = run.read_failure()
    failure = own.in_words() if own is not None else failures.get(target.path.name, "")
    return OpenPoint(
        number, target.path.name, values, "" if holder else failure, holder, run.checkpoint.is_file()
    )  # fmt: skip


def _failures(folder: Path) -> dict[str, str]:
    """Reasons of the failures that parts have written, by the point's folder; of several the latest.

    Where there are no parts, those that the one process of the study has written.
    """
    found: dict[str, str] = {}
    tables = [path / "failures.csv" for path in parts_in(folder).values() or [folder]]
    for table in sorted((path for path in tables if path.is_file()), key=lambda path: path.stat().st_mtime):
        with table.open(encoding="utf-8", newline="") as file:
            found |= {row["point"]: row["reason"] for row in csv.DictReader(file)}
    return found


def _parts_to_run(study: StudySection, folder: Path, unfinished: Sequence[OpenPoint]) -> str:
    """The parts that unfinished points belong to, where the study was run in one number of parts."""
    counts = {of for _, of in parts_in(folder)}
    if len(counts) != 1 or not unfinished:
        return ""
    (of,) = counts
    numbers = {point.number for point in unfinished}
    chains = study.chains()
    which = sorted({place % of + 1 for place, chain in enumerate(chains) if numbers.intersection(chain)})
    return f"{','.join(map(str, which))} of {of}"


def _in_short(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
