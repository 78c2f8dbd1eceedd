"""Random packings without overlap: grains are thrown in at random and pushed apart.

Grains start small and grow to full size in a few steps, so that deep random overlaps open without tearing neighbours
through walls. The same seed gives the same packing. Random close packing of equal spheres is at a solid fraction of
0.64; the method stalls somewhat below, and walls a few diameters apart lower what fits, hence the refusal above 0.60:
what is denser has to be grown (`particles.packing.grown_packing`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.walls import Wall
from particles.errors import PackingError
from particles.packing.packing import Packing
from particles.packing.push_apart import TOLERANCE, Crowd
from particles.packing.space import Place, Space
from particles.sector import CyclicSector

DENSEST = 0.60  # solid fraction
GROWTH = (0.7, 0.85, 0.95, 1.0)  # sizes that the grains go through
SWEEPS = (30, 30, 60, 3000)  # the most sweeps at each size


def pack(
    boxes: Sequence[Place] | Place,
    walls: Sequence[Wall],
    count: int,
    radius: float,
    *,
    seed: int,
    sector: CyclicSector | None = None,
) -> np.ndarray:
    """Centres of ``count`` equal grains at random, sorted by cells, shape (count, 3) [m].

    Parameters
    ----------
    boxes
        Where to throw grains in: rings (each gets its part by volume; within ``sector`` where there is
        one) or a box.
    walls
        Kept clear of.
    radius : float
        [m]
    seed : int
        Of the random positions.

    Raises
    ------
    PackingError
        If the grains would fill more than 0.60 of the boxes, a box is thinner than a grain, or overlaps stay.
    """
    if count < 1:
        raise PackingError(f"{count} grains of radius {radius} m cannot be packed; both must be positive")
    return random_packing(Space.of(boxes, walls, sector), np.full(count, float(radius)), seed=seed).position


def random_packing(space: Space, radius: np.ndarray, *, seed: int) -> Packing:
    """Grains of ``radius`` (n,) [m] at random in ``space``, sorted by cells; as `pack`."""
    size = space.require_positive(radius)
    space.require_room(size, DENSEST, "random close packing is 0.64")
    return part_or_refuse(Crowd(space.throw(np.random.default_rng(seed), size), size, space))


def part_or_refuse(crowd: Crowd) -> Packing:
    """Grow thrown grains to full size.

    Raises
    ------
    PackingError
        If overlaps stay.
    """
    for scale, sweeps in zip(GROWTH, SWEEPS, strict=True):
        crowd.part(scale, sweeps)
    return finished(crowd)


def finished(crowd: Crowd) -> Packing:
    """The packing that a crowd has become; raises PackingError if overlaps are left."""
    if not crowd.worst < TOLERANCE:
        raise PackingError(
            f"the grains cannot be pushed apart: an overlap of {100.0 * crowd.worst:.2g} % of the diameter is left "
            f"(allowed: {100.0 * TOLERANCE:g} %); lower the number of grains, or take smaller ones where "
            "walls are only a few diameters apart",
            crowd.worst,
        )
    # not the displacement: between two walls one pushes back what the other has pushed away
    in_walls = crowd.space.push_off(crowd.position.copy(), crowd.radius) / (2.0 * float(crowd.radius.min()))
    if not in_walls < TOLERANCE:
        raise PackingError(
            f"the grains cannot be pushed off the walls: {100.0 * in_walls:.2g} % of a diameter overlap "
            f"(allowed: {100.0 * TOLERANCE:g} %), where two walls are less than a grain apart; take smaller grains, or "
            "fill another place",
            in_walls,
        )
    lost = int(np.count_nonzero(crowd.space.in_solids(crowd.position)))
    if lost:
        raise PackingError(
            f"{lost} of {len(crowd.radius)} grains were pushed into a vane or another solid of triangles; lower the "
            "number of grains"
        )
    crowd.wrap()
    return Packing(crowd.position, crowd.radius)
