"""One writer a folder: a lock that every program that writes a run or a study holds while it does.

Two programs in one folder would interleave their rows and replace each other's checkpoints. The lock is the kernel's
(``flock`` on ``emclutch.lock`` in the folder), not the file's existence, nor a number in it that is compared with the
processes that run: the kernel releases it when its process ends in whatever way. So the file that a killed run leaves
behind locks nothing, and a process number that is given out again deceives nobody. What stands in the file - process,
host, time - is for the message alone. A library (filelock) would add a dependency and no such message.

On a filesystem without ``flock`` (some network mounts, and systems other than POSIX) the file's exclusive creation is
the lock. There a stale one can be recognised, by its process on the same host, but not taken over without a race: the
user is told which file to remove.
"""

from __future__ import annotations

import datetime
import errno
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from emclutch.results.atomic_file import is_unfinished
from emclutch.results.output_error import OutputError

try:
    import fcntl
except ImportError:  # not POSIX
    fcntl = None  # type: ignore[assignment]

LOCK = "emclutch.lock"
_NO_FLOCK = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}


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
        held = _take(path)
    except OSError as error:
        raise OutputError(
            f"cannot write to {folder}: {error.strerror or error}; write elsewhere with --out, or make room or "
            "permissions there"
        ) from error
    try:
        yield
    finally:
        if fcntl is None:
            os.close(held)  # such systems remove no open file
        with suppress(OSError):  # a folder that was moved or made read-only meanwhile is no reason to fail
            # While it is held: whoever opened the file before finds in `_take` that it is not the folder's any more.
            if fcntl is None or _is_still(path, held):  # not another's, in a folder that took this one's name
                path.unlink(missing_ok=True)
        if fcntl is not None:
            os.close(held)


def has_files(folder: str | Path) -> bool:
    """Return whether anything lies in a folder but a lock and what a killed process had begun to write."""
    return any(entry.name != LOCK and not is_unfinished(entry) for entry in Path(folder).iterdir())


def _take(path: Path) -> int:
    """Descriptor of the lock's file, held."""
    while True:
        try:
            descriptor, is_new = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                descriptor, is_new = os.open(path, os.O_RDWR), False
            except FileNotFoundError:
                continue  # its holder has just let go
        try:
            by_kernel = _flock(descriptor)
            if not by_kernel and not is_new:
                raise _left_or_in_use(path)
            if not by_kernel or _is_still(path, descriptor):
                os.ftruncate(descriptor, 0)
                os.write(descriptor, _own_words())
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            raise _in_use(path, "wait for it, or stop it") from None
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # the former holder removed it between our opening and locking


def _flock(descriptor: int) -> bool:
    """Lock an open file without waiting; False where the system or the filesystem has no such locks."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno in _NO_FLOCK:
            return False
        raise
    return True


def _is_still(path: Path, descriptor: int) -> bool:
    """Return whether an open file is the one of that name."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _own_words() -> bytes:
    since = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    return json.dumps({"pid": os.getpid(), "host": platform.node(), "since": since}).encode() + b"\n"


def _holder(path: Path) -> dict | None:
    """Return what the holder wrote; None where it has not yet, or it cannot be read."""
    try:
        holder = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return holder if isinstance(holder, dict) and isinstance(holder.get("pid"), int) else None


def _in_use(path: Path, remedy: str) -> FolderInUse:
    holder = _holder(path)
    who = "another process"
    if holder is not None:
        who = f"process {holder['pid']} on {holder.get('host')}, since {holder.get('since')}"
    return FolderInUse(f"{path.parent} is in use by {who}; {remedy}, or write elsewhere with --out")


def _left_or_in_use(path: Path) -> OutputError:
    """Return why a file that is there means a lock, where the file itself is the lock."""
    holder = _holder(path)
    if holder is not None and holder.get("host") == platform.node() and not _runs(holder["pid"]):
        return OutputError(
            f"{path.parent} was left by process {holder['pid']}, which does not run any more, on a filesystem without "
            f"locks; remove {path}, then go on"
        )
    return _in_use(path, f"wait for it, or stop it; if it does not run any more, remove {path}")


def _runs(pid: int) -> bool:
    """Return whether a process of that number runs on this host; True where that cannot be told."""
    if os.name != "posix" or pid <= 0:  # elsewhere `kill` would end it
        return True
    try:
        os.kill(pid, 0)  # signal 0 is sent to nobody: it only asks
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
