"""Tables of an accuracy study: rows of accuracy.csv, and the page that is written as Markdown and as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from emclutch.knobs import KNOBS
from emclutch.results.ladder import Basis, KnobError, KnobLadder, Ladder
from emclutch.results.recommended import Choice, Obstacle, own_choice, unknown_of
from emclutch.results.report.content import Block, Page, Picture, Statements, Table
from emclutch.results.report.verdict import Mark, Statement
from emclutch.results.setting_errors import ORDER_SPREAD, SMALL_ERROR
from emclutch.results.text import format_duration, per_cent
from emclutch.scene.replica_count import cores_at_hand

UNITS = {one.name: one.unit for one in KNOBS}
SHORT = {Basis.TORQUE: "torque", Basis.MOMENTS: "squared moments", Basis.LATER: "torque, later"}
MACHINE = ("date", "processor", "cores", "jobs")
"""Of a ladder's machine, what stands at the head of the page."""
SMALLEST_PART = 0.1
"""Of the half width: smaller parts are not named."""
BOLD_MARKDOWN, BOLD_HTML = "**{}**", "<b>{}</b>"
NOT_IN_IT = (
    "Not in these errors: what the model is made of. Friction, rolling friction, fill and contact law change the "
    "torque by more (docs/explanation/sensitivities.md)."
)


@dataclass(frozen=True, slots=True)
class Answer:
    """What reaches a target, with the scene's file, or what is in the way.

    Attributes
    ----------
    target : float
        Half width, relative.
    found : Choice or Obstacle
    file : Path or None
        Of the scene that is ready to run.
    """

    target: float
    found: Choice | Obstacle
    file: Path | None = None

    def in_words(self) -> str:
        """Return a line for the terminal."""
        found = self.found
        if isinstance(found, Choice):
            return f"{per_cent(self.target)}: emclutch run {self.file}"
        return f"{per_cent(self.target)}: {found.in_words()}"


def error_in_words(error: KnobError | None) -> str:
    """Return the bias with both ends of its 95 % interval, and whether they decide anything."""
    if error is None:
        return "not known"
    half = 100.0 * error.half_width
    digits = min(3, max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 1)
    low, high = (f"{100.0 * end:+.{digits}f}" for end in error.interval)
    text = f"{100.0 * error.bias:+.{digits}f} % ({low} to {high} %)"
    return text if error.is_decided else f"not significant: {text}"


def order_in_words(ladder: Ladder, knob: KnobLadder) -> str:
    """Return the order of convergence in theory, and the 95 % interval of the posterior."""
    if knob.knob not in ladder.told:
        return "not measured"
    middle, low, high = ladder.posterior.order(knob.knob)
    theory = "unknown" if knob.order is None else f"{knob.order:g}"
    return f"{theory}; posterior {middle:.2g} ({low:.2g} to {high:.2g})"


def rows_of(ladder: Ladder) -> list[dict[str, Any]]:
    """Return a row for each setting: bias with its 95 % interval, relative to the torque; seconds of one packing.

    Cost is the processor time of a packing over that at the scene's own settings.
    """
    rows = []
    for knob in ladder.knobs:
        for rung in knob.rungs:
            error = None if rung.value is None else ladder.error(knob.knob, rung.step_size)
            low, high = (None, None) if error is None else error.interval
            rows.append(
                {
                    "knob": knob.knob,
                    "key": knob.key,
                    "setting": rung.setting,
                    "unit": UNITS.get(knob.knob, ""),
                    "own": knob.is_own(rung.setting),
                    "basis": SHORT[knob.basis],
                    "value": rung.value,
                    "standard_error": rung.error,
                    "bias": None if error is None else error.bias,
                    "low": low,
                    "high": high,
                    "half_width": None if error is None else error.half_width,
                    "decided": None if error is None else error.is_decided,
                    "order": knob.order,
                    "posterior_order": ladder.posterior.order(knob.knob)[0] if knob.knob in ladder.told else None,
                    "packings": rung.packings,
                    "seconds": rung.seconds,
                    "cost": rung.cost,
                    "failure": rung.failure,
                }
            )
    rows += [{"knob": name, "failure": reason} for name, reason in ladder.unknown.items()]
    return rows


def study_page(ladder: Ladder, answers: Sequence[Answer], folder: Path, bold: str) -> Page:
    """Return the page of a study; `bold` is the form of what is set in bold, ``**{}**`` or ``<b>{}</b>``."""
    known = {key: ladder.machine[key] for key in MACHINE if key in ladder.machine}
    if "processor_seconds" in ladder.machine:
        known["processor time"] = format_duration(ladder.machine["processor_seconds"])
    machine = ", ".join(f"{key} {value}" for key, value in known.items())
    picture: list[Block] = []
    if (folder / "accuracy.png").is_file():
        picture = [
            Picture("total error against cost: a line a knob, all others as in the scene", folder / "accuracy.png")
        ]
    return Page(
        folder,
        f"Accuracy and processor time: {ladder.case}",
        f"device {ladder.device}{f'; {machine}' if machine else ''}",
        {
            "Settings for wanted accuracies": [_answers(ladder, answers, bold), Statements(_remarks(ladder, answers))],
            "Cost against error": picture,
            "Errors at the scene's own settings": [_own(ladder, bold)],
            "All settings that were measured": [_settings(ladder)],
        },
    )


