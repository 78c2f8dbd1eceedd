"""One sphere and one wall, or two spheres: restitution, rolling, sliding, incline, belt, cylinder, edges."""

import numpy as np
import pytest

from geometry.walls import Plane, cylinder, outline
from particles import DEM, Body, Grains, LinearContact, PrescribedSpeed, choose_time_step

G = 9.81


def _floor(body="housing"):
    return Plane("floor", body, np.zeros(3), np.array([0.0, 0.0, 1.0]))


def _sphere(position, radius, density, **state):
    return Grains.create([position], radius, density, **{name: [value] for name, value in state.items()})


@pytest.mark.parametrize("e", [0.9, 0.5, 0.2])
def test_restitution_on_a_wall(e):
    """The asked restitution, and the duration of the force (pi - atan2(2 zeta s, 1 - 2 zeta^2))/(omega s)."""
    law, r, v = LinearContact.from_restitution(1e4, e, 0.3), 1e-3, 0.5
    grains = _sphere([0.0, 0.0, r], r, 2500.0, velocity=[0.0, 0.0, -v])
    omega, zeta = np.sqrt(law.stiffness_n / grains.mass[0]), law.damping_n
    s = np.sqrt(1.0 - zeta**2)
    duration = (np.pi - np.arctan2(2.0 * zeta * s, 1.0 - 2.0 * zeta**2)) / (omega * s)
    dt = 1e-8
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt)
    pushed = 0
    while dem.grains.position[0, 2] < r or dem.time < 1e-5:
        dem.run(10)
        pushed += 10 * bool(dem.contact_force[0, 2] > 0.0)
    assert dem.grains.velocity[0, 2] / v == pytest.approx(e, rel=2e-3)
    assert pushed * dt == pytest.approx(duration, abs=3e-7)


@pytest.mark.parametrize("e", [0.9, 0.5])
def test_restitution_of_two_unequal_grains(e):
    law = LinearContact.from_restitution(1e4, e, 0.3)
    grains = Grains.create([[0, 0, 0], [3.01e-3, 0, 0]], [1e-3, 2e-3], 2500.0, velocity=[[0.3, 0, 0], [-0.2, 0, 0]])
    dem = DEM(grains, [], [], law, dt=choose_time_step(law, grains.mass, grains.radius, steps_per_contact=1000).dt)
    dem.run(5000)
    order = np.argsort(dem.grains.particle_id)
    v = dem.grains.velocity[order, 0]
    assert (v[1] - v[0]) / 0.5 == pytest.approx(e, rel=3e-3)


def test_free_fall_is_an_exact_parabola():
    """With v given half a step back the leapfrog is exact for a constant force."""
    dt, n = 1e-4, 1000
    grains = _sphere([0.0, 0.0, 1.0], 1e-3, 2500.0, velocity=[0.2, 0.0, 1.0 + 0.5 * G * dt])
    law = LinearContact.from_restitution(100.0, 0.5, 0.3)
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt, gravity=(0.0, 0.0, -G))
    dem.run(n)
    t = n * dt
    assert dem.grains.position[0] == pytest.approx([0.2 * t, 0.0, 1.0 + t - 0.5 * G * t**2], rel=1e-12)


def test_oblique_impact_in_gross_sliding():
    """d = 5 mm, rho 2700, e .98, mu .092: v_x' = v_x - mu (1 + e) |v_z|, omega = 5 mu (1 + e) |v_z|/(2 R)."""
    law, r = LinearContact.from_restitution(1e9, 0.98, 0.092), 2.5e-3
    grains = _sphere([0.0, 0.0, r * 1.0001], r, 2700.0, velocity=[2.5069, 0.0, -2.9876])
    dt = choose_time_step(law, grains.mass, grains.radius, steps_per_contact=400).dt
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt)
    while dem.grains.position[0, 2] < 1.001 * r:
        dem.run(100)
    assert dem.grains.velocity[0, 0] == pytest.approx(1.962679, rel=1e-3)
    assert dem.grains.velocity[0, 2] == pytest.approx(2.927848, rel=1e-3)
    assert dem.grains.angular_velocity[0, 1] == pytest.approx(544.221, rel=2e-3)


