"""One writer a folder: a lock that every program that writes a run or a study holds while it does.

Two programs in one folder would interleave their rows and replace each other's checkpoints. The lock is the kernel's
(``flock`` on ``emclutch.lock`` in the folder), not the file's existence, nor a number in it that is compared with the
processes that run: the kernel releases it when its process ends, however it ends. So the file that a killed run leaves
behind locks nothing, and a process number that is given out again deceives nobody. What stands in the file - process,
host, time - is for the message alone.

Some file systems of clusters have no locks (Lustre with ``noflock``). There the file is read instead: a process of this
machine that lives is refused as ever; whether one of another machine does is not known, and it is taken for ended.
"""

from __future__ import annotations

import datetime
import errno
import fcntl
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from emclutch.results.atomic_file import is_unfinished
from emclutch.results.errors import OutputError

LOCK = "emclutch.lock"


class FolderInUse(OutputError):
    """Somebody else writes the folder."""


@contextmanager
def locked_folder(folder: str | Path) -> Iterator[None]:
    """Hold a folder for writing inside a ``with`` block; it is made if it is missing.

    Raises
    ------
    FolderInUse
        Another process (or another part of this one) holds it.
    OutputError
        It cannot be made or written.
    """
    path = Path(folder) / LOCK
    try:
        if Path(folder).exists() and not Path(folder).is_dir():
            raise OutputError(f"{folder} is a file; name a folder with --out")
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = _take(path)
    except OSError as error:
        if error.errno == errno.ELOOP:  # of O_NOFOLLOW: what it points to belongs to somebody else
            raise OutputError(f"{path} is a symbolic link; remove it, then continue") from error
        raise OutputError(
            f"cannot write to {folder}: {error.strerror or error}; write elsewhere with --out, free disk "
            "space or fix the write permission"
        ) from error
    try:
        yield
    finally:
        with suppress(OSError):  # a folder that was moved or made read-only meanwhile is no reason to fail
            # While it is held: whoever opened the file before finds in `_take` that it is not the folder's any more.
            if _is_still(path, descriptor):  # not another's, in a folder that took this one's name
                path.unlink(missing_ok=True)
        os.close(descriptor)


def refuse_in_use(folder: Path) -> None:
    """Raise `FolderInUse` where a process holds a folder; nothing is made in it."""
    path = folder / LOCK
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        return
    try:
        _lock(path, descriptor)
    except BlockingIOError:
        raise FolderInUse(f"{folder} is in use by {_holder(path)}; wait for it, or stop it") from None
    finally:
        os.close(descriptor)


def has_files(folder: str | Path) -> bool:
    """True if anything lies in a folder but a lock and what a killed process had begun to write."""
    return any(entry.name != LOCK and not is_unfinished(entry) for entry in Path(folder).iterdir())


def _take(path: Path) -> int:
    """Return the descriptor of the lock's file, held."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        try:
            _lock(path, descriptor)
            if _is_still(path, descriptor):
                os.ftruncate(descriptor, 0)
                os.write(descriptor, _own_words())
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            raise FolderInUse(
                f"{path.parent} is in use by {_holder(path)}; wait for it, or stop it, or write elsewhere with --out"
            ) from None
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # the former holder removed it between our opening and locking


def _lock(path: Path, descriptor: int) -> None:
    """Lock an open file; BlockingIOError where somebody else has it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):
            raise
        holder = _read(path)
        if holder.get("host") == platform.node() and holder.get("began") == _began(holder.get("pid")) is not None:
            raise BlockingIOError(errno.EAGAIN, "held") from None


def _is_still(path: Path, descriptor: int) -> bool:
    """True if an open file is the one of that name."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _own_words() -> bytes:
    since = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    own = {"pid": os.getpid(), "host": platform.node(), "since": since, "began": _began(os.getpid())}
    return json.dumps(own).encode() + b"\n"


def _began(pid: Any) -> str | None:
    """Return when a process of this machine began, in the kernel's ticks; None where it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return None
    return fields[19] if fields[0] not in "ZX" else None


def _holder(path: Path) -> str:
    """Return who holds the lock, in words."""
    holder = _read(path)
    if not {"pid", "host", "since"} <= set(holder):  # it has not written that yet
        return "another process"
    return f"process {holder['pid']} on {holder['host']}, since {holder['since']}"


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
