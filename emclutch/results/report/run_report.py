"""The report on a run: verdict, operating point, plan, effects, pictures, numbers, balances, cost, files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.effects import EffectsSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.accuracy_study import SettingError
from emclutch.results.column_table import COLUMNS
from emclutch.results.columns import (
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
from emclutch.results.errors import OutputError
from emclutch.results.grain_profiles import profile_column, read_profiles
from emclutch.results.quantities import QUANTITIES
from emclutch.results.quantity import NUMBERS, OPERATING_POINT, rows
from emclutch.results.replicated_mean import drift_in_words
from emclutch.results.report.render import write_index
from emclutch.results.report.report import Block, Links, Picture, Report, Shown, Statements, Table, Text
from emclutch.results.report.verdict import current_is_steady, measured_name, verdict
from emclutch.results.run_folder import RunFolder
from emclutch.results.text import format_estimate, format_percent, format_stress, format_time, format_torque, in_words
from emclutch.settings import UNITS

if TYPE_CHECKING:
    from emclutch.results.result import Result

RARE = 0.1  # of the replicas have a state whose chance to be missed is said

OmittedEffectsOf = Callable[["Result"], Sequence[OmittedEffect]]
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
FILES = {
    "report.html": "the full report of the run, or of the points",
    "summary.json": "the result for programs",
    "history.csv": "one row per coupling window",
    "profiles.csv": "means across the gap",
    "study.csv": "one row per point, units in study.json",
    "torque_vs_current.csv": "torque against current",
    "measured.csv": "measured torque against current",
    "torque_vs_speed.csv": "torque against speed",
    "grain_size.csv": "torque against the size of the grains",
    "failures.csv": "points that failed, with the reason",
    "case.toml": "the scene as resolved, in SI units",
    "run.log": "decisions of the run, with their times",
    "study.log": "result of each point",
    "particles.pvd": "grains in time, for ParaView",
    "field.pvd": "the field in time, for ParaView",
}
"""Files of a run or a study for people to open."""
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


def run_report(result: Result, omitted: Sequence[OmittedEffect] = ()) -> Report:
    """Return the report on a run, finished or not; `omitted`: what its scene leaves out."""
    folder, summary, name = result.folder, result.summary, result.folder.path.resolve().name
    known = [COLUMNS[one] for one in result.history.columns]
    columns = [(one, one.unit, f"{one.meaning} ({one.when.value})") for one in known]
    report = Report(summary.get("title") or name, f"run {name}", data=summary, folder=folder.path)
    report.add("Result", Statements(verdict(result)), Shown.TERMINAL)
    report.add("Operating point", Table(_operating_point(result)), Shown.PAGE)
    report.add("Pictures", _pictures(result), Shown.PAGE)
    report.add("Torque with its errors", Table(_torques(result)), Shown.PAGE)
    report.add("Effects, on and off", effects_table(effects_of(result), omitted))
    report.add("Plan", _scene(folder))
    report.add("Balances", Table(_balances(result)))
    report.add("Numbers", Table(_numbers(summary)))
    report.add("Cost, predicted and measured", cost_table([summary]))
    report.add("Provenance", Table(flat(folder.read_provenance())))
    report.add("Files", links(folder.path), Shown.PAGE)
    report.add("Columns", [_columns("history.csv", columns), _profile_columns(folder.path)])
    return report


def write_failed_index(folder: RunFolder, reason: str) -> None:
    """Write that a run fails for its scene, and an ``index.html`` that says so: what, at which time, what to do."""
    folder.write_failure(reason)
    with suppress(OSError, OutputError):  # what it failed of is reported all the same
        if (failed := folder.read_failure()) is not None:
            title = folder.read_scene().get("scene", {}).get("title") or folder.path.name
            report = Report(f"{title}: failed", failed.in_words(), folder=folder.path)
            report.add("Log", Links([(folder.log.name, "log of the run")]), Shown.PAGE)
            write_index(report)


def effects_of(result: Result) -> list[str]:
    """Return names of the effects that a run has, by its summary; of one without, by its scene."""
    if "effects" in result.summary:
        return list(result.summary["effects"])
    try:
        return list(result.folder.read_scene().get("effects", {}))
    except OutputError:  # a folder that lost its scene has a history all the same
        return []


def measured(result: Result) -> str:
    """Return torque or stress of a run; empty where it has neither."""
    if SHEAR_STRESS in result.history:
        return format_stress(result.stress)
    return format_torque(result.torque) if TORQUE_DISC in result.history else ""


def _operating_point(result: Result) -> list[list[str]]:
    summary, steady = result.summary, current_is_steady(result)
    found = rows(QUANTITIES, OPERATING_POINT, summary, "" if steady else ", at the end of the run")
    if shown := measured(result):
        found.insert(0, [f"raw {measured_name(result)}", shown])
    if result.steady is not None and result.steady.is_steady and result.best != result.steady:
        found.insert(0, [measured_name(result), format_estimate(result.best)])
    scene = result.folder.read_scene() if result.folder.case.is_file() else {}
    effects, friction = scene.get("effects", {}), scene.get("contact", {}).get("friction")
    if friction is not None:
        rolling = effects.get("rolling_friction", {}).get("coefficient", 0.0)
        found.append(["powder, as given", f"friction {friction:.3g}, rolling friction {rolling:.3g}"])
        found.append(["effects in the run", ", ".join(map(in_words, effects))])
    if steady and (expected := summary.get("expected_torque")):
        low, mean, high = (f"{expected[name]:.2g}" for name in ("low", "mean", "high"))
        found.append(["estimate before the run", f"{mean} N m ({low} to {high}), {expected['law']}"])
    return found


def links(folder: Path) -> Links:
    """Return the files in a folder that people open."""
    return Links([(name, what) for name, what in FILES.items() if (folder / name).is_file()])


def _scene(folder: RunFolder) -> list[Block]:
    """Return the plan of a run and its scene."""
    case = folder.read_case() if folder.case.is_file() else ""
    scene = Text(case, "the scene as resolved, in SI units (case.toml)")
    return [Table([*folder.read_plan().get("decisions", {}).items()]), scene]


def effects_table(on: Sequence[str], omitted: Sequence[OmittedEffect]) -> Table:
    """Return every effect of this version, and what no scene can have: on or off, and whether its absence matters."""
    of = {line.effect: line for line in omitted}
    table = []
    for name in dict.fromkeys([*EffectsSection.names(), *of]):
        field, line = EffectsSection.model_fields.get(name), None if name in on else of.get(name)
        state = "on" if name in on else OFF if line is None else line.where
        what = "" if field is None else str(field.description)
        matters = "" if line is None else line.verdict
        fraction, number = ("", "") if line is None else (line.on_torque, line.in_words())
        table.append((in_words(name), state, what, matters, fraction, number))
    head = ("effect", "", "what it is", "relevant in this run?", "effect on the torque", "criterion (limit)")
    return Table(table, head, stacked=True)


def _pictures(result: Result) -> list[Block]:
    """Return the pictures in the folder of a run, and its torque where it has drawn none."""
    found = pictures_in(result.folder.path, PICTURES)
    if TORQUE_DISC not in result.history or result.folder.torque_picture.is_file():
        return found

    def draw(path: Path) -> Path:
        from emclutch.results.pictures.torque import torque_picture

        return torque_picture(path, result.history, result.torque, result.other_histories, best=result.best)

    return [*found, Picture(PICTURES["torque.png"], draw=draw)]


def pictures_in(folder: Path, names: dict[str, str]) -> list[Block]:
    """Return the pictures of some names in a folder."""
    return [Picture(what, folder / name) for name, what in names.items() if (folder / name).is_file()]


def _torques(result: Result) -> list[tuple[str, str]]:
    if TORQUE_DISC not in result.history:
        return []
    torque, summary = result.torque, result.summary
    table = [("raw torque on the disc", format_torque(torque)), ("replicas", str(torque.replicas))]
    if torque.replicas > 1:
        missed = 100.0 * (1.0 - RARE) ** torque.replicas
        rare = f"one that occurs in {100.0 * RARE:g} % of replicas is missed here with a probability of {missed:.2g} %"
        table.append(("rare events, such as a jam", rare))
    if torque.pooled_scatter is not None:
        known = f"{format_percent(torque.pooled_scatter)} with {torque.pooled_freedom:g} degrees of freedom"
        table.append(("scatter between replicas that is pooled with theirs", known))
    if torque.drift is not None:
        table.append(("drift over the averaged part", drift_in_words(torque)))
    if torque.start is not None:
        table.append(("steady part begins at", format_time(torque.start)))
    if torque.correlation_time is not None:
        table.append(("correlation time", format_time(torque.correlation_time)))
    table.append(("verdict", torque.in_words()))
    replicas = summary.get("replicas") or {}
    table += [
        (f"mean of replica {number} (seed {seed})", "none" if mean is None else f"{mean:.5g} N m")
        for number, (seed, mean) in enumerate(zip(replicas.get("seeds", []), replicas.get("means", []), strict=True))
    ]
    for key, label in (("torque_rotor", "on the rotor"), ("torque_field", "taken by the field")):
        if summary.get(key, {}).get("mean") is not None:
            table.append((f"torque {label}", f"{summary[key]['mean']:.5g} N m"))
    error = summary.get("discretisation_error") or {}
    for name, part in error.get("parts", {}).items():
        low, high = SettingError(part["bias"], part["half_width"]).interval
        text = f"{100.0 * part['bias']:+.2g} % (95 %: {100.0 * low:+.2g} to {100.0 * high:+.2g} %)"
        table.append((f"error of {in_words(name)}", f"{text}, at {part['value']:.4g} {UNITS.get(name, '')}".rstrip()))
    if error:
        study = error["accuracy_study"]
        table.append(("accuracy study", f"{study['file']} ({study['date']})"))
    return table


def _balances(result: Result) -> list[tuple[str, str]]:
    """Return each balance and residual with what it is compared with.

    Energies are known at the ends of windows: sums and changes are those from the end of the first one on.
    """
    summary, history = result.summary, result.history
    after = history.iloc[1:]
    table = [("energies", f"from {format_time(float(history[TIME].iloc[0]))} to the end of the run")]
    table += [(f"energy: {in_words(name)}", f"{after[name].sum():.4g} J") for name in ENERGIES if name in history]
    table += [
        (f"energy: change of {in_words(name)}", f"{history[name].iloc[-1] - history[name].iloc[0]:.4g} J")
        for name in ("kinetic_energy", "elastic_energy", "magnetic_energy")
        if name in history
    ]
    for part, label in (("feedback", "moments in the field's solve"), ("moments", "moments of the grains")):
        if values := summary.get(part):
            text = f"residual {values['worst_residual']:.2g} at worst, tolerance {values['tolerance']:.2g}"
            table.append((label, text))
    if values := summary.get("solver"):
        text = f"residual {values['worst_residual']:.2g} m/s at worst, tolerance {values['tolerance']:.2g} m/s"
        table.append(("contacts by DVI", f"{text}; {100.0 * values['missed_share']:.2g} % of the steps missed it"))
    return table


def _numbers(summary: dict[str, Any]) -> list[list[str]]:
    """Return rows of device, course and numerics of a summary: label and value with its unit."""
    table = rows(QUANTITIES, NUMBERS, summary)
    for key, label in (("current", "current"), ("gap_flux_density", "gap field")):
        if text := summary.get(f"{key}_rise_time_note"):
            table.append([f"rise of the {label}", f"not over: {text}"])
    for percent, key in (("63", "torque_rise_time_interval"), ("90", "torque_rise_time_90_interval")):
        if interval := summary.get(key):
            low, high = interval
            end = "beyond the end of the run" if high is None else f"{high:.5g} s"
            table.append([f"rise of the torque to {percent} %, 95 % interval", f"{low:.5g} s to {end}"])
    if summary.get("torque_rise_too_short"):
        end = f"{summary['torque_rise_required_end']:.3g} s or later"
        table.append(["rise of the torque", f"run too short: time.end = {end}"])
    errors = summary.get("field_error_estimate") or {}
    return table + [[f"estimated relative error of the field: {goal}", f"{one:.2g}"] for goal, one in errors.items()]


def cost_table(summaries: Sequence[dict[str, Any]]) -> Table:
    """Return predicted and measured wall-clock seconds by part, summed over runs, and measured over predicted."""
    seconds = [summary["seconds"] for summary in summaries if summary]
    table = []
    for part in PARTS:
        predicted = [one["predicted"][part] for one in seconds if part in one.get("predicted", {})]
        all_measured = [one.get("whole_run" if part == "total" else part) for one in seconds]
        known = [value for value in all_measured if value is not None]
        if any(predicted) or any(known):
            table.append(
                (
                    part,
                    f"{sum(predicted):.1f} s" if predicted else "not predicted",
                    f"{sum(known):.1f} s" if known else "not measured by itself",
                    f"{sum(known) / sum(predicted):.2g}" if known and sum(predicted) > 0.0 else "",
                )
            )
    return Table(table, ("part", "predicted", "measured", "measured over predicted"), (1, 2, 3))


def flat(values: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return nested values as rows: keys joined by a point, each value as text; what is None or empty is left out."""
    if isinstance(values, dict):
        return [row for key, value in values.items() for row in flat(value, f"{prefix}.{key}" if prefix else str(key))]
    if isinstance(values, list) and values and isinstance(values[0], dict):
        return [row for number, value in enumerate(values) for row in flat(value, f"{prefix}[{number}]")]
    if values is None or values == []:
        return []
    return [(prefix, " ".join(map(str, values)) if isinstance(values, list) else str(values))]


def _columns(file: str, columns: Sequence[tuple[str, str, str]]) -> Table:
    return Table(columns, ("column", "unit", "meaning"), folded=f"columns of {file}")


def _profile_columns(folder: Path) -> Table | None:
    path = folder / "profiles.csv"
    if not path.is_file():
        return None
    names = dict.fromkeys(name for table in read_profiles(path).values() for name in table)
    return _columns(path.name, [(name, *profile_column(name)) for name in names])
