"""Verdict on a run: precision of the torque, closure of the balances, missing physics."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from emclutch.results import OutputError, Result
from emclutch.results.columns import TIME, TORQUE_DISC
from emclutch.results.missing_pictures import pictures_are_missing
from emclutch.results.report.markdown import closing_lines, soft_grains
from emclutch.results.time_unit import time_in_words
from emclutch.results.torque_in_words import torque_in_words

CLOSES = 0.01
"""A balance that is off by less, of the torque or of the energy that goes through, says nothing of the results: the
statistical errors are larger."""


ROUGH = 0.1
"""A torque whose 95 % interval reaches further than this share of it is known roughly only."""


class Mark(Enum):
    """Rating of a statement."""

    GOOD = "good"
    POOR = "poor"
    NOTE = "note"


@dataclass(frozen=True, slots=True)
class Statement:
    """One line of a verdict."""

    mark: Mark
    text: str


def verdict(result: Result) -> list[Statement]:
    """The statements on a run, finished or not; the torque first."""
    summary = result.summary
    found = list(_of_the_end(result, summary))
    failed = not summary and result.folder.read_failure() is not None
    if TORQUE_DISC in result.history:
        place = len(found) if failed else 0  # that it failed comes before the torque until then
        found[place:place] = _of_the_torque(result, summary)
    found += _of_the_balances(result, summary)
    found += [Statement(Mark.POOR, text) for text in _warnings(summary)]
    return found + list(_of_what_is_missing(result, summary))


def _of_the_torque(result: Result, summary: dict[str, Any]) -> Iterator[Statement]:
    torque = result.torque
    half = torque.half_width()
    words = torque_in_words(torque)
    if not torque.converged:
        yield Statement(Mark.POOR, f"The torque on the disc is not known: {words}; {torque.reason}.")
    elif half is None or not torque.mean:
        yield Statement(Mark.POOR, f"The torque on the disc is not known: {words}.")
    else:
        share, short = half / abs(torque.mean), bool(summary.get("until")) and not summary["until"]["reached"]
        packings = f"of {torque.replicas} packings" if torque.replicas > 1 else "of one packing"
        yield Statement(
            Mark.POOR if short or share >= 1.0 else Mark.NOTE if share > ROUGH else Mark.GOOD,
            f"The torque on the disc is known to {100.0 * share:.2g} %: {words}, {packings}; {torque.reason}.",
        )
    if torque.replicas == 1:
        yield Statement(Mark.POOR, "One packing ran: what packings differ by is not in the error.")
    until = summary.get("until")
    if until and not until["reached"]:
        reason = f": {until['reason']}" if until["reason"] != torque.reason else ""
        yield Statement(Mark.POOR, f"The target precision is not reached ({until['asked']}){reason}.")
    elif until:
        yield Statement(Mark.GOOD, f"The target precision is reached ({until['asked']}).")


def _of_the_end(result: Result, summary: dict[str, Any]) -> Iterator[Statement]:
    if not summary and (failed := result.folder.read_failure()) is not None:
        text = failed.in_words()
        yield Statement(Mark.POOR, f"{text[:1].upper()}{text[1:]}.")
    elif not summary:
        reached = time_in_words(float(result.history[TIME].iloc[-1]))
        how = f"go on with: emclutch run {result.folder.path} --resume"
        yield Statement(Mark.POOR, f"The run is not finished: it has come to {reached}; {how}")
    elif "lock_up_time" in summary:
        yield Statement(Mark.NOTE, f"{closing_lines(result)[0].capitalize()}.")


def _of_the_balances(result: Result, summary: dict[str, Any]) -> Iterator[Statement]:
    history = result.history
    if summary and TORQUE_DISC in history:
        scale = float(np.sqrt((history[TORQUE_DISC] ** 2).mean()))
        yield _closes("torques", summary["torque_residual_rms"] / scale if scale else None, "of the torque")
    if summary:
        yield _closes("energies", summary["energy_residual_relative"], "of the energy that goes through")


def _closes(what: str, share: float | None, of: str) -> Statement:
    if share is None:
        return Statement(Mark.NOTE, f"The balance of {what} has nothing to compare with: nothing moves or resists.")
    size = f"{100.0 * abs(share):.1g} % {of}"
    if abs(share) < CLOSES:
        return Statement(Mark.GOOD, f"The balance of {what} closes to {size}.")
    return Statement(Mark.POOR, f"The balance of {what} does not close: it is off by {size}.")


def _warnings(summary: dict[str, Any]) -> Iterator[str]:
    if summary and (soft := soft_grains(summary)):
        yield f"{soft[:1].upper()}{soft[1:]}."
    for part in ("solver", "moments"):
        for text in (summary.get(part) or {}).get("warnings", ()):
            yield f"{text[:1].upper()}{text[1:]}."


def _of_what_is_missing(result: Result, summary: dict[str, Any]) -> Iterator[Statement]:
    if note := summary.get("grain_size_note"):
        yield Statement(Mark.NOTE, f"{note[:1].upper()}{note[1:]}.")
    if errors := summary.get("field_error_estimate"):
        worst = max(errors, key=lambda name: abs(errors[name]))
        yield Statement(
            Mark.NOTE, f"The field's discretisation is off by some {100.0 * errors[worst]:.2g} % ({worst}; estimated)."
        )
    if summary and summary.get("discretisation_error") is None:
        yield Statement(
            Mark.NOTE,
            "What the time step of the grains and the mesh do to the torque was not measured; emclutch accuracy does.",
        )
    if pictures_are_missing(result.folder):
        yield Statement(Mark.POOR, f"Its pictures are missing; draw them with: emclutch plot {result.folder.path}")


def effects_of(result: Result) -> list[str]:
    """Names of the effects that a run has, by its summary; of one without, by its scene."""
    summary = result.summary
    if "effects" in summary:
        return list(summary["effects"])
    try:
        return list(tomllib.loads(result.folder.read_case()).get("effects", {}))
    except OutputError:  # a folder that lost its scene has a history all the same
        return []
