"""Compliant contacts: restitution, statics, the limits h -> 0 (DEM) and k -> infinity (rigid), jams, energy."""

import numpy as np
import pytest
from dvi_scenes import STEEL, G, R, lattice, swept

from geometry import Box
from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall
from geometry.walls import Plane, annulus
from particles import DEM, Body, Grains, LinearContact
from particles.dvi import gauss_seidel as gs
from particles.dvi.compliance import ROOTS, calibrated, rebound
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact
from particles.laws.restitution import damping_ratio

pytestmark = pytest.mark.physics

K = 1e6
STIFF = ((K, 2.0 / 7.0 * K), (K, 2.0 / 7.0 * K))
MASS = STEEL * 4.0 / 3.0 * np.pi * R**3
CONTACT_TIME = np.pi * np.sqrt(0.5 * MASS / K)  # of two spheres


def _pairs(gaps, speed, h, e, mu=0.3):
    """Two spheres at each distance, side by side, approaching each other at ``speed``: first all below, then above."""
    n = len(gaps)
    low = np.column_stack((10.0 * R * np.arange(n), np.zeros((n, 2))))
    high = low + np.column_stack((np.zeros((n, 2)), 2.0 * R + gaps))
    grains = Grains.create(np.concatenate((low, high)), R, STEEL)
    grains.velocity[:n, 2], grains.velocity[n:, 2] = 0.5 * speed, -0.5 * speed
    return DVI(grains, [], [], DviContact(mu, e, threshold=1e-3), dt=h, tolerance=1e-12, stiffness=STIFF)


@pytest.mark.parametrize("e", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("ratio", [0.03, 0.2, 0.45, 1.0, 3.0])
def test_binary_impacts_have_the_restitution_asked_for(e, ratio):
    """In the mean over where in a step the contact begins, whether the step resolves it or not; none gains energy."""
    h = ratio * CONTACT_TIME
    dvi = _pairs((np.arange(8) + 0.5) / 8.0 * h, 1.0, h, e)
    dvi.run(int(4.0 / ratio) + 8)
    speed = dvi.grains.velocity[np.argsort(dvi.grains.particle_id), 2]
    rebounds = speed[8:] - speed[:8]
    assert np.mean(rebounds) == pytest.approx(e, rel=0.02)
    assert np.max(rebounds) < 1.0


def test_the_calibration_meets_dashpots_that_are_known():
    """For short steps K = 2 zeta sqrt(a) of the dashpot that `LinearContact` finds for the same restitution."""
    for e in (0.3, 0.6, 0.9):
        fraction, met = calibrated(ROOTS[:1], e)
        assert met[0]
        # first order in the step: the fraction of backward Euler, a, is in it
        assert fraction[0] == pytest.approx(2.0 * damping_ratio(e) * ROOTS[0], abs=1.5 * ROOTS[0] ** 2)


def test_no_share_lets_an_impact_gain_energy():
    for root in (0.3, 1.0, 2.0, 5.0, 30.0):
        least = np.array([max(0.25 * root**2, root * (root - 2.0))])
        assert rebound(np.array([root]), least).max() < 1.0


@pytest.mark.parametrize("mode", [1.0, 1.5, 2.0, 4.0])
def test_no_mode_of_a_group_grows(mode):
    """Groups vibrate at up to 4 times the k/m of a pair: a straight chain at 2, a dense crystal at 4."""
    for e in (0.1, 0.5, 0.9):
        fraction, _ = calibrated(ROOTS, e)
        a, share = mode * ROOTS**2, 1.0 / (1.0 + 1.0 / (mode * fraction))
        trace, determinant = 2.0 - share - a / (mode * fraction) * share, 1.0 - share
        real = np.sqrt(np.maximum(trace**2 - 4.0 * determinant, 0.0))
        largest = np.where(trace**2 > 4.0 * determinant, 0.5 * (np.abs(trace) + real), np.sqrt(determinant))
        assert largest.max() <= 1.0 + 1e-9


@pytest.mark.parametrize("ratio", [0.7, 0.85, 1.0, 2.0])
def test_a_pressed_chain_comes_to_rest(ratio):
    """Eight spheres on a floor under a force: at steps of about a contact time too nothing keeps vibrating.

    With a K of a quarter of a, enough for pairs, speeds stay at two thirds of what the force gives a lone sphere.
    """
    count, h, force = 8, ratio * CONTACT_TIME, 50.0
    x = np.zeros((count, 3))
    x[:, 2] = R * (1.0 + 2.0 * np.arange(count))
    walls = [Plane("floor", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0]))]
    dvi = DVI(Grains.create(x, R, STEEL), walls, [Body("housing")], DviContact(0.3, 0.5, threshold=1e-3), dt=h,
              tolerance=1e-10, max_sweeps=20_000, stiffness=STIFF)  # fmt: skip
    dvi.external_force = np.outer(dvi.grains.particle_id == count - 1, [0.0, 0.0, -force])
    dvi.run(400)
    assert np.abs(dvi.grains.velocity).max() < 0.01 * h * force / MASS


