"""Content of a report on a run or a study: a list of sections, which `render` writes as HTML or as Markdown."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from emclutch.effects import EffectsSection
from emclutch.effects.omitted_effect import ALWAYS, OFF, OmittedEffect
from emclutch.results import COLUMNS, OutputError, Result, RunFolder, load_result
from emclutch.results.accuracy_study import SettingError
from emclutch.results.changing_drive import STEADY, changing_drive
from emclutch.results.columns import (
    CURRENT,
    DISSIPATED,
    ENERGY_RESIDUAL,
    SHEAR_STRESS,
    TIME,
    TORQUE_DISC,
    WORK_BOX_MAGNETIC,
    WORK_LAGGED,
    WORK_MAGNETIC,
    WORK_PRESSURE,
    WORK_SHEAR,
    WORK_WALLS,
)
from emclutch.results.grain_profiles import profile_column, read_profiles
from emclutch.results.replicated_mean import drift_in_words
from emclutch.results.report.verdict import RPM, Mark, Statement, best_in_words, in_words, sentence, verdict
from emclutch.results.rise_time import in_words as in_words_of_rise
from emclutch.results.statistics import ONE_REPLICA
from emclutch.results.study_folder import StudyFolder, is_study, read_study, refresh_in_words
from emclutch.results.study_result import best_estimate_lines, grain_size_lines
from emclutch.results.text import format_percent, format_stress, format_time, format_torque

AT_THE_END = ("coil current", "voltage", "copper loss", "flux density")  # rows of quantities of the last window

RARE = 0.1  # of the replicas have a state whose chance to be missed is said

OmittedEffectsOf = Callable[[Result], Sequence[OmittedEffect]]
"""What the scene of a run leaves out, see `emclutch.simulation.check`."""

PICTURES = {
    "section.png": "flux density and flux lines in the cross-section",
    "gap.png": "radial flux density in the middle of the gap, unrolled",
    "torque.png": "torque against time",
    "torque_vs_current.png": "torque against the coil's current",
    "stress.png": "stress against strain",
    "speeds.png": "speeds of the shafts against time",
    "grains.png": "grains and the forces between them",
    "profiles.png": "flow and stress across the gap",
    "wall_pressure.png": "load of the walls by the grains",
}
"""Pictures that a run may have, and what they show."""
STUDY_PICTURES = {
    "torque_vs_current.png": "torque against the coil's current",
    "torque_vs_speed.png": "torque against the motor's speed",
    "grain_size.png": "torque against the size of the grains",
    "speeds.png": "speeds of the shafts against time",
}
FILES = {
    "report.html": "the report: all that is known of the run, or of the points",
    "summary.json": "the result for programs",
    "history.csv": "a row a coupling window",
    "profiles.csv": "means across the gap",
    "study.csv": "a row a point, units in study.json",
    "torque_vs_current.csv": "torque against current",
    "measured.csv": "measured torque against current",
    "torque_vs_speed.csv": "torque against speed",
    "grain_size.csv": "torque against the size of the grains",
    "failures.csv": "points that failed, with the reason",
    "case.toml": "the scene as resolved, in SI units",
    "run.log": "what was decided, and when",
    "study.log": "what became of each point",
    "particles.pvd": "grains in time, for ParaView",
    "field.pvd": "the field in time, for ParaView",
}
"""Files of a run or a study for people to open."""
SHORT = ("Conclusion", "Operating point", "Verdict", "Points", "Pictures", "Torque with its errors", "Files")
"""Sections of the page that a run writes into its folder."""
PARTS = ("start", "field", "magnetic", "contact", "output", "compiling", "total")
ENERGIES = (
    "coil_supplied",
    WORK_WALLS,
    WORK_SHEAR,
    WORK_PRESSURE,
    WORK_BOX_MAGNETIC,
    WORK_MAGNETIC,
    WORK_LAGGED,
    "work_gravity",
    DISSIPATED,
    ENERGY_RESIDUAL,
)
NUMBERS = (
    ("current", "current at the end", "A"),
    ("turns", "turns of the coil", ""),
    ("gap_flux_density", "mean flux density under the poles", "T"),
    ("flux_linkage", "flux linkage", "Wb"),
    ("lock_up_time", "lock-up time", "s"),
    ("current_rise_time", "current's rise to 63 % of its final value", "s"),
    ("gap_flux_density_rise_time", "gap field's rise to 63 % of its final value", "s"),
    ("torque_rise_time", "torque's rise to 63 % of its final value", "s"),
    ("torque_rise_time_90", "torque's rise to 90 % of its final value", "s"),
    ("torque_lag", "torque's rise over the current's, 63 % (class: 1.7 to 4)", ""),
    ("shear_rate", "shear rate", "1/s"),
    ("shear_strain", "shear strain at the end", ""),
    ("inertial_number", "inertial number", ""),
    ("inertial_number_of_shear_stress", "inertial number of the shear stress", ""),
    ("solid_fraction", "solid fraction of the box", ""),
    ("contacts_per_grain", "contacts of a grain, mean of the steady part", ""),
    ("relative_permeability", "relative permeability of the powder", ""),
    ("figure_of_merit", "figure of merit, 1 / (relative standard error^2 x processor time)", "1/s"),
    ("grains", "grains simulated", ""),
    ("sectors", "sectors in the ring", ""),
    ("dt", "step of the grains", "s"),
    ("window", "coupling window", "s"),
    ("time", "simulated time", "s"),
    ("max_overlap", "largest overlap over diameter, at any time", ""),
    ("typical_overlap", "the same, median over the windows of the second half", ""),
    ("torque_residual_rms", "torque balance, RMS of the residual", "N m"),
    ("energy_residual_relative", "energy balance, residual over the energy supplied, exchanged and dissipated", ""),
    ("work_magnetic_over_slip", "work of the magnetic forces over that of the walls, when steady", ""),
)
"""Of a summary: key, label and unit."""
STRUCTURE = {
    "coordination": "contacts a grain, walls included",
    "rattlers": "fraction of grains with fewer than two contacts",
    "fabric_anisotropy": "anisotropy of the contacts' directions (0 none, 1 all parallel)",
    "force_anisotropy": "the same, weighed by normal force",
    "in_chains": "fraction of grains in force chains",
    "longest_chain": "grains in the longest force chain",
}


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells under a head; without one the first cell is the label of the row.

    `numbers` are the columns to be aligned to the right. A block with a text in `folded` opens on demand under it.
    `stacked`: on a narrow screen a row becomes a paragraph; `report.html.j2` names the columns of the effects in it.
    """

    rows: Sequence[Sequence[str]]
    head: Sequence[str] = ()
    numbers: Sequence[int] = ()
    folded: str = ""
    stacked: bool = False
    kind: ClassVar[str] = "table"


