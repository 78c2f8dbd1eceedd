"""Work-precision study: each numerical setting of a scene is varied, error against the finest over seconds.

A knob is one small object: a name, the settings from coarse to fine, how a setting changes the case, and the
quantities it moves. To add one: a class here, a line in `KNOBS`, and its ladder in `emclutch.scene.timing`.
All settings are timed in one session on one machine, after a short run that compiles every kernel.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Protocol

import numpy as np

from emclutch.device_model.device import build_coil_device, field_is_needed
from emclutch.results import OutputError, RunFolder
from emclutch.results.atomic_file import replace_text
from emclutch.results.folder_lock import has_files, locked_folder
from emclutch.results.pictures.work_precision import work_precision_picture
from emclutch.scene.case import Case
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.grain_smear import moments_are_fed_back, narrowest_gap
from emclutch.simulation.initial_packing import packed
from emclutch.simulation.plan import make_plan
from emclutch.simulation.run import run
from emclutch.simulation.threads import use_threads
from emclutch.studies.frozen_state import frozen_state

log = logging.getLogger(__name__)
WARM_UP_WINDOWS = 0.02  # fraction of the run that compiles the kernels before anything is timed


@dataclass(slots=True)
class Measurement:
    """Values of a setting, quantity -> number or array, with the seconds each took and its statistical error.

    Only what fluctuates has a statistical error; an unknown one is infinite, since nothing may be read off the value.
    """

    values: dict[str, float | np.ndarray]
    seconds: dict[str, float]
    noise: dict[str, float] = field(default_factory=dict)


class Knob(Protocol):
    """One setting of a scene that trades time for accuracy."""

    name: str

    def settings(self, case: Case) -> tuple[float, ...]:
        """From coarse to fine; the last is the reference."""

    def turned(self, case: Case, setting: float) -> Case:
        """The case at a setting."""

    def measure(self, case: Case, points: np.ndarray, folder: Path) -> Measurement:
        """Values and seconds of a turned case; `points` (n, 3) [m] are the grains' places."""


class FieldMesh:
    """Mesh size of the field: gap B, H and grad H at the grains, torque."""

    name = "field mesh"

    def settings(self, case: Case) -> tuple[float, ...]:
        return case.scene.accuracy.mesh if has_solved_field(case) else ()

    def turned(self, case: Case, setting: float) -> Case:
        return case.with_values({"field.size_factor": setting})

    def measure(self, case: Case, points: np.ndarray, folder: Path) -> Measurement:
        if moments_are_fed_back(case.scene):
            found, torque = standing_grains(case, points), run_torque(case, folder)
            return Measurement(found.values | torque.values, found.seconds | torque.seconds, torque.noise)
        values, seconds = field_at(case, points)
        torque = run_torque(case, folder)
        return Measurement(values | torque.values, dict.fromkeys(values, seconds) | torque.seconds, torque.noise)


class SmearWidth:
    """Width over which grains are spread where their moments are fed back: moments and pull of grains that stand."""

    name = "smear width"

    def settings(self, case: Case) -> tuple[float, ...]:
        if not moments_are_fed_back(case.scene):
            return ()
        widest = narrowest_gap(case.scene) / case.scene.grains.largest_diameter
        inside = tuple(a for a in case.scene.accuracy.smear if a <= widest)
        if "smear" not in case.data.get("accuracy", {}):  # of the default those that this scene's sector has room for
            inside = tuple(a for a in inside if self._fits(case, a))
        return inside if len(inside) > 1 else ()

    def _fits(self, case: Case, setting: float) -> bool:
        try:
            self.turned(case, setting)
        except SceneError:
            return False
        return True

    def turned(self, case: Case, setting: float) -> Case:
        return case.with_values({f"effects.{case.scene.effects.attraction.name}.cutoff": setting})

    def measure(self, case: Case, points: np.ndarray, folder: Path) -> Measurement:
        found = standing_grains(case, points)  # H itself depends on the width: it holds what is farther
        values = {name: found.values[name] for name in ("moments", "magnetic pull")}
        return Measurement(values, found.seconds)


