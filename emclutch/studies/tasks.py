"""One point of a study as a task for any executor: plain data goes in, plain data comes out.

A task may run in this process, in another one or on another machine; all that it shares with the study is the file
system. What it finds lies in its folder, how far it is stands in the last row of its history, and that it shall end is
said by a file in the study's folder, which it looks for after every window.
"""

from __future__ import annotations

import logging
import time
import traceback
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from emclutch.results import OutputError
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.lease import Lease, LeaseLost, leased_in_turn
from emclutch.results.study_table import DONE, FAILED, STOPPED
from emclutch.scene.case import Case, case_from
from emclutch.scene.errors import SceneError
from emclutch.simulation.run import run
from emclutch.studies.point_index import lease_of
from emclutch.studies.points import can_resume, is_done_now

log = logging.getLogger(__name__)
STOP = "stop-asked"
LOOK_SECONDS = 0.2  # between two looks for the file: windows may be shorter, and file systems far away


@dataclass(frozen=True, slots=True)
class PointTask:
    """Input of one point.

    Attributes
    ----------
    data, path, trust_scripts : of its case, see `emclutch.scene.case.Case`; paths are absolute, for workers that stand
        in another folder.
    folder : of the point, inside the study's.
    threads : of the kernels; None: ``OMP_NUM_THREADS``, or all cores.
    resume : continue from the checkpoint in `folder`.
    start : folder of the run whose grains the point begins with; None packs its own.
    force : run also where more memory is needed than is free.
    target : total error that the settings were chosen for, relative; None: they were not.
    """

    data: dict[str, Any]
    path: str | None
    trust_scripts: bool
    folder: str
    threads: int | None = None
    resume: bool = False
    start: str | None = None
    force: bool = False
    target: float | None = None

    def case(self) -> Case:
        """The point's case."""
        path = None if self.path is None else Path(self.path)
        return case_from(self.data, None, path, trust_scripts=self.trust_scripts)


@dataclass(frozen=True, slots=True)
class PointOutcome:
    """Outcome of a task.

    Attributes
    ----------
    state : DONE, FAILED or STOPPED.
    message : why it failed.
    is_input : whether input or output is what it failed of, and no run.
    """

    state: str
    message: str = ""
    is_input: bool = False


def run_leased_point(task: PointTask, progress: Any = None) -> PointOutcome:
    """Run one point, as `run_point` does, on a worker that cannot know whether another one has it, or had it.

    It is run under its lease (`emclutch.results.lease`). While another process holds that, it is waited for; what it
    has done is kept then, and what it has begun is continued from its checkpoint. `task.resume` has no meaning.
    """
    folder = Path(task.folder)
    asked = StopAsked(folder.parent)
    while True:
        try:
            with leased_in_turn(lease_of(folder), str(folder), lambda: asked.stop_asked) as lease:
                return PointOutcome(STOPPED) if lease is None else _run_under(lease, task, progress)
        except LeaseLost as error:  # and wait for the one that has it now
            log.warning("%s", error)


def _run_under(lease: Lease, task: PointTask, progress: Any) -> PointOutcome:
    """Run what is left of a point, once its lease is held."""
    folder = Path(task.folder)
    try:
        case = task.case()
        if is_done_now(folder, case, ["time.end"]):
            return PointOutcome(DONE)
        resumed = can_resume(case, folder, True)
    except SceneError as error:
        return PointOutcome(FAILED, error.report(), is_input=True)
    except OutputError as error:
        return PointOutcome(FAILED, str(error), is_input=True)
    return run_point(replace(task, resume=resumed), progress, lease)


def run_point(task: PointTask, progress: Any = None, lease: Lease | None = None) -> PointOutcome:
    """Run one point; whatever it fails of is the outcome's message, so that the other points continue.

    Raises
    ------
    LeaseLost
        Another process has taken the point over while this one was suspended.
    """
    folder = Path(task.folder)
    asked = StopAsked(folder.parent, progress, lease)
    if asked.stop_asked:
        return PointOutcome(STOPPED)
    try:
        run(
            task.case(),
            out=folder,
            threads=task.threads,
            progress=asked,
            resume=task.resume,
            start=task.start,
            force=task.force,
            accuracy_target=task.target,
        )
    except (Interrupted, KeyboardInterrupt):
        return PointOutcome(STOPPED)
    except LeaseLost:
        raise
    except SceneError as error:
        return PointOutcome(FAILED, error.report(), is_input=True)
    except OutputError as error:
        return PointOutcome(FAILED, str(error), is_input=True)
    except OSError as error:
        reason = f"{error.filename or folder}: {error.strerror or error}; check the path, its permissions and its room"
        return PointOutcome(FAILED, reason, is_input=True)
    except RunError as error:
        return PointOutcome(FAILED, str(error))
    except Exception as error:  # a defect of the program is one point's, too
        log.exception("%s: defect of the program", folder.name)
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        reason = f"defect of the program, please report it: {type(error).__name__}: {error} ({place})"
        return PointOutcome(FAILED, reason)
    return PointOutcome(DONE)


class StopAsked:
    """The progress of a run, and whether the file is there that asks it to stop.

    Parameters
    ----------
    folder : of the study.
    progress : notified of the run's progress, or None.
    lease : of the point, or None; where it is lost, the run ends without another word in its folder.
    """

    def __init__(self, folder: Path, progress: Any = None, lease: Lease | None = None) -> None:
        self._file, self._progress, self._lease = folder / STOP, progress, lease
        self._looked = -LOOK_SECONDS
        self._asked = False

    @property
    def stop_asked(self) -> bool:
        """Looks for the file now and then, until it was there; `LeaseLost` where another has taken the point."""
        if self._lease is not None:
            self._lease.refuse_lost()
        now = time.monotonic()
        if not self._asked and now - self._looked >= LOOK_SECONDS:
            self._asked, self._looked = self._file.exists(), now
        return self._asked

    def update(self, fraction: float, text: str) -> None:
        """See `emclutch.results.progress.Progress`."""
        if self._progress is not None:
            self._progress.update(fraction, text)

    def status(self, text: str) -> None:
        """See `emclutch.results.progress.Progress`."""
        if (status := getattr(self._progress, "status", None)) is not None:
            status(text)
