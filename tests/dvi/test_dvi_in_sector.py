"""Rigid and compliant grains of a cyclic sector move as the full ring made of its copies.

Springs make forces of a packing unique, so that both may be compared to the solver's tolerance.
"""

import numpy as np
import pytest
from ring_of_wedges import CELL, OMEGA, PARTS, SECTOR, ring_of, wedge_of

from geometry.time_profile import TimeProfile
from particles import (
    DEM,
    DVI,
    Body,
    Cohesion,
    CyclicSector,
    DemError,
    DemErrorKind,
    DviContact,
    FreeShaft,
    LinearContact,
    PairLaws,
    RollingFriction,
    TwistingFriction,
)

pytestmark = pytest.mark.physics

R = 0.35e-3
STIFF = np.array([[2000.0, 600.0], [2000.0, 600.0]])
INERTIA = 1e-7


def _wedge(fraction=0.5):
    return wedge_of(R, 1.002, fraction)


def _dvi(grains, sector, wall_friction=0.5, dt=1e-5, **more):
    free = Body("rotor", FreeShaft(INERTIA, load_torque=TimeProfile.constant(1e-4)), speed=OMEGA)
    bodies = [Body("disc"), free, Body("housing")]
    contact = DviContact(0.5, 0.3, wall_friction=wall_friction)
    way = {"gravity": (0.0, 0.0, -9.81), "tolerance": 1e-11, "stiffness": STIFF} | more
    return DVI(grains, CELL.walls(), bodies, contact, dt=dt, periodicity=sector, **way)


def _by_number(dvi, array):
    return array[np.argsort(dvi.grains.particle_id)]


def _away(one, two):
    """Distance [m] of places that may differ by whole sectors."""
    turned = [np.linalg.norm(one - SECTOR.turn(two, np.full(len(two), k)), axis=1) for k in range(PARTS)]
    return np.min(turned, axis=0)


RESISTS = {"rolling": RollingFriction(0.2), "twisting": TwistingFriction(0.1)}
WAYS = {"rolls": {}, "resists": RESISTS, "adheres": RESISTS | {"cohesion": Cohesion.constant(0.005)}}


@pytest.mark.parametrize("way", WAYS)
def test_ring_of_copies_follows_the_sector(way):
    """Same places, speed of a free shaft, torques, axial forces and energies; grains are carried through the faces."""
    wedge = _wedge()
    ring, part = _dvi(ring_of(wedge), None, **WAYS[way]), _dvi(wedge, SECTOR, **WAYS[way])
    n = part.grains.count
    whole, sums = ring.run(200), part.run(200)
    assert sums.missed_steps == whole.missed_steps == 0
    assert sums.rebuilds >= 2 and sums.n_contacts > n // 2
    places = _by_number(ring, ring.grains.position)[:n]
    assert np.count_nonzero(SECTOR.wraps(places)) >= 5
    assert _away(_by_number(part, part.grains.position), places).max() < 1e-6 * R
    assert part.bodies[1].speed == pytest.approx(ring.bodies[1].speed, rel=1e-7)
    for body in ("disc", "rotor", "housing"):
        assert sums.torque_on(body) == pytest.approx(whole.torque_on(body), rel=1e-5, abs=1e-10)
        assert sums.force[body][2] == pytest.approx(whole.force[body][2], rel=1e-5, abs=1e-8)
        assert np.array_equal(sums.force[body][:2], [0.0, 0.0])
    mine, theirs = sums.energy_budget, whole.energy_budget
    for name in ("contact_work", "kinetic_change", "elastic_energy", "gravity_work", "dissipated"):
        assert getattr(mine, name) == pytest.approx(getattr(theirs, name), rel=1e-5, abs=1e-14)
    assert sums.shaft_work["rotor"] == pytest.approx(whole.shaft_work["rotor"], rel=1e-5, abs=1e-14)
    assert whole.n_contacts == PARTS * sums.n_contacts
    force = _by_number(ring, ring.contact_force)[:n]
    turns = SECTOR.wraps(places)
    assert SECTOR.turn(force, turns)[:, 2] == pytest.approx(_by_number(part, part.contact_force)[:, 2], abs=1e-6)


def test_angular_momentum_of_a_sector_is_conserved_to_round_off():
    """Rubbing grains between frictionless walls of revolution, whose kinetic energy changes by the contacts' work."""
    part = _dvi(_wedge(0.45), SECTOR, wall_friction=0.0, tolerance=1e-6, gravity=None)
    before = part.grains.angular_momentum_z()
    totals = part.run(400)
    budget = totals.energy_budget
    assert budget.dissipation["sliding"] > 0.0 and totals.rebuilds > 3
    assert part.grains.angular_momentum_z() == pytest.approx(before, rel=1e-12)
    assert budget.kinetic_change == pytest.approx(budget.contact_work, rel=1e-9)


def test_a_sector_turned_as_a_whole_moves_as_before():
    """Faces are nowhere: turned by a part of the sector, other pairs meet across them, and nothing else changes."""
    wedge = _wedge()
    turned = _wedge()
    part = CyclicSector(2.0 * np.pi / 36).rotation(1)  # ten degrees
    turned.position, turned.velocity, turned.angular_velocity = (
        np.asarray(a) @ part.T for a in (turned.position, turned.velocity, turned.angular_velocity)
    )  # fmt: skip
    one, two = _dvi(wedge, SECTOR), _dvi(turned, SECTOR)
    first, second = one.run(100), two.run(100)
    assert _across(one) != _across(two)
    places = _by_number(two, two.grains.position) @ part
    assert _away(_by_number(one, one.grains.position), places).max() < 1e-6 * R
    for body in ("disc", "rotor", "housing"):
        assert first.torque_on(body) == pytest.approx(second.torque_on(body), rel=1e-5, abs=1e-10)


