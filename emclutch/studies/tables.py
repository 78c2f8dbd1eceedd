"""Tables and pictures over the points of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from emclutch.results import Result, load_result
from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.results.columns import DISC_SPEED, ROTOR_SPEED, TIME, TORQUE_DISC
from emclutch.results.grain_size_law import grain_size_law, law_in_words
from emclutch.results.linear_range import linear_range
from emclutch.results.measured_table import measured_in
from emclutch.results.pictures.speeds import speed_picture, speeds_vary
from emclutch.results.pictures.torque_curves import (
    torque_against_current_picture,
    torque_against_grain_size_picture,
    torque_against_speed_picture,
)
from emclutch.results.quantities import QUANTITIES
from emclutch.results.run_end import seconds_of
from emclutch.results.seed_average import averaged_over_seeds
from emclutch.results.statistics import Estimate
from emclutch.results.study_folder import write_about, write_empty_table
from emclutch.results.torque_curves import BEST_ESTIMATE, PER_GAP, REAL_PER_GAP, TorqueCurve, torque_curves
from emclutch.scene.scaled import Scaled
from emclutch.scene.study import StudySection
from emclutch.studies.method_comparison import METHOD, compare_methods

DIGITS = 8
"""Of a number in a table: more than any torque is known to; all of them are in the summary of its run."""
MOST_COURSES = 100
"""Of `speeds.png`: of more points every second, third, ... is drawn."""
SPEEDS_VARY = "speeds_vary"
"""Value of a point's row that is no column: whether its shafts change their speed."""
STARTED = 0.01  # of the motor's fastest speed: an output that dry friction holds chatters below it
SEED, CURRENT, VOLTAGE, SPEED = "scene.seed", "coil.current", "coil.voltage", "motion.rotor.speed"
COLUMNS = tuple(one for one in QUANTITIES if one.column)
SIZES = "particles.diameter", "particles.sizes"
SIZE_COLUMNS = (PER_GAP, REAL_PER_GAP, "seeds", "torque", "standard_error", "low", "high", "converged",
                "inertial_number", "grains", "seconds")  # fmt: skip
"""Of `grain_size.csv`, after the values: grains per gap, those of the real powder, torque, what it cost."""


