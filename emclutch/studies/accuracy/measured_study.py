"""From the results of an accuracy study's tasks to the study of the device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from emclutch.results.accuracy_studies import DRIVE
from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, MeasuredValue, pooled_scatter
from emclutch.results.errors import RunError
from emclutch.results.provenance import provenance
from emclutch.results.recommended import ONE_VALUE
from emclutch.results.text import format_duration
from emclutch.scene.case import Case
from emclutch.scene.flat import flat_scene
from emclutch.settings import FROZEN, HISTORIES, Setting, settings_of
from emclutch.simulation.discretisation_error import device_of
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.studies.accuracy.plan import BASE
from emclutch.studies.accuracy.planned_values import Base, PlannedValue
from emclutch.studies.accuracy.tasks import strain_of
from emclutch.studies.study import DONE, Row


@dataclass(frozen=True)
class StudyRuns:
    """Results of the tasks of a study.

    Attributes
    ----------
    case : Case
    base : Base
        Scene of its replicas.
    planned : tuple of PlannedValue
        All values but the scene's own.
    starts : tuple
        From where on each replica is averaged, the scene's own first.
    replicas : mapping of (setting, value) to list of Row
        Those that were run; (`BASE`, 0): at the scene's own settings.
    frozen : mapping of (setting, value) to Row
        Results on the frozen packing, the scene's own values among them.
    left_out : mapping of str to float
        Settings that did not fit into the budget, and the processor time that they need [s].
    budget : float
        Wall-clock time [s].
    jobs : int
    spent : float
        Processor time of all tasks [s].
    machine : mapping of str to Any
        On which the study began, see `this_machine`.
    """

    case: Case
    base: Base
    planned: tuple[PlannedValue, ...]
    starts: tuple[float | str, ...]
    replicas: Mapping[tuple[str, float], Sequence[Row]]
    frozen: Mapping[tuple[str, float], Row]
    left_out: Mapping[str, float]
    budget: float
    jobs: int
    spent: float
    machine: Mapping[str, Any]

    @property
    def own(self) -> list[Row]:
        """Return the replicas at the scene's own settings."""
        return list(self.replicas[BASE, 0.0])

    @property
    def torque(self) -> float:
        """Return their mean torque [N m]."""
        return float(np.mean([one.values["torque"] for one in self.own]))

    @property
    def seconds(self) -> float:
        """Return the processor time of one of them [s]."""
        return float(np.mean([one.seconds for one in self.own]))

    @property
    def means(self) -> dict[tuple[str, float], float]:
        """Return the mean torque at each value that has one [N m]."""
        return {
            key: float(np.mean([one.values["torque"] for one in some]))
            for key, some in self.replicas.items()
            if some and not failure_of(some, self.torque)
        }

    @property
    def scatter(self) -> tuple[float, float]:
        """Return the relative standard deviation of replicas at the scene's own settings, and its freedom."""
        return pooled_scatter([
            ([one.values["torque"] for one in some if one.state == DONE], self.variance(*key))
            for key, some in self.replicas.items()
            if not failure_of(some, self.torque)
        ])  # fmt: skip

    def variance(self, setting: str, value: float) -> float:
        """Return the variance of replicas at a value over that at the scene's own: by the numbers of grains."""
        if setting == BASE:
            return 1.0
        planned = next(one for one in self.planned if one.setting == setting and one.value == value)
        return self.base.plan.cost.grains / planned.grains


