"""Shafts, the choice of the time step, creation of grains, walls that belong to bodies."""

import math

import numpy as np
import pytest

from geometry.time_profile import TimeProfile
from geometry.walls import Plane
from particles import (
    Body,
    FreeShaft,
    Grains,
    LinearContact,
    choose_time_step,
    stiffness_for_overlap,
)
from particles.walls.wall_table import wall_table

LAW = LinearContact.from_restitution(100.0, 0.5, 0.3)


def test_bad_shaft_is_refused():
    with pytest.raises(ValueError, match="inertia of a free shaft"):
        FreeShaft(0.0)
    with pytest.raises(ValueError, match="load torque"):
        FreeShaft(1.0, load_torque=TimeProfile.constant(-1.0))


def test_step_follows_from_the_contact_time():
    mass = 4.11e-6
    step = choose_time_step(LAW, mass, 0.5e-3)
    assert step.dt == pytest.approx(math.pi * math.sqrt(0.5 * mass / 100.0) / 20.0)
    assert "20 steps per contact" in step.reason


def test_fast_grains_shorten_the_step():
    step = choose_time_step(LAW, 4.11e-6, 0.5e-3, speed=100.0)
    assert step.dt == pytest.approx(0.1 * 0.5e-3 / 100.0) and "moves 0.1 of its radius" in step.reason


def test_a_step_too_long_is_refused():
    with pytest.raises(ValueError, match=r"at most .*5 steps per contact"):
        choose_time_step(LAW, 4.11e-6, 0.5e-3, dt=1e-3)


def test_stiffness_from_overlap():
    assert stiffness_for_overlap(0.01, 1e-4) == pytest.approx(0.01 / (0.005 * 1e-4))
    # pressed and hit: the depths of both add up to what is allowed
    k = stiffness_for_overlap(0.01, 1e-4, mass=4e-9, speed=0.5)
    assert 0.01 / k + 0.5 * (4e-9 / k) ** 0.5 == pytest.approx(0.005 * 1e-4)
    with pytest.raises(ValueError, match=r"overlap = 0\.2"):
        stiffness_for_overlap(0.01, 1e-4, 0.2)


@pytest.mark.parametrize("radius, density", [(0.0, 1.0), (1.0, -1.0), (float("nan"), 1.0)])
def test_bad_grains_are_refused(radius, density):
    with pytest.raises(ValueError, match="must be positive"):
        Grains.create(np.zeros((1, 3)), radius, density)


def test_mass_inertia_and_angular_momentum():
    grains = Grains.create([[2.0, 0.0, 0.0]], 0.5, 10.0, velocity=[[0.0, 3.0, 0.0]], angular_velocity=[[0, 0, 4.0]])
    mass = 10.0 * math.pi / 6.0
    assert grains.mass[0] == pytest.approx(mass)
    assert grains.angular_momentum_z() == pytest.approx(mass * 6.0 + 0.1 * mass * 4.0)
    assert grains.kinetic_energy() == pytest.approx(0.5 * mass * 9.0 + 0.05 * mass * 16.0)


def test_wall_of_an_unknown_body_is_refused():
    floor = Plane("floor", "hosing", np.zeros(3), np.array([0.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match=r"'hosing', which does not exist; bodies are: housing"):
        wall_table([floor], [Body("housing")])


def test_plane_that_would_swing_is_refused():
    side = Plane("side", "rotor", np.zeros(3), np.array([1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="would swing round"):
        wall_table([side], [Body("rotor", TimeProfile.constant(1.0))])
