"""The meshes that a moment of a run is drawn with: pyvista's, from the run's files."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyvista

from emclutch.results.view.look import CHAIN_WIDTH, FLUX_DENSITY, FORCE, MARK, SHADES, SWEEP, flux_levels, line_offset
from emclutch.results.view.run_files import RunFiles


def frame_meshes(files: RunFiles, time: float, parts: tuple[str, ...], colour: str | None) -> dict[str, Any]:
    """Meshes by the name of the part, of those parts that have something to show at a moment [s].

    Their array `shown` is what they are coloured by: of the grains the quantity `colour` of `COLOURS`, of chains
    |F| [N], of the field |B| [T], of walls red, green, blue as bytes.
    """
    read: dict[str, Any] = {
        name: pyvista.read(path) for name in files.series if (path := files.file(name, time)) is not None
    }
    found: dict[str, Any] = {}
    if "grains" in parts and "particles" in read and colour is not None and read["particles"].n_points:
        found["grains"] = _spheres(read["particles"], files.colours[colour][0])
    if "chains" in parts and "contacts" in read and read["contacts"].n_cells:
        found["chains"] = _tubes(read["contacts"], 0.5 * float(read["particles"]["diameter"].min()))
    if "walls" in parts and "walls" in read and read["walls"].n_cells:
        found["walls"] = _painted(read["walls"])
    if "field" in read and any(part in parts for part in ("section", "lines", "device")):
        device = _without_air(read["field"], files)
        flat = files.field == "section"
        if "section" in parts and flat:
            found["section"] = device
        if "lines" in parts and flat and (lines := _flux_lines(device)) is not None:
            found["lines"] = lines
        if "device" in parts:
            surface = device.extract_surface(algorithm="dataset_surface")
            swept = surface.extrude_rotate(angle=-SWEEP, resolution=90, capping=True) if flat else surface
            found["device"] = swept
    return found


def _magnitude(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values, axis=1) if values.ndim == 2 else np.asarray(values)


def _spheres(grains: Any, array: str) -> Any:
    centres = pyvista.PolyData(grains.points)
    centres["shown"] = _magnitude(grains[array]).astype(float)
    centres["diameter"] = grains["diameter"]
    ball = pyvista.Sphere(radius=0.5, theta_resolution=16, phi_resolution=16)
    return centres.glyph(orient=False, scale="diameter", factor=1.0, geom=ball)


def _tubes(contacts: Any, radius: float) -> Any:
    """A tube a contact, its section in proportion to the force."""
    force = _magnitude(contacts.cell_data[FORCE[0]])
    contacts.cell_data["shown"] = force
    contacts.cell_data["tube_radius"] = CHAIN_WIDTH * radius * np.sqrt(force / (force.max() or 1.0))
    return contacts.cell_data_to_point_data().tube(scalars="tube_radius", absolute=True, n_sides=8)


def _painted(walls: Any) -> Any:
    """Walls, each body in a colour of its own with darker marks, which turn with its shaft."""
    rgb = np.array(SHADES)[walls.cell_data["body"] % len(SHADES)]
    rgb = rgb * np.where(walls.cell_data["stripe"] == 1, MARK, 1.0)[:, None]
    walls.cell_data["shown"] = (255.0 * rgb).astype(np.uint8)
    return walls


def _without_air(field: Any, files: RunFiles) -> Any:
    place = field.point_data if files.field_at_points else field.cell_data
    place["shown"] = _magnitude(place[FLUX_DENSITY[0]])
    if files.air is None:
        return field
    return field.extract_cells(np.flatnonzero(field.cell_data["region"] != files.air))


def _flux_lines(device: Any) -> Any:
    """Lines of the section with equal flux between them, where there is flux."""
    flux = 2.0 * math.pi * device.points[:, 0] * device.point_data["vector_potential"]
    levels = flux_levels(float(flux.min()), float(flux.max()))
    if not levels:
        return None
    lines = device.contour(levels, scalars=flux)
    lines.points += (0.0, line_offset(device.bounds[1]), 0.0)
    return lines
