"""Rolling and twisting friction of rigid grains: closed forms, conservation, the law contact by contact, and DEM."""

import numpy as np
import pytest
from dvi_scenes import DOWN, NONE, STEEL, G, R, floor, in_drum

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall
from particles import (
    DEM,
    DVI,
    Body,
    DviContact,
    FreeShaft,
    Grains,
    LinearContact,
    RollingFriction,
    TwistingFriction,
    choose_time_step,
)  # fmt: skip
from particles.dvi import gauss_seidel as gs
from particles.dvi.contact_torques import CX, CZ
from particles.dvi.local_problem import in_disc

pytestmark = pytest.mark.physics
EPS = np.finfo(float).eps


def ball(h, velocity=NONE, spin=NONE, rolling=None, twisting=None, slope=0.0, wall=None, **more):
    """One ball on a plane; gravity is vertical, the plane falls towards -x for a slope [rad]."""
    up = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    grains = Grains.create([R * up], R, STEEL, velocity=[velocity], angular_velocity=[spin])
    return DVI(grains, [wall or floor(slope)], [Body("housing")], DviContact(0.5), dt=h, gravity=DOWN,
               rolling=rolling, twisting=twisting, **{"tolerance": 1e-10, **more})  # fmt: skip


def rolled(v, mu_r):
    """Distance in which a rolling ball stops: f R - mu_r R m g = J a/R, f = -m a make a = -(5/7) mu_r g."""
    return v * v / (2.0 * 5.0 / 7.0 * mu_r * G)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_a_rolling_ball_stops_after_the_known_distance(h, theta):
    """v^2/(2 (5/7) mu_r g); at theta = 1 the drift takes the new velocity: v h/2 less; what remains is a h^2."""
    v, mu_r = 0.5, 0.05
    dvi = ball(h, (v, 0.0, 0.0), (0.0, v / R, 0.0), RollingFriction(mu_r), theta=theta)
    energy = dvi.grains.kinetic_energy()
    totals = dvi.run(round(1.8 / h))
    late = (theta - 0.5) * v * h
    assert dvi.grains.position[0, 0] == pytest.approx(rolled(v, mu_r) - late, abs=5.0 / 7.0 * mu_r * G * h * h)
    assert np.abs(dvi.grains.velocity_force).max() < 1e-7
    assert totals.energy.dissipation["rolling"] == pytest.approx(energy, rel=1e-6)
    assert set(totals.energy.dissipation) == {"impact", "sliding", "rolling"}


@pytest.mark.parametrize("h", [1e-4, 2e-3])
def test_a_twisting_ball_stops_at_the_known_time(h):
    """J = 2/5 m R^2 under mu_w R m g: omega falls by (5/2) mu_w g/R a second, and stays 0."""
    spin, mu_w = 100.0, 0.1
    rate = 2.5 * mu_w * G / R
    dvi = ball(h, spin=(0.0, 0.0, spin), twisting=TwistingFriction(mu_w))
    energy = dvi.grains.kinetic_energy()
    dvi.run(int(0.9 * spin / rate / h))
    assert dvi.grains.angular_velocity[0, 2] == pytest.approx(spin - rate * dvi.time, rel=1e-9)
    left = dvi.grains.kinetic_energy()
    totals = dvi.run(int(0.2 * spin / rate / h))
    assert np.abs(dvi.grains.velocity_force).max() < 1e-8
    assert totals.energy.dissipation["twisting"] == pytest.approx(left, rel=1e-6)
    assert left < energy


@pytest.mark.parametrize(("below", "h"), [(True, 1e-3), (True, 1e-2), (False, 1e-3), (False, 1e-2)])
def test_a_ball_rests_on_slopes_up_to_mu_r_and_rolls_on_steeper_ones(below, h):
    """The lever of the weight is R sin, the bound mu_r R cos: rest for tan <= mu_r, else (5/7) g (sin - mu_r cos)."""
    slope = 0.1
    mu_r = np.tan(slope) * (1.01 if below else 0.9)
    dvi = ball(h, rolling=RollingFriction(mu_r), slope=slope)
    dvi.run(100)
    pull = 0.0 if below else 5.0 / 7.0 * G * (np.sin(slope) - mu_r * np.cos(slope))
    speed = dvi.grains.velocity[0] @ [-np.cos(slope), 0.0, -np.sin(slope)]
    assert speed == pytest.approx(pull * dvi.time, abs=1e-8)


