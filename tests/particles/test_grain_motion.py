"""The contract that both engines of the grains keep (`particles.GrainMotion`): the same assertions for each."""

import numpy as np
import pytest

from geometry.box import Box
from geometry.time_profile import TimeProfile
from particles import DEM, DVI, Body, DviContact, FreeShaft, GrainMotion, Grains, LinearContact

R = 1e-3
G = 9.81
SIDE = 0.02
DT = {"dem": 5e-6, "dvi": 1e-4}
LAW = LinearContact.from_restitution(2e3, 0.4, 0.3)


@pytest.fixture(params=["dem", "dvi"])
def made(request):
    """Makes an engine for grains at ``position`` (n, 3) [m]: a box, a disc that is driven, a shaft that is free."""

    def make(position, *, gravity=(0.0, 0.0, -G), velocity=None) -> GrainMotion:
        grains = Grains.create(np.atleast_2d(position), R, 7850.0, velocity=velocity)
        walls = Box((SIDE, SIDE, SIDE)).walls()
        bodies = [
            Body("housing"),
            Body("disc", TimeProfile.constant(5.0)),
            Body("shaft", FreeShaft(1e-3, drive_torque=0.02)),
        ]
        if request.param == "dem":
            return DEM(grains, walls, bodies, LAW, dt=DT["dem"], gravity=gravity)
        return DVI(grains, walls, bodies, DviContact(0.3, 0.4), dt=DT["dvi"], gravity=gravity)

    return make


def scattered(n=40, seed=2):
    """Grains on a shaken lattice, moving in all directions."""
    sites = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3)[:n]
    rng = np.random.default_rng(seed)
    where = 2.5 * R * (sites - [1.5, 1.5, 0.0]) + [0.0, 0.0, 2.0 * R] + 0.2 * R * rng.uniform(-1.0, 1.0, (n, 3))
    return {"position": where, "velocity": rng.normal(scale=0.3, size=(n, 3))}


def by_number(motion):
    """Places and velocities in the order of the grains' numbers."""
    order = np.argsort(motion.grains.particle_id)
    return motion.grains.position[order], motion.grains.velocity[order]


def test_the_clock_goes_with_the_steps(made):
    motion = made([0.0, 0.0, 0.5 * SIDE])
    assert motion.time == 0.0 and motion.n_sectors == 1 and motion.sector is None and motion.list_skin > 0.0
    totals = [motion.run(7), motion.run(13)]
    assert [t.steps for t in totals] == [7, 13]
    assert motion.step_count == 20 and motion.time == pytest.approx(20 * motion.dt)
    assert totals[1].duration == pytest.approx(13 * motion.dt)


def test_a_grain_falls_and_is_pushed_by_the_held_force(made):
    """x_n = x_0 + a dt^2 n (n + 1)/2 from rest: velocities are those of the step's end."""
    start, n = np.array([0.0, 0.0, 0.5 * SIDE]), 30
    motion = made(start)
    motion.external_force = np.array([[2e-4, 0.0, 0.0]])
    motion.run(n)
    a = np.array([2e-4 / motion.grains.mass[0], 0.0, -G])
    np.testing.assert_allclose(motion.grains.position[0] - start, 0.5 * a * motion.dt**2 * n * (n + 1), rtol=1e-9)
    np.testing.assert_allclose(motion.gravity_now, [0.0, 0.0, -G])


def test_held_forces_stay_with_their_grains(made):
    """However the list sorts them."""
    motion = made(**scattered(), gravity=None)
    assert motion.gravity_now is None
    motion.external_force = 1e-6 * motion.grains.particle_id[:, None] * np.array([1.0, 0.0, 0.0])
    before, lists = motion.order_version, motion.list_version
    while motion.order_version == before:
        motion.run(50)
    assert motion.list_version > lists
    np.testing.assert_array_equal(motion.external_force[:, 0], 1e-6 * motion.grains.particle_id)


def test_bodies_follow_their_drives(made):
    """The driven one omega t, the free one T t/J."""
    motion = made([0.0, 0.0, 0.5 * SIDE])
    motion.run(100)
    _, disc, shaft = motion.bodies
    assert disc.speed == 5.0 and disc.angle == pytest.approx(5.0 * motion.time)
    assert shaft.speed == pytest.approx(0.02 / 1e-3 * motion.time)


def test_a_grain_at_rest_bears_its_weight(made):
    motion = made([1e-3, 2e-3, R])
    motion.run(round(0.02 / motion.dt))
    weight = motion.grains.mass[0] * G
    np.testing.assert_allclose(motion.contact_force, [[0.0, 0.0, weight]], rtol=1e-4, atol=1e-6 * weight)
    table = motion.contacts()
    assert list(table.i) == [0] and list(table.j) == [-1]
    np.testing.assert_allclose(table.force, motion.contact_force, rtol=1e-4, atol=1e-6 * weight)
    np.testing.assert_allclose(table.point, [[1e-3, 2e-3, 0.0]], atol=1e-3 * R)


def test_the_books_close(made):
    """What gravity puts in and contacts lose is what the grains have; nothing else works on them here."""
    motion = made(**scattered())
    budget = motion.run(round(0.01 / motion.dt)).energy_budget
    assert sum(budget.dissipation.values()) > 0.0
    assert budget.kinetic_change == pytest.approx(budget.contact_work + budget.gravity_work, rel=1e-9)


def test_a_restored_state_goes_on_bit_for_bit(made):
    whole, first, second = (made(**scattered()) for _ in range(3))
    whole.run(300)
    first.run(120)
    second.restore(first.state())
    second.run(180)
    expected, found = whole.state(), second.state()
    assert expected.keys() == found.keys()
    assert [name for name in expected if not np.array_equal(expected[name], found[name])] == []


def test_another_run_begins_with_the_grains_of_a_state(made):
    """Grains and angles are the state's; clock, speeds and held forces this engine's own."""
    first = made(**scattered())
    first.external_force = np.full((40, 3), 1e-6)
    first.run(200)
    fresh = made(**scattered(seed=5))
    fresh.begin_with(first.state())
    assert fresh.time == 0.0 and fresh.external_force is None
    assert [b.angle for b in fresh.bodies] == [b.angle for b in first.bodies]
    assert fresh.bodies[2].speed == 0.0 < first.bodies[2].speed
    for expected, found in zip(by_number(first), by_number(fresh), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert fresh.run(20).steps == 20


def test_a_state_of_other_grains_is_refused(made):
    state = made(**scattered(n=39)).state()
    for take in (made(**scattered()).restore, made(**scattered()).begin_with):
        with pytest.raises(ValueError, match="the state has 39 grains and 3 bodies"):
            take(state)


def test_grains_that_were_moved_from_outside_are_listed_anew(made):
    motion = made(**scattered())
    motion.run(1)
    lists = motion.list_version
    motion.grains.position[:, 2] += 0.1 * R
    motion.invalidate()
    motion.run(1)
    assert motion.list_version == lists + 1
