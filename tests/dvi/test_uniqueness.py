"""What the contact laws determine and what they leave open: shafts, wedged grains, contacts that contradict each other.

One step is solved from several starts: from no impulses (cold), from those of the step before (warm), and from these
times random numbers between 0 and 2, contact by contact (perturbed).
"""

import numpy as np
import pytest
from dvi_scenes import CORE, DRUM, STEEL, G, R, in_ring

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import box_surface
from geometry.walls import annulus
from particles import Body, DemError, DemErrorKind, FreeShaft, Grains
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

pytestmark = pytest.mark.physics

H = 1e-3
TOLERANCE = 1e-11
INERTIA = 1e-4  # of the drum: that of 50 grains at its radius
STARTS = ("cold", "warm", "perturbed", "perturbed")


def _bed(friction, seed, steps=300, n=60):
    """Grains settled on the floor of a drum on a free shaft, sheared by a core that turns at 20 rad/s."""
    grains, walls = in_ring(n, seed, 0.06, sizes=(0.8, 1.0))
    bodies = [Body("rotor", TimeProfile.constant(20.0)), Body("drum", FreeShaft(INERTIA))]
    dvi = DVI(grains, walls, bodies, DviContact(0.4), dt=H, gravity=(0.0, 0.0, -G), friction_cone=friction,
              tolerance=1e-6, max_sweeps=5000)  # fmt: skip
    dvi.run(steps)
    dvi.tolerance, dvi.max_sweeps = TOLERANCE, 20_000
    return dvi


def _from(dvi, state, start, rng):
    """The totals of one step after ``state``, and all velocities (by the grains' numbers), the drum's last."""
    state = dict(state)
    for name in ("list_pair_impulse", "list_wall_impulse"):
        size = (len(state[name]), 1)
        state[name] = state[name] * {"cold": 0.0, "warm": 1.0}.get(start, rng.uniform(0.0, 2.0, size))
    dvi.restore(state)
    totals = dvi.run(1)
    g = dvi.grains
    order = np.argsort(g.particle_id)
    spins = g.angular_velocity * g.radius[:, None]
    return totals, np.concatenate([g.velocity[order].ravel(), spins[order].ravel(), [dvi.bodies[-1].speed]])


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_the_convex_law_determines_a_free_shaft(seed):
    """A strictly convex programme: all velocities, the shaft's among them, are the same from every start."""
    dvi = _bed("convex", seed)
    state, rng = dvi.state(), np.random.default_rng(0)
    found = []
    for start in STARTS:
        totals, velocities = _from(dvi, state, start, rng)
        assert totals.residual <= TOLERANCE and totals.n_contacts > 60
        found.append(velocities)
    change = abs(found[0][-1] - state["bodies"][1, 1])
    assert change > 1e-4
    for other in found[1:]:
        assert other == pytest.approx(found[0], abs=1e-8)
        assert other[-1] == pytest.approx(found[0][-1], abs=1e-5 * change)


def test_exact_coulomb_leaves_little_open_in_a_sheared_bed():
    """Every start solves the laws to 1e-11 m/s; the drum's torque agrees within a few per cent, mostly far better.

    It need not agree at all (see the wedged grain). What must: the balance of angular momentum, core included.
    """
    spreads, sizes = [], []
    for seed in range(4):
        dvi = _bed("coulomb", seed)
        state, rng = dvi.state(), np.random.default_rng(0)

        def momentum(dvi=dvi):
            return dvi.grains.angular_momentum_z() + INERTIA * dvi.bodies[1].speed

        torques = []
        for start in STARTS:
            dvi.restore(state)
            before = momentum()
            totals, _ = _from(dvi, state, start, rng)
            assert totals.residual <= TOLERANCE
            scale = H * 0.4 * dvi.grains.mass.sum() * G * DRUM
            # exact but for overlap that is removed from positions
            assert momentum() - before == pytest.approx(-H * totals.torque_on("rotor"), abs=1e-4 * scale)
            torques.append(totals.torque_on("drum"))
        spreads.append(np.ptp(torques))
        sizes.append(np.mean(np.abs(torques)))
    assert max(spreads) < 0.1 * np.mean(sizes)
    assert np.median(spreads) < 0.02 * np.mean(sizes)