@dataclass(frozen=True, slots=True)
class Statements:
    """Lines of a verdict."""

    lines: Sequence[Statement]
    folded: str = ""
    kind: ClassVar[str] = "statements"


@dataclass(frozen=True, slots=True)
class Text:
    """Text that is shown as it is."""

    text: str
    folded: str = ""
    kind: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture in the folder, or one that `draw` writes for a page that has its pictures inside."""

    what: str
    path: Path | None = None
    draw: Callable[[Path], Path] | None = None
    folded: ClassVar[str] = ""
    kind: ClassVar[str] = "picture"

    def png(self) -> bytes:
        """Return the picture's bytes."""
        if self.path is not None:
            return self.path.read_bytes()
        assert self.draw is not None
        with tempfile.TemporaryDirectory() as place:
            return self.draw(Path(place) / "picture.png").read_bytes()


@dataclass(frozen=True, slots=True)
class Links:
    """Files beside the page, and what is in them."""

    files: Sequence[tuple[str, str]]
    folded: ClassVar[str] = ""
    kind: ClassVar[str] = "links"


Block = Table | Statements | Text | Picture | Links


@dataclass(frozen=True, slots=True)
class Page:
    """Title, a line under it, the torque, and sections of blocks by their headings; empty ones are left out."""

    folder: Path
    title: str
    under: str
    sections: dict[str, list[Block]]

    def short(self) -> Page:
        """Return the page for who wants the result alone; without pictures that would have to be drawn."""
        chosen = {name: self.sections[name] for name in SHORT if name in self.sections}
        chosen = {
            name: [one for one in blocks if not isinstance(one, Picture) or one.path is not None]
            for name, blocks in chosen.items()
        }
        return Page(self.folder, self.title, self.under, chosen)


