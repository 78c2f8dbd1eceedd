"""`emclutch plot`: a picture of finished runs in a new file: torque, speeds, torque against motor's speed or current.

A study stands for its points. Pictures that a killed run still owes its folder are drawn as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas

from emclutch.results import OutputError, Result, load_result
from emclutch.results.columns import SHEAR_STRESS
from emclutch.results.measured_table import OVER_RATED, read_measured
from emclutch.results.new_path import new_path, numbered_file
from emclutch.results.seed_average import averaged_over_seeds
from emclutch.results.study_folder import is_study
from emclutch.results.study_result import load_study
from emclutch.results.torque_curves import PER_GAP, TorqueCurve, row_of_run, torque_curves
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import read_all
from emclutch.simulation.pictures import draw_missing
from emclutch.studies.tables import CURRENT, SEED, SIZES, VOLTAGE

TORQUE, SPEEDS, TORQUE_SPEED, TORQUE_CURRENT = "torque", "speeds", "torque_speed", "torque_current"
GRAIN_SIZE = "grain_size"
TRANSIENT = "transient.csv"
_AXES = {TORQUE_CURRENT: ("current", (CURRENT, VOLTAGE)), GRAIN_SIZE: (PER_GAP, SIZES)}
_MEASURED = {SPEEDS: ("time [s]", "speed [rpm]"), TORQUE_CURRENT: ("current [A]", "torque [N m]")}
_RATED = Quantity("a current", "A", "0.94 A", 0.0, open_minimum=True)


def plot_runs(
    folders: Sequence[Path],
    kind: str = TORQUE,
    *,
    rated: str | None = None,
    measured: Path | None = None,
    out: Path | None = None,
    trust_scripts: bool = False,
    log: Callable[[str], None] = lambda text: None,
) -> Path:
    """Draw runs and return the new picture.

    Parameters
    ----------
    folders : of runs, and of studies for all their points that are done, or all of coils in time
        (`emclutch field --transient`). Several lie over one another.
    kind : TORQUE, SPEEDS, TORQUE_SPEED, TORQUE_CURRENT or GRAIN_SIZE.
    rated : current [A] or text with a unit; divides each curve of TORQUE_CURRENT by its own point there.
    measured : table to lay over SPEEDS or TORQUE_CURRENT, as `read_measured` takes it.
    out : new file; default: the next free <kind>-<n>.png in the first folder.
    trust_scripts : as for `load_case`, of runs whose own pictures are missing.
    log : takes a line for each run whose own pictures were missing, and the laws of GRAIN_SIZE.

    Raises
    ------
    SceneError
        What was asked for does not go together.
    OutputError
        A folder holds no run, a run has no shafts, the table is none, or the file exists.
    """
    if measured is not None and kind not in _MEASURED:
        message = "lies over speeds or torque against current only; add --speeds or --torque-current"
        raise SceneError([Fault("--with", str(measured), message)], "command line")
    if rated is not None and kind != TORQUE_CURRENT:
        raise SceneError([Fault("--rated", rated, "divides torque against current only; add --torque-current")],
                         "command line")  # fmt: skip
    if scenes := [folder for folder in folders if folder.suffix == ".toml" and folder.is_file()]:
        message = f"is a scene, not a result; run it, and plot its folder: emclutch run {scenes[0]}"
        raise SceneError([Fault(str(scenes[0]), "", message)], "command line")
    if all((folder / TRANSIENT).is_file() for folder in folders):
        return _transients(folders, kind, out)
    runs = runs_of(folders)
    if not runs:
        raise OutputError(f"no point of the study in {folders[0]} is done: there is nothing to draw")
    results = list(runs.values())
    for result in results:
        try:
            if draw_missing(result.folder, trust_scripts=trust_scripts):
                log(f"{result.folder.path} had no pictures: they are drawn")
        except OutputError as error:  # what was asked for needs them not
            log(f"{result.folder.path} has no pictures, and they cannot be drawn: {error}")
    for folder in folders:
        if is_study(folder) and (old := load_study(folder).refresh_in_words()):
            log(f"{folder}: {old}")
    columns = _MEASURED.get(kind, OVER_RATED) if rated is None else OVER_RATED
    points = None if measured is None else read_measured(measured, *columns)
    curves = curves_of(folders, kind) if kind in _AXES else []
    if rated is not None:
        (at,) = read_all([rated], _RATED, "--rated")
        curves = [curve.over_rated(at) for curve in curves]
    out = numbered_file(folders[0], kind, ".png") if out is None else new_path(out)
    title = _title(folders, results)
    if kind == TORQUE and len(results) == 1 and SHEAR_STRESS in results[0].history:
        from emclutch.results.pictures.sheared_box import stress_picture

        return stress_picture(out, results[0].history, results[0].stress, results[0].other_histories, title=title)
    if kind == TORQUE and len(results) == 1:
        from emclutch.results.pictures.torque import torque_picture

        result = results[0]
        return torque_picture(out, result.history, result.torque, result.other_histories, best=result.best, title=title)
    if kind == TORQUE:
        from emclutch.results.pictures.torque import torque_overlay_picture

        return torque_overlay_picture(out, runs, title=title)
    if kind == TORQUE_CURRENT and rated is None and len(folders) == 1 and not is_study(folders[0]):
        from emclutch.results.pictures.current_ramp import run_against_current_picture

        return run_against_current_picture(out, results[0], measured=points, title=title)
    if kind == TORQUE_CURRENT:
        from emclutch.results.pictures.torque_curves import torque_against_current_picture

        return torque_against_current_picture(out, curves, measured=points, over_rated=rated is not None, title=title)
    if kind == GRAIN_SIZE:
        from emclutch.results.grain_size_law import grain_size_law, law_in_words
        from emclutch.results.pictures.torque_curves import torque_against_grain_size_picture

        laws = [grain_size_law(curve) for curve in curves]
        for curve, law in zip(curves, laws, strict=True):
            log(law_in_words(curve, law))
        return torque_against_grain_size_picture(out, curves, laws, title=title)
    from emclutch.results.pictures.speeds import speed_picture, torque_speed_picture

    histories = {name: result.history for name, result in runs.items()}
    if kind == SPEEDS:
        return speed_picture(out, histories, measured=points, title=title)
    return torque_speed_picture(out, histories, title=title)


def _transients(folders: Sequence[Path], kind: str, out: Path | None) -> Path:
    """Draw the folders of `emclutch field --transient` over one another."""
    if kind != TORQUE:
        option = f"--{kind.replace('_', '-')}"
        message = "is for runs; results of field --transient have no such curve: remove it"
        raise SceneError([Fault(option, "", message)], "command line")
    from emclutch.results.pictures.field import transient_overlay_picture

    tables = {name: pandas.read_csv(one / TRANSIENT) for name, one in zip(_names(folders), folders, strict=True)}
    out = numbered_file(folders[0], "coil_in_time", ".png") if out is None else new_path(out)
    return transient_overlay_picture(out, tables)


def runs_of(folders: Sequence[Path]) -> dict[str, Result]:
    """The results in folders by their names; a study's points by the study's name and their values."""
    runs: dict[str, Result] = {}
    for folder, name in zip(folders, _names(folders), strict=True):
        if is_study(folder):
            of = f"{name}: " if len(folders) > 1 else ""
            runs |= {f"{of}{label}": result for label, result in load_study(folder).results().items()}
        else:
            runs[name] = load_result(folder)
    return runs


def curves_of(folders: Sequence[Path], kind: str) -> list[TorqueCurve]:
    """Return torque against current or grain size: the curves of each study, and one through the runs named alone.

    Parameters
    ----------
    folders : of runs and studies.
    kind : TORQUE_CURRENT, or GRAIN_SIZE over the grains per gap.

    Raises
    ------
    OutputError
        A run has no coil current, or no gap whose grains are counted across.
    """
    x, along = _AXES[kind]
    curves: list[TorqueCurve] = []
    alone = []
    for folder, name in zip(folders, _names(folders), strict=True):
        if is_study(folder):
            study = load_study(folder)
            rows = study.table.to_dict("records")
            others = [key for key in study.varied if key != SEED and not key.startswith(along)]
            if SEED in study.varied:
                rows = averaged_over_seeds(rows, SEED, [key for key in study.varied if key != SEED])
            _require(x, rows, name)
            curves += torque_curves([{"study": name, **row} for row in rows], x,
                                    ["study"] * (len(folders) > 1) + others)  # fmt: skip
        else:
            alone.append(row_of_run(load_result(folder)))
            _require(x, alone, name)
    return curves + torque_curves(alone, x, [])


def _require(x: str, rows: Sequence[Mapping[str, Any]], name: str) -> None:
    if any(row.get(x) is None for row in rows):
        reason = (
            "has no coil current: no effect of its scene needs the field"
            if x == "current"
            else "has no grains per gap: its scene has no sheared gap, no attraction of grains, or is of an older "
            "version"
        )
        raise OutputError(f"{name} {reason}")


def _names(folders: Sequence[Path]) -> list[str]:
    """Name of each folder, with that of the folder around it where two have the same."""
    paths = [folder.resolve() for folder in folders]
    count = Counter(path.name for path in paths)
    return [path.name if count[path.name] == 1 else f"{path.parent.name}/{path.name}" for path in paths]


def _title(folders: Sequence[Path], results: Sequence[Result]) -> str | None:
    if len(folders) == 1 and is_study(folders[0]):
        return load_study(folders[0]).title
    return results[0].summary.get("title") if len(results) == 1 else None