def _wedged(squeeze, friction="coulomb"):
    """A grain that just fits between a floor at rest and a turning lid, pressed upon by ``squeeze`` [N s] in the start.

    Returns the lid's drag and the grain's speed, as chunks of 0.35 m Omega a and Omega a, the totals, and the drag's
    share for each N s of squeeze.
    """
    mu, a, speed = 0.5, 0.05, 4.0
    walls = [annulus("floor", "low", 0.0, 0.0, 0.1), annulus("lid", "high", 2.0 * R, 0.0, 0.1)]
    bodies = [Body("low"), Body("high", TimeProfile.constant(speed))]
    grains = Grains.create([[a, 0.0, R]], R, STEEL)
    dvi = DVI(grains, walls, bodies, DviContact(mu), dt=H, gravity=(0.0, 0.0, -G), friction_cone=friction,
              tolerance=1e-12)  # fmt: skip
    state = dvi.state()
    state["list_wall_impulse"][:, 2] = np.where(state["list_wall_other"] == 0, squeeze, -squeeze)
    dvi.restore(state)
    totals = dvi.run(1)
    sticking = 0.35 * grains.mass[0] * speed * a
    return -totals.torque_on("high") * H / a / sticking, grains.velocity[0, 1] / (speed * a), totals, mu / sticking


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 0.9, 1.0, 3.0])
def test_torque_on_prescribed_shafts_is_not_unique(fraction):
    """A wedged grain: any squeeze N keeps itself up, and with it a torque: each is a solution of exact Coulomb.

    The lid drags with min(mu N, 0.35 m Omega a), at the latter the grain rolls at both (v = Omega a/2). The floor's
    friction, 3/7 of the lid's, keeps it rolling on the floor.
    """
    per_squeeze = _wedged(0.0)[3]
    drag, speed, totals, _ = _wedged(fraction / per_squeeze)
    assert totals.residual < 1e-12 and totals.missed_steps == 0
    assert drag == pytest.approx(min(fraction, 1.0), abs=1e-9)
    assert speed == pytest.approx(0.5 * min(fraction, 1.0), abs=1e-9)
    assert totals.force["high"][2] == pytest.approx(fraction / per_squeeze / H, rel=1e-9)


@pytest.mark.parametrize("fraction", [0.0, 0.5, 3.0])
def test_the_convex_law_lets_no_wedged_grain_slip(fraction):
    """Slip at floor or lid would open it, which the other one forbids: the grain rolls, whatever the start."""
    per_squeeze = _wedged(0.0)[3]
    drag, speed, totals, _ = _wedged(fraction / per_squeeze, "convex")
    assert totals.missed_steps == 0
    assert drag == pytest.approx(1.0, abs=1e-6)
    assert speed == pytest.approx(0.5, abs=1e-6)


@pytest.mark.hard
@pytest.mark.parametrize("solver", ["gauss_seidel", "accelerated"])
def test_contacts_that_contradict_each_other_are_missed_not_blown_up(solver):
    """A grain between two vanes that close at 2 c has no solution: the best velocity leaves c to one of them.

    The step is recorded as missed, with a residual from c to 2 c. Each plain sweep adds the closing momentum 2 m c to
    either vane, on top of the impulses of the steps before; an extrapolation goes a few hundred sweeps further at a
    time, and no step adds to that. The run stops when the overlap has reached its limit.
    """
    c, a, h, cap = 1.0, 0.1, 1e-4, 1000
    walls = [
        box_surface("one", "one", (0.0, -2e-3 - R, 0.0), (0.8, 4e-3, 0.1)),
        box_surface("two", "two", (0.0, 2e-3 + R, 0.0), (0.8, 4e-3, 0.1)),
    ]
    bodies = [Body("one", TimeProfile.constant(c / a)), Body("two", TimeProfile.constant(-c / a))]
    grains = Grains.create([[a, 0.0, 0.0]], R, STEEL)
    dvi = DVI(grains, walls, bodies, DviContact(0.3), dt=h, gravity=(0.0, 0.0, 0.0), solver=solver, max_sweeps=cap,
              tolerance=1e-9)  # fmt: skip
    for step in range(3):
        totals = dvi.run(1)
        assert totals.missed_steps == 1
        swept = a * totals.sweeps * 2.0 * grains.mass[0] * c  # N m s of the sweeps of a step
        for name, sign in (("one", -1.0), ("two", 1.0)):
            squeeze = sign * totals.torque_on(name) * h / swept
            if solver == "gauss_seidel":
                assert squeeze == pytest.approx(step + 1, rel=2e-3)
            else:
                assert 1.0 < squeeze < 400.0
        assert 0.98 * c < totals.residual < 2.02 * c
        assert np.linalg.norm(grains.velocity[0]) < 1.1 * c
    with pytest.raises(DemError, match="overlaps") as stop:
        for _ in range(20):
            assert dvi.run(1).missed_steps == 1
            assert np.linalg.norm(grains.velocity[0]) < 1.1 * c
    assert stop.value.kind is DemErrorKind.OVERLAP


@pytest.mark.hard
@pytest.mark.parametrize("seed", [1, 3])
def test_a_jammed_bed_between_driven_walls_stays_finite(seed):
    """Core and floor turn against drum and lid, with hardly a grain's play: no rigid motion allows it.

    The steps are recorded as missed; forces, speeds and overlap stay finite: no grain is thrown.
    """
    n, speed = 60, 10.0
    high = n * 4.0 / 3.0 * R**3 / (0.4 * (DRUM**2 - CORE**2))
    grains, walls = in_ring(n, seed, high, low="rotor")
    bodies = [Body("rotor", TimeProfile.constant(speed)), Body("drum", TimeProfile.constant(-speed))]
    dvi = DVI(grains, walls, bodies, DviContact(0.8), dt=H, gravity=(0.0, 0.0, -G), tolerance=1e-6, max_sweeps=500)
    totals = dvi.run(25)
    assert totals.missed_steps > 5
    assert totals.residual > 1e-3
    assert totals.max_overlap < 0.1
    assert totals.max_speed < 10.0 * speed * DRUM
    for name, sign in (("rotor", -1.0), ("drum", 1.0)):
        assert 0.0 < sign * totals.torque_on(name) < np.inf
    assert np.isfinite(dvi.contact_force).all()
