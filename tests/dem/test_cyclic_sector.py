"""A cyclic sector behaves as the full ring made of its copies."""


import numpy as np
import pytest
from ring_of_wedges import CELL, OMEGA, PARTS, SECTOR, ring_of, wedge_of

from geometry.time_profile import TimeProfile
from particles import (
    DEM,
    Body,
    Grains,
    LinearContact,
    PairLaws,
    RollingFriction,
    choose_time_step,
)

pytestmark = pytest.mark.physics

RADIUS = 0.25e-3


def _law(wall_friction=0.5, rolling=None):
    between, at_walls = (LinearContact.from_restitution(500.0, 0.7, mu) for mu in (0.5, wall_friction))
    return PairLaws.of_one(between, at_walls=at_walls, rolling=rolling)


def _wedge(fraction=0.5):
    return wedge_of(RADIUS, 1.005, fraction)


def _dem(grains, sector, law, speed=OMEGA):
    bodies = [Body("disc"), Body("rotor", TimeProfile.constant(speed)), Body("housing")]
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    return DEM(grains, CELL.walls(), bodies, law, dt=dt, periodicity=sector)


@pytest.mark.parametrize("rolling", [None, RollingFriction(0.2)], ids=["rolls", "rolling friction"])
def test_ring_of_copies_follows_the_sector(rolling):
    """Same trajectories to the growth of round-off, same torque, with contacts carried through the faces."""
    wedge = _wedge()
    ring = _dem(ring_of(wedge), None, _law(rolling=rolling))
    part = _dem(wedge, SECTOR, _law(rolling=rolling))
    first, n = part.grains.angular_momentum_z(), part.grains.count
    total_ring, total_part = ring.run(300), part.run(300)
    assert total_part.rebuilds >= 3 and total_part.n_contacts > n
    moved = part.grains.position[np.argsort(part.grains.particle_id)]
    whole = ring.grains.position[np.argsort(ring.grains.particle_id)][:n]
    wraps = SECTOR.wraps(whole)
    assert np.count_nonzero(wraps) > 5
    at = SECTOR.turn(whole, wraps)
    off = np.linalg.norm(SECTOR.turn(moved, SECTOR.wraps(moved)) - at, axis=1)
    off = np.minimum(off, np.linalg.norm(moved - SECTOR.turn(at, np.ones(n)), axis=1))  # on a face
    assert off.max() < 1e-7 * RADIUS
    for body in ("disc", "rotor", "housing"):
        assert total_part.torque_on(body) == pytest.approx(total_ring.torque_on(body), rel=1e-6)
        assert total_part.force[body][2] == pytest.approx(total_ring.force[body][2], rel=1e-6, abs=1e-9)
        assert total_part.energy_budget.wall_work[body] == pytest.approx(
            total_ring.energy_budget.wall_work[body], rel=1e-6, abs=1e-15
        )
    assert total_part.energy_budget.dissipated == pytest.approx(total_ring.energy_budget.dissipated, rel=1e-6)
    assert total_ring.n_contacts == PARTS * total_part.n_contacts
    assert part.grains.angular_momentum_z() != pytest.approx(first, rel=1e-3)  # the walls did act


def test_angular_momentum_of_a_sector_is_conserved_to_round_off():
    """Rubbing grains between frictionless walls of revolution."""
    dem = _dem(_wedge(0.45), SECTOR, _law(wall_friction=0.0))
    before = dem.grains.angular_momentum_z()
    totals = dem.run(2000)
    assert totals.energy_budget.dissipation["sliding"] > 0.0 and totals.rebuilds > 10
    assert dem.grains.angular_momentum_z() == pytest.approx(before, rel=1e-12)
    assert totals.energy_budget.kinetic_change == pytest.approx(totals.energy_budget.contact_work, rel=1e-9)


def test_history_is_carried_through_a_face_in_either_orientation():
    """Right after a rebuild that wraps grains every touching pair still has its spring, turned with it.

    A table of the contacts that is asked for before the rebuild has the same forces.
    """
    dem = _dem(_wedge(), SECTOR, _law())
    dem.run(50)
    seen = 0
    for _ in range(400):
        dem.run(1)
        if not dem._stale:
            continue
        before, wraps = _springs(dem), SECTOR.wraps(dem.grains.position)
        crossed = set(dem.grains.particle_id[wraps != 0].tolist())
        forces = np.sort(np.linalg.norm(dem.contacts().force, axis=1))
        dem._rebuild()
        after = _springs(dem)
        assert np.sort(np.linalg.norm(dem.contacts().force, axis=1)) == pytest.approx(forces, rel=1e-9)
        assert before.keys() == after.keys()
        for pair, (size, axial) in before.items():
            assert after[pair][0] == pytest.approx(size, rel=1e-12)
            assert after[pair][1] == pytest.approx(axial, rel=1e-12, abs=1e-20)
            seen += bool(crossed & set(pair))
    assert seen > 5


def _springs(dem):
    """{ids of the pair: (|xi|, xi_z as seen from the lower id)} of the touching pairs."""
    contacts, ids = dem._list, dem.grains.particle_id
    touching, history = contacts.pair_memory
    found = {}
    rows = contacts.pairs.rows()
    for k in np.flatnonzero(touching):
        i, j = int(ids[rows[k]]), int(ids[contacts.pairs.other[k]])
        sign = 1.0 if i < j else -1.0
        found[min(i, j), max(i, j)] = np.linalg.norm(history[k]), sign * history[k, 2]
    return found


def test_moments_turn_with_the_grains_that_are_wrapped_and_are_sorted_with_them():
    """The whole moment and its dipole part: radial and around the axis, they still are so in the place wrapped to."""
    dem = _dem(_wedge(), SECTOR, _law())
    grains = dem.grains
    grains.position = grains.position @ SECTOR.rotation(1).T  # all of them into the next sector
    assert SECTOR.wraps(grains.position).any()
    grains.magnetic_moment = grains.position * [1.0, 1.0, 0.0]
    grains.dipole = np.column_stack((-grains.position[:, 1], grains.position[:, 0], grains.particle_id))
    dem.invalidate()
    assert dem.renew_list() and not SECTOR.wraps(grains.position).any()
    np.testing.assert_allclose(grains.magnetic_moment, grains.position * [1.0, 1.0, 0.0], atol=1e-17)
    around = np.column_stack((-grains.position[:, 1], grains.position[:, 0], grains.particle_id))
    np.testing.assert_allclose(grains.dipole, around, atol=1e-17)
    assert not np.array_equal(grains.particle_id, np.sort(grains.particle_id))
    again = _dem(Grains.of_records(dem.state()), SECTOR, _law())
    again.restore(dem.state())
    assert np.array_equal(again.grains.dipole, grains.dipole)
    assert np.array_equal(again.grains.magnetic_moment, grains.magnetic_moment)
