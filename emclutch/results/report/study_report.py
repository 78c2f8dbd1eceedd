"""The report on a study: how far it has come, its points, curves and failures; of a finished one each point's verdict.

The page in its folder has the same sections; it is written again while the study runs, and the browser loads it again.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.effects import EffectsSection
from emclutch.results.columns import TORQUE_DISC
from emclutch.results.report.report import (
    Block,
    Link,
    Mark,
    Picture,
    Report,
    Shown,
    Statement,
    Statements,
    Table,
    Text,
    note,
    warning,
)
from emclutch.results.report.run_report import (
    OmittedEffectsOf,
    cost_table,
    effects_of,
    effects_table,
    flat,
    links,
    pictures_in,
)
from emclutch.results.report.verdict import verdict
from emclutch.results.run_folder import INDEX
from emclutch.results.study_folder import TABLE, is_study
from emclutch.results.study_table import DONE, FAILED, KEPT, RUNNING, STOPPED, WAITING, PointRow
from emclutch.results.text import format_duration, format_mean, in_words
from emclutch.results.torque_curves import BEST_ESTIMATE, best_of

if TYPE_CHECKING:
    from emclutch.results.study_result import StudyResult

PICTURES = {
    "torque_vs_current.png": "torque against the coil's current",
    "torque_vs_speed.png": "torque against the motor's speed",
    "torque_vs_value.png": "torque against the first of the study's values",
    "grain_size.png": "torque against the size of the grains",
    "speeds.png": "speeds of the shafts against time",
}
METHODS = {
    "torque_dvi": "torque by DVI [N m]",
    "torque_dem": "by DEM [N m]",
    "torque_difference_bars": "difference [standard errors]",
    "lock_up_time_dvi": "locks by DVI [s]",
    "lock_up_time_dem": "by DEM [s]",
    "speed_difference": "speed difference",
    "missed_steps_dvi": "missed steps",
    "seconds_dvi": "time by DVI [s]",
    "seconds_dem": "by DEM [s]",
}
"""Columns of `methods.csv` that are shown, and their heads."""
MAX_ROWS, MAX_FAILURES, MAX_LINES, FEW = 300, 20, 6, 40
RELOAD = 10
"""Seconds after which a browser loads the page of a running study again."""
ORDER = {FAILED: 0, STOPPED: 1, RUNNING: 2, DONE: 3, KEPT: 3, WAITING: 4}


@dataclass(frozen=True, slots=True)
class StudyState:
    """How far a study has come.

    Attributes
    ----------
    folder : Path
    title : str
    points : dict of str to PointRow
        By the names of their folders.
    failures : dict of str to str
        Reasons by the names of the folders of points that have failed.
    seconds_left : float or None
        Wall-clock time to its end [s]; None where it is not known.
    is_running : bool
    """

    folder: Path
    title: str
    points: Mapping[str, PointRow]
    failures: Mapping[str, str]
    seconds_left: float | None = None
    is_running: bool = False

    @property
    def is_complete(self) -> bool:
        """True if every point is done."""
        return all(point.state in (DONE, KEPT) for point in self.points.values())


def state_of(study: StudyResult) -> StudyState:
    """Return the state of a study by the table in its folder."""
    import pandas  # local: `emclutch run` prints its report without tables of studies

    table, points = study.table.astype(object), {}
    for label, (_, row) in zip(study.labels(), table.iterrows(), strict=True):
        known = {name: None if pandas.isna(value) else value for name, value in row.items()}
        torque, interval = best_of(known)
        point = PointRow(label, DONE, 1.0, torque, interval, str(row["converged"]) == "True", float(row["seconds"]))
        point.stress = known.get("shear_stress") if torque is None else None
        points[str(row["folder"])] = point
    failures = {name: one.in_words() for name, one in study.failures().items()}
    return StudyState(study.folder, study.title, points | {name: PointRow(name, FAILED) for name in failures}, failures)


def state_report(state: StudyState, total: int | None = None) -> Report:
    """Return the report on a study, running or not; of its points the torques alone. `total`: points of the study."""
    report = Report(
        state.title or state.folder.resolve().name,
        f"study {state.folder.resolve().name}",
        folder=state.folder,
        reload=RELOAD if state.is_running else 0,
    )
    report.add("Result", Statements([*_progress(state, total), *_corrections(state.folder)]), Shown.TERMINAL)
    few = len(state.points) <= FEW
    report.add("Points", _points(state), Shown.TERMINAL if few else Shown.PAGE)
    report.add("Size of the grains", Text("\n".join(grain_size_lines(state.folder))), Shown.TERMINAL)
    report.add("DVI against DEM", _methods(state.folder / "methods.csv"), Shown.TERMINAL)
    report.add("Failures", _failures(state), Shown.PAGE)
    return report.add("Pictures", pictures_in(state.folder, PICTURES), Shown.PAGE).add(
        "Files", links(state.folder), Shown.PAGE
    )


def study_report(study: StudyResult, omitted_of: OmittedEffectsOf) -> Report:
    """Return the report on the points of a study that are done, with the verdict on each."""
    results, total = study.results(), study.total
    report = state_report(state_of(study), total)
    if outdated := study.refresh_in_words():
        report.add("Warnings", Statements([warning(outdated)]), Shown.TERMINAL)
    verdicts = {label: verdict(result) for label, result in results.items()}
    report.add("Warnings of the points", Statements(_on_points(verdicts)), Shown.PAGE)
    if results and all(TORQUE_DISC in result.history for result in results.values()):

        def draw(path: Path) -> Path:
            from emclutch.results.pictures.torque import torque_overlay_picture

            return torque_overlay_picture(path, results)

        report.add("Torques", Picture("torques of the points against time", draw=draw))
    folded = [Statements(said, folded=label) for label, said in verdicts.items()]
    report.add("Verdict on each point", folded)
    on = {label: effects_of(result) for label, result in results.items()}
    if (first := next(iter(results.values()), None)) is not None:
        report.add("Effects, on and off", effects_table([*itertools.chain(*on.values())], omitted_of(first)))
        differ = [name for name in EffectsSection.names() if 0 < sum(name in each for each in on.values()) < len(on)]
        of = [(in_words(name), f"on at {'; '.join(label for label in on if name in on[label])}") for name in differ]
        report.add("Effects that are not on at all points", Table(of))
        report.add("Cost of all points, predicted and measured", cost_table([one.summary for one in results.values()]))
        scene = Text(
            first.folder.read_case() if first.folder.case.is_file() else "", "the scene as resolved, in SI units"
        )
        report.add("Scene of the first point", [Table([*first.folder.read_plan().get("decisions", {}).items()]), scene])
        report.add("Provenance of the first point", Table(flat(first.folder.read_provenance())))
    return report


def _progress(state: StudyState, total: int | None) -> list[Statement]:
    """Say how far a study has come, and how many of its torques are known."""
    counts = Counter(point.state for point in state.points.values())
    done, number = counts[DONE] + counts[KEPT], max(total or 0, len(state.points))
    known = [one for one in state.points.values() if one.state in (DONE, KEPT) and one.converged]
    widths = [(one.interval[1] - one.interval[0]) / abs(one.torque) for one in known if one.interval and one.torque]
    widest = max(widths, default=None)
    text = f"{done} of {number} points done"
    text += "".join(f", {counts[name]} {name}" for name in (RUNNING, FAILED, STOPPED) if counts[name])
    if state.seconds_left is not None and state.is_running:
        text += f"; about {format_duration(state.seconds_left)} left"
    if done and len(known) < done:
        text += f"; the torque of {len(known)} of them has converged"
    if widest is not None:
        text += f", to ± {50.0 * widest:.2g} % or better (95 %)"
    if done and len(known) < done and not state.is_running:
        text += "; reasons and remedies: column reason of study.csv"
    complete = done == number == len(known)
    lines = [Statement(Mark.GOOD if complete else Mark.NOTE if state.is_running else Mark.WARNING, f"{text}.")]
    return [*lines, note("Friction and fill of the powder are taken as given; emclutch check estimates their range.")]


def _corrections(folder: Path) -> list[Statement]:
    return [note(line) for line in best_estimate_lines(folder)] if is_study(folder) else []


def _points(state: StudyState) -> list[Block]:
    """Return the table of the points, those that failed or run first."""
    names = sorted(state.points, key=lambda name: ORDER[state.points[name].state])
    table = [_cells(name, state.points[name]) for name in names[:MAX_ROWS]]
    head = ("point", "state", "best estimate", "verdict", "took")
    more = max(0, len(names) - MAX_ROWS)
    return [
        Table(table, head, numbers=[4]),
        Text(f"{more} more points; finished ones are in study.csv" if more else ""),
    ]


def _cells(name: str, point: PointRow) -> tuple[str, ...]:
    is_done = point.state in (DONE, KEPT)
    state = f"running, {100.0 * point.fraction:.0f} %" if point.state == RUNNING else point.state
    measured = format_mean(point.torque, point.interval) if point.stress is None else f"{point.stress:.4g} Pa"
    return (
        Link(name, f"{name}/{INDEX}") if is_done else name,
        state,
        measured if is_done else "",
        ("converged" if point.converged else "not converged") if is_done else "",
        "" if point.seconds is None else format_duration(point.seconds),
    )


def _methods(path: Path) -> Table | None:
    """Return torque, time of locking and wall-clock time by both contact methods, of each point; None without them."""
    if not path.is_file():
        return None
    import pandas  # local, as above

    table = pandas.read_csv(path)
    names = list(table.columns)
    values = names[: next(k for k, name in enumerate(names) if name.endswith(("_dem", "_dvi")))]
    shown = [name for name in METHODS if name in names]
    cells = table[shown].map(lambda value: "none" if pandas.isna(value) else f"{value:.4g}")
    rows = pandas.concat([table[values].astype(str), cells], axis=1).to_numpy().tolist()
    head = [*(name.rpartition(".")[2] for name in values), *(METHODS[name] for name in shown)]
    return Table(rows, head, range(len(values), len(head)))


def _failures(state: StudyState) -> list[Block]:
    """Return what points have failed of, with the last lines of their logs."""
    blocks: list[Block] = []
    for name, reason in [*state.failures.items()][:MAX_FAILURES]:
        label = state.points[name].label if name in state.points else name
        what = name if label == name else f"{name} ({label})"
        blocks.append(Statements([Statement(Mark.UNUSABLE, f"{what}: {reason}")]))
        blocks.append(Text(_last_lines(state.folder / name / "run.log")))
    more = max(0, len(state.failures) - MAX_FAILURES)
    return [*blocks, Text(f"{more} more, in failures.csv" if more else "")]


def _last_lines(path: Path) -> str:
    """Return the last lines of a log; empty where there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - 4000))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    return "\n".join(text.splitlines()[-MAX_LINES:])


