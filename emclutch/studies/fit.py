"""Fit of friction, rolling friction and fill to a measured torque curve: a study of the scene, then least squares.

Every combination of the values asked for is run at some of the measured drives (`emclutch.studies.sweep`); the torques
between them are interpolated and fitted by `emclutch.studies.torque_fit`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from emclutch.results import OutputError, RunFolder
from emclutch.results.atomic_file import json_values, replace_json, replace_text
from emclutch.results.fits import NORMAL
from emclutch.results.pictures.figure import legend_below, make_logarithmic, new_figure, save_picture
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Mark, Picture, Report, Shown, Statement, Statements, note, warning
from emclutch.results.study_result import load_study
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.fault_report import key_fault, quantity_at
from emclutch.scene.flat import differing_keys, flat_scene
from emclutch.scene.model import Scene
from emclutch.scene.study import read_study
from emclutch.studies.sweep import sweep
from emclutch.studies.torque_fit import MeasuredTorques, SimulatedTorques, TorqueFit, fit_torque, read_torques

if TYPE_CHECKING:
    from emclutch.results.study_table import StudyTable
    from emclutch.scene.units import Quantity

CURRENT = "coil.current"
DRIVES = 3
"""Drives that are simulated unless they are given: the smallest and the largest measured, and between them."""
FRICTION, FILL = "contact.friction", "particles.solid_fraction"
AMOUNTS = ("particles.mass", "particles.count")


@dataclass(frozen=True, slots=True, kw_only=True)
class Varied:
    """Values of each parameter that are simulated; one value: the parameter is not fitted.

    Attributes
    ----------
    friction, rolling : tuple of float
        Coefficients between grains, and at walls where the scene does not say otherwise.
    fill : tuple of float
        Solid fraction; empty: the amount of powder stays as the scene says.
    """

    friction: tuple[float, ...] = (0.2, 0.4, 0.7)
    rolling: tuple[float, ...] = (0.0, 0.2, 0.5)
    fill: tuple[float, ...] = ()

    def keys(self, scene: Scene) -> dict[str, tuple[float, ...]]:
        """Return the values by the scene's keys; grains that roll freely in the scene and in all values need none."""
        given = {FRICTION: self.friction, rolling_key(scene): self.rolling, FILL: self.fill}
        if not any(self.rolling) and scene.effects.rolling is None:
            del given[rolling_key(scene)]
        return {key: tuple(sorted(set(values))) for key, values in given.items() if values}


def rolling_key(scene: Scene) -> str:
    """Return the key of the coefficient of rolling friction."""
    (kind,) = (one for one in scene.effects.kinds() if one.role == "rolling")
    return f"effects.{kind.name}.coefficient"


@dataclass(frozen=True, slots=True)
class FitResult(Reported):
    """A fit with its folder.

    Attributes
    ----------
    folder : Path
        With fit.json, fit.csv, valley.csv, fit.png, fitted.toml, the study's file and its points.
    key : str
        Of the drive.
    measured : MeasuredTorques
    left_out : int
        Measured points with a drive or a torque of 0.
    fit : TorqueFit
    doubtful : int
        Simulated points whose torque is not converged.
    case : Case
        The scene with the fitted parameters.
    """

    folder: Path
    key: str
    measured: MeasuredTorques
    left_out: int
    fit: TorqueFit
    doubtful: int
    case: Case

    def report(self) -> Report:
        """Return the parameters with their intervals."""
        report = Report(f"Fit: {self.case.scene.scene.title}", data=as_data(self), folder=self.folder)
        report.add("Result", Statements([*_statements(self)]), Shown.TERMINAL)
        return report.add("Picture", Picture("measured and fitted torque", self.folder / "fit.png"), Shown.PAGE)


