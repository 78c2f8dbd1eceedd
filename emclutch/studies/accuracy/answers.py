"""What an accuracy study says: tables, a picture, scenes for wanted accuracies, and one sentence."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w

from emclutch.results.atomic_file import replace_text
from emclutch.results.ladder import Ladder
from emclutch.results.pictures.accuracy import accuracy_picture
from emclutch.results.recommended import STATISTICS, Choice, Obstacle, own_choice
from emclutch.results.report.render import html, markdown
from emclutch.results.text import format_duration, per_cent
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


def present(case: Case, ladder: Ladder, folder: Path, targets: Sequence[float]) -> list[str]:
    """Write tables, a picture, a page and a scene for each target that is reached; return what the terminal shows.

    Writes ``accuracy.csv``, ``accuracy.png``, ``accuracy.md``, ``accuracy.html`` and scenes as
    ``target_10_percent.toml``, in place of earlier ones.

    Parameters
    ----------
    targets : half widths of the torque's 95 % interval that are wanted, relative
    """
    answers = [_answer(case, ladder, folder, target) for target in sorted(targets, reverse=True)]
    _write_csv(folder / "accuracy.csv", rows_of(ladder))
    accuracy_picture(
        folder / "accuracy.png",
        ladder,
        [(one.target, one.found) for one in answers],
        title=f"Accuracy and processor time: {ladder.case}",
    )
    replace_text(folder / "accuracy.md", markdown(study_page(ladder, answers, folder, BOLD_MARKDOWN), folder))
    replace_text(folder / "accuracy.html", html(study_page(ladder, answers, folder, BOLD_HTML)))
    return [*_terminal_table(answers), *(one.in_words() for one in answers), closing_sentence(ladder, answers)]


def closing_sentence(ladder: Ladder, answers: Sequence[Answer]) -> str:
    """Say what the study has found, in one sentence."""
    own = own_choice(ladder)
    found = [(one.target, one.found) for one in answers if isinstance(one.found, Choice)]
    reached = [f"{per_cent(target)} for {format_duration(choice.seconds)}" for target, choice in found]
    costs = f"; {', '.join(reached)} of processor time" if reached else "; no target is reached by what was measured"
    torque, half = ladder.corrected_torque()
    parts = own.total.widths | {STATISTICS: ladder.statistical}
    largest = max(parts, key=lambda name: parts[name])
    unknown = ", ".join(name.replace("_", " ") for name in own.total.unknown)
    return (
        f"{ladder.case}: {ladder.torque:.3g} N m, mean of {ladder.packings} packings, {100.0 * own.total.bias:+.2g} % "
        f"by {'those of its settings that were measured' if unknown else 'its settings'}, so {torque:.3g} N m ± "
        f"{per_cent(half)}{f', and the unknown error of {unknown}' if unknown else ''}; largest part of the "
        f"error: {largest.replace('_', ' ')}{costs}."
    )


def _answer(case: Case, ladder: Ladder, folder: Path, target: float) -> Answer:
    """Write the scene of the cheapest settings."""
    path = folder / f"target_{100.0 * target:g}_percent.toml"
    path.unlink(missing_ok=True)
    found = cheapest_case(case, ladder, target)
    if isinstance(found, Obstacle):
        return Answer(target, found)
    choice, run = found
    replace_text(path, scene_text(run, ladder, choice, target, path.name))
    return Answer(target, choice, path)


def scene_text(case: Case, ladder: Ladder, choice: Choice, target: float, name: str) -> str:
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
    return _head(case, ladder, choice, target, name) + tomli_w.dumps(case.with_values(values).data)


def _head(case: Case, ladder: Ladder, choice: Choice, target: float, name: str) -> str:
    parts = parts_in_words(choice)
    machine = ", ".join(str(ladder.machine[key]) for key in ("date", "processor") if key in ladder.machine)
    lines = [
        f"Torque of {case.name} to {per_cent(target)}: settings by `emclutch accuracy`",
        "",
        f"Run:    emclutch run {name}",
        f"Takes:  {format_duration(choice.seconds)} of processor time, for about {choice.packings} packings",
        f"Error:  +- {per_cent(choice.half_width)}: {parts}",
        f"Bias:   {100.0 * choice.total.bias:+.2g} % by the settings; the torque of a run is to be divided by "
        f"{1.0 + choice.total.bias:.4g}",
        f"From:   ladder of device {ladder.device}{f' ({machine})' if machine else ''}",
        "Note:   what the model is made of, as friction, is not in the error (docs/explanation/sensitivities.md)",
    ]
    return "\n".join(f"# {line}".rstrip() for line in lines) + "\n\n"


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    import pandas

    replace_text(path, pandas.DataFrame(list(rows)).to_csv(index=False))


def _terminal_table(answers: Sequence[Answer]) -> list[str]:
    """Return the answers as lines of a table."""
    from rich.console import Console
    from rich.table import Table

    table = Table("target", "packings", "processor time", "known to", "largest part", "scene")
    for one in answers:
        if isinstance(one.found, Choice):
            name, half = next(iter(one.found.parts.items()))
            table.add_row(
                per_cent(one.target),
                str(one.found.packings),
                format_duration(one.found.seconds),
                f"± {per_cent(one.found.half_width)}",
                f"{name} {per_cent(half)}",
                "" if one.file is None else one.file.name,
            )
    if not table.rows:
        return []
    stream = io.StringIO()
    Console(file=stream, width=100).print(table)
    return stream.getvalue().rstrip().splitlines()