def page_of(folder: Path, omitted_effects_of: OmittedEffectsOf) -> Page:
    """Return the page of the run or the study in a folder; OutputError where there is neither."""
    if is_study(folder):
        return study_page(read_study(folder), omitted_effects_of)
    return run_page(load_result(folder), omitted_effects_of)


def run_page(result: Result, omitted_effects_of: OmittedEffectsOf) -> Page:
    """Return the page of a run, finished or not."""
    folder, summary = result.folder, result.summary
    on, omitted_effects = effects_of(result), omitted_effects_of(result)
    known = [COLUMNS[name] for name in result.history.columns]
    columns = [(one, one.unit, f"{one.meaning} ({one.when.value})") for one in known]
    name = folder.path.resolve().name
    return Page(
        folder.path,
        summary.get("title") or name,
        f"run {name}",
        {
            "Conclusion": [Statements(conclusion(result))],
            "Operating point": _rows(_operating_point(result)),
            "Verdict": [Statements(verdict(result))],
            "Scene": _scene(folder),
            "Effects, on and off": [_effects(on, omitted_effects)],
            "Pictures": _pictures(result),
            "Torque with its errors": _rows(_torques(result)),
            "Balances": _rows(_balances(result)),
            "Numbers": _rows(_numbers(summary)),
            "Cost, predicted and measured": _cost([summary]),
            "Provenance": _rows(_flat(folder.read_provenance())),
            "Files": [
                *_links(folder.path),
                _columns("history.csv", columns),
                *_profile_columns(folder.path),
            ],
        },
    )


def study_page(study: StudyFolder, omitted_effects_of: OmittedEffectsOf) -> Page:
    """Return the page of a study: the points that are done."""
    results = study.results()
    verdicts = {label: verdict(result) for label, result in results.items()}
    torques = {label: _measured(result) for label, result in results.items()}
    on = {label: effects_of(result) for label, result in results.items()}
    first = next(iter(results.values()), None)
    omitted_effects = () if first is None else omitted_effects_of(first)
    over = f", over {', '.join(study.varied)}" if study.varied else ""
    corrected = [Statement(Mark.NOTE, line) for line in best_estimate_lines(study.path)]
    statements = [*_progress(study, results), *corrected, *_on_points(verdicts)]
    points = [
        [
            str(row["folder"]), *(str(row[key]) for key in study.varied), torques[label] or "none",
            "yes" if result.steady is not None and result.steady.converged else "NO", format_time(row["seconds"]),
        ]
        for (label, result), (_, row) in zip(results.items(), study.table.iterrows(), strict=True)
    ]  # fmt: skip
    compared = study.path / "methods.txt"
    head = ("point", *study.varied, _measured_name(results), "converged", "took")
    return Page(
        study.path,
        study.title,
        f"study {study.path.resolve().name}{over}",
        {
            "Verdict": [Statements(statements)],
            "Points": [Table(points, head, numbers=[len(head) - 1])] if points else [],
            "Pictures": _study_pictures(study.path, results),
            "Size of the grains": [Text(sizes)] if (sizes := "\n".join(grain_size_lines(study.path))) else [],
            "Methods": [Text(compared.read_text(encoding="utf-8"))] if compared.is_file() else [],
            "Verdict on each point": [
                Statements(said, folded=f"{label}: {torques[label] or 'no torque'}") for label, said in verdicts.items()
            ],
            "Effects, on and off": [_effects(list(itertools.chain(*on.values())), omitted_effects)] if on else [],
            "Effects that are not on at all points": _rows(
                [
                    (name, f"on at {'; '.join(label for label in on if name in on[label])}")
                    for name in EffectsSection.names()
                    if 0 < sum(name in each for each in on.values()) < len(on)
                ]
            ),
            "Cost of all points, predicted and measured": _cost([result.summary for result in results.values()]),
            "Files": _links(study.path),
            "Scene of the first point": [] if first is None else _scene(first.folder),
            "Provenance of the first point": [] if first is None else _rows(_flat(first.folder.read_provenance())),
        },
    )


