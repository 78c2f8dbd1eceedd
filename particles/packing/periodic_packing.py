"""Random places of grains in a periodic box: thrown in, grown and pushed apart."""

from __future__ import annotations

import numpy as np

from particles.neighbours.neighbour_list import find_pairs
from particles.sheared_box import GapBox, ShearedBox

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
    _require_fill(count, fill)
    box = ShearedBox.of_fill(count, diameter, fill)
    return box, random_in_box(box, np.full(count, 0.5 * diameter), seed=seed)


def random_in_box(box: ShearedBox, radius: np.ndarray, *, seed: int) -> np.ndarray:
    """Centres (n, 3) [m] of grains of ``radius`` (n,) [m] at random in a box at rest; as `periodic_packing`.

    In a gap they keep clear of both walls.
    """
    if isinstance(box, GapBox) and box.corner.any():
        return box.corner + random_in_box(GapBox(box.lengths), radius, seed=seed)
    count, widest = len(radius), 2.0 * float(radius.max(initial=0.0))
    fill = float(np.sum(4.0 / 3.0 * np.pi * radius**3)) / box.volume
    _require_fill(count, fill, 2.0 / 3.0 * np.pi * (0.5 * widest) ** 3 / box.volume)
    smallest = 2.0 * float(radius.min())
    axes = 2 if isinstance(box, GapBox) else 3
    x = np.random.default_rng(seed).uniform(0.0, 1.0, (count, 3)) * box.lengths
    for size in SIZES:
        scale = size * SPARE
        for turn in range(_ROUNDS):
            if turn % _LISTED == 0:
                x[:, :axes] %= box.lengths[:axes]
                pairs = find_pairs(x, max(scale * widest, min(1.2 * scale * widest, box.widest_cutoff(x))), box)
                first, second, shift = pairs.rows(), pairs.other, box.place(np.zeros((pairs.count, 3)), pairs.shift)
                wanted = scale * (radius[first] + radius[second])
            apart = x[first] - x[second] - shift
            distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-12 * smallest)
            depth = wanted - distance
            # pushed by a little more than they overlap: neighbours push back
            if turn % _LISTED == 0 and depth.max(initial=0.0) < (1e-3 if size == 1.0 else 0.05) * smallest:
                break
            push = (0.55 * np.maximum(depth, 0.0) / distance)[:, None] * apart
            for axis in range(3):
                x[:, axis] += np.bincount(first, push[:, axis], count)
                x[:, axis] -= np.bincount(second, push[:, axis], count)
            if axes == 2:
                x[:, 2] = np.clip(x[:, 2], scale * radius, box.lengths[2] - scale * radius)
    if depth.max(initial=0.0) >= 5e-3 * smallest:
        raise BoxTooDense(f"{count} grains at a fill of {fill:g} cannot be pushed apart; lower the fill")
    x[:, :axes] %= box.lengths[:axes]
    return x


def _require_fill(count: int, fill: float, half_a_grain: float = 0.0) -> None:
    if count < 1 or not 0.0 < fill <= DENSEST + half_a_grain:  # numbers are whole
        raise ValueError(
            f"{count} grains at a fill of {fill:.4g}; allowed: at least one grain, and a fill above 0 and at most "
            f"{DENSEST}"
        )
