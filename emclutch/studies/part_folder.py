"""What parts of a study write besides its points: ``parts`` in the study's folder, no file of which two parts write.

``parts/3-of-40`` has the log and the failures of a part, ``parts/point-002.1.lease`` says who is at work on a point.
"""

from __future__ import annotations

import re
from pathlib import Path

PARTS = "parts"
_PART = re.compile(r"(\d+)-of-(\d+)")


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
