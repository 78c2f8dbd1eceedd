"""A chain of rigid grains that is pressed closes no faster than the solver's tolerance, and by fewer sweeps the faster.

T. Unger, L. Brendel, D. E. Wolf, J. Kertesz, Phys. Rev. E 65 (2002) 061305: the sweeps of contact dynamics spread a
force like diffusion, so that too few of them leave a chain apparently elastic. Sixteen grains between a plane and a
force, from rest and without impulses of an earlier step.
"""

from math import comb

import numpy as np
import pytest
from dvi_scenes import STEEL, R, floor

from emclutch.simulation.dvi_plan import TOLERANCE
from particles import DVI, Body, DviContact, Grains

pytestmark = pytest.mark.physics

CHAIN = 16
MASS = STEEL * 4.0 / 3.0 * np.pi * R**3
FORCE, DT = 1.0, 1e-4
GIVEN = DT * FORCE / MASS
"""Speed that the force gives to a lone grain in a step [m/s]."""
SPRINGS = np.full((2, 2), 1e5)


def _speeds(max_sweeps, *, tolerance=1e-14, solver="gauss_seidel", springs=None):
    """Speeds towards the plane (16,), the lowest first [m/s], after a step; whether it missed its tolerance."""
    x = np.zeros((CHAIN, 3))
    x[:, 2] = R * (1.0 + 2.0 * np.arange(CHAIN))
    dvi = DVI(
        Grains.create(x, R, STEEL), [floor()], [Body("housing")], DviContact(0.3), dt=DT, solver=solver,
        tolerance=tolerance, max_sweeps=max_sweeps, stiffness=springs,
    )  # fmt: skip
    dvi.external_force = np.outer(np.arange(CHAIN) == CHAIN - 1, [0.0, 0.0, -FORCE])[dvi.grains.particle_id]
    missed = dvi.run(1).missed_steps
    order = np.argsort(dvi.grains.position[:, 2])
    return -dvi.grains.velocity[order, 2], missed


@pytest.mark.parametrize("sweeps", [1, 2, 4, 8, 15])
def test_sweeps_spread_a_force_like_diffusion(sweeps):
    """Until the plane is felt, the pushed end moves with the chance that a walk of 2 n steps is back, 1/sqrt(pi n).

    A sweep takes two passes, each over every other contact.
    """
    speed, missed = _speeds(sweeps)
    assert speed[-1] == pytest.approx(GIVEN * comb(2 * sweeps, sweeps) / 4.0**sweeps, rel=1e-12)
    assert missed == 1 and speed[: max(CHAIN - 1 - 2 * sweeps, 0)] == pytest.approx(0.0, abs=1e-15 * GIVEN)


def test_a_chain_needs_sweeps_by_the_square_of_its_length():
    """The slowest mode of a chain with one fixed end falls by cos^2(pi/(2 N)) a sweep: (2/pi)^2 N^2 of them for 1/e."""
    few, many = (_speeds(sweeps)[0][-1] for sweeps in (300, 600))
    assert many / few == pytest.approx(np.cos(0.5 * np.pi / CHAIN) ** 600, rel=1e-3)
    assert few < 0.02 * GIVEN


@pytest.mark.parametrize("springs", [None, SPRINGS], ids=["rigid", "springs"])
@pytest.mark.parametrize("solver", ["gauss_seidel", "accelerated"])
def test_no_contact_closes_by_more_than_the_tolerance(solver, springs):
    """However many sweeps that takes; with the tolerance that runs choose the ends close by less than 1 %.

    On springs that is beside what these give way by.
    """
    tolerance = TOLERANCE * GIVEN
    speed, missed = _speeds(5000, tolerance=tolerance, solver=solver, springs=springs)
    at_rest = 0.0 if springs is None else _speeds(5000, tolerance=1e-9 * GIVEN, solver=solver, springs=springs)[0]
    apparent = speed - at_rest
    assert missed == 0
    assert np.diff(apparent, prepend=0.0).max() <= 1.01 * tolerance
    assert abs(apparent[-1]) <= CHAIN * tolerance < 0.01 * GIVEN
