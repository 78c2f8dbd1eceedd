"""The space over which stress and profiles are taken, where nobody names it: what the walls span."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.walls import AnnularBox, Plane, RevolvedWall, Wall
from particles.diagnostics.bins import Bins, SlabBins, even_edges, ring_bins
from particles.grains import Grains

LEVEL = 1.0 - 1e-9  # component of a plane's normal from which on the plane counts as normal to an axis


@dataclass(frozen=True, slots=True, eq=False)
class BoxSpace:
    """A rectangular space from corner ``lower`` to ``upper`` [m], shapes (3,)."""

    lower: np.ndarray
    upper: np.ndarray

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(np.prod(np.asarray(self.upper) - np.asarray(self.lower)))


Space = AnnularBox | BoxSpace


def enclosed_space(grains: Grains, walls: Sequence[Wall], *, ring: bool | None = None) -> Space:
    """A ring where there is a wall of revolution (or ``ring`` says so), else a box.

    Each side lies at the outermost wall, or at the outermost grain where no wall bounds it. Planes that are not normal
    to an axis bound nothing here, and what stands inside (a disc in its housing) is not taken out: name the gap itself
    where that matters.
    """
    revolved = [wall for wall in walls if isinstance(wall, RevolvedWall)]
    planes = [wall for wall in walls if isinstance(wall, Plane)]
    x, radius = grains.position, grains.radius
    if ring is None:
        ring = bool(revolved)
    low, high = np.min(x - radius[:, None], axis=0), np.max(x + radius[:, None], axis=0)
    for plane in planes:
        for axis in np.flatnonzero(np.abs(plane.normal) > LEVEL):
            (low if plane.normal[axis] > 0.0 else high)[axis] = plane.point[axis]
    if not ring:
        return BoxSpace(low, high)
    r = np.hypot(x[:, 0], x[:, 1])
    sides = [max(0.0, float(np.min(r - radius))), float(np.max(r + radius)), float(low[2]), float(high[2])]
    ends = np.array([end for wall in revolved for end in (wall.start, wall.end)]).reshape(-1, 2)
    for k in range(2):
        if len(ends) and np.ptp(ends[:, k]) > 0.0:
            sides[2 * k], sides[2 * k + 1] = float(ends[:, k].min()), float(ends[:, k].max())
    return AnnularBox(*sides)


def default_bins(space: Space, width: float, angle: float) -> Bins:
    """Bins of about ``width`` [m]: against r in a ring (a sector of ``angle`` [rad]), against z in a box."""
    if isinstance(space, BoxSpace):
        side = space.upper - space.lower
        return SlabBins(2, 0, even_edges(space.lower[2], space.upper[2], width), float(side[0] * side[1]))
    return ring_bins(space, width, angle=angle)
