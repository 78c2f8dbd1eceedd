"""From the results of an accuracy study's tasks to the ladder of the device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from emclutch.knobs import FROZEN, HISTORIES, Knob, knobs_of
from emclutch.results.errors import RunError
from emclutch.results.ladder import Basis, KnobLadder, Ladder, Rung, pooled_scatter
from emclutch.results.ladders import DRIVE
from emclutch.results.provenance import provenance
from emclutch.results.text import format_duration
from emclutch.scene.case import Case
from emclutch.scene.flat import flat_scene
from emclutch.simulation.discretisation_error import device_of
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.studies.accuracy.plan import BASE
from emclutch.studies.accuracy.rungs import Base, PlannedRung
from emclutch.studies.accuracy.tasks import TaskResult, strain_of


@dataclass(frozen=True)
class Measured:
    """What a study has found.

    Attributes
    ----------
    case : Case
    base : Base
        Of its packings.
    rungs : tuple of PlannedRung
        All settings but the scene's own.
    starts : tuple
        From where on each packing is averaged, the scene's own first.
    packings : mapping of (knob, setting) to list of TaskResult
        Of those that were run; (`BASE`, 0): at the scene's own settings.
    standing : mapping of (knob, setting) to TaskResult
        Of standing grains, the scene's own settings among them.
    left_out : mapping of str to float
        Knobs that did not fit into the budget, and the processor time that they need [s].
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
    rungs: tuple[PlannedRung, ...]
    starts: tuple[float | str, ...]
    packings: Mapping[tuple[str, float], Sequence[TaskResult]]
    standing: Mapping[tuple[str, float], TaskResult]
    left_out: Mapping[str, float]
    budget: float
    jobs: int
    spent: float
    machine: Mapping[str, Any]

    @property
    def own(self) -> list[TaskResult]:
        """Return the packings at the scene's own settings."""
        return list(self.packings[BASE, 0.0])

    @property
    def torque(self) -> float:
        """Return their mean torque [N m]."""
        return float(np.mean([one.value for one in self.own]))

    @property
    def seconds(self) -> float:
        """Return the processor time of one of them [s]."""
        return float(np.mean([one.seconds for one in self.own]))

    @property
    def means(self) -> dict[tuple[str, float], float]:
        """Return the mean torque of each setting that has one [N m]."""
        return {
            key: float(np.mean([one.value for one in some]))
            for key, some in self.packings.items()
            if some and not failure_of(some, self.torque)
        }

    @property
    def scatter(self) -> tuple[float, float]:
        """Return the relative standard deviation of packings at the scene's own settings, and its freedom."""
        return pooled_scatter([
            ([float(one.value) for one in some if one.value is not None], self.variance(*key))
            for key, some in self.packings.items()
            if not failure_of(some, self.torque)
        ])  # fmt: skip

    def variance(self, knob: str, setting: float) -> float:
        """Return the variance of a rung's packings over that of the scene's own: by the numbers of grains."""
        if knob == BASE:
            return 1.0
        rung = next(one for one in self.rungs if one.knob == knob and one.setting == setting)
        return self.base.plan.cost.grains / rung.grains


def ladder_of(found: Measured) -> Ladder:
    """Return the ladder of a study; RunError where the torque at the scene's own settings has no sign."""
    refuse_no_torque(found.own)
    scatter, freedom = found.scatter
    knobs, unknown = [], {}
    for knob in knobs_of(found.base.scene):
        ladder = _knob_ladder(knob, found, scatter, freedom)
        if sum(one.value is not None for one in ladder.rungs) > 1:
            knobs.append(ladder)
        else:
            unknown[knob.name] = _why_unknown(knob.name, ladder, found)
    flat = flat_scene(found.case.toml())
    return Ladder(
        device=device_of(found.case),
        case=found.case.name,
        drive={key: flat[key] for key in DRIVE if key in flat},
        torque=found.torque,
        scatter=scatter,
        freedom=freedom,
        strain=_averaged_strain(found),
        packings=len(found.own),
        seconds=found.seconds,
        knobs=tuple(knobs),
        unknown=unknown,
        machine={
            **found.machine,
            "jobs": found.jobs,
            "budget": found.budget,
            "processor_seconds": round(found.spent),
        },
    )


def refuse_no_torque(own: Sequence[TaskResult]) -> None:
    """Raise RunError where packings at the scene's own settings disagree on the sign of the torque."""
    values = [one.value or 0.0 for one in own]
    if min(values) <= 0.0 <= max(values):
        words = ", ".join(f"{value:.3g}" for value in values)
        raise RunError(
            f"packings at the scene's own settings have torques of {words} N m: there is nothing that errors could be "
            "relative to; raise accuracy.time_end, or take a scene with a torque"
        )


def scatter_of(values: Sequence[float]) -> float:
    """Return the relative standard deviation of some torques."""
    return float(np.std(values, ddof=1) / abs(np.mean(values)))


def failure_of(some: Sequence[TaskResult], torque: float) -> str:
    """Return why a rung has no value; empty where it has."""
    if failed := next((one.failure for one in some if one.failure), ""):
        return failed
    if any((one.value or 0.0) * torque <= 0.0 for one in some):
        return "some of its packings have a torque of the other sign"
    return ""