@pytest.mark.parametrize("sizes", [(1.0, 1.0), (1.0, 0.4)])
def test_a_plastic_impact_of_two_free_grains(sizes):
    """r_n = v/(1/m_1 + 1/m_2); R_eff mu r_n is the change of J omega of both, rolling (gears) and twisting (axis x)."""
    r1, r2 = R * np.array(sizes)
    v, gear, mu_r, mu_w = 0.3, 0.8, 0.02, 0.03
    # surface speeds of gears are equal: the contact itself does not slip; the spins about x differ
    spins = [[90.0, gear / r1, 0.0], [-20.0, -gear / r2, 0.0]]
    grains = Grains.create([[0.0, 0.0, 0.0], [r1 + r2, 0.0, 0.0]], [r1, r2], STEEL,
                           velocity=[[v, 0.0, 0.0], NONE], angular_velocity=spins)  # fmt: skip
    dvi = DVI(grains, [], [], DviContact(0.5), dt=1e-4, gravity=NONE, tolerance=1e-12,
              rolling=RollingFriction(mu_r), twisting=TwistingFriction(mu_w))  # fmt: skip
    x, m, inertia, r_eff = grains.position.copy(), grains.mass.copy(), grains.inertia.copy(), r1 * r2 / (r1 + r2)
    before, energy = grains.angular_velocity.copy(), grains.kinetic_energy()
    whole = np.cross(x, m[:, None] * grains.velocity).sum(0) + inertia @ before
    totals = dvi.run(1)
    r_n = v / np.sum(1.0 / m)
    turned = inertia[:, None] * (grains.angular_velocity - before)
    assert turned[0, 0] == pytest.approx(-mu_w * r_eff * r_n, rel=1e-9)
    assert turned[1, 0] == pytest.approx(-turned[0, 0], rel=1e-9)
    if sizes[0] == sizes[1]:  # else the torque of rolling makes a gear slip, and friction answers
        assert turned[0, 1] == pytest.approx(-mu_r * r_eff * r_n, rel=1e-9)
    after = np.cross(x, m[:, None] * grains.velocity).sum(0) + inertia @ grains.angular_velocity
    assert after == pytest.approx(whole, rel=1e-12, abs=1e-12 * np.abs(whole).max())
    lost = totals.energy.dissipation
    assert lost["rolling"] > 0.0
    assert lost["twisting"] > 0.0
    assert energy - grains.kinetic_energy() == pytest.approx(sum(lost.values()), rel=1e-10)


def test_a_grain_that_spins_on_another_one():
    """The upper one loses (mu_w R_eff m g)/J a second; the lower one stays, held by the floor's larger bound."""
    r1, r2, mu_w, spin = 0.6 * R, R, 0.2, 50.0
    grains = Grains.create([[0.0, 0.0, r2], [0.0, 0.0, 2.0 * r2 + r1]], [r2, r1], STEEL,
                           angular_velocity=[NONE, [0.0, 0.0, spin]])  # fmt: skip
    dvi = DVI(grains, [floor()], [Body("housing")], DviContact(0.3), dt=1e-3, gravity=DOWN, tolerance=1e-10,
              twisting=TwistingFriction(mu_w))  # fmt: skip
    upper = int(np.argmax(grains.position[:, 2]))
    rate = mu_w * r1 * r2 / (r1 + r2) * G / (0.4 * r1 * r1)
    dvi.run(int(0.8 * spin / rate / dvi.dt))
    assert grains.angular_velocity[upper, 2] == pytest.approx(spin - rate * dvi.time, rel=1e-8)
    assert np.abs(grains.angular_velocity[1 - upper]).max() < 1e-6
    dvi.run(int(0.4 * spin / rate / dvi.dt))
    assert np.abs(grains.angular_velocity).max() < 1e-6


