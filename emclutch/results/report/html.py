"""A run or a study as one page of HTML that needs nothing else: pictures are inside it, nothing is fetched.

The page opens without a network, on a telephone and on paper. Text of scenes is untrusted: every value is escaped by
the templates, and the page's own policy forbids scripts and anything from elsewhere.
"""

from __future__ import annotations

import base64
import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from emclutch import __version__
from emclutch.effects import EffectsSection
from emclutch.effects.left_out import ALWAYS, OFF, LeftOut
from emclutch.results import COLUMNS, OutputError, Result, RunFolder, load_result
from emclutch.results.columns import DISSIPATED, ENERGY_RESIDUAL, TORQUE_DISC, WORK_HELD, WORK_MAGNETIC, WORK_WALLS
from emclutch.results.grain_profiles import profile_column, read_profiles
from emclutch.results.replicated_mean import drift_in_words
from emclutch.results.report.markdown import PICTURES, summary_rows
from emclutch.results.report.verdict import Mark, effects_of, verdict
from emclutch.results.study_folder import StudyFolder, is_study, read_study, refresh_in_words
from emclutch.results.time_unit import time_in_words
from emclutch.results.torque_in_words import torque_in_words

LeftOutOf = Callable[[Result], Sequence[LeftOut]]
"""What the scene of a run leaves out."""

STUDY_PICTURES = {
    "torque_vs_current.png": "torque against the coil's current",
    "torque_vs_speed.png": "torque against the motor's speed",
    "speeds.png": "speeds of the shafts against time",
}
PARTS = ("start", "field", "magnetic", "contact", "output")
ENERGIES = ("coil_supplied", WORK_WALLS, WORK_MAGNETIC, WORK_HELD, "work_gravity", DISSIPATED, ENERGY_RESIDUAL)


def write_page(folder: Path, left_out_of: LeftOutOf, out: Path | None = None) -> Path:
    """Write the page of a run or a study and return it.

    Parameters
    ----------
    folder : of the run or the study.
    left_out_of : what the scene of a run leaves out, see `emclutch.simulation.left_out_of_run`.
    out : new file; default: the next free report.html, report-1.html, ... in the folder.

    Raises
    ------
    OutputError
        The folder holds neither, or the file exists.
    """
    page = (
        study_page(read_study(folder), left_out_of) if is_study(folder) else run_page(load_result(folder), left_out_of)
    )
    if out is None:
        names = itertools.chain(["report.html"], (f"report-{number}.html" for number in itertools.count(1)))
        out = next(folder / name for name in names if not (folder / name).exists())
    try:
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(page)
    except FileExistsError as error:
        raise OutputError(f"{out} exists; name another file with --out") from error
    return out


def run_page(result: Result, left_out_of: LeftOutOf) -> str:
    """The page of a run, finished or not; `left_out_of` as for `write_page`."""
    folder, summary = result.folder, result.summary
    on, left_out = effects_of(result), left_out_of(result)
    return _template("run.html.j2").render(
        **_frame(summary.get("title") or folder.path.resolve().name, [folder.path]),
        verdict=verdict(result),
        matters=_that_matter(left_out, on),
        torque=torque_in_words(result.torque) if TORQUE_DISC in result.history else None,
        effects=_effects(on, left_out),
        pictures=[*_pictures(folder.path, PICTURES), *_own_torque_picture(result)],
        numbers=summary_rows(summary) if summary else [],
        torques=_torques(result),
        balances=_balances(result),
        cost=_cost([summary]) if summary else [],
        **_of_the_run(folder),
        columns=[(name, COLUMNS[name].unit, COLUMNS[name].meaning) for name in result.history.columns],
        profile_columns=_profile_columns(folder.path),
    )


