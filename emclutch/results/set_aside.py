"""The folder of a run that has no checkpoint is renamed for a new one, and keeps what it holds."""

from __future__ import annotations

import os
from pathlib import Path

from emclutch.results.folder_lock import LOCK, locked_folder


def set_aside(path: Path) -> Path:
    """Give the folder of a run that has no checkpoint another name, the next free one, and return that."""
    number = 1
    while (aside := path.with_name(f"{path.name}-set-aside-{number}")).exists():
        number += 1
    with locked_folder(path):  # nobody is at work in it
        os.rename(path, aside)
        (aside / LOCK).unlink()
    return aside