def test_dem_rolls_as_far():
    """Stiff springs and dashpots against none: both within 2 % of the closed form."""
    v, mu_r = 0.05, 0.05
    contact = LinearContact.from_restitution(2e4, 0.5, 0.5)
    dt = choose_time_step(contact, STEEL * 4.0 / 3.0 * np.pi * R**3, R).dt
    grains = Grains.create([[0.0, 0.0, R - 1e-7]], R, STEEL, velocity=[[v, 0.0, 0.0]],
                           angular_velocity=[[0.0, v / R, 0.0]])  # fmt: skip
    dem = DEM(grains, [floor()], [Body("housing")], contact, dt=dt, gravity=DOWN, rolling=RollingFriction(mu_r))
    dem.run(round(0.2 / dt))
    dvi = ball(5e-4, (v, 0.0, 0.0), (0.0, v / R, 0.0), RollingFriction(mu_r), theta=0.5)
    dvi.run(400)
    assert dvi.grains.position[0, 0] == pytest.approx(dem.grains.position[0, 0], rel=0.02)
    assert dvi.grains.position[0, 0] == pytest.approx(rolled(v, mu_r), rel=1e-3)


# -- beds
# --------------------------------------------------------------------------------------------------------------------


def bed(motion=None, n=40, speed=0.0, gravity=DOWN, **more):
    """Grains of many sizes, poured into a drum about z that turns as ``motion`` says, with a floor that stands."""
    rng = np.random.default_rng(11)
    where, walls = in_drum(n, "housing" if motion is None else "drum")
    grains = Grains.create(where, 0.005 * rng.uniform(0.6, 1.0, n), STEEL, velocity=0.1 * rng.normal(size=(n, 3)),
                           angular_velocity=40.0 * rng.normal(size=(n, 3)))  # fmt: skip
    bodies = [Body("drum", motion or TimeProfile.constant(speed), speed=speed), Body("housing")]
    return DVI(grains, walls, bodies, DviContact(0.4, more.pop("restitution", 0.0)), dt=1e-3, gravity=gravity,
               **{"rolling": RollingFriction(0.1, 0.2), "twisting": TwistingFriction(0.05, 0.03), "tolerance": 1e-9,
                  "max_sweeps": 5000, **more})  # fmt: skip


