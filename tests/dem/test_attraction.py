"""A tabulated attraction of near grains, from the gap of every step: forces, energy budget, symmetry, bits.

Two compiled steps for all of it: grains of unequal sizes with the energy budget, in a ring and in a sector.
"""

import math

import numba
import numpy as np
import pytest
from attraction_drives import (
    ACROSS,
    ALONG,
    DENSITY,
    RADIUS,
    SMALLEST,
    VALUES,
    X,
    alike,
    at_gaps,
    from_moments,
    pull,
    table,
)
from dem_laws import FLOOR

from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall
from particles import (
    DEM,
    Attraction,
    Body,
    CyclicSector,
    Grains,
    LinearContact,
    choose_time_step,
    depth_warning,
    pack,
    pull_stiffness_ratio,
)

pytestmark = pytest.mark.physics

LAW = LinearContact.from_restitution(2e4, 0.6, 0.4)


def magnetised(dem, strength, seed=0, **more):
    """Give the grains of `dem`, by their numbers, what `from_moments` needs."""
    random, g = np.random.default_rng(seed), dem.grains
    moment, share = random.uniform(-1.0, 1.0, (g.count, 3)), random.uniform(-1.0, 1.0, g.count)
    held = {"moment": moment[g.particle_id], "share": share[g.particle_id]}
    dem.attraction = table(from_moments(strength), per_grain=held, **more)
    return dem


def sizes(count):
    return RADIUS * np.random.default_rng(9).uniform(0.8, 1.0, count)


def crowd(count=600, strength=2e-3, *, walls=True, stir=0.5, skin=None, **more):
    side = (count * 4 / 3 * np.pi * RADIUS**3 / 0.45) ** (1 / 3)
    box = Box((side, side, side))
    grains = Grains.create(pack(box, box.walls(), count, RADIUS, seed=5), sizes(count), DENSITY)
    grains.velocity[:] = np.random.default_rng(1).normal(size=(count, 3)) * stir
    dt = 0.5 * choose_time_step(LAW, grains.mass, grains.radius).dt
    dem = DEM(grains, box.walls() if walls else [], [Body("housing")], LAW, dt=dt, skin=skin)
    return magnetised(dem, strength, **more) if strength else dem


def differing(a, b):
    one, other = a.state(), b.state()
    assert one.keys() == other.keys()
    return [name for name in one if not np.array_equal(one[name], other[name])]


# ---- the force