def study_of(found: StudyRuns) -> AccuracyStudy:
    """Return the study of a device; RunError where the torque at the scene's own settings has no sign."""
    refuse_no_torque(found.own)
    scatter, freedom = found.scatter
    settings, unknown, over_budget = [], {}, []
    for setting in settings_of(found.base.scene):
        measured = _measured_setting(setting, found, scatter, freedom)
        if sum(one.result is not None for one in measured.values) > 1:
            settings.append(measured)
        else:
            unknown[setting.name], has_no_room = _why_unknown(setting.name, measured, found)
            over_budget += [setting.name] * has_no_room
    flat = flat_scene(found.case.toml())
    return AccuracyStudy(
        device=device_of(found.case),
        case=found.case.name,
        drive={key: flat[key] for key in DRIVE if key in flat},
        torque=found.torque,
        scatter=scatter,
        freedom=freedom,
        strain=_averaged_strain(found),
        replicas=len(found.own),
        seconds=found.seconds,
        settings=tuple(settings),
        unknown=unknown,
        over_budget=over_budget,
        machine={**found.machine, "jobs": found.jobs, "budget": found.budget, "processor_seconds": round(found.spent)},
        kind=found.case.scene.geometry.name(),
    )


def refuse_no_torque(own: Sequence[Row]) -> None:
    """Raise RunError where replicas at the scene's own settings disagree on the sign of the torque."""
    torques = [one.values.get("torque") or 0.0 for one in own]
    if min(torques) <= 0.0 <= max(torques):
        words = ", ".join(f"{torque:.3g}" for torque in torques)
        raise RunError(
            f"replicas at the scene's own settings have torques of {words} N m: errors relative to such a "
            "torque are undefined; raise accuracy.time_end, or take a scene with a torque"
        )


def scatter_of(torques: Sequence[float]) -> float:
    """Return the relative standard deviation of some torques."""
    return float(np.std(torques, ddof=1) / abs(np.mean(torques)))


def failure_of(some: Sequence[Row], torque: float) -> str:
    """Return why there is no result at a value; empty where there is one."""
    if failed := next((one.short_reason for one in some if one.state != DONE), ""):
        return failed
    if any((one.values["torque"] or 0.0) * torque <= 0.0 for one in some):
        return "some of its replicas have a torque of the other sign"
    return ""


def _measured_setting(setting: Setting, found: StudyRuns, scatter: float, freedom: float) -> MeasuredSetting:
    own = float(setting.own(found.base.scene, found.base.plan))
    basis = Basis.TORQUE
    if setting.measured_on == FROZEN:
        basis, freedom, values = Basis.MOMENTS, math.inf, _frozen_values(setting, own, found)
    elif setting.measured_on == HISTORIES:
        basis = Basis.START_UP
        values, freedom = _start_up_values(setting, found)
    else:
        values = _torque_values(setting, own, found, scatter)
    ordered = tuple(sorted(values, key=lambda one: -one.step_size))
    limit = setting.limit(found.base.scene, found.base.plan)
    return MeasuredSetting(
        setting.name, setting.key, basis, own, setting.order, limit, ordered, freedom, setting.is_large
    )


def _torque_values(setting: Setting, own: float, found: StudyRuns, scatter: float) -> list[MeasuredValue]:
    """Return the values of a setting; those that were not run have their predicted cost."""
    keys = {(setting.name, one.value): one for one in found.planned if one.setting == setting.name}
    values = [_torque_value(own, setting.step_size(own), found.own, found.torque, scatter, found.seconds)]
    for key, planned in keys.items():
        some = found.replicas.get(key, ())
        if some:
            error = scatter * math.sqrt(found.variance(*key))
            values.append(_torque_value(key[1], planned.step_size, some, found.torque, error, found.seconds))
        else:
            values.append(_unmeasured(planned, found))
    return values


def _torque_value(
    value: float, step_size: float, some: Sequence[Row], torque: float, scatter: float, own_seconds: float
) -> MeasuredValue:
    failure, seconds = failure_of(some, torque), float(np.mean([one.seconds for one in some]))
    result = None if failure else float(np.mean([one.values["torque"] for one in some]))
    error = 0.0 if failure else scatter / math.sqrt(len(some))
    return MeasuredValue(value, step_size, result, error, len(some), seconds, seconds / own_seconds, failure)


def _predicted_cost(planned: PlannedValue, found: StudyRuns) -> float:
    """Return the cost of a value over that of the scene's own, rounded: equal ones do not differ by round-off."""
    return float(f"{planned.seconds / found.base.seconds:.9g}")


