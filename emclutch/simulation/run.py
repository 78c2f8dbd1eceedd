"""One scene from its file to a torque: plan, pack, march, write."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

from coupling import CoilField, CoilField3D, LayeredField, run_staggered
from emclutch.results import OutputError, Result, RunFolder, load_result, read_history
from emclutch.results.failure import CURE
from emclutch.results.folder_lock import locked_folder
from emclutch.results.grain_profiles import write_profiles
from emclutch.results.steady_torque import SteadyConditions
from emclutch.scene.case import Case, as_case
from emclutch.scene.input_files import hashed_input_files
from emclutch.simulation.assembly import assemble, simulation_of
from emclutch.simulation.forecast.free_disk import NotEnoughDisk, refuse_full_disk
from emclutch.simulation.forecast.free_memory import NotEnoughMemory, refuse_too_much
from emclutch.simulation.forecast.machine_speed import MachineSpeed, machine_speed
from emclutch.simulation.heartbeat import Heartbeat
from emclutch.simulation.interruption import interruptible
from emclutch.simulation.kernel_compilation import compilation_told
from emclutch.simulation.kernel_warm_up import step_compiled_beside
from emclutch.simulation.missed_steps import MissedSteps
from emclutch.simulation.observables import Observables
from emclutch.simulation.pace import RunPace
from emclutch.simulation.plan import make_plan
from emclutch.simulation.replicas import Replicas, count_of_run, other_replicas, tell_packing_share
from emclutch.simulation.resume import may_go_on, run_checkpoint
from emclutch.simulation.snapshots import History, Snapshots, save_checkpoint
from emclutch.simulation.summary import summarise
from emclutch.simulation.thread_trial import ThreadTrial
from emclutch.simulation.threads import threading_layer, threads_are_open, threads_in_use, use_threads
from emclutch.simulation.torque_known import TorqueKnown
from emclutch.simulation.warm_start import StartingGrains, starting_grains, warm_started
from emclutch.simulation.window_state import UserCallback, WindowState
from field import ConvergenceError, PointOutside
from geometry.kernel_cache import specialisations
from particles import DEM, DemError, DemErrorKind, Grains, ParticleError

log = logging.getLogger(__name__)
CHECKPOINT_SECONDS = 60.0  # wall-clock between checkpoints; a crash costs no more than this


class RunError(RuntimeError):
    """The run failed for a reason of physics or numerics; the message says which and what to do."""


class Interrupted(RunError):
    """The user stopped the run; a checkpoint lies in its folder."""


def run(
    case: Case | str | Path,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress=None,
    start: str | Path | None = None,
    insist: bool = False,
    callback: Callable[[WindowState], object] | None = None,
) -> Result:
    """Run a scene and return its result: the first of its replicas, with the torque of all of them.

    The other replicas, as many as `accuracy.replicas` says, are processes beside this one; their folders lie under
    its own.

    Parameters
    ----------
    case : Case, or the path of a scene file
    out : folder of the run; default: the scene's `output.folder`, or the next free runs/<case>-<nnn>.
    threads : of the kernels of each replica; default: ``OMP_NUM_THREADS``, or what a trial in the first windows finds
        to pay of the cores, shared out among the replicas. The result does not depend on it.
    resume : continue from the checkpoint in `out`; a run that was killed before it wrote one starts anew there.
    progress : object with update(fraction, text), or None; if it has announce(text) too, what is being compiled, and
        why a run falls behind its plan; if it has stop_asked, and that is true after a window, the run ends there as
        after Ctrl-C.
    start : folder of a finished run whose grains this one begins with (`emclutch.simulation.warm_start`), in place of
        a packing; it says nothing more where a run is resumed from a checkpoint.
    insist : run also where more memory or disk is needed than is free.
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
    stop = threading.Event()
    with _entered(case, target, resume, progress) as (folder, goes_on, compiled, begin):
        if resume and not goes_on and (start := start or folder.grains_from()) is not None:
            grains = starting_grains(case, start)
        machine = machine_speed()  # before the other replicas are at work: the cost counts those by itself
        count = count_of_run(case, folder, goes_on)
        free, threads = threads_are_open(threads), use_threads(threads, count)
        with (
            interruptible(stop),
            step_compiled_beside(case.scene, lambda text: _announce(progress, text)),
            other_replicas(case, folder, count, threads=threads, free=free, resume=resume, start=start) as replicas,
        ):
            return _run(
                case,
                folder,
                goes_on,
                progress,
                begin,
                compiled,
                replicas,
                stop,
                free=free,
                insist=insist,
                grains=grains,
                machine=machine,
                callback=callback,
            )