def test_forces_of_pairs_and_walls_are_the_tables():
    """From below the smallest gap to beyond the last one; unequal grains, apart, from rest."""
    gap = np.array([1e-4, 2.5e-3, 4e-3, 0.011, 0.07, 0.21, 0.299, 0.31])
    n = len(gap)
    x, radius, walls = at_gaps(gap, RADIUS, 0.7 * RADIUS)
    grains = Grains.create(x, radius, DENSITY)
    dem = DEM(grains, walls, [Body("housing")], LAW, dt=1e-9, skin=RADIUS)
    dem.attraction = table(alike(0.03, 1.7, 0.05, walls=0.02))
    dem.run(1)
    order = np.argsort(dem.grains.particle_id)
    force = (dem.grains.mass[:, None] * dem.grains.velocity / dem.dt)[order].reshape(4, n, 3)
    expected = pull(gap, 1.7, 0.03, 0.05)
    np.testing.assert_allclose(force[0], expected[:, None] * ALONG, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(force[1], -force[0], rtol=1e-13)
    expected = pull(gap, 1.7, 0.02)
    np.testing.assert_allclose(force[2], expected[:, None] * [0.0, 0.0, -1.0], rtol=1e-10, atol=1e-12)
    outwards = np.array([np.cos(0.3), -np.sin(0.3), 0.0])
    np.testing.assert_allclose(force[3], expected[:, None] * outwards, rtol=1e-10, atol=1e-12)
    assert expected[-1] == 0.0 < expected[0] == pytest.approx(expected[1])
    assert not dem.contact_force.any()  # pulls are none


def test_pairs_that_touch_attract_as_at_the_smallest_gap():
    overlap = 0.01 * RADIUS
    grains = Grains.create([[0.0, 0.0, 0.0], [1.9 * RADIUS - overlap, 0.0, 0.0]], [RADIUS, 0.9 * RADIUS], DENSITY)
    dem = DEM(grains, [], [], LAW, dt=1e-9)
    dem.attraction = table(alike(0.03))
    dem.run(1)
    felt = dem.grains.mass[0] * dem.grains.velocity[0, 0] / dem.dt
    assert dem.contact_force[0, 0] == pytest.approx(-LAW.stiffness_n * overlap, rel=1e-9)
    assert felt - dem.contact_force[0, 0] == pytest.approx(pull(0.0, 1.7, 0.03), rel=1e-9)


def test_drives_are_renewed_on_demand_and_the_list_keeps_its_order():
    grains = Grains.create([[0.0, 0.0, 0.0], [2.0 * RADIUS, 0.0, 0.0]], [RADIUS, 0.9 * RADIUS], DENSITY)
    dem = DEM(grains, [], [], LAW, dt=1e-9, skin=0.01 * RADIUS)
    asked = []

    def drives(dem):
        asked.append(dem.listed_pairs.count)
        return alike(0.03)(dem)

    dem.attraction = table(drives)
    dem.run(3)
    dem.run(3)
    assert asked == [0]  # nearer than the skin there is none
    dem.attraction.renew()
    dem.run(1)
    assert asked == [0, 0] and not dem.grains.velocity.any()
    dem.attraction = table(drives, near_gap=0.3)
    assert dem.renew_list() and not dem.renew_list()
    dem.run(1)
    assert asked == [0, 0, 1] and dem.grains.velocity[0, 0] > 0.0


# ---- conservation


def fall(steps):
    """Largest error of kinetic + elastic + W over two grains' fall, impact and way out, over the depth of W."""
    dt = 2e-6 / steps
    elastic = LinearContact.from_restitution(2e3, 1.0, 0.0)
    grains = Grains.create([[0.0, 0.0, 0.0], [2.05 * RADIUS, 0.0, 0.0]], [RADIUS, 0.9 * RADIUS], DENSITY)
    dem = DEM(grains, [], [], elastic, dt=dt, skin=RADIUS)
    dem.attraction = table(alike(1e-3))
    a = 2.0 * RADIUS * 0.9 / 1.9
    # W = -a int_g F dg, exact between the nodes where F is linear in ln g
    k = np.exp(np.append(np.log(SMALLEST), X[np.log(SMALLEST) < X]))
    f = pull(k, 1.7, 1e-3)
    f[-1] = 0.0

    def well(gap):
        if gap < SMALLEST:
            return well(SMALLEST) + a * f[0] * (gap - SMALLEST)
        ends, total = np.append(gap, k[k > gap]), 0.0
        at = np.append(pull(gap, 1.7, 1e-3), f[k > gap])
        for low, high, left, right in zip(ends[:-1], ends[1:], at[:-1], at[1:], strict=True):
            rise = (right - left) / np.log(high / low)
            total += (left - rise * np.log(low)) * (high - low)
            total += rise * (high * (np.log(high) - 1.0) - low * (np.log(low) - 1.0))
        return -a * total

    energy, external, met = [], 0.0, np.inf
    for _ in range(round(2e-3 / dt)):
        gap = (np.linalg.norm(np.diff(dem.grains.position, axis=0)) - 1.9 * RADIUS) / a
        budget = dem.run(1).energy_budget
        external += budget.external_work
        energy.append(budget.kinetic_energy + budget.elastic_energy + well(gap))
        met = min(met, gap)
    assert met < 0.0
    depth = -well(0.0)
    assert external == pytest.approx(well((2.05 - 1.9) * RADIUS / a) - well(gap), abs=0.02 * depth)
    return np.ptp(energy) / depth


def test_energy_of_two_grains_that_fall_on_each_other_is_of_second_order():
    coarse, fine = fall(1), fall(8)
    assert fine < 1e-4
    assert coarse / fine == pytest.approx(64.0, rel=0.2)


def test_momentum_and_angular_momentum_are_conserved_to_round_off_and_all_work_is_booked():
    dem = crowd(600, 4e-3, walls=False, stir=0.2)
    g = dem.grains

    def momenta():
        turning = g.mass @ np.cross(g.position, g.velocity) + g.inertia @ g.angular_velocity
        return np.concatenate([g.momentum() / g.mass.sum(), turning / (g.mass.sum() * 10.0 * RADIUS)])

    before = momenta()
    totals = dem.run(1000)
    assert totals.rebuilds > 2 and totals.n_contacts > 100 and dem.order_version > 0
    speed = math.sqrt(2.0 * totals.energy_budget.kinetic_energy / g.mass.sum())
    assert momenta() == pytest.approx(before, abs=1e-13 * speed)
    budget = totals.energy_budget
    assert abs(budget.external_work) > 0.1 * abs(budget.contact_work)
    assert budget.kinetic_change == pytest.approx(budget.contact_work + budget.external_work, rel=1e-10)
    assert sum(budget.dissipation.values()) == pytest.approx(budget.dissipated, rel=0.02)


# ---- bits


def test_one_and_two_threads_agree_bitwise():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one core only")
    one, two = crowd(), crowd()
    first = one.run(300)
    numba.set_num_threads(2)  # one again before the next test
    second = two.run(300)
    assert differing(one, two) == []
    assert len(one._list.chunks.reaction) > 50 and first.rebuilds > 1 and first.energy_budget == second.energy_budget


def test_restart_is_bitwise_between_two_renewals():
    straight, first = crowd(200), crowd(200)
    straight.run(300)
    first.run(137)
    saved = first.state()
    fresh = crowd(200, seed=1)  # what its grains hold comes from the state
    fresh.restore(saved)
    assert fresh.attraction.strongest == first.attraction.strongest > 0.0  # before a step: a run may be over
    fresh.run(163)
    assert differing(straight, fresh) == []
    assert straight.list_version > first.list_version > 1
    with pytest.raises(ValueError, match="the same `attraction` first"):
        crowd(200, 0.0).restore(saved)
    assert len(crowd(200).attraction.state()) == 4  # the drives are not known before the first step


def test_lists_made_at_other_times_change_nothing_but_round_off():
    """Where the list holds every pair within the range of the table; its vectors and numbers stay with their grains."""
    runs = [crowd(200, near_gap=0.3, skin=share * RADIUS) for share in (0.06, 0.8)]
    totals = [dem.run(300) for dem in runs]
    assert totals[0].rebuilds > 8 > totals[1].rebuilds
    order = [np.argsort(dem.grains.particle_id) for dem in runs]
    first, second = (dem.grains.position[k] for dem, k in zip(runs, order, strict=True))
    assert np.abs(first - second).max() < 1e-9 * RADIUS
    assert np.linalg.norm(runs[0].grains.velocity, axis=1).max() > 0.1
    held = [dem.attraction.per_grain["moment"][k] for dem, k in zip(runs, order, strict=True)]
    np.testing.assert_array_equal(held[0], held[1])


PARTS = 6
SECTOR = CyclicSector(2.0 * math.pi / PARTS)
CELL = ShearCell(0.006, 0.0085, 0.003)


def wedge(fraction=0.4):
    box, random, r = CELL.fill_boxes()["annulus"], np.random.default_rng(4), 0.25e-3
    count = int(fraction * box.volume(SECTOR.angle) / (4 / 3 * np.pi * r**3))
    x = pack([box], CELL.walls(), count, 1.005 * r, seed=1, sector=SECTOR)
    v = 60.0 * np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1) + 0.2 * random.normal(size=x.shape)
    radius = r * random.uniform(0.8, 1.0, count)
    moment = random.uniform(-1.0, 1.0, x.shape)
    return x, v, radius, moment, random.uniform(-1.0, 1.0, count)


