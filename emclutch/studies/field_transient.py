"""`emclutch field --transient`: the coil alone in time, written into a folder; `emclutch.field_transient(case)`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.new_path import new_folder
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Report
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import bad_input_for

if TYPE_CHECKING:
    import pandas

TOLERANCE = 1e-3
"""Local error of a step, relative to the largest state."""
_ENERGIES = ("supplied_energy", "copper_heat", "eddy_heat", "field_energy")


@dataclass(frozen=True)
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

    def report(self) -> Report:
        """Return rise times, energies and the winding's temperature."""
        from emclutch.studies.transient_report import transient_report

        return transient_report(self.folder, self.summary)


def field_transient(
    case: Case | str | Path,
    end: float | None = None,
    tolerance: float = TOLERANCE,
    out: str | Path | None = None,
) -> TransientResult:
    """Compute current, flux and heat of a coil after a change of its voltage, while nothing moves, into a new folder.

    The scene's circuit and eddy currents ([effects.coil_circuit], [effects.eddy_currents]) are taken; without the first
    its defaults are. Powder is spread evenly.

    Parameters
    ----------
    case : Case, or the path of a scene file, with `coil.voltage`
    end : [s]; default: `time.end` of the scene, else when current and flux are within 1 % of their final values.
    tolerance : local error of a time step, relative to the largest state: 1e-6 to 0.1.
    out : new folder; default: the next runs/<case>-transient-<nnn>.

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
    folder = new_folder(out, f"{case.name}-transient")
    with bad_input_for(case.path):
        if end is not None and not 0.0 < end < np.inf:
            raise ValueError(f"the end of {end} s must be a time above 0")
        if not 1e-6 <= tolerance <= 0.1:
            raise ValueError(f"the tolerance {tolerance:g} of a time step is out of range; allowed: 1e-6 to 0.1")
        found = _computed(case, end, tolerance, folder)
    write_index(found.report())
    return found


def _computed(case: Case, end: float | None, tolerance: float, folder: Path) -> TransientResult:
    from emclutch.device_model.device import CoilDevice, field_goals
    from emclutch.results.pictures import section_picture
    from emclutch.results.pictures.field import transient_picture
    from emclutch.results.vtk.field_arrays import field_arrays
    from emclutch.results.vtk.series import PvdSeries
    from emclutch.scene.grain_smear import moments_are_fed_back
    from emclutch.simulation.forecast.expected_field import field_of_sheared_powder, powder_in_words
    from emclutch.studies.coil_transient import COARSER, UNITS, CoilTransient, drive_of
    from emclutch.studies.field import at_the_faces, coil_of_field, even_powder
    from field.laws.table_end import driven_beyond_their_tables
    from field.section.error_estimate import estimate_error
    from field.section.smooth_field import SmoothField

    scene = case.scene
    drive_of(scene)  # before the mesh
    coil = coil_of_field(scene)
    assert isinstance(coil, CoilDevice)  # no field in 3D
    phi, fill = even_powder(scene, coil)
    transient = CoilTransient(scene, coil, fill, faces=at_the_faces(case, coil))
    of_scene = None if scene.time is None else scene.time.end
    course = transient.course(of_scene if end is None and isinstance(of_scene, float) else end, tolerance)
    states, table, last = course.states, course.table, course.states[-1]
    rough, rises = transient.course(last.time, COARSER * tolerance).rise_times(), course.rise_times()
    pairs = [(fine, rough[name]) for name, fine in rises.items()]
    errors = [abs(fine / coarse - 1.0) / (COARSER - 1.0) for fine, coarse in pairs if fine and coarse]
    if fill is not None and moments_are_fed_back(scene):
        current = transient.voltage.largest / transient.winding.resistance
        powder = field_of_sheared_powder(coil, fill, scene, current, transient.static(current)).powder
        sheared = CoilTransient(scene, coil, powder, faces=transient.faces).course(last.time, COARSER * tolerance)
        rises |= {f"{name}_sheared": time for name, time in sheared.rise_times().items()}
    energy = {name: float(table[name].iloc[-1]) for name in _ENERGIES}
    given = energy["supplied_energy"] + float(table["field_energy"].iloc[0])
    residual = given - sum(energy[name] for name in _ENERGIES[1:])
    static = course.field
    mesh = estimate_error(static, field_goals(coil.mesh)).goals if static.ampere_turns else ()
    strongest = max(states, key=lambda one: abs(one.current))
    summary = {
        "units": UNITS | {"rise_time": "s"},
        "changes_at": transient.changes_at,
        **rises,
        "rise_time_error": max(errors, default=None),
        "final": course.final,
        "at_end": {name: float(value) for name, value in table.iloc[-1].items()},
        "distance": course.distance(),
        "energy": energy | {"residual": residual, "relative_residual": residual / max(given, last.copper_loss)},
        "resistance": [transient.winding.resistance_after(one.copper_loss) for one in (states[0], last)],
        "steps": len(states) - 1,
        "tolerance": tolerance,
        "default_circuit": scene.effects.circuit is None,
        "eddy_currents": coil.conductivity is not None,
        "powder": None if phi is None else powder_in_words(scene, phi),
        "error_of_the_mesh": {goal.goal: goal.relative for goal in mesh},
        "warnings": driven_beyond_their_tables([transient.eddy.field(strongest, fill)]),
    }
    folder.mkdir(parents=True)
    table.to_csv(folder / "transient.csv", index=False)
    (folder / "transient.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    series, shown = PvdSeries(folder, "field"), min(len(states), max(2, scene.output.snapshots))
    for number in np.unique(np.linspace(0, len(states) - 1, shown).round().astype(int)):
        series.write_field(states[number].time, field_arrays(transient.eddy.field(states[number], fill)))
    title = scene.scene.title
    transient_picture(folder / "transient.png", table, summary, title=title)
    section_picture(
        folder / "section.png",
        SmoothField(coil.problem.elements, last.psi),
        filled=coil.powder_boxes,
        title=f"{title}\n{last.current:.4g} A at the end",
    )
    return TransientResult(folder, summary, table)
