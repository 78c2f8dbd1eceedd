"""Rolling resistance: a loaded ball rests below the limit and rolls off above it, whatever the time step."""

import numpy as np
import pytest
from dem_laws import FLOOR

from particles import DEM, Body, Grains, LinearContact, RollingFriction, choose_time_step

pytestmark = pytest.mark.physics

R, RHO = 1e-3, 2500.0
MASS = RHO * 4 / 3 * np.pi * R**3


def ball(rolling, steps_per_contact=20, push=0.0, velocity=0.0, duration=0.02):
    """A ball of 1 mm on a plane under 4 mN (weight left out), pushed along x; returns the DEM."""
    k = 1e4
    contact = LinearContact.from_restitution(k, 0.5, 0.5)
    grains = Grains.create([[0.0, 0.0, R - 4e-3 / k]], R, RHO, velocity=[[velocity, 0.0, 0.0]],
                           angular_velocity=[[0.0, velocity / R, 0.0]])  # fmt: skip
    dt = choose_time_step(contact, MASS, R, steps_per_contact=steps_per_contact).dt
    dem = DEM(grains, [FLOOR], [Body("housing")], contact, dt=dt, rolling=rolling)
    dem.external_force = np.array([[push, 0.0, -4e-3]])
    dem.run(round(duration / dt))
    return dem


@pytest.mark.parametrize("steps", [10, 20, 80])
def test_a_loaded_ball_rests_at_every_step(steps):
    """Push 0.1 F_n against mu_r = 0.2: the ball winds up its spring and stays; it does not creep."""
    early, late = (ball(RollingFriction(0.2), steps, push=4e-4, duration=t) for t in (0.02, 0.06))
    wound = 4e-4 * R / (2 / 7 * 1e4 * R * R)  # T/k_r, k_r = k_t R^2
    assert late.grains.position[0, 0] == pytest.approx(wound * R + 4e-4 / (2 / 7 * 1e4), rel=0.05)
    assert abs(late.grains.position[0, 0] - early.grains.position[0, 0]) < 1e-3 * wound * R


@pytest.mark.parametrize("steps", [10, 40])
def test_beyond_the_limit_it_rolls_with_the_excess(steps):
    """Push 0.3 F_n against mu_r = 0.1: acceleration (5/7) (P - mu_r F_n)/m.

    From m a = P - f and I a/R = f R - mu_r R F_n.
    """
    slow, fast = (ball(RollingFriction(0.1), steps, push=1.2e-3, duration=t) for t in (0.01, 0.02))
    a = (fast.grains.velocity[0, 0] - slow.grains.velocity[0, 0]) / (fast.time - slow.time)
    assert a == pytest.approx(5 / 7 * (1.2e-3 - 0.1 * 4e-3) / MASS, rel=0.01)


def test_a_rolling_ball_is_stopped_and_loses_its_energy_to_rolling():
    free = ball(None, velocity=0.02, duration=0.05)
    assert free.grains.velocity[0, 0] == pytest.approx(0.02, rel=1e-3)
    stopped = ball(RollingFriction(0.05), velocity=0.02, duration=0.2)
    assert abs(stopped.grains.velocity[0, 0]) < 1e-5
    # distance of a constant torque: (7/10) m v^2 = mu_r F_n s
    assert stopped.grains.position[0, 0] == pytest.approx(0.7 * MASS * 0.02**2 / (0.05 * 4e-3), rel=0.05)


def test_two_rolling_grains_conserve_angular_momentum():
    grains = Grains.create([[0.0, 0.0, 0.0], [1.999e-3, 0.0, 0.0]], R, RHO,
                           velocity=[[0.0, 0.1, 0.0], [0.0, -0.05, 0.02]],
                           angular_velocity=[[50.0, -20.0, 300.0], [0.0, 70.0, -100.0]])  # fmt: skip
    contact = LinearContact.from_restitution(1e4, 0.8, 0.5)
    dt = choose_time_step(contact, MASS, R).dt
    dem = DEM(grains, [], [], contact, dt=dt, rolling=RollingFriction(0.3))
    before = dem.grains.angular_momentum_z()
    totals = dem.run(200)
    assert dem.grains.angular_momentum_z() == pytest.approx(before, rel=1e-12)
    assert totals.energy_budget.dissipation["rolling"] > 0.0
