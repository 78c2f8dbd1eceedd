"""What must not matter: place, direction, hand, names, restarts; and what is kept: momentum, angular momentum."""

import io
from itertools import pairwise

import numpy as np
import pytest
from dem_laws import BESIDE, DENSITY, EVERYTHING, FLOOR, RADIUS, in_order, law, make_dem
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geometry import Box
from geometry.annular_cell import ShearCell
from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall, box_surface
from geometry.walls import Plane, cylinder, outline
from particles import (
    DEM,
    Body,
    CyclicSector,
    FreeShaft,
    Grains,
    LinearContact,
    choose_time_step,
    pack,
)

pytestmark = pytest.mark.physics

few = settings(max_examples=30, deadline=None)


# ---- angular momentum


@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_momentum_and_angular_momentum_are_kept_to_round_off(name, everything):
    """All three components, of a cluster (of sizes 1 to 3) that falls together, rubs, rolls, twists, sticks, flies."""
    rng = np.random.default_rng(6)
    k = 6.4 * RADIUS * np.arange(-1, 2)
    x = np.stack([a.ravel() for a in np.meshgrid(k, k, k)], axis=1) + rng.normal(size=(27, 3)) * 0.05 * RADIUS
    radius = RADIUS * (rng.uniform(1.0, 3.0, 27) if everything else np.full(27, 3.0))
    v, w = -120.0 * x + 0.2 * rng.normal(size=x.shape), 300.0 * rng.normal(size=x.shape)
    x, v = x + np.array([0.03, 0.01, 0.02]), v + np.array([0.3, 0.0, 0.1])
    grains = Grains.create(x, radius, DENSITY, velocity=v, angular_velocity=w)

    def momenta(g):
        return g.momentum(), g.mass @ np.cross(g.position, g.velocity) + g.inertia @ g.angular_velocity

    before = momenta(grains)
    scale = np.sum(grains.mass * np.linalg.norm(grains.velocity, axis=1))
    arm = np.linalg.norm(grains.position, axis=1).max()
    dem = make_dem(grains, [], [], law(name), everything=everything, overlap_limit=0.3)
    totals = dem.run(8000)
    after = momenta(dem.grains)
    assert min(totals.energy_budget.dissipation.values()) > 1e-4 * totals.energy_budget.dissipated
    assert np.max(np.abs(after[0] - before[0])) < 1e-12 * scale
    assert np.max(np.abs(after[1] - before[1])) < 1e-12 * scale * arm


# ---- symmetry of a small bed


def bed(seed, n=20):
    """A loose cluster of grains of two sizes, stirred and spinning, above z = 0; positions in a shaken lattice."""
    rng = np.random.default_rng(seed)
    k = np.arange(3) * 2.44 * RADIUS
    x = np.stack([a.ravel() for a in np.meshgrid(k, k, k + 1.3 * RADIUS)], axis=1)[:n]
    x = x + rng.uniform(-0.02, 0.02, x.shape) * RADIUS
    radius = RADIUS * np.where(rng.random(n) < 0.5, 1.0, 1.2)
    v = rng.normal(size=x.shape) * 0.3 - 200.0 * (x - x.mean(axis=0))
    return x, radius, v, rng.normal(size=x.shape) * 200.0, np.arange(n) % 2


def run(x, radius, v, w, species, walls=(), bodies=(), gravity=(0.0, 0.0, -9.81), *, contact=None, steps=600):
    grains = Grains.create(x, radius, DENSITY, velocity=v, angular_velocity=w)
    contact = law("linear") if contact is None else contact
    dem = make_dem(grains, list(walls), list(bodies), contact, everything=True, species=species, gravity=gravity)
    begun = grains.kinetic_energy()
    totals = dem.run(steps)
    assert totals.energy_budget.dissipated > 0.2 * begun
    return *in_order(dem.grains), totals


def agree(first, second, turn=None, mirror=None, offset=0.0):
    """Whether the second run is the first, turned (3, 3), mirrored or moved.

    Round-off grows by a factor of a few in each of some ten collisions: 1e-16 of place and speed to below 1e-8.
    """
    turn = np.eye(3) if turn is None else turn
    scales = (RADIUS, 1.0, 1.0 / RADIUS)
    for a, b, scale, axial in zip(first[:3], second[:3], scales, (False, False, True), strict=True):
        moved = a @ turn.T + (offset if scale is RADIUS else 0.0)
        if axial and mirror is not None:
            moved = -moved  # spins are axial vectors: a mirror turns them the other way
        assert np.max(np.abs(b - moved)) < 1e-8 * scale
    for kind, lost in first[3].energy_budget.dissipation.items():
        assert second[3].energy_budget.dissipation[kind] == pytest.approx(
            lost, rel=1e-6, abs=1e-9 * first[3].energy_budget.dissipated
        )


