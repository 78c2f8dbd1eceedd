"""`emclutch field`: the field alone, at one current or along a sweep, with every quantity that it gives.

The powder, where `back_reaction` is on, is spread evenly over the space that it fills, with the permeability of grains
without order; no grain is moved. Where a run feeds back the moments of its grains, the gap field and the linkage with
sheared powder are given as well at the last current (`emclutch.simulation.forecast.expected_field`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas

from emclutch.device_model.body_forces import forces_on, movable_bodies, stress_force
from emclutch.device_model.device import CoilDevice, field_goals, field_is_needed, solved_coil
from emclutch.device_model.device_3d import CoilDevice3D
from emclutch.device_model.materials import grain_law, hysteresis_of, region_laws, region_materials
from emclutch.results.new_path import new_folder
from emclutch.results.pictures import section_picture
from emclutch.results.pictures.field import line_picture, saturation_picture
from emclutch.results.vtk.field_arrays import field_arrays
from emclutch.results.vtk.flux_lines import flux_lines
from emclutch.results.vtk.series import PvdSeries
from emclutch.scene.case import Case
from emclutch.scene.grain_smear import moments_are_fed_back
from emclutch.scene.model import Scene
from emclutch.simulation.forecast.expected_field import field_of_sheared_powder, powder_in_words
from emclutch.studies.field_3d import (
    UNITS,
    even_powder,
    field_study_3d,
    line_table,
    resistance_of,
    row_of,
    write_summary,
)
from field import ConvergenceError, MagneticField, PowderLaw
from field.coil.inductance import apparent_inductance, incremental_inductance
from field.coil.magnetic_circuit import FilledPowder
from field.factorisation import describe_backend
from field.laws.table_end import driven_beyond_their_tables
from field.section.ampere_turns import ampere_turns_by_part
from field.section.current_sweep import sweep_currents
from field.section.error_estimate import estimate_error
from field.section.field_lines import field_along, straight_line
from field.section.maxwell_force import lorentz_force
from field.section.smooth_field import SmoothField

DETAIL_UNITS = {
    "resistance": "ohm",
    "wire_diameter": "m",
    "copper_mass": "kg",
    "largest_flux_density": "T",
    "gap_flux_density_sheared": "T",
    "flux_linkage_sheared": "Wb",
    "axial_force": "N",
    "ampere_turns_by_part": "A",
}
"""Of what field.json holds for the last current; the rest are pure numbers."""


def field_study(
    case: Case,
    currents: Sequence[float] | None = None,
    lines: Sequence[tuple[float, ...]] = (),
    out: str | Path | None = None,
) -> Path:
    """Solve the scene's field at currents [A] and write it into a new folder, which is returned (`field_result.field`).

    With [effects.hysteresis] the order of the currents is that of time, from demagnetised steel on. The folder has
    field.csv (a row a current), field.json, case.toml, field.pvd, section.png, saturation.png (a sweep), and of lines
    (r0, z0, r1, z1) [m], of a field in 3D also (x0, y0, z0, x1, y1, z1), line-<n>.csv and .png at the last current.

    Raises
    ------
    ValueError
        A scene without a coil's field, a line outside the mesh.
    ConvergenceError
        A current that does not converge; what was solved before is written.
    """
    scene = case.scene
    coil = coil_of_field(scene)
    if isinstance(coil, CoilDevice3D):
        return field_study_3d(case, coil, currents, lines, out)
    for line in lines:
        if np.size(line) not in (4, 6):
            raise ValueError(f"lines has {line}; give a list of lines (r0, z0, r1, z1) in m: lines=[(0, 0, 0.01, 0)]")
        if np.size(line) == 6:
            raise ValueError(f"the line {line} m lies in 3D, and this field in a section; write r0, z0, r1, z1")
        ends = np.array([line[:2], line[2:]])
        if np.any(coil.problem.locator.find(ends)[0] < 0):
            raise ValueError(
                f"the line {line} m does not lie in the mesh; it reaches to r = "
                f"{coil.mesh.points[:, 0].max():.4g} m, with r >= 0; bare numbers are metres, write '27 mm'"
            )
    folder = new_folder(out, f"{case.name}-field")
    currents = [coil.largest_current] if currents is None else list(currents)
    amount, fill = even_powder(scene, coil)
    phi = None if fill is None else amount
    folder.mkdir(parents=True)
    series, lines_of_flux = PvdSeries(folder, "field"), PvdSeries(folder, "flux_lines")
    growing = bool(np.all(np.diff(currents) > 0.0))  # then ParaView's time is the current
    rows: list[dict[str, float | None]] = []
    strongest: MagneticField | None = None
    solution: MagneticField | None = None
    failure: ConvergenceError | None = None
    began = perf_counter()
    ampere_turns = coil.turns * np.asarray(currents)
    fields = sweep_currents(coil.problem, ampere_turns, fill, tolerance=coil.newton_tolerance, history=coil.history)
    for number, current in enumerate(currents):
        try:
            solution = next(fields)
        except ConvergenceError as error:
            failure = error
            break
        if strongest is None or abs(solution.ampere_turns) > abs(strongest.ampere_turns):
            strongest = solution
        rows.append(_row(case, coil, solution, current, phi, began))
        moment = current if growing else float(number)
        lines_of_flux.write_flux_lines(moment, *flux_lines(solution))
        series.write_field(moment, field_arrays(solution))
        began = perf_counter()
    table = pandas.DataFrame(rows)
    table.to_csv(folder / "field.csv", index=False)
    if failure is not None:
        raise failure
    assert solution is not None and strongest is not None
    title = scene.scene.title
    at = f"{title}, {rows[-1]['current']:g} A"
    smooth = SmoothField(solution.problem.elements, solution.psi)
    section_picture(folder / "section.png", smooth, filled=coil.powder_boxes, title=at)
    if len(table) > 2:
        saturation_picture(folder / "saturation.png", table, title=title)
    for number, line in enumerate(lines, start=1):
        along = field_along(solution, straight_line(line[:2], line[2:]))
        table_of_line = line_table(along.distance, along.points, along.B, along.H, along.region)
        table_of_line.to_csv(folder / f"line-{number}.csv", index=False)
        r0, z0, r1, z1 = (1e3 * x for x in line)
        where = f"from (r, z) = ({r0:g}, {z0:g}) to ({r1:g}, {z1:g}) mm"
        line_picture(folder / f"line-{number}.png", along, title=f"{at}, {where}")
    summary = {
        "units": UNITS | DETAIL_UNITS,
        "currents": rows,
        "at_last_current": _details(case, coil, solution, amount),
        "warnings": [*case.warnings, *driven_beyond_their_tables([strongest])]
        + hysteresis_of(scene, region_materials(scene, coil.mesh).values())[1],
    }
    write_summary(folder / "field.json", case, summary)
    return folder


def coil_of_field(scene: Scene) -> CoilDevice | CoilDevice3D:
    """The scene's coil with its mesh; ValueError where the scene has no coil's field."""
    if scene.coil_field is None or not (scene.particles is None or field_is_needed(scene)):
        raise ValueError(
            "the scene has no coil's field to solve: it needs field.source = 'coil' and an effect that samples it, "
            f"{scene.effects.tables(needs_moments=True)}"
        )
    return solved_coil(scene)


def _row(
    case: Case, coil: CoilDevice, solution: MagneticField, current: float, phi: float | None, began: float
) -> dict[str, float | None]:
    row = row_of(case.scene, coil, solution, current, began)
    row["apparent_inductance"] = apparent_inductance(solution, coil.turns)
    row["incremental_inductance"] = incremental_inductance(solution, coil.turns)
    if solution.history is None:
        row["coenergy"] = solution.coenergy
    else:
        row["hysteresis_loss"] = solution.hysteresis_loss
    forces = {body: stress_force(solution, regions) for body, regions in movable_bodies(coil, solution)}
    row |= {f"axial_force_{body}": force for body, force in forces.items() if force is not None}
    if coil.has_poles:
        row["gap_flux_density"] = coil.gap_flux_density(solution, faces=at_the_faces(case, coil))
        laws = region_laws(case.scene, coil.mesh)
        powder = None if phi is None else FilledPowder(PowderLaw(grain_law(case.scene)), phi)
        circuit = case.scene.geometry.magnetic_circuit(coil.shape, laws, powder).solve(solution.ampere_turns)
        row["circuit_flux_linkage"] = coil.turns * circuit.linkage_per_turn
    return {name: row[name] for name in UNITS if name in row}


def at_the_faces(case: Case, coil: CoilDevice) -> bool:
    """True if the gap that is meant is that at the faces."""
    gap = coil.shape.sheared_gap("cavity" if case.scene.particles is None else case.scene.particles.region)
    return gap is not None and gap.at_faces


def _details(case: Case, coil: CoilDevice, solution: MagneticField, phi: float | None) -> dict:
    """Results at the last current only: sheared powder, error estimate, forces, winding, solver."""
    details: dict = {
        "powder": powder_in_words(case.scene, phi),
        "unknowns": solution.problem.n_dofs,
        "triangles": len(coil.mesh.triangles),
        "order": solution.problem.elements.order,
        "solver": describe_backend(solution.problem.factorisation_backend),
        "newton_residuals": [residual for residual, _ in solution.newton],
        "turns": coil.turns,
        "resistance": resistance_of(case.scene, coil),
        "wire_diameter": coil.winding.wire_diameter,
        "copper_mass": coil.winding.copper_mass,
        "largest_flux_density": float(np.linalg.norm(solution.flux_density(), axis=1).max()),
    }
    if coil.adapted is not None:
        details["mesh"] = coil.adapted.summary()
    if solution.history is not None:
        details["error_estimate"] = "none: the field of the next order would have another history"
        return details
    if solution.ampere_turns == 0.0:
        return details
    details["ampere_turns_by_part"] = ampere_turns_by_part(solution, coil.shape.air_gaps())
    if phi is not None and moments_are_fed_back(case.scene):
        current = solution.ampere_turns / coil.turns
        sheared = field_of_sheared_powder(coil, coil.uniform_fill(phi), case.scene, current, solution)
        if coil.has_poles:
            B = coil.gap_flux_density(sheared, faces=at_the_faces(case, coil))
            details["gap_flux_density_sheared"] = B
        details["flux_linkage_sheared"] = coil.turns * sheared.flux_linkage_per_turn
    estimate = estimate_error(solution, field_goals(coil.mesh))
    details["estimated_relative_error"] = {goal.goal: goal.relative for goal in estimate.goals}
    coil_alone = {"coil (J x B)": {"lorentz": lorentz_force(solution), "error": "not known"}}
    details["axial_force"] = coil_alone | forces_on(solution, movable_bodies(coil, solution))
    return details
