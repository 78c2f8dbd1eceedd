"""The case with the cheapest settings for a wanted accuracy: those that the scene takes together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from emclutch.results.accuracy_studies import DRIVE
from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.results.recommended import Choice, LimitingError, limiting_error, reaching
from emclutch.scene.case import Case
from emclutch.scene.errors import SceneError
from emclutch.scene.flat import flat_scene
from emclutch.scene.fraction import LEAST, MOST
from emclutch.scene.replica_count import DOUBTFUL_FREEDOM, packs_alike
from emclutch.scene.timing import MAX_SCATTER_FREEDOM
from emclutch.settings import settings_of
from emclutch.simulation.plan import make_plan
from emclutch.simulation.setting_values import grains_per_gap_of, setting_values, total_at, with_settings

MAX_REPLICAS = 64  # that a scene may ask for
SMALLEST = 1e-3  # half width that a run is asked for where nothing is left of the target
SAFER = 0.95  # half width that is wanted where the scene takes values somewhat coarser than they are
STRICTER = 0.97, 0.94  # times a target
MAX_REFUSALS = 6  # of combinations by the scene, after which there is no answer


def cheapest_case(case: Case, study: AccuracyStudy, target: float) -> tuple[Choice, Case] | LimitingError:
    """Return the cheapest settings that the scene takes together, and the case with them; or why there are none.

    Somewhat stricter targets are tried too: a scene may take their settings as they are, and cheaper ones coarser.
    """
    first = cheapest_at(case, study, target)
    if isinstance(first, LimitingError) and (first.best is None or first.best.half_width > target):
        return first
    answers = [first, *(cheapest_at(case, study, one * target) for one in STRICTER)]
    found = [one for one in answers if not isinstance(one, LimitingError)]
    return min(found, key=lambda one: one[0].seconds) if found else answers[0]


def cheapest_at(case: Case, study: AccuracyStudy, target: float) -> tuple[Choice, Case] | LimitingError:
    """Return the answer of `cheapest_case` without stricter targets."""
    measured = {one.name for one in study.settings} | set(study.unknown)
    missing = [one.name for one in settings_of(case.scene) if one.name not in measured]
    if missing and not study.unknown:
        return LimitingError(missing[0], None, None, "the accuracy study is of a scene without it")
    if (error_of_ring := whole_ring(case, study)) is not None:
        return error_of_ring
    refused: list[dict[str, float]] = []
    reason, first, coarser, wanted, tries = "", None, None, target, 0
    for choice in reaching(study, target):
        first = first or choice
        if choice.half_width > wanted or any(one.items() <= choice.values.items() for one in refused):
            continue
        try:
            found, turned = case_for(case, study, choice, target)
            if found.total.unknown:
                name, reason = next(iter(found.total.unknown.items()))
                return LimitingError(name, None, None, reason)
            if found.half_width <= target:
                return found, turned
            coarser, wanted, tries = found, SAFER * wanted, tries + 1
            if tries == MAX_REFUSALS:
                break
        except (SceneError, ValueError) as error:
            refused.append(_to_blame(case, study, choice.values))
            reason = f"the scene refuses {', '.join(refused[-1])} at these settings: {error}"
            if len(refused) == MAX_REFUSALS:
                break
    if coarser is not None:
        return LimitingError(coarser.largest, coarser.parts[coarser.largest], None, best=coarser)
    if not refused:
        return limiting_error(study, target)
    return LimitingError(next(iter(refused[-1])), None, None, reason, first)


def whole_ring(case: Case, study: AccuracyStudy) -> LimitingError | None:
    """Return why a study's costs are not those of a case: its replicas have a sector, and the case the whole ring."""
    if case.scene.grains.sector is not None or (study.setting("sector") is None and "sector" not in study.unknown):
        return None
    reason = "replicas of the study have a sector of the ring, the scene has all of it, which costs more"
    return LimitingError("sector", None, None, f"{reason}; set particles.sector")


