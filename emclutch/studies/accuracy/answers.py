"""Output of an accuracy study: tables, a picture, scenes for wanted accuracies, and one sentence."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w

from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.results.atomic_file import replace_text
from emclutch.results.pictures.accuracy import accuracy_picture
from emclutch.results.recommended import STATISTICS, Choice, LimitingError, own_choice
from emclutch.results.report.render import html, markdown
from emclutch.results.text import format_duration, format_percent
from emclutch.scene.case import Case
from emclutch.scene.input_files import input_files
from emclutch.simulation.recommended_case import cheapest_case
from emclutch.studies.accuracy.tables import (
    BOLD_HTML,
    BOLD_MARKDOWN,
    Answer,
    parts_in_words,
    rows_of,
    study_page,
)


def present(case: Case, study: AccuracyStudy, folder: Path, targets: Sequence[float]) -> list[str]:
    """Write tables, a picture, a page and a scene for each target that is reached; return what the terminal shows.

    Writes ``accuracy.csv``, ``accuracy.png``, ``accuracy.md``, ``accuracy.html`` and scenes as
    ``target_10_percent.toml``, in place of earlier ones.

    Parameters
    ----------
    targets : half widths of the torque's 95 % interval that are wanted, relative
    """
    answers = [_answer(case, study, folder, target) for target in sorted(targets, reverse=True)]
    _write_csv(folder / "accuracy.csv", rows_of(study))
    accuracy_picture(
        folder / "accuracy.png",
        study,
        [(one.target, one.found) for one in answers],
        title=f"Accuracy and processor time: {study.case}",
    )
    replace_text(folder / "accuracy.md", markdown(study_page(study, answers, folder, BOLD_MARKDOWN), folder))
    replace_text(folder / "accuracy.html", html(study_page(study, answers, folder, BOLD_HTML)))
    return [*_terminal_table(answers), *(one.in_words() for one in answers), closing_sentence(study, answers)]


def closing_sentence(study: AccuracyStudy, answers: Sequence[Answer]) -> str:
    """Return the result of the study in one sentence."""
    own = own_choice(study)
    found = [(one.target, one.found) for one in answers if isinstance(one.found, Choice)]
    reached = [f"{format_percent(target)} for {format_duration(choice.seconds)}" for target, choice in found]
    costs = f"; {', '.join(reached)} of processor time" if reached else "; no target is reached by what was measured"
    torque, half = study.best_estimate()
    parts = own.total.widths | {STATISTICS: study.statistical}
    largest = max(parts, key=lambda name: parts[name])
    unknown = ", ".join(name.replace("_", " ") for name in own.total.unknown)
    return (
        f"{study.case}: best estimate {torque:.3g} N m ± {format_percent(half)}"
        f"{f', and the unknown error of {unknown}' if unknown else ''} (raw {study.torque:.3g} N m, mean of "
        f"{study.replicas} replicas; {'measured settings' if unknown else 'numerical settings'} add "
        f"{100.0 * own.total.bias:.2g} %); largest part of the error: {largest.replace('_', ' ')}{costs}."
    )


def _answer(case: Case, study: AccuracyStudy, folder: Path, target: float) -> Answer:
    """Write the scene of the cheapest settings."""
    path = folder / f"target_{100.0 * target:g}_percent.toml"
    path.unlink(missing_ok=True)
    found = cheapest_case(case, study, target)
    if isinstance(found, LimitingError):
        return Answer(target, found)
    choice, run = found
    replace_text(path, scene_text(run, study, choice, target, path.name))
    return Answer(target, choice, path)


def scene_text(case: Case, study: AccuracyStudy, choice: Choice, target: float, name: str) -> str:
    """Return a case of `case_for` as the text of a file that can lie anywhere: its paths are absolute."""
    values: dict[str, Any] = {"output.folder": None}
    values |= {key: str(path.resolve()) for key, path in input_files(case.scene).items()}
    for material, entry in case.data.get("materials", {}).items():
        folder = Path() if case.path is None else case.path.parent
        values |= {
            f"materials.{material}.{key}": str((folder / str(entry[key])).resolve())
            for key in ("table", "file")
            if key in entry
        }
    return _head(case, study, choice, target, name) + tomli_w.dumps(case.with_values(values).data)


def _head(case: Case, study: AccuracyStudy, choice: Choice, target: float, name: str) -> str:
    parts = parts_in_words(choice)
    machine = ", ".join(str(study.machine[key]) for key in ("date", "processor") if key in study.machine)
    lines = [
        f"Torque of {case.name} to {format_percent(target)}: settings by `emclutch accuracy`",
        "",
        f"Run:    emclutch run {name}",
        f"Takes:  {format_duration(choice.seconds)} of processor time, for about {choice.replicas} replicas",
        f"Error:  +- {format_percent(choice.half_width)}: {parts}",
        f"Bias:   {100.0 * choice.total.bias:+.2g} % by the settings; the torque of a run is to be divided by "
        f"{1.0 + choice.total.bias:.4g}",
        f"From:   accuracy study of device {study.device}{f' ({machine})' if machine else ''}",
        "Note:   errors of the model's inputs, as friction, are not included (docs/explanation/sensitivities.md)",
    ]
    return "\n".join(f"# {line}".rstrip() for line in lines) + "\n\n"


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    import pandas

    replace_text(path, pandas.DataFrame(list(rows)).to_csv(index=False))


def _terminal_table(answers: Sequence[Answer]) -> list[str]:
    """Return the answers as lines of a table."""
    from rich.console import Console
    from rich.table import Table

    table = Table("target", "replicas", "processor time", "uncertainty", "largest part", "scene")
    for one in answers:
        if isinstance(one.found, Choice):
            name, half = next(iter(one.found.parts.items()))
            table.add_row(
                format_percent(one.target),
                str(one.found.replicas),
                format_duration(one.found.seconds),
                f"± {format_percent(one.found.half_width)}",
                f"{name} {format_percent(half)}",
                "" if one.file is None else one.file.name,
            )
    if not table.rows:
        return []
    stream = io.StringIO()
    Console(file=stream, width=100).print(table)
    return stream.getvalue().rstrip().splitlines()
