"""Threads that share the sweeps of rigid grains: no bit depends on their number, no law on the shares."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from geometry import Box
from geometry.time_profile import TimeProfile
from geometry.triangle_wall import box_surface
from geometry.walls import annulus, cylinder
from particles import DVI, Body, CyclicSector, DviContact, FreeShaft, Grains
from particles.dvi import gauss_seidel as gs
from particles.dvi import sweep_chunks
from particles.laws.rolling_friction import RollingFriction
from particles.laws.twisting_friction import TwistingFriction
from particles.neighbours.neighbour_list import cell_order, find_pairs

pytestmark = pytest.mark.physics

G = 9.81
R = 5e-3
DOWN = (0.0, -G, 0.0)
STIFF = [[1e6, 3e5], [1e6, 3e5]]


@pytest.fixture(autouse=True)
def one_thread():
    """Unless a test asks for more: on a busy machine threads wait for each other."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture
def few_are_worth_sharing(monkeypatch):
    monkeypatch.setattr(sweep_chunks, "WORTH_SHARING", 100)


def _lattice(size, count, seed=0):
    """The lowest ``count`` places of a shaken lattice in a cuboid about the z axis, on z = 0."""
    pitch = 2.3 * R
    sites = np.stack(np.meshgrid(*[np.arange(int(s / pitch)) + 0.5 for s in size], indexing="ij"), axis=-1)
    where = pitch * sites.reshape(-1, 3) - [0.5 * size[0], 0.5 * size[1], 0.0]
    where = where[np.argsort(where[:, 2], kind="stable")][:count]
    return where + 0.05 * R * np.random.default_rng(seed).uniform(-1.0, 1.0, where.shape)


def _box(n, **more):
    side = 2.3 * R * (np.ceil((n / 2.0) ** (1.0 / 3.0)) + 0.1)
    box = Box((side, side, 3.0 * side))
    where = _lattice(box.size, n)
    spin = np.random.default_rng(1).normal(size=(n, 3))
    radius = R * (1.0 + 0.05 * np.sin(np.arange(n)))
    grains = Grains.create(where, radius, 7850.0, velocity=np.tile([0.2, 0.3, -1.0], (n, 1)), angular_velocity=spin)
    gravity = (2.0, 3.0, -G)
    return DVI(grains, box.walls(), [Body("housing")], DviContact(0.4, 0.2), dt=1e-3, gravity=gravity, **more)


def _drum(n, vanes=False, **more):
    """A drum on a free shaft, braked; with ``vanes`` two on it, and a paddle between that is driven against them."""
    radius, length = 9.0 * R, 2.3 * R * (n / 18.0 + 1.0)
    walls = [
        cylinder("shell", "drum", radius, 0.0, length),
        annulus("low", "housing", 0.0, 0.0, radius),
        annulus("high", "drum", length, 0.0, radius),
    ]
    bodies = [Body("drum", FreeShaft(5e-3, drive_torque=0.3, load_torque=TimeProfile.constant(0.02))), Body("housing")]
    if vanes:
        for name, angle in (("one", 0.0), ("two", np.pi)):
            middle = 8.0 * R * np.array([np.cos(angle), np.sin(angle), 0.0])
            walls.append(box_surface(name, "drum", (*middle[:2], 0.5 * length), (2.0 * R, 0.5 * R, length)))
        walls.append(box_surface("paddle", "paddle", (0.0, 0.0, 0.5 * length), (4.0 * R, 0.5 * R, length)))
        bodies.append(Body("paddle", TimeProfile.constant(-6.0)))
    where = _lattice((11.6 * R, 11.6 * R, length), 100_000)
    clear = np.hypot(where[:, 0], where[:, 1]) < 7.5 * R
    if vanes:
        clear &= (np.abs(where[:, 1]) > 1.5 * R) | (np.abs(where[:, 0]) > 3.5 * R) & (np.abs(where[:, 0]) < 5.5 * R)
    assert np.count_nonzero(clear) >= n
    grains = Grains.create(where[clear][:n], R, 7850.0, velocity=np.tile([0.0, -1.0, 0.0], (n, 1)))
    return DVI(grains, walls, bodies, DviContact(0.3), dt=1e-3, gravity=DOWN, **more)


def _vanes(n, **more):
    return _drum(n, vanes=True, rolling=RollingFriction(0.1), twisting=TwistingFriction(0.05), **more)