def effects_of(result: Result) -> list[str]:
    """Return names of the effects that a run has, by its summary; of one without, by its scene."""
    if "effects" in result.summary:
        return list(result.summary["effects"])
    try:
        return list(result.folder.read_scene().get("effects", {}))
    except OutputError:  # a folder that lost its scene has a history all the same
        return []


def conclusion(result: Result) -> list[Statement]:
    """Return the best estimate of the torque, the raw one where they differ, and the first reservation."""
    summary, found = result.summary, result.steady
    against = [one.text for one in verdict(result) if one.mark is Mark.POOR]
    second = Statement(Mark.GOOD, "The verdict has no reservation.")
    if against:
        number = "one reservation" if len(against) == 1 else f"{len(against)} reservations, the first"
        second = Statement(Mark.POOR, f"The verdict has {number}: {against[0]}")
    rises = [Statement(Mark.NOTE, sentence(line)) for line in in_words_of_rise(summary)]
    if found is None or found.mean is None or (not found.is_steady and changing_drive(result.history, found.start)):
        return [*rises, Statement(Mark.NOTE, "The run has no steady torque."), second]
    current = summary.get("current") if _current_is_steady(result) else None
    at = "" if current is None else f" at {current:.4g} A"
    slip = summary.get("slip")
    at += f"{' and' if at else ' at'} {slip * RPM:.4g} rpm of slip" if slip else ""
    shown = _measured(result)
    first = f"The {_measured_name({'': result})}{at} is {shown}"
    ending = f"; it is of {ONE_REPLICA}" if found.steady_alone else "; it has not converged"
    first += "." if found.converged else f"{ending}."
    sentences = [Statement(Mark.GOOD if found.converged else Mark.POOR, first)]
    if TORQUE_DISC in result.history and (best := best_in_words(result)) is not None:
        sentences.insert(0, Statement(Mark.GOOD if found.converged else Mark.POOR, sentence(best)))
    return [*rises, *sentences, second]


def _current_is_steady(result: Result) -> bool:
    """Whether the current is the same, to 1 %, in all windows that the torque is the mean of."""
    if CURRENT not in result.history or result.steady is None or result.steady.start is None:
        return True
    averaged = result.history[CURRENT][result.history[TIME] >= result.steady.start]
    return bool(np.ptp(averaged) <= STEADY * averaged.abs().max())


def _operating_point(result: Result) -> list[tuple[str, str]]:
    summary = result.summary
    units = {
        "current": ("coil current", "A", 1.0), "voltage": ("voltage at the coil's resistance", "V", 1.0),
        "copper_loss": ("copper loss", "W", 1.0), "gap_flux_density": ("flux density in the gap", "T", 1.0),
        "slip": ("slip", "rpm", RPM), "slip_heat": ("slip heat", "W", 1.0),
        "shear_stress": ("shear stress between the poles, at most", "kPa", 1e-3),
    }  # fmt: skip
    rows = [
        (label, f"{factor * summary[key]:.4g} {unit}")
        for key, (label, unit, factor) in units.items()
        if isinstance(summary.get(key), float)
    ]
    if shown := _measured(result):
        rows.insert(0, (_measured_name({"": result}), shown))
    if not _current_is_steady(result):
        rows = [(f"{name}, at the run's end" if name.startswith(AT_THE_END) else name, value) for name, value in rows]
    elif expected := summary.get("expected_torque"):
        low, mean, high = (f"{expected[name]:.2g}" for name in ("low", "mean", "high"))
        rows.append(("estimate before the run", f"{mean} N m ({low} to {high}), {expected['law']}"))
    return rows


