"""Whether a finished run was killed before it had drawn its pictures."""

from __future__ import annotations

import tomllib

from emclutch.results.run_folder import RunFolder


def pictures_are_missing(folder: RunFolder) -> bool:
    """Whether a run is done, was to draw pictures, lacks the last one, and has the checkpoint to draw it of."""
    if not folder.summary.is_file() or folder.grains_picture.is_file() or not folder.checkpoint.is_file():
        return False
    return bool(tomllib.loads(folder.read_case()).get("output", {}).get("pictures", True))
