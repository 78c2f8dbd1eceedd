"""One head-on impact of each law, integrated by scipy: restitution, depth, force, duration."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from particles.laws.elastic import Elastic
from particles.laws.hertz import HertzContact
from particles.laws.hertz_impact import impact_depth, stiffness_for_depth
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.linear import LinearContact
from particles.laws.restitution import MIN_RESTITUTION, damping_ratio, power_law_damping, restitution_of
from particles.laws.springs import law_table, spring
from particles.laws.thesis import ThesisContact
from particles.laws.walton_braun import WaltonBraun

GLASS = Elastic(48e9, 0.2)
M, R, V = 2e-6, 0.25e-3, 0.4


def impact(law, m_eff=M, r_eff=R, speed=V, pressed_by=0.0, start=0.0):
    """(rebound speed, depth, largest force, duration) of the clipped contact; the memory is the peak so far.

    In units of the undamped duration and depth; the scaled overlap is s^2 and time runs with s, which takes the roots
    of Hertzian forces at touch out of the equation.
    """
    table = law_table(law.kernel, law.row()[None])
    X = law.overlap_under(0.0, m_eff, speed, r_eff)
    T = X / speed
    force_unit = m_eff * speed / T

    def forces(s, u, peak):
        f, _, gamma, _, _, _ = spring(table, 0, max(s * s * X, 0.0), m_eff, r_eff, peak)
        return f / force_unit, gamma * speed / force_unit * u

    def rate(_, y, peak):
        f, damping = forces(y[0], y[1], peak)
        return 0.5 * y[1], -y[0] * max(0.0, f + damping) + y[0] * pressed_by / force_unit, y[0]

    def over(t, y, peak):
        if t == 0.0:
            return 1.0
        if isinstance(law, WaltonBraun) and law.restitution < 1.0:
            return y[0] ** 2 - (1 - law.stiffness_n / law.unloading_stiffness) * peak / X
        if isinstance(law, WaltonBraun) or law.damping_n == 0.0:
            return y[0]
        return sum(forces(y[0], y[1], peak)) / max(y[0], 1e-3)

    def deepest(_, y, peak):
        return y[1]

    over.terminal = deepest.terminal = True
    over.direction = deepest.direction = -1
    settings = dict(method="DOP853", rtol=1e-12, atol=1e-14)
    first = solve_ivp(rate, (0, 1e3), (start, 1.0, 0.0), events=deepest, args=(0.0,), **settings)
    depth = X * first.y[0, -1] ** 2
    force = max(sum(forces(s, u, 0.0)) for s, u in first.y[:2].T) * force_unit
    if pressed_by > 0.0:  # it continues to chatter
        return math.nan, depth, force, math.nan
    # no memory on the way in: the overlap is its own peak; on the way out it is the depth
    last = solve_ivp(rate, (0, 1e3), first.y[:, -1], events=over, args=(depth,), **settings)
    return -speed * last.y[1, -1], depth, force, T * last.y[2, -1]


RESTITUTIONS = [MIN_RESTITUTION, 0.05, 0.2, 0.5, 0.9, 0.999, 1.0]
MADE = {
    "linear": lambda e: LinearContact.from_restitution(1e4, e, 0.3),
    "hertz_mindlin": lambda e: HertzMindlin.from_restitution(GLASS, e, 0.3),
    "hertz": lambda e: HertzContact.from_restitution(1e8, e, 0.3, m_eff=M, speed=V),
    "thesis sqrt": lambda e: ThesisContact.from_restitution(1e5, e, 0.3, diameter=1e-3, exponent=0.5, m_eff=M, speed=V),
    "thesis one": lambda e: ThesisContact.from_restitution(1e5, e, 0.3, diameter=1e-3, exponent=0.0, m_eff=M),
    "walton_braun": lambda e: WaltonBraun.from_restitution(1e4, e, 0.3),
}


@pytest.mark.parametrize("e", RESTITUTIONS)
@pytest.mark.parametrize("name", MADE)
def test_restitution_is_the_one_asked_for(name, e):
    rebound, _, _, _ = impact(MADE[name](e))
    assert rebound / V == pytest.approx(e, abs=1e-8)


@pytest.mark.parametrize("name", ["linear", "hertz_mindlin", "thesis one", "walton_braun"])
def test_restitution_is_independent_of_the_speed(name):
    for speed in (1e-3, 30.0):
        assert impact(MADE[name](0.6), speed=speed)[0] / speed == pytest.approx(0.6, abs=1e-8)


@pytest.mark.parametrize("name, rises", [("hertz", True), ("thesis sqrt", False)])
def test_restitution_away_from_the_reference(name, rises):
    """g of the module docstring goes as v^-1/5 (q = 0) and v^1/5 (q = 1/2), m^-3/5 and m^3/5."""
    law = MADE[name](0.6)
    for m_eff, speed in ((M, 10 * V), (5 * M, V)):
        rebound, _, _, _ = impact(law, m_eff=m_eff, speed=speed)
        assert rebound / speed == pytest.approx(law.restitution_at(m_eff, speed), abs=1e-8)
        assert (rebound / speed > 0.6) == rises


@pytest.mark.parametrize("name", MADE)
def test_undamped_impact_has_the_closed_depth_and_duration(name):
    law = MADE[name](0.5 if name == "walton_braun" else 1.0)
    _, depth, _, duration = impact(law)
    assert depth == pytest.approx(law.overlap_under(0.0, M, V, R), rel=1e-9)
    assert duration == pytest.approx(law.contact_time(M, R, V), rel=1e-9)


@pytest.mark.parametrize("name", MADE)
@pytest.mark.parametrize("load", [0.02, 3.0])
def test_depth_of_a_loaded_contact(name, load):
    """From rest under a force, hit at V: the deepest point of the equation of motion."""
    law = MADE[name](1.0)
    rest = law.overlap_under(load, M, 0.0, R)
    assert spring(law_table(law.kernel, law.row()[None]), 0, rest, M, R, 0.0)[0] == pytest.approx(load, rel=1e-12)
    start = math.sqrt(rest / law.overlap_under(0.0, M, V, R))
    _, depth, _, _ = impact(law, pressed_by=load, start=start)
    assert depth == pytest.approx(law.overlap_under(load, M, V, R), rel=1e-9)


def test_chung_and_ooi_1_two_glass_spheres():
    """Chung & Ooi, Granular Matter 13 (2011) 643, test 1: +-10 m/s; numbers of tests/REFERENCE.md section 4."""
    mass = 2800 * 4 / 3 * math.pi * 0.01**3
    law = HertzMindlin.from_restitution(GLASS, 1.0, 0.35)
    _, depth, force, duration = impact(law, m_eff=0.5 * mass, r_eff=0.005, speed=20.0)
    assert depth == pytest.approx(2.74113e-4, rel=3e-6)
    assert force == pytest.approx(10_696.9, rel=1e-5)
    assert duration == pytest.approx(4.0338e-5, rel=5e-5)  # printed with the constant 2.9432


def test_chung_and_ooi_2_sphere_on_a_wall():
    """Test 2 in its d = 5 mm, rho = 7000, 3.9 m/s form, F = k delta^1.5 given directly."""
    law, mass = HertzContact(3.555556e9, 0.0, 0.0, 0.0, 0.0), 7000 * math.pi / 6 * 0.005**3
    _, depth, force, _ = impact(law, m_eff=mass, r_eff=0.0025, speed=3.9)
    assert depth == pytest.approx(2.26806e-5, rel=3e-6)
    assert force == pytest.approx(384.05, rel=2e-5)


def test_duration_of_a_hertz_impact_and_what_a_doubled_contact_does():
    """T = 2.94328 x_0/v (Landau & Lifshitz); two springs instead of one: depth times 2^(-2/5) = 0.758."""
    law = HertzContact(1e8, 0.0, 0.0, 0.0, 0.0)
    assert law.contact_time(M, R, V) == pytest.approx(2.94328 * impact_depth(1e8, M, V) / V, rel=2e-6)
    assert impact_depth(2e8, M, V) / impact_depth(1e8, M, V) == pytest.approx(0.758, abs=2e-4)
    assert law.contact_time(M, R, 0.0) == math.inf


@pytest.mark.parametrize("e, time", [(0.9, 1.01720e-4), (0.5, 1.04108e-4), (0.2, 1.14228e-4)])
def test_period_of_the_linear_contact(e, time):
    """tests/REFERENCE.md section 4: half a period of the damped, tensile oscillator, R = 1 mm, rho = 2500, k = 1e4."""
    mass = 2500 * 4 / 3 * math.pi * 1e-9
    zeta = -math.log(e) / math.hypot(math.pi, math.log(e))
    half = LinearContact(1e4, 0.0, 0.0, 0.0, 0.0).contact_time(mass, 1e-3, 0.5) / math.sqrt(1 - zeta**2)
    assert half == pytest.approx(time, rel=6e-6)


@pytest.mark.parametrize("force, speed", [(0.02, 0.0), (0.0, V), (0.02, V)])
def test_hertz_stiffness_for_a_depth(force, speed):
    """The two depths, each alone, add up to the wanted one; the true depth is no larger."""
    k = stiffness_for_depth(5e-6, force, M, speed)
    law = HertzContact(k, 0.0, 0.0, 0.0, 0.0)
    assert (force / k) ** (2 / 3) + impact_depth(k, M, speed) == pytest.approx(5e-6, rel=1e-12)
    assert law.overlap_under(force, M, speed, R) <= 5e-6 * (1 + 1e-9)


def test_stiffness_of_a_contact_that_nothing_presses_is_refused():
    with pytest.raises(ValueError, match="no stiffness follows"):
        stiffness_for_depth(1e-6, 0.0, M, 0.0)


def test_restitution_falls_with_damping():
    g = [power_law_damping(e, p, q) for p, q in ((1.5, 0.0), (1.5, 0.5)) for e in (1.0, 0.999999, 0.9, 0.5, 0.05, 0.0)]
    assert np.all(np.diff(g[:6]) > 0) and np.all(np.diff(g[6:]) > 0) and g[0] == g[6] == 0.0
    zeta = np.linspace(0.0, 5.0, 400)
    assert np.all(np.diff([restitution_of(z) for z in zeta]) < 0)


@pytest.mark.parametrize("solve", [damping_ratio, lambda e: power_law_damping(e, 1.5, 0.0)])
def test_restitution_of_nothing_is_the_least_that_is_computed(solve):
    assert solve(0.0) == solve(MIN_RESTITUTION) > solve(0.05)


@pytest.mark.parametrize("e", [-0.1, 1.1, float("nan")])
@pytest.mark.parametrize("make", MADE.values())
def test_impossible_restitution_is_refused(make, e):
    with pytest.raises(ValueError, match=r"restitution = .*allowed: 0 to 1"):
        make(e)


def test_an_impact_far_below_the_load_is_a_vibration_about_the_rest():
    """Down to none, and without a step where the closed form takes over."""
    from particles.laws.hertz_impact import impact_depth, loaded_depth

    k, force, mass = 1e7, 1.0, 1e-5
    rest = (force / k) ** (2.0 / 3.0)
    for speed in (1e-44, 1e-20, 1e-9):
        assert loaded_depth(k, force, mass, speed) == pytest.approx(rest, rel=1e-6)
    seam = (k / (1.25 * mass)) ** 0.5 * (1e-4 * rest) ** 1.25
    below, above = (loaded_depth(k, force, mass, factor * seam) - rest for factor in (0.999, 1.001))
    assert impact_depth(k, mass, seam) == pytest.approx(1e-4 * rest) and above / below == pytest.approx(1.002, rel=1e-4)
