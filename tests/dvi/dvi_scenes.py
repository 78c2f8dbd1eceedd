"""What tests of rigid grains have in common: sizes, weight, floors, drums and rings, a lattice of places.

Every combination of friction law, solver, springs, torques and chunks of threads is compiled once (some ten seconds): a
test takes the engine as it is by default unless it is about another one.
"""

import numpy as np

from geometry.walls import AnnularBox, Plane, annulus, cylinder
from particles import Grains, pack
from particles.dvi import gauss_seidel as gs

G = 9.81
R = 5e-3
CORE, DRUM = 0.012, 0.042
STEEL = 7850.0
DOWN = (0.0, 0.0, -G)
NONE = (0.0, 0.0, 0.0)


def floor(slope=0.0):
    """A plane through the origin that falls towards -x by ``slope`` [rad]; body "housing"."""
    return Plane("floor", "housing", np.zeros(3), np.array([-np.sin(slope), 0.0, np.cos(slope)]))


def lattice(n):
    """The first n places of a cubic lattice of cells 1 wide, the cube at 0: (n, 3), and cells along an edge."""
    count = int(np.ceil(n ** (1.0 / 3.0)))
    return np.stack(np.meshgrid(*[np.arange(count) + 0.5] * 3), axis=-1).reshape(-1, 3)[:n], count


def in_drum(n, low="drum"):
    """n places on a lattice above the floor of a drum about z, and its walls; the floor is of the body ``low``."""
    sites, count = lattice(n)
    side = 0.0102 * count
    radius = 0.71 * side
    walls = [cylinder("shell", "drum", radius, -0.01, 2.0 * side), annulus("low", low, -0.0005, 0.0, radius)]
    return 0.0102 * (sites - [0.5 * count, 0.5 * count, 0.0]), walls


def in_ring(n, seed, high, *, sizes=(1.0, 1.0), low="drum"):
    """Grains packed between a core, of the body "rotor", and a drum with a lid, and these walls.

    sizes : their radii, evenly between these two times R; low : the body of the floor.
    """
    walls = [
        cylinder("core", "rotor", CORE, 0.0, high), cylinder("shell", "drum", DRUM, 0.0, high),
        annulus("low", low, 0.0, CORE, DRUM), annulus("high", "drum", high, CORE, DRUM),
    ]  # fmt: skip
    radius = R * np.random.default_rng(seed).uniform(*sizes, n)
    return Grains.create(pack(AnnularBox(CORE, DRUM, 0.0, high), walls, n, R, seed=seed), radius, STEEL), walls


def scaled(records, factor):
    """The same contact problem started from impulses times ``factor``, velocities along with them."""
    records = [a.copy() for a in records]
    gs.apply_records(-1.0, *records)
    for rows in (records[3], records[5]):
        rows[:, gs.RX : gs.RZ + 1] *= factor
    gs.apply_records(1.0, *records)
    return records


def swept(tolerance, cap, records, *, convex=None, compliance=None):
    """Plain sweeps over ``records`` until their residual is ``tolerance`` [m/s], ``cap`` at most: sweeps, residual.

    One call a sweep: the loop of the engine would be compiled once more for tests alone. The residual is looked at
    every tenth sweep.
    """
    count, reached = 0, np.inf
    while reached > tolerance and count < cap:
        for _ in range(min(10, cap - count)):
            gs.sweep_records(convex, 1.0, compliance, *records)
            count += 1
        reached = gs.residual_records(convex, compliance, *records)
    return count, reached
