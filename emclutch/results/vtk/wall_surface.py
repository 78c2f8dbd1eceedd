"""Triangles and polygons of the walls that grains touch, for drawing them in 3D.

A surface of revolution looks the same at every angle. So that its turning is seen it is cut along meridians that turn
with its body, and every other strip between two of them bears a mark (`stripes`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

FACETS = 120  # straight pieces of a full ring, at least
STRIPES_OF_RING, STRIPES_OF_SECTOR = 24, 6  # strips that are marked in turn


def revolved_surface(
    start: tuple[float, float], end: tuple[float, float], *, angle: float | None, turned: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadrilaterals of the surface that a segment in the (r, z) half-plane sweeps about z.

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
        first = turned % step  # where the body's meridians, `step` apart, stand now
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
    """Width of a strip [rad]; an even number of them closes the circle, so that marks alternate all round."""
    if sector_angle is None:
        return 2.0 * math.pi / STRIPES_OF_RING
    pairs = max(1, round(math.pi * STRIPES_OF_SECTOR / sector_angle))
    return math.pi / pairs


def stripes(material_angle: np.ndarray, sector_angle: float | None) -> np.ndarray:
    """Return whether a cell at a material angle [rad] bears a mark, 0 or 1 (m,) int32."""
    return np.floor(np.asarray(material_angle) / stripe_angle(sector_angle)).astype(np.int32) % 2


def triangle_surface(
    vertices: np.ndarray, triangles: np.ndarray, *, turned: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A triangle wall, turned with its body; in a cyclic sector the whole wall is drawn.

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
    """Corners (k, 3) of a plane's part that lies on the grains' side of the other planes.

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
        corners = _clipped(corners, np.asarray(other.point), np.asarray(other.normal))
    return np.array(corners).reshape(-1, 3)


def _clipped(corners: list[np.ndarray], point: np.ndarray, normal: np.ndarray) -> list[np.ndarray]:
    """Sutherland and Hodgman: the part of a convex polygon on one side of a plane."""
    kept: list[np.ndarray] = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        height_a, height_b = float(np.dot(a - point, normal)), float(np.dot(b - point, normal))
        if height_a >= 0.0:
            kept.append(a)
        if (height_a < 0.0) != (height_b < 0.0):
            kept.append(a + (b - a) * height_a / (height_a - height_b))
    return kept
