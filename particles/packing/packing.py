"""Packing: centres and their radii."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.errors import PackingError
from particles.neighbours.neighbour_list import find_pairs
from particles.packing.space import Space
from particles.walls.wall_table import outside


@dataclass(frozen=True, slots=True, eq=False)
class Packing:
    """Grains in their places.

    Attributes
    ----------
    position : ndarray, shape (n, 3)
        Centres [m].
    radius : ndarray, shape (n,)
        [m]
    velocity, angular_velocity : ndarray, shape (n, 3), or None
        [m/s] and [rad/s]; None: at rest.
    """

    position: np.ndarray
    radius: np.ndarray
    velocity: np.ndarray | None = None
    angular_velocity: np.ndarray | None = None

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.radius)


def deepest_overlaps(packing: Packing, space: Space) -> np.ndarray:
    """Deepest overlap of each grain with a neighbour, as a fraction of the smaller diameter, shape (n,); 0: none."""
    deepest = np.zeros(packing.count)
    r = packing.radius
    pairs = find_pairs(packing.position, 2.0 * float(r.max()), space.sector, r)
    i, j = pairs.rows(), pairs.other
    partner = packing.position[j]
    if space.sector is not None:
        partner = space.sector.turn(partner, pairs.shift)
    depth = r[i] + r[j] - np.linalg.norm(partner - packing.position[i], axis=1)
    relative = depth / (2.0 * np.minimum(r[i], r[j]))
    np.maximum.at(deepest, i, relative)
    np.maximum.at(deepest, j, relative)
    return deepest


def require_fit(packing: Packing, space: Space, limit: float) -> None:
    """Refuse a packing in which a grain is outside, or overlaps a wall or a neighbour by more than ``limit``.

    Raises
    ------
    PackingError
        With the grain's number, from 0, its place, and the overlap as a fraction of the diameter.
    """

    def refuse(k: int, what: str, remedy: str, overlap: float | None = None) -> PackingError:
        x, y, z = 1e3 * packing.position[k]
        return PackingError(f"grain {k} at (x, y, z) = ({x:.4g}, {y:.4g}, {z:.4g}) mm {what}; {remedy}", overlap)

    strayed = np.flatnonzero(outside(packing.position, space.walls, 0.0) | space.in_solids(packing.position))
    if len(strayed):
        raise refuse(
            int(strayed[0]),
            f"lies outside the walls or in a solid ({len(strayed)} of {packing.count} grains do)",
            "check the packing's unit of length and its origin (z along the shaft)",
        )
    if space.sector is not None and (strays := np.flatnonzero(space.sector.wraps(packing.position))).size:
        raise refuse(
            int(strays[0]),
            f"lies outside the sector ({strays.size} of {packing.count} grains do)",
            "give only the grains with 0 <= theta < the sector's angle, or leave the sector out",
        )
    for what, relative in (
        ("a wall", space.wall_overlap(packing.position, packing.radius) / (2.0 * packing.radius)),
        ("a neighbour", deepest_overlaps(packing, space)),
    ):
        k = int(np.argmax(relative))
        if relative[k] > limit:
            raise refuse(
                k,
                f"overlaps {what} by {100.0 * relative[k]:.3g} % of the diameter (allowed: {100.0 * limit:g} %)",
                "check diameters and the unit of length, or part the grains first",
                float(relative[k]),
            )
