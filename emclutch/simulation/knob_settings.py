"""Settings of a scene's knobs: what they are, the error that a ladder knows of them, a scene with others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

from emclutch.knobs import KNOBS, Knob, knobs_of
from emclutch.knobs.powder import GrainsAcross, SectorWidth
from emclutch.results.ladder import Ladder, Total
from emclutch.scene.case import Case
from emclutch.simulation.plan import Plan, make_plan

DIMENSIONAL = ("s", "m/s")
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
    knobs, measured = applying(settings), as_measured(settings, ladder)
    step_sizes = {one.name: one.step_size(measured[one.name]) for one in knobs}
    total = ladder.total(step_sizes, {one.name: one.limit(plan.scene, plan) for one in knobs})
    if plan.scene.span.step is None:
        return total
    lost = [one.name for one in KNOBS if one.in_contacts and ladder.knob(one.name) is not None]
    return replace(total, unknown=total.unknown | dict.fromkeys(lost, "time.step is given: its error is not known"))


def as_measured(settings: Mapping[str, float], ladder: Ladder) -> dict[str, float]:
    """Return some settings as those of a ladder: the sector's width with the same error at its size of grains."""
    known, across, sector = dict(settings), across_of(ladder), ladder.knob("sector")
    if across is not None and sector is not None and "sector" in known and "grains_across" in known:
        known["sector"] = SectorWidth.as_measured(known["sector"], known["grains_across"] / across, sector.own)
    return known


def across_of(ladder: Ladder) -> float | None:
    """Return the grains across the gap of the scene that a ladder was measured on; None where it does not vary them."""
    grains = ladder.knob("grains_across")
    return None if grains is None else grains.own


def applying(settings: Mapping[str, float]) -> list[type[Knob]]:
    """Return the knobs of some settings."""
    return [one for one in KNOBS if one.name in settings]


def with_settings(case: Case, settings: Mapping[str, float], across: float | None = None) -> Case:
    """Return a case with settings of its knobs, set one after another in their order.

    What the program chooses itself follows from the settings before it, as the step from the grains' diameter; times
    and speeds are set, if others are wanted, by the same factor.

    Parameters
    ----------
    settings : by the knob's name; those of the case as it is are left alone, so that what is automatic remains so, and
        those of knobs that it does not have too
    across : grains across the gap for which the width of the sector is given: with finer ones it is as wide as with
        these. Default: those that the scene is given

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
        wanted, before = settings[knob.name], own[knob.name]
        if knob is SectorWidth:
            if across is not None and GrainsAcross.applies(case.scene):
                wanted = SectorWidth.beside(wanted, GrainsAcross.own(case.scene, plan) / across)
            before = SectorWidth.own(case.scene, plan)
        if abs(wanted / before - 1.0) > (SectorWidth.WHOLE if knob is SectorWidth else SAME):
            if knob.unit in DIMENSIONAL:
                wanted *= knob.own(case.scene, plan) / before
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
