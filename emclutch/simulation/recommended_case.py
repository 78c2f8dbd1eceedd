"""The case with the cheapest settings for a wanted accuracy: those that the scene takes together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from emclutch.knobs import knobs_of
from emclutch.results.ladder import Ladder
from emclutch.results.ladders import DRIVE
from emclutch.results.recommended import Choice, Obstacle, obstacle, reaching
from emclutch.scene.case import Case
from emclutch.scene.errors import SceneError
from emclutch.scene.flat import flat_scene
from emclutch.scene.replica_count import DOUBTFUL_FREEDOM, packs_alike
from emclutch.scene.share import LEAST, MOST
from emclutch.scene.timing import MAX_SCATTER_FREEDOM
from emclutch.simulation.knob_settings import across_of, settings_of, total_at, with_settings
from emclutch.simulation.plan import make_plan

MAX_PACKINGS = 64  # that a scene may ask for
SMALLEST = 1e-3  # half width that a run is asked for where nothing is left of the target
SAFER = 0.95  # half width that is wanted where the scene takes settings somewhat coarser than they are
MAX_REFUSALS = 6  # of combinations by the scene, after which there is no answer


def cheapest_case(case: Case, ladder: Ladder, target: float) -> tuple[Choice, Case] | Obstacle:
    """Return the cheapest settings that the scene takes together, and the case with them; or why there are none."""
    measured = {one.knob for one in ladder.knobs} | set(ladder.unknown)
    missing = [one.name for one in knobs_of(case.scene) if one.name not in measured]
    if missing and not ladder.unknown:
        return Obstacle(missing[0], None, None, "the ladder is of a scene without it")
    if (obstacle_of_ring := whole_ring(case, ladder)) is not None:
        return obstacle_of_ring
    refused: list[dict[str, float]] = []
    reason, first, coarser, wanted, tries = "", None, None, target, 0
    for choice in reaching(ladder, target):
        first = first or choice
        if choice.half_width > wanted or any(one.items() <= choice.settings.items() for one in refused):
            continue
        try:
            found, turned = case_for(case, ladder, choice, target)
            if found.total.unknown:
                name, reason = next(iter(found.total.unknown.items()))
                return Obstacle(name, None, None, reason)
            if found.half_width <= target:
                return found, turned
            coarser, wanted, tries = found, SAFER * wanted, tries + 1
            if tries == MAX_REFUSALS:
                break
        except (SceneError, ValueError) as error:
            refused.append(_to_blame(case, ladder, choice.settings))
            reason = f"the scene refuses {', '.join(refused[-1])} at these settings: {error}"
            if len(refused) == MAX_REFUSALS:
                break
    if coarser is not None:
        return Obstacle(coarser.largest, coarser.parts[coarser.largest], None, best=coarser)
    if not refused:
        return obstacle(ladder, target)
    return Obstacle(next(iter(refused[-1])), None, None, reason, first)


def whole_ring(case: Case, ladder: Ladder) -> Obstacle | None:
    """Return why a ladder's costs are not those of a case: its packings have a sector, and the case the whole ring."""
    if case.scene.grains.sector is not None or "sector" not in {one.knob for one in ladder.knobs} | set(ladder.unknown):
        return None
    reason = "packings of the ladder have a sector of the ring, the scene has all of it, which costs more"
    return Obstacle("sector", None, None, f"{reason}; set particles.sector")


def _to_blame(case: Case, ladder: Ladder, settings: Mapping[str, float]) -> dict[str, float]:
    """Return the part of some refused settings that the scene refuses by itself: most often two that do not fit."""
    own = {one.knob: one.own for one in ladder.knobs}
    changed = {name: one for name, one in settings.items() if not math.isclose(one, own[name], rel_tol=1e-6)}
    taken: dict[str, float] = {}
    for name, setting in changed.items():
        if _takes(case, ladder, own | taken | {name: setting}):
            taken[name] = setting
            continue
        for other in [{}, *({one: taken[one]} for one in taken)]:
            if not _takes(case, ladder, own | other | {name: setting}):
                return {name: setting} | other
        return taken | {name: setting}
    return changed


def _takes(case: Case, ladder: Ladder, settings: Mapping[str, float]) -> bool:
    try:
        with_settings(case, settings, across_of(ladder))
    except (SceneError, ValueError):
        return False
    return True


def case_for(case: Case, ladder: Ladder, choice: Choice, target: float) -> tuple[Choice, Case]:
    """Return a case with a choice's settings, that runs until statistics and discretisation together reach a target.

    The scatter between replicas that the study has measured is pooled with the run's own.

    The choice is returned as the scene takes it: a window, or a sector, may come out somewhat larger, and its
    error be larger than the target, or unknown. SceneError or ValueError where the scene, or its plan, refuses the
    settings.
    """
    values: dict[str, Any] = {
        "accuracy.target": None,
        "accuracy.replicas": None,
        "accuracy.max_replicas": min(MAX_PACKINGS, max(24, 2 * choice.packings)),
    }
    start = choice.settings.get("start_up")
    if start is not None and ladder.strain is not None:
        values["time.end"] = f"strain {start + ladder.strain:.6g}"
        values["time.average_from"] = f"strain {start:.6g}"
        values["time.exclude_drift"] = False  # the start-up is part of the ladder, from more packings than a run has
    values |= known_scatter(case, ladder, choice)
    case = with_settings(case.with_values(values), choice.settings, across_of(ladder))
    plan = make_plan(case)[1]
    choice = replace(choice, total=total_at(ladder, settings_of(case, plan, start), plan))
    allowed = math.sqrt(max(target**2 - choice.total.half_width**2, SMALLEST**2))
    return choice, case.with_values({"time.until": f"torque {math.floor(1e4 * allowed) / 100.0:g} %"})


def known_scatter(case: Case, ladder: Ladder, choice: Choice) -> dict[str, Any]:
    """Return the entries of a scene that say how much replicas scatter at a choice's settings, by the ladder.

    With few degrees of freedom where the case has another drive than the ladder, or runs of another length. None where
    all replicas are alike, or scatter by more than a scene may say.
    """
    none: dict[str, Any] = {"accuracy.replica_scatter": None, "accuracy.replica_scatter_freedom": None}
    if packs_alike(case.scene) or not 0.0 < choice.scatter <= 0.01 * MOST or ladder.freedom < 1.0:
        return none
    other_length = "start_up" not in choice.settings and case.scene.accuracy.time_end is not None
    is_other = other_length or bool(other_drive(ladder, flat_scene(case.toml())))
    freedom = min(ladder.freedom, DOUBTFUL_FREEDOM if is_other else MAX_SCATTER_FREEDOM)
    return {
        "accuracy.replica_scatter": f"{max(100.0 * choice.scatter, LEAST):.4g} %",
        "accuracy.replica_scatter_freedom": int(freedom),
    }


def other_drive(ladder: Ladder, flat: Mapping[str, Any]) -> str:
    """Return at which drive a ladder was measured where the run has another; else empty."""
    others = [
        f"{key} = {ladder.drive[key]} instead of {flat.get(key)}"
        for key in DRIVE
        if key in ladder.drive and ladder.drive[key] != flat.get(key)
    ]
    return f"measured at {', '.join(others)}" if others else ""
