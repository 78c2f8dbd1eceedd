"""One scene from its file to a torque: plan, pack, march, write."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from coupling import CoilField, SolidCoilField, run_staggered
from emclutch.assembly import assemble, simulation_of
from emclutch.case import Case
from emclutch.free_memory import refuse_too_much
from emclutch.heartbeat import Heartbeat
from emclutch.kernel_compilation import compilation_told
from emclutch.kernel_warm_up import step_compiled_beside
from emclutch.observables import Observables
from emclutch.plan import make_plan
from emclutch.pole_zone import PoleZone, pole_zone
from emclutch.replicas import Replicas, count_of_run, other_replicas, tell_packing_share
from emclutch.results import Estimate, Result, RunFolder, load_result, read_history
from emclutch.results.folder_lock import locked_folder
from emclutch.results.grain_profiles import write_profiles
from emclutch.results.rise_time import rise_times
from emclutch.results.steady_torque import SteadyConditions, mean_torque, steady_torque
from emclutch.resume import refuse_changed_files, refuse_earlier_end, refuse_other_scene, run_checkpoint
from emclutch.run_pace import RunPace
from emclutch.scene.input_files import hashed_input_files
from emclutch.scene.replica_count import replica_seed
from emclutch.snapshots import History, Snapshots, save_checkpoint
from emclutch.torque_known import TorqueKnown, how_it_ended
from emclutch.warm_start import StartingGrains, starting_grains, warm_started
from field import ConvergenceError, FluxLinkage, MagneticField, MeanFluxDensity, PointOutside, estimate_error
from geometry.kernel_cache import specialisations
from geometry.threads import default_threads
from particles import DEM, DemError, DemErrorKind, Grains, ParticleError, contact_share, depth_warning

log = logging.getLogger(__name__)
JAM = 1e3  # tolerances of the solver of rigid contacts, beyond which a step counts as jammed
CHECKPOINT_SECONDS = 60.0  # wall-clock between checkpoints; a crash costs no more than this


class RunError(RuntimeError):
    """The run failed for a reason of physics or numerics; the message says which and what to do."""


class Interrupted(RunError):
    """The user stopped the run; a checkpoint lies in its folder."""


def run(
    case: Case,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress=None,
    start: str | Path | None = None,
    insist: bool = False,
) -> Result:
    """Run a scene and return its result: the first of its replicas, with the torque of all of them.

    The other replicas, as many as `accuracy.replicas` says, are processes beside this one; their folders lie under
    its own.

    Parameters
    ----------
    case : Case
    out : folder of the run; default: the scene's `output.folder`, or the next free runs/<case>-<nnn>.
    threads : of the kernels of each replica; default: ``OMP_NUM_THREADS`` or all cores, shared out among the replicas.
        The result does not depend on it.
    resume : continue from the checkpoint in `out`.
    progress : object with update(fraction, text), or None; if it has announce(text) too, what is being compiled, and
        why a run falls behind its plan; if it has stop_asked, and that is true after a window, the run ends there as
        after Ctrl-C.
    start : folder of a finished run whose grains this one begins with (`emclutch.warm_start`), in place of a packing;
        it says nothing more where a run is resumed.
    insist : run also where more memory is needed than is free.

    Raises
    ------
    OutputError
        The folder is in use or cannot be written; what is to be resumed belongs to another scene, or a file that the
        scene names has changed; the run to start from has no checkpoint, or other grains.
    RunError
        More memory is needed than is free, a solver did not converge, grains do not fit, a contact failed;
        `Interrupted` after Ctrl-C.
    """
    target = out or case.scene.output.folder or RunFolder.next_path(case.name)
    grains = None if start is None or resume else starting_grains(case, start)
    stop = threading.Event()
    with _entered(case, target, resume, progress) as (folder, compiled, begin):
        count = count_of_run(case, folder, resume)
        threads = use_threads(threads, count)
        with (
            _interruptible(stop),
            step_compiled_beside(case.scene, lambda text: _announce(progress, text)),
            other_replicas(case, folder, count, threads=threads, resume=resume, start=start) as replicas,
        ):
            return _run(case, folder, resume, progress, begin, compiled, replicas, stop, insist, grains)


def run_replica(
    case: Case,
    target: str | Path,
    replicas: Replicas,
    *,
    threads: int,
    resume: bool,
    stop: threading.Event,
    start: str | Path | None = None,
) -> Result:
    """Run one of the other replicas; `stop` ends it with a checkpoint. `start` and what is raised are as of `run`."""
    grains = None if start is None or resume else starting_grains(case, start)
    with _entered(case, target, resume, None) as (folder, compiled, begin):
        use_threads(threads)
        return _run(case, folder, resume, None, begin, compiled, replicas, stop, True, grains)


@contextmanager
def _entered(case: Case, target: str | Path, resume: bool, progress) -> Iterator[tuple[RunFolder, Any, float]]:
    """The run's folder, held, logging and fit to go on in; what fails in the block is told as a RunError."""
    begin = perf_counter()
    if resume:  # before the lock makes a folder
        RunFolder(target).require_checkpoint()
    with locked_folder(target):
        if resume:  # compared before anything in the folder is touched
            folder = RunFolder(target)
            state = run_checkpoint(folder.checkpoint)
            refuse_other_scene(state["case"], case.toml(), target)
            refuse_earlier_end(folder, state, case.scene.time.end)
            with folder.logging():
                refuse_changed_files(case, folder)
        folder = RunFolder.create(target, case.toml(), resume=resume)
        with folder.logging(), compilation_told(lambda text: _announce(progress, text)) as compiled:
            try:
                yield folder, compiled, begin
            except (ConvergenceError, ParticleError, PointOutside, ValueError) as error:
                text = f"{error}{remedy_in_scene(case, error)}"
                log.error("%s", text)
                raise RunError(f"{text}\n(log: {folder.log})") from error