def _unmeasured(planned: PlannedValue, found: StudyRuns) -> MeasuredValue:
    cost = _predicted_cost(planned, found)
    return MeasuredValue(planned.value, planned.step_size, None, 0.0, 0, cost * found.seconds, cost)


def _frozen_values(setting: Setting, own: float, found: StudyRuns) -> list[MeasuredValue]:
    values = []
    planned = {one.value: one for one in found.planned if one.setting == setting.name}
    for value in (own, *planned):
        step_size = setting.step_size(value)
        done = found.frozen.get((setting.name, value))
        cost = _predicted_cost(planned[value], found) if value in planned else 1.0
        if done is None:
            values.append(_unmeasured(planned[value], found))
        else:
            moments, failure = done.values.get("moments"), done.short_reason
            values.append(MeasuredValue(value, step_size, moments, 0.0, 1, done.seconds, cost, failure))
    return values


def _start_up_values(setting: Setting, found: StudyRuns) -> tuple[list[MeasuredValue], float]:
    """Return the values of the start-up: each replica against itself, averaged from the latest start on.

    The mean over all replicas of the study, by their grains, of (T - T_latest)/T_latest; its standard error is that of
    the result, and 0 of the latest start, which the others are compared with.
    """
    strains = [strain for one in found.starts if (strain := strain_of(one)) is not None]
    if len(strains) < 2 or found.base.strain is None:
        return [], math.inf
    latest = strains.index(max(strains))
    rows, weights = [], []
    for key, some in found.replicas.items():
        if failure_of(some, found.torque):
            continue
        means = [one.values["means"] for one in some]
        reference = float(np.mean([one[latest] for one in means]))
        rows += [[(mean - one[latest]) / reference for mean in one] for one in means]
        weights += [1.0 / found.variance(*key)] * len(some)
    excess, weight = np.array(rows), np.array(weights) / sum(weights)
    mean, freedom = weight @ excess, len(rows) - 1.0
    # a replica has the variance s^2/w, and the mean that of s^2/sum(w), with s^2 = sum w (x - mean)^2 / (n - 1)
    error = np.sqrt(weight @ (excess - mean) ** 2 / freedom)
    own = strains[0]
    values = []
    for n, strain in enumerate(strains):
        result = found.torque * (1.0 + mean[n]) / (1.0 + mean[0])
        cost = (found.base.strain + strain - own) / found.base.strain  # of a run that averages as long
        values.append(
            MeasuredValue(
                strain, setting.step_size(strain), float(result), float(error[n]), len(rows), found.seconds, cost
            )
        )
    return values, freedom


def _averaged_strain(found: StudyRuns) -> float | None:
    start = strain_of(found.starts[0])
    return None if start is None or found.base.strain is None else found.base.strain - start


def _why_unknown(name: str, measured: MeasuredSetting, found: StudyRuns) -> tuple[str, bool]:
    """Return why the error of a setting is not known, and whether the budget had no room for it."""
    open_values = [one.seconds for one in measured.values if not one.replicas]
    if name in found.left_out or (open_values and not any(one.failure for one in measured.values)):
        wall = found.left_out.get(name, min(open_values, default=0.0)) / found.jobs
        return f"not measured in this budget: about {format_duration(wall)} more", True
    if failed := [f"{one.value:.4g}: {one.failure}" for one in measured.values if one.failure]:
        return f"fewer than two values have a result ({'; '.join(failed)})", False
    if not measured.values:
        return "the replicas end before the start-up does, or nothing is sheared; raise accuracy.time_end", False
    return ONE_VALUE, False


def this_machine() -> dict[str, Any]:
    """Return date, processor, cores, slowness and the commit of the program, as plain values."""
    known = provenance(threads=1)
    return {
        "date": known["written"],
        "processor": known["machine"]["cpu"],
        "cores": known["machine"]["cores"],
        "slowness": round(slowness(), 3),
        "commit": known["commit"],
    }
