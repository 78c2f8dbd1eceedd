"""Many rigid grains: conservation, energy, quiet piles, warm starts, restart, cold dense packings."""

import numpy as np
import pytest

from geometry import Box
from geometry.walls import annulus, cylinder
from particles import Body, FreeShaft, Grains, PrescribedSpeed, pack
from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import ANDERSON, GAUSS_SEIDEL, solve
from particles.dvi.dvi import DVI
from particles.dvi.interior_point import solve_by_interior_point
from particles.dvi.rigid_contact import RigidContact

G = 9.81
R = 5e-3
DOWN = (0.0, 0.0, -G)


def _cloud(n, fraction=0.3, seed=1):
    side = (n * np.pi / 6.0 / fraction) ** (1.0 / 3.0) * 2.0 * R
    box = Box((side, side, side))
    return box, pack(box, box.walls(), n, R, seed=seed)


def _bed(n, seed=1, height=1.5, **more):
    box, where = _cloud(n, 0.45, seed)
    high = Box((box.size[0], box.size[1], height * box.size[2]))
    grains = Grains.create(where, R, 7850.0)
    dvi = DVI(grains, high.walls(), [Body("housing")], RigidContact(0.4), dt=1e-3, gravity=DOWN, **more)
    return dvi


def test_a_collapsing_cloud_keeps_its_momenta():
    """No walls, no gravity: momentum and angular momentum are kept to round-off while no overlap has to be removed."""
    where = 1.02 * _cloud(120, 0.35)[1]  # apart: packed grains may overlap by 1 %
    rng = np.random.default_rng(0)
    velocity = -5.0 * (where - where.mean(axis=0)) + 0.1 * rng.normal(size=where.shape)
    spin = 50.0 * rng.normal(size=where.shape)
    grains = Grains.create(where, R, 7850.0, velocity=velocity, angular_velocity=spin)
    dvi = DVI(grains, [], [], RigidContact(0.5, 0.3), dt=1e-3, gravity=(0.0, 0.0, 0.0))

    def momenta():
        orbital = np.cross(grains.position, grains.velocity).T @ grains.mass
        return grains.momentum(), orbital + grains.angular_velocity.T @ grains.inertia

    p, spin_before = momenta()
    scale = np.sum(grains.mass * np.linalg.norm(grains.velocity, axis=1))
    energy = grains.kinetic_energy()
    totals = dvi.run(40)
    assert totals.kinetic_energy < 0.5 * energy  # it did collide
    assert totals.projections == 0
    after, spin_after = momenta()
    assert after == pytest.approx(p, abs=1e-13 * scale)
    assert spin_after == pytest.approx(spin_before, abs=1e-13 * scale * 0.1)


def test_energy_never_grows_without_rebound():
    """e = 0, walls at rest, no gravity: every step loses kinetic energy or keeps it; the books close to round-off."""
    box, where = _cloud(150)
    rng = np.random.default_rng(4)
    grains = Grains.create(where, R, 7850.0, velocity=rng.normal(size=where.shape), angular_velocity=30 * rng.normal(size=where.shape))
    dvi = DVI(grains, box.walls(), [Body("housing")], RigidContact(0.4), dt=1e-3, gravity=(0.0, 0.0, 0.0))
    energy = grains.kinetic_energy()
    for _ in range(60):
        totals = dvi.run(1)
        now = grains.kinetic_energy()
        assert now <= energy * (1.0 + 1e-12)
        assert totals.kinetic_change == pytest.approx(totals.contact_work + totals.gravity_work, abs=1e-12 * energy + 1e-15)
        assert sum(totals.dissipation.values()) == pytest.approx(totals.dissipated, abs=1e-15)
        energy = now


def test_balances_of_a_driven_drum():
    """Torque on the shell = change of the grains' angular momentum (gravity along the axis); energy books close."""
    n = 80
    box, where = _cloud(n, 0.4)
    side = box.size[0]
    radius = 0.5 * np.sqrt(2.0) * side
    walls = [cylinder("shell", "drum", radius, 0.0, 2 * side), annulus("low", "housing", 0.0, 0.0, radius)]
    grains = Grains.create(where, R, 7850.0)
    dvi = DVI(grains, walls, [Body("drum", PrescribedSpeed.constant(20.0)), Body("housing")], RigidContact(0.5),
              dt=1e-3, gravity=DOWN)  # fmt: skip
    before, kinetic = grains.angular_momentum_z(), grains.kinetic_energy()
    totals = dvi.run(100)
    gained = grains.angular_momentum_z() - before
    given = -(totals.torque_on("drum") + totals.torque_on("housing")) * totals.duration
    assert gained > 0.0
    assert given == pytest.approx(gained, rel=2e-3)  # positions drift at new velocities: x' x v', O(h)
    assert totals.wall_work["drum"] == pytest.approx(-20.0 * totals.torque_on("drum") * totals.duration, rel=1e-12)
    assert totals.kinetic_change == pytest.approx(grains.kinetic_energy() - kinetic)
    assert totals.kinetic_change == pytest.approx(totals.contact_work + totals.gravity_work, rel=1e-9)
    assert min(totals.dissipation.values()) >= 0.0