def test_the_law_holds_in_every_contact_of_a_bed():
    """From the records of a step, in N m s and rad/s: bounds, and torques against the relative spin; spins obey J."""
    dvi = bed(speed=6.0)
    dvi.run(150)
    grains = dvi.grains
    before = grains.angular_velocity.copy()
    totals = dvi.run(1)
    assert totals.missed_steps == 0
    _, body, pair_index, pair, wall_index, wall = dvi._records()
    r, spin = grains.radius, grains.angular_velocity
    _, pair_torque, wall_torque = dvi._contact_torques
    gained = np.zeros_like(spin)
    loads = {"rest": 0, "roll": 0}
    for index, rows, contact_torques, kind in ((pair_index, pair, pair_torque, 0), (wall_index, wall, wall_torque, 1)):
        for (i, j), row, c in zip(index, rows, contact_torques[: len(rows), CX : CZ + 1], strict=True):
            e, impulse = row[: gs.ARM], row[gs.RX : gs.RZ + 1]
            gained[i] += np.cross(-r[i] * row[gs.ARM] * e, impulse)
            if kind == 0:
                arm, relative = r[i] * r[j] / (r[i] + r[j]), spin[i] - spin[j]
                gained[j] += np.cross(-r[j] * row[gs.ARM] * e, impulse) - arm * c
            else:
                arm, relative = r[i], spin[i] - [0.0, 0.0, body[j, gs.SPEED]]
            gained[i] += arm * c
            for mu, part in (((0.1, 0.2)[kind], np.eye(3) - np.outer(e, e)), ((0.05, 0.03)[kind], np.outer(e, e))):
                contact_torque, turning, bound = arm * part @ c, part @ relative, mu * arm * (impulse @ e)
                size, rate = np.linalg.norm(contact_torque), arm * np.linalg.norm(turning)
                assert size <= bound * (1.0 + 1e-9) + 1e-18
                if size < 0.999 * bound:
                    loads["rest"] += 1
                    assert rate < 3e-9
                elif rate > 1e-6:
                    loads["roll"] += 1
                    assert contact_torque @ turning == pytest.approx(-size * rate / arm, rel=1e-3)
    assert min(loads.values()) > 5
    assert grains.inertia[:, None] * (spin - before) == pytest.approx(gained, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(("theta", "restitution"), [(0.5, 0.0), (1.0, 0.0), (1.0, 0.6)])
def test_the_books_of_energy_close(theta, restitution):
    """Kinetic energy, works and losses, a torque of the torques on a driven drum among them, to round-off."""
    dvi = bed(speed=8.0, theta=theta, restitution=restitution)
    lost = {"rolling": 0.0, "twisting": 0.0}
    for _ in range(10):
        totals = dvi.run(20)
        energy, size = totals.energy, dvi.grains.kinetic_energy()
        given = energy.gravity_work + sum(energy.wall_work.values()) - sum(energy.dissipation.values())
        assert energy.kinetic_change == pytest.approx(given, rel=1e-10, abs=EPS * size * totals.visits)
        lost = {name: lost[name] + energy.dissipation[name] for name in lost}
    assert min(lost.values()) > 0.0


def test_energy_never_grows_in_a_resting_drum():
    dvi = bed(gravity=NONE)
    energy = dvi.grains.kinetic_energy()
    for _ in range(40):
        dvi.run(5)
        now = dvi.grains.kinetic_energy()
        assert now <= energy * (1.0 + 1e-9)
        energy = now
    assert energy > 0.0


@pytest.mark.parametrize("fraction", [1e-2, 1.0, 1e4])
def test_a_free_shaft_takes_the_angular_momentum(fraction):
    """J from a hundredth to 1e4 times a grain's m R_drum^2; the floor turns with the drum: nothing else has any.

    Impulses of a contact act on both partners alike, so only round-off is left: each visit of a contact writes the
    velocity and spin of both, some ten products of the size of the largest parts of L each.
    """
    inertia = fraction * STEEL * 4.0 / 3.0 * np.pi * R**3 * 0.03**2
    dvi = bed(FreeShaft(inertia=inertia), n=25, speed=10.0)
    drum = dvi.bodies[0]

    def momentum():
        return dvi.grains.angular_momentum_z() + inertia * drum.speed

    def energy():
        return dvi.grains.kinetic_energy() + 0.5 * inertia * drum.speed**2

    def parts():
        grains = dvi.grains
        radius, speed = (np.linalg.norm(one[:, :2], axis=1) for one in (grains.position, grains.velocity))
        orbit, spin = grains.mass * radius * speed, grains.inertia * np.abs(grains.angular_velocity[:, 2])
        return float((orbit + spin).sum()) + inertia * abs(drum.speed)

    kept, missed, turned = 0, 0, 0.0
    for _ in range(100):
        size = parts()
        before, had, speed = momentum(), energy(), drum.speed
        totals = dvi.run(1)
        missed += totals.missed_steps
        energy_budget = totals.energy
        changed = energy_budget.gravity_work - sum(energy_budget.dissipation.values())
        assert energy() - had == pytest.approx(changed, rel=1e-9, abs=10.0 * EPS * had * (totals.visits + 1))
        if totals.projections == 0:  # what removes overlap moves grains, and conserves no angular momentum
            kept += 1
            turned += inertia * abs(drum.speed - speed)
            round_off = 10.0 * EPS * max(size, parts()) * (totals.visits + 1)
            assert momentum() == pytest.approx(before, rel=0.0, abs=round_off)
    assert missed <= 2
    assert kept > 20
    assert turned > 0.0


@pytest.mark.parametrize("inertia", [1e-9, 1e-6, 1e-3])
def test_a_ball_that_twists_on_a_free_turntable(inertia):
    """About the shaft's own axis: the bound's torque until both turn alike, at J_1 omega/(J_1 + J)."""
    spin, mu_w = 60.0, 0.1
    grains = Grains.create([[0.0, 0.0, R]], R, STEEL, angular_velocity=[[0.0, 0.0, spin]])
    table = Body("housing", FreeShaft(inertia=inertia))
    dvi = DVI(grains, [floor()], [table], DviContact(0.5), dt=1e-3, gravity=DOWN, tolerance=1e-10,
              twisting=TwistingFriction(mu_w), rolling=RollingFriction(0.05))  # fmt: skip
    own = float(grains.inertia[0])
    contact_torque = mu_w * R * float(grains.mass[0]) * G
    same = spin / (contact_torque / own + contact_torque / inertia)
    steps = int(0.5 * same / dvi.dt)
    dvi.run(steps)
    assert grains.angular_velocity[0, 2] == pytest.approx(spin - contact_torque / own * steps * dvi.dt, rel=1e-9)
    dvi.run(int(0.6 * same / dvi.dt) + 2)
    end = own * spin / (own + inertia)
    assert [grains.angular_velocity[0, 2], table.speed] == pytest.approx([end, end], rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_couple_of_a_free_shaft_is_the_best_one_of_the_disc(seed):
    """(a x^2 + b y^2)/2 - f x - g y against the rim and the inside, sampled."""
    rng = np.random.default_rng(seed)
    a, b, f, g = 10.0 ** rng.uniform(-3.0, 3.0), 1.0, *rng.normal(size=2)
    for limit in (1e-6, 0.1, 1.0, 100.0):
        x, y = in_disc(a, b, limit, f, g)
        assert np.hypot(x, y) <= limit * (1.0 + 1e-12)
        angle, fraction = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 2001), np.linspace(0.0, 1.0, 51))
        u, v = limit * fraction * np.cos(angle), limit * fraction * np.sin(angle)
        value = 0.5 * (a * u * u + b * v * v) - f * u - g * v
        assert 0.5 * (a * x * x + b * y * y) - f * x - g * y <= value.min() + 1e-12 * np.abs(value).max()


