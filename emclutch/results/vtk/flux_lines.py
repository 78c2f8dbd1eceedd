"""Flux lines of a section for ParaView: lines of psi = r A_phi inside the device, as smooth as its finite elements.

Between two neighbouring lines runs the same flux, 2 pi times the difference of psi. Elements are subdivided before psi
is taken to be linear: a contour of the values at the mesh's points alone has a corner on every edge.
"""

from __future__ import annotations

import numpy as np

from emclutch.results.pictures.section import FLUX_LINES, flux_levels
from field import MagneticField
from field.section.smooth_field import SmoothField

PARTS = 4  # of an element's edge


def flux_lines(solution: MagneticField) -> tuple[np.ndarray, np.ndarray]:
    """Return segments (k, 2, 2) of the lines, their ends r, z [m], and the flux (k,) [Wb] inside of each, 2 pi psi."""
    field = SmoothField(solution.problem.elements, solution.psi)
    regions = solution.problem.mesh.regions
    solid = np.concatenate([elements for name, elements in regions.items() if name != "air"])
    fine = field.subdivide(solid, PARTS)
    segments, flux = [np.empty((0, 2, 2))], [np.empty(0)]
    for level in flux_levels(field, FLUX_LINES):
        found = level_segments(fine.points, fine.triangles, fine.psi, level)
        segments.append(found)
        flux.append(np.full(len(found), 2.0 * np.pi * level))
    return np.concatenate(segments), np.concatenate(flux)


def level_segments(points: np.ndarray, triangles: np.ndarray, values: np.ndarray, level: float) -> np.ndarray:
    """Return where values (n,), linear on triangles (k, 3), are `level`: segments (m, 2, 2) between points (n, 2)."""
    above = values[triangles] > level
    crossed = above.any(axis=1) & ~above.all(axis=1)
    corner, above = triangles[crossed], above[crossed]
    lone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), above.argmin(axis=1))  # alone on its side
    each = np.arange(len(corner))
    apex = corner[each, lone]
    ends = []
    for step in (1, 2):
        other = corner[each, (lone + step) % 3]
        part = (level - values[apex]) / (values[other] - values[apex])
        ends.append(points[apex] + part[:, None] * (points[other] - points[apex]))
    return np.stack(ends, axis=1)
