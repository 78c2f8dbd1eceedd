"""`emclutch field` of a field in 3D (slots, or solids from CAD): along a sweep of currents, without powder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas

from emclutch.device_model.device_3d import CoilDevice3D, gap_map
from emclutch.results.new_path import new_folder
from emclutch.results.pictures.field import gap_map_picture
from emclutch.results.vtk.field_arrays import field_arrays_3d
from emclutch.results.vtk.series import PvdSeries
from emclutch.scene.case import Case
from emclutch.scene.fill import fill_of
from emclutch.simulation.forecast.expected_field import powder_in_words
from field.laws.table_end import driven_beyond_their_tables
from field.three_d import Field3D

UNITS = {
    "current": "A",
    "ampere_turns": "A",
    "gap_flux_density": "T",
    "flux_linkage": "Wb",
    "apparent_inductance": "H",
    "energy": "J",
    "coenergy": "J",
    "copper_loss": "W",
    "newton_steps": "-",
    "residual": "-",
    "seconds": "s",
}


def field_study_3d(
    case: Case,
    device: CoilDevice3D,
    currents: Sequence[float] | None,
    lines: Sequence[tuple[float, ...]],
    out: str | Path | None,
) -> Path:
    """Solve and write field.csv, field.json, field.pvd, gap.png and line-<n>.csv into a new folder; see `field_study`.

    A line is x0, y0, z0, x1, y1, z1 [m], or r0, z0, r1, z1 in the half-plane y = 0, x > 0.
    """
    ends = [line_3d(line) for line in lines]
    for line, points in zip(lines, ends, strict=True):
        if np.any(device.problem.locator.find(device.problem.fold.into_mesh(points)[0])[0] < 0):
            raise ValueError(
                f"the line {line} m does not lie in the mesh, which reaches "
                f"{np.linalg.norm(device.mesh.points, axis=1).max():.4g} m far; bare numbers are metres, write '27 mm'"
            )
    folder = new_folder(out, f"{case.name}-field")
    folder.mkdir(parents=True)
    assert case.scene.coil is not None
    resistance = case.scene.coil.resistance_in(device.shape.coil_area, device.shape.coil_mean_radius)
    series, rows = PvdSeries(folder, "field"), []
    scene, phi, fill = case.scene, None, None
    if scene.particles is not None:
        phi = fill_of(device.shape, scene.particles).solid_fraction
        fill = device.uniform_fill(phi) if scene.effects.feedback is not None else None
    solution: Field3D | None = None
    strongest: Field3D | None = None
    for number, current in enumerate([device.largest_current] if currents is None else currents):
        began = perf_counter()
        guess = solution if solution is not None and solution.ampere_turns != 0.0 else None
        solution = device.problem.solve(device.turns * current, fill, guess, tolerance=device.newton_tolerance)
        if strongest is None or abs(solution.ampere_turns) > abs(strongest.ampere_turns):
            strongest = solution
        linkage = device.turns * solution.flux_linkage_per_turn
        rows.append(
            {
                "current": current,
                "ampere_turns": solution.ampere_turns,
                "gap_flux_density": device.gap_flux_density(solution),
                "flux_linkage": linkage,
                "apparent_inductance": linkage / current if current != 0.0 else None,
                "energy": solution.energy,
                "coenergy": solution.coenergy,
                "copper_loss": resistance * current**2,
                "newton_steps": len(solution.newton) - 1,
                "residual": solution.newton[-1][0],
                "seconds": perf_counter() - began,
            }
        )
        series.write_field_3d(float(number), *field_arrays_3d(solution), region_names=sorted(device.mesh.regions))
        pandas.DataFrame(rows).to_csv(folder / "field.csv", index=False)
    assert solution is not None and strongest is not None
    for number, points in enumerate(ends, start=1):
        along_line(solution, points).to_csv(folder / f"line-{number}.csv", index=False)
    gap_map_picture(folder / "gap.png", *gap_map(device, solution), title=case.scene.scene.title)
    details = {
        "powder": powder_in_words(scene, phi),
        "tetrahedra": len(device.mesh.tetrahedra),
        "unknowns": device.problem.n_dofs,
        "part_of_the_ring": f"1/{device.mesh.n_sectors}",
        "linear_solver": device.problem.linear_solver,
        "newton_residuals": [residual for residual, _ in solution.newton],
        "turns_with": device.carrier,
    }
    warnings = [*case.warnings, *driven_beyond_their_tables([strongest])]
    summary = {"units": UNITS, "currents": rows, "at_last_current": details, "warnings": warnings}
    (folder / "field.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return folder


def line_3d(line: Sequence[float], count: int = 201) -> np.ndarray:
    """Points (count, 3) [m] of a line, see `field_study_3d`."""
    if len(line) == 4:
        r0, z0, r1, z1 = line
        line = (r0, 0.0, z0, r1, 0.0, z1)
    return np.linspace(np.asarray(line[:3]), np.asarray(line[3:]), count)


def along_line(solution: Field3D, points: np.ndarray) -> pandas.DataFrame:
    """B and H of the finite element solution itself at the points (k, 3) [m] of a line, and the regions there."""
    mesh, problem = solution.problem.mesh, solution.problem
    B, H = solution.flux_density(points), solution.field_strength(points)
    element, _ = problem.locator.find(problem.fold.into_mesh(points)[0])
    columns = {"distance": np.linalg.norm(points - points[0], axis=1)}
    for name, vector in (("", points), ("B_", B), ("H_", H)):
        columns |= {f"{name}{axis}": vector[:, k] for k, axis in enumerate("xyz")}
    return pandas.DataFrame(columns | {"region": mesh.region_of_element()[element]})
