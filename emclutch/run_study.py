"""A parameter study: every point is a run in a folder of its own; tables and pictures over all of them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from emclutch.case import Case
from emclutch.method_comparison import METHOD, compare_methods, comparison_lines
from emclutch.results import OutputError, Result, RunFolder, load_result
from emclutch.results.atomic_file import replace_text
from emclutch.results.folder_lock import has_files, locked_folder
from emclutch.results.run_folder import logging_to
from emclutch.results.speed_picture import speed_picture, speeds_vary
from emclutch.results.study_pictures import torque_against_current_picture, torque_against_speed_picture
from emclutch.run_case import Interrupted, run
from emclutch.scene.study import Study, load_study
from emclutch.study_points import PointFolder, folders_of_points, set_aside, unclaimed

log = logging.getLogger(__name__)
STARTED = 0.01  # of the motor's fastest speed: an output that dry friction holds trembles below it


def sweep(
    study: Study | str | Path,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress=None,
    insist: bool = False,
) -> Path:
    """Run every point of a study, one after the other, and return the study's folder.

    With ``contact.method`` among the values, `methods.csv` and `methods.txt` compare DEM and DVI.

    The folder holds point-000, point-001, ... (each a whole run), `study.csv` with a row a point, `study.log` with what
    became of each, `speeds.png` where shafts change their speed, and for a sweep of `coil.current` or of a constant
    `motion.rotor.speed` alone also `torque_vs_current.csv` or `torque_vs_speed.csv` with its `.png`. The tables and
    pictures are written anew after every point.

    Parameters
    ----------
    study : a Study, or the path of a study file.
    out : folder; default: the next free studies/<name>-<nnn>.
    resume : keep the points that are done and continue the others from their checkpoints, also to a later time.end.
        A point is known by its values, so that values may be inserted, removed and put in another order; the folders
        keep their names, and new points get the next numbers.
    insist : run also points that need more memory than is free.

    Raises
    ------
    SceneError, OutputError, RunError
        As for a single run; the points that are done stay.
    """
    study = study if isinstance(study, Study) else load_study(study)
    folder = Path(out) if out is not None else RunFolder.next_path(study.path.stem, "studies")
    if resume and not folder.is_dir():  # before the lock makes it
        raise OutputError(f"nothing to resume in {folder}: there is no such folder; name the study's folder with --out")
    with locked_folder(folder):
        if not resume and has_files(folder):
            raise OutputError(f"{folder} is not empty; continue it with --resume, or write elsewhere with --out")
        with logging_to(folder / "study.log", [__name__]):
            _run_points(study, folder, threads, resume, progress, insist)
    return folder


def _run_points(study: Study, folder: Path, threads: int | None, resume: bool, progress, insist: bool) -> None:
    points = list(study.cases())
    targets = folders_of_points(folder, [case for _, case in points], fixed=study.values)
    if others := unclaimed(folder, targets):
        log.info("of none of the study's points, and left as they are: %s", ", ".join(others))
    rows: list[dict] = []
    done: list[tuple[dict, Result]] = []
    courses: dict[str, Any] = {}
    for number, ((values, case), target) in enumerate(zip(points, targets, strict=True)):
        part = None if progress is None else _Part(progress, number, len(points))
        try:
            result = _run_point(case, target, threads, resume, part, insist)
        except Interrupted as stopped:
            hint = f"go on with: emclutch sweep {study.path} --out {folder} --resume"
            raise Interrupted(f"stopped at point {number + 1} of {len(points)}; {hint}") from stopped
        rows.append(_row(values, case, result))
        done.append((values, result))
        _write_tables(folder, study, rows)
        if speeds_vary(result.history):
            courses[_label(study, values) or target.path.name] = result.history
            speed_picture(folder / "speeds.png", courses, title=study.title or None)
        if METHOD in study.values:
            _write_comparison(folder, study, done)


def _run_point(case: Case, point: PointFolder, threads: int | None, resume: bool, progress, insist: bool) -> Result:
    """The result of a point: as it lies there, continued, or computed."""
    name = point.path.name
    resumed = resume and RunFolder(point.path).checkpoint.is_file()
    if resume and point.is_done:
        point.refuse_changed_files(case)
        log.info("%s is done: kept", name)
        return load_result(point.path)
    if resumed:
        log.info("%s goes on from its checkpoint to t = %g s", name, case.scene.time.end)
    elif point.path.is_dir() and has_files(point.path):
        aside = set_aside(point.path)
        log.warning("%s has no checkpoint to go on from: started anew, its files are kept as %s", name, aside.name)
    else:
        log.info("%s starts", name)
    return run(case, out=point.path, threads=threads, progress=progress, resume=resumed, insist=insist)


def _write_comparison(folder: Path, study: Study, done: list[tuple[dict, Result]]) -> None:
    import pandas

    compared = compare_methods(done)
    if compared:
        others = [key for key in study.values if key != METHOD]
        replace_text(folder / "methods.csv", pandas.DataFrame(compared).to_csv(index=False))
        replace_text(folder / "methods.txt", "\n".join(comparison_lines(compared, others)) + "\n")


def _row(values: dict, case: Case, result: Result) -> dict:
    torque, summary = result.torque, result.summary
    row = {**values, "end_time": case.scene.time.end}  # [s]; of points that are kept, too: others are continued
    if "current" in summary:
        row["current"] = summary["current"]
    row |= {
        "torque": torque.mean,
        "standard_error": torque.standard_error,
        "converged": torque.converged,
        "torque_rotor": summary.get("torque_rotor", {}).get("mean"),
        "gap_flux_density": summary.get("gap_flux_density"),
        "typical_overlap": summary["typical_overlap"],
        "inertial_number": summary.get("inertial_number"),
        "seconds": summary["seconds"]["whole_run"],
        "reason": torque.reason,
        "folder": result.folder.path.name,
    }
    for name in ("shear_stress", "shear_stress_error", "field_strength_powder", "fill_powder"):
        if name in summary:  # between pole faces: a point of the powder's law tau(H, phi)
            row[name] = summary[name]
    if "rotor_speed" in result.history:
        row["rotor_speed"] = float(result.history["rotor_speed"].iloc[-1])
    if "lock_up_time" in summary:  # a shaft is free
        row["output_start_time"], row["output_start_speed"] = output_start(result.history) or (None, None)
        row["lock_up_time"] = summary["lock_up_time"]
    return row


def output_start(history: Any) -> tuple[float, float] | None:
    """Time [s] and the motor's speed [rad/s] then, at which an output at rest has begun to move; None if it does not.

    It moves when it turns at `STARTED` times the fastest speed of the motor.
    """
    if "rotor_speed" not in history or "disc_speed" not in history:
        return None
    motor, output = history["rotor_speed"].to_numpy(), history["disc_speed"].to_numpy()
    moving = abs(output) > STARTED * abs(motor).max()
    if not moving.any() or moving[0]:
        return None
    first = int(moving.argmax())
    return float(history["time"].iloc[first]), float(motor[first])


def _label(study: Study, values: dict) -> str:
    """What tells a point from the others: the last part of each key that has several values, with the value."""
    several = [key for key, options in study.values.items() if len(options) > 1]
    parts = (f"{key.rpartition('.')[2].replace('_', ' ')} {values[key]}" for key in several)
    return ", ".join(parts) if not any(isinstance(values[key], (dict, list)) for key in several) else ""


def _write_tables(folder: Path, study: Study, rows: list[dict]) -> None:
    import pandas

    table = pandas.DataFrame(rows)
    replace_text(folder / "study.csv", table.to_csv(index=False))
    if list(study.values) == ["coil.current"]:
        table = table.drop(columns="coil.current").sort_values("current")
        replace_text(folder / "torque_vs_current.csv", table.to_csv(index=False))
        torque_against_current_picture(folder / "torque_vs_current.png", table, title=study.title or None)
    if list(study.values) == ["motion.rotor.speed"] and not any(map(_is_course, study.values["motion.rotor.speed"])):
        table = table.drop(columns="motion.rotor.speed").sort_values("rotor_speed")
        replace_text(folder / "torque_vs_speed.csv", table.to_csv(index=False))
        torque_against_speed_picture(folder / "torque_vs_speed.png", table, title=study.title or None)


def _is_course(value: Any) -> bool:
    return isinstance(value, dict)


class _Part:
    """Progress of one point as a share of the whole study."""

    def __init__(self, progress, number: int, total: int):
        self._progress, self._number, self._total = progress, number, total

    def update(self, fraction: float, text: str) -> None:
        self._progress.update((self._number + fraction) / self._total, self._of_point(text))

    def announce(self, text: str) -> None:
        self._progress.announce(self._of_point(text))

    def _of_point(self, text: str) -> str:
        return f"point {self._number + 1} of {self._total}: {text}"
