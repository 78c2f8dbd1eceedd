"""The meshes that a moment of a run is drawn with: pyvista's, from the run's files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from emclutch.results.text import in_words
from emclutch.results.view.look import CHAIN_WIDTH, CORNER, FIELDS, FORCE, MARK, SHADES, SWEEP, line_offset, near_box
from emclutch.results.view.run_files import RunFiles

FACETS, RING_FACETS = 16, 8  # of a sphere, round and from pole to pole
SWEEP_FACETS = 90  # of a device, round its axis
NAME_STEP, NAME_ASIDE = 0.05, 0.04  # between names and from what they name, over its height
DEEP = 0.7  # of the largest distance from a part's edges, where its leader may end
Axes = Sequence[Sequence[float]]  # `look.view_axes`
REPEATED = ("particles", "contacts", "walls")  # series that show a sector only


def frame_meshes(
    files: RunFiles,
    time: float,
    parts: tuple[str, ...],
    colour: str | None,
    field: str | None = None,
    *,
    ring: bool = False,
) -> dict[str, Any]:
    """Meshes by the name of the part, of those parts that have something to show at a moment [s].

    Their array `shown` is what they are coloured by: of the grains the quantity `colour` of `COLOURS`, of chains
    |F| [N], of the field `field` of `FIELDS`, of walls red, green, blue as bytes. Without `field` a section shows B,
    and a device that is swept from it the colours of its bodies, as bytes. `ring`: grains, chains and walls of a sector
    are repeated round the axis, with a device that is swept from a section to half the circle those in that half.
    """
    read: dict[str, Any] = {
        name: pyvista.read(path) for name in files.series if (path := files.file(name, time)) is not None
    }
    if ring and files.sector is not None:
        read |= {name: full_ring(read[name], files.sector) for name in REPEATED if name in read}
        if "device" in parts and files.field == "section" and "particles" in read:  # of which one half is drawn
            grains = read["particles"]
            read["particles"] = grains.extract_points(grains.points[:, 1] <= grains["diameter"])
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
        device = _without_air(read["field"], files, FIELDS[field or "B"][0])
        flat = files.field == "section"
        if "section" in parts and flat:
            found["section"] = device
        if "device" in parts:
            surface = device.extract_surface(algorithm="dataset_surface")
            found["device"] = surface
            if flat:
                found["edges"] = device_edges(surface)
                swept = surface.extrude_rotate(angle=-SWEEP, resolution=SWEEP_FACETS, capping=True)
                if field is None:
                    swept.clear_point_data()
                    shades = (255.0 * np.array(files.shades)).astype(np.uint8)
                    swept.cell_data["shown"] = shades[swept.cell_data["region"]]
                found["device"] = swept
    if "section" in found and "particles" in read and files.sector is not None and not ring:
        box = near_box(read["particles"].bounds)
        cut = found.keys() & {"section", "lines", "walls"}
        found |= {name: found[name].clip_box(box, invert=False) for name in cut}
    return {name: mesh for name, mesh in found.items() if mesh.n_points}


def device_edges(section: Any) -> Any:
    """Edges of a device that is swept from a section (r, z): in both cuts where bodies meet, and its round corners."""
    section = section.clean()  # bodies have points of their own, where B jumps
    triangles, points = section.regular_faces, section.points
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    region = np.repeat(section.cell_data["region"], 3)
    edges, first, inverse, count = np.unique(edges, axis=0, return_index=True, return_inverse=True, return_counts=True)
    is_border = np.bincount(inverse.ravel(), weights=region != region[first][inverse.ravel()]) > 0.0
    on_axis = (points[edges, 0] < 1e-6 * points[:, 0].max()).all(axis=1)
    is_outer = (count == 1) & ~on_axis
    drawn = edges[is_border | is_outer]
    cut = pyvista.PolyData(points, lines=np.column_stack((np.full(len(drawn), 2), drawn)).ravel())
    round_edges = [_arc(points[corner]) for corner in _corners(points, edges[is_outer], edges[is_border])]
    return cut.append_polydata(cut.rotate_z(-SWEEP), *round_edges)


def _corners(points: np.ndarray, outer: np.ndarray, borders: np.ndarray) -> np.ndarray:
    """Numbers of the points of an outline at which it turns or a border between bodies ends; edges (k, 2) of points."""
    ends, away = np.concatenate((outer, outer[:, ::-1])).T
    order = np.argsort(ends, kind="stable")
    own, start, count = np.unique(ends[order], return_index=True, return_counts=True)
    start, own = start[count == 2], own[count == 2]
    way = points[away[order]] - points[ends[order]]
    way /= np.linalg.norm(way, axis=1)[:, None]
    turns = np.einsum("ij,ij->i", way[start], way[start + 1]) > -math.cos(math.radians(CORNER))
    return own[turns | np.isin(own, borders)]


def _arc(point: np.ndarray) -> Any:
    angle = -np.radians(np.linspace(0.0, SWEEP, SWEEP_FACETS + 1))
    ring = np.column_stack((point[0] * np.cos(angle), point[0] * np.sin(angle), np.full(len(angle), point[2])))
    return pyvista.lines_from_points(ring)


def body_names(files: RunFiles, meshes: dict[str, Any], axes: Axes) -> tuple[np.ndarray, list[str]]:
    """Points (k, 3) [m] of bodies at which their names point, and the names.

    Of walls the corner of each body farthest to the left of a view (`look.view_axes`), of a ring the middle of the
    widest face there, lower for each body inside of another. Of a device that is swept from a section a place in the
    cut, well inside the part and near its left end, or near its right end where it all lies to the right.
    """
    found: dict[str, np.ndarray] = {}
    if "walls" in meshes and "grains" in meshes:
        walls, towards = meshes["walls"], -np.array(axes[0])
        x0, x1, y0, y1, *_ = meshes["grains"].bounds
        is_ring = x0 < 0.0 < x1 and y0 < 0.0 < y1
        for number, name in enumerate(files.bodies):
            own = np.flatnonzero(walls.cell_data["body"] == number)
            if len(own):
                body = walls.extract_cells(own)
                places = body.points
                if is_ring and body.bounds[1] < walls.bounds[1]:  # inside of another body
                    area = np.abs(body.compute_cell_sizes()["Area"])
                    places, towards = body.cell_centers().points[area > 0.9 * area.max()], towards - axes[1]
                found[name] = places[(places @ towards).argmax()]
    elif "device" in meshes and files.field == "section":
        device = meshes["device"]
        centres, region = device.cell_centers().points, device.cell_data["region"]
        seen = (np.abs(centres[:, 1]) < 1e-6 * np.ptp(centres[:, 0])) & (centres[:, 0] > 0.0)
        middle = centres[:, 2].mean()
        for number, name in enumerate(files.regions):
            own = np.flatnonzero(seen & (region == number))
            if len(own):
                part = device.extract_cells(own).extract_surface(algorithm="dataset_surface")
                edges = part.clean().extract_feature_edges(feature_edges=False, manifold_edges=False)
                first, last = edges.points[edges.lines.reshape(-1, 3)[:, 1:]].swapaxes(0, 1)
                along = [first + share * (last - first) for share in np.linspace(0.0, 1.0, 9)]
                depth, _ = cKDTree(np.concatenate(along)).query(centres[own])
                inside = centres[own[depth > DEEP * depth.max()]]
                is_left = inside[:, 2].min() < middle
                found[in_words(name)] = inside[inside[:, 2].argmin() if is_left else inside[:, 2].argmax()]
    return np.array(list(found.values())).reshape(-1, 3), list(found)


def name_places(points: np.ndarray, box: tuple[float, ...], axes: Axes) -> np.ndarray:
    """Places (k, 3) [m] of names in a column to the left of a box, for leader lines to its points that do not cross.

    They have the depths of the points. Leaders of the least total length do not cross: two that did could be exchanged.
    """
    corners = np.array(np.meshgrid(box[:2], box[2:4], box[4:])).reshape(3, -1).T @ np.transpose(axes)
    seen, low, high = points @ np.transpose(axes), corners.min(axis=0), corners.max(axis=0)
    count, height = len(points), high[1] - low[1]
    step = max(NAME_STEP * height, np.ptp(seen[:, 1]) / max(count - 1, 1))
    middle = 0.5 * (seen[:, 1].min() + seen[:, 1].max())
    slots = middle + step * (np.arange(count) - 0.5 * (count - 1))
    left = low[0] - NAME_ASIDE * height
    _, slot = linear_sum_assignment(np.hypot(seen[:, :1] - left, seen[:, 1:2] - slots))
    return np.column_stack((np.full(count, left), slots[slot], seen[:, 2])) @ np.array(axes)


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