def run_replica(
    case: Case,
    target: str | Path,
    replicas: Replicas,
    *,
    threads: int,
    free: bool,
    resume: bool,
    stop: threading.Event,
    start: str | Path | None = None,
) -> Result:
    """Run one of the other replicas; `stop` ends it with a checkpoint. `start` and what is raised are as of `run`.

    ``free``: it may take fewer threads where fewer pay.
    """
    grains = None if start is None or resume else starting_grains(case, start)
    with _entered(case, target, resume, None) as (folder, goes_on, compiled, begin):
        use_threads(threads)
        return _run(case, folder, goes_on, None, begin, compiled, replicas, stop, free=free, insist=True, grains=grains)


@contextmanager
def _entered(case: Case, target: str | Path, resume: bool, progress) -> Iterator[tuple[RunFolder, bool, Any, float]]:
    """The run's folder, held, logging and fit to go on in; what fails in the block is told as a RunError.

    Yields the folder, whether the run goes on from a checkpoint in it, what is compiled, and the time of the begin.
    """
    begin = perf_counter()
    if resume:  # before the lock makes a folder
        RunFolder(target).has_checkpoint()
    with locked_folder(target):
        goes_on = resume and may_go_on(case, RunFolder(target))  # compared before anything in the folder is touched
        folder = RunFolder.create(target, case.toml(), resume=resume)
        with folder.logging(), compilation_told(lambda text: _announce(progress, text)) as compiled:
            if resume and not goes_on:
                _announce(progress, f"{folder.path} has no checkpoint yet: the run starts anew")
            try:
                yield folder, goes_on, compiled, begin
            except (ConvergenceError, ParticleError, PointOutside, ValueError) as error:
                text = f"{error}{remedy_in_scene(case, error)}"
                log.error("%s", text)
                if not isinstance(error, (NotEnoughMemory, NotEnoughDisk)):  # what the machine lacks today
                    folder.write_failure(text)
                raise RunError(f"{text}\n(log: {folder.log})") from error
            except OSError as error:
                text = f"{error.filename or folder.path}: {error.strerror or error}"
                log.error("%s", text)
                how = f"go on with: emclutch run {folder.path} --resume" if folder.is_begun() else "start anew"
                raise OutputError(f"{text}; see to the path, its room and its permissions, then {how}") from error