def _across(dvi):
    """Numbers of the pairs that touch across the faces."""
    table, number = dvi.contacts(), dvi.grains.particle_id
    across = table.shift != 0
    return {frozenset(pair) for pair in zip(number[table.i[across]], number[table.j[across]], strict=True)}


def test_impulses_are_carried_through_a_face_in_either_orientation():
    """Right after grains are wrapped every loaded pair has its impulse, turned with it and along the same normal."""
    part = _dvi(_wedge(), SECTOR, tolerance=1e-6)
    seen = 0
    for _ in range(40):
        part.run(10)
        before, crossed = _impulses(part), set(part.grains.particle_id[SECTOR.wraps(part.grains.position) != 0])
        part._rebuild()
        after = _impulses(part)
        assert before.keys() == after.keys()
        for pair, numbers in before.items():
            assert after[pair] == pytest.approx(numbers, rel=1e-9, abs=1e-16)
            seen += bool(crossed & set(pair))
    assert seen > 5


def _impulses(dvi):
    """{numbers of the pair: (|r|, r_z as the lower number sees it, r along the normal)} of the loaded pairs."""
    listed, number, x = dvi._list, dvi.grains.particle_id, dvi.grains.position
    rows, found = listed.pairs.rows(), {}
    for k in np.flatnonzero(listed.pair_impulse.any(axis=1)):
        i, j, r = rows[k], listed.pairs.other[k], listed.pair_impulse[k]
        away = x[i] - SECTOR.rotation(int(listed.pairs.shift[k])) @ x[j]
        sign = 1.0 if number[i] < number[j] else -1.0
        pair = min(number[i], number[j]), max(number[i], number[j])
        found[pair] = np.linalg.norm(r), sign * r[2], r @ away / np.linalg.norm(away)
    return found


def test_small_steps_of_both_methods_move_a_sector_alike():
    """The same springs by DEM: places differ by what goes with the step, torques of the ring by some per cent."""
    law = LinearContact.from_restitution(STIFF[0, 0], 0.3, 0.5, stiffness_t=STIFF[0, 1], damping_t=0.0)
    bodies = [Body("disc"), Body("rotor", TimeProfile.constant(OMEGA)), Body("housing")]
    dem = DEM(_wedge(), CELL.walls(), bodies, PairLaws.of_one(law), dt=1e-6, periodicity=SECTOR)
    torque, away = dem.run(400), []
    for dt in (2e-6, 1e-6):
        bodies = [Body("disc"), Body("rotor", TimeProfile.constant(OMEGA)), Body("housing")]
        dvi = DVI(
            _wedge(), CELL.walls(), bodies, DviContact(0.5, 0.3), dt=dt, periodicity=SECTOR, tolerance=1e-7,
            stiffness=STIFF,
        )  # fmt: skip
        totals = dvi.run(round(4e-4 / dt))
        for body in ("disc", "rotor", "housing"):
            assert totals.torque_on(body) == pytest.approx(torque.torque_on(body), rel=0.08)
        away.append(_away(_by_number(dvi, dvi.grains.position), _by_number(dem, dem.grains.position)))
    assert away[0].max() < 0.03 * R and np.median(away[1]) < 0.65 * np.median(away[0])


def test_rigid_contacts_of_a_sector_close_without_overlap():
    """Without springs: what overlap steps leave is removed from the positions, across the faces too."""
    part = _dvi(_wedge(), SECTOR, stiffness=None, tolerance=1e-3, dt=5e-5, max_sweeps=500)
    totals = part.run(60)
    assert totals.projections > 0 and totals.rebuilds > 1
    table = part.contacts()
    assert np.count_nonzero(table.shift) > 3
    assert table.overlap.max() < 2e-3 * R


def test_a_restart_of_a_sector_goes_on_bit_for_bit():
    whole, parts = _dvi(_wedge(), SECTOR, tolerance=1e-6), _dvi(_wedge(), SECTOR, tolerance=1e-6)
    whole.run(150)
    parts.run(90)
    other = _dvi(_wedge(), SECTOR, tolerance=1e-6)
    other.restore(parts.state())
    other.run(60)
    one, two = whole.state(), other.state()
    assert [name for name in one if not np.array_equal(one[name], two[name])] == []


def test_a_step_that_a_sector_is_too_narrow_for_is_told():
    """Grains that move so far that a list of one step would not fit into the wedge: the fastest one is named."""
    wedge = _wedge()
    wedge.velocity[3] = [0.0, 0.0, 50.0]
    with pytest.raises(DemError, match="radii of the smallest grain in a step") as raised:
        _dvi(wedge, SECTOR, dt=1e-4)
    assert raised.value.kind is DemErrorKind.TOO_FAST and raised.value.particle_id == 3


def test_what_no_sector_can_have_is_refused():
    with pytest.raises(ValueError, match="turns from sector to sector"):
        _dvi(_wedge(), SECTOR, gravity=(0.0, -9.81, 0.0))