def _run(
    case,
    folder,
    resume,
    progress,
    begin,
    compiled,
    replicas: Replicas,
    stop: threading.Event,
    insist: bool,
    grains: StartingGrains | None = None,
) -> Result:
    scene, case_text = case.scene, case.toml()
    _say(progress, 0.0, "mesh and field")
    device, plan = make_plan(case, threads=_threads())
    for label, reason in plan.reasons.items():
        log.info("%s: %s", label, reason)
    refuse_too_much(len(replicas.histories) * plan.cost.memory, insist=insist)
    mesh_hash = None if device.coil is None else device.coil.mesh.hash()
    folder.write_provenance(
        seed=scene.scene.seed,
        mesh_hash=mesh_hash,
        threads=_threads(),
        threading_layer=_threading_layer(),
        input_files=hashed_input_files(scene),
        grains_from=None if grains is None else grains.as_dict(),
    )
    conditions = SteadyConditions(scene.time.average_from, device.shear_gap, device.shear_radius)
    folder.write_plan({"contact": plan.contact_data, "steady_torque": conditions.as_dict(), "decisions": plan.reasons})
    _say(progress, 0.0, f"packing {plan.count} grains")
    if resume:
        state = run_checkpoint(folder.checkpoint)
        plan = plan.continued(state["steps_per_update"], state["updates"], scene.time.end)
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
    if scene.time.until is not None:
        known = TorqueKnown(scene.time.until, conditions, replicas, plan.end, is_stopped)
    snapshots = Snapshots(
        folder,
        simulation.dem.walls,
        plan.windows,
        scene.output.snapshots,
        scene.output.formats,
        case_text,
        resume_time,
        lambda: known is not None and known.reached,
    )

    def checkpoint(simulation, row) -> bool:
        nonlocal last_save
        stopped = is_stopped()
        done = simulation.window >= plan.windows or (known is not None and known.reached)
        if scene.output.checkpoint and (
            stopped or done or simulation.window == 1 or perf_counter() - last_save > CHECKPOINT_SECONDS
        ):
            snapshots.flush()
            save_checkpoint(folder.checkpoint, simulation, case_text)
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
    extra = () if profiles is None else (profiles,)
    solver = (MissedSteps(scene.contact.dvi.allowed_misses),) if scene.contact.method == "dvi" else ()
    until = () if known is None else (known,)
    pace = RunPace(plan.cost, simulation.dem.time, getattr(progress, "announce", None), lambda: compiled.count)
    observers = (Observables(scene, device), history, *solver, *until, snapshots, *extra, report, checkpoint, pace)
    alive = Heartbeat(progress, simulation, plan.end)
    observers = (alive.stop, *observers)
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
        log.info("the torque is known at t = %g s", simulation.dem.time)
    if problem := replicas.failure() or replicas.wait(is_stopped, lambda text: _announce(progress, text)):
        raise RunError(f"{problem}\n(log: {folder.log})")
    cut_off = simulation.window < plan.windows and not (known is not None and known.reached)
    if stop.is_set() and (cut_off or replicas.are_running()):
        log.info("stopped by the user at t = %g s", simulation.dem.time)
        raise Interrupted(
            f"stopped at t = {simulation.dem.time:.4g} s; "
            + (
                f"go on with: emclutch run {folder.path} --resume"
                if scene.output.checkpoint
                else "no checkpoint was written (output.checkpoint = false)"
            )
        )
    others = replicas.other_histories() if replicas.number == 0 else []
    summarise(case, folder, device, plan, simulation, conditions, perf_counter() - begin, others)
    if others:
        tell_packing_share(folder, load_result(folder.path).torque.packing_share)
    across = [] if profiles is None else profiles.profiles()
    if across:
        write_profiles(folder.path, across)
    if scene.output.pictures:
        _say(progress, 1.0, "pictures")
        from emclutch.run_pictures import draw_run

        draw_run(case, folder, device, simulation, across)
    return load_result(folder.path)


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
    step = "; time.step too must then be shorter" if case.scene.time.step is not None else ""
    return f". In the scene: {change}{step}. A changed contact needs a new run: take another --out, not --resume"