def study_page(study: StudyFolder, left_out_of: LeftOutOf) -> str:
    """The page of a study: the points that are done; `left_out_of` as for `write_page`."""
    results = study.results()
    on = {label: effects_of(result) for label, result in results.items()}
    first = next(iter(results.values()), None)
    left_out = () if first is None else left_out_of(first)
    points = [
        {
            "label": label,
            "result": result,
            "row": row,
            "verdict": verdict(result),
            "torque": torque_in_words(result.torque) if TORQUE_DISC in result.history else None,
        }
        for (label, result), (_, row) in zip(results.items(), study.table.iterrows(), strict=True)
    ]
    compared = study.path / "methods.txt"
    return _template("study.html.j2").render(
        **_frame(study.title, [study.path]),
        study=study,
        points=points,
        known=sum(bool(result.torque.converged) for result in results.values() if TORQUE_DISC in result.history),
        worst=_worst(results.values()),
        poor=_grouped([(p["label"], s.text) for p in points for s in p["verdict"] if s.mark is Mark.POOR], len(points)),
        matters=_that_matter(left_out, next(iter(on.values()), ())),
        effects=_effects(list(dict.fromkeys(itertools.chain(*on.values()))), left_out),
        differing=[
            (name, [label for label in on if name in on[label]])
            for name in EffectsSection.names()
            if 0 < sum(name in each for each in on.values()) < len(on)
        ],
        failures=study.failures(),
        outdated=refresh_in_words(study),
        methods=compared.read_text(encoding="utf-8") if compared.is_file() else "",
        pictures=[*_pictures(study.path, STUDY_PICTURES), *_overlay(results)],
        cost=_cost([result.summary for result in results.values() if result.summary]),
        **({} if first is None else _of_the_run(first.folder)),
    )


def _of_the_run(folder: RunFolder) -> dict[str, Any]:
    """The plan of a run, its scene, and where it was made."""
    return {
        "scene": [*folder.read_plan().get("decisions", {}).items()],
        "case": folder.read_case() if folder.case.is_file() else "",
        "provenance": _flat(folder.read_provenance()),
    }