@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3, 1e-2])
def test_a_resting_sphere_presses_in_by_its_weight(h):
    """delta = m g/k, whatever the step; it gets there from a touch without ringing for ever."""
    floor = annulus("floor", "housing", 0.0, 0.0, 1.0)
    grains = Grains.create([[0.1, 0.0, R]], R, STEEL)
    dvi = DVI(grains, [floor], [Body("housing")], DviContact(0.3, 0.1), dt=h, gravity=(0.0, 0.0, -G),
              tolerance=1e-13, stiffness=STIFF)  # fmt: skip
    dvi.run(max(50, round(60.0 * CONTACT_TIME / h)))
    totals = dvi.run(2)
    assert R - grains.position[0, 2] == pytest.approx(MASS * G / K, rel=1e-4)
    assert totals.force["housing"][2] == pytest.approx(-MASS * G, rel=1e-4)
    assert totals.energy.elastic_energy == pytest.approx(0.5 * (MASS * G) ** 2 / K, rel=1e-3)


def _glancing(make, h):
    """Velocity and spin of a sphere after it has struck the floor askew; it slides, then its spring lets go."""
    floor = annulus("floor", "housing", 0.0, 0.0, 1.0)
    grains = Grains.create([[0.1, 0.0, R + 0.3 * 1e-5]], R, STEEL)
    grains.velocity[:] = [[0.6, 0.0, -1.0]]
    stepper = make(grains, [floor], [Body("housing")], h)
    stepper.run(round(1.6 * np.sqrt(2.0) * CONTACT_TIME / h))
    return np.concatenate([grains.velocity[0], R * grains.angular_velocity[0]])


def test_short_steps_are_dem():
    """The same springs, dashpot and slider: the difference from DEM shrinks with the step, at first order."""
    law = LinearContact(K, 2.0 / 7.0 * K, damping_ratio(0.5), 0.0, 0.3)
    exact = _glancing(lambda g, w, b, h: DEM(g, w, b, law, dt=h), 1e-3 * CONTACT_TIME)
    assert exact[2] == pytest.approx(0.5, abs=2e-3)

    def dvi(g, w, b, h):
        return DVI(g, w, b, DviContact(0.3, 0.5), dt=h, tolerance=1e-13, stiffness=STIFF)

    errors = [np.abs(_glancing(dvi, CONTACT_TIME / n) - exact).max() for n in (25, 100, 400)]
    assert errors[2] < 0.01
    assert errors[0] > 2.5 * errors[1] > 2.5 * 2.5 * errors[2]


def _box_of(n, stiffness, **more):
    sites, side = lattice(n)
    step = 2.04 * R
    where = step * (sites - [0.5 * side, 0.5 * side, 0.0])
    where += 1e-2 * R * np.random.default_rng(3).uniform(-1.0, 1.0, where.shape)
    box = Box((side * step, side * step, 1.2 * side * step))
    return DVI(Grains.create(where, R, STEEL), box.walls(), [Body("housing")], DviContact(0.3), dt=1e-3,
               gravity=(0.0, 0.0, -G), stiffness=stiffness, **more)  # fmt: skip


