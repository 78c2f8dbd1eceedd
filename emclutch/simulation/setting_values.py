"""Values of a scene's settings: what they are, their error by an accuracy study, and a scene with others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

from emclutch.results.accuracy_study import AccuracyStudy, Total
from emclutch.scene.case import Case
from emclutch.settings import SETTINGS, Setting, settings_of
from emclutch.settings.powder import GRAINS_PER_GAP, SAME_WIDTH, SECTOR, width_as_measured, width_beside
from emclutch.simulation.plan import Plan, make_plan

DIMENSIONAL = ("s", "m/s")
REL_TOL = 1e-3
"""Relative difference of two values below which the scene's own is kept."""


def setting_values(case: Case, plan: Plan, averaged_from: float | None = None) -> dict[str, float]:
    """Return the value of each setting of a scene; `averaged_from`: strain from which on a run has averaged."""
    found = {one.name: float(one.own(case.scene, plan)) for one in settings_of(case.scene)}
    if averaged_from and "start_up" in found:
        found["start_up"] = averaged_from
    return found


def total_at(study: AccuracyStudy, values: Mapping[str, float], plan: Plan) -> Total:
    """Return the error at some values, one for each setting of a planned scene.

    What has no error is as the plan says: at another current the real powder has another inertial number.
    """
    settings, measured = applying(values), as_measured(values, study)
    step_sizes = {one.name: one.step_size(measured[one.name]) for one in settings}
    total = study.total(step_sizes, {one.name: one.limit(plan.scene, plan) for one in settings})
    if plan.scene.span.step is None:
        return total
    lost = [one.name for one in SETTINGS if one.in_contacts and study.setting(one.name) is not None]
    return replace(total, unknown=total.unknown | dict.fromkeys(lost, "time.step is given: its error is not known"))


def as_measured(values: Mapping[str, float], study: AccuracyStudy) -> dict[str, float]:
    """Return some values as those of a study: the sector's width with the same error at its size of grains."""
    known, per_gap, sector = dict(values), grains_per_gap_of(study), study.setting("sector")
    if per_gap is not None and sector is not None and "sector" in known and "grains_per_gap" in known:
        known["sector"] = width_as_measured(known["sector"], known["grains_per_gap"] / per_gap, sector.own)
    return known


def grains_per_gap_of(study: AccuracyStudy) -> float | None:
    """Return the grains per gap of the scene of a study; None where the study does not vary them."""
    grains = study.setting("grains_per_gap")
    return None if grains is None else grains.own


def applying(values: Mapping[str, float]) -> list[Setting]:
    """Return the settings of some values."""
    return [one for one in SETTINGS if one.name in values]


def with_settings(case: Case, values: Mapping[str, float], per_gap: float | None = None) -> Case:
    """Return a case with other values of its settings, set one after another in their order.

    What the program chooses itself follows from the settings before it, as the step from the grains' diameter; times
    and speeds are set, if others are wanted, by the same factor.

    Parameters
    ----------
    values : by the setting's name; the case's own values are left alone, so that automatic ones remain automatic, and
        so are values of settings that it does not have
    per_gap : grains per gap for which the width of the sector is given: with finer ones it is as wide as with these.
        Default: those that the scene is given

    Raises
    ------
    SceneError, ValueError
        The scene, or its plan, refuses one.
    """
    plan: Any = _PlanOnDemand(case)
    own = {one.name: one.own(case.scene, plan) for one in settings_of(case.scene) if one.name in values}
    for setting in SETTINGS:
        if setting.name not in own:
            continue
        wanted, before = values[setting.name], own[setting.name]
        if setting is SECTOR:
            if per_gap is not None and GRAINS_PER_GAP.applies(case.scene):
                wanted = width_beside(wanted, GRAINS_PER_GAP.own(case.scene, plan) / per_gap)
            before = SECTOR.own(case.scene, plan)
        if abs(wanted / before - 1.0) > (SAME_WIDTH if setting is SECTOR else REL_TOL):
            if setting.unit in DIMENSIONAL:
                wanted *= setting.own(case.scene, plan) / before
            value = float(f"{wanted:.6g}")
            case = case.with_values(setting.entries(case.scene, plan, value))
            plan = _PlanOnDemand(case)
    make_plan(case)
    return case


class _PlanOnDemand:
    """The plan of a case, made when it is first asked for: it may solve for a field, and most settings need none."""

    def __init__(self, case: Case) -> None:
        self._case = case

    @cached_property
    def _plan(self) -> Plan:
        return make_plan(self._case)[1]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plan, name)
