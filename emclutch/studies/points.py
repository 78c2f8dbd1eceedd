"""Folders of the points of a study: a point is identified by its resolved scene, not by its place in the list.

Each point's folder has its scene in ``case.toml``. A point of the study takes the folder whose scene is its own; where
there is none, the folder whose scene differs only in what a resumed run may change (its end, its output), unless such a
key is one of the study's values: then it tells points from each other. What is left gets the next free numbers. So
values can be inserted, removed and put in another order, and what is computed is found again.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from emclutch.results import OutputError, RunFolder
from emclutch.results.columns import TIME
from emclutch.results.folder_lock import has_files
from emclutch.results.history import last_time
from emclutch.scene.case import Case
from emclutch.scene.study import StudySection
from emclutch.simulation.resume import differing_keys, flat_scene, may_change, refuse_changed_files, seconds_of
from emclutch.studies.accuracy.target import cases_of

POINT = "point-"
_NUMBERED = re.compile(rf"{POINT}(\d+)")


@dataclass(frozen=True, slots=True)
class PointFolder:
    """Folder of one point.

    Attributes
    ----------
    path : Path
        It may not exist yet.
    is_done : bool
        It holds a finished run of exactly the point's scene, of one with a later end, or of one with an earlier end
        before which its torque was known as well as the scene asks for (`time.until`).
    """

    path: Path
    is_done: bool = False

    @property
    def reached(self) -> float:
        """Simulated time [s] from which a run that is resumed continues, to a minute of its work; 0: it restarts."""
        folder = RunFolder(self.path)
        return (last_time(folder.history) or 0.0) if folder.checkpoint.is_file() else 0.0

    def refuse_changed_files(self, case: Case) -> None:
        """OutputError where the run that is to be kept was one of other input files."""
        refuse_changed_files(case, RunFolder(self.path))


def folders_of_points(folder: Path, cases: Sequence[Case], fixed: Collection[str]) -> list[PointFolder]:
    """The folder of each point, in their order.

    Parameters
    ----------
    folder : of the study.
    cases : of the points.
    fixed : keys of the study's values, which tell points from each other.

    Raises
    ------
    OutputError
        A point that is not finished has run beyond the end that it is to have now: that cannot be taken back.
    """
    there = _scenes_in(folder)
    wanted = [flat_scene(case.toml()) for case in cases]
    found: list[Path | None] = [None] * len(cases)
    for exactly in (True, False):  # a point must not take what is exactly another's
        for number, scene in enumerate(wanted):
            if found[number] is None:
                found[number] = next((p for p, old in there.items() if _is_of(old, scene, exactly, fixed)), None)
                if (path := found[number]) is not None:
                    _refuse_earlier_end(path, there.pop(path), scene)
    is_done = [path is not None and _is_done(path, scene, fixed) for path, scene in zip(found, wanted, strict=True)]
    free = _free_numbers(folder)
    paths = (folder / f"{POINT}{next(free):03d}" if path is None else path for path in found)
    return [PointFolder(path, done) for path, done in zip(paths, is_done, strict=True)]


def _free_numbers(folder: Path) -> Iterator[int]:
    """Numbers of points to come: those whose folder was set aside for a run that never began, then the next ones."""
    names = {
        path.name: int(match[1])
        for path in folder.glob(f"{POINT}*")
        if (match := _NUMBERED.match(path.name)) and (path.is_file() or has_files(path))
    }
    taken = {number for name, number in names.items() if _NUMBERED.fullmatch(name)}
    yield from sorted(set(names.values()) - taken)
    yield from count(max(names.values(), default=-1) + 1)


def points_in(study: StudySection, folder: Path) -> list[PointFolder]:
    """The folders of a study's points, in its order; none where the study has no folder."""
    if not folder.is_dir():
        return []
    return folders_of_points(folder, [case for _, case in cases_of(study)], fixed=study.values)


def unclaimed(folder: Path, points: Sequence[PointFolder]) -> list[str]:
    """Names of the points' folders that are of none of these points."""
    claimed = {point.path for point in points}
    return sorted(p.name for p in folder.glob(f"{POINT}*") if _NUMBERED.fullmatch(p.name) and p not in claimed)


def _scenes_in(folder: Path) -> dict[Path, dict[str, Any]]:
    """Flat scenes of the points' folders, by number."""
    found: dict[Path, dict[str, Any]] = {}
    for path in sorted(folder.glob(f"{POINT}*"), key=lambda path: (len(path.name), path.name)):
        case = RunFolder(path).case
        if _NUMBERED.fullmatch(path.name) and case.is_file():
            found[path] = _scene_in(case)
    return found


def _scene_in(case: Path) -> dict[str, Any]:
    try:
        return flat_scene(case.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot read {case}: {error}; move {case.parent} elsewhere, then continue") from error


def _is_of(old: dict[str, Any], new: dict[str, Any], exactly: bool, fixed: Collection[str]) -> bool:
    """True if a run of one scene is, or may become, that of another."""
    keys = differing_keys(old, new)
    return not keys or (not exactly and all(may_change(key) and not _is_in(key, fixed) for key in keys))


def _is_in(key: str, tables: Collection[str]) -> bool:
    return any(key == table or key.startswith(f"{table}.") for table in tables)


def _is_done(path: Path, scene: dict[str, Any], fixed: Collection[str]) -> bool:
    """True if a folder holds a finished run of exactly this scene, or of one with an equivalent end."""
    folder = RunFolder(path)
    if not folder.summary.is_file():
        return False
    old = _scene_in(folder.case)
    keys = differing_keys(old, scene)
    if keys != ["time.end"] or _is_in("time.end", fixed):
        return not keys
    before, now = (seconds_of(one["time.end"], folder) for one in (old, scene))
    is_later = before is not None and now is not None and before > now
    return is_later or folder.read_summary().get("until", {}).get("reached", False)


def _refuse_earlier_end(path: Path, old: dict[str, Any], new: dict[str, Any]) -> None:
    run = RunFolder(path)
    before, now = (seconds_of(one.get("time.end", 0.0), run) for one in (old, new))
    if not run.checkpoint.is_file() or not run.history.is_file() or before is None or now is None or before <= now:
        return
    if differing_keys(old, new) == ["time.end"] and run.summary.is_file():  # finished, and known the better for it
        return
    times = run.read_history()[TIME]
    reached = float(times.iloc[-1]) if len(times) else 0.0
    if reached > now:
        raise OutputError(
            f"{path} has run to {reached:.4g} s, and the study now ends at {now:g} s: its torque is the "
            f"mean of a longer run; set time.end to {before:g} s or later, or begin a new study with --out"
        )
