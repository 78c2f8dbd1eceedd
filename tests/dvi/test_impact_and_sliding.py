"""Rigid grains on walls: sliding, rolling, rebounds, incidence, mass ratios, shafts."""

import numpy as np
import pytest
from dvi_scenes import DOWN, G, R, floor
from interior_point import solve_by_interior_point

from geometry.time_profile import TimeProfile
from geometry.walls import annulus, cylinder
from particles import Body, DemError, DemErrorKind, FreeShaft, Grains
from particles.dvi import gauss_seidel as gs
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

pytestmark = pytest.mark.physics


def _on_floor(velocity, h, contact, gravity=DOWN, height=0.0, **more):
    grains = Grains.create([[0.0, 0.0, R + height]], R, 7850.0, velocity=[velocity])
    return DVI(grains, [floor()], [Body("housing")], contact, dt=h, gravity=gravity, **more)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 1e-2])
def test_sliding_speed_is_exact_for_every_step(h):
    """10 m/s, mu 0.5, after 0.5 s 7.5475 m/s; a sphere still slides: it rolls after 0.58 s.

    The number is of tests/REFERENCE.md section 5.
    """
    dvi = _on_floor([10.0, 0.0, 0.0], h, DviContact(0.5))
    dvi.run(round(0.5 / h))
    assert dvi.grains.velocity[0] == pytest.approx([7.5475, 0.0, 0.0], abs=1e-9)
    assert dvi.grains.position[0, 2] == pytest.approx(R, rel=1e-12)


def test_the_convex_law_floats_where_exact_coulomb_touches():
    """h mu v = 1e-3 * 0.5 * 2 = 1.0 mm for a contact that is kept sliding at 2 m/s; exact: 0.

    tests/REFERENCE.md section 5.
    """
    gaps = {}
    for law in ("coulomb", "convex"):
        dvi = _on_floor([2.0, 0.0, 0.0], 1e-3, DviContact(0.5), friction_cone=law)
        for _ in range(400):
            dvi.grains.velocity[:, :2] = 2.0, 0.0  # driven at 2 m/s without spin
            dvi.grains.angular_velocity[:] = 0.0
            dvi.run(1)
        gaps[law] = dvi.grains.position[0, 2] - R
    assert gaps["coulomb"] == pytest.approx(0.0, abs=1e-12)
    assert gaps["convex"] == pytest.approx(1e-3, rel=0.02)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 1e-2])
def test_slip_to_roll_is_exact_for_every_step(h):
    """u = 5 u0/7, omega = 5 u0/(7 R) (tests/REFERENCE.md section 4), from t_s = 2 u0/(7 mu g) on."""
    dvi = _on_floor([1.0, 0.0, 0.0], h, DviContact(0.3))
    begin = 2.0 / (7.0 * 0.3 * G)
    dvi.run(int(0.9 * begin / h))
    assert dvi.grains.velocity[0, 0] == pytest.approx(1.0 - 0.3 * G * dvi.time, rel=1e-12)
    dvi.run(round(0.2 / h))
    assert dvi.grains.velocity[0] == pytest.approx([5.0 / 7.0, 0.0, 0.0], abs=1e-12)
    assert dvi.grains.angular_velocity[0] == pytest.approx([0.0, 5.0 / (7.0 * R), 0.0], abs=1e-9)


@pytest.mark.parametrize(("slope", "mu"), [(20.0, 0.3), (50.0, 0.3)])
def test_incline(slope, mu):
    """Rolls with a = 5/7 g sin if tan <= 3.5 mu, else slides with a = g (sin - mu cos).

    tests/REFERENCE.md section 4.
    """
    a = np.radians(slope)
    h, steps = 2e-3, 100
    dvi = _on_floor([0.0, 0.0, 0.0], h, DviContact(mu), gravity=G * np.array([np.sin(a), 0.0, -np.cos(a)]))
    dvi.run(steps)
    rolls = np.tan(a) <= 3.5 * mu
    expected = 5.0 / 7.0 * G * np.sin(a) if rolls else G * (np.sin(a) - mu * np.cos(a))
    spin = expected / R if rolls else 5.0 * mu * G * np.cos(a) / (2.0 * R)
    assert dvi.grains.velocity[0, 0] == pytest.approx(expected * h * steps, rel=1e-12)
    assert dvi.grains.angular_velocity[0, 1] == pytest.approx(spin * h * steps, rel=1e-12)


def test_belt_pick_up():
    """A sphere at rest on a wall that moves at U ends at 2U/7: near the rim of a huge slow turntable."""
    rho, speed = 1e3, 0.5
    grains = Grains.create([[rho, 0.0, R]], R, 7850.0)
    table = Body("table", TimeProfile.constant(speed / rho))
    dvi = DVI(grains, [annulus("face", "table", 0.0, 0.0, 2.0 * rho)], [table], DviContact(0.5), dt=1e-3, gravity=DOWN)
    dvi.run(200)
    assert dvi.grains.velocity[0, 1] == pytest.approx(2.0 * speed / 7.0, rel=1e-3)