# -- the loop
# --------------------------------------------------------------------------------------------------------------------


def test_a_restart_goes_on_bit_for_bit():
    whole, first = bed(speed=6.0), bed(speed=6.0)
    whole.run(140)
    first.run(70)
    state = first.state()
    assert np.count_nonzero(state["list_pair_impulse"][:, 3:]) > 0
    second = bed(speed=6.0)
    second.restore(state)
    second.run(70)
    for name in ("position_radius", "velocity_force", "particle_id"):
        assert np.array_equal(getattr(whole.grains, name), getattr(second.grains, name))


def test_couples_start_from_those_of_the_step_before():
    """A bed at rest needs a sweep or two a step, also after its list is rebuilt."""
    dvi = bed(tolerance=1e-7)
    dvi.run(600)
    assert dvi.run(20).sweeps <= 60
    contact_torques = np.sort(np.abs(dvi.state()["list_pair_impulse"][:, 3:]).sum(axis=1))
    dvi.invalidate()
    assert dvi.run(20).sweeps <= 60
    assert np.sort(np.abs(dvi.state()["list_pair_impulse"][:, 3:]).sum(axis=1))[-5:] == pytest.approx(
        contact_torques[-5:], rel=0.1
    )


def test_coefficients_of_zero_are_none():
    """Bit for bit, and nothing is stored for them."""
    without, zero = (
        bed(speed=6.0, rolling=rolling, twisting=twisting)
        for rolling, twisting in ((None, None), (RollingFriction(0.0), TwistingFriction(0.0)))
    )
    for dvi in (without, zero):
        totals = dvi.run(60)
        assert set(totals.energy.dissipation) == {"impact", "sliding"}
        assert dvi.state()["list_pair_impulse"].shape[1] == 3
    assert np.array_equal(without.grains.position_radius, zero.grains.position_radius)
    assert np.array_equal(without.grains.velocity_force, zero.grains.velocity_force)


def test_a_state_with_couples_is_refused_where_there_are_none():
    with pytest.raises(ValueError, match="rolling or twisting friction"):
        bed(rolling=None, twisting=None).restore(bed().state())


