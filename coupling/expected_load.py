"""The force on a contact that the stiffness must bear, before a single grain has moved.

Magnetised grains: in a long straight chain of touching dipoles along the field the two halves pull on each other with
zeta(3) = 1.202 times the force of one touching pair, F_pair = (pi/6) mu_0 M^2 a^2 (exact for uniformly magnetised
spheres, Edwards 2017). Sheared packings carry several times the mean on their force chains and walls, so the
expected load is `PEAK` times the pair force.
Weight: the column of grains above, rho g h d^2, times the same factor.
"""

from __future__ import annotations

from math import pi, sqrt

from field import MU_0

PEAK = 6.0  # largest over pair force: 4 gave overlaps of 0.75 % where 0.5 % was allowed (12 N m class, 100 rpm)


def magnetic_load(M: float, diameter: float) -> float:
    """Expected peak force [N] of a contact between grains magnetised to M [A/m]."""
    return PEAK * pi / 6.0 * MU_0 * M**2 * (0.5 * diameter) ** 2


def pair_attraction(M: float, diameter: float) -> float:
    """Largest force [N] between two touching grains magnetised to M [A/m]."""
    return magnetic_load(M, diameter) / PEAK


def snap_in_overlap(M: float, diameter: float, stiffness: float) -> float:
    """Overlap over diameter of two free grains magnetised to M [A/m] that attract each other from afar.

    They bring the energy F_pair d/3 of two coaxial dipoles in contact to a spring k: depth = sqrt(2 F_pair d/(3 k)),
    without damping. A packing settles below it; it shows when the coil is switched on.
    """
    pair = pair_attraction(M, diameter)
    return sqrt(2.0 * pair / (3.0 * stiffness * diameter))


def weight_load(density: float, acceleration: float, height: float, diameter: float) -> float:
    """Expected peak force [N] under a column of `height` [m] of grains of `density` [kg/m^3]."""
    return PEAK * density * acceleration * height * diameter**2