@pytest.mark.parametrize("friction", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("e", [0.5, 0.9, 1.0])
def test_friction_creates_no_energy(friction, e):
    """One sphere for each incidence from 0 to 89 degrees, three initial spins each."""
    law, r = LinearContact.from_restitution(1e4, e, friction), 1e-3
    angle, spin = (a.ravel() for a in np.meshgrid(np.radians(np.arange(0.0, 90.0, 1.0)), [-500.0, 0.0, 500.0]))
    n = len(angle)
    position = np.stack([np.arange(n) * 4.0 * r, np.zeros(n), np.full(n, 1.01 * r)], axis=1)
    velocity = np.stack([np.zeros(n), np.sin(angle), -np.cos(angle)], axis=1)
    w = np.stack([spin, np.zeros(n), np.zeros(n)], axis=1)
    grains = Grains.create(position, r, 2500.0, velocity=velocity, angular_velocity=w)
    mass, inertia = grains.mass[0], grains.inertia[0]
    dt = choose_time_step(law, grains.mass, grains.radius, steps_per_contact=50).dt
    before = 0.5 * mass + 0.5 * inertia * spin**2
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt)
    dem.run(int(3.0e-3 / dt))
    g = dem.grains
    order = np.argsort(g.particle_id)
    after = (0.5 * mass * np.sum(g.velocity**2, axis=1) + 0.5 * inertia * np.sum(g.angular_velocity**2, axis=1))[order]
    assert (g.velocity[order, 2] > 0.0).all() and len(dem.contacts().i) == 0
    # the phase of the impact in its first step leaves an error of second order in dt, of either sign
    assert (after <= before * (1.0 + 1e-3)).all()


def _on_the_floor(law, r, density, gravity=G):
    grains = _sphere([0.0, 0.0, r], r, density)
    grains.position[0, 2] -= grains.mass[0] * gravity / law.stiffness_n  # at rest on its static overlap
    return grains


def test_slip_to_roll():
    """t_s = 2 u0/(7 mu g); then u = 5 u0/7, omega = 5 u0/(7 R)."""
    law, r, u0 = LinearContact.from_restitution(1e5, 0.5, 0.2), 5e-3, 0.5
    grains = _on_the_floor(law, r, 2500.0)
    grains.velocity[0, 0] = u0
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt, gravity=(0.0, 0.0, -G))
    t_s = 2.0 * u0 / (7.0 * 0.2 * G)
    dem.run(int(0.9 * t_s / dt))
    assert dem.grains.velocity[0, 0] == pytest.approx(u0 - 0.2 * G * dem.time, rel=1e-3)
    dem.run(int(0.3 * t_s / dt))
    assert dem.grains.velocity[0, 0] == pytest.approx(5.0 * u0 / 7.0, rel=1e-3)
    assert dem.grains.angular_velocity[0, 1] == pytest.approx(5.0 * u0 / (7.0 * r), rel=1e-3)


def test_belt_picks_a_sphere_up_to_two_sevenths():
    """A floor that turns slowly, 100 m from its axis, is a belt of speed U; the sphere ends at 2 U/7."""
    law, r, far, belt = LinearContact.from_restitution(1e5, 0.5, 0.3), 5e-3, 100.0, 0.7
    grains = _on_the_floor(law, r, 2500.0)
    grains.position[0, 0] = far
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    rotor = Body("rotor", PrescribedSpeed.constant(belt / far))
    dem = DEM(grains, [_floor("rotor")], [rotor], law, dt=dt, gravity=(0.0, 0.0, -G))
    totals = dem.run(int(0.15 / dt))
    assert dem.grains.velocity[0, 1] == pytest.approx(2.0 * belt / 7.0, rel=2e-3)
    # torque on the belt is minus the change of angular momentum of the sphere
    assert totals.torque["rotor"]["tangential"] * totals.duration == pytest.approx(-dem.grains.angular_momentum_z())
    assert totals.books.wall_work["rotor"] == pytest.approx(
        totals.books.contact_work + totals.books.dissipated + totals.books.elastic_change, rel=1e-12
    )
    assert totals.books.dissipation["sliding"] == pytest.approx(totals.books.dissipated, rel=1e-2)


@pytest.mark.parametrize("degrees", [10.0, 30.0, 50.0, 70.0])
def test_incline_rolls_or_slides(degrees):
    """Rolls with a = (5/7) g sin if tan <= 3.5 mu, else slides with a = g (sin - mu cos)."""
    law, r, mu = LinearContact.from_restitution(1e5, 0.3, 0.3), 5e-3, 0.3
    alpha = np.radians(degrees)
    grains = _on_the_floor(law, r, 2500.0, G * np.cos(alpha))
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    gravity = (G * np.sin(alpha), 0.0, -G * np.cos(alpha))
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt, gravity=gravity)
    dem.run(int(0.1 / dt))
    if np.tan(alpha) <= 3.5 * mu:
        a, rate = 5.0 / 7.0 * G * np.sin(alpha), 5.0 / 7.0 * G * np.sin(alpha) / r
    else:
        a, rate = G * (np.sin(alpha) - mu * np.cos(alpha)), 2.5 * mu * G * np.cos(alpha) / r
    assert dem.grains.velocity[0, 0] / dem.time == pytest.approx(a, rel=3e-3)
    assert dem.grains.angular_velocity[0, 1] / dem.time == pytest.approx(rate, rel=3e-3)