def _sector(n, **more):
    """A wedge of 20 degrees between a core and a drum that is on a free shaft and carries the grains round."""
    core, radius, wedge = 40.0 * R, 60.0 * R, CyclicSector(np.pi / 9.0)
    walls = [
        cylinder("core", "core", core, 0.0, 1.0),
        cylinder("shell", "drum", radius, 0.0, 1.0),
        annulus("low", "drum", 0.0, core, radius),
    ]
    bodies = [Body("core"), Body("drum", FreeShaft(1.0), speed=3.0)]
    r, angle, z = np.meshgrid(
        np.arange(41.2, 59.0, 2.3) * R, (np.arange(6) + 0.5) * wedge.angle / 6.0, np.arange(1.1, 60.0, 2.3) * R
    )  # fmt: skip
    where = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1).reshape(-1, 3)
    where = where[np.argsort(where[:, 2], kind="stable")][:n]
    around = 2.0 * np.stack([-where[:, 1], where[:, 0], 0.0 * where[:, 2]], axis=1)
    grains = Grains.create(where, R, 7850.0, velocity=around)
    more = {"rolling": RollingFriction(0.1)} | more
    return DVI(grains, walls, bodies, DviContact(0.4), dt=1e-3, gravity=(0.0, 0.0, -G), periodicity=wedge, **more)


