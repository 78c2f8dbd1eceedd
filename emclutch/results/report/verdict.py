"""Verdict on a run: torque with its interval, error budget, what to do next and what it costs, balances, warnings.

The same statements stand at the end of `emclutch run`, in ``summary.json``, in the pages and in `emclutch.Result`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from emclutch.results import Estimate, Result
from emclutch.results.changing_drive import changing_drive
from emclutch.results.columns import (
    DISC_SPEED,
    ROTOR_SPEED,
    SHEAR_STRESS,
    TIME,
    TORQUE_DISC,
    TORQUE_HOUSING,
    TORQUE_ROTOR,
)
from emclutch.results.current_ramp import in_words as in_words_of_ramp
from emclutch.results.recommended import STATISTICS
from emclutch.results.replicated_mean import (
    Steadiness,
    drifts_significantly,
    may_be_zero,
    more_replicas_suffice,
    steadiness,
)
from emclutch.results.rise_time import in_words as in_words_of_rise
from emclutch.results.statistics import ONE_REPLICA, REPLICAS
from emclutch.results.text import format_duration, format_percent, format_stress, format_time, format_torque
from particles.dem.overlap_limits import SOFT

RPM = 30.0 / math.pi
CLOSES = 0.01
"""A balance that is off by less, of the largest torque or of the energy supplied, exchanged and dissipated, says
nothing of the results: the statistical errors are larger."""

MAX_REPLICAS = 64
"""Of accuracy.replicas and accuracy.max_replicas."""

ROUGH = 0.1
"""A torque whose 95 % interval reaches further than this fraction of it is known roughly only."""


class Mark(Enum):
    """Rating of a statement."""

    GOOD = "good"
    POOR = "poor"
    NOTE = "note"

    @property
    def sign(self) -> str:
        """The mark as one letter."""
        return {"good": "✓", "poor": "✗", "note": "–"}[self.value]


@dataclass(frozen=True, slots=True)
class Statement:
    """One line of a verdict."""

    mark: Mark
    text: str


def verdict(result: Result) -> list[Statement]:
    """Return the statements on a run, finished or not; the torque first, unless the run failed."""
    summary, torque, end = result.summary, list(_measured(result)), list(_end(result))
    failed = not summary and result.folder.read_failure() is not None
    begin = [*end, *torque] if failed else [*torque, *end]
    found = [*begin, *_total_error(summary), *_target(summary), *_next(result), *_balances(result),
             *_warnings(summary), *_left_out(result), *_gaps(result)]  # fmt: skip
    return [Statement(one.mark, sentence(one.text)) for one in found]


def closing_lines(result: Result) -> list[str]:
    """Return the verdict as lines of text, each after its mark."""
    return [f"{one.mark.sign} {one.text}" for one in verdict(result)]


def soft_grains(summary: dict[str, Any]) -> str:
    """Return a warning where grains that press in overlapped too much; else empty."""
    overlap = summary.get("max_overlap") or 0.0
    compliant = (summary.get("contact") or {}).get("compliant", "solver" not in summary)
    if overlap <= SOFT or not compliant:
        return ""
    return (
        f"the largest overlap is {100 * overlap:.2g} % of the diameter: grains too soft; torque peaks are not to be "
        "trusted"
    )


def sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def _measured(result: Result) -> Iterator[Statement]:
    """Say how well torque or stress is known."""
    yield from (Statement(Mark.NOTE, line) for line in in_words_of_rise(result.summary))
    if ramp := result.summary.get("torque_against_current"):
        yield from (Statement(Mark.NOTE, line) for line in in_words_of_ramp(ramp))
    elif TORQUE_DISC in result.history:
        yield from _best(result)
        yield from _known(result, "torque on the disc", result.torque, format_torque(result.torque))
    elif SHEAR_STRESS in result.history:
        friction = (result.summary.get("effective_friction") or {}).get("mean")
        ratio = "" if friction is None else f", effective friction {friction:.3g}"
        yield from _known(result, "shear stress", result.stress, f"{format_stress(result.stress)}{ratio}")


def _best(result: Result) -> Iterator[Statement]:
    """Say the best estimate with its total error, where the raw torque has a known error of its settings."""
    if (text := best_in_words(result)) is None:
        return
    found, error = result.best, result.summary.get("discretisation_error") or {}
    half, reached = found.half_width(), (result.summary.get("accuracy_target") or {}).get("reached", True)
    if not found.converged or half is None or not reached:
        yield Statement(Mark.POOR, text)
        return
    rough = half > ROUGH * abs(found.mean or 0.0) or error.get("unknown")
    yield Statement(Mark.NOTE if rough else Mark.GOOD, text)


def best_in_words(result: Result) -> str | None:
    """Return the best estimate of a torque with its total error and its correction; None where it is the raw one."""
    raw, best = result.torque, result.best
    if best == raw or not best.mean or not raw.mean:
        return None
    half, bias = best.half_width(), 100.0 * (raw.mean / best.mean - 1.0)
    scope = "in all" if raw.replicas > 1 else "without the scatter between replicas"
    size = "" if half is None else f", ± {format_percent(half / abs(best.mean))} {scope}"
    what = "numerical settings" if result.summary.get("discretisation_error") else "coarse grains"
    return (
        f"best estimate of the torque on the disc: {format_torque(best)}{size}; {what} change the raw torque of "
        f"{raw.mean:.4g} N m by {bias:+.2g} %, which is corrected"
    )


def _known(result: Result, name: str, found: Estimate, words: str) -> Iterator[Statement]:
    name = f"raw {name}" if name.startswith("torque") and best_in_words(result) is not None else name
    half, until = found.half_width(), result.summary.get("until")
    if not found.is_steady and (changing := changing_drive(result.history, found.start)):
        yield Statement(Mark.NOTE, f"The run has no steady {name}: {changing}.")
        return
    if found.steady_alone:
        yield Statement(Mark.POOR, f"The {name} of this replica is {words}; {found.reason}.")
    elif not found.converged:
        yield Statement(Mark.POOR, f"The {name} is not known: {words}; {found.reason}.")
    elif half is None or not found.mean:
        yield Statement(Mark.POOR, f"The {name} is not known: {words}.")
    else:
        share, short = half / abs(found.mean), until is not None and not until["reached"]
        pooled = "" if found.pooled_scatter is None else ", their scatter pooled with that of the accuracy study"
        replicas = f"of {found.replicas} replicas{pooled}"
        yield Statement(
            Mark.POOR if short or share >= 1.0 else Mark.NOTE if share > ROUGH else Mark.GOOD,
            f"The {name} is known to {100.0 * share:.2g} %: {words}, {replicas}; {found.reason}.",
        )
    if known := result.conditions.replica_scatter if found.known and found.pooled_scatter is None else 0.0:
        yield Statement(
            Mark.NOTE,
            f"the scatter of accuracy.replica_scatter ({format_percent(known)}) is not pooled: these replicas scatter "
            "significantly more, or the run is shorter than time.end",
        )
    if found.replicas == 1 and not found.steady_alone:
        yield Statement(Mark.POOR, f"It is of {ONE_REPLICA}; accuracy.replicas = {REPLICAS} includes it.")


def _end(result: Result) -> Iterator[Statement]:
    if result.summary:
        yield from (Statement(Mark.NOTE, line) for line in _end_lines(result))
    elif (failed := result.folder.read_failure()) is not None:
        yield Statement(Mark.POOR, failed.in_words())
    else:
        reached = format_time(float(result.history[TIME].iloc[-1]))
        how = f"continue with: emclutch run {result.folder.path} --resume"
        yield Statement(Mark.POOR, f"The run is not finished: it has come to {reached}; {how}")


def _end_lines(result: Result) -> Iterator[str]:
    """Say what ended a run early, and whether its output is locked."""
    summary = result.summary
    if "stopped" in summary:
        yield f"stopped {summary['stopped']}"
    if (total := summary.get("torque_with_drag")) is not None:
        yield (
            f"the torque on the disc's shaft is {total:.4g} N m, with {abs(summary['drag_torque']):.3g} N m of drag of "
            "seals and bearings (motion.drag_torque, taken as exact)"
        )
    if "lock_up_time" in summary:
        history = result.history
        rotor, disc = (abs(float(history[name].iloc[-1])) * RPM for name in (ROTOR_SPEED, DISC_SPEED))
        if summary["lock_up_time"] is not None:
            yield f"output locked at {summary['lock_up_time']:.4g} s, at {disc:.4g} rpm at the end"
        else:
            yield f"output not locked: {disc:.4g} rpm at the end, the motor {rotor:.4g} rpm"


def _target(summary: dict[str, Any]) -> Iterator[Statement]:
    if not (until := summary.get("until")):
        return
    if until["reached"]:
        yield Statement(Mark.GOOD, f"target precision reached ({until['asked']}) at t = {summary['time']:.4g} s")
    else:
        judged = summary["stress"] if "stress" in summary else summary["torque"]
        reason = f": {until['reason']}" if until["reason"] != judged["reason"] else ""
        yield Statement(Mark.POOR, f"target precision not reached ({until['asked']}){reason}")


def _total_error(summary: dict[str, Any]) -> Iterator[Statement]:
    """Say what the total error of the best estimate consists of, and by what it is limited."""
    if not (summary.get("torque") or {}).get("mean") or "discretisation_error" not in summary:
        return
    found = summary["discretisation_error"]
    if found is None:
        note = summary.get("discretisation_error_note", "not measured")
        yield Statement(Mark.NOTE, f"the interval is statistical only, the error of the settings unknown: {note}")
        return
    total, largest = found["total_error"], found["largest_part"]
    text = f"error budget: settings {format_percent(found['half_width'])}"
    if total is not None:
        statistical = math.sqrt(max(total**2 - found["half_width"] ** 2, 0.0))
        text += f", replicas {format_percent(statistical)}, together {format_percent(total)}"
    if largest is not None:
        text += f"; largest part: {in_words(largest['name'])}, {format_percent(largest['half_width'])}"
    if found["unknown"]:
        text += f"; not included, since not measured: {', '.join(map(in_words, found['unknown']))}"
    text += "".join(f"; extrapolated: {in_words(name)} is {why}" for name, why in found["extrapolated"].items())
    if found["accuracy_study"]["note"]:
        text += f"; {found['accuracy_study']['note']}"
    asked = summary.get("accuracy_target")
    missed = asked is not None and not asked["reached"]
    rough = total is None or total > ROUGH or bool(found["unknown"])
    yield Statement(Mark.POOR if missed else Mark.NOTE if rough else Mark.GOOD, text)
    if asked is not None:
        reached = "reached" if asked["reached"] else "not reached"
        mark = Mark.POOR if missed else Mark.GOOD
        yield Statement(mark, f"the total error of accuracy.target = {format_percent(asked['asked'])} is {reached}")


def _next(result: Result) -> Iterator[Statement]:
    """Say what reaches the target, or the usual one, and what that takes."""
    summary = result.summary
    found, spent = (result.steady, _spent(summary.get("seconds") or {})) if summary else (None, 0.0)
    if found is None or not spent or "torque_against_current" in summary or "lock_up_time" in summary:
        return
    if changing_drive(result.history, found.start):
        return
    until, asked = summary.get("until") or {}, summary.get("accuracy_target") or {}
    if until.get("reached") or asked.get("reached"):
        return
    settings = summary.get("discretisation_error") or {}
    largest, own = (settings.get("largest_part") or {}).get("name"), settings.get("half_width") or 0.0
    wanted, end = result.conditions.wanted(found.mean or 0.0), float(summary.get("time") or 0.0)
    if not end or (may_be_zero(found) and not result.conditions.negligible):
        return
    if found.converged and found.replicas > 1 and largest not in (None, STATISTICS):
        if settings.get("next"):
            how = f"{in_words(largest)} is the largest part of the error; {settings['next']}"
            yield Statement(Mark.NOTE, f"next: {how}")
    elif found.steady_alone and until.get("end") is None:
        how = f"accuracy.replicas = {REPLICAS} measures the scatter between replicas, in about"
        yield Statement(Mark.NOTE, f"next: {how} {format_duration(REPLICAS * spent)} of processor time in all")
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

    `asked` holds the relative error that is asked for and that of the settings, the smaller one.
    """
    until, half = result.summary.get("until") or {}, found.half_width()
    assert half is not None and found.mean
    share = wanted / abs(found.mean)
    if asked is not None:
        share, wanted = asked[0], abs(found.mean) * math.sqrt(asked[0] ** 2 - asked[1] ** 2)
    elif half <= wanted and found.converged:
        share, wanted = 0.5 * half / abs(found.mean), 0.5 * half
    judged = replace(found, exclude_drift=False) if found.converged else found  # a drift is excluded already
    counts = range(found.replicas + 1, MAX_REPLICAS + 1)
    replicas = until.get("replicas") or next((one for one in counts if more_replicas_suffice(judged, one, wanted)), 0)
    if not replicas:
        how = f"is out of reach with {MAX_REPLICAS} replicas; run longer, or ask for less"
        return Statement(Mark.NOTE, f"next: {format_percent(share)} {how}")
    given = "replicas" in result.folder.read_scene().get("accuracy", {})
    key = "accuracy.max_replicas" if until and not given else "accuracy.replicas"
    cost = format_duration(spent * replicas / found.replicas)
    how = f"{format_percent(share)} takes about {replicas} replicas ({key} = {replicas})"
    return Statement(Mark.NOTE, f"next: {how}, {cost} of processor time in all")


