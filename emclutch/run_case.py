"""One scene from its file to a torque: plan, pack, march, write."""

from __future__ import annotations

import logging
import os
import signal
import threading
import tomllib
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from coupling import CoilField, SolidCoilField, run_staggered
from emclutch.assembly import assemble, simulation_of
from emclutch.case import Case
from emclutch.observables import Observables
from emclutch.plan import make_plan
from emclutch.results import OutputError, Result, RunFolder, load_result, read_history
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.grain_profiles import write_profiles
from emclutch.results.rise_time import rise_times
from emclutch.results.steady_torque import SteadyConditions, mean_torque, steady_torque
from emclutch.snapshots import History, Snapshots, save_checkpoint
from field import ConvergenceError, FluxLinkage, MagneticField, MeanFluxDensity, PointOutside, estimate_error
from particles import DemError, DemErrorKind, Grains, ParticleError

log = logging.getLogger(__name__)
MAY_CHANGE = ("time.end", "time.average_from", "output.", "accuracy.", "scene.title", "scene.description")
MUST_STAY = ("output.energies",)  # what a contact remembers has a place for it
JAM = 1e3  # tolerances of the solver of rigid contacts, beyond which a step counts as jammed
CHECKPOINT_SECONDS = 60.0  # wall-clock between checkpoints; a crash costs no more than this


class RunError(RuntimeError):
    """The run failed for a reason of physics or numerics; the message says which and what to do."""


class Interrupted(RunError):
    """The user stopped the run; a checkpoint lies in its folder."""


@dataclass(slots=True)
class _Stop:
    """Set by Ctrl-C; the loop ends after the window."""

    asked: bool = False


def run(
    case: Case, *, out: str | Path | None = None, threads: int | None = None, resume: bool = False, progress=None
) -> Result:
    """Run a scene and return its result.

    Parameters
    ----------
    case : Case
    out : folder of the run; default: the scene's `output.folder`, or the next free runs/<case>-<nnn>.
    threads : of the kernels; default: all cores. The result does not depend on it.
    resume : continue from the checkpoint in `out`.
    progress : object with update(fraction, text), or None.

    Raises
    ------
    OutputError
        The folder is in use or cannot be written.
    RunError
        A solver did not converge, grains do not fit, a contact failed; `Interrupted` after Ctrl-C.
    """
    begin = perf_counter()
    use_threads(threads)
    target = out or case.scene.output.folder or RunFolder.next_path(case.name)
    case_text = case.toml()
    if resume and RunFolder(target).checkpoint.is_file():  # compared before anything in the folder is touched
        state = read_checkpoint(RunFolder(target).checkpoint)
        refuse_other_scene(state["case"], case_text, target)
        refuse_earlier_end(RunFolder(target), state, case.scene.time.end)
    folder = RunFolder.create(target, case_text, resume=resume)
    with folder.logging():
        try:
            return _run(case, folder, case_text, resume, progress, begin)
        except (ConvergenceError, ParticleError, PointOutside, ValueError) as error:
            text = f"{error}{remedy_in_scene(case, error)}"
            log.error("%s", text)
            raise RunError(f"{text}\n(log: {folder.log})") from error


def _run(case, folder, case_text, resume, progress, begin) -> Result:
    scene = case.scene
    _say(progress, 0.0, "mesh and field")
    device, plan = make_plan(case)
    for label, reason in plan.reasons.items():
        log.info("%s: %s", label, reason)
    mesh_hash = None if device.coil is None else device.coil.mesh.hash()
    folder.write_provenance(
        seed=scene.scene.seed, mesh_hash=mesh_hash, threads=_threads(), threading_layer=_threading_layer()
    )
    conditions = SteadyConditions(scene.time.average_from, device.shear_gap, device.shear_radius)
    folder.write_plan({"contact": plan.contact_data, "steady_torque": conditions.as_dict(), "decisions": plan.reasons})
    _say(progress, 0.0, f"packing {plan.count} grains")
    if resume:
        state = read_checkpoint(folder.checkpoint)
        plan = plan.continued(state["steps_per_update"], state["updates"], scene.time.end)
        simulation, resume_time = restore(case, device, plan, state)
        log.info("resumed at t = %g s, window %d of %d", resume_time, simulation.window, plan.windows)
        if simulation.window < plan.windows:  # of an earlier end: a run that is cut off from here on has no summary
            folder.summary.unlink(missing_ok=True)
    else:
        simulation, resume_time = assemble(case, device, plan), None
        log.info("started: %d windows", plan.windows)
    snapshots = Snapshots(
        folder, simulation.dem.walls, plan.windows, scene.output.snapshots, scene.output.formats, case_text, resume_time
    )
    history = History(folder.history, resume_time)
    stop, last_save = _Stop(), perf_counter()

    def checkpoint(simulation, row) -> bool:
        nonlocal last_save
        done = simulation.window >= plan.windows
        if scene.output.checkpoint and (
            stop.asked or done or simulation.window == 1 or perf_counter() - last_save > CHECKPOINT_SECONDS
        ):
            snapshots.flush()
            save_checkpoint(folder.checkpoint, simulation, case_text)
            last_save = perf_counter()
        return stop.asked

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
    observers = (Observables(scene, device), history, *solver, snapshots, *extra, report, checkpoint)
    with _interruptible(stop):
        try:
            run_staggered(simulation, plan.end, observers)
        finally:
            history.close()
            snapshots.close()
    if stop.asked and simulation.window < plan.windows:
        log.info("stopped by the user at t = %g s", simulation.dem.time)
        raise Interrupted(
            f"stopped at t = {simulation.dem.time:.4g} s; "
            + (
                f"go on with: emclutch run {folder.path} --resume"
                if scene.output.checkpoint
                else "no checkpoint was written (output.checkpoint = false)"
            )
        )
    summarise(case, folder, device, plan, simulation, conditions, perf_counter() - begin)
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