def _with_threads(threads, make, n, steps, **more):
    numba.set_num_threads(threads)
    dvi = make(n, **more)
    return dvi, [dvi.run(steps // 2), dvi.run(steps // 2)]


def _differences(a, b):
    one, two = a.state(), b.state()
    assert one.keys() == two.keys()
    return [name for name in one if not np.array_equal(one[name], two[name])]


@pytest.mark.skipif(
    numba.config.NUMBA_NUM_THREADS < 2,
    reason="numba began with one thread and cannot be given a second; test_four_threads has its own",
)
@pytest.mark.usefixtures("few_are_worth_sharing")
@pytest.mark.parametrize(
    ("make", "n", "steps", "more"),
    [
        (_box, 400, 40, {"stiffness": STIFF}),
        (_box, 3000, 24, {"tolerance": 1e-4, "stiffness": STIFF}),
        (_drum, 300, 60, {"max_sweeps": 200}),
        (_drum, 3000, 20, {"max_sweeps": 100}),
        (_vanes, 300, 60, {"tolerance": 1e-4, "stiffness": STIFF}),
        (_sector, 600, 60, {"tolerance": 1e-5, "stiffness": STIFF}),
    ],
)
def test_one_and_two_threads_agree_bitwise(make, n, steps, more):
    one, first = _with_threads(1, make, n, steps, **more)
    two, second = _with_threads(2, make, n, steps, **more)
    assert len(one._chunks.rows) > 4  # chunks that two threads do have
    assert sum(t.rebuilds for t in first) > 1 and first[-1].n_contacts > n // 2 and first[-1].accelerated_steps > 0
    assert _differences(one, two) == []
    assert repr(first) == repr(second)


def test_four_threads_agree_bitwise():
    """In a process of its own: numba starts no more threads than there are cores unless asked at the start."""
    script = (
        "import sys, numba, numpy as np; sys.path.insert(0, sys.argv[1]); import test_threads as t\n"
        "t.sweep_chunks.WORTH_SHARING = 100\n"
        "runs = [t._with_threads(k, t._box, 3000, 16, max_sweeps=40, stiffness=t.STIFF) for k in (1, 2, 4)]\n"
        "assert numba.config.NUMBA_NUM_THREADS == 4 and len(runs[0][0]._chunks.rows) > 8\n"
        "print([t._differences(runs[0][0], r[0]) for r in runs[1:]], len({repr(r[1]) for r in runs}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, os.path.dirname(__file__)],
        env={**os.environ, "NUMBA_NUM_THREADS": "4", "OMP_WAIT_POLICY": "passive"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "[[], []] 1"


@pytest.mark.usefixtures("few_are_worth_sharing")
def test_a_restart_goes_on_bit_for_bit():
    whole, parts = _box(400, stiffness=STIFF), _box(400, stiffness=STIFF)
    whole.run(30)
    parts.run(13)
    other = _box(400, stiffness=STIFF)
    other.restore(parts.state())
    other.run(17)
    assert _differences(whole, other) == []


@pytest.mark.parametrize(
    ("make", "more"), [(_box, {"stiffness": STIFF}), (_drum, {"stiffness": STIFF}), (_vanes, {"stiffness": STIFF})]
)
def test_the_solution_does_not_depend_on_the_shares(make, more, monkeypatch):
    """Springs make it unique: from one state, all at once and by chunks reach the same velocities and torques."""
    monkeypatch.setattr(sweep_chunks, "WORTH_SHARING", 100)
    dvi = make(300, tolerance=1e-10, **more)
    dvi.run(60)
    state = dvi.state()
    answers = []
    for worth in (100, 1000):
        monkeypatch.setattr(sweep_chunks, "WORTH_SHARING", worth)
        again = make(300, tolerance=1e-10, **more)
        again.restore(state)
        assert (again._chunks is None) == (worth == 1000)
        totals = again.run(1)
        assert totals.missed_steps == 0 and totals.n_contacts > 300
        answers.append((again, totals))
    (one, first), (two, second) = answers
    assert one.grains.velocity == pytest.approx(two.grains.velocity, abs=1e-7)
    assert one.grains.angular_velocity == pytest.approx(two.grains.angular_velocity, abs=1e-7 / R)
    for a, b in zip(one.bodies, two.bodies, strict=True):
        assert a.speed == pytest.approx(b.speed, abs=1e-6)
        assert first.torque_on(a.name) == pytest.approx(second.torque_on(a.name), abs=1e-5)
        assert first.force[a.name] == pytest.approx(second.force[a.name], abs=1e-4)
    assert first.n_contacts == second.n_contacts
    assert first.energy_budget.contact_work == pytest.approx(second.energy_budget.contact_work, abs=1e-9)
    assert first.max_overlap == second.max_overlap


@pytest.mark.usefixtures("few_are_worth_sharing")
def test_books_balance_and_the_residual_is_honest():
    """Kinetic energy changes by the works of contacts and gravity; the residual is that of the records."""
    dvi = _drum(300, stiffness=STIFF)
    dvi.run(60)
    totals = dvi.run(1)
    energy_budget = totals.energy_budget
    change = energy_budget.contact_work + energy_budget.gravity_work
    assert energy_budget.kinetic_change == pytest.approx(change, rel=1e-9, abs=1e-12)
    assert totals.residual == pytest.approx(gs.residual_records(None, dvi._compliance, *dvi._records()), rel=1e-12)
    assert 0.0 < totals.residual <= dvi.tolerance


def _chunks_of(position, radius, skin=0.2 * R):
    order = cell_order(position, 2.0 * float(radius.max()) + skin)
    pairs = find_pairs(position[order], 2.0 * float(radius.max()) + skin, None, (radius + 0.5 * skin)[order])
    made = sweep_chunks.make_sweep_chunks(
        pairs.start, pairs.other, np.zeros(len(position) + 1, dtype=np.int64), (1, 1), 14
    )
    return pairs, made.rows


@pytest.mark.usefixtures("few_are_worth_sharing")
@pytest.mark.parametrize("shape", ["bed", "ring", "sizes", "plate", "line"])
def test_shares_of_one_turn_have_no_grain_in_common(shape):
    rng = np.random.default_rng(2)
    n = 4000
    radius = np.full(n, R)
    side = 2.0 * R * (n * np.pi / 6.0 / 0.6) ** (1.0 / 3.0)
    where = rng.uniform(0.0, side, (n, 3))
    if shape == "ring":
        angle = rng.uniform(0.0, 2.0 * np.pi, n)
        where = np.stack([30 * R * np.cos(angle), 30 * R * np.sin(angle), rng.uniform(0.0, 60 * R, n)], axis=1)
    elif shape == "sizes":
        radius = R * rng.uniform(0.2, 1.0, n)
    elif shape == "plate":
        where = rng.uniform(0.0, 1.0, (n, 3)) * [160 * R, 160 * R, 2.0 * R]
    elif shape == "line":
        where = np.arange(n)[:, None] * [2.0 * R, 0.0, 0.0]
    pairs, rows = _chunks_of(where, radius)
    assert len(rows) > 8 and rows[0] == 0 and rows[-1] == n
    owner = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
    for turn in range(2):
        touched = np.full(n, -1)
        mine = owner[pairs.rows()] % 2 == turn
        first, second, chunk = pairs.rows()[mine], pairs.other[mine], owner[pairs.rows()][mine]
        for grain in (first, second):
            assert np.all((touched[grain] == -1) | (touched[grain] == chunk))
            touched[grain] = chunk
    counts = np.diff(pairs.start[rows])
    assert counts.max() < 2.0 * counts.mean()


@pytest.mark.usefixtures("few_are_worth_sharing")
def test_grains_that_all_touch_each_other_are_one_share():
    where = np.random.default_rng(3).uniform(-0.5 * R, 0.5 * R, (150, 3))
    assert list(_chunks_of(where, np.full(150, R))[1]) == [0, 150]


def test_few_grains_are_not_shared():
    assert _box(300)._chunks is None
