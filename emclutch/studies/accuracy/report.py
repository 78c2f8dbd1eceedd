"""The report on an accuracy study: best estimate, settings for wanted accuracies, errors; the rows of accuracy.csv."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, SettingError
from emclutch.results.recommended import Choice, own_choice, unknown_of
from emclutch.results.report.report import Mark, Picture, Report, Shown, Statement, Statements, Table, note, warning
from emclutch.results.setting_errors import ORDER_SPREAD, SMALL_ERROR
from emclutch.results.text import format_duration, format_percent, in_words
from emclutch.scene.replica_count import cores_at_hand
from emclutch.settings import SETTINGS, UNITS
from emclutch.studies.accuracy.fidelities import CheapestAnswer, TorqueByLaw, statements_on

SHORT = {Basis.TORQUE: "torque", Basis.MOMENTS: "squared moments", Basis.START_UP: "torque, start-up"}
MACHINE = ("date", "processor", "cores", "jobs")
"""Entries of a study's machine that stand at the head of the page."""
SMALLEST_PART = 0.1
"""Of the half width: smaller parts are not named."""
TAKEN_AS_GIVEN = "No ± contains an error of friction, rolling friction, fill or contact law, which may be larger."
ROUGH = 0.1
"""A half width of the best estimate beyond which it is known roughly only, relative."""


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


def accuracy_report(
    study: AccuracyStudy, answers: Sequence[CheapestAnswer], folder: Path, remarks: Sequence[str], law: TorqueByLaw
) -> Report:
    """Return the report on a study in a folder; `remarks` are added to its statements, `law` needs no study."""
    known = {key: study.machine[key] for key in MACHINE if key in study.machine}
    if "processor_seconds" in study.machine:
        known["processor time"] = format_duration(study.machine["processor_seconds"])
    machine = ", ".join(f"{key} {value}" for key, value in known.items())
    subtitle = f"device {study.device}{f'; {machine}' if machine else ''}"
    report = Report(f"Accuracy and processor time: {study.case}", subtitle, folder=folder,
                    data={"settings": rows_of(study), "law": law.as_dict(),
                          "cheapest": [one.as_dict() for one in answers]})  # fmt: skip
    statements = [*_statements(study), note(law.in_words()), *map(warning, remarks)]
    report.add("Result", Statements(statements), Shown.TERMINAL)
    report.add("Cheapest for a target", Statements(statements_on(answers)), Shown.TERMINAL)
    choices = [(one.target, one.grains) for one in answers if isinstance(one.grains, Choice)]
    explanations = Statements([*_explanations(study, choices)])
    report.add("Settings for wanted accuracies", [_choices(study, choices), explanations], Shown.PAGE)
    if (picture := folder / "accuracy.png").is_file():
        what = "total error against cost: a line a setting, all others as in the scene"
        report.add("Cost against error", Picture(what, picture), Shown.PAGE)
    report.add("Errors at the scene's own settings", _own(study), Shown.PAGE)
    return report.add("All values that were measured", _values(study), Shown.PAGE)


def own_in_words(study: AccuracyStudy, cores: int) -> str:
    """Return what a run at the settings of the scene reaches and costs, and its dominant error."""
    own = own_choice(study)
    half = "error unknown" if own.total.unknown else f"± {format_percent(own.half_width)}"
    how = f"{own.cost_in_words(cores)}, {own.replicas} replicas, measured by the accuracy study of this device"
    dominant = f"{in_words(own.largest)}, ± {format_percent(own.parts[own.largest])}"
    return f"Runs of grains give {study.best_estimate()[0]:.3g} N m {half} in {how}. Dominant error: {dominant}."


