"""The first stage of a run: what it starts from is decided, reported and written into its folder."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from emclutch.device_model.decision import warnings_of
from emclutch.device_model.device import Device
from emclutch.results.steady_torque import SteadyConditions
from emclutch.scene.input_files import hashed_input_files
from emclutch.scene.model import Scene
from emclutch.scene.start_up import start_up_strain
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque
from emclutch.simulation.forecast.regime import omitted_effects
from emclutch.simulation.forecast.space import refuse_full_disk, refuse_too_much
from emclutch.simulation.plan import Plan, make_plan
from emclutch.simulation.plan_in_words import plan_in_words
from emclutch.simulation.run_request import RunRequest
from emclutch.simulation.scaled_slip import strain_rate
from emclutch.simulation.stopping_rule import looks_several_times
from emclutch.simulation.threads import threading_layer, threads_in_use

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A planned run: device, plan and replicas.

    Attributes
    ----------
    device : Device
    plan : Plan
    conditions : SteadyConditions
        When its torque counts as steady.
    decisions : dict of str to str
        The plan in words, as it was when this process took the run up.
    expected : ExpectedTorque
    """

    device: Device
    plan: Plan
    conditions: SteadyConditions
    decisions: dict[str, str]
    expected: ExpectedTorque


def plan_run(request: RunRequest) -> PlannedRun:
    """Build the device and decide the run; ValueError where it cannot be, or the machine has too little room for it."""
    scene, folder, progress = request.case.scene, request.folder, request.progress
    if request.opened.is_resumed:  # what it had done is known once its checkpoint is read
        progress.log("mesh and field")
    else:
        progress.update(0.0, "mesh and field")
    device, plan = make_plan(request.case, threads=threads_in_use())
    decisions = plan_in_words(device, plan)
    for label, reason in decisions.items():
        log.info("%s: %s", label, reason)
    for label, texts in warnings_of(decisions).items():
        for text in texts:
            log.warning("%s: %s", label, text)
            progress.log(f"warning: {label}: {text}")
    refuse_too_much(request.replicas.count * plan.cost.memory, force=request.force)
    if not request.opened.is_resumed:  # else most of it is there
        refuse_full_disk(plan.cost.disk, folder.path, force=request.force)
    folder.write_provenance(
        seed=scene.scene.seed,
        mesh_hash=None if device.coil is None else device.coil.mesh.hash(),
        threads=threads_in_use(),
        threading_layer=threading_layer(),
        input_files=hashed_input_files(scene),
        grains_from=None if request.grains is None else request.grains.as_dict(),
    )
    if request.target is not None:
        folder.add_to_provenance(accuracy_target=float(request.target))
    conditions = steady_conditions(plan.scene, device, plan.end)
    expected = expected_torque(scene, device, plan.peak_field)  # at the scene's speeds, not those of the run
    missing = omitted_effects(plan.scene, device, plan, expected)
    folder.write_plan(
        {
            "contact": plan.contact_data,
            "steady_torque": conditions.as_dict(),
            "decisions": decisions,
            "warnings": warnings_of(decisions),
            "shear_rate": strain_rate(plan.scene, device),
            "omitted_effects": {line.effect: line.in_words() for line in missing if line.is_reservation},
        }
    )
    return PlannedRun(device, plan, conditions, decisions, expected)


def steady_conditions(scene: Scene, device: Device, end: float) -> SteadyConditions:
    """Criteria of a plan's scene, whose longest run ends at `end` [s], for the verdict on a run's torque."""
    until = scene.span.until
    negligible, share = (0.0, 0.0) if until is None else (until.absolute or 0.0, until.relative or 0.0)
    return SteadyConditions(
        scene.span.average_time,
        device.shear_gap,
        device.shear_radius,
        negligible,
        share,
        start_up_strain(scene),
        scene.span.exclude_drift,
        looks_several_times(scene, device, end),
        scene.accuracy.replica_scatter or 0.0,
        float(scene.accuracy.replica_scatter_freedom or 0),
        0.99 * end,
    )
