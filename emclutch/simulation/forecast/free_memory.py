"""Free memory, and the refusal of a run that needs more."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

MIB = 2**20
_GROUP, _OLD_GROUP = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/memory")
_NAMES = ((_GROUP, "memory.max", "memory.current"), (_OLD_GROUP, "memory.limit_in_bytes", "memory.usage_in_bytes"))


class NotEnoughMemory(ValueError):
    """A run needs more memory than is free."""


def refuse_too_much(needed: float, *, force: bool = False) -> None:
    """Raise `NotEnoughMemory` where `needed` [MiB] is more than is free, unless `force`, or nothing is known."""
    if not force and (text := shortage(needed)):
        raise NotEnoughMemory(f"{text}; or run all the same with --force")


def shortage(needed: float) -> str:
    """Say by how much `needed` [MiB] exceeds what is free, and what to do; empty where it does not."""
    free = free_memory()
    if free is None or needed <= free:
        return ""
    return (
        f"the run needs about {needed:.0f} MiB of memory, and {free:.0f} MiB are free for it: take a narrower sector "
        "(particles.sector), fewer or larger grains (particles.diameter), a coarser mesh (field.size_factor), or end "
        "other programs"
    )


def free_memory() -> float | None:
    """Memory [MiB] that this process may hold altogether, what it has already included; None if not known.

    What the system can give without swapping, and no more than the control group (a container) allows.
    """
    found = [free for free in (_of_system(), *(_of_group(*names) for names in _NAMES)) if free is not None]
    return (min(found) + _own()) / MIB if found else None


def _of_system() -> float | None:
    """Bytes that can be had without swapping: Linux tells; elsewhere the whole memory stands for it."""
    with suppress(OSError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * float(line.split()[1])
    with suppress(OSError, ValueError, AttributeError):
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return None


def _of_group(folder: Path, most: str, used: str) -> float | None:
    """Bytes that the control group has left; None without one, or without a limit."""
    with suppress(OSError, ValueError):  # no limit is the word "max"
        limit = float((folder / most).read_text(encoding="ascii"))
        return limit - float((folder / used).read_text(encoding="ascii")) + _reclaimable(folder)
    return None


def _reclaimable(folder: Path) -> float:
    """Bytes of files that the group counts as used and gives back at once."""
    with suppress(OSError, ValueError):
        for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines():
            name, _, value = line.partition(" ")
            if name in ("inactive_file", "total_inactive_file"):
                return float(value)
    return 0.0


def _own() -> float:
    """Bytes that this process holds."""
    with suppress(OSError, ValueError, AttributeError):
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
        return float(pages) * os.sysconf("SC_PAGE_SIZE")
    return 0.0