def _statements(study: AccuracyStudy) -> Iterator[Statement]:
    """Say the best estimate with its error, what is not in it, the raw torque and the dominant error."""
    own, (torque, half) = own_choice(study), study.best_estimate()
    mark = Mark.WARNING if half > ROUGH or own.total.unknown else Mark.GOOD
    yield Statement(mark, f"Torque on the disc: {torque:.3g} N m ± {format_percent(half)} (95 %), best estimate.")
    yield note(TAKEN_AS_GIVEN)
    for reason, names in _grouped((reason, in_words(name)) for name, reason in unknown_of(study).items()).items():
        yield warning(f"not measured, and not in the error bar: {', '.join(names)}; {reason}")
    what, bias = "measured" if own.total.unknown else "numerical", 100.0 * own.total.bias
    how = f"the {what} settings {'add' if bias > 0.0 else 'take off'} {abs(bias):.2g} %"
    excess = 100.0 * (study.torque / torque - 1.0)
    beside = f"{abs(excess):.2g} % {'above' if excess > 0.0 else 'below'} the best estimate of all replicas"
    yield note(f"Raw torque: {study.torque:.3g} N m, mean of {study.replicas} replicas, {beside}; {how}.")
    yield note(own_in_words(study, cores_at_hand()))


def _grouped(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Return the second members of pairs by the first."""
    found: dict[str, list[str]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def _choices(study: AccuracyStudy, choices: Sequence[tuple[float, Choice]]) -> Table:
    """Return settings, cost and error of the scene as it is and of each target that runs of grains reach."""
    rows, cores = [], cores_at_hand()
    reached = [(format_percent(target), choice) for target, choice in choices]
    for target, choice in (("this scene", own_choice(study)), *reached):
        rows.append(
            (
                target, changes_in_words(study, choice) or "none", str(choice.replicas),
                format_duration(choice.seconds), format_duration(choice.wall_seconds(cores)),
                f"{100.0 * choice.total.bias:+.2g} %", f"± {format_percent(choice.half_width)}",
                parts_in_words(choice), f"{3600.0 * choice.figure_of_merit:.3g}",
            )
        )  # fmt: skip
    head = ("target", "settings that differ", "replicas", "processor time", f"on {cores} cores", "bias", "uncertainty",
            "parts", "figure of merit [1/h]")  # fmt: skip
    return Table(rows, head, (2, 3, 4, 5, 6, 8))


def changes_in_words(study: AccuracyStudy, choice: Choice) -> str:
    """Return the settings that are not the scene's own."""
    return ", ".join(
        f"{setting.name} {choice.values[setting.name]:.4g}"
        for setting in study.settings
        if setting.name in choice.values and not setting.is_own(choice.values[setting.name])
    )


def parts_in_words(choice: Choice) -> str:
    """Return the parts of the half width that count, the largest first."""
    return ", ".join(
        f"{in_words(name)} {format_percent(half)}"
        for name, half in choice.parts.items()
        if half >= SMALLEST_PART * choice.half_width
    )


def _explanations(study: AccuracyStudy, choices: Sequence[tuple[float, Choice]]) -> Iterator[Statement]:
    """Say what the columns are, and what is assumed."""
    yield note("Bias: what the settings add to the torque, which is to be divided by 1 + bias.")
    yield note(
        "Uncertainty: half the 95 % interval of the torque so corrected, of replicas and settings in quadrature."
    )
    yield note("Figure of merit: 1/(error² processor time), the error being half of the uncertainty.")
    yield note(prior_in_words(study))
    if any(abs(choice.total.bias) > target for target, choice in choices):
        yield note("Some targets are reached by that correction: the bias alone is larger.")


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


def _own(study: AccuracyStudy) -> Table:
    """Return the error of each setting at the scene's own value, the widest first."""
    choice = own_choice(study)
    theory = {one.name: one.theory for one in SETTINGS}
    of = {one.name: one for one in study.settings}
    rows: list[tuple[str, ...]] = []
    for name in sorted(of, key=lambda one: -choice.parts.get(one, 0.0)):
        setting = of[name]
        rows.append(
            (
                name,
                setting.key,
                f"{setting.own:.4g} {UNITS.get(name, '')}".strip(),
                error_in_words(study.error(name)),
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
