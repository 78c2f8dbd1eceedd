"""Many rigid grains: conservation, energy, quiet piles, warm starts, restart, cold dense packings."""

import numpy as np
import pytest
from dvi_scenes import DOWN, STEEL, G, R, scaled, swept
from interior_point import solve_by_interior_point

from geometry import Box
from geometry.time_profile import TimeProfile
from geometry.walls import annulus, cylinder
from particles import Body, FreeShaft, Grains
from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import accelerate_records
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

pytestmark = pytest.mark.physics


def _cloud(n, fraction=0.3, seed=1):
    """A cube just as large as n spheres at a solid fraction below 0.4 need, and their places, a shaken lattice."""
    side = int(np.ceil(n ** (1.0 / 3.0)))
    step = 2.0 * R * (np.pi / 6.0 / fraction) ** (1.0 / 3.0)
    sites = np.stack(np.meshgrid(*[np.arange(side) + 0.5] * 3), axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(seed)
    play = 0.5 * (step - 2.0 * R)
    where = step * rng.permutation(sites)[:n] + play * rng.uniform(-1.0, 1.0, (n, 3))
    return Box((side * step,) * 3), where - [0.5 * side * step, 0.5 * side * step, 0.0]


def _bed(n, seed=1, height=1.5, **more):
    box, where = _cloud(n, 0.38, seed)
    high = Box((box.size[0], box.size[1], height * box.size[2]))
    grains = Grains.create(where, R, STEEL)
    dvi = DVI(grains, high.walls(), [Body("housing")], DviContact(0.4), dt=1e-3, gravity=DOWN, **more)
    return dvi


def test_a_collapsing_cloud_keeps_its_momenta():
    """No walls, no gravity: momentum and angular momentum are kept to round-off while no overlap has to be removed."""
    where = _cloud(120, 0.35)[1]
    rng = np.random.default_rng(0)
    velocity = -5.0 * (where - where.mean(axis=0)) + 0.1 * rng.normal(size=where.shape)
    spin = 50.0 * rng.normal(size=where.shape)
    grains = Grains.create(where, R, STEEL, velocity=velocity, angular_velocity=spin)
    dvi = DVI(grains, [], [], DviContact(0.5, 0.3), dt=1e-3, gravity=(0.0, 0.0, 0.0))

    def momenta():
        orbital = np.cross(grains.position, grains.velocity).T @ grains.mass
        return grains.momentum(), orbital + grains.angular_velocity.T @ grains.inertia

    p, spin_before = momenta()
    scale = np.sum(grains.mass * np.linalg.norm(grains.velocity, axis=1))
    energy = grains.kinetic_energy()
    totals = dvi.run(40)
    assert totals.energy_budget.kinetic_energy < 0.5 * energy  # it did collide
    assert totals.projections == 0
    after, spin_after = momenta()
    assert after == pytest.approx(p, abs=1e-13 * scale)
    assert spin_after == pytest.approx(spin_before, abs=1e-13 * scale * 0.1)


def test_energy_never_grows_without_rebound():
    """e = 0, walls at rest, no gravity: every step loses kinetic energy or keeps it; the budget closes to round-off."""
    box, where = _cloud(150)
    rng = np.random.default_rng(4)
    grains = Grains.create(
        where, R, STEEL, velocity=rng.normal(size=where.shape), angular_velocity=30 * rng.normal(size=where.shape)
    )
    dvi = DVI(grains, box.walls(), [Body("housing")], DviContact(0.4), dt=1e-3, gravity=(0.0, 0.0, 0.0))
    energy = grains.kinetic_energy()
    for _ in range(60):
        totals = dvi.run(1)
        now = grains.kinetic_energy()
        assert now <= energy * (1.0 + 1e-12)
        assert totals.energy_budget.kinetic_change == pytest.approx(
            totals.energy_budget.contact_work + totals.energy_budget.gravity_work, abs=1e-12 * energy + 1e-15
        )
        assert sum(totals.energy_budget.dissipation.values()) == pytest.approx(
            totals.energy_budget.dissipated, abs=1e-15
        )
        energy = now


def test_balances_of_a_driven_drum():
    """Torque on the shell = change of the grains' angular momentum (gravity along the axis); energies balance."""
    n = 80
    box, where = _cloud(n, 0.35)
    side = box.size[0]
    radius = 0.5 * np.sqrt(2.0) * side
    walls = [cylinder("shell", "drum", radius, 0.0, 2 * side), annulus("low", "housing", 0.0, 0.0, radius)]
    grains = Grains.create(where, R, STEEL)
    dvi = DVI(grains, walls, [Body("drum", TimeProfile.constant(20.0)), Body("housing")], DviContact(0.5),
              dt=1e-3, gravity=DOWN)  # fmt: skip
    before, kinetic = grains.angular_momentum_z(), grains.kinetic_energy()
    totals = dvi.run(100)
    gained = grains.angular_momentum_z() - before
    given = -(totals.torque_on("drum") + totals.torque_on("housing")) * totals.duration
    assert gained > 0.0
    assert given == pytest.approx(gained, rel=2e-3)  # exact but for overlap removed from positions
    assert totals.energy_budget.wall_work["drum"] == pytest.approx(
        -20.0 * totals.torque_on("drum") * totals.duration, rel=1e-12
    )
    assert totals.energy_budget.kinetic_change == pytest.approx(grains.kinetic_energy() - kinetic)
    assert totals.energy_budget.kinetic_change == pytest.approx(
        totals.energy_budget.contact_work + totals.energy_budget.gravity_work, rel=1e-9
    )
    assert min(totals.energy_budget.dissipation.values()) >= 0.0


def test_a_drum_that_turns_the_other_way_has_the_opposite_torque():
    """The mirror image in y of a bed on springs: places mirrored, torques of the other sign.

    Grains stand in another order, and so are swept in another: what is left is the tolerance. With a friction of 0.5 a
    grain between three others gets other velocities at step 23, though both solves converge: Coulomb friction may have
    more than one solution, and the order of the sweeps then decides.
    """
    where = _cloud(80, 0.35)[1]
    radius = 1.1 * np.hypot(where[:, 0], where[:, 1]).max() + R
    walls = [cylinder("shell", "drum", radius, 0.0, 1.0), annulus("low", "drum", 0.0, 0.0, radius)]
    found = []
    for sign in (1.0, -1.0):
        mirror = np.array([1.0, sign, 1.0])
        grains = Grains.create(where * mirror, R, STEEL, velocity=np.tile([0.5, 1.0, -1.0] * mirror, (80, 1)))
        dvi = DVI(
            grains, walls, [Body("drum", TimeProfile.constant(20.0 * sign))], DviContact(0.2), dt=1e-3, gravity=DOWN,
            stiffness=[[1e6, 3e5], [1e6, 3e5]], tolerance=1e-11,
        )  # fmt: skip
        totals = dvi.run(40)
        assert totals.missed_steps == 0 and totals.n_contacts > 80
        found.append((totals.torque_on("drum"), grains.position[np.argsort(grains.particle_id)] * mirror))
    (torque, position), (opposite, mirrored) = found
    assert torque < 0.0
    assert opposite == pytest.approx(-torque, rel=1e-6)
    assert mirrored == pytest.approx(position, abs=1e-6 * R)


@pytest.mark.hard
def test_a_pile_does_not_creep_in_a_hundred_thousand_steps():
    """Cannon balls, 16 + 9 + 4 + 1 in a box that just holds the lowest layer: rigid, hyperstatic, at rest.

    From the second step on the warm start answers in one sweep. What is left to move it is the tolerance.
    """
    layers = [
        (2.0 * R * x + R * k, 2.0 * R * y + R * k, R + np.sqrt(2.0) * R * k)
        for k in range(4)
        for x in range(4 - k)
        for y in range(4 - k)
    ]
    where = np.array(layers) - [3.0 * R, 3.0 * R, 0.0]
    grains = Grains.create(where, R, STEEL)
    box = Box((8.0 * R, 8.0 * R, 10.0 * R))
    dvi = DVI(grains, box.walls(), [Body("housing")], DviContact(0.3), dt=1e-3, gravity=DOWN, tolerance=1e-10)
    dvi.run(1)
    totals = dvi.run(100_000)
    after = grains.position[np.argsort(grains.particle_id)]
    assert np.linalg.norm(after - where, axis=1).max() < 1e-6 * 2 * R
    assert totals.sweeps < 1.001 * totals.steps
    assert totals.warm_hits > 0.999
    assert totals.missed_steps == 0
    weight = grains.mass.sum() * G
    assert totals.force["housing"] == pytest.approx([0.0, 0.0, -weight], abs=1e-6 * weight)


@pytest.fixture(scope="module")
def settled():
    """The contact problem of a settled bed of 100 grains, with the impulses of the step before."""
    dvi = _bed(100, seed=4, tolerance=1e-6, max_sweeps=1000)
    still = 1e-5 * dvi.grains.mass.sum() * G * R
    for _ in range(20):  # the last grains that roll come to rest late
        dvi.run(300)
        if dvi.grains.kinetic_energy() < still:
            break
    assert dvi.grains.kinetic_energy() < still
    dvi.run(1)
    return dvi._records()


GOAL = 1e-8 * G * 1e-3  # of g h: in impulses, of m g h


@pytest.mark.hard
def test_a_cold_dense_packing_is_solved_where_sweeps_stall(settled):
    """From no impulses at all: the interior point reaches 1e-8 of g h, plain sweeps do not in 5 000."""
    assert swept(GOAL, 5000, scaled(settled, 0.0))[1] > 10.0 * GOAL
    records = scaled(settled, 0.0)
    assert solve_by_interior_point(None, GOAL, *records)[1] <= GOAL
    assert gs.residual_records(None, None, *records) <= GOAL
    weight = np.sum(records[5][:, gs.RZ]) / 1e-3
    assert weight == pytest.approx(np.sum(1.0 / records[0][:, gs.IM]) * G, rel=1e-3)  # a few still roll


def test_an_accelerated_warm_step_reaches_eight_digits(settled):
    """From impulses 0.1 % off: 1e-8 of g h in less than half the plain sweeps."""
    quick = accelerate_records(None, None, GOAL, 5000, *scaled(settled, 0.999))
    assert quick[1] <= GOAL
    assert swept(GOAL, 2 * quick[0], scaled(settled, 0.999))[1] > GOAL


def test_restart_is_bit_exact():
    a = _bed(60, max_sweeps=100)
    a.run(120)
    state = a.state()
    a.run(60)
    b = _bed(60, max_sweeps=100)
    b.restore(state)
    b.run(60)
    for name in ("position", "velocity", "angular_velocity", "particle_id"):
        assert np.array_equal(getattr(a.grains, name), getattr(b.grains, name))
    assert np.array_equal(a.contact_force, b.contact_force)


def test_calls_may_be_cut_anywhere():
    """60 steps in one call or one by one, lists renewed in between: the same bits, shaft with load included."""
    results = []
    for parts in ([60], [1] * 60):
        box, where = _cloud(50, 0.35)
        radius = 0.5 * np.sqrt(2.0) * box.size[0]
        walls = [cylinder("shell", "drum", radius, 0.0, 2 * box.size[2]), annulus("low", "drum", 0.0, 0.0, radius)]
        shaft = Body("drum", FreeShaft(1e-4, drive_torque=0.05, load_torque=TimeProfile.constant(0.01)))
        dvi = DVI(Grains.create(where, R, STEEL), walls, [shaft], DviContact(0.5), dt=1e-3, gravity=DOWN)
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
        ({"solver": "psor"}, "solver"),
    ],
)
def test_bad_settings_are_refused(change, text):
    with pytest.raises(ValueError, match=text):
        DVI(Grains.create([[0.0, 0.0, R]], R, STEEL), [], [], DviContact(0.3), **({"dt": 1e-3} | change))
