"""Restitution of rigid contacts: e at any step, and no energy from impacts of several contacts at once.

Newton's law in Moreau's form, u_n' + e u_n >= 0 for all contacts that touch, r_n >= 0, r_n (u_n' + e u_n) = 0: with
r.(u' - u) = r.W r >= 0 the energy changes by r.(u + u')/2 <= 0 without friction, for any e <= 1.
"""

import numpy as np
import pytest

from geometry.walls import Plane
from particles import DVI, Body, DviContact, Grains

R, STEEL = 1e-3, 7800.0
FLOOR = Plane("floor", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0]))
WALL = Plane("wall", "housing", np.zeros(3), np.array([1.0, 0.0, 0.0]))
RAMP = Plane("ramp", "housing", np.zeros(3), np.array([-0.6, 0.0, 0.8]))
NONE = (0.0, 0.0, 0.0)


def _energy(grains):
    """Kinetic energy of each grain, in the order of their numbers [J]."""
    square = (grains.velocity**2).sum(1) + 0.4 * grains.radius**2 * (grains.angular_velocity**2).sum(1)
    return (0.5 * grains.mass * square)[np.argsort(grains.particle_id)]


@pytest.mark.parametrize("springs", [False, True])
@pytest.mark.parametrize("h", [1e-4, 1e-5, 1e-6, 1e-7])
def test_a_ball_rebounds_at_e_whatever_the_step(h, springs):
    """Down to steps in which it moves a hundredth of the slop, 1e-6 R. On springs e is met in the mean."""
    e, radius = 0.9, 2.5e-3
    stiffness = [[1e5, 3e4]] * 2 if springs else None
    for speed in (1.0, 0.03) if h > 1e-7 else (0.1,):
        grains = Grains.create([[0.0, 0.0, radius + 5.5 * h * speed]], radius, STEEL, velocity=[[0.0, 0.0, -speed]])
        dvi = DVI(grains, [FLOOR], [Body("housing")], DviContact(0.0, e, threshold=1e-3), dt=h, stiffness=stiffness)
        dvi.run(40 if not springs else 40 + int(1.5e-3 / h))
        assert grains.velocity[0, 2] == pytest.approx(e * speed, rel=0.01 if springs else 1e-9)


@pytest.mark.parametrize("e", [1.0, 0.9, 0.5])
def test_wall_and_ramp_are_hit_one_after_the_other(e):
    """A ball that touches both flies at the wall and from the ramp: first it hits the wall, then the ramp at 0.6 e.

    In between it may come nearer to the ramp by h times that, which is removed.
    """
    h = 1e-5
    grains = Grains.create([[R * (1 + 1e-7), 0, 2 * R * (1 + 1e-7)]], R, STEEL, velocity=[[-1.0, 0, 0]])
    dvi = DVI(grains, [WALL, RAMP], [Body("housing")], DviContact(0.0, e), dt=h, gravity=NONE, tolerance=1e-10)
    dvi.run(1)
    assert grains.velocity[0] == pytest.approx([e, 0.0, 0.0], abs=1e-9)
    gap = -0.6 * grains.position[0, 0] + 0.8 * grains.position[0, 2] - R
    assert -0.6 * e * h <= gap < 0.0
    totals = dvi.run(1)
    hit = 0.6 * e * (1.0 + e)
    assert grains.velocity[0] == pytest.approx([e - 0.6 * hit, 0.0, 0.8 * hit], abs=1e-9)
    assert totals.max_overlap * 2.0 * R <= 0.6 * e * h
    dvi.run(50)
    assert -0.6 * grains.position[0, 0] + 0.8 * grains.position[0, 2] > R
    assert np.sum(grains.velocity**2) == pytest.approx(e**2 * (1.0 - 0.36 * (1.0 - e**2)), rel=1e-8)


def test_a_ball_is_struck_while_it_is_leaving_another():
    """e = 1, three balls in a row: c strikes a, which is leaving b and touches it still.

    u_ca' = -u_ca = 1.1 and u_ab' = -u_ab = -0.1 with 3 v = const.: the energy is the same, by hand.
    """
    where = [[2.0 * R * k, 0.0, 0.0] for k in range(3)]
    velocity = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    grains = Grains.create(where, R, STEEL, velocity=velocity)
    before = grains.kinetic_energy()
    dvi = DVI(grains, [], [], DviContact(0.3, 1.0), dt=1e-3, gravity=NONE, tolerance=1e-13)
    totals = dvi.run(1)
    assert np.sort(grains.velocity[:, 0]) == pytest.approx([-0.7, -0.6, 0.4], abs=1e-11)
    assert grains.kinetic_energy() == pytest.approx(before, rel=1e-10)
    assert totals.energy_budget.dissipation["impact"] == pytest.approx(0.0, abs=1e-10 * before)


@pytest.mark.hard
@pytest.mark.parametrize(("between", "at_walls"), [(1.0, 1.0), (0.9, 0.9), (0.2, 1.0), (1.0, 0.2), (0.5, 0.0)])
def test_impacts_without_friction_make_no_energy(between, at_walls):
    """Lattices that touch, on a floor and at a wall, with random velocities and gaps up to three slops; e differs."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        n = 4
        where = 2.0 * R * np.stack(np.meshgrid(*[np.arange(n)] * 3), axis=-1).reshape(-1, 3) + R
        where *= 1.0 + rng.uniform(0.0, 3e-4 / n)
        radius = R * rng.uniform(0.9998, 1.0, len(where))
        grains = Grains.create(where, radius, STEEL, velocity=rng.normal(size=where.shape))
        contact = DviContact(0.0, between, wall_restitution=at_walls)
        dvi = DVI(
            grains, [FLOOR, WALL], [Body("housing")], contact, dt=1e-5, gravity=NONE, tolerance=1e-11, max_sweeps=20000
        )
        energy = begun = grains.kinetic_energy()
        for _ in range(20):
            dvi.run(1)
            before, energy = energy, grains.kinetic_energy()
            assert energy <= before + 1e-9 * begun


@pytest.mark.parametrize(("e", "most"), [(1.0, 0.2), (0.95, 0.08), (0.9, 0.0), (0.5, 0.0)])
def test_what_friction_makes_in_a_corner_is_bounded(e, most):
    """Newton's law with Coulomb friction makes energy where e is near 1: spins of a grain turn into an approach.

    (Kane & Levinson, Dynamics, 1985.) 2 000 random impacts in a corner of 120 degrees, the worst of those tried.
    """
    n, angle = 2000, np.radians(120.0)
    second = Plane("second", "housing", np.zeros(3), np.array([np.cos(angle), 0.0, np.sin(angle)]))
    gains = []
    for friction in (0.1, 0.3, 0.5, 1.0):
        rng = np.random.default_rng(1)
        height = R * (1.0 - np.cos(angle)) / np.sin(angle)
        where = np.c_[np.full(n, R), 40.0 * R * np.arange(n), np.full(n, height)]
        spin = rng.normal(size=(n, 3)) / R * rng.choice([0.3, 1.0, 3.0], (n, 1))
        grains = Grains.create(where, R, STEEL, velocity=rng.normal(size=(n, 3)), angular_velocity=spin)
        dvi = DVI(
            grains, [WALL, second], [Body("housing")], DviContact(friction, e), dt=1e-5, gravity=NONE, tolerance=1e-9,
            max_sweeps=4000,
        )  # fmt: skip
        before = _energy(grains)
        dvi.run(1)
        gains.append(np.max(_energy(grains) / before - 1.0))
    assert max(gains) <= most + 1e-6
    assert most == 0.0 or max(gains) > 0.02  # there is one