class MomentRefresh:
    """Steps between evaluations of moments and held forces: torque."""

    name = "moment refresh"

    def settings(self, case: Case) -> tuple[float, ...]:
        attraction = case.scene.effects.attraction
        model = None if attraction is None else attraction.model
        return case.scene.accuracy.refresh if model == "near_field" and case.scene.contact.method == "dem" else ()

    def turned(self, case: Case, setting: float) -> Case:
        return case.with_values({f"effects.{case.scene.effects.attraction.name}.update_every": int(setting)})

    def measure(self, case: Case, points: np.ndarray, folder: Path) -> Measurement:
        return run_torque(case, folder)


class ContactStep:
    """Step of the grains, as steps in the duration of a contact: torque."""

    name = "contact step"

    def settings(self, case: Case) -> tuple[float, ...]:
        return case.scene.accuracy.contact_step if case.scene.span.step is None else ()

    def turned(self, case: Case, setting: float) -> Case:
        return case.with_values({"time.steps_per_contact": setting})

    def measure(self, case: Case, points: np.ndarray, folder: Path) -> Measurement:
        return run_torque(case, folder)


KNOBS: tuple[Knob, ...] = (FieldMesh(), SmearWidth(), MomentRefresh(), ContactStep())


def has_solved_field(case: Case) -> bool:
    """True if the case solves for the field of a coil."""
    return case.scene.coil_field is not None and field_is_needed(case.scene)


def field_at(case: Case, points: np.ndarray) -> tuple[dict[str, float | np.ndarray], float]:
    """Gap B [T], H [A/m] and grad H [A/m^2] at `points` without grains; and the seconds it took."""
    scene = case.scene
    begin = perf_counter()
    coil = build_coil_device(scene)
    solution = coil.solve_at_peak(None)
    H, grad_H = solution.sampler("powder").sample(points)
    seconds = perf_counter() - begin
    return {"gap B": coil.gap_flux_density(solution), "H at grains": H, "grad H at grains": grad_H}, seconds


def standing_grains(case: Case, points: np.ndarray) -> Measurement:
    """H [A/m] and grad H [A/m^2], moments [A m^2] and pull across the gap [J] of the scene's grains at `points`."""
    found = frozen_state(case, points)
    values: dict[str, float | np.ndarray] = {
        "H at grains": found.field,
        "grad H at grains": found.gradient,
        "moments": found.moment,
        "magnetic pull": found.stress,
    }
    return Measurement(values, dict.fromkeys(values, found.seconds))


def run_torque(case: Case, folder: Path) -> Measurement:
    """The disc's mean torque [N m] of a whole run without snapshots and pictures."""
    result = run(case, out=folder)
    if result.torque.mean is None:
        return Measurement({}, {})
    return Measurement(
        {"torque": result.torque.mean},
        {"torque": result.summary["seconds"]["total"]},
        {"torque": np.inf if result.torque.standard_error is None else result.torque.standard_error},
    )


def accuracy(case: Case, *, out: str | Path | None = None, threads: int | None = None, progress=None) -> Path:
    """Turn every knob of a case; write accuracy.csv and accuracy.png and return their folder.

    The table has a row a knob, setting and quantity: value, relative error against the knob's finest setting (RMS
    over points for fields), its statistical error where there is one, and wall-clock seconds.

    Raises SceneError, before anything runs, for a scene without a disc or without anything to vary, and where a
    setting of a knob is none that the scene can have.
    """
    _refuse_what_has_no_price(case)
    use_threads(threads)
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-accuracy", "studies")
    with locked_folder(folder):
        if has_files(folder):
            raise OutputError(f"{folder} is not empty; write elsewhere with --out")
        _turn_all(case, folder, progress)
    return folder


