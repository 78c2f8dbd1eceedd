"""Polygons of the walls that grains touch, for drawing them in 3D.

A surface of revolution looks the same at every angle. So that its turning is seen it is cut along meridians that turn
with its body, and every other strip between two of them bears a mark (`stripes`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.vtk.data_set import poly_data, write_data_set

if TYPE_CHECKING:
    from particles.diagnostics.wall_pressure import WallPressure

FACETS = 120  # straight pieces of a full ring, at least
STRIPES_OF_RING, STRIPES_OF_SECTOR = 24, 6  # strips that are marked in turn


@dataclass(frozen=True, slots=True)
class WallSurfaces:
    """Surfaces of all walls.

    Attributes
    ----------
    points, velocity : (n, 3) [m], [m/s].
    polygons : point numbers of each of the k polygons.
    cell_arrays : (k,) by name: `body` (its number among `bodies`), `wall`, `angular_speed` [rad/s], `material_angle`
        [rad], `stripe`.
    bodies : their names.
    """

    points: np.ndarray
    velocity: np.ndarray
    polygons: list[np.ndarray]
    cell_arrays: dict[str, np.ndarray]
    bodies: list[str]


def wall_surfaces(
    walls: Sequence[Any], angles: Mapping[str, float], speeds: Mapping[str, float], sector_angle: float | None
) -> WallSurfaces:
    """Return the surfaces of walls where their bodies have turned them.

    Parameters
    ----------
    walls : revolved walls (`start`, `end`), planes (`point`, `normal`) and triangle walls (`vertices`,
        `triangles`), each with `name`, `body`.
    angles, speeds : of the bodies by name [rad], [rad/s]; 0 where missing.
    sector_angle : of the cyclic sector [rad]; None draws full rings. A sector's walls stay over its
        grains; that they turn is seen by the marks of the cell array `stripe`, which turn with the body.
    """
    bodies = list(dict.fromkeys(wall.body for wall in walls))
    planes = [wall for wall in walls if hasattr(wall, "normal")]
    reach = reach_of(walls)
    points, velocity, polygons = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    rows: list[tuple[int, int, float, float, int]] = []
    count = 0
    for number, wall in enumerate(walls):
        turned, speed = angles.get(wall.body, 0.0), speeds.get(wall.body, 0.0)
        if hasattr(wall, "normal"):
            corners = plane_polygon(wall, planes, reach)
            faces, material = np.arange(len(corners))[None], np.zeros(1)
        elif hasattr(wall, "triangles"):
            corners, faces, material = triangle_surface(wall.vertices, wall.triangles, turned=turned)
        else:
            corners, faces, material = revolved_surface(wall.start, wall.end, angle=sector_angle, turned=turned)
        if len(corners) < 3:  # the other planes leave nothing of this one
            continue
        points.append(corners)
        velocity.append(speed * np.column_stack([-corners[:, 1], corners[:, 0], np.zeros(len(corners))]))
        polygons += list(faces + count)
        count += len(corners)
        marks = stripes(material, sector_angle) if hasattr(wall, "start") else np.zeros(len(faces), dtype=np.int32)
        rows += [(bodies.index(wall.body), number, speed, *cell) for cell in zip(material, marks, strict=True)]
    kinds = {"body": "i4", "wall": "i4", "angular_speed": "f8", "material_angle": "f8", "stripe": "i4"}
    cells = np.array(rows, dtype=list(kinds.items()))
    arrays = {name: np.ascontiguousarray(cells[name]) for name in kinds}
    return WallSurfaces(np.vstack(points), np.vstack(velocity), polygons, arrays, bodies)


def revolved_surface(
    start: tuple[float, float], end: tuple[float, float], *, angle: float | None, turned: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return quadrilaterals of the surface that a segment in the (r, z) half-plane sweeps about z.

    Parameters
    ----------
    start, end : (r, z) [m].
    angle : of the sector [rad]; None for the full ring.
    turned : angle of the body [rad]. A full ring is turned by it. A sector stays over its grains: its marks pass by.

    Returns
    -------
    points (k, 3) [m], quadrilaterals (m, 4), material angle (m,) [rad] in [0, 2 pi): azimuth of each
    cell in the frame that turns with the body.
    """
    opening = 2.0 * math.pi if angle is None else angle
    step = stripe_angle(angle)
    step /= max(1, math.ceil(step * FACETS / (2.0 * math.pi)))
    if angle is None:
        azimuth = turned + np.linspace(0.0, opening, round(opening / step) + 1)
    else:
        first = turned % step  # where the body's meridians, `step` apart, are at present
        cuts = first + step * np.arange(math.ceil(opening / step) + 1)
        sliver = 1e-6 * step  # a meridian that coincides with a face of the sector cuts nothing off
        azimuth = np.concatenate([[0.0], cuts[(cuts > sliver) & (cuts < opening - sliver)], [opening]])
    (r0, z0), (r1, z1) = start, end
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    lower = np.column_stack([r0 * cos, r0 * sin, np.full_like(cos, z0)])
    upper = np.column_stack([r1 * cos, r1 * sin, np.full_like(cos, z1)])
    n = len(azimuth)
    i = np.arange(n - 1)
    quads = np.column_stack([i, i + 1, n + i + 1, n + i])
    middle = 0.5 * (azimuth[1:] + azimuth[:-1])
    return np.vstack([lower, upper]), quads, np.mod(middle - turned, 2.0 * math.pi)


def stripe_angle(sector_angle: float | None) -> float:
    """Return the width of a strip [rad]; an even number of them closes the circle, so that marks alternate."""
    if sector_angle is None:
        return 2.0 * math.pi / STRIPES_OF_RING
    pairs = max(1, round(math.pi * STRIPES_OF_SECTOR / sector_angle))
    return math.pi / pairs


