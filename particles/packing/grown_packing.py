"""Dense random packings: grains grow while they are shaken, until they touch all round.

After Lubachevsky & Stillinger (J. Stat. Phys. 60, 1990): spheres that move about while they grow find denser places
than spheres that are only pushed apart, and the slower they grow, the denser. Their motion between collisions is
replaced by small random throws, each followed by two sweeps of pushing apart (`particles.packing.push_apart`).
Growth that ends in overlaps is taken back to where grains are loose and repeated four times slower, twice at most.

**What fits.** Random close packing, 0.634 for equal spheres far from walls, rises with the spread of sizes: Desmond &
Weeks (Phys. Rev. E 90, 022204, 2014) give phi = 0.634 + 0.0658 delta + 0.0857 S delta^2 with delta = standard
deviation/mean and S = skewness of the radii; above it is refused. A layer of about a quarter of a diameter at every
wall stays poorly filled: of equal grains in a cube of 15 diameters 0.61 was reached, in one of 10 diameters 0.58.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from particles.packing.packing import Packing
from particles.packing.push_apart import Crowd
from particles.packing.random_packing import GROWTH, SWEEPS, finished
from particles.packing.space import Space

_LOOSE = 0.45  # solid fraction up to which grains are parted without shaking
_STAGES = 20  # sizes from there to the full one
_ROUNDS = (25, 100, 400)  # throws at each size: slower each time
_THROW = 0.1  # of a diameter; 0.05 reached less in the same time
_LAST_SWEEPS = 1500


def random_close_packing(radius: np.ndarray) -> float:
    """Solid fraction of random close packing far from walls for ``radius`` (n,) [m] (module docstring)."""
    relative = np.asarray(radius) / float(np.mean(radius))
    return close_packing_of_moments(lambda power: float(np.mean(relative**power)))


def close_packing_of_moments(moment: Callable[[int], float]) -> float:
    """The same from the moments of the size, ``moment(k)`` being the mean of its k-th power, in any unit."""
    mean = moment(1)
    second, third = moment(2) / mean**2, moment(3) / mean**3
    variance = second - 1.0
    if variance <= 1e-12:
        return 0.634
    delta = math.sqrt(variance)
    skewness = (third - 3.0 * second + 2.0) / variance**1.5
    return 0.634 + 0.0658 * delta + 0.0857 * skewness * delta**2


def grown_packing(space: Space, radius: np.ndarray, *, seed: int) -> Packing:
    """Grains of ``radius`` (n,) [m] packed as densely as their sum asks for, sorted by cells.

    Raises
    ------
    PackingError
        Above random close packing, if a place is thinner than a grain, or if overlaps stay.
    """
    size = space.require_positive(radius)
    densest = random_close_packing(size)
    space.require_room(size, densest, f"random close packing of these sizes is {densest:.3f}")
    rng = np.random.default_rng(seed)
    crowd = Crowd(space.throw(rng, size), size, space)
    loose = min(1.0, (_LOOSE / space.solid_fraction(size)) ** (1.0 / 3.0))
    for scale, sweeps in zip(GROWTH, SWEEPS, strict=True):
        separated = crowd.part(loose * scale, sweeps)
    if loose == 1.0:
        return finished(crowd)
    for rounds in _ROUNDS:
        for scale in np.linspace(loose, 1.0, _STAGES):
            crowd.shake(float(scale), rounds, _THROW, rng)
        separated = crowd.part(1.0, _LAST_SWEEPS)
        if separated:
            break
    return finished(crowd)
