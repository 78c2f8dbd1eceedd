"""What tests of rigid grains have in common: sizes, weight, a sloping floor, a lattice of places.

Every combination of friction law, solver, springs, torques and chunks of threads is compiled once (some ten seconds): a
test takes the engine as it is by default unless it is about another one.
"""

import numpy as np

from geometry.walls import Plane
from particles.dvi import gauss_seidel as gs

G = 9.81
R = 5e-3
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