def _links(folder: Path) -> list[Block]:
    found = [(name, what) for name, what in FILES.items() if (folder / name).is_file()]
    return [Links(found)] if found else []


def _rows(rows: Sequence[Sequence[str]]) -> list[Block]:
    return [Table(rows)] if rows else []


def _measured(result: Result) -> str:
    """Return torque or stress of a run; empty where it has neither."""
    if SHEAR_STRESS in result.history:
        return format_stress(result.stress)
    return format_torque(result.torque) if TORQUE_DISC in result.history else ""


def _measured_name(results: dict[str, Result]) -> str:
    return "shear stress" if any(SHEAR_STRESS in one.history for one in results.values()) else "torque on the disc"


def _scene(folder: RunFolder) -> list[Block]:
    """Return the plan of a run and its scene."""
    case = folder.read_case() if folder.case.is_file() else ""
    text = [Text(case, "the scene as resolved, in SI units (case.toml)")] if case else []
    return [*_rows([*folder.read_plan().get("decisions", {}).items()]), *text]


def _progress(study: StudyFolder, results: dict[str, Result]) -> list[Statement]:
    """Say how far a study has come, and what went wrong."""
    done = len(results)
    known = sum(one.steady is not None and bool(one.steady.converged) for one in results.values())
    lines = [
        Statement(Mark.GOOD, f"All {done} points are done.")
        if study.points is None or study.points <= done
        else Statement(Mark.POOR, f"{done} of {study.points} points are done.")
    ]
    if done:
        worst = _widest(results.values())
        precision = f"; half of the widest 95 % interval is {worst} of its mean" if worst else ""
        text = f"The {_measured_name(results)} is converged at {known} of {done} points{precision}."
        if alone := sum(one.steady is not None and one.steady.steady_alone for one in results.values()):
            text += f" {alone} points are each of {ONE_REPLICA}."
        lines.append(Statement(Mark.GOOD if known == done else Mark.POOR, text))
    if outdated := refresh_in_words(study):
        lines.append(Statement(Mark.POOR, sentence(outdated)))
    return lines + [Statement(Mark.POOR, f"{name}: {one.in_words()}.") for name, one in study.failures().items()]


def _on_points(verdicts: dict[str, list[Statement]]) -> list[Statement]:
    """Return what speaks against points, each text once, with the points that it is said of."""
    of: dict[str, list[str]] = {}
    for label, statements in verdicts.items():
        for one in statements:
            if one.mark is Mark.POOR:
                of.setdefault(one.text, []).append(label)
    every = len(verdicts)
    return [
        Statement(Mark.POOR, f"{'all points' if len(labels) == every > 1 else '; '.join(labels)}: {text}")
        for text, labels in of.items()
    ]


def _effects(on: Sequence[str], omitted_effects: Sequence[OmittedEffect]) -> Table:
    """Return every effect of this version, on or off, and of those omitted the significance."""
    of = {line.effect: line for line in omitted_effects}
    rows = []
    for name in dict.fromkeys([*EffectsSection.names(), *of]):
        field, line = EffectsSection.model_fields.get(name), None if name in on else of.get(name)
        state = "on" if name in on else OFF if line is None else line.where
        what = "" if field is None else str(field.description)
        relevant = "" if line is None else line.verdict.lower() if line.where == ALWAYS else line.verdict
        share, number = ("", "") if line is None else (line.on_torque, line.in_words())
        rows.append((name.replace("_", " "), state, what, relevant, share, number))
    head = ("effect", "", "what it is", "relevant?", "torque, about", "criterion (limit)")
    return Table(rows, head, stacked=True)


def _pictures(result: Result) -> list[Block]:
    """Return the pictures in the folder of a run, and its torque where it has drawn none."""
    found = _in_folder(result.folder.path, PICTURES)
    if TORQUE_DISC not in result.history or result.folder.torque_picture.is_file():
        return found

    def draw(path: Path) -> Path:
        from emclutch.results.pictures.torque import torque_picture

        return torque_picture(path, result.history, result.torque, result.other_histories)

    return [*found, Picture(PICTURES["torque.png"], draw=draw)]