def _template(name: str) -> Any:
    places = FileSystemLoader(Path(__file__).parent / "templates")
    environment = Environment(
        loader=places, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["seconds"] = time_in_words
    return environment.get_template(name)


def _frame(title: str, folders: Sequence[Path]) -> dict[str, Any]:
    return {"title": title, "folder": folders[0].resolve().name, "version": __version__}


def _that_matter(left_out: Sequence[LeftOut], on: Sequence[str]) -> list[LeftOut]:
    return [line for line in left_out if line.matters and line.where != ALWAYS and line.effect not in on]


def _grouped(said: Sequence[tuple[str, str]], points: int) -> list[tuple[str, str]]:
    """Statements on points, each once, with the points that it is said of."""
    of: dict[str, list[str]] = {}
    for label, text in said:
        of.setdefault(text, []).append(label)
    return [("all points" if len(labels) == points > 1 else "; ".join(labels), text) for text, labels in of.items()]


def _effects(on: Sequence[str], left_out: Sequence[LeftOut]) -> list[dict[str, str]]:
    """Every effect of this version, and what no scene can have: on or off, and whether its absence matters."""
    of = {line.effect: line for line in left_out}
    rows = []
    for name in dict.fromkeys([*EffectsSection.names(), *of]):
        field, line = EffectsSection.model_fields.get(name), None if name in on else of.get(name)
        rows.append(
            {
                "name": name.replace("_", " "),
                "state": "on" if name in on else OFF if line is None else line.where,
                "what": str(field.description) if field is not None else "",
                "matters": "" if line is None else line.verdict,
                "mark": "" if line is None or line.where == ALWAYS else line.verdict,
                "number": "" if line is None else line.in_words(),
            }
        )
    return rows


def _pictures(folder: Path, names: dict[str, str]) -> Iterator[dict[str, str]]:
    for name, what in names.items():
        if (folder / name).is_file():
            yield {"data": _embedded((folder / name).read_bytes()), "what": what}


def _embedded(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def _own_torque_picture(result: Result) -> Iterator[dict[str, str]]:
    """The torque of a run that has drawn none."""
    if TORQUE_DISC not in result.history or result.folder.torque_picture.is_file():
        return
    from emclutch.results.pictures.torque import torque_picture

    with tempfile.TemporaryDirectory() as place:
        path = torque_picture(Path(place) / "torque.png", result.history, result.torque, result.other_histories)
        yield {"data": _embedded(path.read_bytes()), "what": PICTURES["torque.png"]}


def _overlay(results: dict[str, Result]) -> Iterator[dict[str, str]]:
    """The torques of a study's points over one another."""
    if not results or not all(TORQUE_DISC in result.history for result in results.values()):
        return
    from emclutch.results.pictures.torque_overlay import torque_overlay_picture

    with tempfile.TemporaryDirectory() as place:
        path = torque_overlay_picture(Path(place) / "torques.png", results)
        yield {"data": _embedded(path.read_bytes()), "what": "torques of the points against time"}


def _torques(result: Result) -> list[tuple[str, str]]:
    if TORQUE_DISC not in result.history:
        return []
    torque = result.torque
    rows = [("mean over the steady part", "none" if torque.mean is None else f"{torque.mean:.5g} N m")]
    if (interval := torque.interval()) is not None:
        rows.append(("95 % interval", f"{interval[0]:.5g} to {interval[1]:.5g} N m"))
    rows.append(("packings", str(torque.replicas)))
    if torque.drift is not None:
        rows.append(("drift over the averaged stretch", drift_in_words(torque)))
    if torque.start is not None:
        rows.append(("steady part begins at", time_in_words(torque.start)))
    if torque.correlation_time is not None:
        rows.append(("correlation time", time_in_words(torque.correlation_time)))
    rows.append(("verdict", torque.reason))
    summary = result.summary
    rows += [
        (f"mean of packing {number} (seed {seed})", "none" if mean is None else f"{mean:.5g} N m")
        for number, (seed, mean) in enumerate(
            zip(*((summary.get("replicas") or {}).get(k, []) for k in ("seeds", "means")), strict=True)
        )
    ]
    for key, label in (("torque_rotor", "on the rotor"), ("torque_field", "taken by the field")):
        if summary.get(key, {}).get("mean") is not None:
            rows.append((f"torque {label}", f"{summary[key]['mean']:.5g} N m"))
    return rows


def _balances(result: Result) -> list[tuple[str, str]]:
    """Each balance and residual with what it is compared with; energies are sums over the run."""
    summary, history = result.summary, result.history
    rows = [
        (f"energy: {name.replace('_', ' ')}", f"{history[name].sum():.4g} J") for name in ENERGIES if name in history
    ]
    rows += [
        (f"energy: change of {name.replace('_', ' ')}", f"{history[name].iloc[-1] - history[name].iloc[0]:.4g} J")
        for name in ("kinetic_energy", "elastic_energy")
        if name in history
    ]
    for part, label in (("feedback", "moments in the field's solve"), ("moments", "moments of the grains")):
        if found := summary.get(part):
            rows.append((label, f"residual {found['worst_residual']:.2g} at worst, tolerance {found['tolerance']:.2g}"))
    if found := summary.get("solver"):
        rows.append(
            (
                "rigid contacts",
                f"{found['worst_residual']:.2g} m/s off the law of contact at worst, tolerance "
                f"{found['tolerance']:.2g} m/s; {100.0 * found['missed_share']:.2g} % of the steps missed it",
            )
        )
    return rows


def _cost(summaries: Sequence[dict[str, Any]]) -> list[dict[str, str]]:
    """Predicted and measured wall-clock seconds by part, summed over runs, and measured over predicted."""
    seconds = [summary["seconds"] for summary in summaries]
    rows = []
    for part in (*PARTS, "compiling", "total"):
        told = [one["predicted"].get(part) for one in seconds if part in one.get("predicted", {})]
        measured = [one.get("whole_run" if part == "total" else part) for one in seconds]
        found = [value for value in measured if value is not None]
        if not any(told) and not any(found):
            continue
        both = bool(told) and bool(found) and sum(told) > 0.0
        rows.append(
            {
                "part": part,
                "predicted": f"{sum(told):.1f} s" if told else "not predicted",
                "measured": f"{sum(found):.1f} s" if found else "not measured by itself",
                "ratio": f"{sum(found) / sum(told):.2g}" if both else "",
            }
        )
    return rows


def _worst(results: Any) -> str:
    """Half the widest 95 % interval, relative to its torque; empty where one is unknown."""
    shares = []
    for result in results:
        torque = result.torque if TORQUE_DISC in result.history else None
        half = None if torque is None else torque.half_width()
        if torque is None or half is None or not torque.mean:
            return ""
        shares.append(half / abs(torque.mean))
    return f"{100.0 * max(shares):.2g} %" if shares else ""


def _flat(values: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Nested values as rows: the keys joined by a point, each value as text; what is None or empty is left out."""
    if isinstance(values, dict):
        return [row for key, value in values.items() for row in _flat(value, f"{prefix}.{key}" if prefix else str(key))]
    if isinstance(values, list) and values and isinstance(values[0], dict):
        return [row for number, value in enumerate(values) for row in _flat(value, f"{prefix}[{number}]")]
    if values is None or values == []:
        return []
    return [(prefix, " ".join(map(str, values)) if isinstance(values, list) else str(values))]


def _profile_columns(folder: Path) -> list[tuple[str, str, str]]:
    path = folder / "profiles.csv"
    if not path.is_file():
        return []
    names = dict.fromkeys(name for table in read_profiles(path).values() for name in table)
    return [(name, *profile_column(name)) for name in names]
