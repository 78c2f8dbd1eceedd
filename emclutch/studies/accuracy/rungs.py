"""The rungs of an accuracy study: the scene that is run, and each knob's settings as scenes that can be planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

from emclutch.knobs import HISTORIES, KNOBS, Knob, knobs_of
from emclutch.knobs.powder import StartUp
from emclutch.scene.case import Case, case_from
from emclutch.scene.errors import Fault, SceneError, bad_input_for, shown
from emclutch.scene.model import Scene
from emclutch.scene.multiple import STRAIN, Multiple
from emclutch.scene.replica_count import has_steady_torque, packs_alike
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.timing import instant_in_words
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.simulation.plan import Plan, make_plan
from emclutch.simulation.scaled_slip import strain_rate

QUIET: dict[str, Any] = {
    "accuracy.replicas": 1,
    "accuracy.replica_scatter": None,
    "accuracy.replica_scatter_freedom": None,
    "accuracy.target": None,
    "time.until": None,
    "time.average_from": None,
    "time.exclude_drift": None,
    "output.folder": None,
    "output.snapshots": 0,
    "output.pictures": False,
    "output.profiles": False,
    "output.checkpoint": False,
    "output.formats": [],
    "output.energy_budget": False,
}
START_UPS = 2.0
"""Length of a packing's run, in strains of the start-up."""


COMPILING_WINDOWS = 3


@dataclass(frozen=True, slots=True)
class PlannedRung:
    """One setting of a knob that the scene takes, before anything runs.

    Attributes
    ----------
    knob : str
    setting : float
        That the planned scene has: a sector is as wide as asked or wider.
    step_size : float
    values : dict of str to Any
        Entries of the scene; empty at its own setting.
    grains : int
    seconds : float
        Predicted processor time of a packing on the reference machine [s]: the speed of this one, which each process
        finds out by itself, does not enter.
    planning : float
        Processor time of mesh, field and plan [s].
    """

    knob: str
    setting: float
    step_size: float
    values: dict[str, Any]
    grains: int
    seconds: float
    planning: float


@dataclass(frozen=True, slots=True)
class SettingTask:
    """One setting to plan, as plain data for any process."""

    data: dict[str, Any]
    path: str | None
    trust_scripts: bool
    knob: str
    values: dict[str, Any]
    asked: float


@dataclass(frozen=True, slots=True)
class PlannedSetting:
    """A setting that was planned, or the faults of its scene."""

    rung: PlannedRung | None
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Base:
    """What every packing of a study is at the scene's own settings.

    Attributes
    ----------
    case : Case
    plan : Plan
    strain : float or None
        Shear strain of a packing's run; None: nothing is sheared at a constant rate.
    """

    case: Case
    plan: Plan
    strain: float | None

    @property
    def scene(self) -> Scene:
        """Return the scene of one packing."""
        return self.case.scene

    @property
    def seconds(self) -> float:
        """Return the predicted processor time of a packing on the reference machine [s]."""
        return _reference_seconds(self.plan)


def base_of(case: Case) -> Base:
    """Return what every packing is: of a length that does not depend on the result, and without output.

    SceneError where it cannot be planned.
    """
    values, own = dict(QUIET), case.scene.time and case.scene.time.average_from
    if isinstance(own, Multiple):
        del values["time.average_from"], values["time.exclude_drift"]  # a strain is a setting of the start-up
    if case.scene.accuracy.time_end is not None:
        end = case.scene.accuracy.time_end
        values["time.end"] = str(end) if isinstance(end, Multiple) else end
    elif is_sheared(case):
        start = own.value if isinstance(own, Multiple) else start_up_strain(case.scene)
        values["time.end"] = STRAIN.format(f"{START_UPS * max(start, start_up_strain(case.scene)):g}")
    base = case.with_values(values)
    with bad_input_for(case.path):
        device, plan = make_plan(base, threads=1)
    end = base.scene.span.end
    rate = strain_rate(plan.scene, device) if is_sheared(case) else 0.0
    strain = end.value if isinstance(end, Multiple) else rate * plan.end
    return Base(base, plan, strain if rate else None)


def compiling_run(plan: Plan) -> dict[str, Any]:
    """Return entries of the scene that shorten its run to a few windows: what compiles all kernels that it needs."""
    end = COMPILING_WINDOWS * plan.end / plan.windows
    return {"time.end": end, "time.average_from": None, "time.exclude_drift": None}


def is_sheared(case: Case) -> bool:
    """Return whether the gap is sheared at a constant rate, so that lengths are strains."""
    scene = case.scene
    return StartUp.applies(scene) and has_steady_torque(scene) and scene.motion.largest_slip > 0.0


def refuse_what_has_no_ladder(case: Case) -> None:
    """Raise SceneError for a scene without the torque, or the packings, to compare; knobs every scene of grains has."""
    case.need_grains()
    faults, kind = [], case.scene.geometry.name()
    if not case.scene.geometry.has_axis:
        message = "has no disc, and accuracy is measured by the disc's torque; take a clutch, a drum or a shear_cell"
        faults.append(Fault("geometry.kind", shown(kind), message))
    if packs_alike(case.scene):
        message = (
            "begins every packing alike, so that nothing tells noise from error; take 'random', or particles.noise"
        )
        faults.append(Fault("particles.packing", shown(case.scene.grains.packing), message))
    if faults:
        raise SceneError(faults, source_of(case))


def source_of(case: Case) -> str:
    """Return the name of a case's file."""
    return "scene" if case.path is None else str(case.path)


