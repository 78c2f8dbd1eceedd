"""One scene from its file to a torque: plan, pack, march, write."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from emclutch.results import Result, RunFolder
from emclutch.results.history import last_time
from emclutch.scene.case import Case, as_case
from emclutch.scene.replica_count import max_replica_count, replicas_side_by_side
from emclutch.simulation.finished_run import finish_run
from emclutch.simulation.interruption import interruptible
from emclutch.simulation.kernel_warm_up import step_compiled_aside
from emclutch.simulation.open_folder import open_folder
from emclutch.simulation.orders import Orders
from emclutch.simulation.planned_run import plan_run
from emclutch.simulation.replicas import Replicas, count_of_run, other_replicas
from emclutch.simulation.run_observers import make_callbacks, march
from emclutch.simulation.run_progress import RunProgress
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.started_run import start_run
from emclutch.simulation.threads import may_tune_threads, use_threads
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
) -> Result:
    """Run a scene and return its result: the first of its replicas, with the torque of all of them.

    The other replicas (`accuracy.replicas`, and with `time.until` as many more as its rule asks for) are processes
    in addition to this one, as many at a time as there are cores for; their folders lie under its own.

    Parameters
    ----------
    case : Case, or the path of a scene file
    out : folder of the run; default: the scene's `output.folder`, or the next free runs/<case>-<nnn>.
    threads : of the kernels of each replica; default: ``OMP_NUM_THREADS``, or what a trial in the first windows finds
        to pay of the cores, shared out among the replicas. The result does not depend on it.
    resume : continue from the checkpoint in `out`; a run that was killed before it wrote one starts again there.
    progress : object with update(fraction, text), or None; if it has announce(text) too, what is being compiled, and
        how long it has to go; if it has stop_asked, and that is true after a window, the run ends there as
        after Ctrl-C.
    start : folder of a finished run whose grains this one begins with (`emclutch.simulation.warm_start`), in place of
        a packing; it says nothing more where a run is resumed from a checkpoint.
    force : run also where more memory or disk is needed than is free.
    callback : called with the `emclutch.WindowState` after every window of the first replica; where it returns true,
        all replicas end with a checkpoint, and the result, of what was run, says so (`Result.stopped`).

    Raises
    ------
    CallbackError
        The callback raised an error.
    OutputError
        The folder is in use or cannot be written; what is to be resumed belongs to another scene, or a file that the
        scene names has changed; the run to start from has no checkpoint, or other grains.
    RunError
        More memory or disk is needed than is free, a solver did not converge, grains do not fit, a contact failed;
        `Interrupted` after Ctrl-C.
    """
    case = as_case(case)
    target = out or case.scene.output.folder or RunFolder.next_path(case.name)
    case.need_grains()  # before the lock makes a folder, as the next line
    grains = None if start is None or resume else starting_grains(case, start)
    stop, reporter = threading.Event(), RunProgress(progress)
    with open_folder(case, target, resume, reporter) as opened:
        folder = opened.folder
        if resume and not opened.goes_on and (start := start or folder.grains_from()) is not None:
            grains = starting_grains(case, start)
        count = count_of_run(case, folder, opened.goes_on)
        tune_threads, threads = may_tune_threads(threads), use_threads(threads, count)
        slots = replicas_side_by_side(max(count, max_replica_count(case.scene)), threads)
        with (
            interruptible(stop, lambda: opened.compiled.is_going_on or last_time(folder.history) is None),
            step_compiled_aside(case.scene, reporter.announce),
            other_replicas(
                case, folder, count, threads=threads, slots=slots, tune_threads=tune_threads, resume=resume, start=start
            ) as replicas,
        ):
            return _run(RunRequest(case, opened, reporter, replicas, stop, tune_threads, force, grains, callback))


def run_replica(
    case: Case,
    target: str | Path,
    number: int,
    orders: Orders,
    *,
    threads: int,
    tune_threads: bool,
    resume: bool,
    start: str | Path | None = None,
) -> Result:
    """Run one of the other replicas, as far as its `orders` say. `start` and what is raised are as of `run`.

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
            orders.stopped,
            tune_threads,
            force=True,
            grains=grains,
            orders=orders,
        )
        return _run(request)


def _run(request: RunRequest) -> Result:
    """The stages of a run."""
    started = start_run(request, plan_run(request))
    observers = make_callbacks(request, started)
    march(started, observers)
    return finish_run(request, started, observers)