def _longer(result: Result, until: float, end: float, spent: float) -> Statement:
    how = f"emclutch run {result.folder.path} --resume --set time.end='{1e3 * until:.4g} ms'"
    cost = format_duration(spent * (until / end - 1.0))
    return Statement(Mark.NOTE, f"next: run to {format_time(until)} ({how}), about {cost} of processor time more")


def _spent(seconds: dict[str, Any]) -> float:
    """Return the processor time [s] of all replicas, of all parts of a resumed run; without that of compiling."""
    windows = sum(seconds.get(part, 0.0) for part in ("field", "magnetic", "contact"))
    whole = max(seconds.get("whole_run", 0.0), seconds.get("total", 0.0))
    return max(windows, seconds.get("processor", whole) - seconds.get("compiling", 0.0))


def in_words(name: str) -> str:
    """Return the name of a numerical setting as words."""
    return name.replace("_", " ")


def _balances(result: Result) -> Iterator[Statement]:
    history, summary = result.history, result.summary
    if not summary:
        return
    if TORQUE_DISC in history:
        names = [name for name in (TORQUE_DISC, TORQUE_ROTOR, TORQUE_HOUSING) if name in history]
        scale = float(np.sqrt((history[names] ** 2).mean()).max())
        yield _balance("torques", summary["torque_residual_rms"] / scale if scale else None, "of the largest torque")
    yield _balance("energies", summary["energy_residual_relative"], "of the energy supplied, exchanged and dissipated")
    solver = summary.get("solver")
    if solver and not solver.get("warnings"):
        stiffness = (summary.get("contact") or {}).get("stiffness")
        grains = "rigid grains" if stiffness is None else f"grains on springs of {stiffness:.3g} N/m"
        share, tolerance = 100.0 * solver["missed_share"], solver["tolerance"]
        missed = f"{share:.2g} % of the steps missed the tolerance of {tolerance:.2g} m/s"
        yield Statement(Mark.GOOD, f"Contact solver (DVI, {grains}) converged: {missed}.")