@pytest.fixture(scope="module")
def moving():
    """A bed of 125 in a box that has been turned by 60 degrees, and its problem."""
    dvi = _box_of(125, STIFF, tolerance=1e-9, max_sweeps=20_000)
    dvi.run(100)
    dvi.gravity = G * np.array([np.sin(1.0), 0.0, -np.cos(1.0)])
    dvi.run(40)
    return dvi


def test_forces_of_a_packing_are_unique(moving):
    """From no impulses and from those of the step before: the same ones, in more contacts than there are unknowns."""
    warm = moving._records()
    cold = [a.copy() for a in warm]
    gs.apply_records(-1.0, *cold)
    for rows in (cold[3], cold[5]):
        rows[:, gs.RX : gs.RZ + 1] = 0.0
    for records in (warm, cold):
        assert swept(1e-12, 100_000, records, compliance=moving._compliance)[1] <= 1e-12
    loaded = np.any(warm[3][:, gs.RX : gs.RZ + 1] != 0.0, axis=1).sum() + len(warm[5])
    assert 3 * loaded > 6 * 125
    scale = np.abs(warm[3][:, gs.RX : gs.RZ + 1]).max()
    assert cold[3][:, gs.RX : gs.RZ + 1] == pytest.approx(warm[3][:, gs.RX : gs.RZ + 1], abs=1e-6 * scale)
    assert cold[0] == pytest.approx(warm[0], abs=1e-9)


@pytest.mark.hard
def test_stiff_springs_are_rigid():
    """One step in which a lattice collapses, k up by ten and a hundred: velocities tend to rigid ones, as 1/k."""

    def step(stiffness):
        dvi = _box_of(27, stiffness, tolerance=1e-9, max_sweeps=200_000)
        dvi.grains.velocity[:] = 0.5 * np.random.default_rng(5).normal(size=(27, 3))
        totals = dvi.run(1)
        assert totals.missed_steps == 0 and totals.n_contacts > 27
        return dvi.grains.velocity[np.argsort(dvi.grains.particle_id)]

    rigid = step(None)
    errors = [np.abs(step(((k, k), (k, k))) - rigid).max() for k in (1e7, 1e8, 1e9)]
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]


@pytest.mark.hard
def test_a_jam_between_driven_plates_has_a_finite_force():
    """A vane comes at 2 mm/s to a sphere that leans on a standing one: k_n/2 times the way made, at any time.

    Rigid contacts have no solution there.
    """

    def vane(name, body, x):
        corners = np.array([[x, 0.0, -0.05], [x, 0.2, -0.05], [x, 0.2, 0.05], [x, 0.0, 0.05]])
        return TriangleWall(name, body, corners, np.array([[0, 1, 2], [0, 2, 3]]))

    radius, omega = 0.1, 0.02
    grains = Grains.create([[R, radius, 0.0]], R, STEEL)
    walls = [vane("standing", "drum", 0.0), vane("moving", "rotor", 2.0 * R)]
    bodies = [Body("drum"), Body("rotor", TimeProfile.constant(omega))]  # turning about z moves it towards -x
    dvi = DVI(grains, walls, bodies, DviContact(0.0), dt=1e-4, stiffness=STIFF, tolerance=1e-9)
    for steps in (99, 100, 200):
        assert dvi.run(steps).missed_steps == 0
        totals = dvi.run(1)
        force = 0.5 * K * radius * omega * dvi.time
        assert totals.force["drum"][0] == pytest.approx(-force, rel=0.03)
        assert totals.torque_on("rotor") == pytest.approx(-radius * force, rel=0.03)  # it is held back


def test_energy_never_grows(e=0.5):
    """A cloud collapses: kinetic and elastic energy together only fall, at steps below and above a contact time."""
    for ratio in (0.2, 1.0, 5.0):
        rng = np.random.default_rng(1)
        sites = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3) * 2.4 * R
        velocity = -3.0 * (sites - sites.mean(axis=0)) + 0.05 * rng.normal(size=sites.shape)
        grains = Grains.create(sites, R, STEEL, velocity=velocity)
        dvi = DVI(grains, [], [], DviContact(0.5, e), dt=ratio * CONTACT_TIME, tolerance=1e-9, stiffness=STIFF)
        first = energy = grains.kinetic_energy()
        for _ in range(60):
            totals = dvi.run(max(1, round(8.0 / ratio)))
            energy_budget = totals.energy_budget
            now = energy_budget.kinetic_energy + totals.energy.elastic_energy
            assert now <= energy + 1e-9 * first
            assert energy_budget.kinetic_change + totals.energy.elastic_change == pytest.approx(
                -sum(totals.energy.dissipation.values()), abs=1e-12 * first
            )
            energy = now
        assert energy < 0.7 * first


