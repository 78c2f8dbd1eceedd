"""The second stage of a run: its simulation before the first window, packed, warm-started or of a checkpoint."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

from coupling import Simulation
from emclutch.device_model.device import Device
from emclutch.simulation.assembly import assemble, simulation_of
from emclutch.simulation.forecast.cost import format_rough_time
from emclutch.simulation.plan import Plan
from emclutch.simulation.planned_run import PlannedRun
from emclutch.simulation.resume import begun_windows, run_checkpoint
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.warm_start import warm_started
from particles import Grains

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class StartedRun:
    """A run that is ready to march.

    Attributes
    ----------
    planned : PlannedRun
        Of a run that continues, with the windows that it began with.
    simulation : Simulation
    resume_time : float or None
        Of the checkpoint that it continues from [s]; None: it begins.
    profiles : dict or None
        What the checkpoint has of profiles.
    """

    planned: PlannedRun
    simulation: Simulation
    resume_time: float | None = None
    profiles: dict[str, Any] | None = None

    @property
    def plan(self) -> Plan:
        """Of the run."""
        return self.planned.plan


def start_run(request: RunRequest, planned: PlannedRun) -> StartedRun:
    """Pack the grains of a run, take them from another one, or continue from its checkpoint."""
    device, plan = planned.device, planned.plan
    if not request.opened.is_resumed:
        request.progress.update(0.0, f"packing {plan.count} grains")
        grains = request.grains
        simulation = assemble(device, plan) if grains is None else warm_started(device, plan, grains)
        estimate = format_rough_time(plan.cost.seconds["total"])
        request.progress.log(f"started: {plan.windows} windows, estimated {estimate} on idle cores")
        return StartedRun(planned, simulation)
    state = run_checkpoint(request.folder.checkpoint)
    plan = plan.continued(*begun_windows(state, request.case.scene.contact.method))
    simulation = restored(device, plan, state)
    resume_time = simulation.motion.time
    log.info("resumed at t = %g s, window %d of %d", resume_time, simulation.window, plan.windows)
    if simulation.window < plan.windows:  # of an earlier end: a run that is cut off from here on has no summary
        request.folder.summary.unlink(missing_ok=True)
    return StartedRun(replace(planned, plan=plan), simulation, resume_time, state.get("profiles"))


def restored(device: Device, plan: Plan, state: dict[str, Any]) -> Simulation:
    """The simulation of a checkpoint."""
    of_the_grains = state["dem"]
    simulation = simulation_of(device, plan, Grains.of_records(of_the_grains))
    if simulation.magnetised is not None:
        simulation.magnetised.resume(simulation.motion)
    simulation.motion.restore(of_the_grains)
    simulation.window = state["window"]
    simulation.restore_rows(state["rows"])
    if simulation.magnetised is not None:
        simulation.magnetised.restore(state["magnetised"])
    if simulation.source is not None and state["source"] is not None:
        simulation.source.restore(state["source"])
    return simulation
