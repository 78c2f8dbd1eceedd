"""Asking for diagnostics changes nothing, and what they say is what the step did."""

import copy
import math

import numpy as np
import pytest

from emclutch.simulation.summary import structure_of
from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.time_profile import TimeProfile
from particles import DEM, Body, CyclicSector, Grains, LinearContact, choose_time_step, pack
from particles.diagnostics.bins import RingBins, ring_bins
from particles.diagnostics.coordination import contacts_per_grain
from particles.diagnostics.enclosed_space import default_bins, enclosed_space
from particles.diagnostics.profiles import profile_of, profile_sums

pytestmark = pytest.mark.physics

CELL = ShearCell(0.006, 0.0085, 0.003)
SECTOR = CyclicSector(2.0 * math.pi / 6)
RADIUS = 0.25e-3
LAW = LinearContact.from_restitution(500.0, 0.7, 0.5)


def ring(speed=60.0):
    box = CELL.fill_boxes()["annulus"]
    count = int(0.5 * box.volume(SECTOR.angle) / (4 / 3 * math.pi * RADIUS**3))
    x = pack([box], CELL.walls(), count, RADIUS, seed=1, sector=SECTOR)
    spin = np.random.default_rng(0).normal(size=x.shape)
    grains = Grains.create(x, RADIUS, 7850.0, velocity=0.1 * spin, angular_velocity=100.0 * spin)
    bodies = [Body("disc"), Body("rotor", TimeProfile.constant(speed)), Body("housing")]
    dt = choose_time_step(LAW, grains.mass, grains.radius).dt
    return DEM(grains, CELL.walls(), bodies, LAW, dt=dt, periodicity=SECTOR)


def box():
    side = 3.5e-3
    cell = Box((side, side, side))
    x = pack(cell, cell.walls(), 300, RADIUS, seed=2)
    grains = Grains.create(x, RADIUS, 7850.0)
    dt = choose_time_step(LAW, grains.mass, grains.radius).dt
    return DEM(grains, cell.walls(), [Body("housing")], LAW, dt=dt, gravity=[0.0, 0.0, -9.81])


def profile_across(dem):
    """The profile over what the walls enclose, in bins of a diameter."""
    angle = 2.0 * math.pi if dem.sector is None else dem.sector.angle
    bins = default_bins(enclosed_space(dem.grains, dem.walls), 2.0 * RADIUS, angle)
    return profile_of(profile_sums(dem.grains, dem.contacts(), bins, dem.sector), bins)


@pytest.mark.parametrize("make", [ring, box])
def test_diagnostics_leave_the_trajectory_bitwise_unchanged(make):
    """Positions, velocities, history, lists, bodies and sums of two runs, one diagnosed at every window."""
    asked, left_alone = make(), make()
    for _ in range(6):
        totals, other = asked.run(40), left_alone.run(40)
        before = asked.state()
        profile, structure = profile_across(asked), structure_of(asked)
        after = asked.state()
        assert before.keys() == after.keys()
        for name, value in before.items():
            assert np.array_equal(value, after[name]), name
        assert (
            totals.energy_budget.kinetic_energy == other.energy_budget.kinetic_energy and totals.torque == other.torque
        )
    one, two = asked.state(), left_alone.state()
    assert one.keys() == two.keys()
    for name, value in one.items():
        assert value.dtype == two[name].dtype and np.array_equal(value, two[name]), name
    assert profile.contacts.sum() > 50.0 and structure["coordination"] > 0.0


def test_torque_next_to_a_wall_is_the_one_that_the_step_booked():
    """The present contacts against the sums of the step that feels them."""
    dem = ring()
    dem.run(300)
    contacts, grains = dem.contacts(), copy.deepcopy(dem.grains)
    totals = dem.run(1)
    edges = np.array([CELL.inner_radius, CELL.inner_radius + 1e-9, CELL.outer_radius - 1e-9, CELL.outer_radius])
    bins = RingBins("r", edges, -CELL.height, 2.0 * CELL.height, SECTOR.angle)
    torque = profile_of(profile_sums(grains, contacts, bins, dem.sector), bins).torque
    assert abs(totals.torque_on("rotor")) > 0.0
    # means over shells of 1 nm, in which the torque of a contact grows along its branch of 0.1 mm and more
    assert torque[2] == pytest.approx(-totals.torque_on("rotor"), rel=1e-6)
    assert torque[0] == pytest.approx(totals.torque_on("disc"), rel=1e-6)
    z = contacts_per_grain(contacts, grains.count)
    assert z.sum() == np.sum(contacts.j >= 0) * 2 + np.sum(contacts.j < 0)


def test_profile_of_a_sheared_ring_is_what_drove_it():
    """Grains at the rotor move with it, those at the disc hardly; solid fractions hold all grains; a fresh DEM too."""
    dem = ring()
    space = CELL.fill_boxes()["annulus"]
    bins = ring_bins(space, 2.0 * RADIUS, angle=SECTOR.angle)
    assert enclosed_space(dem.grains, dem.walls, ring=True) == space
    assert np.all(np.isfinite(profile_across(dem).solid_fraction))  # before the first step
    sums = None
    dem.run(1500)
    for _ in range(10):
        dem.run(100)
        one = profile_sums(dem.grains, dem.contacts(), bins, dem.sector)
        sums = one if sums is None else sums + one
    profile = profile_of(sums, bins, {body.name: body.speed for body in dem.bodies})
    assert profile.moments == 10
    assert np.all(np.diff(profile.angular_speed) > 0.0) and profile.angular_speed[-1] < 60.0
    assert np.all(profile.shear_rate > 0.0) and np.all(profile.shear_stress > 0.0)
    assert np.all(profile.slip["disc"] > 0.0) and np.all(profile.slip["rotor"] < 0.0)
    filled = np.sum(profile.solid_fraction * profile.volume)
    assert filled == pytest.approx(dem.grains.volume.sum(), rel=1e-3)  # overlaps with the walls are outside
    assert 0.02 < np.median(profile.mu) < 2.0
    assert np.all(profile.inertial_number > 0.0)
