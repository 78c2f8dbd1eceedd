"""One scene from its file to a torque: plan, pack, march, write."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from emclutch.device_model.device import field_is_needed
from emclutch.results import Result, RunFolder
from emclutch.results.history import last_time
from emclutch.results.measured_table import TORQUE_CURVE, keep_measured, read_measured
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.replica_count import max_replica_count, replicas_side_by_side
from emclutch.simulation.finished_run import finish_run
from emclutch.simulation.kernel_compilation import interruptible
from emclutch.simulation.open_folder import open_folder
from emclutch.simulation.planned_run import plan_run
from emclutch.simulation.replicas import ReplicaControl, Replicas, count_of_run, other_replicas
from emclutch.simulation.run_observers import make_callbacks, march
from emclutch.simulation.run_progress import RunProgress
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.started_run import start_run
from emclutch.simulation.threads import check_threads, may_tune_threads, use_threads
from emclutch.simulation.warm_start import starting_grains
from emclutch.simulation.window_state import WindowState


def run(
    case: Case | str | Path,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress=None,
    start: str | Path | None = None,
    force: bool = False,
    callback: Callable[[WindowState], object] | None = None,
    measured: str | Path | None = None,
    accuracy_target: float | None = None,
) -> Result:
    """Run a scene whose settings are its own and return its result; see `emclutch.run`, which takes a target, too.

    Parameters
    ----------
    case, out, threads, resume, progress, start, force, callback, measured : as of `emclutch.run`
    accuracy_target : total error that the settings were chosen for (`emclutch.studies.accuracy.target`): the run's
        folder keeps it, and its summary says whether it was reached.

    Raises
    ------
    CallbackError, OutputError, RunError
        As `emclutch.run`.
    SceneError
        The scene has a target itself.
    """
    case = as_case(case)
    refuse_target(case)
    target = out or case.scene.output.folder or RunFolder.next_path(case.name)
    case.need_grains()  # before the lock makes a folder, as the next lines
    check_threads(threads)
    if callback is not None and not callable(callback):
        message = "is not a function; give one that takes an emclutch.WindowState"
        raise SceneError([Fault("callback", shown(callback), message)], "arguments")
    grains = None if start is None or resume else starting_grains(case, start)
    stop, reporter = threading.Event(), RunProgress(progress)
    with open_folder(case, target, resume, reporter) as opened:
        folder = opened.folder
        if measured is not None:
            keep_measured(measured, folder.path)
        if resume and not opened.is_resumed and (start := start or folder.grains_from()) is not None:
            grains = starting_grains(case, start)
        count = count_of_run(case, folder, opened.is_resumed)
        tune_threads, threads = may_tune_threads(threads), use_threads(threads, count)
        slots = replicas_side_by_side(max(count, max_replica_count(case.scene)), threads)
        with (
            interruptible(stop, lambda: last_time(folder.history) is None, opened.compiled),
            other_replicas(
                case, folder, count, threads=threads, slots=slots, tune_threads=tune_threads, resume=resume, start=start
            ) as replicas,
        ):
            request = RunRequest(case, opened, reporter, replicas, stop, tune_threads, force, grains, callback)
            return _run(replace(request, target=accuracy_target))


def refuse_target(case: Case) -> None:
    """Raise SceneError for a scene whose settings are still to be chosen for `accuracy.target`."""
    if (target := case.scene.accuracy.target) is not None:
        message = (
            "needs settings that are chosen first; run the scene with emclutch.run or the command emclutch run, or "
            "remove accuracy.target and set time.until = 'torque 5 %'"
        )
        raise SceneError([Fault("accuracy.target", f"'{target}'", message)], str(case.path or "scene"))


def refuse_unshown(case: Case, measured: str | Path) -> None:
    """Raise OutputError for a measured curve that cannot be read, SceneError for one that no picture would show."""
    read_measured(measured, *TORQUE_CURVE)
    message = ""
    if case.scene.coil_field is None or not field_is_needed(case.scene):
        message = "lies over torque against the coil's current, of which this scene has none; remove it"
    elif not case.scene.output.pictures:
        message = "lies over a picture, and output.pictures = false; remove one of them"
    if message:
        raise SceneError([Fault("--with", str(measured), message)], str(case.path or "scene"))


def run_replica(
    case: Case,
    target: str | Path,
    number: int,
    control: ReplicaControl,
    *,
    threads: int,
    tune_threads: bool,
    resume: bool,
    start: str | Path | None = None,
) -> Result:
    """Run one of the other replicas, as far as its `control` says. `start` and what is raised are as of `run`.

    ``tune_threads``: it may take fewer threads where fewer pay.
    """
    grains = None if start is None or resume else starting_grains(case, start)
    with open_folder(case, target, resume, RunProgress()) as opened:
        use_threads(threads)
        request = RunRequest(
            case,
            opened,
            RunProgress(),
            Replicas(number),
            control.stopped,
            tune_threads,
            force=True,
            grains=grains,
            control=control,
        )
        return _run(request)


def _run(request: RunRequest) -> Result:
    """The stages of a run."""
    started = start_run(request, plan_run(request))
    observers = make_callbacks(request, started)
    march(started, observers)
    return finish_run(request, started, observers)
