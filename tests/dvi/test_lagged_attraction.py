"""Grains that attract each other part and fall as by energy, within what a step adds to their speed.

*Effective cohesion* (A. Abramian, L. Staron, P.-Y. Lagree, J. Rheol. 64 (2020) 1227) and free flight under a magnetic
pull: two grains of iron along the field with the necks of `coupling.mutual_moments`, at the step of
`particles.dvi.dvi_step` and its multiples; works and speeds are those of the table of two spheres by finite elements.
"""

import numpy as np
import pytest

from coupling import MutualMoments, grain_table, neck_pull
from coupling.neighbour_rows import neighbour_rows
from field import GrainLaw
from field.spheres.lone_sphere import sphere_magnetisation
from particles import DVI, DviContact, Grains, choose_dvi_step

pytestmark = pytest.mark.physics

IRON = GrainLaw(999.0, 1.3e6)
A = 125e-6
MASS = 7700.0 * 4.0 / 3.0 * np.pi * A**3
REACH, SMALLEST_GAP = 20.0 * A, 3e-3
STRENGTH = 3.3e5
M = float(sphere_magnetisation(IRON, np.array([STRENGTH]))[0])
STIFF = np.array([[1.4e5, 4e4], [1.4e5, 4e4]])
TABLE = grain_table(IRON, "near_field")
LONG = [1.0, 2.0, 4.0]


def _work(gap):
    """Of parting two grains from a gap [radii] for good [J]."""
    return neck_pull(IRON, M, 2.0 * A, gap)[1]


PULL, WORK = neck_pull(IRON, M, 2.0 * A, SMALLEST_GAP)
STEP = choose_dvi_step(MASS, A, attraction=PULL, work=WORK).dt
FREE = 2.0 * np.sqrt(WORK / MASS)  # relative speed that parts two grains for good [m/s]


class Two:
    """Two grains on the axis of the field at a gap [radii], parting with a speed [m/s]."""

    def __init__(self, gap, speed, dt, *, mean):
        x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, (2.0 + gap) * A]])
        grains = Grains.create(x, A, 7700.0, velocity=np.outer([-0.5, 0.5], [0.0, 0.0, speed]))
        self.dvi = DVI(grains, [], [], DviContact(0.3, 0.5), dt=dt, stiffness=STIFF, tolerance=1e-8)
        self.solver = MutualMoments(TABLE, near=True, reach=REACH, smallest_gap=SMALLEST_GAP)
        self.ahead = dt if mean else 0.0

    def step(self):
        """With the pull that `Dipoles` holds, its mean over the way ahead, or that of the place; gap and speed."""
        x, v = (np.ascontiguousarray(a) for a in (self.dvi.grains.position, self.dvi.grains.velocity))
        rows, radius, H = neighbour_rows(x, REACH), np.full(2, A), np.tile([0.0, 0.0, STRENGTH], (2, 1))
        found = self.solver.solve(x, radius, H, rows, tolerance=1e-6, max_sweeps=500)
        lagged = self.solver.forces(x, radius, rows, found, velocity=v, ahead=self.ahead)
        self.dvi.external_force = lagged.force
        self.dvi.run(1)
        return self.state()

    def state(self):
        first, second = np.argsort(self.dvi.grains.position[:, 2])
        x, v = self.dvi.grains.position[:, 2], self.dvi.grains.velocity[:, 2]
        return (x[second] - x[first]) / A - 2.0, v[second] - v[first]


def _work_of_parting(times, *, mean):
    """What two grains that are struck apart with 1.5 times FREE lose until they are free [J]."""
    speed = 1.5 * FREE
    two = Two(0.0, speed, times * STEP, mean=mean)
    gap, left = 0.0, speed
    while 0.0 < left and gap < 4.0:
        gap, left = two.step()
    assert left > 0.0
    return 0.25 * MASS * (speed**2 - left**2) + _work(gap)


def test_a_step_of_the_rule_adds_a_tenth_of_the_speed_of_parting():
    assert pytest.approx(0.1 * FREE) == 2.0 * STEP * PULL / MASS


@pytest.mark.parametrize("times", LONG)
def test_what_a_blow_loses_to_the_pull_goes_with_the_step(times):
    """A blow is held back by what the pull does in a step before it falls: lagged, at its place, by h F v/2 too much.

    The mean over the way ahead, which runs hold, takes nearly half of that away.
    """
    lagged, mean = (_work_of_parting(times, mean=mean) - WORK for mean in (False, True))
    law = 0.5 * times * STEP * PULL * 1.5 * FREE
    assert lagged == pytest.approx(law, rel=0.15)
    assert 0.0 < mean < 0.65 * law


@pytest.mark.parametrize("times", LONG)
def test_grains_fall_with_the_energy_of_the_pull(times):
    """From rest at half a radius: kinetic energy against the work done.

    It is to 1 % of the work of parting for each tenth of FREE that a step adds.
    """
    two, before = Two(0.5, 0.0, times * STEP, mean=True), 0.0
    error = []
    while True:
        gap, _ = two.state()
        after, speed = two.step()
        if after < 0.02 or speed > 0.0:
            break
        energy = 0.25 * MASS * (0.5 * (before + speed)) ** 2  # speeds are those of the middles of steps
        error.append((energy - (_work(gap) - _work(0.5))) / WORK)
        before = speed
    assert len(error) >= 2 and np.abs(error).max() < 0.01 * times


@pytest.mark.parametrize("times", LONG)
@pytest.mark.parametrize(("share", "rebounds"), [(0.5, False), (8.0, True)])
def test_a_fall_that_is_over_within_a_step_does_not_rebound(times, share, rebounds):
    """Under a pull that does not fall with the gap: from h^2 F/m or so on falls rebound, at whatever step."""
    dt = times * STEP
    gap = share * dt**2 * PULL / MASS / A
    two = Two(gap, 0.0, dt, mean=True)
    two.dvi.external_force = np.outer([1.0, -1.0], [0.0, 0.0, PULL])
    speeds = []
    for _ in range(12):
        two.dvi.run(1)
        speeds.append(two.state()[1])
    assert (max(speeds) > 0.2 * np.sqrt(4.0 * gap * A * PULL / MASS)) == rebounds
    assert two.state()[0] < gap
