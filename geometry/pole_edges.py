"""Cut edges of poles: a chamfer of 45 degrees or a fillet at right-angled corners of a polygon of the section.

In the polygon a fillet's arc is drawn by chords whose inner corners lie so far from its centre that the area removed is
that of the arc, (1 - pi/4) r^2: the volume of steel does not depend on the number of chords. The mesh of a section has
the arc itself (`Clutch.fillet_arcs`); fields in 3D have the chords. A chamfer removes c^2/2.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

CHORDS = 4
"""Of a fillet: 0.4 r each, their corners 1.7 % of r from the arc. The winding's side is a tangent of the fillet: with
more chords the triangle between them is flatter."""

SMALLEST_EDGE = 50e-6
"""Smallest chamfer and fillet [m]: what is machined as a sharp edge is broken by as much."""


def cut_corners(polygon: np.ndarray, which: Collection[int], *, chamfer: float, fillet: float) -> np.ndarray:
    """Return a polygon with some of its right-angled corners cut.

    Parameters
    ----------
    polygon : ndarray (n, 2)
        Corners [m].
    which : collection of int
        Indexes of the corners to cut; both sides of each have to be longer than what is cut.
    chamfer, fillet : float
        Leg of the chamfer or radius of the fillet [m]; with both 0 the polygon comes back as it is.

    Returns
    -------
    ndarray (m, 2)
    """
    size = max(chamfer, fillet)
    if size == 0.0:
        return polygon
    turns = np.linspace(0.0, 0.5 * math.pi, 2 if chamfer > 0.0 else CHORDS + 1)
    reach = np.full(len(turns), 1.0)
    reach[1:-1] = _inner_reach(len(turns) - 1)
    corners: list[np.ndarray] = []
    for i, corner in enumerate(polygon):
        if i not in which:
            corners.append(corner)
            continue
        back, ahead = (polygon[i - 1] - corner, polygon[(i + 1) % len(polygon)] - corner)
        back, ahead = back / np.linalg.norm(back), ahead / np.linalg.norm(ahead)
        centre = corner + size * (back + ahead)
        corners += [
            centre - size * k * (math.cos(t) * ahead + math.sin(t) * back) for k, t in zip(reach, turns, strict=True)
        ]
    return np.array(corners)


def _inner_reach(chords: int) -> float:
    """Distance of a fillet's inner corners from its centre over r.

    With ends at r and inner corners at k r, the n triangles of the chords have the area of the quarter circle where
    sin(pi/2n) (2 k + (n - 2) k^2) = pi/2.
    """
    n, area = chords - 2, 0.5 * math.pi / math.sin(0.5 * math.pi / chords)
    return (math.sqrt(1.0 + n * area) - 1.0) / n if n > 0 else 0.5 * area