def _study_pictures(folder: Path, results: dict[str, Result]) -> list[Block]:
    """Return the pictures in the folder of a study, and the torques of its points over one another."""
    found = _in_folder(folder, STUDY_PICTURES)
    if not results or not all(TORQUE_DISC in result.history for result in results.values()):
        return found

    def draw(path: Path) -> Path:
        from emclutch.results.pictures.torque import torque_overlay_picture

        return torque_overlay_picture(path, results)

    return [*found, Picture("torques of the points against time", draw=draw)]


def _in_folder(folder: Path, names: dict[str, str]) -> list[Block]:
    return [Picture(what, folder / name) for name, what in names.items() if (folder / name).is_file()]


def _torques(result: Result) -> list[tuple[str, str]]:
    if TORQUE_DISC not in result.history:
        return []
    torque, summary = result.torque, result.summary
    rows = [("torque on the disc", format_torque(torque)), ("replicas", str(torque.replicas))]
    if torque.replicas > 1:
        missed = 100.0 * (1.0 - RARE) ** torque.replicas
        rare = f"a state of {100.0 * RARE:g} % of replicas"
        rows.append((rare, f"in none of these with a probability of {missed:.2g} %"))
    if torque.pooled_scatter is not None:
        known = f"{format_percent(torque.pooled_scatter)} with {torque.pooled_freedom:g} degrees of freedom"
        rows.append(("scatter between replicas that is pooled with theirs", known))
    if torque.drift is not None:
        rows.append(("drift over the averaged part", drift_in_words(torque)))
    if torque.start is not None:
        rows.append(("steady part begins at", format_time(torque.start)))
    if torque.correlation_time is not None:
        rows.append(("correlation time", format_time(torque.correlation_time)))
    rows.append(("verdict", torque.reason))
    replicas = summary.get("replicas") or {}
    rows += [
        (f"mean of replica {number} (seed {seed})", "none" if mean is None else f"{mean:.5g} N m")
        for number, (seed, mean) in enumerate(zip(replicas.get("seeds", []), replicas.get("means", []), strict=True))
    ]
    for key, label in (("torque_rotor", "on the rotor"), ("torque_field", "taken by the field")):
        if summary.get(key, {}).get("mean") is not None:
            rows.append((f"torque {label}", f"{summary[key]['mean']:.5g} N m"))
    found = summary.get("discretisation_error") or {}
    for name, part in found.get("parts", {}).items():
        low, high = SettingError(part["bias"], part["half_width"]).interval
        error = f"{100.0 * part['bias']:+.2g} % (95 %: {100.0 * low:+.2g} to {100.0 * high:+.2g} %)"
        rows.append((f"error by the setting of {in_words(name)}", f"{error}, at {part['value']:.4g}"))
    if found:
        rows.append(("accuracy study", f"{found['accuracy_study']['file']} ({found['accuracy_study']['date']})"))
    return rows


def _balances(result: Result) -> list[tuple[str, str]]:
    """Return each balance and residual with what it is compared with; energies are sums over the run."""
    summary, history = result.summary, result.history
    rows = [
        (f"energy: {name.replace('_', ' ')}", f"{history[name].sum():.4g} J") for name in ENERGIES if name in history
    ]
    rows += [
        (f"energy: change of {name.replace('_', ' ')}", f"{history[name].iloc[-1] - history[name].iloc[0]:.4g} J")
        for name in ("kinetic_energy", "elastic_energy", "magnetic_energy")
        if name in history
    ]
    for part, label in (("feedback", "moments in the field's solve"), ("moments", "moments of the grains")):
        if found := summary.get(part):
            rows.append((label, f"residual {found['worst_residual']:.2g} at worst, tolerance {found['tolerance']:.2g}"))
    if found := summary.get("solver"):
        text = (
            f"{found['worst_residual']:.2g} m/s off the law of contact at worst, tolerance {found['tolerance']:.2g} m/s"
        )
        rows.append(("contacts by DVI", f"{text}; {100.0 * found['missed_share']:.2g} % of the steps missed it"))
    return rows


