"""`emclutch field` of a field in 3D (slots, or solids from CAD): along a sweep of currents, without powder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas

from emclutch.device_model.body_forces import MOVABLE
from emclutch.device_model.device import CoilDevice
from emclutch.device_model.device_3d import CoilDevice3D, gap_map
from emclutch.results.atomic_file import replace_json
from emclutch.results.new_path import new_folder
from emclutch.results.pictures.field import gap_map_picture
from emclutch.results.vtk.field_arrays import field_arrays_3d
from emclutch.results.vtk.series import PvdSeries
from emclutch.scene.case import Case
from emclutch.scene.fill import fill_of
from emclutch.scene.input_files import materials_in_words
from emclutch.scene.model import Scene
from emclutch.simulation.forecast.expected_field import powder_in_words
from field import MagneticField
from field.laws.table_end import driven_beyond_their_tables
from field.three_d import Field3D

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
    "hysteresis_loss": "J",
    **{f"axial_force_{body}": "N" for body in MOVABLE},
    "copper_loss": "W",
    "newton_steps": "-",
    "residual": "-",
    "seconds": "s",
}
"""Columns of field.csv and their units."""


def resistance_of(scene: Scene, coil: CoilDevice | CoilDevice3D) -> float:
    """Of the coil [ohm]: the scene's own, or that of its turns in copper."""
    assert scene.coil is not None
    return scene.coil.resistance_in(coil.shape.coil_area, coil.shape.coil_mean_radius)


def even_powder(scene: Scene, coil: CoilDevice | CoilDevice3D) -> tuple[float | None, np.ndarray | None]:
    """Solid fraction of the scene's powder spread evenly, and its fill (n powder elements,) where it feeds back."""
    if scene.particles is None:
        return None, None
    phi = fill_of(coil.shape, scene.particles, scene.scene.seed).solid_fraction
    return phi, None if scene.effects.feedback is None else coil.uniform_fill(phi)


def row_of(
    scene: Scene, coil: CoilDevice | CoilDevice3D, solution: MagneticField | Field3D, current: float, began: float
) -> dict[str, float | None]:
    """Return what every field has in a row of field.csv; `began`: the clock [s] before it was solved."""
    return {
        "current": current,
        "ampere_turns": solution.ampere_turns,
        "flux_linkage": coil.turns * solution.flux_linkage_per_turn,
        "energy": solution.energy,
        "copper_loss": resistance_of(scene, coil) * current**2,
        "newton_steps": len(solution.newton) - 1,
        "residual": solution.newton[-1][0],
        "seconds": perf_counter() - began,
    }


def write_summary(path: Path, case: Case, summary: dict) -> None:
    """Write a summary with the materials of the regions, and beside it case.toml, the scene as resolved."""
    replace_json(path, summary | {"materials": materials_in_words(case.scene, case.data)})
    case.write_toml(path.with_name("case.toml"))


def line_table(distance: np.ndarray, points: np.ndarray, B: np.ndarray, H: np.ndarray, region) -> pandas.DataFrame:
    """Return the columns of line-<n>.csv, of points (k, 2) in r, z or (k, 3) in x, y, z."""
    columns = {"distance": distance}
    for name, vector in (("", points), ("B_", B), ("H_", H)):
        columns |= {f"{name}{axis}": vector[:, k] for k, axis in enumerate("rz" if points.shape[1] == 2 else "xyz")}
    return pandas.DataFrame(columns | {"region": region})


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
    series, rows = PvdSeries(folder, "field"), []
    scene, (phi, fill) = case.scene, even_powder(case.scene, device)
    solution: Field3D | None = None
    strongest: Field3D | None = None
    for number, current in enumerate([device.largest_current] if currents is None else currents):
        began = perf_counter()
        guess = solution if solution is not None and solution.ampere_turns != 0.0 else None
        solution = device.problem.solve(device.turns * current, fill, guess, tolerance=device.newton_tolerance)
        if strongest is None or abs(solution.ampere_turns) > abs(strongest.ampere_turns):
            strongest = solution
        row = row_of(scene, device, solution, current, began)
        row["apparent_inductance"] = device.turns * solution.flux_linkage_per_turn / current if current else None
        row |= {"gap_flux_density": device.gap_flux_density(solution), "coenergy": solution.coenergy}
        rows.append({name: row[name] for name in UNITS if name in row})
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
    write_summary(folder / "field.json", case, summary)
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
    return line_table(np.linalg.norm(points - points[0], axis=1), points, B, H, mesh.region_of_element()[element])