def sheared(copies):
    x, v, radius, moment, share = wedge()
    if copies:
        turns = [SECTOR.rotation(k).T for k in range(PARTS)]
        x, v, moment = (np.concatenate([a @ turn for turn in turns]) for a in (x, v, moment))
        radius, share = np.tile(radius, PARTS), np.tile(share, PARTS)
    law = LinearContact.from_restitution(500.0, 0.7, 0.5)
    grains = Grains.create(x, radius, DENSITY, velocity=v)
    bodies = [Body("disc"), Body("rotor", TimeProfile.constant(60.0)), Body("housing")]
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    dem = DEM(grains, CELL.walls(), bodies, law, dt=dt, periodicity=None if copies else SECTOR)
    who = dem.grains.particle_id
    held = {"moment": moment[who], "share": share[who]}
    dem.attraction = table(from_moments(1e-4), per_grain=held, near_gap=0.3)
    return dem


def test_a_ring_of_copies_follows_the_sector():
    """Pulls across the faces, walls too; what a grain holds is turned where it is wrapped."""
    ring, part = sheared(True), sheared(False)
    on_ring, on_part = ring.run(200), part.run(200)
    n = part.grains.count
    assert on_part.rebuilds >= 3 and np.count_nonzero(part.listed_pairs.shift) > 10
    there = ring.grains.position[np.argsort(ring.grains.particle_id)][:n]
    turned = SECTOR.wraps(there)
    assert np.count_nonzero(turned) > 5
    here = part.grains.position[np.argsort(part.grains.particle_id)]
    off = SECTOR.turn(here, SECTOR.wraps(here)) - SECTOR.turn(there, turned)
    near_face = np.abs(np.arctan2(here[:, 1], here[:, 0]) % SECTOR.angle - 0.5 * SECTOR.angle) > 0.499 * SECTOR.angle
    assert np.abs(off[~near_face]).max() < 1e-7 * RADIUS
    assert on_part.energy_budget.external_work == pytest.approx(on_ring.energy_budget.external_work, rel=1e-7)
    assert abs(on_part.energy_budget.external_work) > 0.01 * abs(on_part.energy_budget.contact_work)
    for body in ("disc", "rotor", "housing"):
        assert on_part.torque_on(body) == pytest.approx(on_ring.torque_on(body), rel=1e-6)
    assert on_ring.n_contacts == PARTS * on_part.n_contacts


