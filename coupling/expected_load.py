"""The force on a contact that the stiffness must bear, before a single grain has moved.

Magnetised grains: in a long straight chain of touching dipoles along the field the two halves pull on each other with
zeta(3) = 1.202 times the force of one touching pair, F_pair = (pi/6) mu_0 M^2 a^2 (exact for uniformly magnetised
spheres, Edwards 2017). Sheared packings carry several times the mean on their force chains and walls, so the
expected load is `PEAK` times the pair force.
Grains whose necks saturate (`coupling.mutual_moments`, near_field): the pair's own force at the smallest gap, which a
chain raises by 2 to 2.7 from 18 kA/m on and a sheared packing by more; and their force falls with the gap by up to
(pi/2) mu_0 Ms^2 a, a negative stiffness that the springs of the contacts must exceed by far.
Weight: the column of grains above, rho g h d^2, times the same factor.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from field import MU_0
from field.spheres.lone_sphere import saturation, sphere_magnetisation
from field.spheres.pair_table import pair_table

PEAK = 6.0  # largest over pair force: 4 gave overlaps of 0.75 % where 0.5 % was allowed (12 N m class, 100 rpm)


def magnetic_load(M: float, diameter: float) -> float:
    """Expected peak force [N] of a contact between grains magnetised to M [A/m]."""
    return PEAK * pi / 6.0 * MU_0 * M**2 * (0.5 * diameter) ** 2


NECK_MARGIN = 10.0  # least stiffness of a contact over the negative one of its neck
NECK_PEAK = 4.0  # of the pair's force at the smallest gap: 2 to 2.7 in a chain, more on the chains of a sheared packing


def neck_load(law, M: float, diameter: float, smallest_gap: float) -> float:
    """Expected peak force [N] of a near contact between grains that a field magnetises to M [A/m] one by one.

    `law` is the grains' (saturating), `smallest_gap` between surfaces in radii.
    """
    return NECK_PEAK * neck_pull(law, M, diameter, smallest_gap)[0]


def neck_pull(law, M: float, diameter: float, smallest_gap: float) -> tuple[float, float]:
    """Attraction [N] of two near grains alone at the smallest gap, and the work [J] that parts them from there.

    As `neck_load`: both along the field, `pair_table`'s force over the gap; beyond its largest gap that of dipoles,
    F r/3 at the distance r.
    """
    Ms, a = saturation(law), 0.5 * diameter
    fields = np.geomspace(1e-4, 10.0, 2001) * Ms  # the field in which a lone grain has M
    h = float(np.interp(M, sphere_magnetisation(law, fields), fields)) / Ms
    table = pair_table(law)
    gap = np.geomspace(smallest_gap, table.gap[-1], 200) if smallest_gap < table.gap[-1] else np.array([smallest_gap])
    force = np.array([float(table.force_of(g, h)) for g in gap])
    work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(gap))) + force[-1] * (2.0 + gap[-1]) / 3.0
    unit = MU_0 * Ms**2 * a**2
    return float(force[0]) * unit, work * unit * a


def neck_stiffness(law, diameter: float, *, at_walls: bool = False) -> float:
    """Largest -dF/dr [N/m] of a saturated neck, (pi/2) mu_0 Ms^2 a: flux density mu_0 Ms over a growing area.

    At a steel wall the gap to the image opens twice as fast: twice that. The tables have up to 4 % more.
    """
    return (1.0 if at_walls else 0.5) * pi * MU_0 * saturation(law) ** 2 * 0.5 * diameter


def chain_magnetisation(law, M: float) -> float:
    """Magnetisation [A/m] in a straight chain of touching mutual dipoles, of grains that have M one by one.

    M_c = M_sph(H + zeta(3) M_c/6), H the field in which a lone grain has M.
    """
    try:
        scale = saturation(law)
    except ValueError:
        scale = max(M, 1.0)
    fields = np.geomspace(1e-5, 1e3, 4001) * scale
    lone = sphere_magnetisation(law, fields)
    H = M_chain = float(np.interp(M, lone, fields))
    for _ in range(60):  # contracts by 3 zeta(3)/6 = 0.6 a turn at most
        M_chain = float(np.interp(H + 1.2020569 / 6.0 * M_chain, fields, lone))
    return M_chain


def pair_work(M: float, diameter: float) -> float:
    """Work [J] that parts two touching grains magnetised to M [A/m], F_pair d/3 of coaxial dipoles."""
    return pair_attraction(M, diameter) * diameter / 3.0


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
