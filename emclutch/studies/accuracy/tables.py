"""Tables of an accuracy study: rows of accuracy.csv, and the page that is written as Markdown and as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, SettingError
from emclutch.results.recommended import Choice, LimitingError, own_choice, unknown_of
from emclutch.results.report.content import Block, Page, Picture, Statements, Table
from emclutch.results.report.verdict import Mark, Statement
from emclutch.results.setting_errors import ORDER_SPREAD, SMALL_ERROR
from emclutch.results.text import format_duration, format_percent
from emclutch.scene.replica_count import cores_at_hand
from emclutch.settings import SETTINGS

UNITS = {one.name: one.unit for one in SETTINGS}
SHORT = {Basis.TORQUE: "torque", Basis.MOMENTS: "squared moments", Basis.START_UP: "torque, start-up"}
MACHINE = ("date", "processor", "cores", "jobs")
"""Entries of a study's machine that stand at the head of the page."""
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
    found : Choice or LimitingError
    file : Path or None
        Of the scene that is ready to run.
    """

    target: float
    found: Choice | LimitingError
    file: Path | None = None

    def in_words(self) -> str:
        """Return a line for the terminal."""
        found = self.found
        if isinstance(found, Choice):
            return f"{format_percent(self.target)}: emclutch run {self.file}"
        return f"{format_percent(self.target)}: {found.in_words()}"


def error_in_words(error: SettingError | None) -> str:
    """Return the bias with both ends of its 95 % interval, and whether they decide anything."""
    if error is None:
        return "not known"
    half = 100.0 * error.half_width
    digits = min(3, max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 1)
    low, high = (f"{100.0 * end:+.{digits}f}" for end in error.interval)
    text = f"{100.0 * error.bias:+.{digits}f} % ({low} to {high} %)"
    return text if error.is_significant else f"not significant: {text}"


def order_in_words(study: AccuracyStudy, setting: MeasuredSetting) -> str:
    """Return the order of convergence in theory, and the 95 % interval of the posterior."""
    if setting.name not in study.told:
        return "not measured"
    middle, low, high = study.posterior.order(setting.name)
    theory = "unknown" if setting.order is None else f"{setting.order:g}"
    return f"{theory}; posterior {middle:.2g} ({low:.2g} to {high:.2g})"


def rows_of(study: AccuracyStudy) -> list[dict[str, Any]]:
    """Return a row for each value: bias with its 95 % interval, relative to the torque; seconds of one replica.

    Cost is the processor time of a replica over that at the scene's own settings.
    """
    rows = []
    for setting in study.settings:
        for measured in setting.values:
            error = None if measured.result is None else study.error(setting.name, measured.step_size)
            low, high = (None, None) if error is None else error.interval
            rows.append(
                {
                    "setting": setting.name,
                    "key": setting.key,
                    "value": measured.value,
                    "unit": UNITS.get(setting.name, ""),
                    "own": setting.is_own(measured.value),
                    "basis": SHORT[setting.basis],
                    "result": measured.result,
                    "standard_error": measured.error,
                    "bias": None if error is None else error.bias,
                    "low": low,
                    "high": high,
                    "half_width": None if error is None else error.half_width,
                    "significant": None if error is None else error.is_significant,
                    "order": setting.order,
                    "posterior_order": study.posterior.order(setting.name)[0] if setting.name in study.told else None,
                    "replicas": measured.replicas,
                    "seconds": measured.seconds,
                    "cost": measured.cost,
                    "failure": measured.failure,
                }
            )
    rows += [{"setting": name, "failure": reason} for name, reason in study.unknown.items()]
    return rows


def study_page(study: AccuracyStudy, answers: Sequence[Answer], folder: Path, bold: str) -> Page:
    """Return the page of a study; `bold` is the form of what is set in bold, ``**{}**`` or ``<b>{}</b>``."""
    known = {key: study.machine[key] for key in MACHINE if key in study.machine}
    if "processor_seconds" in study.machine:
        known["processor time"] = format_duration(study.machine["processor_seconds"])
    machine = ", ".join(f"{key} {value}" for key, value in known.items())
    picture: list[Block] = []
    if (folder / "accuracy.png").is_file():
        picture = [Picture("total error against cost: a line for each setting", folder / "accuracy.png")]
    return Page(
        folder,
        f"Accuracy and processor time: {study.case}",
        f"device {study.device}{f'; {machine}' if machine else ''}",
        {
            "Settings for wanted accuracies": [_answers(study, answers, bold), Statements(_remarks(study, answers))],
            "Cost against error": picture,
            "Errors at the scene's own settings": [_own(study, bold)],
            "All values that were measured": [_values(study)],
        },
    )


def _answers(study: AccuracyStudy, answers: Sequence[Answer], bold: str) -> Table:
    """Return a row for the scene as it is, and one for each target."""
    own = own_choice(study)
    rows = [_answer_row("this scene", study, own, bold, "")]
    for one in answers:
        if isinstance(one.found, Choice):
            name = one.file.name if one.file else ""
            rows.append(_answer_row(format_percent(one.target), study, one.found, bold, name))
        else:
            rows.append((format_percent(one.target), one.found.in_words(), *[""] * 7))
    head = (
        "target", "settings that differ", "replicas", "processor time", f"on {cores_at_hand()} cores", "bias",
        "uncertainty", "parts", "figure of merit [1/h]", "scene",
    )  # fmt: skip
    return Table([row + ("",) * (len(head) - len(row)) for row in rows], head, (2, 3, 4, 5, 6, 8))


def _answer_row(target: str, study: AccuracyStudy, choice: Choice, bold: str, scene: str) -> tuple[str, ...]:
    rounds = math.ceil(choice.replicas / cores_at_hand())
    return (
        target,
        changes_in_words(study, choice) or "none",
        str(choice.replicas),
        format_duration(choice.seconds),
        format_duration(choice.seconds / choice.replicas * rounds),
        f"{100.0 * choice.total.bias:+.2g} %",
        f"± {format_percent(choice.half_width)}",
        parts_in_words(choice, bold),
        f"{3600.0 * choice.figure_of_merit:.3g}",
        scene,
    )


def changes_in_words(study: AccuracyStudy, choice: Choice) -> str:
    """Return the settings that are not the scene's own."""
    return ", ".join(
        f"{setting.name} {choice.values[setting.name]:.4g}"
        for setting in study.settings
        if setting.name in choice.values and not setting.is_own(choice.values[setting.name])
    )


