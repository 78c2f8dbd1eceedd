"""Folders of studies that continue after they were stopped or killed: their file of decisions says how."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from emclutch.results import OutputError
from emclutch.results.folder_lock import has_files
from emclutch.results.text import format_duration
from emclutch.scene.case import Case
from emclutch.simulation.resume import differing_keys, flat_scene


def refuse_folder(folder: Path, resume: bool, plan: str) -> None:
    """Raise OutputError where a study cannot begin, or has nothing to continue."""
    if resume and not (folder / plan).is_file():
        raise OutputError(f"nothing to resume in {folder}: it has no {plan}; name the study's folder with --out")
    if not resume and folder.is_dir() and has_files(folder):
        how = "continue it with --resume, or " if (folder / plan).is_file() else ""
        raise OutputError(f"{folder} is not empty; {how}write elsewhere with --out")


def read_plan(path: Path, case: Case, budget: float | None) -> dict[str, Any]:
    """Return the decisions of a study; OutputError where it is of another scene or budget."""
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        keys = differing_keys(flat_scene(known["case"]), flat_scene(case.toml()))
        begun = float(known["budget"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"cannot read {path}: {error}; begin a new study with --out") from None
    place = f"the study in {path.parent}"
    if keys:
        raise OutputError(f"{place} is of another scene ({', '.join(keys)}); begin a new one with --out")
    if budget is not None and budget != begun:
        raise OutputError(
            f"{place} has a budget of {format_duration(begun)}, by which it was planned; continue it "
            "without --budget, or begin a new one with --out"
        )
    return known
