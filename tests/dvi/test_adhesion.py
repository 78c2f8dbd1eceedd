"""A contact that adheres parts where it is pulled with more than F_c, and slides where its repulsion lets it.

The laws of `particles.dvi.adhesion`, of rigid contacts and of those on springs, against formulas and against DEM.
"""

import numpy as np
import pytest
from dvi_scenes import DOWN, STEEL, G, R, floor

from geometry.walls import Plane
from particles import DEM, DVI, Body, Cohesion, DviContact, Grains, LinearContact

pytestmark = pytest.mark.physics

MASS = STEEL * 4.0 / 3.0 * np.pi * R**3
WEIGHT = MASS * G
STIFF = np.array([[1e5, 3e4], [1e5, 3e4]])
KINDS = pytest.mark.parametrize("springs", [None, STIFF], ids=["rigid", "springs"])
WORK = 0.5
LAWS = {
    "constant": (Cohesion.constant(5e-3), 5e-3),
    "dmt": (Cohesion.dmt(WORK), np.pi * WORK * R),
    "jkr": (Cohesion.jkr(WORK), 0.75 * np.pi * WORK * R),
}
"""Law, and F_c of two grains of radius R [N]."""
ALONG = np.array([1.0, 2.0, 2.0]) / 3.0
TOUCH = 1.0 - 1e-7  # pressed in a little: grains that touch may also be apart, by round-off
CEILING = Plane("ceiling", "housing", np.zeros(3), np.array([0.0, 0.0, -1.0]))


def _two(cohesion, dt, springs, speed=0.0):
    """Two grains that touch along an oblique line, and part with ``speed`` [m/s]."""
    both = np.stack([-ALONG, ALONG])
    grains = Grains.create(TOUCH * R * both, R, STEEL, velocity=0.5 * speed * both)
    return DVI(grains, [], [], DviContact(0.4), dt=dt, cohesion=cohesion, stiffness=springs, tolerance=1e-13)


def _gap(dvi):
    return float(np.linalg.norm(np.diff(dvi.grains.position, axis=0))) - 2.0 * R


@KINDS
@pytest.mark.parametrize("law", LAWS)
def test_two_grains_part_at_the_pull_off_force(law, springs):
    """Whatever the step is; beyond F_c they come apart as fast as what is left of the pull lets them."""
    cohesion, limit = LAWS[law]
    for dt in (1e-6, 3e-5, 1e-3):
        for share in (0.99, 1.2):
            dvi = _two(cohesion, dt, springs)
            dvi.external_force = np.outer(np.sign(dvi.grains.position @ ALONG), share * limit * ALONG)
            opened = -_gap(dvi)
            dvi.run(100)
            opened += _gap(dvi)
            if share < 1.0:
                assert opened < 1e-6 * R
                on = dvi.contact_force * np.sign(dvi.grains.position @ ALONG)[:, None]
                assert on == pytest.approx(np.tile(-share * limit * ALONG, (2, 1)), rel=1e-2, abs=1e-3 * limit)
                (contact,) = dvi.contacts().force
                assert np.linalg.norm(contact) == pytest.approx(share * limit, rel=1e-2)
            else:
                assert opened > 0.9 * 0.5 * (2.0 * (share - 1.0) * limit / MASS) * (100 * dt) ** 2
    assert dvi.contacts().i.size == 0 and not dvi.contact_force.any()


def test_a_blow_that_parts_rigid_grains_is_held_back_for_one_step():
    """Of the speed of parting v the step h takes 2 h F_c/m, and the next one nothing; slower ones stay together."""
    cohesion, limit = LAWS["constant"]
    for dt in (1e-5, 1e-3):
        loss = 2.0 * dt * limit / MASS
        dvi = _two(cohesion, dt, None, speed=10.0 * loss + 0.1)  # by more than the slop in a step
        dvi.run(20)
        parted = np.linalg.norm(np.diff(dvi.grains.velocity, axis=0))
        assert parted == pytest.approx(9.0 * loss + 0.1, rel=1e-9)
        dvi = _two(cohesion, dt, None, speed=0.9 * loss)
        dvi.run(20)
        assert np.abs(dvi.grains.velocity).max() < 1e-12 and _gap(dvi) < 1e-4 * R