def parts_in_words(choice: Choice, bold: str = "{}") -> Markup:
    """Return the parts of the half width that count, the largest in bold."""
    parts = [
        f"{name} {format_percent(half)}"
        for name, half in choice.parts.items()
        if half >= SMALLEST_PART * choice.half_width
    ]
    return Markup(", ").join([Markup(bold).format(parts[0]), *parts[1:]])


def _remarks(study: AccuracyStudy, answers: Sequence[Answer]) -> list[Statement]:
    corrected = any(isinstance(one.found, Choice) and abs(one.found.total.bias) > one.target for one in answers)
    remarks = [
        Statement(
            Mark.NOTE,
            "The bias is the relative error of the raw torque; the best estimate is the raw torque over 1 + bias. The "
            "uncertainty is half its 95 % interval: that of the replicas and that of the settings, in quadrature. "
            "Figure of merit: 1 / (error² × processor time), with half the uncertainty as the error.",
        ),
        Statement(Mark.NOTE, prior_in_words(study)),
    ]
    if corrected:
        remarks.append(Statement(Mark.NOTE, "Some targets are reached by that correction: the bias alone is larger."))
    remarks += [
        Statement(Mark.POOR, f"Error of {name.replace('_', ' ')} not included: {reason}.")
        for name, reason in unknown_of(study).items()
    ]
    return [*remarks, Statement(Mark.NOTE, NOT_IN_IT)]


def prior_in_words(study: AccuracyStudy) -> str:
    """Return what is assumed of small errors and orders, what it gains, and how this study agrees with it."""
    chi2, count = study.prior_check()
    half = study.total(study.told).half_width
    spread, small = format_percent(ORDER_SPREAD), format_percent(SMALL_ERROR)
    return (
        f"Prior: orders of convergence lie within ± {spread} of theory (one standard deviation); small settings have "
        f"errors of about {small}, with heavy tails. Without the prior of small errors the uncertainty of the settings "
        f"is ± {format_percent(study.without_prior)} instead of ± {format_percent(half)}. Under it the {count} small "
        f"errors of this study have chi² = {chi2:.2g}."
    )


def _own(study: AccuracyStudy, bold: str) -> Table:
    """Return the error of each setting at the scene's own value, the widest first."""
    choice = own_choice(study)
    theory = {one.name: one.theory for one in SETTINGS}
    of = {one.name: one for one in study.settings}
    known = [name for name in choice.parts if name in of]
    rows: list[tuple[str, ...]] = []
    for name in [*known, *(one for one in of if one not in known)]:
        setting = of[name]
        shown = error_in_words(study.error(name))
        rows.append(
            (
                name,
                setting.key,
                f"{setting.own:.4g} {UNITS.get(name, '')}".strip(),
                Markup(bold).format(shown) if name == next(iter(known), None) else shown,
                order_in_words(study, setting),
                theory.get(name, ""),
            )
        )
    rows += [(name, "", "", "not known", reason, theory.get(name, "")) for name, reason in study.unknown.items()]
    return Table(rows, ("setting", "key", "value", "error of the torque", "order of convergence", "theory"))


def _values(study: AccuracyStudy) -> Table:
    rows = []
    for setting in study.settings:
        for measured in setting.values:
            error = None if measured.result is None else study.error(setting.name, measured.step_size)
            result = measured.failure or "none" if measured.result is None else f"{measured.result:.4g}"
            own = " (this scene)" if setting.is_own(measured.value) else ""
            rows.append(
                (
                    setting.name,
                    f"{measured.value:.4g} {UNITS.get(setting.name, '')}".strip() + own,
                    f"{result} ± {format_percent(measured.error)}" if measured.error else result,
                    SHORT[setting.basis],
                    error_in_words(error) if measured.result is not None else "",
                    str(measured.replicas),
                    f"{measured.seconds:.3g}",
                    f"{measured.cost:.3g}",
                )
            )
    head = ("setting", "value", "result ± standard error", "measured on", "error", "replicas", "seconds each", "cost")
    return Table(rows, head, (5, 6, 7))