def _peaks(h, e, bounces, drops):
    """Largest heights between rebounds, as chunks of the drop; looked at every eighth step (off by g (4 h)^2/2).

    The spheres fall side by side, each from its own height.
    """
    n = len(drops)
    where = np.column_stack((4.0 * R * np.arange(n), np.zeros(n), R + drops))
    grains = Grains.create(where, R, 7850.0)
    dvi = DVI(grains, [floor()], [Body("housing")], DviContact(0.3, e), dt=h, gravity=DOWN)
    heights, highest, fell = [[] for _ in drops], np.zeros(n), np.ones(n, dtype=bool)
    while min(map(len, heights)) < bounces:
        dvi.run(8)
        order = np.argsort(dvi.grains.particle_id)
        up = dvi.grains.velocity[order, 2] > 0.0
        highest = np.where(up | ~fell, np.maximum(highest, dvi.grains.position[order, 2] - R), 0.0)
        for k in np.flatnonzero(~up & ~fell):
            heights[k].append(highest[k])
        fell = ~up
    return np.array([found[:bounces] for found in heights]) / drops[:, None]


def test_bouncing_heights_converge_at_first_order():
    """e = 0.8: peaks of 0.64^k = e^(2 k) of the drop; a sixteenth of h, a sixteenth of the error."""
    exact = 0.64 ** np.arange(1, 4)
    errors = []
    for h in (8e-4, 5e-5):
        # where in its step an impact falls is chance: the mean over several drops
        drops = 0.3 * (1.0 + np.linspace(0.0, 0.05, 6))
        errors.append(np.mean(np.abs(_peaks(h, 0.8, 3, drops) - exact).max(axis=1)))
    assert errors[-1] < 3e-3
    assert errors[0] / errors[-1] == pytest.approx(16.0, rel=0.5)


def test_a_slow_impact_does_not_rebound():
    dvi = _on_floor([0.0, 0.0, -0.009], 1e-3, DviContact(0.3, 0.8, threshold=0.01), gravity=(0.0, 0.0, 0.0))
    dvi.run(1)
    assert abs(dvi.grains.velocity[0, 2]) < 100 * np.finfo(float).eps * 0.009
    fast = _on_floor([0.0, 0.0, -0.011], 1e-3, DviContact(0.3, 0.8, threshold=0.01), gravity=(0.0, 0.0, 0.0))
    fast.run(1)
    assert fast.grains.velocity[0, 2] == pytest.approx(0.8 * 0.011, rel=1e-12)


@pytest.mark.parametrize("mu", [0.05, 0.3, 1.0])
def test_every_incidence_has_an_answer_that_loses_energy(mu):
    """No Painleve trouble for spheres: 0 to 89 degrees, spinning or not; impulse in the cone, no energy made."""
    for degrees in range(0, 90):
        for spin in (0.0, 400.0):
            a = np.radians(degrees)
            grains = Grains.create([[0.0, 0.0, R]], R, 7850.0, velocity=[[np.sin(a), 0.0, -np.cos(a)]],
                                   angular_velocity=[[0.0, spin, 0.0]])  # fmt: skip
            before = grains.kinetic_energy()
            dvi = DVI(grains, [floor()], [Body("housing")], DviContact(mu), dt=1e-3, gravity=(0.0, 0.0, 0.0))
            totals = dvi.run(1)
            assert totals.missed_steps == 0
            assert grains.kinetic_energy() <= before * (1.0 + 1e-14)
            force = dvi.contact_force[0]
            assert force[2] > 0.0 and np.hypot(force[0], force[1]) <= mu * force[2] * (1.0 + 1e-12)
            assert force[2] * dvi.dt == pytest.approx(grains.mass[0] * np.cos(a), rel=1e-12)
            slip = abs(np.sin(a) - spin * R)
            stuck = min(slip / 3.5, mu * np.cos(a))
            assert np.hypot(force[0], force[1]) * dvi.dt == pytest.approx(grains.mass[0] * stuck, rel=1e-9, abs=1e-15)


def _stacked(*masses):
    """Spheres upon each other, masses in those of a steel one, from the floor up."""
    grains = Grains.create([[0.0, 0.0, (2 * k + 1) * R] for k in range(len(masses))], R, 7850.0 * np.array(masses))
    return DVI(grains, [floor()], [Body("housing")], DviContact(0.3), dt=1e-3, gravity=DOWN, tolerance=1e-8,
               max_sweeps=300)  # fmt: skip