class MissedSteps:
    """Callback that stops a run of rigid grains of whose steps too many miss the tolerance.

    Raises
    ------
    ParticleError
        If more than the share ``allowed`` of all steps so far, and of a hundred at the least, have missed it.
    """

    def __init__(self, allowed: float):
        self._allowed = allowed
        self._missed = self._steps = 0

    def __call__(self, simulation, row: dict) -> None:
        self._missed += row["missed_steps"]
        self._steps += row["steps"]
        if self._missed > self._allowed * max(self._steps, 100):
            raise ParticleError(
                f"t = {row['time']:.4g} s: {self._missed} of {self._steps} steps missed the tolerance of "
                f"{simulation.dem.tolerance:.3g} m/s on the contacts (the last window's residual: "
                f"{row['solver_residual']:.3g} m/s); raise contact.dvi.max_sweeps or contact.dvi.tolerance, shorten "
                "contact.dvi.step, or allow more by contact.dvi.allowed_misses"
            )


def profile_average(scene, device):
    """The callback that averages profiles over the steady part, or None where none are asked for."""
    if not scene.output.profiles:
        return None
    from emclutch.profile_average import ProfileAverage  # local: what is off costs nothing

    start = scene.time.average_from
    return ProfileAverage(device.shape, 0.5 * scene.time.end if start is None else start)


def restore(case, device, plan, state: dict):
    """The simulation of a checkpoint and its time [s]."""
    dem_state = state["dem"]
    simulation = simulation_of(case, device, plan, Grains.of_records(dem_state))
    near = getattr(simulation.magnetised, "near", None)
    if near is not None and isinstance(simulation.dem, DEM):
        simulation.dem.attraction = near.attraction  # the state's drives belong to it
    simulation.dem.restore(dem_state)
    simulation.window = state["window"]
    simulation.restore_rows(state["rows"])
    saved = state["source"]
    source = simulation.source
    if saved is not None and isinstance(source, (CoilField, SolidCoilField)):
        source.restore(saved)
    return simulation, simulation.dem.time


