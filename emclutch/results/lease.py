"""A lease on a name in a folder that several machines see, without file locks.

File systems of clusters have `flock` for all machines (NFS 4, GPFS), for each machine alone (Lustre with
``localflock``, NFS with ``nolock``), or not at all. What all of them have (NFS from version 3 on) is that of several
who make one file with ``O_EXCL`` one succeeds. So a lease is a file ``NAME.1.lease`` that its holder makes, sets the
time of every `RENEW_SECONDS`, and removes in the end. Who finds one takes the next number, if the holder has ended: on
the same machine that is known at once (its process is there or not); of another machine the lease is watched, and has
expired if its time does not change for `EXPIRE_SECONDS`. Two times of one file are compared, never a time with a clock.

Of several who take an expired lease at the same moment, one makes the next number; the others are refused. A process
that is suspended for longer than `EXPIRE_SECONDS` may lose its lease; it learns so by `Lease.refuse_lost`.
"""

from __future__ import annotations

import itertools
import json
import logging
import math
import os
import platform
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from emclutch.results.folder_lock import FolderInUse

log = logging.getLogger(__name__)
RENEW_SECONDS = 20.0
EXPIRE_SECONDS = 300.0
"""A kernel that is compiled may keep a holder from renewing for a minute."""
LOOK_SECONDS = 5.0  # between two looks at a lease that is watched
WAIT_SECONDS = 1.0  # between two tries to take a lease in turn
LIVES, ENDED, GONE = "lives", "has ended", "is gone"
_numbers_of_leases = itertools.count()
_held_here: set[int] = set()  # numbers of the leases that this process holds, or is about to take


class LeaseLost(FolderInUse):
    """A lease expired while its holder was suspended, and another process has taken it."""


class Lease:
    """A lease that is held.

    Parameters
    ----------
    file : of the lease.
    text : that its holder has written there.
    what : is leased, for the message.
    """

    def __init__(self, file: Path, text: str, what: str) -> None:
        self._file, self._text, self._what = file, text, what
        self._renewed = _seconds()

    @property
    def is_held(self) -> bool:
        """True if the lease's file is still the holder's, or cannot be read: then nobody is known to have it."""
        return self._is_own() is not False

    def _is_own(self) -> bool | None:
        """None where the file's server does not answer."""
        try:
            return self._file.read_text(encoding="utf-8") == self._text
        except FileNotFoundError:
            return False
        except OSError:
            return None

    def renew(self) -> None:
        """Set the time of the file, or note that it is lost; nothing where its server does not answer."""
        own = self._is_own()
        if own:
            with suppress(OSError):  # it may do so the next time
                os.utime(self._file)
                self._renewed = _seconds()
        elif own is False:
            self._renewed = -math.inf

    def refuse_lost(self) -> None:
        """Raise `LeaseLost` where another has the lease. The file is looked at after a pause in renewing, or a loss."""
        if _seconds() - self._renewed > 0.5 * EXPIRE_SECONDS and not self.is_held:
            raise LeaseLost(
                f"{self._what} was taken over by another process while this one was suspended; it is left to that one"
            )

    def give_back(self) -> None:
        """Remove the file, unless it is another's, or its server does not answer."""
        if self._is_own():
            with suppress(OSError):
                self._file.unlink(missing_ok=True)


def _seconds() -> float:
    """Time that goes on while the machine sleeps [s]."""
    return time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


