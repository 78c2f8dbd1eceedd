"""A gas of rubbing grains conserves momentum and angular momentum; all work is booked."""

import numpy as np
import pytest

from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.time_profile import TimeProfile
from particles import DEM, Body, FreeShaft, Grains, LinearContact, choose_time_step, pack

pytestmark = pytest.mark.physics

LAW = LinearContact.from_restitution(500.0, 0.7, 0.5)


def _cloud(count=400):
    """Grains that fall towards their common centre, with spins, and no wall."""
    r, rng = 0.5e-3, np.random.default_rng(3)
    side = (count * 4 / 3 * np.pi * r**3 / 0.3) ** (1 / 3)
    x = pack(Box((side, side, side)), Box((side, side, side)).walls(), count, r, seed=2)
    v = -40.0 * (x - x.mean(axis=0)) + 0.2 * rng.normal(size=x.shape) + [0.5, 0.1, 0.0]
    return Grains.create(x, r, 7850.0, velocity=v, angular_velocity=rng.normal(size=x.shape) * 300.0)


def test_kinetic_energy_is_booked_exactly_and_losses_by_mechanism_to_first_order():
    grains = _cloud()
    dt = choose_time_step(LAW, grains.mass, grains.radius, steps_per_contact=80).dt
    dem = DEM(grains, [], [], LAW, dt=dt)
    totals = dem.run(4000)
    lost = sum(totals.energy_budget.dissipation.values())
    assert totals.energy_budget.kinetic_change == pytest.approx(totals.energy_budget.contact_work, rel=1e-10)
    assert lost == pytest.approx(totals.energy_budget.dissipated, rel=0.03)
    assert min(totals.energy_budget.dissipation.values()) > 0.0


def test_losses_by_mechanism_converge_with_the_step():
    gap = []
    for steps in (25.0, 100.0):
        grains = _cloud(200)
        dt = choose_time_step(LAW, grains.mass, grains.radius, steps_per_contact=steps).dt
        totals = DEM(grains, [], [], LAW, dt=dt).run(int(20e-3 / dt))
        gap.append(abs(sum(totals.energy_budget.dissipation.values()) / totals.energy_budget.dissipated - 1.0))
    assert gap[1] < 0.5 * gap[0]


def _shear_cell(motion, **extra):
    cell, r = ShearCell(0.01, 0.0125, 0.004), 0.25e-3
    box = cell.fill_boxes()["annulus"]
    count = int(0.5 * box.volume() / (4 / 3 * np.pi * r**3))
    grains = Grains.create(pack([box], cell.walls(), count, r, seed=1), r, 7850.0)
    bodies = [Body("disc", motion), Body("rotor", TimeProfile.constant(20.0)), Body("housing")]
    dt = choose_time_step(LAW, grains.mass, grains.radius).dt
    return DEM(grains, cell.walls(), bodies, LAW, dt=dt, **extra)


def test_torques_on_all_bodies_balance_the_grains_angular_momentum():
    dem = _shear_cell(FreeShaft(1e-7, drive_torque=1e-5, load_torque=TimeProfile.constant(2e-5)))
    before, shaft = dem.grains.angular_momentum_z(), dem.bodies[0].speed
    totals = dem.run(1000)
    on_bodies = sum(totals.torque_on(body.name) for body in dem.bodies) * totals.duration
    rate = dem.grains.angular_momentum_z() - before
    assert on_bodies == pytest.approx(-rate, rel=1e-9)
    # the free shaft: J domega = (contact + drive) t - load, energies booked with the mean speed
    change = 1e-7 * (dem.bodies[0].speed - shaft)
    assert 0.0 < abs(change) <= (abs(totals.torque_on("disc")) + 3e-5) * totals.duration
    kinetic = 0.5e-7 * (dem.bodies[0].speed ** 2 - shaft**2)
    shaft = totals.shaft_work["disc"]
    work = shaft["drive"] - shaft["load"] + shaft["contact"]
    assert shaft["contact"] == pytest.approx(
        -totals.energy_budget.wall_work["disc"], rel=0.02
    )  # by drifts, half a step aside
    assert kinetic == pytest.approx(work, rel=1e-9)
    assert totals.shaft_work["disc"]["load"] >= 0.0
    assert all(abs(totals.torque[name]["normal"]) < 1e-12 for name in totals.torque)


def test_energy_of_a_driven_cell_with_gravity_and_forces_closes():
    dem = _shear_cell(TimeProfile.constant(-10.0), gravity=(0.0, 0.0, -9.81))
    dem.external_force = np.full((dem.grains.count, 3), 1e-6)
    totals = dem.run(800)
    put_in = totals.energy_budget.contact_work + totals.energy_budget.gravity_work + totals.energy_budget.external_work
    assert totals.energy_budget.kinetic_change == pytest.approx(put_in, rel=1e-9)
    assert totals.energy_budget.dissipated > 0.0
    assert sum(totals.energy_budget.dissipation.values()) == pytest.approx(totals.energy_budget.dissipated, rel=0.05)


def test_brake_holds_a_shaft_at_rest_until_it_is_overcome():
    grains = Grains.create([[0.0, 0.0, 0.0]], 1e-3, 1000.0)
    body = Body("disc", FreeShaft(2e-3, drive_torque=0.5, load_torque=TimeProfile.constant(0.6)))
    dem = DEM(grains, [], [body], LAW, dt=1e-5)
    dem.run(1000)
    assert body.speed == 0.0
    body.external_torque = 0.3
    totals = dem.run(1000)
    assert body.speed == pytest.approx(0.2 / 2e-3 * 1e-2, rel=1e-9)
    assert totals.shaft_work["disc"]["load"] == pytest.approx(0.6 * body.angle, rel=2e-3)
    body.external_torque = -0.5  # nothing drives it any more: the brake stops it and holds it
    dem.run(2000)
    assert body.speed == 0.0


def test_integrator_is_of_second_order():
    """A grain on the spring of its external force, F = -k x; the error falls by 4 when dt halves."""
    errors = []
    for steps in (100, 200):
        dt, omega = 2.0 * np.pi / steps / 50.0, 50.0
        grains = Grains.create([[1e-2, 0.0, 0.0]], 1e-3, 1000.0)
        grains.velocity[0, 0] = 1e-2 * omega * np.sin(0.5 * omega * dt)  # v(-dt/2) of x = A cos(omega t)
        soft = LinearContact.from_restitution(0.01, 0.5, 0.0)
        dem = DEM(grains, [], [], soft, dt=dt)
        for _ in range(steps // 4 + steps):
            dem.external_force = -dem.grains.mass[:, None] * omega**2 * dem.grains.position
            dem.run(1)
        errors.append(abs(dem.grains.position[0, 0] - 1e-2 * np.cos(omega * dem.time)))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