def _turn_all(case: Case, folder: Path, progress) -> None:
    quiet = {"output.snapshots": 0, "output.pictures": False, "output.checkpoint": False, "output.formats": []}
    if case.scene.accuracy.time_end is not None:
        quiet["time.end"] = case.scene.accuracy.time_end
    base = case.with_values(quiet)
    turns = [(knob, setting, knob.turned(base, setting)) for knob in KNOBS for setting in knob.settings(base)]
    _say(progress, 0.0, "a short run compiles the kernels")
    run(base.with_values({"time.end": WARM_UP_WINDOWS * base.scene.span.end}), out=folder / "warm-up")
    points = packed_points(base)
    if has_solved_field(base) and not moments_are_fed_back(base.scene):
        field_at(base, points)
    measured: dict[tuple[str, float], Measurement] = {}
    for number, (knob, setting, turned) in enumerate(turns):
        _say(progress, number / len(turns), f"{knob.name} = {setting:g}")
        target = folder / f"{knob.name.replace(' ', '-')}-{setting:g}"
        measured[knob.name, setting] = knob.measure(turned, points, target)
    table = price_table(measured)
    replace_text(folder / "accuracy.csv", table.to_csv(index=False))
    work_precision_picture(folder / "accuracy.png", table, title=case.scene.scene.title)
    _say(progress, 1.0, "done")
    show(table)


def _refuse_what_has_no_price(case: Case) -> None:
    """Raise SceneError for a scene without the torque to compare, or without a knob to turn."""
    case.need_grains()
    source = "scene" if case.path is None else str(case.path)
    if not case.scene.geometry.has_axis:
        message = "has no disc, and accuracy is measured by the disc's torque; take a clutch, a drum or a shear_cell"
        raise SceneError([Fault("geometry.kind", shown(case.scene.geometry.name()), message)], source)
    if not any(knob.settings(case) for knob in KNOBS):
        message = "leaves nothing to vary: the step is fixed and no field is solved; take 'auto'"
        raise SceneError([Fault("time.step", shown(case.scene.span.step), message)], source)


def price_table(measured: dict[tuple[str, float], Measurement]):
    """DataFrame knob, setting, quantity, value, error, noise, seconds; the last setting of a knob is its reference."""
    import pandas

    rows = []
    last = {name: measured[name, setting] for name, setting in measured}
    for (name, setting), found in measured.items():
        reference = last[name]
        for quantity, value in found.values.items():
            truth = reference.values.get(quantity)
            error = None if found is reference or truth is None else relative_error(value, truth)
            scale = abs(truth) if isinstance(truth, float) and truth else 1.0
            noise = None
            if quantity in found.noise:
                noise = np.hypot(found.noise[quantity], reference.noise.get(quantity, np.inf)) / scale
            rows.append(
                {
                    "knob": name,
                    "setting": setting,
                    "quantity": quantity,
                    "value": float(value) if np.ndim(value) == 0 else float(np.sqrt(np.mean(np.square(value)))),
                    "error": error,
                    "noise": noise,
                    "seconds": found.seconds[quantity],
                }
            )
    return pandas.DataFrame(rows)


def relative_error(value, truth) -> float:
    """RMS of the difference over RMS of the truth [-]."""
    difference = np.sqrt(np.mean(np.square(np.asarray(value) - np.asarray(truth))))
    size = np.sqrt(np.mean(np.square(np.asarray(truth))))
    return float(difference / size) if size > 0.0 else float(difference)


def packed_points(case: Case) -> np.ndarray:
    """Centres of the packed grains (n, 3) [m]; the same for every setting of the knobs."""
    device, plan = make_plan(case)
    return packed(case.scene, device.boxes, device.walls(), plan.count, plan.sector).position


def show(table) -> None:
    """Print the table to the terminal."""
    from rich.console import Console
    from rich.table import Table

    shown = Table("knob", "setting", "quantity", "value", "error", "noise", "seconds", title="what accuracy costs")
    for row in table.itertuples():
        error = "reference" if np.isnan(row.error) else f"{row.error:.2e}"
        noise = "" if row.noise is None or np.isnan(row.noise) else f"{row.noise:.1e}"
        shown.add_row(
            row.knob, f"{row.setting:g}", row.quantity, f"{row.value:.5g}", error, noise, f"{row.seconds:.2f}"
        )
    Console().print(shown)


def _say(progress, fraction: float, text: str) -> None:
    if progress is not None:
        progress.update(fraction, text)