def _numbers(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return rows of device, course and numerics of a summary: label and value with its unit."""
    rows = [
        (label, f"{summary[key]:.5g} {unit}".strip()) for key, label, unit in NUMBERS if summary.get(key) is not None
    ]
    rows += [
        (f"at the end: {label}", f"{summary['structure'][key]:.3g}")
        for key, label in STRUCTURE.items()
        if summary.get("structure", {}).get(key) is not None  # a summary of an earlier version has none
    ]
    for key, label in (("current", "current"), ("gap_flux_density", "gap field")):
        if note := summary.get(f"{key}_rise_time_note"):
            rows.append((f"{label}'s rise", f"not over: {note}"))
    for share, key in (("63", "torque_rise_time_interval"), ("90", "torque_rise_time_90_interval")):
        if interval := summary.get(key):
            low, high = interval
            end = "beyond the end of the run" if high is None else f"{high:.5g} s"
            rows.append((f"torque's rise to {share} %, 95 % interval", f"{low:.5g} s to {end}"))
    if summary.get("torque_rise_too_short"):
        rows.append(
            ("torque's rise", f"run too short: time.end = {summary['torque_rise_required_end']:.3g} s or later")
        )
    errors = summary.get("field_error_estimate") or {}
    return rows + [(f"estimated relative error of the field: {goal}", f"{error:.2g}") for goal, error in errors.items()]


def _cost(summaries: Sequence[dict[str, Any]]) -> list[Block]:
    """Return predicted and measured wall-clock seconds by part, summed over runs, and measured over predicted."""
    seconds = [summary["seconds"] for summary in summaries if summary]
    rows = []
    for part in PARTS:
        predicted = [one["predicted"][part] for one in seconds if part in one.get("predicted", {})]
        measured = [one.get("whole_run" if part == "total" else part) for one in seconds]
        found = [value for value in measured if value is not None]
        if any(predicted) or any(found):
            rows.append(
                (
                    part,
                    f"{sum(predicted):.1f} s" if predicted else "not predicted",
                    f"{sum(found):.1f} s" if found else "not measured by itself",
                    f"{sum(found) / sum(predicted):.2g}" if found and sum(predicted) > 0.0 else "",
                )
            )
    return [Table(rows, ("part", "predicted", "measured", "measured over predicted"), (1, 2, 3))] if rows else []


def _widest(results: Iterable[Result]) -> str:
    """Return half the widest 95 % interval, relative to its mean; empty where one is unknown."""
    shares = []
    for result in results:
        torque = result.steady
        half = None if torque is None else torque.half_width()
        if torque is None or half is None or not torque.mean:
            return ""
        shares.append(half / abs(torque.mean))
    return f"{100.0 * max(shares):.2g} %" if shares else ""


def _flat(values: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return nested values as rows: keys joined by a point, each value as text; what is None or empty is left out."""
    if isinstance(values, dict):
        return [row for key, value in values.items() for row in _flat(value, f"{prefix}.{key}" if prefix else str(key))]
    if isinstance(values, list) and values and isinstance(values[0], dict):
        return [row for number, value in enumerate(values) for row in _flat(value, f"{prefix}[{number}]")]
    if values is None or values == []:
        return []
    return [(prefix, " ".join(map(str, values)) if isinstance(values, list) else str(values))]


def _columns(file: str, columns: Sequence[tuple[str, str, str]]) -> Table:
    return Table(columns, ("column", "unit", "meaning"), folded=f"columns of {file}")


def _profile_columns(folder: Path) -> list[Block]:
    path = folder / "profiles.csv"
    if not path.is_file():
        return []
    names = dict.fromkeys(name for table in read_profiles(path).values() for name in table)
    return [_columns(path.name, [(name, *profile_column(name)) for name in names])]
