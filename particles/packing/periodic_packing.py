"""Random places of equal grains in a periodic box: thrown in, grown and pushed apart."""

from __future__ import annotations

import numpy as np

from particles.neighbours.neighbour_list import find_pairs
from particles.sheared_box import ShearedBox

SIZES = (0.7, 0.85, 0.95, 1.0)
SPARE = 1.005  # pushed apart a little further than the grains are thick, or every pair that was pushed would touch
DENSEST = 0.58
_ROUNDS, _LISTED = 3000, 10


class BoxTooDense(RuntimeError):
    """The grains cannot be pushed apart."""


def periodic_packing(count: int, diameter: float, fill: float, *, seed: int) -> tuple[ShearedBox, np.ndarray]:
    """A cube at rest and the centres (n, 3) [m] of grains of ``diameter`` [m] that take the fraction ``fill`` of it.

    Raises
    ------
    ValueError
        No grains, or a fill out of range; so few grains that one would meet another twice.
    BoxTooDense
        Overlaps stay.
    """
    if count < 1 or not 0.0 < fill <= DENSEST:
        raise ValueError(
            f"{count} grains at a fill of {fill}; allowed: at least one grain, and a fill above 0 and at most {DENSEST}"
        )
    box = ShearedBox.of_fill(count, diameter, fill)
    x = np.random.default_rng(seed).uniform(0.0, 1.0, (count, 3)) * box.lengths
    for size in SIZES:
        wanted = size * SPARE * diameter
        for turn in range(_ROUNDS):
            if turn % _LISTED == 0:
                x %= box.lengths
                pairs = find_pairs(x, max(wanted, min(1.2 * wanted, box.widest_cutoff(x))), box)
                first, second, shift = pairs.rows(), pairs.other, box.place(np.zeros((pairs.count, 3)), pairs.shift)
            apart = x[first] - x[second] - shift
            distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-12 * diameter)
            depth = wanted - distance
            # pushed by a little more than they overlap: neighbours push back
            if turn % _LISTED == 0 and depth.max(initial=0.0) < (1e-3 if size == 1.0 else 0.05) * diameter:
                break
            push = (0.55 * np.maximum(depth, 0.0) / distance)[:, None] * apart
            for axis in range(3):
                x[:, axis] += np.bincount(first, push[:, axis], count)
                x[:, axis] -= np.bincount(second, push[:, axis], count)
    if depth.max(initial=0.0) >= 5e-3 * diameter:
        raise BoxTooDense(f"{count} grains at a fill of {fill:g} cannot be pushed apart; lower the fill")
    return box, x % box.lengths