def pen(height=0.02):
    """A floor with a pole of triangles through the bed, and what must move with it."""
    at, size = (3.9 * RADIUS, 3.7 * RADIUS, 0.5 * height), (0.3 * RADIUS, 0.3 * RADIUS, height)
    return [FLOOR, box_surface("pole", "housing", at, size)]


@given(
    seed=st.integers(0, 999), move=st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(np.array), name=st.sampled_from(BESIDE)
)
@few
def test_a_bed_may_be_moved_anywhere_with_its_walls(seed, move, name):
    """Walls on bodies at rest may be moved in x and y too."""
    x, radius, v, w, species = bed(seed)
    walls = pen()
    moved = [
        Plane("floor", "housing", walls[0].point + move, walls[0].normal),
        TriangleWall("pole", "housing", walls[1].vertices + move, walls[1].triangles),
    ]
    first = run(x, radius, v, w, species, walls, [Body("housing")], contact=law(name))
    second = run(x + move, radius, v, w, species, moved, [Body("housing")], contact=law(name))
    agree(first, second, offset=move)


@given(seed=st.integers(0, 999), angle=st.floats(-3.2, 3.2), name=st.sampled_from(BESIDE))
@few
def test_a_bed_may_be_turned_about_the_shaft_with_its_walls(seed, angle, name):
    """Rotor and pole turn as they did; a cylinder and a disc about the axis are what they were."""
    x, radius, v, w, species = bed(seed)
    x = x - [3.0 * RADIUS, 3.0 * RADIUS, 0.0]
    turn = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    drum = [*outline("drum", "rotor", [(0.0, 0.0), (7.0 * RADIUS, 0.0), (7.0 * RADIUS, 0.02)])]
    pole = box_surface("pole", "rotor", (0.9 * RADIUS, 0.7 * RADIUS, 0.01), (0.3 * RADIUS, 0.3 * RADIUS, 0.02))
    results = []
    for rotation in (np.eye(3), turn):
        walls = [*drum, TriangleWall("pole", "rotor", pole.vertices @ rotation.T, pole.triangles)]
        bodies = [Body("rotor", FreeShaft(1e-8, drive_torque=1e-7), speed=50.0)]
        moved = (a @ rotation.T for a in (x, v, w))
        x_, v_, w_ = moved
        results.append((*run(x_, radius, v_, w_, species, walls, bodies, contact=law(name)), bodies[0].speed))
    agree(*results, turn=turn)
    assert results[1][4] == pytest.approx(results[0][4], rel=1e-9)


@given(seed=st.integers(0, 999), number=st.integers(0, 999), name=st.sampled_from(BESIDE))
@few
def test_free_grains_may_be_turned_any_way(seed, number, name):
    x, radius, v, w, species = bed(seed)
    turn = Rotation.random(random_state=number).as_matrix()
    gravity = np.array([1.0, 2.0, -9.81])
    first = run(x, radius, v, w, species, gravity=gravity, contact=law(name))
    second = run(x @ turn.T, radius, v @ turn.T, w @ turn.T, species, gravity=turn @ gravity, contact=law(name))
    agree(first, second, turn=turn)


@given(seed=st.integers(0, 999), axis=st.integers(0, 2), name=st.sampled_from(BESIDE))
@few
def test_a_bed_and_its_mirror_image_move_alike(seed, axis, name):
    """A mirror keeps all but the spins, which are axial: they turn the other way."""
    x, radius, v, w, species = bed(seed)
    mirror = np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))
    walls = pen()
    image = [
        Plane("floor", "housing", mirror @ walls[0].point, mirror @ walls[0].normal),
        TriangleWall("pole", "housing", walls[1].vertices @ mirror, walls[1].triangles),
    ]
    gravity = np.array([0.0, 0.0, -9.81])
    first = run(x, radius, v, w, species, walls, [Body("housing")], gravity, contact=law(name))
    second = run(
        x @ mirror, radius, v @ mirror, -w @ mirror, species, image, [Body("housing")], mirror @ gravity,
        contact=law(name),
    )  # fmt: skip
    agree(first, second, turn=mirror, mirror=True)