def _to_blame(case: Case, study: AccuracyStudy, values: Mapping[str, float]) -> dict[str, float]:
    """Return the part of some refused settings that the scene refuses by itself: most often two that do not fit."""
    own = {one.name: one.own for one in study.settings}
    changed = {name: one for name, one in values.items() if not math.isclose(one, own[name], rel_tol=1e-6)}
    taken: dict[str, float] = {}
    for name, value in changed.items():
        if _takes(case, study, own | taken | {name: value}):
            taken[name] = value
            continue
        for other in [{}, *({one: taken[one]} for one in taken)]:
            if not _takes(case, study, own | other | {name: value}):
                return {name: value} | other
        return taken | {name: value}
    return changed


def _takes(case: Case, study: AccuracyStudy, values: Mapping[str, float]) -> bool:
    try:
        with_settings(case, values, grains_per_gap_of(study))
    except (SceneError, ValueError):
        return False
    return True


def case_for(case: Case, study: AccuracyStudy, choice: Choice, target: float) -> tuple[Choice, Case]:
    """Return a case with a choice's settings, that runs until statistics and discretisation together reach a target.

    The scatter between replicas that the study has measured is pooled with the run's own.

    The choice is returned as the scene takes it: a window, or a sector, may come out somewhat larger, and its
    error be larger than the target, or unknown. SceneError or ValueError where the scene, or its plan, refuses the
    settings.
    """
    values: dict[str, Any] = {
        "accuracy.target": None,
        "accuracy.replicas": None,
        "accuracy.max_replicas": min(MAX_REPLICAS, max(24, 2 * choice.replicas)),
    }
    start = choice.values.get("start_up")
    if start is not None and study.strain is not None:
        values["time.end"] = f"strain {start + study.strain:.6g}"
        values["time.average_from"] = f"strain {start:.6g}"
        values["time.exclude_drift"] = False  # the start-up is part of the study, from more replicas than a run has
    values |= known_scatter(case, study, choice)
    case = with_settings(case.with_values(values), choice.values, grains_per_gap_of(study))
    plan = make_plan(case)[1]
    choice = replace(choice, total=total_at(study, setting_values(case, plan, start), plan))
    allowed = math.sqrt(max(target**2 - choice.total.half_width**2, SMALLEST**2))
    return choice, case.with_values({"time.until": f"torque {math.floor(1e4 * allowed) / 100.0:g} %"})


def known_scatter(case: Case, study: AccuracyStudy, choice: Choice) -> dict[str, Any]:
    """Return the entries of a scene that say how much replicas scatter at a choice's settings, by the study.

    With few degrees of freedom where the case has another drive than the study, or runs of another length. None where
    all replicas are alike, or scatter by more than a scene may say.
    """
    none: dict[str, Any] = {"accuracy.replica_scatter": None, "accuracy.replica_scatter_freedom": None}
    if packs_alike(case.scene) or not 0.0 < choice.scatter <= 0.01 * MOST or study.freedom < 1.0:
        return none
    other_length = "start_up" not in choice.values and case.scene.accuracy.time_end is not None
    is_other = other_length or bool(other_drive(study, flat_scene(case.toml())))
    freedom = min(study.freedom, DOUBTFUL_FREEDOM if is_other else MAX_SCATTER_FREEDOM)
    return {
        "accuracy.replica_scatter": f"{max(100.0 * choice.scatter, LEAST):.4g} %",
        "accuracy.replica_scatter_freedom": int(freedom),
    }


def other_drive(study: AccuracyStudy, flat: Mapping[str, Any]) -> str:
    """Return at which drive a study was made where the run has another; else empty."""
    others = [
        f"{key} = {study.drive[key]} instead of {flat.get(key)}"
        for key in DRIVE
        if key in study.drive and study.drive[key] != flat.get(key)
    ]
    return f"measured at {', '.join(others)}" if others else ""