@pytest.mark.parametrize("friction, factor", [(1.0, 1.4), (0.0, 1.0)])
def test_small_oscillations_in_a_cylinder(friction, factor):
    """Period 2 pi sqrt(factor (R_c - R)/g): 7/5 rolling, 1 without friction."""
    law, r, rc, amplitude = LinearContact.from_restitution(1e5, 0.5, friction), 5e-3, 50e-3, 0.02
    at = rc - r + 1.3e-3 * G / law.stiffness_n
    grains = _sphere([at * np.sin(amplitude), -at * np.cos(amplitude), 0.0], r, 2500.0)
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    wall = cylinder("drum", "housing", rc, -0.1, 0.1)
    dem = DEM(grains, [wall], [Body("housing")], law, dt=dt, gravity=(0.0, -G, 0.0))
    crossings, last, every = [], dem.grains.position[0, 0], 20
    while len(crossings) < 5:
        dem.run(every)
        now = dem.grains.position[0, 0]
        if last * now < 0.0:
            crossings.append(dem.time - every * dt * now / (now - last))
        last = now
    period = (crossings[4] - crossings[0]) / 2.0
    assert period == pytest.approx(2.0 * np.pi * np.sqrt(factor * (rc - r) / G), rel=2e-3)


def test_eight_balls_press_their_weight():
    """Eight balls of 5 kg stand on the floor with 392.4 N; the force of the floor is that at every step."""
    r = 0.05
    density = 5.0 / (4.0 / 3.0 * np.pi * r**3)
    law = LinearContact.from_restitution(1e6, 0.3, 0.3)
    position = np.array([[x, y, r] for x in range(4) for y in range(2)]) * [3 * r, 3 * r, 1.0]
    position[:, 2] -= 5.0 * G / law.stiffness_n
    grains = Grains.create(position, r, density)
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    dem = DEM(grains, [_floor()], [Body("housing")], law, dt=dt, gravity=(0.0, 0.0, -G))
    for _ in range(50):
        assert dem.run(1).force["housing"][2] == pytest.approx(-392.4, rel=1e-9)


def test_rolling_over_a_convex_edge_keeps_one_contact_and_a_continuous_force():
    """A sphere rolls outward on a disc's face, over its edge, down its rim: one contact, handed on."""
    walls = outline("disc", "disc", [(0.0, 0.01), (0.03, 0.01), (0.03, -0.01), (0.0, -0.01)])
    law, r = LinearContact.from_restitution(1e5, 0.3, 5.0), 5e-3
    grains = _sphere([0.0295, 0.0, 0.01 + r], r, 2500.0, velocity=[0.05, 0.0, 0.0], angular_velocity=[0.0, 10.0, 0.0])
    weight = grains.mass[0] * G
    grains.position[0, 2] -= weight / law.stiffness_n
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    dem = DEM(grains, walls, [Body("disc")], law, dt=dt, gravity=(0.0, 0.0, -G))
    dem.run(100)
    before, over = dem.contact_force[0], 0.0
    while dem.contacts().i.size and dem.time < 1.0:
        count = dem.run(1).n_contacts
        assert count <= 1
        if count:
            assert np.linalg.norm(dem.contact_force[0] - before) < 0.05 * weight
            before = dem.contact_force[0]
        over = max(over, np.arctan2(dem.grains.position[0, 0] - 0.03, dem.grains.position[0, 2] - 0.01))
    # a sphere on a sharp edge leaves it at cos(angle) = 10/17 from rest; here it starts a little faster
    assert 0.6 < over < np.arccos(10.0 / 17.0) + 0.02


def test_force_is_the_same_all_round_an_edge():
    """Pressed in by the same depth from the face, round the edge, to the rim: always one wall, one depth."""
    from particles.walls.wall_kernels import near_walls, wall_overlaps
    from particles.walls.wall_table import wall_rows

    rows = wall_rows(outline("disc", "disc", [(0.0, 0.01), (0.03, 0.01), (0.03, -0.01), (0.0, -0.01)]))
    r, depth = 5e-3, 1e-4
    turn = np.linspace(0.0, 0.5 * np.pi, 181)
    arc = np.stack([0.03 + (r - depth) * np.sin(turn), np.zeros(181), 0.01 + (r - depth) * np.cos(turn)], axis=1)
    face = arc[0] - np.linspace(5e-3, 0.0, 50)[:, None] * [1.0, 0.0, 0.0]
    rim = arc[-1] - np.linspace(0.0, 5e-3, 50)[:, None] * [0.0, 0.0, 1.0]
    centres = np.concatenate([face, arc, rim])
    radius, start, other = (
        np.full(len(centres), r),
        np.zeros(len(centres) + 1, np.int64),
        np.zeros(9999, np.int32),
    )
    found = near_walls(centres, radius, rows, start, other)
    grain = np.repeat(np.arange(len(centres)), np.diff(start))
    overlap = wall_overlaps(centres, radius, rows, grain, other[:found].astype(np.int64))[:, 0]
    touching = overlap > 0.0
    assert np.array_equal(grain[touching], np.arange(len(centres)))
    assert overlap[touching] == pytest.approx(depth, rel=1e-9)