def _on_points(verdicts: Mapping[str, Sequence[Statement]]) -> list[Statement]:
    """Return warnings of points, each text once, with the points that it is said of."""
    of: dict[tuple[Mark, str], list[str]] = {}
    for label, statements in verdicts.items():
        for one in statements:
            if one.mark in (Mark.UNUSABLE, Mark.WARNING):
                of.setdefault((one.mark, one.text), []).append(label)
    every = len(verdicts)
    return [
        Statement(mark, f"{'all points' if len(labels) == every > 1 else '; '.join(labels)}: {text}")
        for (mark, text), labels in of.items()
    ]


def best_estimate_lines(folder: Path) -> list[str]:
    """Return how far a study's raw torques are from their best estimates, in words; empty where they are the same."""
    import pandas  # local, as above

    table, name = pandas.read_csv(folder / TABLE), BEST_ESTIMATE[0]
    if name not in table:
        return []
    known = table[table[name].notna() & table["torque"].notna()]
    known = known[known[name] != 0.0]
    excess = sorted({f"{100.0 * ratio - 100.0:+.2g}" for ratio in known["torque"] / known[name]}, key=float)
    if not excess:
        return []
    share = f"{excess[0]} %" if len(excess) == 1 else f"{excess[0]} to {excess[-1]} %"
    points = "all points" if len(known) == len(table) else f"{len(known)} of {len(table)} points"
    return [
        f"Numerical settings and coarse grains change the raw torque of {points} by {share}, which is corrected in the "
        f"best estimates ({BEST_ESTIMATE[0]} of study.csv)."
    ]


def grain_size_lines(folder: Path) -> list[str]:
    """Return the laws of the grain size of a study in words; none where its grains have one size."""
    return [line for curve in grain_size_curves(folder) for line in curve["reason"].split("\n")]


def grain_size_curves(folder: Path) -> list[dict[str, Any]]:
    """Return what ``grain_size.json`` has of each curve; none where the grains of a study have one size."""
    path = folder / "grain_size.json"
    return json.loads(path.read_text(encoding="utf-8"))["curves"] if path.is_file() else []
