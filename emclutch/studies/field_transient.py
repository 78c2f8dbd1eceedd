"""`emclutch field --transient`: the coil alone in time, written into a folder; `emclutch.field_transient(case)`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas

from emclutch.device_model.device import CoilDevice, field_goals
from emclutch.results.new_path import new_folder
from emclutch.results.pictures import section_picture
from emclutch.results.pictures.field import transient_picture
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Report
from emclutch.results.vtk.field_arrays import field_arrays
from emclutch.results.vtk.series import PvdSeries
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import bad_input_for
from emclutch.scene.grain_smear import moments_are_fed_back
from emclutch.scene.model import Scene
from emclutch.scene.units import Quantity, Time
from emclutch.scene.value_list import values_of
from emclutch.simulation.forecast.expected_field import field_of_sheared_powder, powder_in_words
from emclutch.studies.coil_transient import UNITS, CoilTransient, Course, drive_of
from emclutch.studies.field import at_the_faces, coil_of_field
from emclutch.studies.field_3d import even_powder, write_summary
from emclutch.studies.transient_report import transient_report
from field.laws.table_end import driven_beyond_their_tables
from field.section.error_estimate import estimate_error
from field.section.smooth_field import SmoothField

if TYPE_CHECKING:
    from emclutch.results import Progress

TOLERANCE = 1e-3
"""Local error of a step, relative to the largest state."""
_TOLERANCE = Quantity("a tolerance", "", "1e-3", 1e-6, 0.1)
COARSER = 4.0
"""Factor of the tolerance of a second march: the error is proportional to it, so that a third of the difference
estimates it."""


@dataclass(frozen=True, repr=False)
class TransientResult(Reported):
    """The coil alone in time, as it stands in its folder.

    Attributes
    ----------
    folder : Path
        With transient.csv, transient.json, transient.png, section.png, field.pvd.
    summary : dict
        transient.json: `current_rise_time`, `current_rise_time_90` and the same of `gap_flux_density` and
        `flux_linkage` [s] (null: not by the end), with `_sheared` those with the permeability of sheared powder, their
        largest `rise_time_error` (relative, of the time steps), values and `energy` [J] at the end, `final` values,
        `warnings`, and `units`.
    table : pandas.DataFrame
        A row a step; units of the columns in `summary["units"]`.
    """

    folder: Path
    summary: dict[str, Any]
    table: pandas.DataFrame

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns of `table`."""
        return self.summary["units"]

    def report(self) -> Report:
        """Return rise times, energies and the winding's temperature."""
        return transient_report(self.folder, self.summary)