def _balance(what: str, share: float | None, of: str) -> Statement:
    if share is None:
        return Statement(Mark.NOTE, f"The balance of {what} has nothing to compare with: nothing moves or resists.")
    size = f"{100.0 * abs(share):.1g} % {of}"
    if abs(share) < CLOSES:
        return Statement(Mark.GOOD, f"The balance of {what} closes to {size}.")
    return Statement(Mark.POOR, f"The balance of {what} does not close: it is off by {size}.")


def _warnings(summary: dict[str, Any]) -> Iterator[Statement]:
    parts = "grain_size", "scaled_speed", "solver", "moments", "steel", "energy_made"
    texts = [soft_grains(summary), *(text for part in parts for text in (summary.get(part) or {}).get("warnings", []))]
    yield from (Statement(Mark.POOR, text) for text in texts if text)
    yield from (Statement(Mark.NOTE, text) for text in (summary.get("scene") or {}).get("warnings", []))


def _left_out(result: Result) -> Iterator[Statement]:
    """Name the effects that the scene leaves out although they may matter, as the run's plan found them."""
    for effect, number in result.folder.read_plan().get("omitted_effects", {}).items():
        yield Statement(Mark.POOR, f"left out, although it may matter ({number}): {in_words(effect)}")


def _wall_load(summary: dict[str, Any]) -> str:
    """Return the pressure on the pole faces in words; empty where it was not measured."""
    poles = (summary.get("wall_pressure") or {}).get("poles") or {}
    parts = []
    for body, load in poles.items():
        ratio = "" if load["mu"] is None else f", tau/P {load['mu']:.2f}"
        parts.append(
            f"{1e-3 * load['pressure']:.3g} kPa on the {body} ({1e-3 * load['magnetic_pull']:.3g} kPa of it magnetic "
            f"pull on the nearer half of the gap){ratio}"
        )
    return f"between the poles grains press with {'; '.join(parts)}" if parts else ""


def _gaps(result: Result) -> Iterator[Statement]:
    """Say what the numbers do not hold."""
    summary = result.summary
    if "grain_size" in summary:
        yield Statement(Mark.NOTE, summary["grain_size"]["note"])
    if "scaled_speed" in summary:
        yield Statement(Mark.NOTE, summary["scaled_speed"]["note"])
    if load := _wall_load(summary):
        yield Statement(Mark.NOTE, load)
    if errors := summary.get("field_error_estimate"):
        worst = max(errors, key=lambda name: abs(errors[name]))
        yield Statement(
            Mark.NOTE, f"The estimated error of the field's mesh is {100.0 * abs(errors[worst]):.2g} % ({worst})."
        )
    if result.folder.lacks_pictures():
        yield Statement(Mark.POOR, f"Its pictures are missing; draw them with: emclutch plot {result.folder.path}")