def _run(
    case,
    folder,
    goes_on: bool,
    progress,
    begin,
    compiled,
    replicas: Replicas,
    stop: threading.Event,
    *,
    free: bool,
    insist: bool,
    grains: StartingGrains | None,
    machine: MachineSpeed | None = None,
    callback: Callable[[WindowState], object] | None = None,
) -> Result:
    scene, case_text = case.scene, case.toml()
    _say(progress, 0.0, "mesh and field")
    device, plan = make_plan(case, threads=threads_in_use(), machine=machine)
    for label, reason in plan.reasons.items():
        log.info("%s: %s", label, reason)
        if "WARNING" in reason:
            _announce(progress, f"{label}: {reason}")
    refuse_too_much(len(replicas.histories) * plan.cost.memory, insist=insist)
    if not goes_on:  # else most of it is there
        refuse_full_disk(plan.cost.disk, folder.path, insist=insist)
    mesh_hash = None if device.coil is None else device.coil.mesh.hash()
    folder.write_provenance(
        seed=scene.scene.seed,
        mesh_hash=mesh_hash,
        threads=threads_in_use(),
        threading_layer=threading_layer(),
        input_files=hashed_input_files(scene),
        grains_from=None if grains is None else grains.as_dict(),
    )
    until = scene.span.until
    negligible, share = (0.0, 0.0) if until is None else (until.absolute or 0.0, until.relative or 0.0)
    conditions = SteadyConditions(scene.span.average_from, device.shear_gap, device.shear_radius, negligible, share)
    folder.write_plan({"contact": plan.contact_data, "steady_torque": conditions.as_dict(), "decisions": plan.reasons})
    _say(progress, 0.0, f"packing {plan.count} grains")
    if goes_on:
        state = run_checkpoint(folder.checkpoint)
        plan = plan.continued(state["steps_per_update"], state["updates"], scene.span.end)
        simulation, resume_time = restore(case, device, plan, state)
        log.info("resumed at t = %g s, window %d of %d", resume_time, simulation.window, plan.windows)
        if simulation.window < plan.windows:  # of an earlier end: a run that is cut off from here on has no summary
            folder.summary.unlink(missing_ok=True)
    else:
        resume_time = None
        simulation = assemble(case, device, plan) if grains is None else warm_started(case, device, plan, grains)
        log.info("started: %d windows", plan.windows)
    history = History(folder.history, resume_time)
    last_save = perf_counter()

    def is_stopped() -> bool:
        if getattr(progress, "stop_asked", False):
            stop.set()
        return stop.is_set() or bool(replicas.failure())

    known = None
    if scene.span.until is not None:
        known = TorqueKnown(scene.span.until, conditions, replicas, plan.end, is_stopped)
    asked = None if callback is None else UserCallback(callback, plan.windows)

    def ends_early() -> bool:
        return (known is not None and known.reached) or (asked is not None and asked.stopped)

    snapshots = Snapshots(
        folder,
        simulation.motion.walls,
        plan.windows,
        scene.output.snapshots,
        scene.output.formats,
        case_text,
        resume_time,
        ends_early,
    )
    if resume_time is None:
        snapshots.begin(simulation)

    def checkpoint(simulation, row) -> bool:
        nonlocal last_save
        stopped = is_stopped()
        done = simulation.window >= plan.windows or ends_early()
        if scene.output.checkpoint and (
            stopped or done or simulation.window == 1 or perf_counter() - last_save > CHECKPOINT_SECONDS
        ):
            snapshots.flush()
            save_checkpoint(folder.checkpoint, simulation, case_text, profiles)
            last_save = perf_counter()
        return stopped

    def report(simulation, row) -> None:
        _say(
            progress,
            simulation.window / plan.windows,
            f"t = {row['time'] * 1e3:.3g} ms  torque on the disc {row['torque_disc']:.3g} N m"
            if "torque_disc" in row
            else f"t = {row['time'] * 1e3:.3g} ms",
        )

    profiles = profile_average(scene, device)
    if profiles is not None and goes_on:
        profiles.restore(state.get("profiles"))
    extra = () if profiles is None else (profiles,)
    solver: tuple[MissedSteps, ...] = ()
    if scene.contact.method == "dvi":
        solver = (MissedSteps(scene.contact.dvi.allowed_misses, read_history(folder.history) if goes_on else None),)
    enders = tuple(one for one in (known, asked) if one is not None)
    pace = RunPace(plan.cost, simulation.motion.time, getattr(progress, "announce", None), lambda: compiled.count)
    trial = thread_trial(progress, lambda: compiled.count) if free and threads_in_use() > 1 else ()
    alive = Heartbeat(progress, simulation, plan.end)
    each_window = (alive.stop, Observables(scene, device), history)
    observers = (*each_window, *solver, *enders, snapshots, *extra, report, checkpoint, pace, *trial)
    with alive:
        try:
            if resume_time is None or known is None or not known(simulation):
                run_staggered(simulation, plan.end, observers)
        finally:
            history.close()
            snapshots.close()
    log.info(
        "kernels: %d specialisations, %d of them compiled in %.1f s",
        len(specialisations()),
        compiled.count,
        compiled.seconds,
    )
    if known is not None and known.reached:
        log.info("the torque is known at t = %g s", simulation.motion.time)
    if asked is not None and asked.stopped and not replicas.failure():
        log.info("stopped by the callback at t = %g s", simulation.motion.time)
        replicas.end()
    elif problem := replicas.failure() or replicas.wait(is_stopped, lambda text: _announce(progress, text)):
        how = f"go on with: emclutch run {folder.path} --resume"
        if replicas.failed_for_the_scene():
            folder.write_failure(problem)
            how = CURE
        raise RunError(f"{problem}; {how}\n(log: {folder.log})")
    cut_off = simulation.window < plan.windows and not ends_early()
    if stop.is_set() and (cut_off or replicas.are_running()):
        log.info("stopped by the user at t = %g s", simulation.motion.time)
        raise Interrupted(
            f"stopped at t = {simulation.motion.time:.4g} s; "
            + (
                f"go on with: emclutch run {folder.path} --resume"
                if scene.output.checkpoint
                else "no checkpoint was written (output.checkpoint = false)"
            )
        )
    across = [] if profiles is None else profiles.profiles()
    if across:
        write_profiles(folder.path, across)
    elif profiles is not None:
        log.warning("no profiles: the run ended before their averaging began; set time.average_from to an earlier time")
    others = replicas.other_histories() if replicas.number == 0 else []
    seconds = {"whole_run": perf_counter() - begin, "compiling": compiled.seconds}
    stopped = asked is not None and asked.stopped
    summarise(case, folder, device, plan, simulation, conditions, seconds, others, stopped=stopped)
    if others:
        tell_packing_share(folder, load_result(folder.path).torque.packing_share)
    if scene.output.pictures:
        _say(progress, 1.0, "pictures")
        from emclutch.simulation.pictures import draw_run

        draw_run(case, folder, device, simulation, across)
    return load_result(folder.path)