def stripes(material_angle: np.ndarray, sector_angle: float | None) -> np.ndarray:
    """True if a cell at a material angle [rad] bears a mark, 0 or 1 (m,) int32."""
    return np.floor(np.asarray(material_angle) / stripe_angle(sector_angle)).astype(np.int32) % 2


def triangle_surface(
    vertices: np.ndarray, triangles: np.ndarray, *, turned: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a triangle wall, turned with its body; in a cyclic sector the whole wall is drawn.

    Parameters
    ----------
    vertices (v, 3) [m], triangles (t, 3) : of the wall at angle 0.
    turned : angle of the body [rad].

    Returns
    -------
    points (v, 3) [m], triangles (t, 3), material angle (t,) [rad] in [0, 2 pi): azimuth of each triangle's centre in
    the frame that turns with the body.
    """
    cos, sin = math.cos(turned), math.sin(turned)
    x, y, z = np.asarray(vertices, dtype=np.float64).T
    centre = np.asarray(vertices)[triangles].mean(axis=1)
    material = np.mod(np.arctan2(centre[:, 1], centre[:, 0]), 2.0 * math.pi)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, z]), np.asarray(triangles), material


def plane_polygon(plane: Any, others: Sequence[Any], reach: float) -> np.ndarray:
    """Return the corners (k, 3) of a plane's part that lies on the grains' side of the other planes.

    Parameters
    ----------
    plane, others : with `point` (3,) [m] and unit `normal` (3,) that points to the grains.
    reach : half the edge of the square that an unbounded plane is drawn as [m].
    """
    normal = np.asarray(plane.normal, dtype=np.float64)
    aside = np.eye(3)[np.argmin(np.abs(normal))]
    u = np.cross(normal, aside)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    centre = np.asarray(plane.point, dtype=np.float64)
    corners = [centre + reach * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for other in others:
        if other is plane or abs(float(np.dot(other.normal, normal))) > 1.0 - 1e-9:
            continue
        corners = _clip(corners, np.asarray(other.point), np.asarray(other.normal))
    return np.array(corners).reshape(-1, 3)


def _clip(corners: list[np.ndarray], point: np.ndarray, normal: np.ndarray) -> list[np.ndarray]:
    """Return the part of a convex polygon on one side of a plane (Sutherland and Hodgman)."""
    kept: list[np.ndarray] = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        height_a, height_b = float(np.dot(a - point, normal)), float(np.dot(b - point, normal))
        if height_a >= 0.0:
            kept.append(a)
        if (height_a < 0.0) != (height_b < 0.0):
            kept.append(a + (b - a) * height_a / (height_a - height_b))
    return kept


def reach_of(walls: Sequence[Any]) -> float:
    """Return half the edge of an unbounded plane's square: twice the size of what the walls enclose [m]."""
    points = [np.asarray(wall.point, dtype=np.float64) for wall in walls if hasattr(wall, "normal")]
    points += [np.array([math.hypot(*wall.start), 0.0, wall.start[1]]) for wall in walls if hasattr(wall, "start")]
    points += [corner for wall in walls if hasattr(wall, "triangles") for corner in wall.bounds]
    if not points:
        return 1.0
    spread = float(np.ptp(np.array(points), axis=0).max())
    return 2.0 * (spread or float(np.abs(points).max()) or 0.5)


def write_wall_pressure_surfaces(
    folder: str | Path, load: WallPressure, walls: Sequence[Any], sector_angle: float | None, time: float
) -> Path:
    """Write the surfaces of all bins, of a cyclic sector its own part.

    Parameters
    ----------
    folder : of the run.
    load, walls : as of `WallPressure`.
    sector_angle : [rad]; None draws full rings.
    time : [s].

    Returns
    -------
    Path
        The file. Its cells have `pressure`, `shear_stress` [Pa], `wall` and `body` (its number among the names in the
        field data `bodies`).
    """
    bodies = list(dict.fromkeys(wall.body for wall in walls))
    planes = [wall for wall in walls if hasattr(wall, "normal")]
    reach = reach_of(walls)
    points, polygons, rows, count = [np.zeros((0, 3))], [], [], 0
    for b, number in enumerate(load.bins.wall):
        wall, k = walls[number], load.bins.coordinate[number]
        if k >= 0:
            start, end = np.array(wall.start), np.array(wall.end)
            low, high = (start + (s - start[k]) / (end[k] - start[k]) * (end - start)
                         for s in (load.bins.low[b], load.bins.high[b]))  # fmt: skip
            corners, faces, _ = revolved_surface(tuple(low), tuple(high), angle=sector_angle, turned=0.0)
        elif hasattr(wall, "normal"):
            corners = plane_polygon(wall, planes, reach)
            faces = np.arange(len(corners))[None]
        else:
            corners, faces, _ = triangle_surface(wall.vertices, wall.triangles, turned=0.0)
        if len(corners) < 3:  # the other planes leave nothing of this one
            continue
        points.append(corners)
        polygons += list(faces + count)
        count += len(corners)
        rows += [(load.pressure[b], load.shear_stress[b], number, bodies.index(wall.body))] * len(faces)
    columns = np.array(rows, dtype=float).reshape(-1, 4).T
    path = Path(folder) / "wall_pressure.vtp"
    arrays = {"pressure": columns[0], "shear_stress": columns[1], "wall": columns[2].astype("i4"),
              "body": columns[3].astype("i4")}  # fmt: skip
    data = poly_data(np.vstack(points), polygons=polygons)
    write_data_set(path, data, time=time, cell_arrays=arrays, texts={"bodies": bodies})
    return path