@pytest.mark.parametrize("masses", [(1.0, 1e3), (1.0, 1e6), (*[1.0] * 9, 1e4), (1.0, 1e3, 1e6)])
def test_a_heavy_sphere_rests_on_light_ones(masses):
    """The hardest case for plain sweeps: the light ones pass on (1 + ratio) weights, 1/ratio of it a sweep.

    All errors but that of this one mode are gone after some sweeps; an extrapolation as far as the ratio removes it.
    """
    dvi = _stacked(*masses)
    totals = dvi.run(20)
    assert totals.missed_steps == 0
    assert totals.force["housing"][2] == pytest.approx(-dvi.grains.mass.sum() * G, rel=1e-4)
    assert np.abs(dvi.grains.velocity).max() < 1e-7
    force = dvi.contacts().force
    order = np.argsort(dvi.grains.position[:, 2])
    above = np.cumsum(dvi.grains.mass[order][::-1]) * G  # what each contact carries, the highest first
    assert np.sort(np.linalg.norm(force, axis=1)) == pytest.approx(above, rel=1e-4)


def test_masses_beyond_sweeps_are_reported_and_have_a_solution():
    """Every second of six a million times as heavy: the step is missed.

    The interior point, which is no part of the program, solves it.
    """
    dvi = _stacked(*(1.0, 1e6) * 3)
    assert dvi.run(1).missed_steps == 1
    records = dvi._records()
    assert solve_by_interior_point(None, 1e-8, *records)[1] <= 1e-8
    assert records[5][:, gs.RZ].sum() / dvi.dt == pytest.approx(dvi.grains.mass.sum() * G, rel=1e-4)


@pytest.mark.parametrize("log_inertia", [-6, -3, 0, 3, 6])
def test_a_free_shaft_shares_angular_momentum_exactly(log_inertia):
    """A sphere lands tangentially inside a free drum: sticking, both end with one rim speed; L is kept to round-off.

    With J the drum's inertia and m R^2 2/5 the sphere's, the tangential impulse is (v - omega rho)/(3.5/m + rho^2/J).
    """
    rho = 0.05
    grains = Grains.create([[rho - R, 0.0, 0.0]], R, 7850.0, velocity=[[1.0, 0.3, 0.0]])
    mass, j = grains.mass[0], grains.inertia[0] * 10.0**log_inertia
    shaft = Body("drum", FreeShaft(j), speed=-3.0)
    before = grains.angular_momentum_z() + j * shaft.speed
    dvi = DVI(grains, [cylinder("shell", "drum", rho, -1.0, 1.0)], [shaft], DviContact(10.0), dt=1e-3,
              gravity=(0.0, 0.0, 0.0))  # fmt: skip
    # the contact point's radius is rho: its lever about the axis
    impulse = (0.3 + 3.0 * rho) / (3.5 / mass + rho**2 / j)
    totals = dvi.run(1)
    assert shaft.speed == pytest.approx(-3.0 + rho * impulse / j, rel=1e-10)
    assert totals.torque_on("drum") * dvi.dt == pytest.approx(rho * impulse, rel=1e-10)
    assert grains.angular_momentum_z() + j * shaft.speed == pytest.approx(before, abs=1e-13 * (abs(before) + 3.0 * j))


def test_a_load_holds_a_shaft_and_a_drive_overcomes_it():
    """Dry friction: at rest below its limit; beyond it omega = (T - T_load) t/J, work drive = load + J omega^2/2."""
    far = Grains.create([[0.0, 0.0, 5.0]], R, 7850.0)
    for drive, expected in ((0.9, 0.0), (1.5, 0.5 * 0.2 / 2.0)):
        shaft = Body("rotor", FreeShaft(2.0, drive_torque=drive, load_torque=TimeProfile.constant(1.0)))
        dvi = DVI(far, [cylinder("shell", "rotor", 1.0, -1.0, 1.0)], [shaft], DviContact(0.3), dt=1e-3,
                  gravity=(0.0, 0.0, 0.0))  # fmt: skip
        totals = dvi.run(200)
        assert shaft.speed == pytest.approx(expected, abs=1e-13)
        work = totals.shaft_work["rotor"]
        assert work["drive"] - work["load"] == pytest.approx(0.5 * 2.0 * shaft.speed**2, abs=1e-12)


def test_theta_moves_positions_by_a_part_of_a_step_only():
    """Free flight with theta = 1/2 is the exact parabola; at 1, velocities lag by half a step."""
    h, n, t = 1e-2, 50, 0.5
    for theta in (0.5, 1.0):
        lag = (theta - 0.5) * h
        dvi = _on_floor([0.2, 0.0, 1.0 + G * lag], h, DviContact(0.3), height=2.0, theta=theta)
        dvi.run(n)
        assert dvi.grains.position[0] == pytest.approx([0.2 * t, 0.0, R + 2.0 + t - 0.5 * G * t**2], rel=1e-12)


def test_a_grain_that_is_shot_off_stops_the_run():
    """Twenty radii in a step are what no wall throws a grain at: the message names grain, speed and remedy."""
    grains = Grains.create([[0.0, 0.0, 0.0]], 1e-3, 7800.0, velocity=[[500.0, 0.0, 0.0]])
    dvi = DVI(grains, [], [], DviContact(0.3), dt=1e-4)
    with pytest.raises(DemError, match=r"shot off at 500 m/s, 25 diameters in a step.*more clearance") as stop:
        dvi.run(10)
    assert stop.value.kind is DemErrorKind.TOO_FAST