def write_tables(folder: Path, study: StudySection, done: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> None:
    """Write all tables and pictures of the points that are done; of none the table's head.

    `done` : in the study's order, the values of each point and those of its row (`emclutch.studies.point.run_point`).
    """
    write_about(folder, study.title, study.values, len(study.points()))
    if not done:
        write_empty_table(folder, study.values)
        return
    write_torques(folder, study, [values | {k: v for k, v in row.items() if k != SPEEDS_VARY} for values, row in done])
    if any(row[SPEEDS_VARY] for _, row in done):  # then an output that stands still is drawn too
        drawn = done[:: -(-len(done) // MOST_COURSES)]
        histories = {label_of(study, values) or row["folder"]: folder / row["folder"] for values, row in drawn}
        courses = {label: load_result(path).history for label, path in histories.items()}
        speed_picture(folder / "speeds.png", courses, title=study.title or None)
    if METHOD in study.values:
        compared = compare_methods([(values, load_result(folder / row["folder"])) for values, row in done])
        if compared:
            _write_csv(folder / "methods.csv", compared)


def write_failures(folder: Path, failures: Sequence[tuple[str, dict[str, Any], str]]) -> None:
    """`failures.csv`: folder, values and reason of each point that failed; no such file where none has."""
    path = folder / "failures.csv"
    if failures:
        _write_csv(path, [{"point": name, **values, "reason": reason} for name, values, reason in failures])
    else:
        path.unlink(missing_ok=True)


def write_torques(folder: Path, study: StudySection, rows: list[dict[str, Any]]) -> None:
    """`study.csv`, averages over seeds, and torque against current, speed and grain size where these are varied."""
    _write_csv(folder / "study.csv", rows)
    runs = rows
    varied = [key for key, values in study.values.items() if len(values) > 1]
    if SEED in varied:
        varied.remove(SEED)
        rows = averaged_over_seeds(rows, SEED, varied)
        _write_csv(folder / "seeds.csv", rows)
    title = study.title or None
    axis = next((key for key in (CURRENT, VOLTAGE) if key in varied), None)
    if axis is not None and _all_have("current", rows):
        curves = _write_curves(folder / "torque_vs_current.csv", rows, axis, "current", varied)
        ranges = [linear_range(curve.x, curve.torque, curve.error, curve.converged) for curve in curves]
        found = [
            {"values": curve.values, "linear_range": one.as_dict()} for curve, one in zip(curves, ranges, strict=True)
        ]
        replace_json(folder / "torque_vs_current.json", {"curves": found})
        torque_against_current_picture(
            folder / "torque_vs_current.png", curves, ranges, measured=measured_in(folder), title=title,
            band=expected_band(rows) if len(curves) == 1 else None,
        )  # fmt: skip
    constant = not any(isinstance(speed, dict) for speed in study.values.get(SPEED, ()))
    if SPEED in varied and constant and _all_have("rotor_speed", rows):
        curves = _write_curves(folder / "torque_vs_speed.csv", rows, SPEED, "rotor_speed", varied)
        torque_against_speed_picture(folder / "torque_vs_speed.png", curves, title=title)
    if any(key.startswith(SIZES) for key in varied) and _all_have(PER_GAP, rows):
        _write_grain_sizes(folder, runs, rows, varied, title)


def expected_band(rows: Sequence[dict[str, Any]]) -> np.ndarray | None:
    """Return current [A] and low, middle and high expected torque [N m] of a curve's rows; None below two of them."""
    names = ("current", "expected_low", "expected_torque", "expected_high")
    band = [[row[name] for name in names] for row in rows if all(row.get(name) is not None for name in names)]
    return np.array(sorted(band)) if len(band) > 1 else None


def _write_grain_sizes(
    folder: Path, runs: list[dict[str, Any]], rows: list[dict[str, Any]], varied: list[str], title: str | None
) -> None:
    """Write torque against grain size, with the law of each curve; nothing where no curve has two sizes.

    `rows` are the `runs`, or their averages over seeds, whose cost is that of all their runs.
    """
    curves = torque_curves(rows, PER_GAP, [key for key in varied if not key.startswith(SIZES)])
    if all(np.unique(curve.x).size < 2 for curve in curves):
        return
    cost: dict[str, float] = {}
    for run in runs:
        point = repr([run[key] for key in varied])
        cost[point] = cost.get(point, 0.0) + run["seconds"]
    table = [{**row, "seconds": cost[repr([row[key] for key in varied])]} for row in rows]
    _write_csv(folder / "grain_size.csv", [{key: row.get(key) for key in (*varied, *SIZE_COLUMNS)} for row in table])
    laws = [grain_size_law(curve) for curve in curves]
    found = [
        {"values": curve.values, "law": None if law is None else law.as_dict(), "reason": law_in_words(curve, law)}
        for curve, law in zip(curves, laws, strict=True)
    ]
    replace_json(folder / "grain_size.json", {"curves": found})
    torque_against_grain_size_picture(folder / "grain_size.png", curves, laws, title=title)


def _all_have(name: str, rows: list[dict[str, Any]]) -> bool:
    return all(row.get(name) is not None for row in rows)


def _write_curves(path: Path, rows: list[dict[str, Any]], axis: str, x: str, varied: list[str]) -> list[TorqueCurve]:
    """Write the points of the curves over `x`, one a row, and return the curves; `axis` is the value along them."""
    others = [key for key in varied if key != axis]
    order = {repr([row[key] for key in others]): None for row in rows}  # as they are met
    number = {curve: place for place, curve in enumerate(order)}
    ordered = sorted(rows, key=lambda row: (number[repr([row[key] for key in others])], row[x]))
    kept = [{key: row[key] for key in row if key != axis or axis == VOLTAGE} for row in ordered]
    _write_csv(path, kept)
    return torque_curves(rows, x, others)


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    import pandas

    table = pandas.DataFrame(list(rows))
    for name in table.columns:
        if table[name].dtype.kind == "f" and "." not in name:  # not the study's values, by which points are known
            table[name] = [float(f"{value:.{DIGITS}g}") for value in table[name]]
    replace_text(path, table.to_csv(index=False))


def row_of(result: Result, name: str, end: float | str | Scaled | None = None) -> dict[str, Any]:
    """Return the row of a point in the folder `name`: the quantities that are columns of `study.csv`.

    `end` : of the scene in its folder, None: unknown, as a point may have been continued alone to a later one.
    """
    torque, summary, history = disc_torque(result), result.summary, result.history
    low, high = torque.interval() if torque.known else (None, None)
    end = seconds_of(result.folder.read_scene()["time"]["end"] if end is None else end, result.folder)
    row: dict[str, Any] = {"end_time": end, "torque": torque.mean, "standard_error": torque.standard_error,
           "low": low, "high": high, "converged": torque.converged, "steady_alone": torque.steady_alone}  # fmt: skip
    row |= {one.column: one.value(summary) for one in COLUMNS if one.is_in(summary)}
    row |= {"reason": torque.in_words(), "folder": name}
    if TORQUE_DISC in history and (best := result.best) != torque:
        ends = best.interval() if best.known else (None, None)
        row |= dict(zip(BEST_ESTIMATE, (best.mean, *ends), strict=True))
    if (start := result.folder.read_provenance().get("grains_from")) is not None:
        row["started_from"] = Path(start["folder"]).name  # a study's point
    if ROTOR_SPEED in history:
        row["rotor_speed"] = float(history[ROTOR_SPEED].iloc[-1])
    if "lock_up_time" in summary:  # a shaft is free
        row["output_start_time"], row["output_start_speed"] = output_start(history) or (None, None)
    return row | {SPEEDS_VARY: speeds_vary(history)}


def disc_torque(result: Result) -> Estimate:
    """The result's steady torque; none where the scene has no disc, as a box without a wall on it.

    Of a sheared periodic box the verdict is that of its stress.
    """
    if TORQUE_DISC in result.history:
        return result.torque
    if result.steady is not None:
        return replace(result.steady, mean=None, standard_error=None)
    return Estimate(None, None, 0, None, None, False, "the scene has no disc")


def output_start(history: Any) -> tuple[float, float] | None:
    """Time [s] and the motor's speed [rad/s] then, at which an output at rest has begun to move; None if it does not.

    It moves when it turns at `STARTED` times the fastest speed of the motor.
    """
    if ROTOR_SPEED not in history or DISC_SPEED not in history:
        return None
    motor, output = history[ROTOR_SPEED].to_numpy(), history[DISC_SPEED].to_numpy()
    moving = abs(output) > STARTED * abs(motor).max()
    if not moving.any() or moving[0]:
        return None
    first = int(moving.argmax())
    return float(history[TIME].iloc[first]), float(motor[first])


def label_of(study: StudySection, values: dict[str, Any]) -> str:
    """Label of a point: the last part of each key that has several values, with the value."""
    several = [key for key, options in study.values.items() if len(options) > 1]
    parts = (f"{key.rpartition('.')[2].replace('_', ' ')} {values[key]}" for key in several)
    return ", ".join(parts) if not any(isinstance(values[key], (dict, list)) for key in several) else ""