@given(seed=st.integers(0, 999), number=st.integers(0, 999), name=st.sampled_from(BESIDE))
@few
def test_names_do_not_matter(seed, number, name):
    """Grains in another order, walls too: sums are added in another order, which round-off alone sees."""
    x, radius, v, w, species = bed(seed)
    order = np.random.default_rng(number).permutation(len(x))
    walls = pen()
    first = run(x, radius, v, w, species, walls, [Body("housing")], contact=law(name))
    moved = (a[order] for a in (x, radius, v, w, species))
    second = run(*moved, walls[::-1], [Body("idle"), Body("housing")], contact=law(name))
    agree(tuple(a[order] for a in first[:3]) + first[3:], second)


# ---- neighbours


@pytest.mark.parametrize("ratio", [1.0, 10.0], ids=["equal", "1 to 10"])
def test_contacts_are_those_of_a_naive_search_at_every_step(ratio):
    """All pairs and all walls, by the definition of touching; fast grains, many lists (1 to 10: every 20 steps)."""
    rng = np.random.default_rng(8)
    x, _, v, w, species = bed(5, 27)
    radius = np.where(rng.random(27) < 0.7, RADIUS, RADIUS / ratio)
    v = -300.0 * (x - x.mean(axis=0)) + 0.3 * rng.normal(size=x.shape)
    rc = 8.0 * RADIUS
    x = x - np.array([2.5, 2.5, 0.0]) * RADIUS
    walls = [FLOOR, cylinder("drum", "housing", rc, 0.0, 0.05)]
    grains = Grains.create(x, radius, DENSITY, velocity=v, angular_velocity=w)
    dem = make_dem(grains, walls, [Body("housing")], law("linear"), everything=True, species=species,
                   gravity=(0.0, 0.0, -9.81), overlap_limit=0.4)  # fmt: skip
    seen = lists = 0
    for _ in range(1500):
        lists += dem.run(1 if ratio == 1.0 else 20).rebuilds
        table, g = dem.contacts(), dem.grains
        reach = g.radius[:, None] + g.radius[None]
        near = np.triu(np.linalg.norm(g.position[:, None] - g.position[None], axis=2) < reach, 1)
        naive = {tuple(pair) for pair in np.argwhere(near).tolist()}
        naive |= {(i, -1) for i in np.flatnonzero(g.position[:, 2] < g.radius).tolist()}
        naive |= {(i, -2) for i in np.flatnonzero(rc - np.hypot(*g.position[:, :2].T) < g.radius).tolist()}
        j = np.where(table.j >= 0, table.j, -1 - table.wall)
        pairs = zip(table.i.tolist(), j.tolist(), strict=True)
        found = [(min(pair), max(pair)) if pair[1] >= 0 else pair for pair in pairs]
        assert len(found) == len(set(found)) and set(found) == naive
        seen += len(naive)
    assert seen > 2000 and lists > 10


# ---- time


def test_gravity_that_turns_and_swings_is_integrated_in_second_order():
    """g(t) = g (cos(w t), sin(w t), t w) without contacts: x(t) in closed form; the error falls by 4."""
    g, rate, end = 9.81, 40.0, 0.2

    def exact(t):
        return g / rate**2 * np.array([1.0 - np.cos(rate * t), rate * t - np.sin(rate * t), (rate * t) ** 3 / 6.0])

    def swinging(times):
        phase = rate * np.asarray(times)
        return g * np.stack([np.cos(phase), np.sin(phase), phase], axis=1)

    errors = []
    for dt in (2e-3, 1e-3, 5e-4):
        grains = Grains.create([[0.0, 0.0, 0.0]], 0.1, DENSITY)
        grains.velocity[0] = -0.5 * dt * swinging([0.0])[0]  # at rest at t = 0, hence half a kick back
        contact = law("linear", m_eff=float(grains.mass[0]), speed=0.01, radius=0.1)
        dem = make_dem(grains, [], [], contact, dt=dt, gravity=swinging)
        dem.run(round(end / dt))
        errors.append(np.abs(dem.grains.position[0] - exact(end)))
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.02)
    assert errors[-1].max() < 2e-4 * np.abs(exact(end)).max()