def starts_of(base: Base) -> list[float | str]:
    """Return from where on the torque is averaged, a strain or a time [s]: the scene's own first, then what is tried.

    Where the run is too short for the start-up, or nothing is sheared, its second half.
    """
    if base.strain is None:
        return [0.5 * base.plan.end]
    own = StartUp.own(base.scene, base.plan)
    if own >= base.strain:
        return [STRAIN.format(f"{0.5 * base.strain:g}")]
    kept = [one for one in StartUp.ladder(base.scene, base.plan) if one < base.strain * (1.0 - 1e-9) and one != own]
    return [STRAIN.format(f"{one:g}") for one in (own, *kept)]


def setting_tasks(base: Base) -> list[SettingTask]:
    """Return the settings to plan: all of each knob, but the scene's own.

    Raises
    ------
    SceneError
        Of a setting in `accuracy.ladders` that the scene does not take, or of a list that says nothing: all at once.
    """
    tasks, faults = [], _lists_of_nothing(base.scene)
    case, plan = base.case, base.plan
    path = None if case.path is None else str(case.path.resolve())
    for knob in knobs_of(base.scene):
        if knob.measured_on == HISTORIES:
            faults += _late_starts(base, knob)
            continue
        own = knob.own(base.scene, plan)
        for setting in knob.ladder(base.scene, plan):
            if setting == own:
                continue
            if knob.is_whole and setting != round(setting):
                faults += _faults(base, knob, setting, [f"{knob.key} is a whole number"])
                continue
            values = knob.values(base.scene, plan, setting)
            try:
                changed = case.with_values(values)
            except SceneError as error:
                faults += _faults(base, knob, setting, [str(fault) for fault in error.faults])
            else:
                tasks.append(SettingTask(changed.data, path, case.trust_scripts, knob.name, values, setting))
    if faults:
        raise SceneError(faults, source_of(base.case))
    return tasks


def planned_setting(task: SettingTask) -> PlannedSetting:
    """Plan one setting."""
    begin = process_time()
    try:
        case = case_from(
            task.data, None, None if task.path is None else Path(task.path), trust_scripts=task.trust_scripts
        )
        with bad_input_for(case.path):
            _, plan = make_plan(case, threads=1)
    except SceneError as error:
        return PlannedSetting(None, tuple(str(fault) for fault in error.faults))
    return PlannedSetting(rung_of(case, plan, task.knob, task.values, process_time() - begin))


def rung_of(case: Case, plan: Plan, name: str, values: dict[str, Any], planning: float) -> PlannedRung:
    """Return the rung that a planned scene is."""
    knob = next(one for one in knobs_of(case.scene) if one.name == name)
    setting = float(knob.own(case.scene, plan))
    seconds = _reference_seconds(plan)
    return PlannedRung(name, setting, knob.step_size(setting), values, plan.cost.grains, seconds, planning)


def _reference_seconds(plan: Plan) -> float:
    return plan.cost.seconds["total"] / slowness()


def planned_rungs(base: Base, tasks: Sequence[SettingTask], found: Sequence[PlannedSetting]) -> list[PlannedRung]:
    """Return the rungs that the scene takes; SceneError for those of `accuracy.ladders` that it does not."""
    faults: list[Fault] = []
    for task, one in zip(tasks, found, strict=True):
        if one.rung is None:
            knob = next(knob for knob in knobs_of(base.scene) if knob.name == task.knob)
            faults += _faults(base, knob, task.asked, one.faults)
    if faults:
        raise SceneError(faults, source_of(base.case))
    return [one.rung for one in found if one.rung is not None]


def _faults(base: Base, knob: type[Knob], setting: float, why: Sequence[str]) -> list[Fault]:
    """Return the fault of a setting that the scene lists; of the usual ones none, they are left out."""
    if getattr(base.scene.accuracy.ladders, knob.name) is None:
        return []
    message = f"is none that the scene can have: {'; '.join(why)}; remove it from the list, or change the scene"
    return [Fault(f"accuracy.ladders.{knob.name}", f"{setting:g}", message)]


def _lists_of_nothing(scene: Scene) -> list[Fault]:
    """Return the faults of lists in `accuracy.ladders` that are empty, or of a setting that the scene does not have."""
    faults, own = [], knobs_of(scene)
    for knob in KNOBS:
        asked = getattr(scene.accuracy.ladders, knob.name)
        if asked is None:
            continue
        key = f"accuracy.ladders.{knob.name}"
        if knob not in own:
            message = f"is of {knob.key}, which has no part in this scene; remove it"
            faults.append(Fault(key, shown(list(asked)), message))
        elif not asked:
            faults.append(Fault(key, "[]", "has no setting; name one or more, or remove it for the usual ones"))
    return faults


def _late_starts(base: Base, knob: type[Knob]) -> list[Fault]:
    asked = getattr(base.scene.accuracy.ladders, knob.name) or ()
    end = instant_in_words(base.scene.span.end)
    end = end if base.strain is None or end.startswith("strain") else f"{end}, a strain of {base.strain:.4g}"
    message = f"is not before the end of the packings, {end}; lower it, or raise accuracy.time_end"
    if base.strain is None:
        message = "is a shear strain, and nothing is sheared at a constant rate; remove the list"
    late = [one for one in asked if base.strain is None or one >= base.strain]
    return [Fault(f"accuracy.ladders.{knob.name}", f"{one:g}", message) for one in late]