def test_the_convex_law_stops_a_rolling_ball_as_far_on():
    """A ball that rolls does not slip, so that nothing lifts it."""
    v, mu_r, h = 0.5, 0.05, 1e-3
    dvi = ball(h, (v, 0.0, 0.0), (0.0, v / R, 0.0), RollingFriction(mu_r), theta=0.5, friction_cone="convex",
               tolerance=1e-9)  # fmt: skip
    totals = dvi.run(1800)
    assert totals.missed_steps == 0
    assert dvi.grains.position[0, 0] == pytest.approx(rolled(v, mu_r), rel=1e-3)


def test_a_ball_stops_on_triangles_as_on_a_plane():
    """Over a dozen edges: torques are handed on with the impulses."""
    x = np.linspace(-0.1, 0.5, 13)
    corners = np.array([(s, y, 0.0) for s in x for y in (-0.1, 0.1)])
    strips = [t for k in range(0, 24, 2) for t in ([k, k + 2, k + 3], [k, k + 3, k + 1])]
    wall = TriangleWall("floor", "housing", corners, np.array(strips))
    v, mu_r, h = 0.5, 0.05, 1e-3
    dvi = ball(h, (v, 0.0, 0.0), (0.0, v / R, 0.0), RollingFriction(mu_r), theta=0.5, wall=wall)
    dvi.run(1800)
    assert dvi.grains.position[0, 0] == pytest.approx(rolled(v, mu_r), abs=5.0 / 7.0 * mu_r * G * h * h)


def test_a_ball_on_springs_stops_as_far_on():
    """Compliant contacts have the same torque; it follows their normal impulse, which is m g h once they rest."""
    v, mu_r, h = 0.5, 0.05, 1e-3
    k = np.full((2, 2), 1e4)
    dvi = ball(h, (v, 0.0, 0.0), (0.0, v / R, 0.0), RollingFriction(mu_r), theta=0.5, stiffness=k)
    dvi.run(1800)
    assert dvi.grains.position[0, 0] == pytest.approx(rolled(v, mu_r), rel=0.01)


def test_a_ball_on_springs_winds_them_up_on_a_slope_and_rests():
    """m g sin/k_t by the tangential spring, and as much by that of rolling, k_r = k_t R^2 as DEM's; both are stored."""
    slope, k_t = 0.1, 2e3
    dvi = ball(1e-3, slope=slope, rolling=RollingFriction(0.2), stiffness=np.array([[1e4, k_t], [1e4, k_t]]))
    totals = dvi.run(400)
    along = np.array([-np.cos(slope), 0.0, -np.sin(slope)])
    pull = float(dvi.grains.mass[0]) * G * np.sin(slope)
    assert dvi.grains.position[0] @ along == pytest.approx(2.0 * pull / k_t, rel=1e-3)
    assert np.abs(dvi.grains.velocity_force).max() < 1e-6
    # the lever of the weight is shorter than R by the overlap, 0.08 %
    assert dvi._springs[[1, 2]] == pytest.approx([0.5 * pull * pull / k_t] * 2, rel=3e-3)
    energy_budget = totals.energy
    given = energy_budget.gravity_work - sum(energy_budget.dissipation.values())
    assert energy_budget.kinetic_change + energy_budget.elastic_change == pytest.approx(given, rel=1e-9)


def test_the_books_of_a_bed_on_springs_close():
    """Their energies among them; and it continues bit for bit after a restart."""
    stiffness = np.full((2, 2), 5e4)
    dvi, other = bed(speed=8.0, stiffness=stiffness), bed(speed=8.0, stiffness=stiffness)
    for _ in range(5):
        energy = dvi.run(20).energy
        given = energy.gravity_work + sum(energy.wall_work.values()) - sum(energy.dissipation.values())
        assert energy.kinetic_change + energy.elastic_change == pytest.approx(given, rel=1e-9, abs=1e-15)
        assert energy.dissipation["rolling"] + energy.dissipation["twisting"] > 0.0
    state = dvi.state()
    dvi.run(40)
    other.restore(state)
    other.run(40)
    assert np.array_equal(dvi.grains.velocity_force, other.grains.velocity_force)
