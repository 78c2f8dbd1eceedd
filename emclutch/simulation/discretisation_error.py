"""Discretisation error of a run: what the ladder of its device says of its settings.

A ladder is measured once for a device (`emclutch accuracy`) and found again by the hash of what matters of the scene;
each run evaluates it at its own settings. Nothing is measured here: without a ladder the error is not known, and the
summary says which command finds it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.knobs import knobs_of
from emclutch.knobs.powder import COUNT
from emclutch.results import OutputError
from emclutch.results.ladder import Ladder, Total
from emclutch.results.ladders import SHIPPED, device_hash, find_ladder
from emclutch.results.recommended import STATISTICS, Obstacle, recommended
from emclutch.results.statistics import Estimate
from emclutch.results.text import format_duration, per_cent
from emclutch.scene.case import Case
from emclutch.scene.flat import flat_scene, keys_at_default
from emclutch.scene.input_files import file_contents
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.simulation.knob_settings import applying, as_measured, settings_of, total_at
from emclutch.simulation.plan import Plan
from emclutch.simulation.recommended_case import cheapest_case, other_drive, whole_ring
from emclutch.simulation.scaled_slip import strain_rate

if TYPE_CHECKING:
    from emclutch.device_model.device import Device

log = logging.getLogger(__name__)
SAME_SPEED = 1.2
"""Ratio of two measured speeds up to which they are one machine's."""
TARGETS = (0.10, 0.05, 0.03)
"""Total errors that settings are usually wanted for."""
FAR = 2.0
"""Factor of step size beyond the rungs from which on the law is said to be extrapolated."""

ROUNDING = 1.01
"""Of a target: settings and windows are rounded."""


def device_of(case: Case) -> str:
    """Return the hash by which the ladder of a device is found: of all but numerical settings, seed, drive and output.

    Speeds count also where an inertial number takes their place: at them the real powder has its own, where the error
    of another one begins. A file counts with its content.
    """
    scene, flat = case.scene, flat_scene(case.toml())
    flat |= file_contents(scene)
    numerical = {key for one in knobs_of(scene) for key in one.keys(scene)}
    if scene.grains.count is not None and COUNT in numerical:
        volume = scene.grains.count * scene.grains.grain_volume / (scene.grains.sector or 2.0 * math.pi)
        flat["particles.volume"] = f"{volume:.2g}"  # counts are whole numbers, and follow from the size of the grains
    return device_hash(flat, numerical, frozenset(keys_at_default(scene)))


def ladder_of_device(case: Case) -> tuple[Ladder, Path] | None:
    """Return the ladder of a case's device, with the times of this machine, and its file; None where there is none.

    OutputError for a damaged file.
    """
    found = find_ladder(device_of(case))
    if found is None:
        return None
    ladder, path = found
    ratio = slowness() / ladder.machine.get("slowness", slowness())
    return (ladder if 1.0 / SAME_SPEED < ratio < SAME_SPEED else ladder.on_another_machine(ratio)), path


def has_accuracy_study(case: Case) -> bool:
    """Return whether the errors of the settings of a case's device were measured."""
    try:
        return ladder_of_device(case) is not None
    except OutputError:  # `accuracy_in_words` names the damaged file
        return False


def discretisation_error(
    case: Case, plan: Plan, torque: Estimate | None, device: Device | None = None
) -> dict[str, Any]:
    """Return the entries of a run's summary, in plain values.

    Parameters
    ----------
    case, plan : of the run.
    torque : its steady torque [N m]; None: it has none.
    device : whose gap is sheared; None: nothing is.

    Returns
    -------
    dict
        `discretisation_error`: `bias` and `half_width` of its 95 % interval, relative to the torque, positive where it
        is too large; `parts` by knob, with its setting; `unknown` knobs and `extrapolated` ones with the reason; the
        `ladder`; `corrected_torque` [N m] and `total_error`, relative: statistics and discretisation in quadrature.
        None, with `discretisation_error_note`, where it is not known.
    """
    if torque is None or not torque.mean:
        return _unknown("the run has no steady torque on the disc, to which ladders refer")
    try:
        return _by_ladder(case, plan, torque, device)
    except OutputError as error:
        return _unknown(str(error))
    except Exception as error:  # a run that has come to its end does not fail of what is said about it
        log.exception("the discretisation error cannot be told")
        return _unknown(f"defect of the program, please report it: {type(error).__name__}: {error}")


def is_reached(asked: float, torque: Estimate | None, error: dict[str, Any] | None) -> bool:
    """Return whether a total error is reached: by a steady torque, with the errors of all settings known.

    `asked` is relative; `error` is the `discretisation_error` of a summary.
    """
    if torque is None or not torque.converged or error is None or error["unknown"] or error["total_error"] is None:
        return False
    return error["total_error"] <= asked * ROUNDING