# ---- input and refusals


def test_the_stiffest_slot_is_known_to_the_step_and_to_the_warnings():
    grains = Grains.create([[0.0, 0.0, RADIUS], [1.92 * RADIUS, 0.0, RADIUS]], [RADIUS, 0.9 * RADIUS], DENSITY)
    dem = DEM(grains, [FLOOR], [Body("housing")], LAW, dt=1e-9)
    dem.attraction = table(alike(0.02, walls=0.002))
    assert dem.attraction.stiffest == dem.attraction.strongest == 0.0
    assert pull_stiffness_ratio(dem.attraction, LAW, RADIUS) == 0.0
    assert depth_warning(dem.attraction, LAW, RADIUS) is None
    dem.run(1)
    a, gap = 2.0 * RADIUS * 0.9 / 1.9, np.geomspace(SMALLEST, 0.29, 4000)
    steepest = np.max(-np.diff(pull(gap, 1.7, 0.02)) / np.diff(gap)) / a
    assert dem.attraction.stiffest == pytest.approx(steepest, rel=0.01)
    assert dem.attraction.strongest == pytest.approx(pull(SMALLEST, 1.7, 0.02), rel=0.05)
    assert pull_stiffness_ratio(dem.attraction, LAW, RADIUS) == pytest.approx(steepest / LAW.stiffness_n, rel=0.01)
    assert depth_warning(dem.attraction, LAW, RADIUS) is None
    soft = LinearContact.from_restitution(50.0, 0.6, 0.4)
    assert "raise the stiffness" in depth_warning(dem.attraction, soft, RADIUS)
    usual = choose_time_step(LAW, grains.mass, grains.radius)
    assert choose_time_step(LAW, grains.mass, grains.radius, attraction=1.0) == usual
    tight = choose_time_step(LAW, grains.mass, grains.radius, attraction=1e3 * LAW.stiffness_n)
    assert tight.dt < 0.1 * usual.dt and "attraction" in tight.reason


def test_a_wrong_table_or_drive_is_refused():
    with pytest.raises(ValueError, match=r"they must be \(ng, nh\)"):
        Attraction(0.0, 0.1, VALUES, ACROSS[1:], SMALLEST, alike(1.0))
    for wrong in ({"near_gap": -1.0}, {"smallest": 0.0}, {"values": np.full_like(VALUES, np.nan)}):
        with pytest.raises(ValueError, match=r"allowed|not finite"):
            Attraction(
                0.0, 0.1, wrong.get("values", VALUES), ACROSS, wrong.get("smallest", SMALLEST), alike(1.0),
                near_gap=wrong.get("near_gap", 0.0),
            )  # fmt: skip
    corners = RADIUS * np.array([[-5.0, -5.0, 0.0], [5.0, -5.0, 0.0], [0.0, 5.0, 0.0]])
    floor = TriangleWall("floor", "housing", corners, np.array([[0, 1, 2]]))
    grains = Grains.create([[0.0, 0.0, 1.01 * RADIUS], [3.0 * RADIUS, 0.0, RADIUS]], [RADIUS, RADIUS], DENSITY)
    dem = DEM(grains, [floor], [Body("housing")], LAW, dt=1e-9, skin=3.0 * RADIUS)

    def driven_triangle(dem):
        pair, wall = alike(1.0)(dem)
        return pair, wall + 1.0

    for drives, message in (
        (lambda dem: (np.zeros((7, 3)), np.zeros((1, 2))), "they must be"),
        (alike(1.0, column=4.1), "column"),
        (alike(np.nan), "not finite"),
        (driven_triangle, "a triangle is driven"),
    ):
        dem.attraction = table(drives)
        with pytest.raises(ValueError, match=message):
            dem.run(1)
    dem.attraction = table(alike(1.0), per_grain={"moment": np.zeros((3, 3))})
    with pytest.raises(ValueError, match="one a grain"):
        dem.run(1)