def test_a_settled_pile_rests_and_its_warm_start_takes_one_sweep():
    """After settling, 2 000 steps move no grain by 1e-5 of a diameter, at a sweep a step; the floor bears the weight."""
    dvi = _bed(60, tolerance=1e-6, max_sweeps=5000)
    dvi.run(800)
    order = np.argsort(dvi.grains.particle_id)
    before = dvi.grains.position[order].copy()
    totals = dvi.run(2000)
    after = dvi.grains.position[np.argsort(dvi.grains.particle_id)]
    assert np.linalg.norm(after - before, axis=1).max() < 1e-5 * 2 * R
    assert totals.sweeps < 1.05 * totals.steps
    assert totals.warm_hits > 0.999
    assert totals.missed_steps == 0
    assert totals.force["housing"] == pytest.approx([0.0, 0.0, -dvi.grains.mass.sum() * G], abs=1e-3 * dvi.grains.mass.sum() * G)
    assert totals.max_overlap < 1e-3


@pytest.fixture(scope="module")
def settled():
    """The contact problem of a bed of 100 grains at rest, with the impulses of the step before."""
    dvi = _bed(100, seed=2, tolerance=1e-6, max_sweeps=1000)
    dvi.run(600)
    assert dvi.grains.kinetic_energy() < 1e-9 * dvi.grains.mass.sum() * G * R
    dvi.run(1)
    return dvi._records()


def _scaled(problem, factor):
    """The same problem started from impulses times ``factor``, velocities along with them."""
    records = [a.copy() for a in problem]
    gs.apply_impulses(-1.0, *records)
    for rows in (records[3], records[5]):
        rows[:, gs.RX : gs.RZ + 1] *= factor
    gs.apply_impulses(1.0, *records)
    return records


GOAL = 1e-8 * G * 1e-3  # of g h: in impulses, of m g h


def test_a_cold_dense_packing_is_solved_where_sweeps_stall(settled):
    """From no impulses at all: the interior point reaches 1e-8 of g h, plain sweeps do not in 5 000."""
    assert solve(None, None, GAUSS_SEIDEL, GOAL, 5000, *_scaled(settled, 0.0))[1] > 100.0 * GOAL
    records = _scaled(settled, 0.0)
    assert solve_by_interior_point(None, GOAL, *records)[1] <= GOAL
    assert gs.residual(None, *records) <= GOAL
    weight = np.sum(records[5][:, gs.RZ]) / 1e-3
    assert weight == pytest.approx(np.sum(1.0 / records[0][:, gs.IM]) * G, rel=1e-6)


def test_an_accelerated_warm_step_reaches_eight_digits(settled):
    """From impulses 0.1 % off: 1e-8 of g h in less than half the plain sweeps."""
    quick = solve(None, None, ANDERSON, GOAL, 5000, *_scaled(settled, 0.999))
    assert quick[1] <= GOAL
    assert solve(None, None, GAUSS_SEIDEL, GOAL, 2 * quick[0], *_scaled(settled, 0.999))[1] > GOAL


def test_restart_is_bit_exact():
    a = _bed(60)
    a.run(120)
    state = a.state()
    a.run(60)
    b = _bed(60)
    b.restore(state)
    b.run(60)
    for name in ("position", "velocity", "angular_velocity", "particle_id"):
        assert np.array_equal(getattr(a.grains, name), getattr(b.grains, name))
    assert np.array_equal(a.contact_force, b.contact_force)


def test_calls_may_be_cut_anywhere():
    """60 steps in one call or one by one, lists renewed in between: the same bits, shaft with load included."""
    results = []
    for parts in ([60], [1] * 60):
        box, where = _cloud(50, 0.4)
        radius = 0.5 * np.sqrt(2.0) * box.size[0]
        walls = [cylinder("shell", "drum", radius, 0.0, 2 * box.size[2]), annulus("low", "drum", 0.0, 0.0, radius)]
        shaft = Body("drum", FreeShaft(1e-4, drive_torque=0.05, load_torque=0.01))
        dvi = DVI(Grains.create(where, R, 7850.0), walls, [shaft], RigidContact(0.5), dt=1e-3, gravity=DOWN)
        for steps in parts:
            dvi.run(steps)
        results.append((dvi.grains.position.copy(), dvi.grains.angular_velocity.copy(), shaft.speed, shaft.angle))
    assert np.array_equal(results[0][0], results[1][0]) and np.array_equal(results[0][1], results[1][1])
    assert results[0][2:] == results[1][2:]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"dt": 0.0}, "dt"),
        ({"theta": 0.3}, "theta"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"solver": "fast"}, "solver"),
        ({"solver": "psor"}, "convex"),
    ],
)
def test_bad_settings_are_refused(change, text):
    with pytest.raises(ValueError, match=text):
        DVI(Grains.create([[0.0, 0.0, R]], R, 7850.0), [], [], RigidContact(0.3), **({"dt": 1e-3} | change))
