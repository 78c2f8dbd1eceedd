"""Settings of a scene's knobs: what they are, the error that a ladder knows of them, a scene with others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

from emclutch.knobs import KNOBS, Knob, knobs_of
from emclutch.results.ladder import Ladder, Total
from emclutch.scene.case import Case
from emclutch.simulation.plan import Plan, make_plan

BY_FACTOR = ("s", "m/s", "diameters")
"""Units of settings that may follow from those before: a sector grows with the grains across the gap."""
SAME = 1e-3
"""Of a setting: what is nearer to the scene's own is left as the scene has it."""


def settings_of(case: Case, plan: Plan, averaged_from: float | None = None) -> dict[str, float]:
    """Return the setting of each knob of a scene; `averaged_from`: strain from which on a run has averaged."""
    found = {one.name: float(one.own(case.scene, plan)) for one in knobs_of(case.scene)}
    if averaged_from and "start_up" in found:
        found["start_up"] = averaged_from
    return found


def total_at(ladder: Ladder, settings: Mapping[str, float], plan: Plan) -> Total:
    """Return the error at some settings, one for each knob of a planned scene.

    What has no error is as the plan says: at another current the real powder has another inertial number.
    """
    knobs = applying(settings)
    step_sizes = {one.name: one.step_size(settings[one.name]) for one in knobs}
    total = ladder.total(step_sizes, {one.name: one.limit(plan.scene, plan) for one in knobs})
    if plan.scene.span.step is None:
        return total
    lost = [one.name for one in KNOBS if one.in_contacts and ladder.knob(one.name) is not None]
    return replace(total, unknown=total.unknown | dict.fromkeys(lost, "time.step is given: its error is not known"))


def applying(settings: Mapping[str, float]) -> list[type[Knob]]:
    """Return the knobs of some settings."""
    return [one for one in KNOBS if one.name in settings]


def with_settings(case: Case, settings: Mapping[str, float]) -> Case:
    """Return a case with settings of its knobs, set one after another in their order.

    What the program chooses itself follows from the settings before it, as the step from the grains' diameter; times,
    speeds and widths are set, if others are wanted, by the same factor.

    Parameters
    ----------
    settings : by the knob's name; those of the case as it is are left alone, so that what is automatic remains so, and
        those of knobs that it does not have too

    Raises
    ------
    SceneError, ValueError
        The scene, or its plan, refuses one.
    """
    plan: Any = _PlanOnDemand(case)
    own = {one.name: one.own(case.scene, plan) for one in knobs_of(case.scene) if one.name in settings}
    for knob in KNOBS:
        if knob.name not in own:
            continue
        factor = settings[knob.name] / own[knob.name]
        if abs(factor - 1.0) > SAME:
            wanted = factor * knob.own(case.scene, plan) if knob.unit in BY_FACTOR else settings[knob.name]
            setting = float(f"{wanted:.6g}")
            case = case.with_values(knob.values(case.scene, plan, setting))
            plan = _PlanOnDemand(case)
    make_plan(case)
    return case


class _PlanOnDemand:
    """The plan of a case, made when it is first asked for: it may solve for a field, and most knobs need none."""

    def __init__(self, case: Case) -> None:
        self._case = case

    @cached_property
    def _plan(self) -> Plan:
        return make_plan(self._case)[1]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plan, name)
