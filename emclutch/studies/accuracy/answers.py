"""Files of an accuracy study: tables, a picture, a page, and scenes for wanted accuracies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w

from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.results.atomic_file import replace_text
from emclutch.results.pictures.accuracy import accuracy_picture
from emclutch.results.recommended import Choice, LimitingError, budget_option
from emclutch.results.report.render import markdown, write_index
from emclutch.results.text import format_duration, format_percent
from emclutch.scene.case import Case
from emclutch.scene.input_files import input_files
from emclutch.scene.replica_count import cores_at_hand
from emclutch.simulation.recommended_case import cheapest_case
from emclutch.studies.accuracy.budgeted_study import BUDGET
from emclutch.studies.accuracy.fidelities import CheapestAnswer, TorqueByLaw
from emclutch.studies.accuracy.report import accuracy_report, parts_in_words, rows_of


def write_answers(
    case: Case, study: AccuracyStudy, folder: Path, targets: Sequence[float], remarks: Sequence[str], law: TorqueByLaw
) -> tuple[CheapestAnswer, ...]:
    """Write tables, a picture, a page and a scene for each target that is reached; return what reaches the targets.

    Writes ``accuracy.csv``, ``accuracy.png``, ``accuracy.md``, ``index.html`` and scenes as
    ``target_10_percent.toml``, in place of earlier ones.

    Parameters
    ----------
    targets : half widths of the torque's 95 % interval that are wanted, relative
    remarks : sentences that are added to the report
    law : torque by the law of the powder, which needs no study
    """
    answers = tuple(_answer(case, study, folder, target, law) for target in sorted(targets, reverse=True))
    _write_csv(folder / "accuracy.csv", rows_of(study))
    found = [(one.target, one.grains) for one in answers if one.grains is not None]
    accuracy_picture(folder / "accuracy.png", study, found, title=f"Accuracy and processor time: {study.case}")
    report = accuracy_report(study, answers, folder, remarks, law)
    replace_text(folder / "accuracy.md", markdown(report, folder))
    write_index(report)
    return answers


def _answer(case: Case, study: AccuracyStudy, folder: Path, target: float, law: TorqueByLaw) -> CheapestAnswer:
    """Write the scene of the cheapest settings; where none reach the target, name the command that continues."""
    path, command = folder / f"target_{100.0 * target:g}_percent.toml", ""
    path.unlink(missing_ok=True)
    found = cheapest_case(case, study, target)
    grains = found if isinstance(found, LimitingError) else found[0]
    if isinstance(found, tuple):
        replace_text(path, scene_text(found[1], study, found[0], target, path.name))
        command = f"emclutch run {path}"
    elif budget := found.budget(study.machine.get("jobs", 1), 2.0 * study.machine.get("budget", BUDGET)):
        command = "to continue this study, give the same command with "
        command += f"--out {folder} --resume --budget {budget_option(budget)}"
    return CheapestAnswer(target=target, law=law, grains=grains, command=command, cores=cores_at_hand())


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
        f"Error:  ± {format_percent(choice.half_width)}: {parts}",
        f"Bias:   {100.0 * choice.total.bias:+.2g} % by the settings; the torque of a run is to be divided by "
        f"{1.0 + choice.total.bias:.4g}",
        f"From:   accuracy study of device {study.device}{f' ({machine})' if machine else ''}",
        "Note:   errors of the model's inputs, as friction, are not included (docs/explanation/sensitivities.md)",
    ]
    return "\n".join(f"# {line}".rstrip() for line in lines) + "\n\n"


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    import pandas

    replace_text(path, pandas.DataFrame(list(rows)).to_csv(index=False))