def field_transient(
    case: Case | str | Path,
    end: float | str | None = None,
    tolerance: float | str = TOLERANCE,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> TransientResult:
    """Compute current, flux and heat of a coil after a change of its voltage, while nothing moves, into a new folder.

    The scene's circuit and eddy currents ([effects.coil_circuit], [effects.eddy_currents]) are taken; without the first
    the voltage is applied from t = 0. Powder is spread evenly.

    Parameters
    ----------
    case : Case, or the path of a scene file, with `coil.voltage`
    end : number [s] or text with a unit, "0.1 s"; default: `time.end` of the scene, else when current and flux are
        within 1 % of their final values.
    tolerance : local error of a time step, relative to the largest state: 1e-6 to 0.1.
    out : new folder; default: the next runs/<case>-transient-<nnn>.
    progress : takes the fraction of the simulated time that is done, and the march that it is of.

    Raises
    ------
    SceneError
        The scene has faults, no coil's field, no voltage, a field in 3D or hysteresis, or the winding passes
        250 degrees C.
    ConvergenceError
        A step that does not converge.
    OutputError
        The folder is there already.
    """
    case = as_case(case)
    folder, scene = new_folder(out, f"{case.name}-transient"), case.scene
    if progress is not None:
        progress.status("mesh")
    with bad_input_for(case.path):
        if end is not None:
            (end,) = values_of([end], Time, "end")
        (tolerance,) = values_of([tolerance], _TOLERANCE, "tolerance")
        if scene.coil_field is not None:
            drive_of(scene)  # before the mesh
        coil = coil_of_field(scene)
        assert isinstance(coil, CoilDevice)  # no field in 3D
        phi, fill = even_powder(scene, coil)
        transient = CoilTransient(scene, coil, fill, faces=at_the_faces(case, coil))
        transient.notify = _notify(progress, 0, "the coil in time")
        of_scene = None if scene.time is None else scene.time.end
        course = transient.course(of_scene if end is None and isinstance(of_scene, float) else end, tolerance)
        summary = {
            "units": UNITS | {"rise_time": "s"},
            "changes_at": transient.changes_at,
            **_rise_times(scene, transient, course, tolerance, progress),
            **_ends(transient, course, case.warnings),
            "tolerance": tolerance,
            "default_circuit": scene.effects.circuit is None,
            "current_given": scene.coil is not None and scene.coil.current is not None,
            "powder": None if phi is None else powder_in_words(scene, phi),
        }
    if progress is not None:
        progress.update(1.0, "files and pictures")
    _write(folder, case, transient, course, summary)
    found = TransientResult(folder, json.loads((folder / "transient.json").read_text(encoding="utf-8")), course.table)
    write_index(found.report())
    return found


def _notify(progress: Progress | None, number: int, text: str) -> Callable[[float], None] | None:
    """Return what shows the fraction of a march, of two or three of a study."""
    return None if progress is None else lambda share: progress.update((number + share) / 3.0, text)


def _rise_times(
    scene: Scene, transient: CoilTransient, course: Course, tolerance: float, progress: Progress | None
) -> dict[str, float | None]:
    """Rise times [s], with sheared powder too where grains feed back their moments, and the error of the steps."""
    end, coarse, coil = course.states[-1].time, COARSER * tolerance, transient.coil
    transient.notify = _notify(progress, 1, "again with coarser time steps, for their error")
    found, rough = dict(course.rises), transient.course(end, coarse).rises
    pairs = [(fine, rough[name]) for name, fine in found.items()]
    errors = [abs(fine / other - 1.0) / (COARSER - 1.0) for fine, other in pairs if fine and other]
    if isinstance(transient.fill, np.ndarray) and moments_are_fed_back(scene):
        current = transient.voltage.largest / transient.cold_resistance
        powder = field_of_sheared_powder(coil, transient.fill, scene, current, transient.static(current)).powder
        sheared = CoilTransient(scene, coil, powder, faces=transient.faces)
        sheared.notify = _notify(progress, 2, "again with sheared powder")
        found |= {f"{name}_sheared": time for name, time in sheared.course(end, coarse).rises.items()}
    return found | {"rise_time_error": max(errors, default=None)}


def _ends(transient: CoilTransient, course: Course, warnings: tuple[str, ...]) -> dict[str, Any]:
    """Values at the end and those that they go to, energies [J], errors, and warnings with those of the scene."""
    last, static, table = course.states[-1], course.field, course.table
    at_end = {name: float(value) for name, value in table.iloc[-1].items()}
    first = float(table["field_energy"].iloc[0])
    given = at_end["supplied_energy"] + first
    residual = given - at_end["copper_heat"] - at_end["eddy_heat"] - at_end["field_energy"]
    mesh = estimate_error(static, field_goals(transient.coil.mesh)).goals if static.ampere_turns else ()
    strongest = max(course.states, key=lambda one: abs(one.current))
    return {
        "final": course.final,
        "at_end": at_end,
        "distance": max(abs(at_end[name] - value) / table[name].abs().max() for name, value in course.final.items()),
        "first_field_energy": first,
        "residual": residual,
        "relative_residual": residual / max(given, last.copper_loss),
        "resistance": [transient.cold_resistance, transient.resistance(last.copper_loss)],
        "steps": len(course.states) - 1,
        "eddy_currents": transient.coil.conductivity is not None,
        "error_of_the_mesh": {goal.goal: goal.relative for goal in mesh},
        "warnings": [*warnings, *driven_beyond_their_tables([transient.field(strongest)])],
    }


def _write(folder: Path, case: Case, transient: CoilTransient, course: Course, summary: dict[str, Any]) -> None:
    folder.mkdir(parents=True)
    course.table.to_csv(folder / "transient.csv", index=False)
    write_summary(folder / "transient.json", case, summary)
    scene, series, states, title = case.scene, PvdSeries(folder, "field"), course.states, case.scene.scene.title
    shown = min(len(states), max(2, scene.output.snapshots))
    for number in np.linspace(0, len(states) - 1, shown).round().astype(int):
        series.write_field(states[number].time, field_arrays(transient.field(states[number])))
    transient_picture(folder / "transient.png", course.table, summary, title=title)
    smooth = SmoothField(transient.coil.problem.elements, states[-1].psi)
    title += f"{title}\n{states[-1].current:.4g} A at the end"
    section_picture(folder / "section.png", smooth, filled=transient.coil.powder_boxes, title=title)
