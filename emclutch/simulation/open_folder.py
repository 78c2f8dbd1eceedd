"""A run's folder while the run works in it: locked, with its log open and errors translated."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from emclutch.results import OutputError, RunFolder
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import locked_folder
from emclutch.results.report.run_report import write_failed_index
from emclutch.scene.case import Case
from emclutch.simulation.forecast.space import NotEnoughSpace
from emclutch.simulation.kernel_compilation import Compiled, reported_compilation
from emclutch.simulation.resume import may_go_on
from emclutch.simulation.run_progress import RunProgress
from field import ConvergenceError, PointOutside
from particles import DemError, DemErrorKind, ParticleError

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class OpenFolder:
    """A locked folder of a run.

    Attributes
    ----------
    folder : RunFolder
    is_resumed : bool
        True if the run continues from a checkpoint in it.
    compiled : Compiled
        What has been compiled since it was opened.
    begin : float
        Reading of the wall clock when it was opened [s].
    """

    folder: RunFolder
    is_resumed: bool
    compiled: Compiled
    begin: float


@contextmanager
def open_folder(case: Case, target: str | Path, resume: bool, progress: RunProgress) -> Iterator[OpenFolder]:
    """Hold a run's folder, fit to continue in; what fails in the block is reported as a RunError or OutputError."""
    begin = perf_counter()
    if resume:  # before the lock makes a folder
        RunFolder(target).has_checkpoint()
    with locked_folder(target):
        is_resumed = resume and may_go_on(case, RunFolder(target))  # compared before anything in the folder is touched
        folder = RunFolder.create(target, case.toml(), resume=resume)
        with folder.logging(), reported_compilation(progress.log) as compiled:
            if resume and not is_resumed:
                progress.log(f"{folder.path} has no checkpoint yet: the run starts again")
            with translate_errors(case, folder):
                yield OpenFolder(folder, is_resumed, compiled, begin)


@contextmanager
def translate_errors(case: Case, folder: RunFolder) -> Iterator[None]:
    """Log an error and raise it as a RunError, or as an OutputError where it is the disk's."""
    try:
        yield
    except KeyboardInterrupt as error:  # before there was a window to end, or in a kernel that was compiled
        log.info("stopped by the user at once")
        saved = "the state of the last checkpoint is kept" if folder.checkpoint.is_file() else "nothing is saved yet"
        how = f"continue with: emclutch run {folder.path} --resume" if folder.is_begun() else "run it again"
        raise Interrupted(f"stopped at once, {saved}; {how}") from error
    except (ConvergenceError, ParticleError, PointOutside, ValueError) as error:
        text = f"{error}{remedy_in_scene(case, error)}"
        log.error("%s", text)
        if not isinstance(error, NotEnoughSpace):  # what the machine lacks today
            write_failed_index(folder, text)
        raise RunError(f"{text}\n(log: {folder.log})") from error
    except OSError as error:
        text = f"{error.filename or folder.path}: {error.strerror or error}"
        log.error("%s", text)
        how = f"continue with: emclutch run {folder.path} --resume" if folder.is_begun() else "start again"
        raise OutputError(f"{text}; check the path, its free space and its permissions, then {how}") from error


def remedy_in_scene(case: Case, error: Exception) -> str:
    """Keys of the scene that remedy too deep overlaps; empty for other errors."""
    contact = case.scene.contact
    if contact.method != "dem" or not isinstance(error, DemError) or error.kind is not DemErrorKind.OVERLAP:
        return ""
    entry = contact.stiffness_entry
    key, softer = f"contact.{entry.name}", getattr(contact, entry.name)
    if softer is None:
        change = f"lower contact.max_overlap = {contact.max_overlap:g} to a quarter, or give {entry}"
    else:
        change = f"raise {key} = {softer:g} fourfold, or leave it out: it then follows from contact.max_overlap"
    step = "; time.step too must then be shorter" if case.scene.span.step is not None else ""
    return f". In the scene: {change}{step}. A changed contact needs a new run: take another --out, not --resume"
