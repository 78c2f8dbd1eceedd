"""Rigid grains on vanes, ribs and meshes: inclines, turning vanes, free shafts with a lever on the normal."""

import numpy as np
import pytest
from dvi_scenes import NONE, G, R

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall, box_surface
from geometry.walls import annulus, cylinder
from particles import DVI, Body, DviContact, FreeShaft, Grains

pytestmark = pytest.mark.physics


@pytest.mark.parametrize(("slope", "mu"), [(20.0, 0.3), (50.0, 0.3)])
def test_incline(slope, mu):
    """Over a dozen edges: rolls with 5/7 g sin if tan <= 3.5 mu, else slides with g (sin - mu cos), for every h."""
    a = np.radians(slope)
    x = np.linspace(-0.1, 0.5, 13)
    corners = [(s * np.cos(a), y, -s * np.sin(a)) for s in x for y in (-0.1, 0.1)]
    strips = [t for k in range(0, 24, 2) for t in ([k, k + 2, k + 3], [k, k + 3, k + 1])]
    wall = TriangleWall("incline", "housing", np.array(corners), np.array(strips))
    up, down = np.array([np.sin(a), 0.0, np.cos(a)]), np.array([np.cos(a), 0.0, -np.sin(a)])
    h, steps = 2e-3, 150
    grains = Grains.create([R * up], R, 7850.0)
    dvi = DVI(grains, [wall], [Body("housing")], DviContact(mu), dt=h, gravity=(0.0, 0.0, -G), tolerance=1e-12)
    dvi.run(steps)
    rolls = np.tan(a) <= 3.5 * mu
    pull = 5.0 / 7.0 * G * np.sin(a) if rolls else G * (np.sin(a) - mu * np.cos(a))
    spin = pull / R if rolls else 5.0 * mu * G * np.cos(a) / (2.0 * R)
    assert grains.velocity[0] == pytest.approx(pull * h * steps * down, abs=1e-9)
    assert grains.angular_velocity[0] == pytest.approx([0.0, spin * h * steps, 0.0], rel=1e-9, abs=1e-9)


def _vane(motion, mu, e, h, x=0.1, velocity=NONE, gap=0.0, **more):
    """A grain before a radial vane whose face lies at y = 2 mm."""
    wall = box_surface("vane", "rotor", (0.0, 0.0, 0.0), (0.8, 4e-3, 0.1))
    grains = Grains.create([[x, 2e-3 + R + gap, 0.0]], R, 7850.0, velocity=[velocity])
    rotor = Body("rotor", motion, speed=more.pop("speed", 0.0))
    return DVI(grains, [wall], [rotor], DviContact(mu, e), dt=h, gravity=NONE, tolerance=1e-13, **more)


@pytest.mark.parametrize(("mu", "e"), [(0.0, 0.0), (0.0, 0.5), (10.0, 0.0)])
def test_a_turning_vane_strikes_a_grain(mu, e):
    """v_n = (1 + e) omega x; what sticks gets 2/7 of the wall's velocity along the face, v_t = -2/7 omega y."""
    speed = 20.0
    dvi = _vane(TimeProfile.constant(speed), mu, e, 1e-4)
    dvi.run(1)
    along = -2.0 / 7.0 * speed * 2e-3 if mu else 0.0
    assert dvi.grains.velocity[0] == pytest.approx([along, (1.0 + e) * speed * 0.1, 0.0], abs=1e-12)


def test_a_vane_reaches_a_grain_but_does_not_cross_it():
    """With a gap g the grain is given omega x - g/h: in the next middle they touch, to the curvature of the path."""
    speed, h, gap = 20.0, 1e-3, 0.5e-3
    dvi = _vane(TimeProfile.constant(speed), 0.0, 0.0, h, gap=gap)
    dvi.run(1)
    assert dvi.grains.velocity[0, 1] == pytest.approx(speed * 0.1 - gap / h, abs=1e-12)
    assert dvi.run(1).max_overlap < 0.5 * (speed * h) ** 2


@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_a_grain_is_flung_along_a_vane(theta):
    """Without friction, in the vane's frame x'' = omega^2 x: x = x_0 cosh(omega t), at first order in h.

    It keeps to the face at second order: were the body's angle taken at another time than the positions, half a step
    away, the gap would be omega x h/2.
    """
    speed, x, t = 20.0, 0.05, 0.1
    errors, gaps = [], []
    for n in (50, 100, 200):
        start = (-speed * (2e-3 + R), speed * x, 0.0)
        dvi = _vane(TimeProfile.constant(speed), 0.0, 0.0, t / n, x, start, theta=theta)
        assert dvi.run(n).missed_steps == 0
        angle = dvi.bodies[0].angle
        assert angle == pytest.approx(speed * t, rel=1e-12)
        along = dvi.grains.position[0] @ [np.cos(angle), np.sin(angle), 0.0]
        across = dvi.grains.position[0] @ [-np.sin(angle), np.cos(angle), 0.0]
        errors.append(abs(along / (x * np.cosh(speed * t)) - 1.0))
        gaps.append(abs(across - 2e-3 - R))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([1.0, 1.0], abs=0.1)
    assert np.log2(np.array(gaps[:-1]) / gaps[1:]).min() > 1.8
    assert errors[-1] < 0.05 and gaps[-1] < 0.1 * speed * along * t / n