def fit(
    case: Case | str | Path,
    to: str | Path,
    *,
    varied: Varied = Varied(),
    key: str = CURRENT,
    drives: tuple[float, ...] = (),
    repose: tuple[float, float] | None = None,
    common_error: float = 0.0,
    out: str | Path | None = None,
    jobs: int | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress: StudyTable | None = None,
    force: bool = False,
) -> FitResult:
    """Fit contact parameters of a scene to a measured torque curve.

    Parameters
    ----------
    case : Case or the path of a scene file.
    to : file of the measured curve, as `emclutch.studies.torque_fit.read_torques` takes it.
    varied : what is simulated and fitted.
    key : dotted key of the drive; its unit is that of the curve's first column.
    drives : simulated drives [SI], from the smallest to the largest that are fitted; default: three of those measured.
    repose : angle of repose and its standard error [rad], fitted as one more measurement.
    common_error : relative standard error that all measured torques share, as that of a calibration; 0.03 for 3 %.
    out : folder; default: the next fits/<case>-<nnn>.
    jobs, threads, resume, progress, force : of the study, as of `emclutch.sweep`.

    Raises
    ------
    SceneError
        Faults of the scene, or of what is varied.
    OutputError, RunError
        The curve cannot be read; the folder is there already, or was begun for another scene or values; of the study.
    """
    case = as_case(case)
    if not 0.0 <= common_error < 1.0:
        message = "is out of range; allowed: >= 0, < 1, e.g. 0.03 for 3 % of each torque"
        raise SceneError([Fault("common_error", f"{common_error:g}", message)], "fit")
    if case.scene.geometry.measured != "torque":
        kind = case.scene.geometry.name()
        message = "has no torque that could be fitted; take a scene of a clutch, a brake or a shear_cell"
        raise SceneError([Fault("geometry.kind", repr(kind), message)], case.name)
    case = case.with_values({"particles.repose": None})  # its friction is what is looked for
    drive = drive_quantity(case, key)
    measured, left_out = read_torques(to, drive.unit)
    simulated_at = drives or _some(measured.drive)
    within = (measured.drive >= min(simulated_at) * (1 - 1e-9)) & (measured.drive <= max(simulated_at) * (1 + 1e-9))
    left_out += int((~within).sum())
    error = None if measured.error is None else measured.error[within]
    measured = MeasuredTorques(measured.drive[within], measured.torque[within], error, common_error)
    values = varied.keys(case.scene)
    names = fitted_names(values)
    other = None if repose is None else _bulk_friction(case.scene, values, *repose)
    if len(measured.drive) + (repose is not None) <= len(names):
        message = (
            f"has {len(measured.drive)} points at the simulated drives, {min(simulated_at):g} to "
            f"{max(simulated_at):g} {drive.unit}, too few for {len(names)} parameters; measure more, fit fewer, or "
            "change --at"
        )
        raise SceneError([Fault("--to", str(to), message)], "command line")
    folder = Path(out) if out is not None else RunFolder.next_path(case.name, "fits")
    if folder.exists() != resume:
        how = (
            "name another folder with --out, or continue it with --resume" if folder.exists() else "name it with --out"
        )
        raise OutputError(f"{folder} {'exists' if folder.exists() else 'is not there'}; {how}")
    points = {**values, key: tuple(simulated_at)}
    base = study_case(case, {name: levels for name, levels in values.items() if name in (FRICTION, FILL)})
    if resume:
        _refuse_other(folder, base, points)
    else:
        for levels in product(*points.values()):  # a scene that is refused leaves no folder behind
            study_case(case, values).with_values(dict(zip(points, levels, strict=True)))
        _write_study(folder, base, points)
    study = read_study(folder / "study.toml", trust_scripts=case.trust_scripts)
    done, begun = folder / "points", (folder / "points").is_dir()
    sweep(study, out=done, threads=threads, resume=begun, jobs=jobs, progress=progress, force=force)
    simulated, doubtful = _torques(done, names, key)
    try:
        found = fit_torque(simulated, measured, other)
    except ValueError as reason:
        raise SceneError([Fault("fit", "", str(reason))], str(to)) from None
    best = {one.name: one.value for one in found.parameters}
    fitted = study_case(case, values).with_values(best)
    result = FitResult(folder, key, measured, left_out, found, doubtful, fitted)
    _write(result)
    return result


def study_case(case: Case, values: dict[str, tuple[float, ...]]) -> Case:
    """Return the scene with the first of all values; a solid fraction replaces another amount of powder."""
    gone = dict.fromkeys(AMOUNTS if FILL in values else ())
    return case.with_values(gone | {name: levels[0] for name, levels in values.items()})


def drive_quantity(case: Case, key: str) -> Quantity:
    """Return the quantity of the drive; SceneError for a key that is none."""
    reason = key_fault(key, Scene)
    if not reason and getattr(case.scene, key.partition(".")[0], None) is None:
        reason = "is in a section that the scene does not have; name its drive, e.g. --over field.field_strength"
    quantity = None if reason else quantity_at(key, Scene, case.data)
    if quantity is None:
        message = reason or "is not a continuous quantity; fit over a current, a voltage or a field strength"
        raise SceneError([Fault("--over", key, message)], "command line")
    return quantity


