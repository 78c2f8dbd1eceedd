"""What the tables need of each point that is done, in one file: a study of ten thousand points is gathered from a few.

Whoever has run points appends a line of JSON a point to ``points.jsonl`` in the study's folder, or in that of its part:
name, SHA-256 of the scene in ``case.toml``, row of the tables. The line holds as long as ``case.toml`` and
``summary.json`` of the point have the time and size that stand in it; of a point without a line that holds, the files
themselves are read. So the file saves opening others and decides nothing: it may be removed, and where two
processes write it at a time a line may be lost.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from emclutch import __version__
from emclutch.results import OutputError, RunFolder, load_result
from emclutch.results.atomic_file import json_values, replace_text
from emclutch.results.pictures.speeds import speeds_vary
from emclutch.studies.tables import row_of

INDEX = "points.jsonl"
PARTS = "parts"
"""Folder of what parts write besides points, no file of which two write: ``parts/3-of-40`` has the log and the failures
of a part, ``parts/point-002.1.lease`` says who is at work on a point."""
_PART = re.compile(r"(\d+)-of-(\d+)")
Stamp = list[list[int]]
"""Time of the last change [ns] and size [bytes] of ``case.toml`` and of ``summary.json``."""


@dataclass(frozen=True, slots=True)
class IndexedPoint:
    """A point that is done.

    Attributes
    ----------
    name : of its folder.
    scene : SHA-256 of the text of its ``case.toml``.
    stamp : of its files, when they were read.
    row : of `study.csv`, without the study's values.
    speeds_vary : whether its shafts change their speed.
    """

    name: str
    scene: str
    stamp: Stamp
    row: dict[str, Any]
    speeds_vary: bool

    def line(self) -> str:
        """The point as a line of the file."""
        found = {"version": __version__} | {name: getattr(self, name) for name in self.__slots__}
        return json.dumps(found, allow_nan=False, separators=(",", ":")) + "\n"


class PointIndex:
    """Points that are done, of a study's folder and of those of its parts.

    Parameters
    ----------
    folder : of the study.
    home : folder whose file gets the points that are read by `point`; None: none does.
    """

    def __init__(self, folder: Path, home: Path | None) -> None:
        self.folder = folder
        self._file = None if home is None else home / INDEX
        self._known: dict[tuple[str, str], IndexedPoint] = {}  # by name and stamp: a file may have older lines
        for place in (folder, *parts_in(folder).values()):
            self._known |= {(point.name, repr(point.stamp)): point for point in _points_in(place / INDEX)}

    def scene_of(self, path: Path) -> str | None:
        """The SHA-256 of a point's scene, None where there is none; OSError where it cannot be read."""
        if (known := self._known.get((path.name, repr(_stamp_of(path))))) is not None:
            return known.scene
        try:
            return sha256_of(RunFolder(path).case.read_text(encoding="utf-8"))
        except (FileNotFoundError, NotADirectoryError):  # it has not begun, or is being set aside
            return None

    def point(self, path: Path) -> IndexedPoint:
        """A point that is done; read, and appended to the file, where it is new or has changed.

        Raises
        ------
        OutputError
            It cannot be read.
        """
        stamp = _stamp_of(path)
        if (known := self._known.get((path.name, repr(stamp)))) is not None:
            return known
        result = load_result(path)
        if stamp is None:
            raise OutputError(f"{path} has no {result.folder.summary.name}; run it again")
        scene = sha256_of(result.folder.case.read_text(encoding="utf-8"))
        row = json_values(row_of({}, result))  # as it is read again
        found = IndexedPoint(path.name, scene, stamp, row, speeds_vary(result.history))
        self._known[path.name, repr(stamp)] = found
        if self._file is not None:
            with suppress(OSError), self._file.open("a", encoding="utf-8") as file:  # tables meet the same disk
                file.write(found.line())
        return found

    def rewrite(self, points: Sequence[IndexedPoint]) -> None:
        """Replace the study's own file by one with these points."""
        with suppress(OSError):
            replace_text(self.folder / INDEX, "".join(point.line() for point in points))


def sha256_of(text: str) -> str:
    """Return the SHA-256 of a scene's text."""
    return hashlib.sha256(text.encode()).hexdigest()


def _points_in(path: Path) -> list[IndexedPoint]:
    """The points of a file, but for lines of another version, and for half of one that a killed process has left."""
    found = []
    with suppress(OSError, UnicodeDecodeError):
        for line in path.read_text(encoding="utf-8").splitlines():
            with suppress(ValueError, TypeError, AttributeError):
                values = json.loads(line)
                if values.pop("version", None) == __version__:
                    found.append(IndexedPoint(**values))
    return found


def _stamp_of(path: Path) -> Stamp | None:
    """Return the stamp of a point's files; None where one is missing."""
    try:
        states = [os.stat(f"{path}/{name}") for name in ("case.toml", "summary.json")]
    except OSError:
        return None
    return [[state.st_mtime_ns, state.st_size] for state in states]


def part_folder(study: Path, part: tuple[int, int]) -> Path:
    """The folder of a part, in that of its study."""
    return study / PARTS / f"{part[0]}-of-{part[1]}"


def lease_of(point: Path) -> Path:
    """The lease of a point's folder, as `emclutch.results.lease.leased` takes it."""
    return point.parent / PARTS / point.name


def parts_in(study: Path) -> dict[tuple[int, int], Path]:
    """The folders of all parts that have run, by which part of how many they are."""
    found = {}
    for path in sorted((study / PARTS).glob("*-of-*")):
        if match := _PART.fullmatch(path.name):
            found[int(match[1]), int(match[2])] = path
    return found