@pytest.mark.parametrize("log_inertia", [-2, 0, 3])
@pytest.mark.parametrize("mu", [0.0, 0.2, 10.0])
def test_a_free_vane_is_struck(log_inertia, mu):
    """The whole 3 x 3 block against matrices by hand: the normal has a lever, and so has friction.

    Impulse r on the grain: u = u_0 + W r; u_n = 0, and sticks (u = 0) or slides along -u_t with |r_t| = mu r_n, in
    the plane of the shaft (planar impact: one direction of slip), which need not be that of u_0.
    """
    x, velocity = 0.02, np.array([0.3, -1.0, 0.0])
    dvi = _vane(FreeShaft(1.0), mu, 0.0, 1e-4, x, velocity)
    mass, j = dvi.grains.mass[0], dvi.grains.mass[0] * x**2 * 10.0**log_inertia
    dvi = _vane(FreeShaft(j), mu, 0.0, 1e-4, x, velocity)
    # rows: normal y, tangent x; the contact point is (x, 2 mm), and the shaft gives it omega (-2 mm, x)
    lever = np.array([x, -2e-3])
    w = np.diag([1.0 / mass, 3.5 / mass]) + np.outer(lever, lever) / j
    u = velocity[[1, 0]]
    r = np.linalg.solve(w, -u)
    if abs(r[1]) > mu * r[0]:
        slide = [np.array([1.0, s * mu]) * (-u[0] / (w[0, 0] + s * mu * w[0, 1])) for s in (-1.0, 1.0)]
        r = next(p for p in slide if p[0] > 0.0 and (u + w @ p)[1] * p[1] <= 0.0)
    totals = dvi.run(1)
    assert dvi.grains.velocity[0] == pytest.approx(velocity + np.array([r[1], r[0], 0.0]) / mass, abs=1e-10)
    assert dvi.bodies[0].speed == pytest.approx(-(lever @ r) / j, abs=1e-10 * (1.0 + abs(lever @ r) / j))
    assert totals.torque_on("rotor") * dvi.dt == pytest.approx(-(lever @ r), rel=1e-9, abs=1e-15)
    assert totals.residual <= 1e-13 * 10.0


def test_a_ribbed_drum_keeps_angular_momentum():
    """48 grains flung about in a ribbed drum on a free shaft: L about the axis to round-off, the residual small."""
    ribs = [
        box_surface(f"rib{k}", "drum", 0.05 * np.array([np.cos(a), np.sin(a), 0.0]), (8e-3, 6e-3, 0.05), a)
        for k, a in enumerate(2.0 * np.pi / 5.0 * np.arange(5))
    ]
    walls = [
        cylinder("shell", "drum", 0.05, -0.02, 0.02), annulus("low", "drum", -0.02, 0.0, 0.05),
        annulus("high", "drum", 0.02, 0.0, 0.05), *ribs,
    ]  # fmt: skip
    rng = np.random.default_rng(2)
    a, r, z = np.meshgrid(np.arange(8) * 0.25 * np.pi, (0.013, 0.035), (-0.012, 0.0, 0.012), indexing="ij")
    where = np.column_stack([r.ravel() * np.cos(a.ravel()), r.ravel() * np.sin(a.ravel()), z.ravel()])
    grains = Grains.create(where, 4e-3, 7850.0, velocity=rng.normal(0.0, 1.0, where.shape))
    j = 2e-5
    drum = Body("drum", FreeShaft(j), speed=-30.0)
    dvi = DVI(grains, walls, [drum], DviContact(0.3, 0.7), dt=2e-4, gravity=NONE, tolerance=1e-10)
    size = j * 30.0
    normal = 0.0
    for _ in range(200):
        # where overlap is pushed out, the positions keep no angular momentum: over the velocities alone it is kept
        before = grains.angular_momentum_z() + j * drum.speed
        totals = dvi.run(1)
        change = grains.angular_momentum_z() + j * drum.speed - before
        assert totals.residual <= 1e-10 and totals.missed_steps == 0
        if totals.projections == 0:
            assert abs(change) < 1e-13 * size
        normal = max(normal, abs(totals.torque["drum"]["normal"]))
    assert normal > 0.0  # ribs were struck


def test_a_drum_slips_on_a_held_grain():
    """A grain held on a flat mesh that turns freely: omega = omega_0 - mu m g r t/J, to the stop."""
    corners = 0.2 * np.array([[np.cos(a), np.sin(a), 0.0] for a in 2.0 * np.pi / 7.0 * np.arange(7)])
    fan = np.array([[7, k, (k + 1) % 7] for k in range(7)])
    disc = TriangleWall("disc", "drum", np.vstack([corners, [[0.0, 0.0, 0.0]]]), fan)
    x, mu, j, speed, h = 0.1, 0.3, 1e-4, 12.0, 1e-3
    grains = Grains.create([[x, 0.0, R]], R, 7850.0)
    drum = Body("drum", FreeShaft(j), speed=speed)
    dvi = DVI(grains, [disc], [drum], DviContact(mu), dt=h, gravity=(0.0, 0.0, -G), tolerance=1e-12)
    torque = mu * grains.mass[0] * G * x
    stop = speed * j / torque
    steps = int(0.9 * stop / h)

    def turn(steps):
        for _ in range(steps):
            dvi.grains.position[:], dvi.grains.velocity[:], dvi.grains.angular_velocity[:] = (x, 0.0, R), 0.0, 0.0
            totals = dvi.run(1)
        return totals

    assert turn(steps).torque_on("drum") == pytest.approx(-torque, rel=1e-9)
    assert drum.angle > 2.0 * np.pi / 7.0  # over edges
    assert drum.speed == pytest.approx(speed - torque * steps * h / j, rel=1e-9)
    turn(steps // 4)
    assert abs(drum.speed) < 1e-6