def _some(drives: np.ndarray) -> tuple[float, ...]:
    """Return the smallest and the largest drive, and those nearest to equal ratios between them."""
    wanted = np.geomspace(drives[0], drives[-1], DRIVES)
    return tuple(sorted({float(drives[np.argmin(np.abs(np.log(drives / one)))]) for one in wanted}))


def _write_study(folder: Path, base: Case, values: dict[str, tuple[float, ...]]) -> None:
    folder.mkdir(parents=True)
    base.write_toml(folder / "scene.toml")
    study = {"case": "scene.toml", "title": f"fit of {base.name}", "values": {k: list(v) for k, v in values.items()}}
    replace_text(folder / "study.toml", tomli_w.dumps({"study": study}))


def _refuse_other(folder: Path, base: Case, values: dict[str, tuple[float, ...]]) -> None:
    """Raise OutputError where the fit in a folder was begun for another scene, or with other values."""
    try:
        scene = (folder / "scene.toml").read_text(encoding="utf-8")
        study = tomllib.loads((folder / "study.toml").read_text(encoding="utf-8"))["study"]["values"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{folder} holds no fit to continue: {error}; begin a new one with --out") from None
    differing = differing_keys(flat_scene(scene), flat_scene(base.toml()))
    differing += differing_keys(study, {key: list(levels) for key, levels in values.items()})
    if differing:
        raise OutputError(
            f"the fit in {folder} was begun with another {' and another '.join(dict.fromkeys(differing))}; give what "
            "it was begun with, or begin a new one with --out"
        )


def _torques(points: Path, names: tuple[str, ...], key: str) -> tuple[SimulatedTorques, int]:
    """Return the torques of a study's points, and how many are not converged."""
    table = load_study(points).table
    torque = table["torque"].to_numpy(dtype=float)
    torque = torque * np.sign(np.nanmedian(torque))  # one of the other sign is noise, and is refused by the fit
    error = np.nan_to_num(table["standard_error"].to_numpy(dtype=float))
    doubtful = int((~table["converged"].astype(bool)).sum())
    parameters = table[list(names)].to_numpy(dtype=float)
    return SimulatedTorques(names, parameters, table[key].to_numpy(dtype=float), torque, error), doubtful


def _bulk_friction(
    scene: Scene, values: dict[str, tuple[float, ...]], repose: float, spread: float
) -> Callable[[np.ndarray], float]:
    """Return the residual of the angle of repose, in standard errors of its sine and of the table together.

    The softness of the table's contacts counts as a uniform error of its whole size.
    """
    from particles.bulk_friction.friction_table import SOFTNESS, measured_table  # local: of an angle only

    table, wanted = measured_table(), math.sin(repose)
    if values[FRICTION][-1] > table.friction[-1]:
        message = f"goes beyond the table of bulk friction, 0 to {table.friction[-1]:g}; lower it, or remove --repose"
        raise SceneError([Fault("--friction", f"{values[FRICTION][-1]:g}", message)], "command line")
    names = fitted_names(values)

    def residual(p: np.ndarray) -> float:
        fixed = {key: levels[0] for key, levels in values.items()} | dict(zip(names, p, strict=True))
        mean, error = table.bulk_friction(float(fixed[FRICTION]), float(fixed.get(rolling_key(scene), 0.0)))
        return (mean - wanted) / math.hypot(spread * math.cos(repose), error, SOFTNESS * mean / math.sqrt(3.0))

    return residual


def fitted_names(values: dict[str, tuple[float, ...]]) -> tuple[str, ...]:
    """Return the keys that have more than one value."""
    return tuple(name for name, levels in values.items() if len(levels) > 1)


def _write(result: FitResult) -> None:
    """Write fit.json, fit.csv, valley.csv, fit.png and fitted.toml; what an earlier fit left there is replaced."""
    folder, fitted, measured = result.folder, result.fit, result.measured
    replace_json(folder / "fit.json", as_data(result))
    rows = zip(measured.drive, measured.torque, fitted.torque, fitted.low, fitted.high, strict=True)
    head = f"{result.key},torque_measured,torque,low,high\n"
    replace_text(folder / "fit.csv", head + "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in rows))
    names = ",".join(one.name for one in fitted.parameters)
    valley = "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in fitted.valley)
    replace_text(folder / "valley.csv", f"{names}\n{valley}")
    replace_text(folder / "fitted.toml", result.case.toml())
    _draw(result)
    write_index(result.report())


def _draw(result: FitResult) -> None:
    """Measured and fitted torque over the drive, and the valley of the first two parameters."""
    fitted, measured = result.fit, result.measured
    several = len(fitted.parameters) > 1
    title = f"{result.case.scene.scene.title}: fitted torque"
    figure, axes = new_figure(9.0 if several else 5.0, 4.6, title, columns=2 if several else 1)
    bars = None if measured.error is None else NORMAL * measured.error
    axes[0].errorbar(measured.drive, measured.torque, yerr=bars, fmt="ko", ms=4, capsize=3, label="measured")
    axes[0].plot(measured.drive, fitted.torque, color="C0", label="fitted")
    axes[0].fill_between(measured.drive, fitted.low, fitted.high, color="C0", alpha=0.25, label="95 %")
    axes[0].set(xlabel=result.key, ylabel="torque [N m]")
    make_logarithmic(axes[0])
    legend_below(axes[0], 3)
    if several:
        a, b = fitted.parameters[:2]
        axes[1].plot(*fitted.valley[:, :2].T, color="C0", label="best within 95 %")
        axes[1].plot(a.value, b.value, "o", color="C3", label="best")
        axes[1].set(xlabel=a.name, ylabel=b.name)
        legend_below(axes[1], 2)
    save_picture(figure, result.folder / "fit.png")


def as_data(result: FitResult) -> dict[str, Any]:
    """The fit for a machine; torques in N m."""
    fitted = result.fit
    return json_values(
        {
            "parameters": [asdict(one) for one in fitted.parameters],
            "valley": fitted.valley.tolist(),
            "sum_of_squares": fitted.sum_of_squares, "degrees_of_freedom": fitted.degrees_of_freedom,
            "probability": fitted.probability, "scatter": fitted.scatter, "is_poor": fitted.is_poor,
            "measured_points": len(result.measured.drive), "left_out": result.left_out,
            "common_error": result.measured.common_error,
            "not_converged": result.doubtful, "drive": result.key, "folder": str(result.folder),
        }
    )  # fmt: skip


def _statements(result: FitResult) -> Iterator[Statement]:
    """Say the parameters with their intervals, how well they fit, and what would bound them."""
    fitted = result.fit
    for one in fitted.parameters:
        ends = ("" if bounded else ", the end of what was simulated" for bounded in one.bounded)
        low, high = (f"{value:.3g}{end}" for value, end in zip((one.low, one.high), ends, strict=True))
        mark = Mark.GOOD if all(one.bounded) else Mark.WARNING
        yield Statement(mark, f"{one.name} = {one.value:.3g} (95 %: {low} to {high}).")
    if len(fitted.parameters) > 1 and len(fitted.valley) > 1:
        pairs = " to ".join("(" + ", ".join(f"{v:.3g}" for v in row) + ")" for row in fitted.valley[[0, -1]])
        yield note(f"They vary together from {pairs}, see valley.csv.")
    if names := ", ".join(one.name for one in fitted.parameters if not any(one.bounded)):
        yield note(f"The curve does not bound {names}: add another measurement, e.g. --repose '34 deg'.")
    if names := ", ".join(one.name for one in fitted.parameters if sum(one.bounded) == 1):
        yield note(f"{names} may lie beyond the values that were simulated: widen their range.")
    left = f", {result.left_out} left out (0, or beyond the simulated drives)" if result.left_out else ""
    points = f"{len(result.measured.drive)} points{left}"
    yield note(f"Scatter of measured over fitted torques: {100.0 * fitted.scatter:.2g} %, {points}.")
    if common := result.measured.common_error:
        yield note(f"The intervals contain a common error of {100.0 * common:.3g} % of all measured torques.")
    if fitted.is_poor:
        probability = f"probability {fitted.probability:.1g}"
        yield Statement(Mark.UNUSABLE, f"No parameters in the range fit this curve within its errors ({probability}).")
        yield note("Widen the range, or the difference is not one of these parameters.")
    if result.doubtful:
        yield warning(f"{result.doubtful} simulated torques are not converged; run longer, or take more replicas")
    yield note(f"Scene: {result.folder / 'fitted.toml'}")
