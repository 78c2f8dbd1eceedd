"""A parameter study: every point is a run in a folder of its own; a table and a picture of the torque at the end."""

from __future__ import annotations

from pathlib import Path

from emclutch.results import OutputError, Result, RunFolder, load_result
from emclutch.results.atomic_file import replace_text
from emclutch.results.study_pictures import torque_against_current_picture
from emclutch.run_case import Interrupted, run
from emclutch.scene.study import Study, load_study


def sweep(
    study: Study | str | Path,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress=None,
) -> Path:
    """Run every point of a study, one after the other, and return the study's folder.

    The folder holds point-000, point-001, ... (each a whole run), `study.csv` with a row a point, and for a sweep
    of `coil.current` alone also `torque_vs_current.csv` and `.png`. Tables are written anew after every point.

    Parameters
    ----------
    study : a Study, or the path of a study file.
    out : folder; default: the next free studies/<name>-<nnn>.
    resume : keep the points that are done and continue the others from their checkpoints.

    Raises
    ------
    SceneError, OutputError, RunError
        As for a single run; the points that are done stay.
    """
    study = study if isinstance(study, Study) else load_study(study)
    folder = Path(out) if out is not None else RunFolder.next_path(study.path.stem, "studies")
    if not resume and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder} is in use; continue it with --resume, or write elsewhere with --out")
    points = list(study.cases())
    rows: list[dict] = []
    for number, (values, case) in enumerate(points):
        target = RunFolder(folder / f"point-{number:03d}")
        if resume and target.summary.is_file() and target.case.read_text(encoding="utf-8") == case.toml():
            result = load_result(target.path)
        else:
            part = None if progress is None else _Part(progress, number, len(points))
            resumed = resume and target.checkpoint.is_file()
            try:
                result = run(case, out=target.path, threads=threads, progress=part, resume=resumed)
            except Interrupted as stopped:
                hint = f"go on with: emclutch sweep {study.path} --out {folder} --resume"
                raise Interrupted(f"stopped at point {number + 1} of {len(points)}; {hint}") from stopped
        rows.append(_row(values, result))
        _write_tables(folder, study, rows)
    return folder


def _row(values: dict, result: Result) -> dict:
    torque, summary = result.torque, result.summary
    row = dict(values)
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
    return row


def _write_tables(folder: Path, study: Study, rows: list[dict]) -> None:
    import pandas

    table = pandas.DataFrame(rows)
    replace_text(folder / "study.csv", table.to_csv(index=False))
    if list(study.values) == ["coil.current"]:
        table = table.drop(columns="coil.current").sort_values("current")
        replace_text(folder / "torque_vs_current.csv", table.to_csv(index=False))
        torque_against_current_picture(folder / "torque_vs_current.png", table, title=study.title or None)


class _Part:
    """Progress of one point as a share of the whole study."""

    def __init__(self, progress, number: int, total: int):
        self._progress, self._number, self._total = progress, number, total

    def update(self, fraction: float, text: str) -> None:
        self._progress.update(
            (self._number + fraction) / self._total, f"point {self._number + 1} of {self._total}: {text}"
        )
