"""Rigid grains against exact motions: first order in the step; the energy budget over impacts."""

import numpy as np
import pytest
from dvi_scenes import DOWN, NONE, STEEL, G, R, floor, lattice
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from geometry import Box
from geometry.time_profile import TimeProfile
from geometry.walls import Plane, annulus, cylinder
from particles import Body, Grains
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

pytestmark = pytest.mark.physics

DRUM = 0.05  # radius of the drum
ARM = DRUM - R  # radius of the circle that the centre moves on
Z = np.array([0.0, 0.0, 1.0])


def _orders(errors):
    """Slope of log(error) against log(h) for steps that are halved from one row to the next, fitted."""
    errors = np.abs(np.asarray(errors))
    return -np.polyfit(np.arange(len(errors)), np.log2(errors), 1)[0]


@pytest.fixture
def no_slop(monkeypatch):
    """Overlap is let be below 1e-4 radii: on curved walls an error of its own, below that of any step of use."""
    monkeypatch.setattr("particles.dvi.dvi.SLOP", 1e-8)


def _in_drum(h, speed, mu, angle=0.0, **more):
    grains = Grains.create([[ARM * np.sin(angle), -ARM * np.cos(angle), 0.0]], R, STEEL)
    drum = Body("drum", TimeProfile.constant(speed))
    return DVI(grains, [cylinder("shell", "drum", DRUM, -1.0, 1.0)], [drum], DviContact(mu), dt=h,
               gravity=(0.0, -G, 0.0), tolerance=1e-12, **more)  # fmt: skip


