"""Conditions of a resume: its own checkpoint, the same input files, the same scene but for end and output."""

from __future__ import annotations

import logging
import tomllib
from pathlib import Path
from typing import Any

from emclutch.results import OutputError, RunFolder
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.columns import TIME
from emclutch.results.history import rows_until
from emclutch.results.run_end import seconds_of
from emclutch.scene.case import Case
from emclutch.scene.flat import differing_keys, flat_scene
from emclutch.scene.input_files import hashed_input_files
from emclutch.scene.scaled import Scaled
from emclutch.scene.timing import instant_in_words

log = logging.getLogger(__name__)
MAY_CHANGE = (
    "time.end", "time.until", "time.average_from", "output.", "accuracy.", "scene.title", "scene.description",
    "particles.powder_law",
)  # fmt: skip
MUST_STAY = (
    "output.energy_budget",  # what a contact remembers has a place for it
    "accuracy.inertial_number",  # as the speeds
)
_OF_A_RUN = ("case", "window", "steps_per_update", "steps", "dem", "rows", "magnetised", "source")


def run_checkpoint(path: str | Path) -> dict[str, Any]:
    """Return the checkpoint of a run, see `emclutch.simulation.checkpoints.save_checkpoint`.

    Raises
    ------
    OutputError
        It cannot be read, or holds something else.
    """
    state = read_checkpoint(path)
    if "updates" in state:  # of an older version, whose windows were of whole intervals between updates
        state["steps"] = state["steps_per_update"] * state["updates"]
    missing = [name for name in _OF_A_RUN if name not in state]
    if missing:
        raise OutputError(f"{path} is not a checkpoint of a run: it lacks {', '.join(missing)}; start again with --out")
    return state


def may_go_on(case: Case, folder: RunFolder) -> bool:
    """True if a run continues from a checkpoint.

    Raises
    ------
    OutputError
        Scene or files differ, or nothing is left to do.
    """
    can_resume = folder.has_checkpoint()
    if can_resume:
        state = run_checkpoint(folder.checkpoint)
        refuse_other_scene(state["case"], case.toml(), folder.path)
        refuse_earlier_end(folder, state, case.scene.span.end)
        rows_until(folder.history, checkpoint_time(folder.checkpoint, state["dem"], case.scene.contact.method))
    else:
        refuse_other_scene(folder.read_case(), case.toml(), folder.path)
    with folder.logging():
        refuse_changed_files(case, folder)
    return can_resume


def refuse_other_scene(old_text: str, new_text: str, target: str | Path) -> None:
    """Raise OutputError unless two scenes differ at most in what a continued run may change: its end and its output."""
    old, new = flat_scene(old_text), flat_scene(new_text)
    differing = [
        f"{key}: {_in_short(old.get(key, 'absent'))} -> {_in_short(new.get(key, 'absent'))}"
        for key in differing_keys(old, new)
        if not may_change(key)
    ]
    if differing:
        contact = any(text.startswith("contact.") for text in differing)
        why = "a changed contact needs a new run: " if contact else ""
        raise OutputError(
            f"the run in {target} belongs to another scene ({'; '.join(differing)}); {why}start again in another "
            f"folder with --out, or continue the old scene with emclutch run {target} --resume"
        )


def refuse_earlier_end(folder: RunFolder, state: dict, end: float | Scaled) -> None:
    """Raise OutputError where a run whose end was set earlier is past it: nothing would be left to do.

    The same end is always allowed: runs of older versions went beyond it.
    """
    time, before = seconds_of(end, folder), seconds_of(tomllib.loads(state["case"])["time"]["end"], folder)
    if time is None or before is None or time >= before or not folder.history.is_file():
        return
    times = folder.read_history()[TIME].to_numpy()
    reached = float(times[min(state["window"], len(times)) - 1]) if len(times) else 0.0
    if time < reached:
        raise OutputError(
            f"time.end = {instant_in_words(end)} is earlier than the checkpoint in {folder.path}, at {reached:.4g} s: "
            f"nothing is left to do, and nothing was changed; give a later time.end, or read the torque until then in "
            f"{folder.history.name}"
        )


def begun_windows(state: dict[str, Any], method: str) -> tuple[float, int, int]:
    """Return the step [s] of the run that a checkpoint is of, and its steps an update and a window."""
    return _step_of(state["dem"], method), state["steps_per_update"], state["steps"]


def _step_of(dem: dict[str, Any], method: str) -> float:
    return float(dem["scalars"][0 if method == "dvi" else 2])


def checkpoint_time(path: Path, dem: dict[str, Any], method: str) -> float:
    """Return the time [s] of the state of a DEM or DVI; OutputError where it is none."""
    try:
        return float(dem["counters"][0] * _step_of(dem, method))
    except (KeyError, IndexError, TypeError) as error:
        raise OutputError(f"{path} is not a checkpoint of a run ({error!r}); start again with --out") from error


def refuse_changed_files(case: Case, folder: RunFolder) -> None:
    """Raise OutputError where a file that the scene names has another content than when the run began.

    A run of a version that kept no hashes continues with a warning in its log.
    """
    now = hashed_input_files(case.scene)
    if not now:
        return
    written = folder.read_provenance()
    entries = [written, *written.get("resumed", [])]  # a run of an older version may have been resumed by this one
    before = next((entry["input_files"] for entry in entries if entry.get("input_files") is not None), None)
    if before is None:
        log.warning("the run did not note the content of its input files; whether they changed since is unknown")
        return
    changed = [
        f"{key} = {file['path']}"
        for key, file in now.items()
        if before.get(key, {}).get("sha256", file["sha256"]) != file["sha256"]
    ]
    if changed:
        raise OutputError(
            f"the run in {folder.path} began with another content of {', '.join(changed)} (its sha256 differs from the "
            f"one in {folder.provenance.name}); put the former file back, or start again in another folder with --out"
        )


def may_change(key: str) -> bool:
    """True if a continued run may have another value of a dotted key."""
    return key not in MUST_STAY and key.startswith(MAY_CHANGE)


def _in_short(value: Any) -> str:
    """Return a value as text, shortened: the points of a curve are too many for a message."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:50]} ..."
