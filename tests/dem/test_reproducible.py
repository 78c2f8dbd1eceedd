"""Bit for bit: any number of threads, any split of the steps, restart, absent parts; explained stops."""

import numba
import numpy as np
import pytest

from geometry.box import Box
from particles import DEM, Body, DemError, Grains, LinearContact, RollingFriction, choose_time_step, pack
from particles.dem.total_columns import N_BODY_SUMS, N_SUMS

LAW = LinearContact.from_restitution(2e4, 0.6, 0.4)


def _scene(count=600, *, gravity=(0.0, 0.0, -9.81), speed=1.5):
    r = 0.5e-3
    side = (count * 4 / 3 * np.pi * r**3 / 0.5) ** (1 / 3)
    box = Box((side, side, side))
    grains = Grains.create(pack(box, box.walls(), count, r, seed=5), r, 7850.0)
    grains.velocity[:] = np.random.default_rng(1).normal(size=(count, 3)) * speed
    dt = choose_time_step(LAW, grains.mass, grains.radius).dt
    return DEM(grains, box.walls(), [Body("housing")], LAW, dt=dt, gravity=gravity)


def _same(a, b):
    sa, sb = a.state(), b.state()
    assert sa.keys() == sb.keys()
    return [name for name in sa if not np.array_equal(sa[name], sb[name])]


def test_one_and_two_threads_agree_bitwise():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one core only")
    one, two = _scene(), _scene()
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        first = one.run(400)
        numba.set_num_threads(2)
        second = two.run(400)
    finally:
        numba.set_num_threads(before)
    assert _same(one, two) == []
    assert first.rebuilds > 2 and first.n_contacts > 100
    assert first.torque == second.torque and first.energy_budget.dissipation == second.energy_budget.dissipation


def test_splitting_a_run_changes_nothing():
    whole, parts = _scene(200), _scene(200)
    whole.run(300)
    for k in (1, 99, 130, 70):
        parts.run(k)
    assert _same(whole, parts) == []


def test_restart_is_bitwise_with_history():
    straight, first = _scene(200), _scene(200)
    straight.run(500)
    first.run(230)
    saved = first.state()
    assert np.abs(saved["list_pair_history"]).max() > 0.0
    fresh = _scene(200)
    fresh.restore(saved)
    assert fresh.time == first.time
    fresh.run(270)
    assert _same(straight, fresh) == []


def test_state_of_another_scene_is_refused():
    with pytest.raises(ValueError, match="restore it into the scene"):
        _scene(200).restore(_scene(201).state())


def test_beginning_with_the_grains_of_another_run_goes_on_at_time_0():
    """As that run itself would continue, but for round-off: the list is rebuilt. Resting springs would not."""
    straight, first = _scene(200), _scene(200)
    straight.run(500)
    first.run(230)
    fresh = _scene(200)
    fresh.begin_with(first.state())
    assert fresh.time == 0.0
    fresh.run(270)
    by_number = [np.argsort(dem.grains.particle_id) for dem in (straight, fresh)]
    expected, found = (d.grains.position[k] for d, k in zip((straight, fresh), by_number, strict=True))
    assert found == pytest.approx(expected, abs=1e-6 * first.grains.radius[0])
    forgetful = _scene(200)
    state = first.state()
    state["list_pair_touching"][:] = 0
    forgetful.begin_with(state)
    forgetful.run(270)
    order = np.argsort(forgetful.grains.particle_id)
    assert np.abs(forgetful.grains.position[order] - expected).max() > 1e-4 * first.grains.radius[0]


def test_energy_is_balanced_from_the_first_step_on_under_a_stiffer_law():
    """What the springs of the other run store under this one's law is what the energy budget begins with."""
    first = _scene(200, speed=3.0)
    first.run(150)
    stiffer = LinearContact.from_restitution(8e4, 0.6, 0.4)
    dt = choose_time_step(stiffer, first.grains.mass, first.grains.radius).dt
    fresh = DEM(Grains.of_records(first.state()), first.walls, [Body("housing")], stiffer, dt=dt, gravity=(0, 0, -9.81))
    fresh.begin_with(first.state())
    budget = fresh.run(20).energy_budget
    lost = sum(budget.dissipation.values())
    left = budget.gravity_work - lost - budget.kinetic_change - budget.elastic_change
    assert abs(left) < 0.02 * (lost + abs(budget.elastic_change))
    work = budget.contact_work + budget.gravity_work + budget.external_work
    assert budget.kinetic_change == pytest.approx(work, rel=1e-9)


def test_grains_whose_contacts_remember_something_else_are_refused():
    scene = _scene(50)
    rolling = DEM(scene.grains, scene.walls, scene.bodies, LAW, dt=scene.dt, rolling=RollingFriction(0.1))
    with pytest.raises(ValueError, match="same kind of contact law"):
        _scene(50).begin_with(rolling.state())


