"""Sweeps over many rigid contacts: a stack (tests/REFERENCE.md section 5), dense references, acceleration."""

import numpy as np
import pytest
from dvi_scenes import in_drum, swept
from interior_point import cone_problem, cone_programme, solve_by_interior_point

from geometry.time_profile import TimeProfile
from particles import Body, FreeShaft, Grains
from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import accelerate_records
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

G = 9.81


def _stack(n, top=1.0):
    """n unit masses on a floor, the highest ``top``, each driven down at 1 m/s; contact k is below mass k + 1."""
    grain = np.zeros((n + 1, gs.N_GRAIN))
    grain[1:, gs.IM], grain[1:, gs.VZ] = 1.0, -1.0
    grain[n, gs.IM] = 1.0 / top
    index = np.array([[k + 1, k] for k in range(n)], dtype=np.int32)
    pair = np.zeros((n, gs.N_PAIR))
    pair[:, gs.EZ] = pair[:, gs.ARM] = 1.0
    w = grain[index[:, 0], gs.IM] + grain[index[:, 1], gs.IM]
    pair[:, gs.IWN], pair[:, gs.IWT], pair[:, gs.MU] = 1.0 / w, 1.0 / (3.5 * w), 0.3
    return grain, index, pair


def _sweeps(grain, index, pair, at_once):
    """Sweeps with so many contacts a call, which are visited in groups that share no mass."""
    body, none, wall = np.zeros((0, gs.N_BODY)), np.zeros((0, 2), dtype=np.int32), np.zeros((0, gs.N_WALL_CONTACT))
    parts = [slice(k, k + at_once) for k in range(0, len(pair), at_once)]
    count = 0
    while True:
        count += 1
        for part in parts:
            gs.sweep_records(None, 1.0, None, grain, body, index[part], pair[part], none, wall)
        u = grain[index[:, 0], gs.VZ] - grain[index[:, 1], gs.VZ]
        if np.abs(u).max() < 1e-6:
            return count


@pytest.mark.parametrize(("n", "cold"), [(5, 129), (10, 493), (20, 1865), (50, 10735)])
def test_unit_stack_takes_the_known_number_of_sweeps(n, cold):
    """129/493/1865/10 735 sweeps to |u| < 1e-6 from nothing, upwards; one from the impulses of before.

    tests/REFERENCE.md section 5. All at once, every other contact is visited first, then those between: both orders
    are consistent (Young, Trans. Amer. Math. Soc. 76 (1954) 92) and shrink errors at the same rate in the end.
    """
    grain, index, pair = _stack(n)
    assert _sweeps(grain, index, pair, 1) == cold
    assert pair[:, gs.RZ] == pytest.approx(np.arange(n, 0, -1), rel=1e-3)
    grain, index, pair = _stack(n)
    assert _sweeps(grain, index, pair, n) == pytest.approx(cold, rel=0.07)
    fresh, _, _ = _stack(n)
    body, none = np.zeros((0, gs.N_BODY)), np.zeros((0, 2), dtype=np.int32)
    gs.apply_records(1.0, fresh, body, index, pair, none, np.zeros((0, gs.N_WALL_CONTACT)))
    assert _sweeps(fresh, index, pair, n) == 1