def summarise(
    case, folder: RunFolder, device, plan, simulation, conditions: SteadyConditions, seconds: float, others=()
) -> None:
    """summary.json: the torque with its error, the device, the numerics, the cost.

    `others` are the histories of the other replicas: their torques count, all else is of this run.
    """
    history = read_history(folder.history)
    summary: dict = {"title": case.scene.scene.title, "effects": list(case.scene.effects.active)}
    for body in ("rotor", "field"):
        column = f"torque_{body}"
        if column in history and (body != "field" or simulation.magnetised is not None):
            summary[column] = mean_torque(history, column, conditions.average_from, others).as_dict()
    torque = steady_torque(history, conditions, others) if "torque_disc" in history else None
    if torque is not None:
        summary["torque"] = torque.as_dict()
        if others:
            summary["replicas"] = replicas_summary(case, (history, *others), torque)
        if case.scene.time.until is not None:
            summary["until"] = how_it_ended(torque, case.scene.time.until, history)
    if simulation.dem.bodies and any(body.is_free for body in simulation.dem.bodies):
        summary["lock_up_time"] = lock_up_time(history)
    if isinstance(simulation.source, (CoilField, SolidCoilField)):
        summary |= {
            "current": float(history["current"].iloc[-1]),
            "turns": simulation.source.turns,
            "gap_flux_density": float(history["gap_flux_density"].iloc[-1]),
            "flux_linkage": float(history["flux_linkage"].iloc[-1]),
            "field_solves": simulation.source.solves,
        }
        summary |= rise_times(history, device.coil.currents[-1])
        summary["field_error_estimate"] = field_error_estimate(simulation.source.solution)
    zone = None if simulation.magnetised is None else pole_zone(device)
    if zone is not None and torque is not None:
        summary |= zone_summary(zone, (history, *others), torque)
    if "feedback_residual" in history:
        summary["feedback"] = {
            "tolerance": simulation.source.fill_tolerance,
            "worst_residual": float(history["feedback_residual"].max()),
        } | {part: float(history[f"feedback_{part}"].iloc[-1]) for part in ("across", "clipped", "lagged")}
    if "moment_residual" in history:
        summary["moments"] = moments_summary(case.scene.effects.dipoles, history, plan, simulation.dem)
    if "missed_steps" in history:
        summary["solver"] = solver_summary(history, simulation.dem.tolerance)
    if "inertial_number" in history:
        late = history["inertial_number"].iloc[len(history) // 2 :].dropna()
        summary["inertial_number"] = float(late.median()) if len(late) else None
    throughput = 0.0
    if "dissipated" in history:
        throughput = float((history["work_walls"].abs() + history["dissipated"]).sum())
    summary |= {
        "grains": plan.count,
        "sectors": simulation.n_sectors,
        "dt": plan.dt,
        "time": float(history["time"].iloc[-1]),
        "steps": int(history["steps"].sum()),
        "max_overlap": float(history["max_overlap"].max()),
        "typical_overlap": float(history["max_overlap"].iloc[len(history) // 2 :].median()),
        "torque_residual_rms": float(np.sqrt((history["torque_residual"] ** 2).mean())),
        "energy_residual_relative": float(history["energy_residual"].sum() / throughput) if throughput else None,
        "discretisation_error": None,
        "discretisation_error_note": "not measured in a single run; emclutch accuracy measures it",
        "seconds": {
            part: float(history[f"wall_{part}"].sum())
            for part in ("field", "magnetic", "contact", "total")
            if f"wall_{part}" in history
        }
        | {"whole_run": seconds, "foretold": plan.cost.seconds},
        "contact": plan.contact_data,
        "plan": plan.reasons,
    }
    folder.write_summary(summary)


def zone_summary(zone: PoleZone, histories, torque: Estimate) -> dict[str, float | None]:
    """Shear stress [Pa] with its error, mean H [A/m] and fill of the powder between the poles, of the steady part."""
    late = [each[each["time"] > (torque.start or 0.0)] for each in histories]
    found: dict[str, float | None] = {
        "shear_stress": None if torque.mean is None else zone.shear_stress(torque.mean),
        "shear_stress_error": None if torque.standard_error is None else zone.shear_stress(torque.standard_error),
    }
    for name in ("field_strength_powder", "fill_powder"):
        if name in late[0]:
            found[name] = float(np.mean([each[name].mean() for each in late]))
    return found


def replicas_summary(case, histories, torque: Estimate) -> dict[str, Any]:
    """The replicas' seeds, and the mean torque of each over the steady part that they have in common."""
    start = torque.start or 0.0
    return {
        "count": len(histories),
        "seeds": [replica_seed(case.scene.scene.seed, number) for number in range(len(histories))],
        "means": [mean_torque(each, "torque_disc", start).mean for each in histories],
        "packing_share": torque.packing_share,
    }


def moments_summary(dipoles, history, plan, dem) -> dict[str, float | str]:
    """How the moments of grains that magnetise one another did; a caution where their contacts are too soft for it."""
    summary: dict[str, float | str] = {
        "model": dipoles.model,
        "tolerance": dipoles.tolerance,
        "worst_residual": float(history["moment_residual"].max()),
        "sweeps_per_update": float(history["moment_sweeps"].sum()) * plan.steps_per_update / history["steps"].sum(),
    }
    if isinstance(dem, DEM) and dem.attraction is not None:
        summary["strongest_near_pull"] = dem.attraction.strongest
        summary["necks_over_contact_stiffness"] = contact_share(dem.attraction, dem.laws, dem.grains.radius)
        caution = depth_warning(dem.attraction, dem.laws, dem.grains.radius)
        if caution is not None:
            summary["caution"] = caution
    return summary


def solver_summary(history, tolerance: float) -> dict[str, float | str]:
    """How the solver of rigid contacts did; a caution where steps ended far from the law of contact."""
    missed, worst = int(history["missed_steps"].sum()), float(history["solver_residual"].max())
    summary: dict[str, float | str] = {
        "tolerance": tolerance,
        "sweeps_per_step": float(np.average(history["sweeps"], weights=history["steps"])),
        "missed_share": missed / float(history["steps"].sum()),
        "worst_residual": worst,
        "stabilisation_work": float(history["stabilisation_work"].sum()),
    }
    if worst > JAM * tolerance:
        summary["caution"] = (
            f"contacts ended a step {worst:.2g} m/s off the law of contact: rigid grains were jammed between walls "
            "that push, where no finite force may exist; torques near that time are not to be trusted"
        )
    return summary


def field_error_estimate(solution) -> dict[str, float] | None:
    """Estimated relative errors of the last field's discretisation; None without current, and for one in space."""
    if not isinstance(solution, MagneticField) or solution.ampere_turns == 0.0:
        return None
    estimate = estimate_error(solution, (FluxLinkage(), MeanFluxDensity("powder")))
    return {goal.goal: goal.relative for goal in estimate.goals}


def lock_up_time(history) -> float | None:
    """Time [s] from which on the shafts' speeds stay within 1 % of the faster one; None if they do not."""
    slip = (history["rotor_speed"] - history["disc_speed"]).abs()
    fast = np.maximum(history["rotor_speed"].abs(), history["disc_speed"].abs())
    slipping = np.flatnonzero((slip > 0.01 * fast).to_numpy() | (fast == 0.0).to_numpy())
    if len(slipping) == 0:
        return 0.0
    if slipping[-1] == len(history) - 1:
        return None
    return float(history["time"].iloc[slipping[-1] + 1])


def use_threads(threads: int | None, replicas: int = 1) -> int:
    """Set the number of threads of the compiled kernels, and return it; None: all, shared out among the replicas.

    ValueError outside 1 .. the machine's cores.
    """
    import numba

    available: int = getattr(numba.config, "NUMBA_NUM_THREADS")  # noqa: B009 (numba's stubs hide it)
    if threads is not None and not 1 <= threads <= available:
        raise ValueError(f"threads = {threads}; allowed: 1 to {available}, the cores of this machine")
    chosen = threads or max(1, default_threads(available) // replicas)
    numba.set_num_threads(chosen)
    return chosen


def _threads() -> int:
    import numba

    return numba.get_num_threads()


def _threading_layer() -> str:
    """The layer that numba will use or uses, e.g. "omp"."""
    import numba

    try:
        return numba.threading_layer()
    except ValueError:  # no parallel kernel has run yet: the first choice that this machine can load
        return str(getattr(numba.config, "THREADING_LAYER_PRIORITY")[0])  # noqa: B009


def _say(progress, fraction: float, text: str) -> None:
    if progress is not None:
        progress.update(fraction, text)


def _announce(progress, text: str) -> None:
    log.info("%s", text)
    announce = getattr(progress, "announce", None)
    if announce is not None:
        announce(text)


class _interruptible:
    """Ctrl-C asks the loop to stop after its window; a second one stops at once."""

    def __init__(self, stop: threading.Event):
        self._stop = stop
        self._former: Any = None

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            self._former = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, number, frame):
        if self._stop.is_set():
            raise KeyboardInterrupt
        self._stop.set()

    def __exit__(self, *error):
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)