@KINDS
def test_a_grain_hangs_from_a_ceiling_by_more_than_its_weight(springs):
    for share in (1.01, 0.99):
        grains = Grains.create([[0.0, 0.0, -TOUCH * R]], R, STEEL)
        cohesion = Cohesion.constant(0.0, share * WEIGHT)
        dvi = DVI(
            grains, [CEILING], [Body("housing")], DviContact(0.4), dt=1e-4, gravity=DOWN, cohesion=cohesion,
            stiffness=springs, tolerance=1e-12,
        )  # fmt: skip
        dvi.run(200)
        totals = dvi.run(1)
        if share > 1.0:
            assert totals.force["housing"][2] == pytest.approx(-WEIGHT, rel=1e-6)
            assert dvi.contact_force[0, 2] == pytest.approx(WEIGHT, rel=1e-6)
            assert abs(dvi.grains.velocity[0, 2]) < 1e-6
        else:
            assert dvi.grains.velocity[0, 2] < -0.5 * G * 200 * 1e-4 * (1.0 - share)
            assert totals.n_contacts == 0


@pytest.mark.parametrize("share", [0.95, 1.2])
def test_friction_is_limited_by_the_repulsion(share):
    """A ball that is drawn along rolls up to the force (7/2) mu (m g + F_c), and slides under more."""
    mu, pull = 0.4, 2.0 * WEIGHT
    grains = Grains.create([[0.0, 0.0, R]], R, STEEL)
    dvi = DVI(
        grains, [floor()], [Body("housing")], DviContact(mu), dt=1e-4, gravity=DOWN,
        cohesion=Cohesion.constant(0.0, pull), tolerance=1e-12,
    )  # fmt: skip
    limit = mu * (WEIGHT + pull)
    force = share * 3.5 * limit
    dvi.external_force = np.array([[force, 0.0, 0.0]])
    totals = dvi.run(100)
    time = 100 * dvi.dt
    friction = min(force * 2.0 / 7.0, limit)
    assert dvi.grains.velocity[0] == pytest.approx([(force - friction) / MASS * time, 0.0, 0.0], rel=1e-6, abs=1e-9)
    spin = 2.5 * friction / (MASS * R) * time
    assert dvi.grains.angular_velocity[0] == pytest.approx([0.0, spin, 0.0], rel=1e-6, abs=1e-9)
    assert totals.force["housing"] == pytest.approx([friction, 0.0, -WEIGHT], rel=1e-6)
    lost = totals.energy_budget.dissipation
    assert lost["impact"] == pytest.approx(0.0, abs=1e-12)
    assert (lost["sliding"] > 1e-6) == (share > 1.0)


def _struck(engine, law, dt, **more):
    """Four grains that hold together in a square are struck by a fifth."""
    x = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0], [3.2, 3.0, 1.6]]) * TOUCH * R
    v = np.zeros((5, 3))
    v[4] = [-0.05, -0.06, -0.1]
    grains = Grains.create(x, R, STEEL, velocity=v)
    return engine(grains, [], [], law, dt=dt, cohesion=Cohesion.constant(1.0), **more)


def test_grains_that_stick_are_struck_as_by_dem():
    """At small steps, on the same springs: places and velocities; energy is kept with what the pulls hold."""
    law = LinearContact.from_restitution(STIFF[0, 0], 0.5, 0.4, stiffness_t=STIFF[0, 1], damping_t=0.0)
    dem = _struck(DEM, law, 5e-6)
    dvi = _struck(DVI, DviContact(0.4, 0.5), 1e-6, stiffness=STIFF, tolerance=1e-9)
    dem.run(1600)
    totals = dvi.run(8000)
    one, two = (e.grains.position[np.argsort(e.grains.particle_id)] for e in (dem, dvi))
    assert np.abs(one - two).max() < 0.01 * R
    one, two = (e.grains.velocity[np.argsort(e.grains.particle_id)] for e in (dem, dvi))
    assert np.abs(one - two).max() < 0.02 * np.abs(one).max()
    assert len(dvi.contacts().i) == len(dem.contacts().i) > 3
    budget = totals.energy_budget
    assert budget.kinetic_change == pytest.approx(budget.contact_work, rel=1e-9)
    assert budget.elastic_energy < 0.0 and budget.dissipation["impact"] > 0.0


def test_a_restart_goes_on_bit_for_bit_and_knows_the_pulls():
    dvi = _struck(DVI, DviContact(0.4, 0.5), 1e-5, stiffness=STIFF)
    dvi.run(100)
    other = _struck(DVI, DviContact(0.4, 0.5), 1e-5, stiffness=STIFF)
    other.restore(dvi.state())
    assert np.array_equal(other.contacts().force, dvi.contacts().force)
    dvi.run(100), other.run(100)
    assert np.array_equal(other.grains.position, dvi.grains.position)
    bare = DVI(other.grains, [], [], DviContact(0.4, 0.5), dt=1e-5)
    with pytest.raises(ValueError, match="or cohesion, and the other none"):
        bare.restore(dvi.state())