def refuse_other_scene(old_text: str, new_text: str, target: str | Path) -> None:
    """OutputError unless two scenes differ at most in what a continued run may change: its end and its output."""
    old, new = (_flat(tomllib.loads(text)) for text in (old_text, new_text))
    differing = [
        f"{key}: {old.get(key, 'absent')} -> {new.get(key, 'absent')}"
        for key in sorted({*old, *new})
        if old.get(key) != new.get(key) and (key in MUST_STAY or not key.startswith(MAY_CHANGE))
    ]
    if differing:
        contact = any(text.startswith("contact.") for text in differing)
        why = "a changed contact needs a new run: " if contact else ""
        raise OutputError(
            f"the checkpoint in {target} belongs to another scene ({'; '.join(differing)}); {why}start anew in another "
            f"folder with --out, or continue the old scene with emclutch run {target} --resume"
        )


def refuse_earlier_end(folder: RunFolder, state: dict, end: float) -> None:
    """OutputError where a run whose end [s] was set earlier is past it: nothing would be left to do.

    The same end is always allowed: a last window may reach beyond it.
    """
    if end >= tomllib.loads(state["case"])["time"]["end"] or not folder.history.is_file():
        return
    times = read_history(folder.history)["time"].to_numpy()
    reached = float(times[min(state["window"], len(times)) - 1]) if len(times) else 0.0
    if end < reached:
        raise OutputError(
            f"time.end = {end:.4g} s is earlier than the checkpoint in {folder.path}, at {reached:.4g} s: nothing is "
            f"left to do, and nothing was changed; give a later time.end, or read the torque until then in "
            f"{folder.history.name}"
        )


def _flat(table: dict, prefix: str = "") -> dict:
    """Nested tables as dotted keys."""
    flat: dict = {}
    for key, value in table.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return flat


def restore(case, device, plan, state: dict):
    """The simulation of a checkpoint and its time [s]."""
    dem_state = state["dem"]
    simulation = simulation_of(case, device, plan, Grains.of_records(dem_state))
    simulation.dem.restore(dem_state)
    simulation.window = state["window"]
    simulation.restore_rows(state["rows"])
    saved = state["source"]
    source = simulation.source
    if saved is not None and isinstance(source, (CoilField, SolidCoilField)):
        source.restore(saved)
    return simulation, simulation.dem.time


def summarise(case, folder: RunFolder, device, plan, simulation, conditions: SteadyConditions, seconds: float) -> None:
    """summary.json: the torque with its error, the device, the numerics, the cost."""
    history = read_history(folder.history)
    summary: dict = {"title": case.scene.scene.title, "effects": list(case.scene.effects.active)}
    for body in ("rotor", "field"):
        column = f"torque_{body}"
        if column in history and (body != "field" or simulation.magnetised is not None):
            summary[column] = mean_torque(history, column, conditions.average_from).as_dict()
    if "torque_disc" in history:
        summary["torque"] = steady_torque(history, conditions).as_dict()
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
        | {"whole_run": seconds},
        "contact": plan.contact_data,
        "plan": plan.reasons,
    }
    folder.write_summary(summary)


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


def use_threads(threads: int | None) -> None:
    """Set the number of threads of the compiled kernels; ValueError outside 1 .. the machine's cores."""
    import numba

    available: int = getattr(numba.config, "NUMBA_NUM_THREADS")  # noqa: B009 (numba's stubs hide it)
    if threads is not None and not 1 <= threads <= available:
        raise ValueError(f"threads = {threads}; allowed: 1 to {available}, the cores of this machine")
    numba.set_num_threads(threads or min(available, os.cpu_count() or 1))


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


class _interruptible:
    """Ctrl-C asks the loop to stop after its window; a second one stops at once."""

    def __init__(self, stop: _Stop):
        self._stop = stop
        self._former: Any = None

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            self._former = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, number, frame):
        if self._stop.asked:
            raise KeyboardInterrupt
        self._stop.asked = True

    def __exit__(self, *error):
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)
