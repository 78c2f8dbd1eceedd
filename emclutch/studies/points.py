"""Folders of the points of a study: a point is identified by its resolved scene, not by its place in the list.

Each point's folder has its scene in ``case.toml``. A point of the study takes the folder whose scene is its own; where
there is none, the folder whose scene differs only in what a resumed run may change (its end, its output), unless such a
key is one of the study's values: then it tells points from each other. What is left gets its own number, or one that no
other point of the study can get. So values can be inserted, removed and put in another order, what is computed is found
again, and parts of a study that run at the same time need not agree on anything.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from emclutch.results import OutputError, RunFolder
from emclutch.results.columns import TIME
from emclutch.results.folder_lock import has_files
from emclutch.results.history import last_time
from emclutch.results.run_end import seconds_of
from emclutch.scene.case import Case
from emclutch.scene.flat import differing_keys, flat_scene
from emclutch.scene.study import StudySection
from emclutch.scene.timing import instant_in_words
from emclutch.simulation.resume import may_change, refuse_changed_files
from emclutch.studies.accuracy.target import cases_of
from emclutch.studies.point_index import PointIndex, sha256_of

log = logging.getLogger(__name__)
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


def folders_of_points(
    folder: Path,
    cases: Sequence[Case],
    fixed: Collection[str],
    part: tuple[Sequence[int], int] | None = None,
    index: PointIndex | None = None,
) -> list[PointFolder]:
    """The folder of each point, in their order.

    A point that has none gets its own number; where something else lies there, as many more as the study has points,
    as often as needed. So points of one study never get the same number, whichever of them are begun, and by whom.

    Parameters
    ----------
    folder : of the study.
    cases : of the points.
    fixed : keys of the study's values, which tell points from each other.
    part : numbers of these points in their study, and how many that has, where they are not all of it. A point then
        continues a run with another end only in a folder of its own numbers.

    Raises
    ------
    OutputError
        A point that is not finished has run beyond the end that it is to have now: that cannot be taken back.
    """
    numbers, total = (range(len(cases)), len(cases)) if part is None else part
    there = _scenes_in(folder, index or PointIndex(folder, None))
    marks = [sha256_of(case.toml()) for case in cases]
    found: list[Path | None] = [None] * len(cases)
    for place, mark in enumerate(marks):
        own = folder / _name(numbers[place])
        if there.get(own) == mark:
            found[place] = own
            there.pop(own)
    paths_of: dict[str, list[Path]] = {}
    for path, mark in reversed(there.items()):
        paths_of.setdefault(mark, []).append(path)
    for place, mark in enumerate(marks):
        if found[place] is None and paths_of.get(mark):
            found[place] = path = paths_of[mark].pop()
            there.pop(path)
    is_done = [path is not None and RunFolder(path).summary.is_file() for path in found]
    open_places = [place for place, path in enumerate(found) if path is None]
    if part is not None:  # what may belong to others is not read
        own_numbers = {numbers[place] for place in open_places}
        there = {path: mark for path, mark in there.items() if _number(path) % total in own_numbers}
    scenes = {path: _scene_in(RunFolder(path).case) for path in there} if open_places else {}
    wanted = {place: flat_scene(cases[place].toml()) for place in open_places} if scenes else {}
    for exactly in (True, False):  # a point must not take what is exactly another's
        for place, scene in wanted.items():
            if found[place] is not None:
                continue
            mine = (p for p in scenes if part is None or _number(p) % total == numbers[place])
            if (match := next((p for p in mine if _is_of(scenes[p], scene, exactly, fixed)), None)) is not None:
                _refuse_earlier_end(match, scenes.pop(match), scene)
                found[place], is_done[place] = match, _is_done(match, scene, fixed)
    return [
        PointFolder(_free_path(folder, number, total) if path is None else path, done)
        for number, path, done in zip(numbers, found, is_done, strict=True)
    ]


def is_done_now(path: Path, case: Case, fixed: Collection[str]) -> bool:
    """True if a folder holds a finished run of a case, see `PointFolder.is_done`, perhaps of another process since."""
    folder, text = RunFolder(path), case.toml()
    if not folder.case.is_file():
        return False
    if folder.case.read_text(encoding="utf-8") == text:
        return folder.summary.is_file()
    return _is_done(path, flat_scene(text), fixed)


def can_resume(case: Case, path: Path, resume: bool) -> bool:
    """True if a point continues from its checkpoint; what lies in its folder without one is put aside."""
    name = path.name
    if resume and RunFolder(path).checkpoint.is_file():
        log.info("%s continues from its checkpoint to %s", name, instant_in_words(case.scene.span.end))
        return True
    if path.is_dir() and has_files(path):
        aside = RunFolder(path).set_aside()
        log.warning("%s has no checkpoint to continue from: restarted, its files are kept as %s", name, aside.name)
    else:
        log.info("%s starts", name)
    return False


def _free_path(folder: Path, number: int, total: int) -> Path:
    """The first of a point's numbers under which nothing lies."""
    for free in count(number, total):
        path = folder / _name(free)
        if not path.exists() or (path.is_dir() and not has_files(path)):
            return path
    raise AssertionError("numbers have no end")


def _name(number: int) -> str:
    return f"{POINT}{number:03d}"


def _number(path: Path) -> int:
    return int(path.name.removeprefix(POINT))


def points_in(study: StudySection, folder: Path) -> list[PointFolder]:
    """The folders of a study's points, in its order; none where the study has no folder."""
    if not folder.is_dir():
        return []
    return folders_of_points(folder, [case for _, case in cases_of(study)], fixed=study.values)


def unclaimed(folder: Path, points: Sequence[PointFolder]) -> list[str]:
    """Names of the points' folders that are of none of these points."""
    claimed = {point.path for point in points}
    return sorted(p.name for p in folder.glob(f"{POINT}*") if _NUMBERED.fullmatch(p.name) and p not in claimed)


def _scenes_in(folder: Path, index: PointIndex) -> dict[Path, str]:
    """SHA-256 of the scenes of the points' folders, by number."""
    found: dict[Path, str] = {}
    for path in sorted(folder.glob(f"{POINT}*"), key=lambda path: (len(path.name), path.name)):
        if _NUMBERED.fullmatch(path.name):
            try:
                scene = index.scene_of(path)
            except (OSError, ValueError) as error:
                raise _unreadable(path, error) from error
            if scene is not None:
                found[path] = scene
    return found


def _scene_in(case: Path) -> dict[str, Any]:
    try:
        return flat_scene(case.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _unreadable(case.parent, error) from error


def _unreadable(path: Path, error: Exception) -> OutputError:
    return OutputError(f"cannot read {RunFolder(path).case}: {error}; move {path} elsewhere, then continue")


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