def test_a_part_that_is_off_is_absent():
    """Setting a force and taking it away again leaves the program as it was: no such argument."""
    never, once = _scene(150), _scene(150)
    once.external_force = np.ones((150, 3))
    once.external_force = None
    never.run(200)
    once.run(200)
    assert _same(never, once) == []
    assert "external_force" not in once.state()
    given = once._arguments(1, True, np.zeros(1), np.zeros(1), np.zeros(N_SUMS), np.zeros((1, N_BODY_SUMS)), None)
    assert given.grains.external.shape == (0, 3) and given.grains.gravity.shape == (1, 3)


def test_external_force_follows_its_grain_when_grains_are_sorted():
    dem = _scene(150, gravity=None, speed=2.0)
    dem.external_force = 1e-6 * dem.grains.particle_id[:, None] * np.array([1.0, 0.0, 0.0])
    version = dem.order_version
    dem.run(600)
    assert dem.order_version > version
    assert np.array_equal(dem.external_force[:, 0], 1e-6 * dem.grains.particle_id)


def test_naive_search_gives_the_same_contacts_at_every_step():
    dem = _scene(150, speed=1.0)
    for _ in range(150):
        dem.run(1)
        table = dem.contacts()
        x, r = dem.grains.position.copy(), dem.grains.radius.copy()
        near = np.linalg.norm(x[:, None] - x[None], axis=2) < r[:, None] + r[None]
        naive = {tuple(sorted(p)) for p in np.argwhere(np.triu(near, 1)).tolist()}
        found = {tuple(sorted(p)) for p in zip(table.i.tolist(), table.j.tolist(), strict=True) if p[1] >= 0}
        assert found == naive


def test_contact_table_adds_up_to_the_force_on_each_grain():
    dem = _scene(150)
    dem.run(200)
    table, total = dem.contacts(), np.zeros((150, 3))
    dem.run(1)  # the table holds the forces that this step feels
    np.add.at(total, table.i, table.force)
    between = table.j >= 0
    np.add.at(total, table.j[between], -table.force[between])
    assert total == pytest.approx(dem.contact_force, abs=1e-12)
    assert (table.wall >= 0).sum() > 0


def test_deep_overlap_stops_with_place_and_remedy():
    grains = Grains.create([[0.0, 0.0, 5e-3], [0.5e-3, 0.0, 5e-3]], 0.5e-3, 7850.0)
    dem = DEM(grains, Box((0.02, 0.02, 0.02)).walls(), [Body("housing")], LAW, dt=1e-6, gravity=(0, 0, -9.81))
    with pytest.raises(DemError, match=r"grain 0 at \(x, y, z\) = .* 50 % of .*raise the stiffness"):
        dem.run(10)


def test_two_grains_on_one_spot_stop_without_nan():
    grains = Grains.create([[0.0, 0.0, 5e-3]] * 2, 0.5e-3, 7850.0)
    dem = DEM(grains, Box((0.02, 0.02, 0.02)).walls(), [Body("housing")], LAW, dt=1e-6, gravity=(0, 0, -9.81))
    with pytest.raises(DemError, match="100 % of the diameter"):
        dem.run(10)


def test_not_a_number_stops_with_the_grain():
    dem = _scene(150, gravity=None)
    force = np.zeros((150, 3))
    force[np.flatnonzero(dem.grains.particle_id == 17)[0], 1] = np.nan
    dem.external_force = force
    with pytest.raises(DemError, match=r"grain 17 .* not a finite number"):
        dem.run(3)


def test_escape_stops_the_run():
    dem = _scene(150)
    k = int(np.flatnonzero(dem.grains.particle_id == 3)[0])
    dem.grains.position[k] = [0.0, 0.0, -5e-3]
    dem.invalidate()
    with pytest.raises(DemError, match=r"grain 3 .* left the device"):
        dem.run(3)


def test_step_too_long_for_the_contact_is_refused():
    grains = Grains.create([[0.0, 0.0, 5e-3]], 0.5e-3, 7850.0)
    with pytest.raises(ValueError, match="5 steps per contact"):
        DEM(grains, [], [], LAW, dt=1e-3)


def test_a_grain_that_could_pass_through_another_stops_the_run():
    """Two grains that meet at 5 km/s: in a step of 1 us they would change places without touching."""
    grains = Grains.create(
        [[-2e-3, 0.0, 5e-3], [2e-3, 0.0, 5e-3]], 0.5e-3, 7850.0, velocity=[[2500, 0, 0], [-2500, 0, 0]]
    )
    dem = DEM(grains, Box((0.02, 0.02, 0.02)).walls(), [Body("housing")], LAW, dt=1e-6)
    with pytest.raises(DemError, match=r"grain [01] at .*at 2.5e\+03 m/s it moves 5 radii .*shorten dt"):
        dem.run(10)


def test_contact_table_changes_nothing_even_when_the_list_is_stale():
    looked, left_alone = _scene(300), _scene(300)
    stale = 0
    for _ in range(200):
        looked.run(1)
        left_alone.run(1)
        stale += looked._stale
        looked.contacts()
    assert stale > 1
    assert _same(looked, left_alone) == []
