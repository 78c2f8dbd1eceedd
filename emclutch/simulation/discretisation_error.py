"""Discretisation error of a run: that of its settings by the accuracy study of its device.

A device is studied once (`emclutch accuracy`), and its study is found by the hash of what matters of the scene; each
run evaluates it at its own settings. Nothing is measured here: without a study the error is not known, and the summary
says which command measures it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results import OutputError
from emclutch.results.accuracy_studies import SHIPPED, device_hash, find_accuracy_study
from emclutch.results.accuracy_study import AccuracyStudy, Total
from emclutch.results.recommended import STATISTICS, LimitingError, budget_option, recommended
from emclutch.results.statistics import Estimate
from emclutch.results.text import format_duration, format_percent, in_words
from emclutch.scene.case import Case
from emclutch.scene.flat import flat_scene, keys_at_default
from emclutch.scene.input_files import file_contents
from emclutch.scene.replica_count import cores_at_hand
from emclutch.settings import settings_of
from emclutch.settings.powder import COUNT
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.simulation.plan import Plan
from emclutch.simulation.recommended_case import cheapest_case, other_drive, whole_ring
from emclutch.simulation.scaled_slip import strain_rate
from emclutch.simulation.setting_values import applying, as_measured, setting_values, total_at

if TYPE_CHECKING:
    from emclutch.device_model.device import Device

log = logging.getLogger(__name__)
SAME_SPEED = 1.2
"""Ratio of two measured speeds up to which they are one machine's."""
TARGETS = (0.10, 0.05, 0.03)
"""Total errors that settings are usually wanted for."""
EXTRAPOLATION_FACTOR = 2.0
"""Factor of step size beyond the measured values from which on the law is called extrapolated."""

ROUNDING = 1.01
"""Tolerance of a target, since values and windows are rounded."""


def device_of(case: Case) -> str:
    """Return the hash by which the study of a device is found: of all but numerical settings, seed, drive and output.

    Speeds count also where an inertial number takes their place: at them the real powder has its own, where the error
    of another one begins. A file counts with its content.
    """
    scene, flat = case.scene, flat_scene(case.toml())
    flat |= file_contents(scene)
    numerical = {key for one in settings_of(scene) for key in one.keys(scene)}
    if scene.grains.count is not None and COUNT in numerical:
        volume = scene.grains.count * scene.grains.grain_volume / (scene.grains.sector or 2.0 * math.pi)
        flat["particles.volume"] = f"{volume:.2g}"  # counts are whole numbers, and follow from the size of the grains
    return device_hash(flat, numerical, frozenset(keys_at_default(scene)))


def accuracy_study_of_device(case: Case) -> tuple[AccuracyStudy, Path] | None:
    """Return the study of a case's device, with the times of this machine, and its file; None where there is none.

    OutputError for a damaged file.
    """
    found = find_accuracy_study(device_of(case))
    if found is None:
        return None
    study, path = found
    ratio = slowness() / study.machine.get("slowness", slowness())
    return (study if 1.0 / SAME_SPEED < ratio < SAME_SPEED else study.on_another_machine(ratio)), path


