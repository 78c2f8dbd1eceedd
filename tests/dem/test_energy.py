"""Where energy goes: friction creates none, and every law's energy budget closes, wherever the partner and shafts."""

import numpy as np
import pytest
from dem_laws import (
    BESIDE,
    COHESION,
    DENSITY,
    EVERYTHING,
    FLOOR,
    LAWS,
    MASS,
    RADIUS,
    SPEED,
    impacts,
    in_order,
    law,
    make_dem,
)

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import box_surface
from geometry.walls import outline
from particles import (
    Body,
    Cohesion,
    FreeShaft,
    Grains,
    PairLaws,
    RollingFriction,
    TwistingFriction,
)

pytestmark = pytest.mark.physics

INERTIA = 0.4 * MASS * RADIUS**2


def energy(dem, pull=0.0):
    """Kinetic energy [J] of each grain of `impacts` by partner, (4, n), the two of a pair together.

    Less what cohesion ``pull`` [N] holds in contacts: a grain that sticks owes that.
    """
    _, v, w = in_order(dem.grains)
    owned = 0.5 * MASS * np.sum(v**2, axis=1) + 0.5 * INERTIA * np.sum(w**2, axis=1)
    table = dem.contacts()
    np.add.at(owned, dem.grains.particle_id[table.i], -pull * table.overlap)
    five = owned.reshape(5, -1)
    return np.concatenate([five[:3], [five[3] + five[4]]])


def swept(name, mu, e, everything=False, steps=60.0):
    """Energy before and after the impacts of tests/REFERENCE.md section 4: incidence 0 to 89 degrees, three spins."""
    angle, spin = (a.ravel() for a in np.meshgrid(np.radians(np.arange(0.0, 90.0, 1.0)), [-800.0, 0.0, 800.0]))
    spins = np.stack([0.5 * spin, 0.3 * spin, spin], axis=1)
    grains, walls = impacts(SPEED * np.cos(angle), SPEED * np.sin(angle), spins)
    contact, pull = law(name, e, mu), COHESION if everything else 0.0
    dem = make_dem(grains, walls, [Body("wall")], contact, steps=steps, everything=everything)
    before = energy(dem, pull)
    # a Hertzian contact lasts v^(-1/5) longer
    dem.run(int(3.0 * contact.contact_time(MASS, RADIUS, SPEED * np.cos(angle).min()) / dem.dt))
    return before, energy(dem, pull)