@pytest.mark.parametrize("name", ["linear", "hertz_mindlin", "walton_braun"])
def test_restart_is_bitwise_with_all_that_is_remembered(name):
    """Springs of friction, rolling and twisting, a hysteretic peak, triangles that turn, species, a free shaft, forces.

    Taken up through a state that has been written to disk and read again, at a step that has not made a list.
    """

    def scene():
        x, radius, v, w, species = bed(3, 27)
        drum = outline("drum", "rotor", [(0.0, 0.0), (8.0 * RADIUS, 0.0), (8.0 * RADIUS, 0.02)])
        vane = box_surface("vane", "disc", (2.0 * RADIUS, 0.0, 0.01), (4.0 * RADIUS, 0.2 * RADIUS, 0.02), angle=0.3)
        ramp = TimeProfile((0.0, 2e-3), (0.0, -90.0))
        bodies = [Body("rotor", FreeShaft(1e-8, 1e-7, TimeProfile.constant(5e-8)), speed=40.0), Body("disc", ramp)]
        x = x - np.array([2.5, 2.5, 0.0]) * RADIUS
        keep = np.abs(Rotation.from_rotvec([0, 0, -0.3]).apply(x)[:, 1]) > 1.4 * RADIUS
        grains = Grains.create(x[keep], radius[keep], DENSITY, velocity=v[keep], angular_velocity=w[keep])
        dem = make_dem(
            grains, [*drum, vane], bodies, law(name), everything=True, species=species[keep],
            gravity=(0.0, 0.0, -9.81), overlap_limit=0.3,
        )  # fmt: skip
        dem.bodies[0].external_torque = 1e-8
        return dem

    straight, first, fresh = scene(), scene(), scene()
    half = int(0.6e-3 / straight.dt)
    straight.run(2 * half)
    for steps in (half - 3, 3):
        first.run(steps)
    saved = first.state()
    history = saved["list_pair_history"]
    # memory and stored energy are the hysteretic law's
    used = np.count_nonzero(np.any(history != 0.0, axis=0))
    columns = first._columns.energy_column + 8
    assert used >= columns - (0 if name == "walton_braun" else 2) and np.any(saved["list_wall_history"] != 0.0)
    file = io.BytesIO()
    np.savez(file, **saved)
    file.seek(0)
    fresh.restore(dict(np.load(file)))
    totals = fresh.run(half)
    goes_on = first.run(half)
    assert totals.torque_on("disc") != 0.0 != totals.torque_on("rotor")
    assert totals.torque == goes_on.torque and totals.energy_budget == goes_on.energy_budget
    for end in (first.state(), straight.state()):
        for key, value in fresh.state().items():
            assert np.array_equal(value, end[key]), key


def test_restart_of_a_sector_is_bitwise():
    """With springs on contacts across the faces."""
    cell, sector = ShearCell(0.006, 0.0085, 0.003), CyclicSector(2.0 * np.pi / 6.0)
    box, r = cell.fill_boxes()["annulus"], 0.25e-3
    count = int(0.5 * box.volume(sector.angle) / (4.0 / 3.0 * np.pi * r**3))
    x = pack([box], cell.walls(), count, r, seed=1, sector=sector)
    contact = LinearContact.from_restitution(500.0, 0.7, 0.5)

    def scene():
        rng = np.random.default_rng(4)
        v = 60.0 * np.cross([0.0, 0.0, 1.0], x) + 0.2 * rng.normal(size=x.shape)
        grains = Grains.create(x, r, 7850.0, velocity=v)
        bodies = [Body("disc"), Body("rotor", TimeProfile.constant(60.0)), Body("housing")]
        dt = choose_time_step(contact, grains.mass, grains.radius).dt
        return DEM(grains, cell.walls(), bodies, contact, dt=dt, periodicity=sector)

    straight, first, fresh = scene(), scene(), scene()
    straight.run(900)
    first.run(451)
    saved = first.state()
    across = (saved["list_pair_shift"] != 0) & (saved["list_pair_touching"] != 0)
    assert np.count_nonzero(np.any(saved["list_pair_history"][across] != 0.0, axis=1)) > 5
    fresh.restore(saved)
    fresh.run(449)
    for key, value in fresh.state().items():
        assert np.array_equal(value, straight.state()[key]), key


def test_a_state_of_before_histories_were_whole_fours_goes_on_to_the_same_bits():
    def scene():
        x, radius, v, w, _ = bed(3, 27)
        grains = Grains.create(x, radius, DENSITY, velocity=v, angular_velocity=w)
        return DEM(grains, Box((1.0, 1.0, 1.0)).walls(), [Body("housing")], law("linear"), dt=1e-6, overlap_limit=0.3)

    first, second, other = scene(), scene(), scene()
    first.run(20)
    state = first.state()
    columns = first._columns.energy_column + 4
    assert state["list_pair_history"].shape[1] > columns
    narrow = state | {name: state[name][:, :columns] for name in ("list_pair_history", "list_wall_history")}
    other.restore(narrow)
    second.restore(state)
    for dem in (second, other):
        dem.run(20)
    assert np.array_equal(second.grains.velocity_force, other.grains.velocity_force)
    with pytest.raises(ValueError, match="remembers 13 numbers, one of this DEM 8"):
        scene().restore(state | {"list_pair_history": np.zeros((len(state["list_pair_history"]), 13))})
