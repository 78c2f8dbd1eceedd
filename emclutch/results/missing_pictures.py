"""Check for a finished run that was killed before its pictures were drawn."""

from __future__ import annotations

import tomllib

from emclutch.results.run_folder import RunFolder


def pictures_are_missing(folder: RunFolder) -> bool:
    """Return whether a run is done, was to draw pictures, lacks the last one, and has the checkpoint to draw it of."""
    if not folder.summary.is_file() or folder.grains_picture.is_file() or not folder.checkpoint.is_file():
        return False
    return bool(tomllib.loads(folder.read_case()).get("output", {}).get("pictures", True))