def _carried_up(speed, mu, times):
    """A sphere put at rest into a drum that turns: slips until its surface has the drum's speed, then rolls.

    With phi from the bottom, u = a phi' and p = R omega: slip s = u + p - Omega R_d, normal force per mass
    N = g cos(phi) + u^2/a, friction f = -mu N sign(s); u' = f - g sin(phi), p' = 5/2 f. Rolling: u' = -5/7 g sin(phi).
    Returns the time at which it begins to roll, and (phi, p) at ``times``.
    """

    def slip(_, y):
        return y[1] + y[2] - speed * DRUM

    def slides(t, y):
        f = -mu * (G * np.cos(y[0]) + y[1] ** 2 / ARM) * np.sign(slip(t, y))
        return y[1] / ARM, f - G * np.sin(y[0]), 2.5 * f

    def rolls(_, y):
        a = -5.0 / 7.0 * G * np.sin(y[0])
        return y[1] / ARM, a, -a

    slip.terminal = True
    exact = {"rtol": 1e-11, "atol": 1e-13, "dense_output": True}
    first = solve_ivp(slides, (0.0, times[-1]), np.zeros(3), events=slip, **exact)
    begin = first.t[-1]
    then = solve_ivp(rolls, (begin, times[-1]), first.y[:, -1], **exact)
    return begin, np.array([(first if t < begin else then).sol(t)[[0, 2]] for t in times])


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_slip_and_roll_in_a_turning_drum(theta, no_slop):
    """Place, spin and the moment at which slip ends, against the ordinary differential equations: order 1."""
    speed, mu, t, looks = 12.0, 0.1, 1.0, 10
    begin, exact = _carried_up(speed, mu, np.arange(1, looks + 1) * t / looks)
    assert 2 < begin * looks / t < 8  # looked at before and after
    errors, late, steps = [], [], (200, 400, 800, 1600, 3200)
    for n in steps:
        h = t / n
        dvi = _in_drum(h, speed, mu, theta=theta)
        seen, slips = [], []
        for k in range(n):
            assert dvi.run(1).missed_steps == 0
            (x, y, _), v, p = dvi.grains.position[0], dvi.grains.velocity[0], R * dvi.grains.angular_velocity[0, 2]
            slips.append((v[1] * x - v[0] * y) / np.hypot(x, y) + p - speed * DRUM)
            if (k + 1) % (n // looks) == 0:
                seen.append([np.arctan2(x, -y), p])
        errors.append(np.abs(np.array(seen) - exact).max(axis=0) / [1.0, speed * DRUM])
        slides = int(np.argmax(np.abs(slips) < 1e-3 * speed * DRUM))
        a, b = slips[slides - 3], slips[slides - 2]  # two full steps of slip: where their line ends
        late.append(abs(h * (slides - 1 - b / (b - a)) - begin))
    place, spin = np.array(errors).T
    assert _orders(place) == pytest.approx(1.0, abs=0.1) and _orders(spin) == pytest.approx(1.0, abs=0.15)
    assert place[-1] < 1e-3 and spin[-1] < 1e-4
    # a moment within a step: its error jumps about below a line of first order
    assert np.all(np.array(late) < 0.1 * t / np.array(steps))


def test_slop_is_the_floor_of_the_error():
    """With the overlap that is let be, 1e-4 R, a rolling sphere's lever is short by as much: no more than that."""
    speed, mu, t = 12.0, 0.1, 1.0
    _, exact = _carried_up(speed, mu, np.array([t]))
    dvi = _in_drum(t / 3200, speed, mu, theta=0.5)
    dvi.run(3200)
    x, y, _ = dvi.grains.position[0]
    assert np.arctan2(x, -y) == pytest.approx(exact[0, 0], abs=3e-4)
    assert R * dvi.grains.angular_velocity[0, 2] == pytest.approx(exact[0, 1], abs=3e-4 * speed * DRUM)
    assert np.hypot(x, y) == pytest.approx(ARM, abs=1.1e-4 * R + 0.5 * (t / 3200 * 0.2) ** 2 / ARM)


@pytest.mark.parametrize("theta", [1.0, 0.5])
@pytest.mark.parametrize(("mu", "inertia"), [(1.0, 1.4), (0.0, 1.0)])
def test_rocking_in_a_cylinder(mu, inertia, theta, no_slop):
    """Period 4 K(sin(phi_0/2)) sqrt(c a/g), c = 7/5 rolling and 1 without friction, at any swing.

    For small swings the numbers of tests/REFERENCE.md section 4.

    Order 1 for the period and for what the swing loses: each step turns the velocity into the new tangent, and takes
    (h phi')^2/2 of it.
    """
    swing = 0.6
    period = 4.0 * ellipk(np.sin(0.5 * swing) ** 2) * np.sqrt(inertia * ARM / G)
    errors = []
    for n in (50, 100, 200, 400, 800):
        dvi = _in_drum(period / n, 0.0, mu, swing, theta=theta)
        phi = [swing]
        for _ in range(int(2.4 * n)):
            dvi.run(1)
            phi.append(np.arctan2(dvi.grains.position[0, 0], -dvi.grains.position[0, 1]))
        phi = np.array(phi)
        k = np.flatnonzero((phi[:-1] > 0.0) & (phi[1:] <= 0.0))
        crossed = (k + phi[k] / (phi[k] - phi[k + 1])) / n
        errors.append([crossed[1] - crossed[0] - 1.0, phi[3 * n // 2 :].max() / swing - 1.0])
    period_error, loss = np.array(errors).T
    assert _orders(period_error) == pytest.approx(1.0, abs=0.1) and abs(period_error[-1]) < 4e-4
    assert _orders(loss) == pytest.approx(1.0, abs=0.1)
    assert np.all(loss < 0.0) and loss[-1] > -0.012


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_a_turning_table_carries_a_sphere_along(theta):
    """At rest on a table that turns at Omega: slips along a curve, then rolls round a circle at 2/7 Omega; order 1.

    Slip s = v - R omega x z - Omega z x r, v' = -mu g s/|s|; rolling v' = 2/7 Omega z x v (Earnshaw).
    """
    speed, mu, start, t, looks = 8.0, 0.12, 0.06, 1.0, 10

    def slip(y):
        return y[3:6] + R * np.cross(Z, y[6:9]) - speed * np.cross(Z, y[:3])

    def motion(y, a):
        return np.concatenate([y[3:6], a, 2.5 / R * np.cross(a, Z)])

    def slides(_, y):
        s = slip(y)
        return motion(y, -mu * G * s / np.linalg.norm(s))

    def rolls(_, y):
        return motion(y, 2.0 / 7.0 * speed * np.cross(Z, y[3:6]))

    def stops(_, y):
        return np.linalg.norm(slip(y)) - 1e-7

    stops.terminal = True
    exact = {"rtol": 1e-11, "atol": 1e-13, "dense_output": True}
    first = solve_ivp(slides, (0.0, t), [start, *np.zeros(8)], events=stops, **exact)
    begin = first.t[-1]
    assert 0.1 * t < begin < 0.5 * t
    # its velocity begins to turn at 2/7 Omega about a fixed point
    x, v = first.y[:3, -1], first.y[3:6, -1]
    turn = 2.0 / 7.0 * speed
    centre = x + np.cross(Z, v) / turn
    times = np.arange(1, looks + 1) * t / looks
    path = []
    for moment in times:
        angle = turn * (moment - begin)
        arm = x - centre
        path.append(
            first.sol(moment)[:2] if angle < 0.0
            else (centre + np.cos(angle) * arm + np.sin(angle) * np.cross(Z, arm))[:2]
        )  # fmt: skip
    errors = []
    for n in (100, 200, 400, 800, 1600):
        grains = Grains.create([[start, 0.0, R]], R, STEEL)
        table = Body("table", TimeProfile.constant(speed))
        dvi = DVI(grains, [annulus("face", "table", 0.0, 0.0, 1.0)], [table], DviContact(mu), dt=t / n,
                  gravity=(0.0, 0.0, -G), theta=theta, tolerance=1e-12)  # fmt: skip
        error = 0.0
        for where in path:
            dvi.run(n // looks)
            error = max(error, np.linalg.norm(grains.position[0, :2] - where))
        errors.append(error / start)
    assert _orders(errors) == pytest.approx(1.0, abs=0.05)
    assert errors[-1] < 2e-3


def _bounced(height, u, e, mu, t):
    """Exact place (x, height above the floor) of a sphere dropped from ``height`` with the speed u along the floor."""
    x, z, w, p = 0.0, height, 0.0, 0.0  # p = R omega: the surface that touches moves at u - p
    while True:
        fall = (w + np.sqrt(w * w + 2.0 * G * z)) / G
        if fall > t:
            return x + u * t, z + w * t - 0.5 * G * t * t
        x, z, w, t = x + u * fall, 0.0, w - G * fall, t - fall
        slip = u - p
        impulse = np.sign(slip) * min(-mu * (1.0 + e) * w, abs(slip) / 3.5)
        u, p, w = u - impulse, p + 2.5 * impulse, -e * w


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_oblique_bounces_with_friction_converge(theta):
    """Three or four rebounds with e = 0.7: place at a fixed time, along the floor and above it; order 1.

    Where in its step an impact falls is chance: the mean of 48 spheres. Large ones: an impact may come at a gap of v h,
    which adds to the lever of friction.
    """
    big, u, e, mu, t = 0.05, 1.0, 0.7, 0.15, 0.9
    drops = np.linspace(0.2, 0.3, 48)
    exact = np.array([_bounced(height, u, e, mu, t) for height in drops])
    errors = []
    for n in (300, 600, 1200, 2400, 4800):
        h = t / n
        lag = (theta - 0.5) * h  # of the velocities behind the positions
        where = np.stack([0.0 * drops, 3.0 * big * np.arange(len(drops)), big + drops], axis=1)
        grains = Grains.create(where, big, STEEL, velocity=[[u, 0.0, G * lag]] * len(drops))
        dvi = DVI(grains, [floor()], [Body("housing")], DviContact(mu, e), dt=h, gravity=DOWN, theta=theta)
        dvi.run(n)
        found = grains.position[np.argsort(grains.particle_id)][:, [0, 2]] - [0.0, big]
        errors.append(np.abs(found - exact).mean(axis=0))
    along, above = np.array(errors).T
    assert _orders(along) == pytest.approx(1.0, abs=0.25) and _orders(above) == pytest.approx(1.0, abs=0.25)
    assert along[-1] < 2e-3 and above[-1] < 3e-4


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_bounces_between_two_walls_converge(theta):
    """No weight, e = 0.8: a dozen spheres to and fro, place after six or seven rebounds; order 1."""
    gap, e, t = 0.02, 0.8, 0.3
    speeds = np.random.default_rng(0).uniform(1.0, 1.5, 48)

    def place(v):
        x, left, towards = 0.0, t, 1.0
        while (fly := (gap - towards * x) / v) < left:
            x, left, v, towards = towards * gap, left - fly, e * v, -towards
        return x + towards * v * left

    exact = np.array([place(v) for v in speeds])
    walls = [Plane(f"wall {s:+g}", "housing", [s * (gap + R), 0.0, 0.0], [-s, 0.0, 0.0]) for s in (-1.0, 1.0)]
    errors = []
    for n in (400, 800, 1600, 3200, 6400):
        where = np.stack([0.0 * speeds, 4.0 * R * np.arange(len(speeds)), 0.0 * speeds], axis=1)
        grains = Grains.create(where, R, STEEL, velocity=np.stack([speeds, 0.0 * speeds, 0.0 * speeds], axis=1))
        dvi = DVI(grains, walls, [Body("housing")], DviContact(0.3, e), dt=t / n, gravity=NONE, theta=theta)
        dvi.run(n)
        errors.append(np.abs(grains.position[np.argsort(grains.particle_id), 0] - exact).mean())
    assert _orders(errors) == pytest.approx(1.0, abs=0.25)
    assert errors[-1] < 0.01 * gap


def _cloud(h, e, theta, gravity, n=60, seed=4, threshold=0.01):
    """Grains that fly about in a box at rest, apart in the middle of the first step whatever theta is."""
    sites, side = lattice(n)
    rng = np.random.default_rng(seed)
    where = 2.5 * R * (sites - [0.5 * side, 0.5 * side, 0.0]) + 0.4 * R * rng.uniform(-1.0, 1.0, (n, 3))
    spin = 50.0 * rng.normal(size=where.shape)
    velocity = rng.normal(size=where.shape)
    where -= (1.0 - theta) * h * velocity
    grains = Grains.create(where, R, STEEL, velocity=velocity, angular_velocity=spin)
    box = Box((2.5 * R * side,) * 3)
    return DVI(grains, box.walls(), [Body("housing")], DviContact(0.4, e, threshold=threshold), dt=h, theta=theta,
               gravity=gravity, tolerance=1e-9)  # fmt: skip


@pytest.mark.parametrize("theta", [1.0, 0.5])
@pytest.mark.parametrize("h", [1e-4, 5e-4, 2e-3])
@pytest.mark.parametrize("gravity", [NONE, (0.0, 0.0, -G)])
def test_contacts_without_rebound_never_add_energy(h, theta, gravity):
    """e = 0, walls at rest: after a step there is no more kinetic energy than free flight would have given.

    The impulses take the shortest way, in the metric of the masses, to velocities that the laws admit, and rest is one
    of these. Without gravity kinetic energy never grows.
    """
    dvi = _cloud(h, 0.0, theta, gravity)
    g = dvi.grains
    begun = g.kinetic_energy()
    scale = begun + g.mass.sum() * G * R
    for _ in range(round(min(0.05 / h, 150))):
        before = g.kinetic_energy() + h * np.sum(g.mass * (g.velocity @ gravity))
        before += 0.5 * h**2 * g.mass.sum() * np.dot(gravity, gravity)
        dvi.run(1)
        assert g.kinetic_energy() <= before + 1e-12 * scale
    if not any(gravity):
        assert g.kinetic_energy() < 0.9 * begun  # they did collide


@pytest.mark.parametrize("theta", [1.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.9])
def test_energy_is_accounted_for_over_impacts(e, theta):
    """Kinetic + potential energy + h (theta - 1/2) F.v changes by the contacts' work less that of the stabilisation.

    The third term: positions move with (1 - theta) v + theta v', the work of gravity is with the mean. Whatever the
    contacts give or take is booked as impact and sliding, with either sign.
    """
    gravity, h = np.array([1.0, 0.0, -G]), 1e-3
    dvi = _cloud(h, e, theta, tuple(gravity))
    g = dvi.grains

    def energy():
        force = g.mass[:, None] * gravity
        return g.kinetic_energy() - np.sum(force * g.position) + h * (theta - 0.5) * np.sum(force * g.velocity)

    begun, scale = energy(), g.kinetic_energy()
    stabilised = 0.0
    for _ in range(20):
        before = energy()
        totals = dvi.run(10)
        stabilised += abs(totals.stabilisation_work)
        change = totals.energy_budget.contact_work - totals.stabilisation_work
        assert energy() - before == pytest.approx(change, abs=1e-11 * scale)
        assert sum(totals.energy_budget.dissipation.values()) == pytest.approx(
            -totals.energy_budget.contact_work, abs=1e-12 * scale
        )
    assert energy() < begun - 0.1 * scale
    assert stabilised > 0.0