def _answers(ladder: Ladder, answers: Sequence[Answer], bold: str) -> Table:
    """Return a row for the scene as it is, and one for each target."""
    own = own_choice(ladder)
    rows = [_answer_row("this scene", ladder, own, bold, "")]
    for one in answers:
        if isinstance(one.found, Choice):
            rows.append(_answer_row(per_cent(one.target), ladder, one.found, bold, one.file.name if one.file else ""))
        else:
            rows.append((per_cent(one.target), one.found.in_words(), *[""] * 7))
    head = (
        "target", "settings that differ", "packings", "processor time", f"on {cores_at_hand()} cores", "bias",
        "known to", "parts", "figure of merit [1/h]", "scene",
    )  # fmt: skip
    return Table([row + ("",) * (len(head) - len(row)) for row in rows], head, (2, 3, 4, 5, 6, 8))


def _answer_row(target: str, ladder: Ladder, choice: Choice, bold: str, scene: str) -> tuple[str, ...]:
    rounds = math.ceil(choice.packings / cores_at_hand())
    return (
        target,
        changes_in_words(ladder, choice) or "none",
        str(choice.packings),
        format_duration(choice.seconds),
        format_duration(choice.seconds / choice.packings * rounds),
        f"{100.0 * choice.total.bias:+.2g} %",
        f"± {per_cent(choice.half_width)}",
        parts_in_words(choice, bold),
        f"{3600.0 * choice.figure_of_merit:.3g}",
        scene,
    )


def changes_in_words(ladder: Ladder, choice: Choice) -> str:
    """Return the settings that are not the scene's own."""
    return ", ".join(
        f"{knob.knob} {choice.settings[knob.knob]:.4g}"
        for knob in ladder.knobs
        if knob.knob in choice.settings and not knob.is_own(choice.settings[knob.knob])
    )


def parts_in_words(choice: Choice, bold: str = "{}") -> Markup:
    """Return the parts of the half width that count, the largest in bold."""
    parts = [
        f"{name} {per_cent(half)}" for name, half in choice.parts.items() if half >= SMALLEST_PART * choice.half_width
    ]
    return Markup(", ").join([Markup(bold).format(parts[0]), *parts[1:]])


def _remarks(ladder: Ladder, answers: Sequence[Answer]) -> list[Statement]:
    corrected = any(isinstance(one.found, Choice) and abs(one.found.total.bias) > one.target for one in answers)
    remarks = [
        Statement(
            Mark.NOTE,
            'A bias is what the settings add to the torque; the torque is to be divided by 1 + bias. "Known to" is '
            "half the 95 % interval of the torque so corrected: of its packings and its settings, in quadrature. "
            "Figure of merit: 1 / (error² processor time), the error being half of that.",
        ),
        Statement(Mark.NOTE, prior_in_words(ladder)),
    ]
    if corrected:
        remarks.append(Statement(Mark.NOTE, "Some targets are reached by that correction: the bias alone is larger."))
    remarks += [
        Statement(Mark.POOR, f"Error of {name.replace('_', ' ')} not included: {reason}.")
        for name, reason in unknown_of(ladder).items()
    ]
    return [*remarks, Statement(Mark.NOTE, NOT_IN_IT)]


def prior_in_words(ladder: Ladder) -> str:
    """Return what is assumed of small errors and orders, what it gains, and how this study agrees with it."""
    chi2, count = ladder.prior_check()
    half = ladder.total(ladder.told).half_width
    return (
        f"Prior: orders of convergence lie within ± {per_cent(ORDER_SPREAD)} of theory (one standard deviation); small "
        f"settings have errors of about {per_cent(SMALL_ERROR)}, with heavy tails. Without the prior of small errors "
        f"the error of the settings is known to ± {per_cent(ladder.without_prior)} instead of ± {per_cent(half)}. "
        f"Under it the {count} small errors of this study have chi² = {chi2:.2g}."
    )


def _own(ladder: Ladder, bold: str) -> Table:
    """Return the error of each knob at the scene's own setting, the widest first."""
    choice = own_choice(ladder)
    theory = {one.name: one.theory for one in KNOBS}
    of = {one.knob: one for one in ladder.knobs}
    known = [name for name in choice.parts if name in of]
    rows: list[tuple[str, ...]] = []
    for name in [*known, *(one for one in of if one not in known)]:
        knob = of[name]
        shown = error_in_words(ladder.error(name))
        rows.append(
            (
                name,
                knob.key,
                f"{knob.own:.4g} {UNITS.get(name, '')}".strip(),
                Markup(bold).format(shown) if name == next(iter(known), None) else shown,
                order_in_words(ladder, knob),
                theory.get(name, ""),
            )
        )
    rows += [(name, "", "", "not known", reason, theory.get(name, "")) for name, reason in ladder.unknown.items()]
    return Table(rows, ("knob", "key", "setting", "error of the torque", "order", "theory"))


def _settings(ladder: Ladder) -> Table:
    rows = []
    for knob in ladder.knobs:
        for rung in knob.rungs:
            error = None if rung.value is None else ladder.error(knob.knob, rung.step_size)
            value = rung.failure or "none" if rung.value is None else f"{rung.value:.4g}"
            own = " (this scene)" if knob.is_own(rung.setting) else ""
            rows.append(
                (
                    knob.knob,
                    f"{rung.setting:.4g} {UNITS.get(knob.knob, '')}".strip() + own,
                    f"{value} ± {per_cent(rung.error)}" if rung.error else value,
                    SHORT[knob.basis],
                    error_in_words(error) if rung.value is not None else "",
                    str(rung.packings),
                    f"{rung.seconds:.3g}",
                    f"{rung.cost:.3g}",
                )
            )
    head = ("knob", "setting", "value ± standard error", "measured on", "error", "packings", "seconds each", "cost")
    return Table(rows, head, (5, 6, 7))