@pytest.mark.parametrize("e", [0.2, 0.9, 1.0])
@pytest.mark.parametrize("a", [0.01, 0.1, 1.0, 4.0, 10.0, 100.0])
def test_a_groove_gives_back_no_more_than_a_plane(e, a):
    """Two contacts at once, 20 degrees between them, no friction: at most e and the percent that is left soft."""
    slope = np.deg2rad(10.0)
    walls = [Plane(name, "housing", (0.0, 0.0, 0.0), (side * np.sin(slope), 0.0, np.cos(slope)))
             for name, side in (("left", 1.0), ("right", -1.0))]  # fmt: skip
    h = np.sqrt(a * MASS / K)
    phase = np.array([0.1, 0.3, 0.5, 0.7, 0.9])  # side by side along the groove
    where = np.column_stack((np.zeros(5), 10.0 * R * np.arange(5), R / np.cos(slope) + phase * h))
    grains = Grains.create(where, R, STEEL)
    grains.velocity[:, 2] = -1.0
    dvi = DVI(grains, walls, [Body("housing")], DviContact(0.0, e, threshold=1e-3), dt=h, tolerance=1e-12,
              stiffness=STIFF)  # fmt: skip
    dvi.run(round(4.0 * np.pi / np.sqrt(a)) + 6)
    assert np.mean(grains.velocity[:, 2]) <= e + 0.012


def test_a_flat_mesh_carries_as_a_plane_does():
    """Spheres at rest on two triangles: m g/k deep, and no position is touched."""
    corners = np.array([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]])
    floor = TriangleWall("floor", "housing", corners, np.array([[0, 1, 2], [0, 2, 3]]))
    grains = Grains.create([[-0.03, 0.01, R], [0.0, 0.02, R], [0.04, -0.03, R]], R, STEEL)
    dvi = DVI(grains, [floor], [Body("housing")], DviContact(0.3, 0.5), dt=1e-3, gravity=(0.0, 0.0, -G),
              tolerance=1e-12, stiffness=STIFF)  # fmt: skip
    totals = dvi.run(400)
    assert R - grains.position[:, 2] == pytest.approx(np.full(3, MASS * G / K), rel=1e-6)
    assert totals.stabilisation_work == 0.0


def test_a_state_brings_its_step_and_springs_follow():
    made, other = (_box_of(27, STIFF, tolerance=1e-9) for _ in range(2))
    made.run(30)
    other = DVI(Grains.create(np.zeros((27, 3)) + 0.02, R, STEEL), made.walls, [Body("housing")], DviContact(0.3),
                dt=2e-3, gravity=(0.0, 0.0, -G), stiffness=STIFF, tolerance=1e-9)  # fmt: skip
    other.restore(made.state())
    made.run(20)
    other.run(20)
    assert np.array_equal(other.grains.velocity_force, made.grains.velocity_force)


def test_restart_is_bit_exact():
    whole, cut = (_box_of(64, STIFF, tolerance=1e-6) for _ in range(2))
    whole.run(60)
    cut.run(23)
    state = cut.state()
    again = _box_of(64, STIFF, tolerance=1e-6)
    again.restore(state)
    again.run(37)
    assert np.array_equal(again.grains.position_radius, whole.grains.position_radius)
    assert np.array_equal(again.grains.velocity_force, whole.grains.velocity_force)
    assert again.run(1).energy.elastic_energy == whole.run(1).energy.elastic_energy


@pytest.mark.parametrize("stiffness", [((0.0, 1.0), (1.0, 1.0)), ((1.0, 1.0),), ((1.0, np.inf), (1.0, 1.0))])
def test_bad_stiffness_is_refused(stiffness):
    with pytest.raises(ValueError, match="stiffness"):
        _box_of(8, stiffness)
