"""Fit of friction, rolling friction and fill to a measured torque curve by the law of the powder, without a run.

The law (`emclutch.simulation.forecast.expected_torque`) gives the torque of a grid of powders at up to `DRIVES` of the
measured currents, in fields that are solved for them; `emclutch.studies.torque_fit` fits these to the curve.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas
import tomli_w

from emclutch.device_model.device import build_device
from emclutch.results.atomic_file import json_values, replace_json, replace_text
from emclutch.results.new_path import new_folder
from emclutch.results.pictures.figure import draw_measured, legend_below, make_logarithmic, new_figure, save_picture
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Links, Mark, Picture, Report, Shown, Statement, Statements, note, warning
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError, bad_input_for, entry_at
from emclutch.scene.fault_report import key_fault, quantity_at
from emclutch.scene.map_axes import CURRENT, KEYS, SHARE_A_MESH
from emclutch.scene.model import Scene
from emclutch.scene.units import format_number
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, torques_of_powders
from emclutch.simulation.forecast.powder_law import POWDERS, law_of, powder_of, shipped_laws
from emclutch.studies.design_search import expectation_of
from emclutch.studies.measured_torques import trend_in_words
from emclutch.studies.torque_fit import WITHIN, MeasuredTorques, TorqueFit, TrialTorques, fit_torque, read_torques
from field import MagneticField
from field.section.ampere_turns import ampere_turns_by_part
from particles.bulk_friction.friction_table import SOFTNESS, measured_table

if TYPE_CHECKING:
    from emclutch.results import Progress
    from emclutch.scene.units import Quantity

DRIVES = 6
"""Drives at most at which the law is computed; between them ln T is a cubic spline of ln x."""
TRIALS = {1: 21, 2: 21, 3: 13}
"""Values of each parameter for which the law is computed, by the number of parameters."""
FRICTION, FILL = "contact.friction", "particles.solid_fraction"
MISFITS, LARGE_SHARE, LARGE_SCATTER = 3, 0.1, 0.1
"""Points that are named where nothing fits; part of the ampere-turns from which on the clearance is suspected; scatter
from which on a fit without errors is doubtful."""
AMOUNTS = ("particles.mass", "particles.count")

Ends = float | tuple[float, float]


@dataclass(frozen=True, slots=True, repr=False)
class FitResult(Reported):
    """A fit with its folder.

    Attributes
    ----------
    folder : Path
        With fit.json, fit.csv, valley.csv, fit.png, fitted.toml and index.html.
    key, unit : str
        Of the drive, the unit in SI.
    source : Path
        The measured table.
    measured : MeasuredTorques
    left_out : int
        Measured points with a drive or a torque that is not above 0.
    fit : TorqueFit
    repose : tuple of float or None
        Angles of repose [rad] of the powders within the 95 % interval; None where friction is not fitted.
    case : Case
        The scene with the fitted parameters.
    expected : ExpectedTorque
        Of that scene at the largest measured drive.
    own : dict of str to float
        The scene's own values of the fitted parameters; empty where they were not tried.
    clearance : float or None
        Part of the ampere-turns in the running clearance there; None where the curve is fitted, or there is none.
    """

    folder: Path
    key: str
    unit: str
    source: Path
    measured: MeasuredTorques
    left_out: int
    fit: TorqueFit
    repose: tuple[float, float] | None
    case: Case
    expected: ExpectedTorque
    own: dict[str, float]
    clearance: float | None = None

    def report(self) -> Report:
        """Return the parameters with their intervals."""
        report = Report(f"Fit: {self.case.scene.scene.title}", data=as_data(self), folder=self.folder)
        report.add("Result", Statements([*_statements(self)]), Shown.TERMINAL)
        report.add("Picture", Picture("measured and fitted torque", self.folder / "fit.png"), Shown.PAGE)
        parameters = "nearest parameters, which do not fit" if self.fit.is_poor else "best parameters"
        files = [
            ("fitted.toml", f"the scene with the {parameters}"), ("fit.csv", "measured and fitted torques"),
            ("valley.csv", "parameters that fit together"), ("fit.json", "all numbers in SI"),
        ]  # fmt: skip
        return report.add("Files", Links(files), Shown.PAGE)


def fit(
    case: Case | str | Path,
    to: str | Path,
    *,
    friction: Ends = POWDERS["friction"],
    rolling_friction: Ends = POWDERS["rolling friction"],
    fill: Ends | None = None,
    over: str = CURRENT,
    repose: tuple[float, float] | None = None,
    common_error: float = 0.0,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Fit friction, rolling friction and fill of a scene to a measured torque curve.

    Parameters
    ----------
    case : Case or the path of a scene file.
    to : file of the measured curve, as `emclutch.studies.torque_fit.read_torques` takes it.
    friction, rolling_friction : least and largest coefficient between which it is fitted, or the one it has.
    fill : the same of the solid fraction; default: the amount of powder of the scene.
    over : dotted key of the drive; its unit is that of the curve's first column.
    repose : angle of repose and its standard error [rad], fitted as one more measurement.
    common_error : relative standard error that all measured torques share, as that of a calibration; 0.03 for 3 %.
    out : new folder; default: the next fits/<case>-<nnn>.
    progress : takes the fraction that is done.

    Raises
    ------
    SceneError
        Faults of the scene, or of what is fitted.
    OutputError
        The curve cannot be read; the folder is there already.
    """
    case = as_case(case)
    case.need_grains()
    if not 0.0 <= common_error < 1.0:
        message = "is out of range; allowed: >= 0, < 1, e.g. 0.03 for 3 % of each torque"
        raise SceneError([Fault("common_error", f"{common_error:g}", message)], "fit")
    if case.scene.geometry.measured != "torque":
        kind = case.scene.geometry.name()
        message = "has no torque that could be fitted; take a scene of a clutch, a brake or a shear_cell"
        raise SceneError([Fault("geometry.kind", repr(kind), message)], case.name)
    drive = _drive_quantity(case, over)
    measured, left_out = read_torques(to, drive.unit)
    measured = replace(measured, common_error=common_error)
    folder = new_folder(out, case.name, "fits")
    ends = _ends(case.scene, friction, rolling_friction, fill)
    names = tuple(key for key, values in ends.items() if len(values) > 1)
    if not names:
        message = "have one value each: nothing is fitted; give one of them a range, e.g. 0.2:0.7"
        raise SceneError([Fault("friction, rolling_friction, fill", "", message)], "fit")
    if measured.error is None and len(measured.drive) + (repose is not None) <= len(names):
        message = f"has {len(measured.drive)} points without errors, too few for {len(names)} parameters; "
        message += "measure more, fit fewer, or add a column 'error [N m]'"
        raise SceneError([Fault("to", str(to), message)], "fit")
    gone = {"particles.repose": None} | dict.fromkeys(AMOUNTS if FILL in ends else ())  # their values are looked for
    gone |= {} if names == (FILL,) else {"particles.powder_law": None}  # of one friction
    for values in product(*ends.values()):
        case.with_values(gone | dict(zip(ends, values, strict=True)))  # SceneError where one is not valid
    base = case.with_values(gone | {key: sum(values) / len(values) for key, values in ends.items()})
    grid = {key: np.linspace(v[0], v[-1], TRIALS[len(names)]) if len(v) > 1 else np.array(v) for key, v in ends.items()}
    drives = np.unique(measured.drive)
    if len(drives) > DRIVES:
        drives = np.geomspace(drives[0], drives[-1], DRIVES)
    trials = _trials(base, over, drives, grid, progress)

    def bulk_friction(levels: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return tau/P and its standard error on the grid of the fit, or to be repeated along the fill."""
        fitted, table = grid | dict(zip(names, levels, strict=True)), measured_table()
        at = fitted[FRICTION], fitted.get(_rolling_key(case.scene), np.zeros(1))
        shape = [1 if key == FILL else len(fitted[key]) for key in names]
        mean, error = (replace(table, mean=one).on_grid(*at).reshape(shape) for one in (table.mean, table.error))
        return mean, error

    def residual(levels: tuple[np.ndarray, ...]) -> np.ndarray:
        """Return that of the angle of repose; the softness of the table's contacts is a uniform error of its size."""
        assert repose is not None
        mean, error = bulk_friction(levels)
        sine_error = repose[1] * math.cos(repose[0])
        found = (mean - math.sin(repose[0])) / np.sqrt(sine_error**2 + error**2 + (SOFTNESS * mean) ** 2 / 3.0)
        return np.broadcast_to(found, [len(one) for one in levels])

    found = fit_torque(trials, measured, None if repose is None else residual)
    best = {one.name: float(f"{one.value:.4g}") for one in found.parameters}
    fixed = {key: values[0] for key, values in ends.items() if key not in names}
    fitted = case.with_values(gone | fixed | best)
    angles = None
    if names != (FILL,):
        bulk = np.broadcast_to(bulk_friction(found.levels)[0], found.excess.shape)[found.excess <= WITHIN]
        angles = math.asin(float(bulk.min())), math.asin(float(bulk.max()))
    largest = float(measured.drive.max())
    expected = expectation_of(_driven(fitted, over, largest))
    clearance = _clearance_share(_driven(fitted, over, largest)) if found.is_poor else None
    own = dict(zip((FRICTION, _rolling_key(case.scene)), powder_of(case.scene), strict=False))
    own |= {FILL: build_device(case.scene).fill.solid_fraction} if FILL in ends else {}
    tried = all(values[0] <= own[key] <= values[-1] for key, values in ends.items())
    own = {name: own[name] for name in names if tried}
    result = FitResult(folder, over, drive.unit, Path(to), measured, left_out, found, angles, fitted, expected, own,
                       clearance)  # fmt: skip
    _write(result)
    return result


def _rolling_key(scene: Scene) -> str:
    """Return the key of the coefficient of rolling friction."""
    (kind,) = (one for one in scene.effects.kinds() if one.role == "rolling")
    return f"effects.{kind.name}.coefficient"


def _ends(scene: Scene, friction: Ends, rolling: Ends, fill: Ends | None) -> dict[str, tuple[float, ...]]:
    """Return the value of each key, or the ends of its range; grains that roll freely throughout need no key of it."""
    given = {FRICTION: ("friction", friction), _rolling_key(scene): ("rolling friction", rolling), FILL: ("", fill)}
    found, faults = {}, []
    for key, (name, entry) in given.items():
        values = () if entry is None else tuple(sorted(set(entry if isinstance(entry, tuple) else (entry,))))
        low, high = POWDERS.get(name, (0.0, math.inf))
        for value in values:
            if not low <= value <= high:
                message = f"is out of range; the law of the powder holds from {low:g} to {high:g}"
                faults.append(Fault(key, f"{value:g}", message))
        found[key] = values
    if faults:
        raise SceneError(faults, "fit")
    if not any(found[_rolling_key(scene)]) and scene.effects.rolling is None:
        del found[_rolling_key(scene)]
    return {key: values for key, values in found.items() if values}


def _drive_quantity(case: Case, key: str) -> Quantity:
    """Return the quantity of the drive; SceneError for a key that is none."""
    reason = key_fault(key, Scene)
    if not reason and getattr(case.scene, key.partition(".")[0], None) is None:
        reason = "is in a section that the scene does not have; name its drive, e.g. --over field.field_strength"
    quantity = None if reason else quantity_at(key, Scene, case.data)
    if quantity is None:
        message = reason or "is not a continuous quantity; fit over a current, a voltage or a field strength"
        raise SceneError([Fault("over", key, message)], "fit")
    return quantity


def _driven(case: Case, key: str, value: float) -> Case:
    """Return the scene with a drive [SI] in place of what else drives it."""
    replaced = next((one for own, one, _ in KEYS.values() if own == key), ())
    gone = [one for one in replaced if entry_at(case.data, one.split(".")) is not None]
    return case.with_values({**dict.fromkeys(gone), key: value})


def _clearance_share(case: Case) -> float | None:
    """Return the part of the ampere-turns in the clearance of a section; None where the field does not tell it."""
    device = build_device(case.scene)
    coil, (solution, _) = device.section_coil, expected_magnetisation(case, device)
    if coil is None or not isinstance(solution, MagneticField) or solution.history is not None:
        return None
    parts, gaps = ampere_turns_by_part(solution, coil.shape.air_gaps()), coil.shape.air_gaps()
    return sum(parts[name] for name in gaps) / sum(parts.values()) if gaps else None


def _trials(
    base: Case, key: str, drives: np.ndarray, grid: dict[str, np.ndarray], progress: Progress | None
) -> TrialTorques:
    """Return the torques of all powders at the drives, on one mesh where they can share it."""
    chi = float(np.clip(base.scene.grains.susceptibility, *POWDERS["susceptibility"]))
    rolling, fill = grid.get(_rolling_key(base.scene), np.zeros(1)), grid.get(FILL)
    powders = np.array([*product(grid[FRICTION], rolling, [chi])])
    is_measured = base.scene.grains.powder_law is not None
    laws = [law_of(base.scene)[0]] if is_measured else shipped_laws().interpolated(powders)
    device, found = None, []
    for number, value in enumerate(drives):
        at = _driven(base, key, float(value))
        with bad_input_for(base.path):
            source = at.scene.coil_field
            shares = device is not None and key.startswith(SHARE_A_MESH) and not (source and source.tolerance)
            device = device.driven_as(at.scene) if device is not None and shares else build_device(at.scene)
            fills = np.array([device.fill.solid_fraction]) if fill is None else fill
            field, _ = expected_magnetisation(at, device)
            found.append(torques_of_powders(at.scene, device, field, laws, fills))
        if progress is not None:
            progress.update((number + 1) / len(drives), f"{number + 1} of {len(drives)} drives")
    levels = {name: one for name, one in grid.items() if len(one) > 1}
    shape = (*map(len, levels.values()), len(drives))
    torque, error, guess = (np.stack(one, axis=-1).reshape(shape) for one in zip(*found, strict=True))
    return TrialTorques(tuple(levels), tuple(levels.values()), drives, torque, error, guess, laws[0].deviation)


def _write(result: FitResult) -> None:
    """Write fit.json, fit.csv, valley.csv, fit.png, fitted.toml and the page."""
    folder, fitted, measured = result.folder, result.fit, result.measured
    folder.mkdir(parents=True)
    replace_json(folder / "fit.json", as_data(result))
    points = np.column_stack([measured.drive, measured.torque, fitted.measured, fitted.guess_at])
    head = [result.key, "torque_measured", "torque", "low", "high", "is_guess"]
    names = [one.name for one in fitted.parameters]
    for name, rows, columns in (("fit.csv", points, head), ("valley.csv", fitted.valley, names)):
        replace_text(folder / name, pandas.DataFrame(rows, columns=columns).to_csv(index=False, float_format="%.6g"))
    scene = json.loads(json.dumps(result.case.resolved()), parse_float=lambda text: float(f"{float(text):.15g}"))
    replace_text(folder / "fitted.toml", tomli_w.dumps(scene))
    _draw(result)
    write_index(result.report())


def _draw(result: FitResult) -> None:
    """Measured and fitted torque over the drive, and which of the first two parameters fit."""
    fitted, measured = result.fit, result.measured
    several = len(fitted.parameters) > 1
    title = f"{result.case.scene.scene.title}: fitted torque"
    figure, axes = new_figure(9.0 if several else 5.0, 4.6, title, columns=2 if several else 1)
    drive, torque, low, high = fitted.curve.T
    axes[0].plot(drive, torque, color="C0", label=f"law, {'nearest' if fitted.is_poor else 'best'} parameters")
    axes[0].fill_between(drive, low, high, color="C0", alpha=0.25, lw=0.0, label="law, parameters within 95 %")
    error = fitted.own_error * measured.torque if measured.error is None else measured.error
    draw_measured(axes[0], {"torque": np.column_stack([measured.drive, measured.torque, error])}, joined=False)
    if fitted.guess_at.any() and not fitted.guess_at.all():
        axes[0].plot(measured.drive[fitted.guess_at], fitted.measured[fitted.guess_at, 0], "o", mfc="white", color="C0",
                     label="a guess")  # fmt: skip
    axes[0].set(xlabel=f"{result.key} [{result.unit}]" if result.unit else result.key, ylabel="torque [N m]")
    make_logarithmic(axes[0])
    legend_below(axes[0])
    if several:
        a, b = fitted.parameters[:2]
        excess = fitted.excess.reshape(*fitted.excess.shape[:2], -1).min(axis=2)
        axes[1].contourf(*fitted.levels[:2], excess.T, [-1.0, WITHIN], colors=["C0"], alpha=0.25)
        axes[1].plot([], [], color="C0", alpha=0.25, lw=8.0, label="within 95 %")
        axes[1].plot(*fitted.valley[:, :2].T, color="C0", label=f"best for each {a.name.rpartition('.')[2]}")
        axes[1].plot(a.value, b.value, "o", color="C3", label="best")
        axes[1].set(xlabel=a.name, ylabel=b.name)
        legend_below(axes[1])
    save_picture(figure, result.folder / "fit.png")


def as_data(result: FitResult) -> dict[str, Any]:
    """The fit for a machine; torques in N m, angles in rad."""
    fitted = result.fit
    return json_values(
        {
            "parameters": [asdict(one) for one in fitted.parameters],
            "valley": fitted.valley.tolist(), "repose": result.repose,
            "sum_of_squares": fitted.sum_of_squares, "degrees_of_freedom": fitted.degrees_of_freedom,
            "probability": None if result.measured.error is None else fitted.probability,
            "scatter": fitted.scatter, "is_poor": fitted.is_poor,
            "factor": fitted.factor, "is_guess": fitted.is_guess, "guess_points": int(fitted.guess_at.sum()),
            "measured_points": len(result.measured.drive), "left_out": result.left_out,
            "clearance_share": result.clearance, "fall": result.measured.largest_fall() or None,
            "own_error": fitted.own_error, "common_error": result.measured.common_error,
            "drive": result.key, "folder": str(result.folder),
        } | result.expected.as_dict()
    )  # fmt: skip


def _statements(result: FitResult) -> Iterator[Statement]:
    """Say the parameters with their intervals, how well they fit, and what would bound them; or why none fit."""
    fitted, measured = result.fit, result.measured
    judged = fitted.guess_at == fitted.guess_at.all()
    points = np.column_stack([measured.drive, measured.torque / fitted.measured[:, 0]])[judged]
    trend = trend_in_words("measured divided by fitted torque", points, partial(_drive, result))
    yield from _of_misfit(result, trend) if fitted.is_poor else _of_parameters(result)
    if trend and (measured.error is None or fitted.is_poor):
        yield warning(trend)
    if drag := result.case.scene.motion.drag_in_words:
        yield note(drag)
    if fall := measured.largest_fall():
        (before, high), (after, low) = fall
        yield warning(
            f"the measured torque falls from {high:.3g} N m at {_drive(result, before)} to {low:.3g} N m at "
            f"{_drive(result, after)}, by more than its errors; by the law it cannot fall. Suspect the point, or the "
            "temperature of the coil, where the current was not measured at each point"
        )
    left = f", {result.left_out} left out (a drive or a torque not above 0)" if result.left_out else ""
    left = " without guesses" * (not judged.all()) + left
    text = f"Scatter of measured over fitted torques: {100.0 * fitted.scatter:.3g} %, {judged.sum()} points{left}."
    is_doubtful = measured.error is None and fitted.scatter > LARGE_SCATTER
    yield warning(f"{text} So large a scatter makes the values doubtful") if is_doubtful else note(text)
    if fitted.is_guess:
        yield warning(f"the fit is a guess, as is the torque: {result.expected.law}")
    elif fitted.guess_at.any():
        yield warning(
            f"{int(fitted.guess_at.sum())} of {len(measured.drive)} points have little weight: there the law is a "
            "guess for some powders of the range at least, see is_guess in fit.csv"
        )
    if fitted.is_poor:
        return
    if measured.error is None:
        yield note("No test of the fit is possible: the table has no errors. Add a column error [N m].")
    elif fitted.probability is not None:
        yield note(f"Errors alone cause a misfit this large with a probability of {100.0 * fitted.probability:.2g} %.")
    scene = str(result.folder / "fitted.toml")
    smallest = min(float(measured.drive.min()), 0.5 * float(measured.drive.max()))  # of one point a range too
    drives = f"{_drive(result, smallest)}:{_drive(result, float(measured.drive.max()))}"
    vary = ("--current", drives) if result.key == CURRENT else ("--vary", f"{result.key}={drives}")
    words = shlex.join([scene, *vary, *(("--with", str(result.source)) if result.key == CURRENT else ())])
    yield note(f"Next: map the torque of these values: emclutch map {words}")
    yield note(f"Next: measure the law of this powder by cells: emclutch powder-law {shlex.quote(scene)}")


def _drive(result: FitResult, value: float) -> str:
    return f"{format_number(value)} {result.unit}".strip()


def _of_misfit(result: FitResult, trend: str) -> Iterator[Statement]:
    """Say that nothing fits, which points are off most, and what to suspect."""
    fitted, measured = result.fit, result.measured
    why = f"within the errors (probability {fitted.probability:.1g})"
    yield Statement(Mark.UNUSABLE, f"No parameters in the range fit this curve {why}.")
    ratio = measured.torque / fitted.measured[:, 0]
    worst = np.argsort(-np.abs(np.log(ratio)), kind="stable")[:MISFITS]
    points = (f"{100.0 * (ratio[k] - 1.0):+.0f} % at {_drive(result, float(measured.drive[k]))}"
              + " (a guess of the law)" * bool(fitted.guess_at[k]) for k in worst)  # fmt: skip
    yield note(f"Largest misfits, measured against the nearest curve: {', '.join(points)}.")
    share = result.clearance or 0.0
    takes = f"geometry.clearance (it takes {100.0 * share:.2g} % of the ampere-turns), " if share > LARGE_SHARE else ""
    if fitted.has_shape and not trend:
        yield note(f"The curve has the shape of the law: {fitted.factor:.3g} times the nearest curve fits. Suspect one "
                   f"cause at all drives: {takes}calibration, winding, radius, gap or amount of powder.")  # fmt: skip
    else:
        yield note(f"Check {takes}B-H curve, gap, amount of powder and the errors of the points, or widen the range.")
    values = ", ".join(f"{one.name} = {one.value:.3g}" for one in fitted.parameters)
    yield note(f"Nearest values in the range, not to be used: {values}.")


def _of_parameters(result: FitResult) -> Iterator[Statement]:
    """Say the parameters with their intervals, and what would bound them."""
    fitted, measured = result.fit, result.measured
    for one, levels in zip(fitted.parameters, fitted.levels, strict=True):
        ends = ("" if bounded else " (end of its range)" for bounded in one.bounded)
        low, high = (f"{value:.3g}{end}" for value, end in zip((one.low, one.high), ends, strict=True))
        if not any(one.bounded):
            how = f"is not determined: all values from {one.low:.3g} to {one.high:.3g} fit. The best is {one.value:.3g}"
        elif one.value in levels[[0, -1]]:
            how = (f"ends at the limit of its range, {one.value:.3g} (95 %: {low} to {high}); there measured torques "
                   f"are {fitted.factor:.3g} times those of the law")  # fmt: skip
        else:
            how = f"= {one.value:.3g} (95 %: {low} to {high})"
        yield Statement(Mark.GOOD if all(one.bounded) else Mark.WARNING, f"{one.name} {how}.")
    yield note("One curve does not separate the fitted values from what is taken as given: other frictions, fill, gap, "
               "turns and the calibration of the bench.")  # fmt: skip
    if result.own:
        nearest = tuple(np.argmin(abs(of - own)) for of, own in zip(fitted.levels, result.own.values(), strict=True))
        fits = "fit too" if fitted.excess[nearest] <= WITHIN else "do not fit (95 %)"
        values = ", ".join(f"{name} = {value:.3g}" for name, value in result.own.items())
        yield note(f"The scene's own values {fits}: {values}.")
    several = len(fitted.parameters) > 1
    if not all(any(one.bounded) for one in fitted.parameters):
        why = "All of them change the strength of the powder, which the curve mainly fixes. " if several else ""
        yield note(f"{why}Give what is known a value, e.g. --friction 0.5.")
    if several and len(fitted.valley) > 1:
        pairs = " to ".join("(" + ", ".join(f"{v:.3g}" for v in row) + ")" for row in fitted.valley[[0, -1]])
        yield note(f"Best values vary together from {pairs}, see valley.csv.")
    if result.repose is not None:
        low, high = (f"{math.degrees(one):.3g}" for one in result.repose)
        yield note(f"The powders that fit have an angle of repose of {low} to {high} degrees.")
    if result.expected.real is not None:
        at = _drive(result, float(measured.drive.max()))
        yield note(f"Torque of the best parameters by the law at {at}: {result.expected.real.in_words()}.")
    own = "" if measured.error is not None else f" ({100.0 * fitted.own_error:.2g} %, found by the fit)"
    yield note(
        f"The intervals contain the errors of single points{own}, a common error of "
        f"{100.0 * measured.common_error:.3g} %, and the errors of the law, mostly common to all points."
    )
