"""Read an HDF5 file that may be untrusted, cut off or another program's, without leaving it.

HDF5 follows links by itself: a name in a file may stand for another file (external links, datasets whose values lie
elsewhere, virtual datasets), for another name (soft links), or for a group that it lies in. What this program writes
has none of them, so a file with one is refused before anything in it is read, and above all written.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from emclutch.results.errors import OutputError

DAMAGED = (KeyError, ValueError, TypeError, AttributeError, RuntimeError)
"""What h5py and numpy raise, as well as OSError, on files with other groups and types than ours, or damaged ones."""


@contextmanager
def reading(path: Path, remedy: str) -> Iterator[h5py.File]:
    """Open a file for reading in the block.

    Raises
    ------
    OutputError
        It cannot be read, in the block either, with the remedy; or it has links.
    """
    try:
        with h5py.File(path, "r", locking=False) as file:
            refuse_links(file, path)
            yield file
    except (OSError, *DAMAGED) as error:
        raise OutputError(f"cannot read {path}: {error}; {remedy}") from error


def refuse_links(file: h5py.File, path: Path) -> None:
    """Raise OutputError where a name in an open file stands for anything but an object of its own, in this file."""
    waiting: list[tuple[str, h5py.Group]] = [("", file["/"])]
    seen = {_number_of(file["/"])}
    while waiting:
        where, group = waiting.pop()
        for name in group:
            link, place = group.get(name, getlink=True), f"{where}/{name}"
            if isinstance(link, h5py.ExternalLink):
                raise _refused(path, place, f"is a link into another file, {link.filename!r}")
            if not isinstance(link, h5py.HardLink):
                raise _refused(path, place, "is a link to another name")
            node = group[name]
            if (number := _number_of(node)) in seen:
                raise _refused(path, place, "is another name of what has one already")
            seen.add(number)
            if isinstance(node, h5py.Group):
                waiting.append((place, node))
            elif isinstance(node, h5py.Dataset) and (node.external or node.is_virtual):
                raise _refused(path, place, "has its values in another file")


def _number_of(node: h5py.Group | h5py.Dataset) -> int:
    return h5py.h5o.get_info(node.id).addr


def _refused(path: Path, place: str, what: str) -> OutputError:
    return OutputError(
        f"{path}: {place} {what}; this program writes no such files and reads none: do not trust it, start the run "
        "again without --resume"
    )
