"""`emclutch field` of a field in space (slots, or solids from CAD): along a sweep of currents, without powder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas

from emclutch.case import Case
from emclutch.field_arrays import solid_field_arrays
from emclutch.results import OutputError, RunFolder
from emclutch.results.field_pictures import gap_map_picture
from emclutch.results.vtk_series import PvdSeries
from emclutch.solid_device import SolidCoilDevice, gap_flux_density
from field import MU_0
from field.solid import SolidField
from geometry import Clutch

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


def solid_field_study(
    case: Case,
    device: SolidCoilDevice,
    currents: Sequence[float] | None,
    lines: Sequence[tuple[float, ...]],
    out: str | Path | None,
) -> Path:
    """Solve and write field.csv, field.json, field.pvd, gap.png and line-<n>.csv into a new folder; see `field_study`.

    A line is x0, y0, z0, x1, y1, z1 [m], or r0, z0, r1, z1 in the half-plane y = 0, x > 0.
    """
    ends = [line_in_space(line) for line in lines]
    for line, points in zip(lines, ends, strict=True):
        if np.any(device.problem.locator.find(device.problem.fold.into_mesh(points)[0])[0] < 0):
            raise ValueError(
                f"the line {line} m does not lie in the mesh, which reaches "
                f"{np.linalg.norm(device.mesh.points, axis=1).max():.4g} m far; bare numbers are metres, write '27 mm'"
            )
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-field")
    if folder.exists():
        raise OutputError(f"{folder} exists; name another folder with --out")
    folder.mkdir(parents=True)
    assert case.scene.coil is not None
    resistance = case.scene.coil.resistance_in(device.shape.coil_area, device.shape.coil_mean_radius)
    series, rows = PvdSeries(folder, "field"), []
    solution: SolidField | None = None
    for number, current in enumerate([device.largest_current] if currents is None else currents):
        began = perf_counter()
        guess = solution if solution is not None and solution.ampere_turns != 0.0 else None
        solution = device.problem.solve(device.turns * current, guess, tolerance=device.newton_tolerance)
        linkage = device.turns * solution.flux_linkage_per_turn
        rows.append(
            {
                "current": current,
                "ampere_turns": solution.ampere_turns,
                "gap_flux_density": gap_flux_density(device, solution),
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
        series.write_solid_field(float(number), *solid_field_arrays(solution), region_names=sorted(device.mesh.regions))
        pandas.DataFrame(rows).to_csv(folder / "field.csv", index=False)
    assert solution is not None
    for number, points in enumerate(ends, start=1):
        along_line(solution, points).to_csv(folder / f"line-{number}.csv", index=False)
    gap_map_picture(folder / "gap.png", *gap_map(device, solution), title=case.scene.scene.title)
    details = {
        "powder": "left out: a field in space is solved without it",
        "tetrahedra": len(device.mesh.tetrahedra),
        "unknowns": device.problem.n_dofs,
        "part_of_the_ring": f"1/{device.mesh.n_sectors}",
        "linear_solver": device.problem.linear_solver,
        "newton_residuals": [residual for residual, _ in solution.newton],
        "turns_with": device.carrier,
    }
    summary = {"units": UNITS, "currents": rows, "at_last_current": details}
    (folder / "field.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return folder


def line_in_space(line: Sequence[float], count: int = 201) -> np.ndarray:
    """Points (count, 3) [m] of a line, see `solid_field_study`."""
    if len(line) == 4:
        r0, z0, r1, z1 = line
        line = (r0, 0.0, z0, r1, 0.0, z1)
    return np.linspace(np.asarray(line[:3]), np.asarray(line[3:]), count)


def along_line(solution: SolidField, points: np.ndarray) -> pandas.DataFrame:
    """B and H of the finite element solution itself at the points (k, 3) [m] of a line, and the regions there."""
    mesh, problem = solution.problem.mesh, solution.problem
    B, H = solution.flux_density(points), solution.field_strength(points)
    element, _ = problem.locator.find(problem.fold.into_mesh(points)[0])
    columns = {"distance": np.linalg.norm(points - points[0], axis=1)}
    for name, vector in (("", points), ("B_", B), ("H_", H)):
        columns |= {f"{name}{axis}": vector[:, k] for k, axis in enumerate("xyz")}
    return pandas.DataFrame(columns | {"region": mesh.region_of_element()[element]})


def gap_map(
    device: SolidCoilDevice, solution: SolidField, pitches: float = 2.0, count: int = 200
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Recovered B_r (m, count) [T] on the gap's middle cylinder, free of powder; at angles [rad] and z (m,) [m].

    Over some pitches of a slotted clutch, or all around.
    """
    shape = device.shape
    slots = (shape.disc_slots or shape.rotor_slots) if isinstance(shape, Clutch) else None
    angle = np.linspace(0.0, 2.0 * np.pi if slots is None else pitches * slots.pitch, count)
    line = shape.gap_midline(80)
    r, z = line.T
    points = np.stack(
        [np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.broadcast_to(z[:, None], (len(z), count))], axis=-1
    )
    H = solution.sampler("powder").sample(points.reshape(-1, 3))[0].reshape(len(z), count, 3)
    return angle, z, MU_0 * (H[..., 0] * np.cos(angle) + H[..., 1] * np.sin(angle))
