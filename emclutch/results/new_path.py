"""Where a command writes: at a place where there is nothing yet, since nothing is overwritten."""

from __future__ import annotations

import itertools
from pathlib import Path

from emclutch.results.errors import OutputError
from emclutch.results.run_folder import RunFolder
from emclutch.scene.errors import Fault, SceneError


def new_path(path: Path, option: str = "--out") -> Path:
    """Return a path; OutputError where there is something, with the `option` that names another one."""
    if path.exists():
        kind = "file" if path.suffix else "folder"
        raise OutputError(f"{path} exists; name another {kind} ({option})")
    return path


def new_picture(path: Path, option: str = "--out", endings: tuple[str, ...] = (".png",)) -> Path:
    """Return the path of a new picture or movie; SceneError for another ending, OutputError where it cannot be."""
    if path.suffix.lower() not in endings:
        raise SceneError([Fault(option, str(path), f"must end in {' or '.join(endings)}")], "command line")
    if not path.parent.is_dir():
        raise OutputError(f"{path.parent} is not a folder; make it first")
    return new_path(path, option)


def new_folder(out: str | Path | None, stem: str, parent: str = "runs") -> Path:
    """Return `out`, or the next free ``<parent>/<stem>-<nnn>``; it is not made yet. OutputError where it exists."""
    return new_path(Path(out), "out") if out is not None else RunFolder.next_path(stem, parent)


def numbered_file(folder: Path, stem: str, ending: str) -> Path:
    """Return the next free ``<stem>-1<ending>``, ``<stem>-2<ending>``, ... in a folder."""
    paths = (folder / f"{stem}-{number}{ending}" for number in itertools.count(1))
    return next(path for path in paths if not path.exists())
