"""The last stage of a run: wait for the other replicas, then write the summary and draw the pictures."""

from __future__ import annotations

import logging
from time import perf_counter

from emclutch.results import Result, load_result
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.grain_profiles import write_profiles
from emclutch.results.report.render import write_index
from emclutch.results.report.run_report import write_failed_index
from emclutch.results.run_folder import RESTART_HINT
from emclutch.results.vtk.wall_surface import write_wall_pressure_surfaces
from emclutch.results.wall_loads import write_wall_pressure
from emclutch.simulation.run_observers import RunObservers
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.started_run import StartedRun
from emclutch.simulation.summary import FinishedRun, summarise
from geometry.kernels.cache import specialisations
from geometry.kernels.machine_code import machine_code_digest

log = logging.getLogger(__name__)


def finish_run(request: RunRequest, started: StartedRun, observers: RunObservers) -> Result:
    """Return the result of a run that has marched.

    The summary is written before the pictures: a run that has one is done.

    Raises
    ------
    RunError
        Another replica failed.
    Interrupted
        The user stopped the run before its end.
    """
    case, folder = request.case, request.folder
    compiled, replicas, early = request.opened.compiled, request.replicas, observers.early
    log.info(
        "kernels: %d specialisations, %d of them compiled in %.1f s",
        len(specialisations()),
        compiled.count,
        compiled.seconds,
    )
    folder.add_to_provenance(machine_code=machine_code_digest())
    end_replicas(request, started, observers)
    refuse_cut_off(request, started, observers)
    write_averaged_profiles(request, started, observers)
    others = replicas.histories()[1:] if replicas.count > 1 else []
    seconds = {"whole_run": perf_counter() - request.opened.begin, "compiling": compiled.seconds}
    load = {} if observers.profiles is None else observers.profiles.walls.summary()
    stopped = early.is_by_callback
    histories = [folder.read_history(), *others]
    summarise(FinishedRun(case, folder, started.planned, started.simulation, histories, seconds, stopped, load))
    if case.scene.output.pictures:
        request.progress.update(1.0, "pictures")
        from emclutch.simulation.pictures import draw_run  # local: the libraries that draw are heavy

        draw_run(case, folder, started.planned.device, started.simulation, observers.profiles)
    result = load_result(folder.path)
    if request.control is None:  # nobody asks of the other replicas
        write_index(result.report())
    return result


def end_replicas(request: RunRequest, started: StartedRun, observers: RunObservers) -> None:
    """Wait for the other replicas, or end them where the callback wants no more; RunError where one has failed."""
    time, replicas, early = started.simulation.motion.time, request.replicas, observers.early
    if early.torque_is_known:
        log.info("the torque is known at t = %g s", time)
    if early.is_by_callback and not replicas.failure():
        log.info("stopped by the callback at t = %g s", time)
        replicas.end()
        return
    if replicas.wait(request.is_stopped, lambda: request.progress.update(replicas.share_done(time), "other replicas")):
        replicas.finish()
        replicas.wait_for_results(request.is_stopped)
    if problem := replicas.failure():
        how = request.how_to_go_on
        if replicas.failed_for_the_scene():
            write_failed_index(request.folder, problem)
            how = RESTART_HINT
        raise RunError(f"{problem}; {how}\n(log: {request.folder.log})")


def refuse_cut_off(request: RunRequest, started: StartedRun, observers: RunObservers) -> None:
    """Raise `Interrupted` where the user has stopped the run, or one of its replicas, before its end."""
    cut_off = started.simulation.window < started.plan.windows and not observers.early.has_come
    if request.stop.is_set() and (cut_off or request.replicas.are_running()):
        time, has_checkpoint = started.simulation.motion.time, request.case.scene.output.checkpoint
        log.info("stopped by the user at t = %g s", time)
        how = request.how_to_go_on if has_checkpoint else "no checkpoint was written (output.checkpoint = false)"
        raise Interrupted(f"stopped at t = {time:.4g} s; {how}")


def write_averaged_profiles(request: RunRequest, started: StartedRun, observers: RunObservers) -> None:
    """Write profiles across the gap and the load of the walls to the run's folder, where they are asked for."""
    if observers.profiles is None:
        return
    across, load = observers.profiles.profiles(), observers.profiles.walls.pressure()
    if load is None:
        log.warning("no profiles: the run ended before their averaging began; set time.average_from to an earlier time")
        return
    write_profiles(request.folder.path, across)
    motion = started.simulation.motion
    write_wall_pressure(request.folder.path, load, motion.walls)
    if "vtk" in request.case.scene.output.formats:
        angle = None if motion.sector is None else motion.sector.angle
        write_wall_pressure_surfaces(request.folder.path, load, motion.walls, angle, motion.time)