def _knob_ladder(knob: type[Knob], found: Measured, scatter: float, freedom: float) -> KnobLadder:
    own = float(knob.own(found.base.scene, found.base.plan))
    basis = Basis.TORQUE
    if knob.measured_on == FROZEN:
        basis, freedom, rungs = Basis.MOMENTS, math.inf, _standing_rungs(knob, own, found)
    elif knob.measured_on == HISTORIES:
        basis = Basis.LATER
        rungs, freedom = _later_rungs(knob, found)
    else:
        rungs = _torque_rungs(knob, own, found, scatter)
    ordered = tuple(sorted(rungs, key=lambda one: -one.step_size))
    limit = knob.limit(found.base.scene, found.base.plan)
    return KnobLadder(knob.name, knob.key, basis, own, knob.order, limit, ordered, freedom, knob.is_large)


def _torque_rungs(knob: type[Knob], own: float, found: Measured, scatter: float) -> list[Rung]:
    """Return the rungs of a knob, those that were not run with their predicted cost."""
    keys = {(knob.name, one.setting): one for one in found.rungs if one.knob == knob.name}
    rungs = [_torque_rung(own, knob.step_size(own), found.own, found.torque, scatter, found.seconds)]
    for key, planned in keys.items():
        some = found.packings.get(key, ())
        if some:
            error = scatter * math.sqrt(found.variance(*key))
            rungs.append(_torque_rung(key[1], planned.step_size, some, found.torque, error, found.seconds))
        else:
            rungs.append(_unmeasured(planned, found))
    return rungs


def _torque_rung(
    setting: float, step_size: float, some: Sequence[TaskResult], torque: float, scatter: float, own_seconds: float
) -> Rung:
    failure, seconds = failure_of(some, torque), float(np.mean([one.seconds for one in some]))
    value = None if failure else float(np.mean([one.value for one in some]))
    error = 0.0 if failure else scatter / math.sqrt(len(some))
    return Rung(setting, step_size, value, error, len(some), seconds, seconds / own_seconds, failure)


def _predicted_cost(planned: PlannedRung, found: Measured) -> float:
    """Return the cost of a setting over that of the scene's own, rounded: equal ones do not differ by round-off."""
    return float(f"{planned.seconds / found.base.seconds:.9g}")


def _unmeasured(planned: PlannedRung, found: Measured) -> Rung:
    cost = _predicted_cost(planned, found)
    return Rung(planned.setting, planned.step_size, None, 0.0, 0, cost * found.seconds, cost)


def _standing_rungs(knob: type[Knob], own: float, found: Measured) -> list[Rung]:
    rungs = []
    planned = {one.setting: one for one in found.rungs if one.knob == knob.name}
    for setting in (own, *planned):
        step_size = knob.step_size(setting)
        result = found.standing.get((knob.name, setting))
        cost = _predicted_cost(planned[setting], found) if setting in planned else 1.0
        if result is None:
            rungs.append(_unmeasured(planned[setting], found))
        else:
            rungs.append(Rung(setting, step_size, result.value, 0.0, 1, result.seconds, cost, result.failure))
    return rungs


def _later_rungs(knob: type[Knob], found: Measured) -> tuple[list[Rung], float]:
    """Return the rungs of the start-up: each packing against itself, averaged from the latest start on.

    The mean over all packings of the study, by their grains, of (T - T_latest)/T_latest; its standard error is that of
    the rung, and 0 of the latest start, which the others are compared with.
    """
    strains = [strain for one in found.starts if (strain := strain_of(one)) is not None]
    if len(strains) < 2 or found.base.strain is None:
        return [], math.inf
    latest = strains.index(max(strains))
    rows, weights = [], []
    for key, some in found.packings.items():
        if failure_of(some, found.torque):
            continue
        reference = float(np.mean([one.means[latest] for one in some]))
        rows += [[(mean - one.means[latest]) / reference for mean in one.means] for one in some]
        weights += [1.0 / found.variance(*key)] * len(some)
    excess, weight = np.array(rows), np.array(weights) / sum(weights)
    mean, freedom = weight @ excess, len(rows) - 1.0
    # a packing has the variance s^2/w, and the mean that of s^2/sum(w), with s^2 = sum w (x - mean)^2 / (n - 1)
    error = np.sqrt(weight @ (excess - mean) ** 2 / freedom)
    own = strains[0]
    rungs = []
    for n, strain in enumerate(strains):
        value = found.torque * (1.0 + mean[n]) / (1.0 + mean[0])
        cost = (found.base.strain + strain - own) / found.base.strain  # of a run that averages as long
        rungs.append(
            Rung(strain, knob.step_size(strain), float(value), float(error[n]), len(rows), found.seconds, cost)
        )
    return rungs, freedom


def _averaged_strain(found: Measured) -> float | None:
    start = strain_of(found.starts[0])
    return None if start is None or found.base.strain is None else found.base.strain - start


def _why_unknown(name: str, ladder: KnobLadder, found: Measured) -> str:
    if name in found.left_out:
        wall = found.left_out[name] / found.jobs
        return f"not measured in this budget: about {format_duration(wall)} more"
    if failed := [f"{one.setting:.4g}: {one.failure}" for one in ladder.rungs if one.failure]:
        return f"fewer than two settings have a value ({'; '.join(failed)})"
    if not ladder.rungs:
        return "the packings end before the start-up does, or nothing is sheared; raise accuracy.time_end"
    if any(not one.packings for one in ladder.rungs):
        wall = min(one.seconds for one in ladder.rungs if not one.packings) / found.jobs
        return f"not measured in this budget: about {format_duration(wall)} more"
    return "no other setting of it fits the scene"


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
