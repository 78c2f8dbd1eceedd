"""Statements on a run: the number to quote, what it leaves out, raw value, next step, balances, warnings.

`emclutch run` prints them; they stand in ``summary.json``, at the head of the pages and in `emclutch.Result.verdict`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.changing_drive import STEADY, changing_drive
from emclutch.results.columns import (
    CURRENT,
    DISC_SPEED,
    ROTOR_SPEED,
    SHEAR_STRESS,
    TIME,
    TORQUE_DISC,
    TORQUE_HOUSING,
    TORQUE_ROTOR,
)
from emclutch.results.current_ramp import in_words as ramp_in_words
from emclutch.results.quantity import RPM
from emclutch.results.recommended import STATISTICS
from emclutch.results.replicated_mean import (
    Steadiness,
    drifts_significantly,
    may_be_zero,
    more_replicas_suffice,
    steadiness,
)
from emclutch.results.report.report import Mark, Statement, note, sentence, warning
from emclutch.results.rise_time import in_words as rise_in_words
from emclutch.results.statistics import REPLICAS, Estimate
from emclutch.results.text import format_duration, format_estimate, format_percent, format_range, format_time, in_words
from particles.dem.overlap_limits import SOFT

if TYPE_CHECKING:
    from emclutch.results.result import Result

CLOSES = 0.01
"""A balance that is off by less, of the largest torque or of the energy converted, says nothing of the results: the
statistical errors are larger."""
MAX_REPLICAS = 64
"""Of accuracy.replicas and accuracy.max_replicas."""
ROUGH = 0.1
"""A torque whose 95 % interval reaches further than this fraction of it is known roughly only."""


def verdict(result: Result) -> list[Statement]:
    """Return the statements on a run, finished or not; the number to quote first, unless the run failed."""
    summary = result.summary
    found = [*_not_finished(result), *_transient(result), *_torque(result), *_stress(result), *_requested(result),
             *_ended(summary), *_next(result), *_balances(result), *_warnings(result), *_remarks(summary)]  # fmt: skip
    return [replace(one, text=sentence(one.text)) for one in found]


def measured_name(result: Result) -> str:
    """Return what a run measures: the torque on the disc, or the shear stress of a box."""
    return "shear stress" if SHEAR_STRESS in result.history else "torque on the disc"


def current_is_steady(result: Result) -> bool:
    """Return whether the current is the same, to 1 %, in all windows that the torque is the mean of."""
    if CURRENT not in result.history or result.steady is None or result.steady.start is None:
        return True
    averaged = result.history[CURRENT][result.history[TIME] >= result.steady.start]
    return bool(np.ptp(averaged) <= STEADY * averaged.abs().max())


def _not_finished(result: Result) -> Iterator[Statement]:
    """Say why a run has no summary."""
    if result.summary:
        return
    if (failed := result.folder.read_failure()) is not None:
        yield Statement(Mark.UNUSABLE, failed.in_words())
        return
    reached = format_time(float(result.history[TIME].iloc[-1]))
    yield Statement(Mark.UNUSABLE, f"the run is not finished: it has reached {reached}")
    yield note(f"continue with: emclutch run {result.folder.path} --resume")


def _transient(result: Result) -> Iterator[Statement]:
    """Say the times of a transient: rise of current and torque, lock-up; and torque against a ramp of current."""
    summary = result.summary
    good = Mark.WARNING if result.folder.read_plan().get("omitted_effects") else Mark.GOOD
    if "lock_up_time" in summary:
        history, time = result.history, summary["lock_up_time"]
        rotor, disc = (abs(float(history[name].iloc[-1])) * RPM for name in (ROTOR_SPEED, DISC_SPEED))
        if time is not None:
            yield Statement(good, f"the output locks at {format_time(time)} and turns at {disc:.4g} rpm at the end")
        else:
            yield note(f"the output is not locked at the end: it turns at {disc:.4g} rpm, the motor at {rotor:.4g} rpm")
    lines = rise_in_words(summary)
    known = Mark.UNUSABLE if summary.get("current_rise_time") is None else good
    first = Mark.NOTE if "lock_up_time" in summary else known
    yield from (Statement(Mark.NOTE if number else first, line) for number, line in enumerate(lines))
    if ramp := summary.get("torque_against_current"):
        yield from map(note, ramp_in_words(ramp))


def _torque(result: Result) -> Iterator[Statement]:
    """Say the torque with its error, what it leaves out, raw value and correction, and the parts of the error."""
    summary = result.summary
    if TORQUE_DISC not in result.history or "torque_against_current" in summary or SHEAR_STRESS in result.history:
        return
    raw, best = result.torque, result.best
    quoted = best if raw.is_steady else raw
    yield from _headline(result, "torque on the disc", quoted, _operating_point(result))
    if not raw.is_steady or not raw.mean:
        return
    if range_ := summary.get("expected_torque_unknown_powder"):
        between = format_range(range_["low"], range_["high"])
        how = "(90 % range, by the law of the powder); emclutch powder finds the friction"
        yield note(f"if friction and fill of the powder were unknown: {between} N m {how}")
    else:
        yield note("friction and fill of the powder are taken as given; their uncertainty is not in the error bar")
    error = summary.get("discretisation_error")
    if error is None and summary:
        reason = summary.get("discretisation_error_note", "it is not measured")
        yield note(f"the error of the numerical settings is not in the error bar: {reason}")
    if best != raw:
        what = "numerical settings" if error else "coarse grains"
        excess = 100.0 * (raw.mean / (best.mean or raw.mean) - 1.0)
        how = f"{'add' if excess > 0.0 else 'take off'} {abs(excess):.2g} %, corrected above"
        yield note(f"raw torque: {format_estimate(raw)}, {_replicas(raw)}; {what} {how}")
    else:
        yield note(_averaged(raw))
    if error:
        yield from _error(summary, error)


def _headline(result: Result, name: str, found: Estimate, at: str) -> Iterator[Statement]:
    """Say the number to quote, or why there is none, and what helps."""
    until, target = result.summary.get("until"), result.summary.get("accuracy_target")
    if not found.is_steady and (changing := changing_drive(result.history, found.start)):
        yield note(f"no steady {name}: {changing}")
        return
    if found.mean is None or not found.is_steady:
        value = "" if found.mean is None else f", mean so far {found.mean:.3g} {_unit(name)}"
        yield Statement(Mark.UNUSABLE, f"{name} not known{value}: {found.reason}")
        if found.remedy and next(_next(result), None) is None and not rise_in_words(result.summary):
            yield note(f"to mend it: {found.remedy}")
        return
    half = found.half_width()
    fraction = math.inf if half is None or not found.mean else half / abs(found.mean)
    missed = [one for one in (until, target) if one is not None and not one["reached"]]
    rough = fraction > ROUGH or bool(missed) or not found.converged
    mark = Mark.UNUSABLE if fraction >= 1.0 else Mark.WARNING if rough else Mark.GOOD
    yield Statement(mark, f"{name}: {format_estimate(found, _unit(name))}{at}")
    if found.steady_alone:
        yield note("one replica: the scatter between replicas is not in the error bar")


def _requested(result: Result) -> Iterator[Statement]:
    """Say whether the precision and the accuracy that were requested are reached."""
    until, target = result.summary.get("until"), result.summary.get("accuracy_target")
    if result.steady is None or not result.steady.is_steady:
        return
    if until is not None and until["reached"]:
        at = format_time(result.summary["time"])
        yield note(f"the statistical error reached time.until = '{until['asked']}' at {at}")
    elif until is not None:
        yield warning(f"the statistical error did not reach time.until = '{until['asked']}': {until['reason']}")
    if target is not None:
        reached = "reached" if target["reached"] else "not reached"
        text = f"the requested accuracy, accuracy.target = {format_percent(target['asked'])}, is {reached}"
        yield note(text) if target["reached"] else warning(text)


def _unit(name: str) -> str:
    return "Pa" if name == "shear stress" else "N m"


def _operating_point(result: Result) -> str:
    """Return current and slip of a torque, after a comma."""
    current = result.summary.get("current") if current_is_steady(result) else None
    slip = result.summary.get("slip")
    parts = [] if current is None else [f"{current:.4g} A"]
    parts += [f"{slip * RPM:.4g} rpm of slip"] if slip else []
    return f", at {' and '.join(parts)}" if parts else ""


def _replicas(found: Estimate) -> str:
    pooled = "" if found.pooled_scatter is None else ", scatter pooled with that of the accuracy study"
    start = "" if found.start is None else f" averaged from {format_time(found.start)}"
    return f"{found.replicas} replica{'s' * (found.replicas > 1)}{start}{pooled}"


def _averaged(found: Estimate) -> str:
    return _replicas(found) if found.steady_alone else f"{_replicas(found)}; {found.reason}"


def _error(summary: dict[str, Any], error: dict[str, Any]) -> Iterator[Statement]:
    """Say the parts of the error of the best estimate, and the errors that were not measured."""
    total, largest = error["total_error"], error["largest_part"]
    text = f"error: settings {format_percent(error['half_width'])}"
    if total is not None:
        statistical = math.sqrt(max(total**2 - error["half_width"] ** 2, 0.0))
        text += f", replicas {format_percent(statistical)}"
    if largest is not None:
        text += f"; dominant: {in_words(largest['name'])}, {format_percent(largest['half_width'])}"
    yield note(text)
    if error["unknown"]:
        names = ", ".join(map(in_words, error["unknown"]))
        yield warning(f"not measured, and not in the error bar: the error of {names}")
    for name, why in error["extrapolated"].items():
        yield warning(f"the error of {in_words(name)} is extrapolated: the value is {why}")
    if text := error["accuracy_study"]["note"]:
        yield note(text)


def _stress(result: Result) -> Iterator[Statement]:
    """Say the stress of a sheared box with its error."""
    if SHEAR_STRESS not in result.history:
        return
    yield from _headline(result, "shear stress", result.stress, "")
    if result.stress.is_steady:
        friction = (result.summary.get("effective_friction") or {}).get("mean")
        ratio = "" if friction is None else f"effective friction {friction:.3g}; "
        yield note(f"{ratio}{_averaged(result.stress)}")


def _ended(summary: dict[str, Any]) -> Iterator[Statement]:
    """Say who ended a run early, and the torque on the shaft."""
    if "stopped" in summary:
        yield note(f"stopped {summary['stopped']}")
    if (total := summary.get("torque_with_drag")) is not None:
        drag = abs(summary["drag_torque"])
        yield note(f"torque on the disc's shaft: {total:.4g} N m, with {drag:.3g} N m of drag (motion.drag_torque)")


def _next(result: Result) -> Iterator[Statement]:
    """Say what reaches the target, or the usual one, and what that takes."""
    summary = result.summary
    found, spent = (result.steady, _spent(summary.get("seconds") or {})) if summary else (None, 0.0)
    if found is None or not spent or "torque_against_current" in summary or "lock_up_time" in summary:
        return
    if changing_drive(result.history, found.start):
        return
    until, asked = summary.get("until") or {}, summary.get("accuracy_target") or {}
    settings = summary.get("discretisation_error") or {}
    largest, own = (settings.get("largest_part") or {}).get("name"), settings.get("half_width") or 0.0
    if asked.get("reached") or (until.get("reached") and not asked):
        return
    wanted, end = result.conditions.wanted(found.mean or 0.0), float(summary.get("time") or 0.0)
    if not end or (may_be_zero(found) and not result.conditions.negligible):
        return
    if found.converged and found.replicas > 1 and largest not in (None, STATISTICS):
        if settings.get("next"):
            yield note(f"next: {settings['next']}")
    elif found.steady_alone and until.get("end") is None:
        cost = format_duration(REPLICAS * spent)
        yield note(
            f"next: accuracy.replicas = {REPLICAS} measures the scatter between replicas: {cost} of processor time"
        )
    elif found.replicas == 1 or _runs_longer(found, wanted, until, end):
        later = until.get("end") or (0.0 if found.missing else 2.0 * end)
        yield _longer(result, max(later, end + (found.missing or 0.0)), end, spent)
    else:
        target = asked.get("asked") or 0.0
        yield _more_replicas(result, found, wanted, (target, own) if target > own else None, spent)


def _runs_longer(found: Estimate, wanted: float, until: dict[str, Any], end: float) -> bool:
    """True where more replicas do not help, as after a start-up that is not over or in a drift, or cost more."""
    if found.missing or steadiness(found, wanted) is Steadiness.DRIFTING or drifts_significantly(found, wanted):
        return True
    replicas, later = until.get("replicas"), until.get("end")
    if replicas is not None:
        return later is not None and later / end < replicas / found.replicas
    return later is not None or found.starts_up or found.half_width() is None


def _more_replicas(
    result: Result, found: Estimate, wanted: float, asked: tuple[float, float] | None, spent: float
) -> Statement:
    """Say how many replicas reach `wanted`, or of what is `asked` what the settings' error leaves, or half the error.

    `asked` holds the requested relative error and that of the settings, the smaller one.
    """
    until, half = result.summary.get("until") or {}, found.half_width()
    assert half is not None and found.mean
    fraction = wanted / abs(found.mean)
    if asked is not None:
        fraction, wanted = asked[0], abs(found.mean) * math.sqrt(asked[0] ** 2 - asked[1] ** 2)
    elif half <= wanted and found.converged:
        fraction, wanted = 0.5 * half / abs(found.mean), 0.5 * half
    judged = replace(found, exclude_drift=False) if found.converged else found  # a drift is excluded already
    counts = range(found.replicas + 1, MAX_REPLICAS + 1)
    count = until.get("replicas") or next((one for one in counts if more_replicas_suffice(judged, one, wanted)), 0)
    if not count:
        return note(
            f"next: ± {format_percent(fraction)} needs more than {MAX_REPLICAS} replicas; run longer, or ask for less"
        )
    given = "replicas" in result.folder.read_scene().get("accuracy", {})
    key = "accuracy.max_replicas" if until and not given else "accuracy.replicas"
    cost = format_duration(spent * count / found.replicas)
    return note(f"next: ± {format_percent(fraction)} takes {key} = {count}, {cost} of processor time")


def _longer(result: Result, until: float, end: float, spent: float) -> Statement:
    how = f"emclutch run {result.folder.path} --resume --set time.end='{1e3 * until:.4g} ms'"
    cost = format_duration(spent * (until / end - 1.0))
    return note(f"next: run to {format_time(until)}, another {cost} of processor time: {how}")


def _spent(seconds: dict[str, Any]) -> float:
    """Return the processor time [s] of all replicas, of all parts of a resumed run; without that of compiling."""
    windows = sum(seconds.get(part, 0.0) for part in ("field", "magnetic", "contact"))
    whole = max(seconds.get("whole_run", 0.0), seconds.get("total", 0.0))
    return max(windows, seconds.get("processor", whole) - seconds.get("compiling", 0.0))


def _balances(result: Result) -> Iterator[Statement]:
    """Say whether the balances of torques and energies close, and whether the solver of contacts converged."""
    history, summary = result.history, result.summary
    if not summary:
        return
    found: list[tuple[str, float | None, str]] = []
    if TORQUE_DISC in history:
        names = [name for name in (TORQUE_DISC, TORQUE_ROTOR, TORQUE_HOUSING) if name in history]
        scale = float(np.sqrt((history[names] ** 2).mean()).max())
        residual = summary["torque_residual_rms"] / scale if scale else None
        found.append(("torque", residual, "of the largest torque"))
    found.append(("energy", summary["energy_residual_relative"], "of the energy converted"))
    closed = [f"{what} to {100.0 * abs(r):.1g} % {of}" for what, r, of in found if r is not None and abs(r) < CLOSES]
    if closed:
        yield Statement(Mark.GOOD, f"balances close: {' and '.join(closed)}")
    for what, residual, of in found:
        if residual is not None and abs(residual) >= CLOSES:
            size = f"{100.0 * abs(residual):.1g} % {of}"
            yield Statement(Mark.UNUSABLE, f"the balance of {what} does not close: it is off by {size}")
        elif residual is None:
            yield note(f"the balance of {what} has nothing to compare with: nothing moves or resists")
    solver = summary.get("solver")
    if solver and not solver.get("warnings"):
        stiffness = (summary.get("contact") or {}).get("stiffness")
        grains = "rigid grains" if stiffness is None else f"grains on springs of {stiffness:.3g} N/m"
        missed = (
            f"{100.0 * solver['missed_share']:.2g} % of the steps missed the tolerance of {solver['tolerance']:.2g} m/s"
        )
        yield Statement(Mark.GOOD, f"contacts (DVI, {grains}) converged: {missed}")


def omitted_in_words(effect: str, criterion: str) -> str:
    """Return the warning that an effect is left out, though by its criterion it may be relevant."""
    return f"omitted effect that may be relevant: {in_words(effect)}. {sentence(criterion)}"


def soft_grains(summary: dict[str, Any]) -> str:
    """Return a warning where grains that are compressed overlapped too much; else empty."""
    overlap = summary.get("max_overlap") or 0.0
    compliant = (summary.get("contact") or {}).get("compliant", "solver" not in summary)
    if overlap <= SOFT or not compliant:
        return ""
    return f"the largest overlap is {100 * overlap:.2g} % of the diameter: grains too soft; peak torques are unreliable"


def _warnings(result: Result) -> Iterator[Statement]:
    """Say what makes the numbers doubtful, and which effects are left out although they may matter."""
    summary = result.summary
    parts = "grain_size", "scaled_speed", "solver", "moments", "coil_heat", "steel", "energy_made", "scene"
    texts = [soft_grains(summary), *(text for part in parts for text in (summary.get(part) or {}).get("warnings", []))]
    yield from (warning(text) for text in texts if text)
    scatter = result.conditions.replica_scatter
    if (found := result.steady) is not None and found.known and found.pooled_scatter is None and scatter:
        yield note(
            f"accuracy.replica_scatter ({format_percent(scatter)}) is not used: these replicas scatter significantly "
            "more, or the run is shorter than time.end"
        )
    for effect, number in result.folder.read_plan().get("omitted_effects", {}).items():
        yield warning(omitted_in_words(effect, number))
    if result.folder.lacks_pictures():
        yield warning(f"its pictures are missing; draw them with: emclutch plot {result.folder.path}")


def _remarks(summary: dict[str, Any]) -> Iterator[Statement]:
    """Say how the run differs from the device, the load of the pole faces, and the error of the mesh."""
    for part in ("grain_size", "scaled_speed"):
        if part in summary:
            yield note(summary[part]["note"])
    for body, load in ((summary.get("wall_pressure") or {}).get("poles") or {}).items():
        ratio = "" if load["mu"] is None else f", tau/P {load['mu']:.2f}"
        pull = f"{1e-3 * load['magnetic_pull']:.3g} kPa of it magnetic pull"
        yield note(f"pressure on the poles of the {body}: {1e-3 * load['pressure']:.3g} kPa ({pull}){ratio}")
    if errors := summary.get("field_error_estimate"):
        worst = max(errors, key=lambda name: abs(errors[name]))
        yield note(f"estimated error of the field mesh: {100.0 * abs(errors[worst]):.2g} % ({worst})")
