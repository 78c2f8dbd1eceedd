"""The values of an accuracy study: the scene that is run, and the values of each setting as scenes to be planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import process_time
from typing import Any, NamedTuple

from emclutch.device_model.device import Device
from emclutch.scene.case import Case
from emclutch.scene.errors import Fault, SceneError, bad_input_for, shown
from emclutch.scene.model import Scene
from emclutch.scene.replica_count import has_steady_torque, packs_alike
from emclutch.scene.scaled import STRAIN, Scaled
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.timing import instant_in_words
from emclutch.settings import HISTORIES, SETTINGS, Setting, settings_of
from emclutch.settings.powder import START_UP
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
"""Length of a replica's run, in strains of the start-up."""


COMPILING_WINDOWS = 3


@dataclass(frozen=True, slots=True)
class PlannedValue:
    """One value of a setting that the scene takes, before anything runs.

    Attributes
    ----------
    setting : str
    value : float
        That the planned scene has: a sector is as wide as asked or wider.
    step_size : float
    entries : dict of str to Any
        Entries of the scene; empty at its own value.
    grains : int
    seconds : float
        Predicted processor time of a replica on the reference machine [s]: the speed of this one, which each process
        finds out by itself, does not enter.
    planning : float
        Processor time of mesh, field and plan [s].
    """

    setting: str
    value: float
    step_size: float
    entries: dict[str, Any]
    grains: int
    seconds: float
    planning: float


class ValueToPlan(NamedTuple):
    """A scene with a value of a setting: the value as asked for, and the entries that make it."""

    case: Case
    setting: str
    entries: dict[str, Any]
    asked: float


@dataclass(frozen=True, slots=True)
class Base:
    """The scene of every replica of a study at the scene's own settings.

    Attributes
    ----------
    case : Case
    plan : Plan
    strain : float or None
        Shear strain of a replica's run; None: nothing is sheared at a constant rate.
    """

    case: Case
    plan: Plan
    device: Device
    strain: float | None

    @property
    def scene(self) -> Scene:
        """Return the scene of one replica."""
        return self.case.scene

    @property
    def seconds(self) -> float:
        """Return the predicted processor time of a replica on the reference machine [s]."""
        return _reference_seconds(self.plan)


def base_of(case: Case) -> Base:
    """Return the scene of every replica: of a length that does not depend on the result, and without output.

    SceneError where it cannot be planned.
    """
    values, own = dict(QUIET), case.scene.time and case.scene.time.average_from
    if isinstance(own, Scaled):
        del values["time.average_from"], values["time.exclude_drift"]  # a strain is a value of the start-up
    if case.scene.accuracy.time_end is not None:
        end = case.scene.accuracy.time_end
        values["time.end"] = str(end) if isinstance(end, Scaled) else end
    elif is_sheared(case):
        start = own.value if isinstance(own, Scaled) else start_up_strain(case.scene)
        values["time.end"] = STRAIN.format(f"{START_UPS * max(start, start_up_strain(case.scene)):g}")
    base = case.with_values(values)
    with bad_input_for(case.path):
        device, plan = make_plan(base, threads=1)
    end = base.scene.span.end
    rate = strain_rate(plan.scene, device) if is_sheared(case) else 0.0
    strain = end.value if isinstance(end, Scaled) else rate * plan.end
    return Base(base, plan, device, strain if rate else None)


def compiling_run(plan: Plan) -> dict[str, Any]:
    """Return entries of the scene that shorten its run to a few windows: what compiles all kernels that it needs."""
    end = COMPILING_WINDOWS * plan.end / plan.windows
    return {"time.end": end, "time.average_from": None, "time.exclude_drift": None}


def is_sheared(case: Case) -> bool:
    """Return whether the gap is sheared at a constant rate, so that lengths are strains."""
    scene = case.scene
    return START_UP.applies(scene) and has_steady_torque(scene) and scene.motion.largest_slip > 0.0


