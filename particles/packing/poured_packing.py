"""The start of a pour: grains loose in the upper part of the space, from where they fall.

Grains are thrown in above a lid that leaves them a solid fraction of 0.3, or in all of the space where they fill more,
and pushed apart. The fall is the DEM's: run `particles.packing.settling.settle` with gravity on.
"""

from __future__ import annotations

import numpy as np

from geometry.walls import Plane
from particles.packing.packing import Packing
from particles.packing.push_apart import Crowd
from particles.packing.random_packing import DENSEST, part_or_refuse
from particles.packing.space import Space

LOOSE = 0.3  # solid fraction above the lid
_MIN_HEIGHT = 4.0  # between lid and ceiling, in largest diameters: less would be a layer
_PROBES = 65_536  # points that measure the volume above a height: to 0.4 %
_THROWS = 2000  # each leaves more than a few per cent of the grains below the lid


def poured_packing(space: Space, radius: np.ndarray, *, up: np.ndarray, seed: int) -> Packing:
    """Grains of ``radius`` (n,) [m] ready to fall against ``up`` (3,), a vector of any length.

    Raises
    ------
    ValueError
        If ``up`` is no direction, or swings round from sector to sector.
    PackingError
        If they would fill more than 0.60 of the space, a place is thinner than a grain, or overlaps stay.
    """
    direction = np.asarray(up, dtype=float).reshape(-1)
    length = float(np.linalg.norm(direction))
    if direction.shape != (3,) or not 0.0 < length < np.inf:
        raise ValueError(f"up = {up}; a direction of three components is needed, against gravity")
    direction = direction / length
    if space.sector is not None and np.hypot(direction[0], direction[1]) > 1e-9:
        raise ValueError(
            "up turns from sector to sector; in a sector grains fall along the axis only: take up = (0, 0, 1), or "
            "leave the sector out"
        )
    size = space.require_positive(radius)
    space.require_room(size, DENSEST, "random close packing is 0.64")
    largest = 2.0 * float(size.max())
    rng = np.random.default_rng(seed)
    heights = space.scatter(rng, np.zeros(_PROBES)) @ direction
    fraction = min(1.0, space.solid_fraction(size) / LOOSE)
    lid = min(float(np.quantile(heights, 1.0 - fraction)), float(heights.max()) - _MIN_HEIGHT * largest)
    position = np.empty((len(size), 3))
    below = np.arange(len(size))
    for _ in range(_THROWS):
        position[below] = space.scatter(rng, size[below])
        below = below[position[below] @ direction < lid + size[below]]
        if not len(below):
            break
    walls = space.walls if fraction == 1.0 else (*space.walls, Plane("lid", "lid", lid * direction, direction))
    return part_or_refuse(Crowd(position, size, Space(space.places, walls, space.sector)))