def has_accuracy_study(case: Case) -> bool:
    """Return whether the errors of the settings of a case's device were measured."""
    try:
        return accuracy_study_of_device(case) is not None
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
        is too large; `parts` by setting, with its value; `unknown` settings and `extrapolated` ones with the reason;
        the `accuracy_study`; `best_estimate` [N m] and `total_error`, relative: statistics and discretisation in
        quadrature.
        None, with `discretisation_error_note`, where it is not known.
    """
    if torque is None or not torque.mean:
        return _unknown("the run has no steady torque on the disc, to which accuracy studies refer")
    try:
        return _by_study(case, plan, torque, device)
    except OutputError as error:
        return _unknown(str(error))
    except Exception as error:  # a run that has come to its end does not fail of what is said about it
        log.exception("the discretisation error is unknown")
        return _unknown(f"defect of the program, please report it: {type(error).__name__}: {error}")


def is_reached(asked: float, torque: Estimate | None, error: dict[str, Any] | None) -> bool:
    """Return whether a total error is reached: by a steady torque, with the errors of all settings known.

    `asked` is relative; `error` is the `discretisation_error` of a summary.
    """
    if torque is None or not torque.converged or error is None or error["unknown"] or error["total_error"] is None:
        return False
    return error["total_error"] <= asked * ROUNDING


def _by_study(case: Case, plan: Plan, torque: Estimate, device: Device | None) -> dict[str, Any]:
    found = accuracy_study_of_device(case)
    if found is None:
        how = f"{how_to_find(case)}, in up to {format_duration(case.scene.accuracy.budget)}"
        return _unknown(f"no accuracy study of this device yet; run it with: {how}")
    study, path = found
    rate = 0.0 if device is None else strain_rate(plan.scene, device)
    strain = None if torque.start is None else torque.start * rate
    values = setting_values(case, plan, strain)
    total = total_at(study, values, plan)
    flat = flat_scene(case.toml())
    entry = total.as_dict()
    for setting in entry["parts"]:
        entry["parts"][setting]["value"] = values[setting]
    entry["extrapolated"] = extrapolated(study, values)
    entry["accuracy_study"] = {
        "file": str(path),
        "device": study.device,
        "case": study.case,
        "date": study.machine.get("date"),
        "drive": study.drive,
        "note": other_drive(study, flat),
    }
    entry |= corrected(torque, total)
    entry["next"] = _next(case, study, entry["total_error"])
    return {"discretisation_error": entry}


def _next(case: Case, study: AccuracyStudy, total: float | None) -> str | None:
    """Return what the next of the usual targets takes, by the study; None: it is reached, or the error unknown."""
    target = next((one for one in TARGETS if total is not None and one < total), None)
    if target is None:
        return None
    found, share = whole_ring(case, study) or recommended(study, target), format_percent(target)
    if isinstance(found, LimitingError):
        budget = found.budget(cores_at_hand())
        command = "" if budget is None else f": {how_to_find(case)} --budget {budget_option(budget)}"
        return f"± {share} is not reached. {found.in_words(cores_at_hand())}{command}"
    cost = f"{found.replicas} replicas, {found.cost_in_words(cores_at_hand())}"
    return f"± {share} takes about {cost}, with the settings of: {how_to_find(case)} --for '{share}'"


def accuracy_in_words(case: Case, plan: Plan) -> str:
    """Return what is known of a case's accuracy before it is run, and what its target costs."""
    target, budget = case.scene.accuracy.target, format_duration(case.scene.accuracy.budget)
    try:
        found = accuracy_study_of_device(case)
    except OutputError as error:
        return str(error)
    if found is None and target is None:
        return f"error of the numerical settings not measured. To measure it: {how_to_find(case)}"
    if found is None:
        return (
            f"{target}: no accuracy study of this device yet. The run begins with one, of up to {budget} "
            "(accuracy.budget), which also gives the cost of the run"
        )
    study, path = found
    if target is not None:
        answer = cheapest_case(case, study, target)
        words = answer.in_words() if isinstance(answer, LimitingError) else answer[0].in_words()
        return f"{target}: {words}"
    total = total_at(study, setting_values(case, plan), plan)
    half = format_percent(total.half_width)
    text = f"numerical settings leave an error of ± {half} (95 %) in the torque of a run. "
    text += "The scatter of replicas adds to it"
    if total.largest is not None:
        width = format_percent(total.widths[total.largest])
        text += f". Largest remaining error: {in_words(total.largest)}, ± {width}"
    text += "".join(f". Not included: {in_words(name)} ({why})" for name, why in total.unknown.items())
    return text if path.parent == SHIPPED else f"{text}. Accuracy study: {_shown(path)}"


def _shown(path: Path) -> str:
    """Return where a study lies: short, as lines of `check` are."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def how_to_find(case: Case) -> str:
    """Return the command that runs the accuracy study of a case, in its usual time."""
    return f"emclutch accuracy {case.path or 'CASE'}"


def corrected(torque: Estimate, total: Total) -> dict[str, Any]:
    """Return a torque without its bias [N m], with half its 95 % interval, and that relative to it; None: unknown."""
    assert torque.mean is not None
    mean, half = torque.mean / (1.0 + total.bias), torque.half_width()
    share = None if half is None else math.hypot(half / abs(torque.mean), total.half_width)
    widths = total.widths | ({} if half is None else {STATISTICS: half / abs(torque.mean)})
    largest = max(widths, key=lambda name: widths[name], default=None)
    return {
        "best_estimate": {"mean": mean, "half_width": None if share is None else share * abs(mean)},
        "total_error": share,
        "largest_part": None if largest is None else {"name": largest, "half_width": widths[largest]},
    }


def extrapolated(study: AccuracyStudy, values: Mapping[str, float]) -> dict[str, str]:
    """Return the settings whose values lie far beyond those that were measured, with how far."""
    found = {}
    measured = as_measured(values, study)
    for setting in applying(values):
        measured_setting = study.setting(setting.name)
        sizes = [] if measured_setting is None else [one.step_size for one in measured_setting.values if one.result]
        if not sizes:
            continue
        h = setting.step_size(measured[setting.name])
        if h > EXTRAPOLATION_FACTOR * max(sizes):
            found[setting.name] = f"{h / max(sizes):.2g} times as coarse as the coarsest that was measured"
        elif 0.0 < h < min(sizes) / EXTRAPOLATION_FACTOR:
            found[setting.name] = f"{min(sizes) / h:.2g} times as fine as the finest that was measured"
    return found


def _unknown(why: str) -> dict[str, Any]:
    return {"discretisation_error": None, "discretisation_error_note": why}