@pytest.mark.parametrize("mu", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("name", LAWS)
def test_friction_creates_no_energy_at_any_incidence(name, mu):
    """Against a plane, triangles, a cylinder, a grain.

    A well-known code gained 34 % at 76 degrees (tests/REFERENCE.md section 4).

    A leapfrog meets the ends of an impact within a step: an error of (pi/steps)^2/8 of a linear contact's energy at
    the most, of either sign. No impact may gain more than that.
    """
    for e in (0.5, 0.8, 1.0):
        before, after = swept(name, mu, e)
        assert np.all(after <= before * (1.0 + (np.pi / 60.0) ** 2 / 8.0)), e
    assert np.all(after.sum(axis=1) < before.sum(axis=1) * (1.0 - 1e-3))  # friction does take energy, e = 1 here


@pytest.mark.parametrize("name", BESIDE)
def test_rolling_twisting_and_cohesion_create_no_energy_at_any_incidence(name):
    for e in (0.5, 1.0):
        before, after = swept(name, 0.3, e, everything=True)
        assert np.all(after <= before * (1.0 + (np.pi / 60.0) ** 2 / 8.0)), e


@pytest.mark.parametrize("axis", [0, 2], ids=["rolling", "twisting"])
@pytest.mark.parametrize("name", BESIDE)
def test_a_wound_spring_gives_back_no_more_when_its_contact_closes(name, axis):
    """A bound grain bounces and swings to and fro on its rolling or twisting spring: the energy never rises.

    Where the stiffness follows the overlap a spring that kept its angle while the contact closes would pump energy
    into the swing (Elata & Berryman for the tangential one); nothing slides or is damped normally here.
    """
    laws = PairLaws.of_one(
        law(name, 1.0, 5.0),
        n_species=2,
        rolling=RollingFriction(50.0),
        twisting=TwistingFriction(50.0),
        cohesion=Cohesion.constant(0.1),
    )
    for speed in np.linspace(100.0, 3000.0, 8):
        grains = Grains.create([[0.0, 0.0, 0.99 * RADIUS]], RADIUS, DENSITY, velocity=[[0.0, 0.0, -0.03]])
        grains.angular_velocity[0, axis] = speed
        dem = make_dem(grains, [FLOOR], [Body("housing")], laws, steps=100.0, species=np.zeros(1, dtype=int))
        budget = dem.run(1).energy_budget
        kinetic, first = budget.kinetic_energy, budget.kinetic_energy + budget.elastic_energy
        for _ in range(100):
            budget = dem.run(40).energy_budget
            assert budget.kinetic_energy + budget.elastic_energy <= first + 1e-4 * kinetic  # leapfrog: (pi/100)^2/8
        assert dem.contacts().i.size == 1


# ---- the energy budget


def thrown(name, everything, steps):
    """Impacts of five incidences on each partner, spinning, on turning walls; totals of all of it."""
    angle, spin = np.radians([5.0, 30.0, 50.0, 70.0, 85.0]), np.random.default_rng(1).normal(size=(5, 3)) * 300.0
    grains, walls = impacts(SPEED * np.cos(angle), SPEED * np.sin(angle), spin)
    wall = Body("wall", TimeProfile.constant(2.0))
    dem = make_dem(grains, walls, [wall], law(name), steps=steps, everything=everything)
    totals = dem.run(int(4e-4 / dem.dt))
    assert dem.contacts().i.size == 0
    return totals


def throughput(budget):
    return budget.dissipated + sum(abs(work) for work in budget.wall_work.values())


@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_losses_by_mechanism_close_to_a_millionth_of_the_throughput(name, everything):
    """With the step: normal forces close in second order, tangential ones in first with a small coefficient.

    Cohesion jumps at touch, and an integrator meets that within a step: first order, of either sign. 1e-6 is reached
    at 3 000 to 4 000 steps a contact, with cohesion at 25 000.
    """
    coarse, fine = 100.0, 25_600.0 if everything else 4_800.0
    errors = []
    for steps in (coarse, fine):
        totals = thrown(name, everything, steps)
        budget = totals.energy_budget
        errors.append(abs(budget.integration_error) / throughput(budget))
        assert budget.kinetic_change == pytest.approx(budget.contact_work, abs=1e-12 * throughput(budget))
        assert all(lost > 0.0 for lost in budget.dissipation.values())
        assert len(budget.dissipation) == (5 if everything else 3)
    assert errors[0] < 1e-3 and errors[1] < 1e-6


def device(name, everything, steps):
    """96 grains stirred in a free drum with motor and load, by a vane of triangles that turns the other way."""
    rng = np.random.default_rng(3)
    profile = [(0.0, 0.0), (8.0 * RADIUS, 0.0), (8.0 * RADIUS, 6.0 * RADIUS), (0.0, 6.0 * RADIUS)]
    vane = box_surface("vane", "disc", (4.0 * RADIUS, 0.0, 3.0 * RADIUS), (5.0 * RADIUS, RADIUS, 4.0 * RADIUS))
    shaft = FreeShaft(SHAFT_INERTIA, drive_torque=2e-6, load_torque=TimeProfile.constant(1e-6), drive_slope=1e-8)
    bodies = [Body("drum", shaft, speed=60.0), Body("disc", TimeProfile.constant(-80.0))]
    x = np.array([
        [a, b, c]
        for a in (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
        for b in (-6.0, -4.0, -2.0, 2.0, 4.0, 6.0)
        for c in (1.0, 2.98, 4.96)
        if np.hypot(a, b) < 6.9
    ])  # fmt: skip
    x = (1.01 * x + 0.01 * rng.normal(size=x.shape)) * RADIUS
    v, w = 0.5 * rng.normal(size=x.shape), 300.0 * rng.normal(size=x.shape)
    grains = Grains.create(x, RADIUS, DENSITY, velocity=v, angular_velocity=w)
    walls = [*outline("drum", "drum", profile), vane]
    gravity = (0.0, 0.0, -9.81)
    return make_dem(grains, walls, bodies, law(name), steps=steps, everything=everything, gravity=gravity)


SHAFT_INERTIA = 2e-10


@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_books_of_a_device_close(name, everything):
    """Grains: kinetic_change = works, the free shaft: J omega^2/2 = drive - load + contact, both to round-off; the
    split by mechanism in first order at the least; what the grains do to the shaft is what it does to them.
    """
    errors = []
    for steps in (50.0, 800.0):
        dem = device(name, everything, steps)
        before = dem.bodies[0].speed
        totals = dem.run(int(1e-3 / dem.dt))
        budget, shaft = totals.energy_budget, totals.shaft_work["drum"]
        scale = throughput(budget)
        assert budget.kinetic_change == pytest.approx(budget.contact_work + budget.gravity_work, abs=1e-12 * scale)
        kinetic = 0.5 * SHAFT_INERTIA * (dem.bodies[0].speed ** 2 - before**2)
        assert kinetic == pytest.approx(shaft["drive"] - shaft["load"] + shaft["contact"], abs=1e-12 * scale)
        assert shaft["contact"] == pytest.approx(-budget.wall_work["drum"], abs=1e-5 * scale)
        assert budget.elastic_energy != 0.0 and abs(budget.wall_work["disc"]) > 1e-3 * scale
        errors.append(abs(budget.integration_error) / scale)
    assert errors[0] < 5e-4
    assert errors[1] < 3e-5
