"""Free disk space, and the refusal of a run that needs more."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

from emclutch.simulation.forecast.free_memory import MIB


class NotEnoughDisk(ValueError):
    """A run needs more disk than is free."""


def refuse_full_disk(needed: float, folder: str | Path, *, force: bool = False) -> None:
    """Raise `NotEnoughDisk` where `needed` [MiB] is more than is free in `folder`, unless `force`."""
    with suppress(OSError):  # not known: the run finds out
        free = shutil.disk_usage(folder).free / MIB
        if needed > free and not force:
            raise NotEnoughDisk(
                f"the run needs about {needed:.0f} MiB of disk, and {free:.0f} MiB are free in {folder}: write "
                "elsewhere with --out, take fewer snapshots (output.snapshots) or formats (output.formats), a longer "
                "time.window, or run all the same with --force"
            )
