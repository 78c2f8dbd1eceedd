"""`emclutch field`: the field alone, at one current or along a sweep, with every quantity that it gives.

The powder, where `back_reaction` is on, is spread evenly over the space that it fills; no grain is moved.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas

from emclutch.case import Case
from emclutch.device import CoilDevice, Device, build_device, grain_law, region_laws
from emclutch.field_arrays import field_arrays
from emclutch.observables import pole_flux_density
from emclutch.results import OutputError, RunFolder
from emclutch.results.field_pictures import line_picture, saturation_picture
from emclutch.results.pictures import section_picture
from emclutch.results.vtk_series import PvdSeries
from field import MU_0, ConvergenceError, MagneticField, PowderLaw
from field.current_sweep import sweep_currents
from field.error_estimate import FluxLinkage, MeanFluxDensity, estimate_error
from field.factorisation import describe_backend
from field.field_lines import field_along, straight_line
from field.inductance import apparent_inductance, incremental_inductance
from field.magnetic_circuit import FilledPowder, clutch_circuit
from field.maxwell_force import axial_force, lorentz_force
from geometry import Clutch

UNITS = {
    "current": "A",
    "ampere_turns": "A",
    "gap_flux_density": "T",
    "flux_linkage": "Wb",
    "circuit_flux_linkage": "Wb",
    "apparent_inductance": "H",
    "incremental_inductance": "H",
    "energy": "J",
    "coenergy": "J",
    "copper_loss": "W",
    "newton_steps": "-",
    "residual": "-",
    "seconds": "s",
}
"""Columns of field.csv and their units."""


def field_study(
    case: Case,
    currents: Sequence[float] | None = None,
    lines: Sequence[tuple[float, float, float, float]] = (),
    out: str | Path | None = None,
) -> Path:
    """Solve the scene's field and write what it gives into a new folder.

    Parameters
    ----------
    case : Case
        A clutch (or a section from CAD) with a coil.
    currents : sequence of float or None
        [A]; None: the largest current of the scene.
    lines : sequence of (r0, z0, r1, z1)
        Straight lines [m] along which B and H are written, at the last current.
    out : str, Path or None
        New folder; None: the next runs/<case>-field-<nnn>.

    Returns
    -------
    Path
        The folder, with field.csv (a row a current), field.json, field.pvd, section.png, saturation.png (a sweep),
        line-<n>.csv and .png.

    Raises
    ------
    ValueError
        A scene without a coil's field, a line outside the mesh.
    ConvergenceError
        A current that does not converge; what was solved before is written.
    OutputError
        The folder is there already.
    """
    device = build_device(case.scene)
    coil = device.coil
    if coil is None:
        raise ValueError(
            "the scene has no coil's field to solve: it needs field.source = 'coil' and an effect that samples it, "
            "magnetic_force or dipoles"
        )
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-field")
    if folder.exists():
        raise OutputError(f"{folder} exists; name another folder with --out")
    currents = [coil.largest_current] if currents is None else list(currents)
    phi = device.fill.solid_fraction if case.scene.effects.back_reaction is not None else None
    fill = None if phi is None else coil.uniform_fill(phi)
    folder.mkdir(parents=True)
    series = PvdSeries(folder, "field")
    rows: list[dict[str, float]] = []
    solution: MagneticField | None = None
    failure: ConvergenceError | None = None
    began = perf_counter()
    fields = sweep_currents(
        coil.problem, coil.turns * np.asarray(currents), fill, tolerance=coil.newton_tolerance
    )
    for number, current in enumerate(currents):
        try:
            solution = next(fields)
        except ConvergenceError as error:
            failure = error
            break
        rows.append(_row(case, device, coil, solution, current, phi, perf_counter() - began))
        cells, at_points, names = field_arrays(solution)
        series.write_field(
            float(number),
            solution.problem.mesh.points,
            solution.problem.mesh.triangles,
            cell_arrays=cells,
            point_arrays=at_points,
            region_names=names,
        )
        began = perf_counter()
    table = pandas.DataFrame(rows)
    table.to_csv(folder / "field.csv", index=False)
    if failure is not None:
        raise failure
    assert solution is not None
    title = case.scene.scene.title
    section_picture(
        folder / "section.png", coil.mesh, solution.point_psi, solution.flux_density(), title=title
    )
    if len(table) > 2:
        saturation_picture(folder / "saturation.png", table, title=title)
    for number, line in enumerate(lines, start=1):
        along = field_along(solution, straight_line(line[:2], line[2:]))
        columns = {
            "distance": along.distance,
            "r": along.points[:, 0],
            "z": along.points[:, 1],
            "B_r": along.B[:, 0],
            "B_z": along.B[:, 1],
            "H_r": along.H[:, 0],
            "H_z": along.H[:, 1],
            "region": along.region,
        }
        pandas.DataFrame(columns).to_csv(folder / f"line-{number}.csv", index=False)
        line_picture(folder / f"line-{number}.png", along, title=title)
    summary = {"units": UNITS, "currents": rows, "at_last_current": _details(case, coil, solution)}
    (folder / "field.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return folder


def _row(
    case: Case,
    device: Device,
    coil: CoilDevice,
    solution: MagneticField,
    current: float,
    phi: float | None,
    seconds: float,
) -> dict[str, float]:
    row = {
        "current": current,
        "ampere_turns": solution.ampere_turns,
        "flux_linkage": coil.turns * solution.flux_linkage_per_turn,
        "apparent_inductance": apparent_inductance(solution, coil.turns),
        "incremental_inductance": incremental_inductance(solution, coil.turns),
        "energy": solution.energy,
        "coenergy": solution.coenergy,
        "copper_loss": coil.winding.copper_loss(current),
        "newton_steps": len(solution.newton) - 1,
        "residual": solution.newton[-1][0],
        "seconds": seconds,
    }
    if isinstance(coil.shape, Clutch):
        row["gap_flux_density"] = pole_flux_density(coil.shape, solution)
        laws = region_laws(case.scene, coil.mesh)
        powder = {} if phi is None else {"powder": FilledPowder(PowderLaw(grain_law(case.scene)), phi)}
        circuit = clutch_circuit(coil.shape, laws, **powder).solve(solution.ampere_turns)
        row["circuit_flux_linkage"] = coil.turns * circuit.linkage_per_turn
    return {name: row[name] for name in UNITS if name in row}


def _details(case: Case, coil: CoilDevice, solution: MagneticField) -> dict:
    """What is computed once, at the last current: error estimate, forces, winding, solver."""
    details: dict = {
        "unknowns": solution.problem.n_dofs,
        "triangles": len(coil.mesh.triangles),
        "order": solution.problem.elements.order,
        "solver": describe_backend(solution.problem._solver.backend),
        "newton_residuals": [residual for residual, _ in solution.newton],
        "turns": coil.turns,
        "resistance_20C": coil.winding.resistance,
        "wire_diameter": coil.winding.wire_diameter,
        "copper_mass": coil.winding.copper_mass,
        "largest_flux_density": float(np.linalg.norm(solution.flux_density(), axis=1).max()),
    }
    if solution.ampere_turns == 0.0:
        return details
    estimate = estimate_error(solution, [FluxLinkage(), MeanFluxDensity("powder")])
    details["estimated_relative_error"] = {goal.goal: goal.relative for goal in estimate.goals}
    forces: dict[str, dict[str, float | None]] = {"coil (J x B)": {"lorentz": lorentz_force(solution)}}
    for body in ("disc", "rotor"):
        regions = [name for name in coil.mesh.regions if name == body or name.startswith(f"{body}_")]
        if regions:
            force = axial_force(solution, regions, yielding=("powder",), virtual_work=True)
            forces[body] = {
                "maxwell_stress": force.maxwell_stress,
                "virtual_work": force.virtual_work,
                "error_estimate": force.error,
            }
    details["axial_force"] = forces
    B = details["largest_flux_density"]
    details["magnetic_pressure_at_largest_B"] = B * B / (2.0 * MU_0)
    return details
