"""The meshes that a moment of a run is drawn with: pyvista's, from the run's files."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyvista
from scipy.spatial import cKDTree

from emclutch.results.text import in_words
from emclutch.results.view.look import CHAIN_WIDTH, FIELDS, FORCE, MARK, SHADES, SWEEP, line_offset
from emclutch.results.view.run_files import RunFiles

FACETS, RING_FACETS = 16, 8  # of a sphere, round and from pole to pole
NAME_STEP, NAME_ASIDE = 0.06, 0.15  # between names and from the device, over the device's height
REPEATED = ("particles", "contacts", "walls")  # series that show a sector only


def frame_meshes(
    files: RunFiles, time: float, parts: tuple[str, ...], colour: str | None, field: str = "B", *, ring: bool = False
) -> dict[str, Any]:
    """Meshes by the name of the part, of those parts that have something to show at a moment [s].

    Their array `shown` is what they are coloured by: of the grains the quantity `colour` of `COLOURS`, of chains
    |F| [N], of the field `field` of `FIELDS`, of walls red, green, blue as bytes. `ring`:
    grains, chains and walls of a sector are repeated round the axis.
    """
    read: dict[str, Any] = {
        name: pyvista.read(path) for name in files.series if (path := files.file(name, time)) is not None
    }
    if ring and files.sector is not None:
        read |= {name: full_ring(read[name], files.sector) for name in REPEATED if name in read}
    found: dict[str, Any] = {}
    if "grains" in parts and "particles" in read and colour is not None and read["particles"].n_points:
        found["grains"] = _spheres(read["particles"], files.colours[colour][0], RING_FACETS if ring else FACETS)
    if "chains" in parts and "contacts" in read and read["contacts"].n_cells:
        found["chains"] = _tubes(read["contacts"], 0.5 * float(read["particles"]["diameter"].min()))
    if "walls" in parts and "walls" in read and read["walls"].n_cells:
        found["walls"] = _painted(read["walls"])
    if "lines" in parts and "flux_lines" in read and read["flux_lines"].n_cells:
        found["lines"] = read["flux_lines"].translate((0.0, line_offset(read["flux_lines"].bounds[1]), 0.0))
    if "field" in read and any(part in parts for part in ("section", "device")):
        device = _without_air(read["field"], files, FIELDS[field][0])
        flat = files.field == "section"
        if "section" in parts and flat:
            found["section"] = device
        if "device" in parts:
            surface = device.extract_surface(algorithm="dataset_surface")
            swept = surface.extrude_rotate(angle=-SWEEP, resolution=90, capping=True) if flat else surface
            found["device"] = swept
    return found


def body_names(files: RunFiles, meshes: dict[str, Any]) -> tuple[np.ndarray, list[str]]:
    """Points (k, 3) [m] at which names of bodies are written, and the names.

    Of walls the corner of each body that is nearest to the left end of the grains; of a device swept from a section the
    place in the cut that is farthest from the edges of each part.
    """
    found: dict[str, np.ndarray] = {}
    if "walls" in meshes and "grains" in meshes:
        walls = meshes["walls"]
        x0, x1, y0, y1, z0, z1 = meshes["grains"].bounds
        left = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), z0 - 0.05 * (z1 - z0)])
        for number, name in enumerate(files.bodies):
            own = np.flatnonzero(walls.cell_data["body"] == number)
            if x0 < 0.0 < x1 and y0 < 0.0 < y1:  # a ring: names apart from each other
                left[:2] = x1 * math.cos(2.0 * number), x1 * math.sin(2.0 * number)
            if len(own):
                found[name] = _nearest(walls.extract_cells(own).points, left)
    elif "device" in meshes and files.field == "section":
        device = meshes["device"]
        centres, region = device.cell_centers().points, device.cell_data["region"]
        seen = (np.abs(centres[:, 1]) < 1e-6 * np.ptp(centres[:, 0])) & (centres[:, 0] > 0.0)
        for number, name in enumerate(files.regions):
            own = np.flatnonzero(seen & (region == number))
            if len(own):
                part = device.extract_cells(own).extract_surface(algorithm="dataset_surface")
                edges = part.clean().extract_feature_edges(feature_edges=False, manifold_edges=False)
                first, last = edges.points[edges.lines.reshape(-1, 3)[:, 1:]].swapaxes(0, 1)
                along = [first + share * (last - first) for share in np.linspace(0.0, 1.0, 9)]
                depth, _ = cKDTree(np.concatenate(along)).query(centres[own])
                found[in_words(name)] = centres[own[depth.argmax()]]
    return np.array(list(found.values())).reshape(-1, 3), list(found)


def name_column(points: np.ndarray, box: tuple[float, ...]) -> np.ndarray:
    """Places (k, 3) [m] of names to the left of a device in a box, none above another, for leader lines to its points.

    They lie in the plane of the cut, in the order of the points' radii.
    """
    x0, x1, _, _, z0, _ = box
    step = max(NAME_STEP * (x1 - x0), np.ptp(points[:, 0]) / max(len(points) - 1, 1))
    places = np.zeros((len(points), 3))
    places[np.argsort(-points[:, 0]), 0] = x1 - step * np.arange(len(points))
    places[:, 2] = z0 - NAME_ASIDE * (x1 - x0)
    return places


def _nearest(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    return points[np.linalg.norm(points - place, axis=1).argmin()]


def full_ring(data: Any, sector: float) -> Any:
    """What lies in a sector [rad] repeated round z; vectors turn with it, and what is shown stays the same."""
    degrees = math.degrees(sector)
    turned = [data.rotate_z(k * degrees, transform_all_input_vectors=True) for k in range(round(360.0 / degrees))]
    return turned[0].append_polydata(*turned[1:]) if len(turned) > 1 else data


def _magnitude(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values, axis=1) if values.ndim == 2 else np.asarray(values)


def _spheres(grains: Any, array: str, facets: int) -> Any:
    centres = pyvista.PolyData(grains.points)
    centres["shown"] = _magnitude(grains[array]).astype(float)
    centres["diameter"] = grains["diameter"]
    ball = pyvista.Sphere(radius=0.5, theta_resolution=facets, phi_resolution=facets)
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


def _without_air(field: Any, files: RunFiles, array: str) -> Any:
    place = field.point_data if files.field_at_points else field.cell_data
    place["shown"] = _magnitude(place[array])
    if files.air is None:
        return field
    return field.extract_cells(np.flatnonzero(field.cell_data["region"] != files.air))