def _by_ladder(case: Case, plan: Plan, torque: Estimate, device: Device | None) -> dict[str, Any]:
    found = ladder_of_device(case)
    if found is None:
        how = f"{how_to_find(case)}, in up to {format_duration(case.scene.accuracy.budget)}"
        return _unknown(f"no ladder of this device has been measured; measure it with: {how}")
    ladder, path = found
    rate = 0.0 if device is None else strain_rate(plan.scene, device)
    strain = None if torque.start is None else torque.start * rate
    settings = settings_of(case, plan, strain)
    total = total_at(ladder, settings, plan)
    flat = flat_scene(case.toml())
    entry = total.as_dict()
    for knob in entry["parts"]:
        entry["parts"][knob]["setting"] = settings[knob]
    entry["extrapolated"] = extrapolated(ladder, settings)
    entry["ladder"] = {
        "file": str(path),
        "device": ladder.device,
        "case": ladder.case,
        "date": ladder.machine.get("date"),
        "drive": ladder.drive,
        "note": other_drive(ladder, flat),
    }
    entry |= corrected(torque, total)
    entry["next"] = _next(case, ladder, entry["total_error"])
    return {"discretisation_error": entry}


def _next(case: Case, ladder: Ladder, total: float | None) -> str | None:
    """Return what the next of the usual targets takes, by the ladder; None: it is reached, or the error unknown."""
    target = next((one for one in TARGETS if total is not None and one < total), None)
    if target is None:
        return None
    found, share = whole_ring(case, ladder) or recommended(ladder, target), per_cent(target)
    if isinstance(found, Obstacle):
        budget = "" if found.seconds is None else f": {how_to_find(case)} --budget {math.ceil(found.seconds / 60.0)}min"
        return f"{share} is {found.in_words()}{budget}"
    cost = f"{found.packings} packings, {format_duration(found.seconds)} of processor time"
    return f"{share} takes about {cost}, with the settings of: {how_to_find(case)} --for '{share}'"


def accuracy_in_words(case: Case, plan: Plan) -> str:
    """Return what is known of a case's accuracy before it is run, and what its target costs."""
    target, budget = case.scene.accuracy.target, format_duration(case.scene.accuracy.budget)
    try:
        found = ladder_of_device(case)
    except OutputError as error:
        return str(error)
    if found is None and target is None:
        return f"error of the settings unknown: no ladder of this device; measure it with: {how_to_find(case)}"
    if found is None:
        return (
            f"{target}: no ladder of this device; it is measured first, which takes up to {budget} (accuracy.budget), "
            "and says what the run costs"
        )
    ladder, path = found
    if target is not None:
        answer = cheapest_case(case, ladder, target)
        words = answer.in_words() if isinstance(answer, Obstacle) else answer[0].in_words()
        return f"{target}: {words}; by {_shown(path)}"
    total = total_at(ladder, settings_of(case, plan), plan)
    low, high = (100.0 * end for end in total.whole.interval)
    text = f"numerical settings change the torque by {100.0 * total.bias:+.2g} % (95 %: {low:+.2g} to {high:+.2g} %)"
    if total.largest is not None:
        size = per_cent(total.widths[total.largest])
        text += f"; largest part: {total.largest.replace('_', ' ')}, {size}"
    text += "".join(f"; not included: {name.replace('_', ' ')} ({why})" for name, why in total.unknown.items())
    return f"{text}; measured by {how_to_find(case)}, in {_shown(path)}"


def _shown(path: Path) -> str:
    """Return where a ladder lies: short, as lines of `check` are."""
    if path.parent == SHIPPED:
        return "the ladder that comes with emclutch"
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def how_to_find(case: Case) -> str:
    """Return the command that measures the ladder of a case, in its usual time."""
    return f"emclutch accuracy {case.path or 'CASE'}"


def corrected(torque: Estimate, total: Total) -> dict[str, Any]:
    """Return a torque without its bias [N m], with half its 95 % interval, and that relative to it; None: unknown."""
    assert torque.mean is not None
    mean, half = torque.mean / (1.0 + total.bias), torque.half_width()
    share = None if half is None else math.hypot(half / abs(torque.mean), total.half_width)
    widths = total.widths | ({} if half is None else {STATISTICS: half / abs(torque.mean)})
    largest = max(widths, key=lambda name: widths[name], default=None)
    return {
        "corrected_torque": {"mean": mean, "half_width": None if share is None else share * abs(mean)},
        "total_error": share,
        "largest_part": None if largest is None else {"name": largest, "half_width": widths[largest]},
    }


def extrapolated(ladder: Ladder, settings: Mapping[str, float]) -> dict[str, str]:
    """Return the knobs whose settings lie far beyond the rungs, with how far."""
    found = {}
    measured = as_measured(settings, ladder)
    for knob in applying(settings):
        rungs = ladder.knob(knob.name)
        sizes = [] if rungs is None else [one.step_size for one in rungs.rungs if one.value]
        if not sizes:
            continue
        h = knob.step_size(measured[knob.name])
        if h > FAR * max(sizes):
            found[knob.name] = f"{h / max(sizes):.2g} times as coarse as the coarsest that was measured"
        elif 0.0 < h < min(sizes) / FAR:
            found[knob.name] = f"{min(sizes) / h:.2g} times as fine as the finest that was measured"
    return found


def _unknown(why: str) -> dict[str, Any]:
    return {"discretisation_error": None, "discretisation_error_note": why}
