"""An attempt at a task: while a process is at work on it, the task's folder has a name that only this process knows.

`attempt` moves the folder NAME to ``attempts/NAME.1c2d3e4f``, and back in the end. A file system renames in one step:
of several processes one gets the folder, without file locks. Where an attempt was left behind, its process was killed,
belongs to a machine that died, or is cut off from the study and goes on. The next attempt moves that folder, too: it
continues from the checkpoint there, and a process that still writes by the former name finds no folder and ends
(`TakenOver`). Where two processes have done one task all the same, the first to end has done it, and the folder of the
other is removed: by the same scene and seed it has the same bits.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from emclutch.results.errors import OutputError
from emclutch.results.folder_lock import LOCK, refuse_in_use
from emclutch.results.history import last_time
from emclutch.results.run_folder import next_aside

ATTEMPTS = "attempts"
_held: dict[Path, int] = {}
"""Inodes of the folders of the attempts of this process: another folder that is made under the name has another one."""


class TakenOver(OutputError):
    """Another process continues what this one had begun."""


@contextmanager
def attempt(folder: Path, is_done: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield the folder of a task under the name of this attempt; it is made where there is none.

    What killed attempts have left is continued, of several that which has come furthest.

    Parameters
    ----------
    folder : of the task.
    is_done : whether the task is done in a folder. Where another attempt has put its folder back meanwhile, that stays
        if it is done, and is set aside if it is not.

    Raises
    ------
    FolderInUse
        A run that belongs to no study is at work in the folder (`emclutch run FOLDER --resume`).
    TakenOver
        At the end of the block: another process has taken the folder meanwhile.
    OutputError
        It cannot be made or moved.
    """
    own = folder.parent / ATTEMPTS / f"{folder.name}.{secrets.token_hex(4)}"
    try:
        _take(folder, own)
        _held[own] = own.stat().st_ino
    except FileNotFoundError:
        raise TakenOver(f"{folder.name} was taken over by another process, which continues it") from None
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}; write elsewhere with --out") from error
    try:
        yield own
    finally:
        try:
            _put_back(own, folder, is_done)
        finally:
            del _held[own]


def refuse_taken_over(own: Path) -> None:
    """Raise `TakenOver` where the folder of an attempt of this process is another's by now."""
    try:
        is_own = own.stat().st_ino == _held.get(own)
    except FileNotFoundError:
        is_own = False
    if not is_own:
        raise TakenOver(f"{own.stem} was taken over by another process, which continues it")


def clear_attempt(own: Path) -> None:
    """Remove what is in the folder of an attempt, and keep the folder, whose inode is that of the attempt."""
    for path in own.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def attempts_in(folder: Path) -> dict[str, list[Path]]:
    """Return the folders of attempts at tasks below `folder` by the tasks' names, those that came furthest first."""
    found: dict[str, list[Path]] = {}
    with suppress(FileNotFoundError, NotADirectoryError):
        for path in (folder / ATTEMPTS).iterdir():
            if path.is_dir():
                found.setdefault(path.stem, []).append(path)
    for paths in found.values():
        if len(paths) > 1:
            paths.sort(key=lambda path: (-(last_time(path / "history.csv") or 0.0), path.name))
    return found


def _take(folder: Path, own: Path) -> None:
    while True:
        with suppress(FileNotFoundError):  # another process was faster
            if folder.is_dir():
                refuse_in_use(folder)
            elif folder.is_file():
                raise OutputError(f"{folder} is a file; move it elsewhere, then continue")
            try:
                own.parent.mkdir(parents=True, exist_ok=True)
            except FileExistsError:
                if own.parent.is_file():
                    raise
                continue  # another process has removed it at this moment
            if folder.is_dir():
                os.rename(folder, own)
            elif begun := attempts_in(folder.parent).get(folder.name):
                os.rename(begun[0], own)
            else:
                own.mkdir()
                if folder.is_dir():  # it was put back meanwhile
                    own.rmdir()
                    continue
            break
    for lock in (own / LOCK, *own.glob(f"replicas/*/{LOCK}")):  # of the processes that had it
        lock.unlink(missing_ok=True)


def _put_back(own: Path, folder: Path, is_done: Callable[[Path], bool]) -> None:
    try:
        refuse_taken_over(own)
    except TakenOver:
        shutil.rmtree(own, ignore_errors=True)  # what a child of this process has made under the former name
        raise
    while not _moved_back(own, folder):
        if is_done(folder):
            shutil.rmtree(own, ignore_errors=True)
            break
        with suppress(FileNotFoundError):  # the other one was taken meanwhile
            os.rename(folder, next_aside(folder))
    with suppress(OSError):  # others are at work
        own.parent.rmdir()


def _moved_back(own: Path, folder: Path) -> bool:
    """Move the folder of an attempt to its task's name, an empty one to nowhere; False where another one lies there."""
    try:
        if any(own.iterdir()):
            os.rename(own, folder)
        else:
            own.rmdir()
    except FileNotFoundError:
        raise TakenOver(f"{folder.name} was taken over by another process, which continues it") from None
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        return False
    return True
