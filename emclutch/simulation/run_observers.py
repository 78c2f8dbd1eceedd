"""The third stage of a run: its callbacks after each window, and the march itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from coupling import Simulation, WindowRow, run_staggered
from coupling.sheared_means import BoxRow, GapRow
from coupling.staggered import Measure
from emclutch.device_model.device import Device
from emclutch.scene.model import Scene
from emclutch.simulation.checkpoints import Checkpoints
from emclutch.simulation.early_end import EarlyEnd, early_end
from emclutch.simulation.missed_steps import MissedSteps
from emclutch.simulation.observables import Observables
from emclutch.simulation.pace import RunPace
from emclutch.simulation.replicas import Replicas
from emclutch.simulation.run_progress import Heartbeat, RunProgress
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.snapshots import History, Snapshots
from emclutch.simulation.started_run import StartedRun
from emclutch.simulation.threads import ThreadTrial, threads_in_use, use_threads

if TYPE_CHECKING:
    from emclutch.simulation.profile_average import ProfileAverage


@dataclass(frozen=True, slots=True)
class RunObservers:
    """Callbacks of a run, and those of them that are read at its end.

    Attributes
    ----------
    measures : tuple of callable
        Those that complete a window's row.
    callbacks : tuple of callable
        In the order in which the loop calls them.
    early : EarlyEnd
    profiles : ProfileAverage or None
    alive : Heartbeat
    history : History
    snapshots : Snapshots
    """

    measures: tuple[Measure, ...]
    callbacks: tuple[Callable, ...]
    early: EarlyEnd
    profiles: ProfileAverage | None
    alive: Heartbeat
    history: History
    snapshots: Snapshots

    def close(self) -> None:
        """Write what is kept back, and close the files."""
        self.history.close()
        self.snapshots.close()


def make_callbacks(request: RunRequest, started: StartedRun) -> RunObservers:
    """Make everything that looks at a run after each of its windows, in four stages, and write the frame of t = 0.

    The loop completes a row by the measures before it calls any of them. Their order matters: snapshots show whether
    the end has come, which the deciding ones say; a checkpoint holds what all of these have kept by then.
    """
    scene, folder, progress = request.case.scene, request.folder, request.progress
    plan, simulation, resume_time = started.plan, started.simulation, started.resume_time
    history = History(folder.history, resume_time)
    early = early_end(request, started.planned, 0.0 if resume_time is None else resume_time)
    snapshots = Snapshots(
        folder,
        simulation.motion.walls,
        plan.windows,
        scene.output.snapshots,
        scene.output.formats,
        request.case.toml(),
        resume_time,
        lambda: early.has_come,
    )
    if resume_time is None:
        snapshots.begin(simulation)
    profiles = profile_average(plan.scene, started.planned.device)
    if profiles is not None:
        profiles.restore(started.profiles, simulation.motion)

    def share(time: float) -> float:
        """Fraction of the run that is done when this replica has come to a time [s]."""
        return request.replicas.share_done(time) if request.replicas.count > 1 else time / plan.end

    if resume_time is not None:  # the time left is that of the pace from here on
        progress.update(share(resume_time), f"resumed at t = {resume_time * 1e3:.3g} ms")
    alive = Heartbeat(progress.listener, simulation, share)

    measures = (Observables(scene, started.planned.device),)
    deciding = (*missed_steps(request, resume_time), *early.callbacks)
    showing = (
        ReplicaPool(request.replicas),
        snapshots,
        *(() if profiles is None else (profiles,)),
        WindowProgress(progress, share),
    )
    keeping = (Checkpoints(request, plan.windows, early, snapshots, profiles),)
    tuning = (RunPace(plan.cost, share, simulation.motion.time, progress.log), *thread_trial(request))
    callbacks = (alive.stop, history, *deciding, *showing, *keeping, *tuning)
    return RunObservers(measures, callbacks, early, profiles, alive, history, snapshots)


def march(started: StartedRun, observers: RunObservers) -> None:
    """Take the run to its end, unless the torque is known already at the checkpoint that it continues from."""
    early = observers.early
    with observers.alive:
        try:
            first = () if started.resume_time is None else (early.trigger, early.control)
            if not any(one is not None and one(started.simulation) for one in first):
                begin = observers.snapshots.begin_field
                run_staggered(started.simulation, started.plan.end, observers.callbacks, observers.measures, begin)
        finally:
            observers.close()


@dataclass(frozen=True, slots=True)
class ReplicaPool:
    """Callback of the loop that starts, or sends on, other replicas where cores are free for them."""

    replicas: Replicas

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        self.replicas.pump_now_and_then()


@dataclass(frozen=True, slots=True)
class WindowProgress:
    """Callback of the loop that reports how far the run is; `share` is the fraction that is done at a time [s]."""

    progress: RunProgress
    share: Callable[[float], float]

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        if self.progress.listener is None:
            return
        disc, box = row.bodies.get("disc"), row.part(BoxRow) or row.part(GapRow)
        measured = "" if disc is None else f"  torque on the disc {disc.torque:.3g} N m"
        if box is not None:
            measured = f"  strain {box.shear_strain:.3g}, shear stress {box.shear_stress:.3g} Pa"
        share = self.share(row.time)  # at the end the result follows, which is a mean
        self.progress.update(share, f"t = {row.time * 1e3:.3g} ms{measured if share < 1.0 else ''}")


def profile_average(scene: Scene, device: Device) -> ProfileAverage | None:
    """Return the callback that averages profiles over the steady part of a plan's scene; None without `profiles`."""
    if not scene.output.profiles:
        return None
    from emclutch.simulation.profile_average import ProfileAverage  # local: what is off costs nothing

    start = scene.span.average_time
    zone = device.pole_zone
    boxes = () if zone is None else zone.boxes
    return ProfileAverage(device.shape, 0.5 * scene.span.end_time if start is None else start, boxes)


def missed_steps(request: RunRequest, resume_time: float | None) -> tuple[MissedSteps, ...]:
    """Return the callback that stops rigid grains whose solver fails too often; none for others."""
    contact = request.case.scene.contact
    if contact.method != "dvi":
        return ()
    before = None if resume_time is None else request.folder.read_history()
    return (MissedSteps(contact.dvi.allowed_misses, before),)


def thread_trial(request: RunRequest) -> tuple[ThreadTrial, ...]:
    """Return the callback that finds out how many threads pay; none where there is nothing to choose."""
    if not request.tune_threads or threads_in_use() == 1:
        return ()
    return (ThreadTrial(threads_in_use(), use_threads, request.progress.log),)