def refuse_unmeasurable(case: Case) -> None:
    """Raise SceneError for a scene without the torque, or the replicas, to compare; settings every scene has."""
    case.need_grains()
    faults, kind = [], case.scene.geometry.name()
    if not case.scene.geometry.has_axis:
        message = "has no disc, and accuracy is measured by the disc's torque; take a clutch, a drum or a shear_cell"
        faults.append(Fault("geometry.kind", shown(kind), message))
    if packs_alike(case.scene):
        message = (
            "begins every replica alike, so that noise and error cannot be separated; take 'random', or particles.noise"
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
    own = START_UP.own(base.scene, base.plan)
    if own >= base.strain:
        return [STRAIN.format(f"{0.5 * base.strain:g}")]
    kept = [one for one in START_UP.values(base.scene, base.plan) if one < base.strain * (1.0 - 1e-9) and one != own]
    return [STRAIN.format(f"{one:g}") for one in (own, *kept)]


def values_to_plan(base: Base) -> list[ValueToPlan]:
    """Return the values to plan: all of each setting, but the scene's own.

    Raises
    ------
    SceneError
        Of a value in `accuracy.values` that the scene does not take, or of a list that says nothing: all at once.
    """
    found, faults = [], _lists_of_nothing(base.scene)
    case, plan = base.case, base.plan
    for setting in settings_of(base.scene):
        if setting.measured_on == HISTORIES:
            faults += _late_starts(base, setting)
            continue
        own = setting.own(base.scene, plan)
        for value in setting.values(base.scene, plan):
            if value == own:
                continue
            if setting.is_whole and value != round(value):
                faults += _faults(base, setting, value, [f"{setting.key} is a whole number"])
                continue
            entries = setting.entries(base.scene, plan, value)
            try:
                found.append(ValueToPlan(case.with_values(entries), setting.name, entries, value))
            except SceneError as error:
                faults += _faults(base, setting, value, [str(fault) for fault in error.faults])
    if faults:
        raise SceneError(faults, source_of(base.case))
    return found


def plan_value(value: ValueToPlan, base: Base | None = None) -> PlannedValue | list[str]:
    """Plan one value, and return it, or the faults of its scene; with the field of `base` nothing is solved."""
    begin = process_time()
    try:
        with bad_input_for(value.case.path):
            device = None if base is None else base.device.driven_as(value.case.scene)
            _, plan = make_plan(value.case, device, threads=1, like=None if base is None else base.plan)
    except SceneError as error:
        return [str(fault) for fault in error.faults]
    setting = next(one for one in settings_of(value.case.scene) if one.name == value.setting)
    own, planning = float(setting.own(value.case.scene, plan)), process_time() - begin
    seconds = _reference_seconds(plan)
    return PlannedValue(setting.name, own, setting.step_size(own), value.entries, plan.cost.grains, seconds, planning)


def _reference_seconds(plan: Plan) -> float:
    return plan.cost.seconds["total"] / slowness()


def accepted_values(
    base: Base, values: Sequence[ValueToPlan], found: Sequence[PlannedValue | list[str]]
) -> list[PlannedValue]:
    """Return the values that the scene takes; SceneError for those of `accuracy.values` that it does not."""
    faults: list[Fault] = []
    for value, one in zip(values, found, strict=True):
        if isinstance(one, list):
            setting = next(setting for setting in settings_of(base.scene) if setting.name == value.setting)
            faults += _faults(base, setting, value.asked, one)
    if faults:
        raise SceneError(faults, source_of(base.case))
    return [one for one in found if isinstance(one, PlannedValue)]


def _faults(base: Base, setting: Setting, value: float, why: Sequence[str]) -> list[Fault]:
    """Return the fault of a value that the scene lists; of the usual ones none, they are left out."""
    if getattr(base.scene.accuracy.values, setting.name) is None:
        return []
    message = f"is no value that the scene can have: {'; '.join(why)}; remove it from the list, or change the scene"
    return [Fault(f"accuracy.values.{setting.name}", f"{value:g}", message)]


def _lists_of_nothing(scene: Scene) -> list[Fault]:
    """Return the faults of lists in `accuracy.values` that are empty, or of a setting that the scene does not have."""
    faults, own = [], settings_of(scene)
    for setting in SETTINGS:
        asked = getattr(scene.accuracy.values, setting.name)
        if asked is None:
            continue
        key = f"accuracy.values.{setting.name}"
        if setting not in own:
            message = f"is of {setting.key}, which this scene does not use; remove it"
            faults.append(Fault(key, shown(list(asked)), message))
        elif not asked:
            faults.append(Fault(key, "[]", "has no value; name one or more, or remove it for the usual ones"))
    return faults


def _late_starts(base: Base, setting: Setting) -> list[Fault]:
    asked = getattr(base.scene.accuracy.values, setting.name) or ()
    end = instant_in_words(base.scene.span.end)
    end = end if base.strain is None or end.startswith("strain") else f"{end}, a strain of {base.strain:.4g}"
    message = f"is not before the end of the replicas, {end}; lower it, or raise accuracy.time_end"
    if base.strain is None:
        message = "is a shear strain, and nothing is sheared at a constant rate; remove the list"
    late = [one for one in asked if base.strain is None or one >= base.strain]
    return [Fault(f"accuracy.values.{setting.name}", f"{one:g}", message) for one in late]
