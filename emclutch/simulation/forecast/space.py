"""Memory and disk that a run needs, and what is free of them; a run that needs more is refused unless it is forced.

What is needed was measured as resident sizes and folders of shipped cases.
"""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.device_model.device import Device
    from emclutch.scene.model import Scene

MIB = 2**20
# MiB of the program, of what a field and what pictures load (compiling takes some 200 more, once)
BASE_MIB, FIELD_MIB, PICTURES_MIB = 220.0, 110.0, 60.0
# Bytes in memory: a grain, one of its neighbours, an unknown of the field in the section and in 3D, a window's row
GRAIN, NEIGHBOUR, UNKNOWN, SOLID_UNKNOWN, WINDOW = 4000.0, 50.0, 4000.0, 5000.0, 2000.0
# Bytes on disk: a grain's frame in each format, an unknown's; a row of the history, and in the record; a grain and an
# unknown of the checkpoint; the rest
FRAME = {"vtk": 260.0, "hdf5": 120.0}
FIELD_FRAME, HISTORY, RECORD, CHECKPOINT, UNKNOWN_CHECKPOINT, REST_MIB = 39.0, 800.0, 1200.0, 1200.0, 30.0, 3.0
_GROUP, _OLD_GROUP = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/memory")
_NAMES = ((_GROUP, "memory.max", "memory.current"), (_OLD_GROUP, "memory.limit_in_bytes", "memory.usage_in_bytes"))


class NotEnoughSpace(ValueError):
    """A run needs more memory or disk than is free."""


def memory(scene: Scene, device: Device, windows: int) -> float:
    """Memory [MiB] that a run holds at most, but for compiling; the history is read as a whole in the end."""
    neighbours = sum(one.neighbours(scene, device) for one in scene.effects.present)
    kept = BASE_MIB + PICTURES_MIB * scene.output.pictures
    used = device.fill.count * (GRAIN + NEIGHBOUR * neighbours) + windows * WINDOW
    if device.coil is not None:
        kept += FIELD_MIB
        used += (SOLID_UNKNOWN if device.section_coil is None else UNKNOWN) * device.coil.problem.n_dofs
    return kept + used / MIB


def disk(scene: Scene, device: Device, windows: int) -> float:
    """Disk [MiB] that a run's folder takes in the end."""
    output, count = scene.output, device.fill.count
    unknowns = 0 if device.coil is None else device.coil.problem.n_dofs
    frames = output.snapshots + 1
    used = frames * count * sum(FRAME[kind] for kind in output.formats)
    used += windows * (HISTORY + RECORD * ("hdf5" in output.formats))
    used += frames * unknowns * FIELD_FRAME * ("vtk" in output.formats)
    used += (CHECKPOINT * count + UNKNOWN_CHECKPOINT * unknowns) * output.checkpoint
    return REST_MIB + used / MIB


def refuse_too_much(needed: float, *, force: bool = False) -> None:
    """Raise `NotEnoughSpace` where `needed` [MiB] is more than the free memory, unless `force` or it is not known."""
    if not force and (text := shortage(needed)):
        raise NotEnoughSpace(f"{text}; or run all the same with --force")


def refuse_full_disk(needed: float, folder: str | Path, *, force: bool = False) -> None:
    """Raise `NotEnoughSpace` where `needed` [MiB] of disk is more than is free in `folder`, unless `force`."""
    with suppress(OSError):  # not known: the run finds out
        free = shutil.disk_usage(folder).free / MIB
        if needed > free and not force:
            raise NotEnoughSpace(
                f"the run needs about {needed:.0f} MiB of disk, and {free:.0f} MiB are free in {folder}: write "
                "elsewhere with --out, take fewer snapshots (output.snapshots) or formats (output.formats), a longer "
                "time.window, or run all the same with --force"
            )


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