@contextmanager
def leased(path: Path, what: str, gives_up: Callable[[], bool] = lambda: False) -> Iterator[Lease]:
    """Hold the lease of a name inside a ``with`` block, or refuse.

    Parameters
    ----------
    path : folder and name of the lease; its file has a number and ``.lease`` appended. The folder is made.
    what : is leased, for the message.
    gives_up : where it is true, a holder on another machine is not watched any longer, and counts as one that lives.

    Raises
    ------
    FolderInUse
        Somebody holds it. Where the holder is on another machine, this is known as soon as it renews the lease, and
        that it has ended after `EXPIRE_SECONDS`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    number = next(_numbers_of_leases)
    _held_here.add(number)
    try:
        held = Lease(*_take(path, what, number, gives_up), what)
        ended = threading.Event()
        renewing = threading.Thread(target=_renew, args=(held, ended), name=f"lease of {what}", daemon=True)
        renewing.start()
        try:
            yield held
        finally:
            ended.set()
            renewing.join()
            held.give_back()
    finally:
        _held_here.remove(number)


@contextmanager
def leased_in_turn(path: Path, what: str, gives_up: Callable[[], bool] = lambda: False) -> Iterator[Lease | None]:
    """Hold a lease as `leased` does, after waiting for whoever holds it; None where `gives_up` is true before."""
    with ExitStack() as stack:
        lease = None
        while lease is None and not gives_up():
            try:
                lease = stack.enter_context(leased(path, what, gives_up))
            except FolderInUse as error:
                log.info("%s", error)
                time.sleep(WAIT_SECONDS)
        yield lease


def lease_holder(path: Path) -> str | None:
    """Return in words who holds the lease of a name; None where nobody does.

    Of another machine it may be one that was killed: that is not waited for.
    """
    numbers = _numbers(path)
    if not numbers or _lives(file := _file(path, max(numbers))) is False:
        return None
    return _in_words(file)


def _take(path: Path, what: str, number_here: int, gives_up: Callable[[], bool]) -> tuple[Path, str]:
    """Return the file of a new lease, and what stands in it."""
    judged, last = "", max(_numbers(path), default=0)
    while last:
        judged, state = _text(str(_file(path, last))), _state_of(_file(path, last), gives_up)
        if state == LIVES:
            raise _refusal(path, last, what)
        if state == ENDED:
            break
        last = max(_numbers(path), default=0)  # it is gone: others may have come since
    own, text = _file(path, last + 1), json.dumps(_own_marks() | {"lease": number_here})
    try:
        descriptor = os.open(own, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    except FileExistsError:
        raise _refusal(path, last + 1, what) from None
    with open(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
    numbers = _numbers(path)
    again = max(numbers) > last + 1 or (last in numbers and _text(str(_file(path, last))) != judged)
    if again:  # taken, given back and taken again by others since we looked
        own.unlink(missing_ok=True)
        raise _refusal(path, max({*numbers} - {last + 1}), what)
    for number in numbers:
        if number <= last:
            _file(path, number).unlink(missing_ok=True)
    return own, text


def _renew(held: Lease, ended: threading.Event) -> None:
    while not ended.wait(RENEW_SECONDS):
        held.renew()


def _state_of(file: Path, gives_up: Callable[[], bool]) -> str:
    """Return whether the holder of a lease lives, or has ended; it is watched where its process cannot be seen."""
    lives = _lives(file)
    if lives is not None:
        return LIVES if lives else ENDED
    before, end = None, time.monotonic() + EXPIRE_SECONDS
    while True:
        try:
            now = _renewed(file)
        except FileNotFoundError:
            return GONE
        except OSError:  # nothing is known from this look
            now = None
        if before is not None and now is not None and now != before:
            return LIVES
        before = before if now is None else now
        if gives_up():
            return LIVES
        if time.monotonic() > end:
            return LIVES if before is None else ENDED  # never read: who could say that it has ended
        time.sleep(LOOK_SECONDS)


def _lives(file: Path) -> bool | None:
    """True if the holder of a lease is a process of this machine that runs, False if it has ended; None of others.

    A lease of this process has ended if it could not be removed when it was given back.
    """
    marks, own = _marks(file), _own_marks()
    if not marks or any(marks.get(name) != own[name] for name in ("host", "boot", "processes")):
        return None
    if (marks.get("pid"), marks.get("began")) == (own["pid"], own["began"]):
        return marks.get("lease") in _held_here
    return _began(marks.get("pid")) == marks.get("began")


def _renewed(file: Path) -> int:
    """Return when a lease was renewed last. Opening the file makes NFS ask its server."""
    with file.open("rb") as opened:
        return os.fstat(opened.fileno()).st_mtime_ns


def _numbers(path: Path) -> list[int]:
    named = re.compile(rf"{re.escape(path.name)}\.(\d+)\.lease")
    try:
        return [int(match[1]) for name in os.listdir(path.parent) if (match := named.fullmatch(name))]
    except FileNotFoundError:
        return []


def _file(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}.lease")


def _own_marks() -> dict[str, Any]:
    """Return what tells this process from all others that can see the folder."""
    return {
        "pid": os.getpid(),
        "host": platform.node(),
        "boot": _text("/proc/sys/kernel/random/boot_id"),
        "processes": os.readlink("/proc/self/ns/pid"),  # containers count theirs apart
        "began": _began(os.getpid()),
    }


def _began(pid: Any) -> str | None:
    """Return when a process of this machine began, in the kernel's ticks; None where it has ended."""
    fields = _text(f"/proc/{pid}/stat").rpartition(")")[2].split()
    return fields[19] if len(fields) > 19 and fields[0] not in "ZX" else None


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def _marks(file: Path) -> dict[str, Any]:
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _in_words(file: Path) -> str:
    marks = _marks(file)
    return f"process {marks['pid']} on {marks['host']}" if {"pid", "host"} <= set(marks) else "another process"


def _refusal(path: Path, number: int, what: str) -> FolderInUse:
    file = _file(path, number)
    return FolderInUse(
        f"{what} is in use by {_in_words(file)}; wait for it, or stop it (of a process that was killed the lease "
        f"{file} expires by itself)"
    )