@pytest.mark.parametrize("top", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("n", [2, 6, 21])
def test_a_heavy_mass_on_a_column_of_light_ones_is_carried_in_tens_of_sweeps(n, top):
    """Each contact carries what is above it: r_k = (top + n - 1 - k) 1 m/s, the lowest k = 0.

    Plain sweeps pass on 1/top of what is missing: 100 of them are as good as none. Velocities are those of the impulses
    to round-off, though an extrapolation went as far as the ratio of masses.
    """
    grain, index, pair = _stack(n, top)
    records = [grain, np.zeros((0, gs.N_BODY)), index, pair, np.zeros((0, 2), dtype=np.int32),
               np.zeros((0, gs.N_WALL_CONTACT))]  # fmt: skip
    plain = _copy(records)
    swept(1e-7, 100, plain)
    carried = top + n - 1.0 - np.arange(n)
    assert plain[3][0, gs.RZ] < 0.8 * carried[0]
    sweeps, reached = accelerate_records(None, None, 1e-7, 500, *records)
    assert sweeps < 100 and reached <= 1e-7
    assert pair[:, gs.RZ] == pytest.approx(carried, rel=1e-6)
    from_above = np.append(pair[1:, gs.RZ], 0.0)
    round_off = 10.0 * np.finfo(float).eps * top * (sweeps + 1)  # each sweep adds changes of impulses as large as top
    assert grain[1:, gs.VZ] == pytest.approx(-1.0 + grain[1:, gs.IM] * (pair[:, gs.RZ] - from_above), abs=round_off)


def _records(n=60, inertia=1e-4, seed=3, speed=0.0, friction=0.4):
    """A bed of many sizes, just poured into a drum on a free shaft; free velocities, contacts without impulses."""
    rng = np.random.default_rng(seed)
    where, walls = in_drum(n)
    grains = Grains.create(where, 0.005 * rng.uniform(0.9, 1.0, n), 7850.0)
    shaft = Body("drum", FreeShaft(inertia, drive_torque=0.02, load_torque=TimeProfile.constant(0.01)), speed=2.0)
    dvi = DVI(grains, walls, [shaft], DviContact(friction), dt=2e-3, gravity=(0.0, 0.0, -G), max_sweeps=200,
              solver="gauss_seidel")  # fmt: skip
    dvi.run(60)
    dvi.grains.velocity += speed * rng.normal(size=(n, 3))
    dvi.run(1)
    grain, body, *records = dvi._records()
    gs.apply_records(-1.0, grain, body, *records)
    records[1][:, gs.RX : gs.RZ + 1] = 0.0
    records[3][:, gs.RX : gs.RZ + 1] = 0.0
    body[:, gs.BRAKE] = 0.0
    return [grain, body, *records]


def _copy(records):
    return [a.copy() for a in records]


def _dense(records):
    """Generalised masses, and (for each contact) the 3 x k matrix of its velocity in world axes, by hand."""
    grain, body, pair_index, pair, wall_index, wall = records
    n = len(grain)
    mass = np.concatenate(
        [np.repeat(1.0 / grain[:, gs.IM], 6) * np.tile([1, 1, 1, 0.4, 0.4, 0.4], n), 1.0 / body[:, 1]]
    )
    matrices = []

    def skew(e):
        return np.array([[0.0, -e[2], e[1]], [e[2], 0.0, -e[0]], [-e[1], e[0], 0.0]])

    for (i, j), row in zip(pair_index, pair, strict=True):
        h = np.zeros((3, len(mass)))
        # the point of i nearest to j is at -a R_i e: its velocity is v + omega x (-a R e) = v + a e x p
        h[:, 6 * i : 6 * i + 3], h[:, 6 * i + 3 : 6 * i + 6] = np.eye(3), row[gs.ARM] * skew(row[:3])
        h[:, 6 * j : 6 * j + 3], h[:, 6 * j + 3 : 6 * j + 6] = -np.eye(3), row[gs.ARM] * skew(row[:3])
        matrices.append(h)
    for (i, b), row in zip(wall_index, wall, strict=True):
        h = np.zeros((3, len(mass)))
        h[:, 6 * i : 6 * i + 3], h[:, 6 * i + 3 : 6 * i + 6] = np.eye(3), row[gs.ARM] * skew(row[:3])
        h[:2, 6 * n + b] = -row[[gs.LX, gs.LY]]
        matrices.append(h)
    return mass, np.array(matrices)


def _vector(grain, body):
    return np.concatenate([grain[:, [0, 1, 2, 4, 5, 6]].ravel(), body[:, gs.SPEED]])


def _dense_residual(matrices, mass, velocity, rows, convex=False):
    """The natural map of tests/REFERENCE.md section 5, contact by contact, from world-frame vectors."""
    worst = 0.0
    for h, row in zip(matrices, rows, strict=True):
        e, mu, r = row[:3], row[gs.MU], row[gs.RX : gs.RZ + 1]
        u = h @ velocity
        w_n = float(e @ (h / mass) @ h.T @ e)
        u_t = u - (u @ e) * e
        u = u + (row[gs.B] + (0.0 if convex else mu * np.linalg.norm(u_t))) * e
        x = r - u / w_n
        n, t = x @ e, x - (x @ e) * e
        size = np.linalg.norm(t)
        if size <= mu * n:
            nearest = x
        elif mu * size <= -n:
            nearest = np.zeros(3)
        else:
            n = (n + mu * size) / (1.0 + mu * mu)
            nearest = n * e + mu * n * t / size
        worst = max(worst, w_n * np.linalg.norm(r - nearest))
    return worst


def _rows(records):
    return [*records[3], *records[5]]


@pytest.mark.parametrize("convex", [None, True])
def test_residual_equals_a_dense_reference_at_every_stage(convex):
    """Also checks that velocities stay v_free + M^-1 H r, free shaft and the load's brake included."""
    records = _records()
    mass, matrices = _dense(records)
    free = _vector(*records[:2])
    for sweeps in (0, 1, 5, 50):
        now = _copy(records)
        for _ in range(sweeps):
            gs.sweep_records(convex, 1.0, None, *now)
        r = np.array([row[gs.RX : gs.RZ + 1] for row in _rows(now)])
        velocity = free + np.einsum("mik,mi->k", matrices, r) / mass
        velocity[-1] -= now[1][0, gs.BRAKE] * now[1][0, gs.IJ]
        assert _vector(*now[:2]) == pytest.approx(velocity, rel=1e-10, abs=1e-12)
        expected = _dense_residual(matrices, mass, velocity, _rows(now), convex=bool(convex))
        assert gs.residual_records(convex, None, *now) == pytest.approx(expected, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("inertia", [1e-6, 1e-4, 1e2])
def test_converged_sweeps_satisfy_the_dense_laws(inertia):
    """Exact Coulomb to 1e-12 m/s, with a shaft 25 to 2.5e9 times as hard to turn as a grain in the system."""
    records = _records(inertia=inertia)
    mass, matrices = _dense(records)
    sweeps, reached = accelerate_records(None, None, 1e-12, 20_000, *records)
    assert reached <= 1e-12 and sweeps < 20_000
    assert _dense_residual(matrices, mass, _vector(*records[:2]), _rows(records)) < 2e-12
    loaded = sum(bool(np.any(row[gs.RX : gs.RZ + 1] != 0.0)) for row in _rows(records))
    assert loaded > 30


def test_convex_law_has_one_velocity_whatever_the_solver():
    """Sweeps and the cone programme share no line; the velocities of the CCP are unique."""
    records = _records(speed=0.1)
    records[1][:, gs.LOAD] = 0.0  # the programme holds the brake; here there is none
    a = _copy(records)
    assert swept(1e-11, 50_000, a, convex=True)[1] <= 1e-11
    problem = cone_problem(*records)
    impulse, velocity = cone_programme(problem, np.zeros(len(problem.friction)), 1e-11)
    assert velocity == pytest.approx(_vector(*a[:2]), abs=1e-8)
    assert np.all(np.linalg.norm(impulse[:, 1:], axis=1) <= problem.friction * impulse[:, 0] * (1.0 + 1e-9))


def test_interior_point_and_sweeps_agree_on_exact_coulomb():
    records = _records(speed=0.1)
    a, b = _copy(records), _copy(records)
    assert accelerate_records(None, None, 1e-11, 50_000, *a)[1] <= 1e-11
    assert solve_by_interior_point(None, 1e-11, *b)[1] <= 1e-11
    assert _vector(*b[:2]) == pytest.approx(_vector(*a[:2]), abs=1e-7)


def test_acceleration_needs_fewer_sweeps_for_the_same_residual():
    records = _records()
    plain, fast = _copy(records), _copy(records)
    slow = swept(1e-10, 50_000, plain)
    quick = accelerate_records(None, None, 1e-10, 50_000, *fast)
    assert max(slow[1], quick[1]) <= 1e-10
    assert 2 * quick[0] < slow[0]
    assert _vector(*fast[:2]) == pytest.approx(_vector(*plain[:2]), abs=1e-7)
