"""The case with the cheapest settings for a wanted accuracy: those that the scene takes together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from emclutch.results.ladder import Ladder
from emclutch.results.recommended import Choice, Obstacle, obstacle, reaching
from emclutch.scene.case import Case
from emclutch.scene.errors import SceneError
from emclutch.simulation.knob_settings import settings_of, total_at, with_settings
from emclutch.simulation.plan import make_plan

MAX_PACKINGS = 64  # that a scene may ask for
SAFER = 0.95  # half width that is wanted where the scene takes settings somewhat coarser than they are
MAX_REFUSALS = 6  # of combinations by the scene, after which there is no answer


def cheapest_case(case: Case, ladder: Ladder, target: float) -> tuple[Choice, Case] | Obstacle:
    """Return the cheapest settings that the scene takes together, and the case with them; or why there are none."""
    refused: list[dict[str, float]] = []
    reason, first, wanted = "", None, target
    for choice in reaching(ladder, target):
        first = first or choice
        if choice.half_width > wanted or any(one.items() <= choice.settings.items() for one in refused):
            continue
        try:
            found = case_for(case, ladder, choice, target)
            if found is not None:
                return found
            wanted *= SAFER
        except (SceneError, ValueError) as error:
            refused.append(_to_blame(case, ladder, choice.settings))
            reason = f"the scene refuses {', '.join(refused[-1])} at these settings: {error}"
            if len(refused) == MAX_REFUSALS:
                break
    if not refused:
        return obstacle(ladder, wanted)
    return Obstacle(next(iter(refused[-1])), None, None, reason, first)


def _to_blame(case: Case, ladder: Ladder, settings: Mapping[str, float]) -> dict[str, float]:
    """Return the part of some refused settings that the scene refuses by itself: most often two that do not fit."""
    own = {one.knob: one.own for one in ladder.knobs}
    changed = {name: one for name, one in settings.items() if not math.isclose(one, own[name], rel_tol=1e-6)}
    taken: dict[str, float] = {}
    for name, setting in changed.items():
        if _takes(case, own | taken | {name: setting}):
            taken[name] = setting
            continue
        for other in [{}, *({one: taken[one]} for one in taken)]:
            if not _takes(case, own | other | {name: setting}):
                return {name: setting} | other
        return taken | {name: setting}
    return changed


def _takes(case: Case, settings: Mapping[str, float]) -> bool:
    try:
        with_settings(case, settings)
    except (SceneError, ValueError):
        return False
    return True


def case_for(case: Case, ladder: Ladder, choice: Choice, target: float) -> tuple[Choice, Case] | None:
    """Return a case with a choice's settings, that runs until statistics and discretisation together reach a target.

    The choice is returned as the scene takes it: a window, or a sector, may come out somewhat larger. None where its
    error is then larger than the target. SceneError or ValueError where the scene, or its plan, refuses
    the settings.
    """
    case = with_settings(case, choice.settings)
    values: dict[str, Any] = {
        "accuracy.target": None,
        "accuracy.replicas": None,
        "accuracy.max_replicas": min(MAX_PACKINGS, max(24, 2 * choice.packings)),
    }
    start = choice.settings.get("start_up")
    if start is not None and ladder.strain is not None:
        values["time.end"] = f"strain {start + ladder.strain:.6g}"
        if ladder.strain > start * 1.01:  # else the average begins in the middle, which is there
            values["time.average_from"] = f"strain {start:.6g}"
    case = case.with_values(values)
    plan = make_plan(case)[1]
    settings = settings_of(case, plan, start)
    choice = replace(choice, total=total_at(ladder, {name: settings[name] for name in choice.settings}, plan))
    if choice.total.unknown or choice.half_width > target:
        return None
    allowed = math.sqrt(target**2 - choice.total.half_width**2)
    return choice, case.with_values({"time.until": f"torque {math.floor(1e4 * allowed) / 100.0:g} %"})