def thread_trial(progress, compiled) -> tuple[ThreadTrial, ...]:
    """The callback that finds out how many threads pay."""
    return (ThreadTrial(threads_in_use(), use_threads, compiled, getattr(progress, "announce", None)),)


def remedy_in_scene(case: Case, error: Exception) -> str:
    """Which keys of the scene mend grains that were pressed in too far; empty for other errors."""
    contact = case.scene.contact
    if contact.method != "dem" or not isinstance(error, DemError) or error.kind is not DemErrorKind.OVERLAP:
        return ""
    key = contact.stiffness_key.partition(",")[0]
    softer = getattr(contact, key.removeprefix("contact."))
    if softer is None:
        change = f"lower contact.max_overlap = {contact.max_overlap:g} to a quarter, or give {contact.stiffness_key}"
    else:
        change = f"raise {key} = {softer:g} fourfold, or leave it out: it then follows from contact.max_overlap"
    step = "; time.step too must then be shorter" if case.scene.span.step is not None else ""
    return f". In the scene: {change}{step}. A changed contact needs a new run: take another --out, not --resume"


def profile_average(scene, device):
    """The callback that averages profiles over the steady part, or None where none are asked for."""
    if not scene.output.profiles:
        return None
    from emclutch.simulation.profile_average import ProfileAverage  # local: what is off costs nothing

    start = scene.span.average_from
    return ProfileAverage(device.shape, 0.5 * scene.span.end if start is None else start)


def restore(case, device, plan, state: dict):
    """The simulation of a checkpoint and its time [s]."""
    dem_state = state["dem"]
    simulation = simulation_of(case, device, plan, Grains.of_records(dem_state))
    near = getattr(simulation.magnetised, "near", None)
    if near is not None and isinstance(simulation.motion, DEM):
        simulation.motion.attraction = near.attraction  # the state's drives belong to it
    simulation.motion.restore(dem_state)
    simulation.window = state["window"]
    simulation.restore_rows(state["rows"])
    saved = state["source"]
    source = simulation.source
    if saved is not None and isinstance(source, (CoilField, CoilField3D, LayeredField)):
        source.restore(saved)
    return simulation, simulation.motion.time


def _say(progress, fraction: float, text: str) -> None:
    if progress is not None:
        progress.update(fraction, text)


def _announce(progress, text: str) -> None:
    log.info("%s", text)
    announce = getattr(progress, "announce", None)
    if announce is not None:
        announce(text)
