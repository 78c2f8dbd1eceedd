"""The step: what limits it, which limit is named, and what is refused."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

from particles.dem.time_step import (
    SLIDING,
    WALL_ROLLING,
    choose_time_step,
    stiffness_for_overlap,
)
from particles.laws.elastic import Elastic, rayleigh_time
from particles.laws.hertz import HertzContact
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.linear import LinearContact
from particles.laws.pair_table import PairLaws
from particles.laws.thesis import ThesisContact
from particles.laws.walton_braun import WaltonBraun

IRON = Elastic(210e9, 0.3)
MASS, RADIUS = 4.1e-6, 0.5e-3
LAWS = [
    LinearContact.from_restitution(1e4, 0.5, 0.3),
    HertzMindlin.from_restitution(IRON, 0.5, 0.3),
    HertzContact.from_restitution(1e9, 0.5, 0.3, m_eff=MASS, speed=0.5),
    ThesisContact.from_restitution(1e6, 0.5, 0.3, diameter=1e-3, exponent=0.5, m_eff=MASS, speed=0.5),
    WaltonBraun.from_restitution(1e4, 0.5, 0.3),
]


@pytest.mark.parametrize(
    "material, density, radius, time",
    [(Elastic(1e8, 0.3), 2500, 1e-3, 2.73663e-5), (IRON, 7800, 50e-6, 5.274e-8)],
)
def test_rayleigh_time(material, density, radius, time):
    """tests/REFERENCE.md section 4."""
    assert rayleigh_time(material, density, radius) == pytest.approx(time, rel=1e-4 if radius < 1e-4 else 3e-6)


def test_linear_step_is_a_twentieth_of_the_contact():
    """pi sqrt(m/(2 k))/20; k_t = 2/7 k_n slides with the same period and is not named."""
    step = choose_time_step(LAWS[0], MASS, RADIUS)
    assert step.dt == pytest.approx(math.pi * math.sqrt(0.5 * MASS / 1e4) / 20, rel=1e-14)
    assert "20 steps per contact" in step.reason and "k_n = 1e+04 N/m" in step.reason
    assert 20 * step.dt == pytest.approx(LAWS[0].contact_time(0.5 * MASS, 0.5 * RADIUS, 0.0), rel=1e-14)


def test_lightest_and_smallest_grain_count():
    sizes = np.array([1.0, 0.5, 2.0]) * RADIUS
    masses = MASS * (sizes / RADIUS) ** 3
    assert choose_time_step(LAWS[0], masses, sizes) == choose_time_step(LAWS[0], masses[1], sizes[1])


def test_hertz_mindlin_step_is_bounded_by_the_rayleigh_time():
    mass = 7800 * 4 / 3 * math.pi * (50e-6) ** 3
    step = choose_time_step(LAWS[1], mass, 50e-6, speed=0.1)
    assert step.dt == pytest.approx(0.2 * 5.274e-8, rel=1e-4) and "Rayleigh" in step.reason


@pytest.mark.parametrize("law", LAWS[2:4])
def test_hertzian_contacts_get_stiffer_with_speed_and_load(law):
    def step(**expected):
        return choose_time_step(law, MASS, 50 * RADIUS, **expected).dt  # light for its size: no other limit

    for key in ("speed", "load"):
        steps = [step(**{key: value}) for value in (1e-4, 1e-2, 1.0)]
        assert steps[0] >= steps[1] >= steps[2] and steps[0] > steps[2]
    assert step(speed=0.5, load=1.0) <= min(step(speed=0.5), step(load=1.0))


def test_duration_follows_the_law_of_hertz():
    """T goes as v^(-1/5): a tenth of the speed, 1.585 times the step."""
    law = HertzContact(1e9, 0.0, 0.0, 0.0, 0.3)
    fast, slow = (choose_time_step(law, MASS, RADIUS, speed=v).dt for v in (0.5, 0.05))
    assert slow / fast == pytest.approx(10**0.2, rel=1e-12)


def test_speed_bounds_the_step_and_is_named():
    step = choose_time_step(LAWS[0], MASS, RADIUS, speed=1e3)
    assert step.dt == pytest.approx(0.1 * RADIUS / 1e3) and "moves 0.1 of its radius" in step.reason


def test_stiff_tangential_spring_bounds_the_step_and_is_named():
    law = LinearContact(1e4, 8e4, 0.0, 0.0, 0.3)
    step = choose_time_step(law, MASS, RADIUS)
    assert 20 * step.dt == pytest.approx(math.pi * math.sqrt(0.5 * MASS / (3.5 * 8e4)), rel=1e-14)
    assert "of sliding (k_t" in step.reason and "contact alone would allow" in step.reason


def test_unloading_branch_bounds_the_hysteretic_step():
    law = WaltonBraun.from_restitution(1e4, 0.1, 0.3)
    assert choose_time_step(law, MASS, RADIUS).dt == pytest.approx(
        math.pi * math.sqrt(0.5 * MASS / 1e6) / 20, rel=1e-12
    )


def rolling_modes(m_eff, inertias, arms):
    """omega^2/k_t of sliding and rolling springs, relative translation and the spins as unknowns."""
    slide = np.array([1.0, *arms])
    roll = np.array([0.0, 1.0, -1.0][: 1 + len(arms)])
    r_eff = arms[0] if len(arms) == 1 else arms[0] * arms[1] / sum(arms)
    springs = np.outer(slide, slide), np.outer(slide, slide) + r_eff**2 * np.outer(roll, roll)
    return [eigh(k, np.diag([m_eff, *inertias]), eigvals_only=True)[-1] for k in springs]


def test_stiffest_mode_of_sliding_and_rolling():
    """At a wall the two springs add on the spin; of spheres of any sizes, two of the lightest are the stiffest."""
    sliding, rolling = rolling_modes(1.0, [0.4], [1.0])
    assert sliding == pytest.approx(SLIDING) and rolling == pytest.approx(WALL_ROLLING)
    for ratio in np.geomspace(1.0, 1e3, 30):
        m = ratio**3
        assert rolling_modes(m / (1 + m), [0.4, 0.4 * m * ratio**2], [1.0, ratio])[1] <= 2 * SLIDING * (1 + 1e-12)


def test_rolling_counts_where_the_wall_is_the_stiffer_partner():
    wall = LinearContact(1e4, 5e4, 0.0, 0.0, 0.3)
    table = PairLaws.of_one(LAWS[0], at_walls=wall)
    free, rolling = (choose_time_step(table, MASS, RADIUS, rolling=r) for r in (False, True))
    assert free.dt / rolling.dt == pytest.approx(math.sqrt(WALL_ROLLING / SLIDING), rel=1e-12)
    assert "sliding and rolling" in rolling.reason


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_a_step_that_it_accepts_itself(law):
    chosen = choose_time_step(law, MASS, RADIUS, speed=0.3, load=1e-3)
    assert 0.0 < chosen.dt < math.inf
    asked = choose_time_step(law, MASS, RADIUS, speed=0.3, load=1e-3, dt=chosen.dt)
    assert asked.dt == chosen.dt and "as asked" in asked.reason
    # without speed and load only what is too long for the lightest touch is refused
    choose_time_step(law, MASS, RADIUS, dt=choose_time_step(law, MASS, RADIUS, speed=1e-3).dt)
    with pytest.raises(ValueError, match=r"dt = 1 s; allowed: more than 0 and at most .* leave it out"):
        choose_time_step(law, MASS, RADIUS, dt=1.0)


@pytest.mark.parametrize("e", [0.0, 0.02, 0.1, 0.3])
def test_longest_step_allowed_gains_no_energy_from_damping(e):
    """Leapfrog with the velocity half a step behind, at the longest step, from every phase of touching."""
    law = LinearContact.from_restitution(1e4, e, 0.0, stiffness_t=0.0)
    with pytest.raises(ValueError) as refusal:
        choose_time_step(law, 2 * MASS, RADIUS, dt=1.0)
    dt = float(str(refusal.value).split("at most ")[1].split(" s")[0]) * 0.999  # printed with three digits
    gamma = 2 * law.damping_n * math.sqrt(1e4 * MASS)
    for phase in np.linspace(0.0, 1.0, 41):
        x, v = -phase * dt, 1.0  # overlap and closing speed, in units of the speed
        for _ in range(2000):
            force = max(0.0, 1e4 * x + gamma * v) if x > 0.0 else 0.0
            v -= force * dt / MASS
            x += v * dt
            if x <= 0.0 and v < 0.0:
                break
        assert abs(v) < 1.0


@pytest.mark.parametrize(
    "change, message",
    [
        ({"mass": 0.0}, "mass of a grain = 0 kg"),
        ({"radius": float("nan")}, "radius of a grain"),
        ({"speed": -1.0}, "expected speed = -1 m/s"),
        ({"load": float("inf")}, "expected load = inf N"),
        ({"steps_per_contact": 2.0}, "steps_per_contact = 2; allowed: 5 or more"),
        ({"dt": 0.0}, "dt = 0 s; allowed: more than 0"),
        ({"dt": float("nan")}, "dt = nan s; allowed"),
    ],
)
def test_impossible_numbers_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        choose_time_step(LAWS[0], **{"mass": MASS, "radius": RADIUS} | change)


def test_refusal_names_the_tightest_limit():
    with pytest.raises(ValueError, match="a tenth of a radius a step"):
        choose_time_step(LAWS[0], MASS, RADIUS, speed=1e3, dt=1e-6)
    with pytest.raises(ValueError, match="40 % of the Rayleigh time"):
        choose_time_step(LAWS[1], MASS, RADIUS, dt=1e-6)


@pytest.mark.parametrize("force, speed", [(0.1, 0.0), (0.0, 0.5), (0.1, 0.5)])
def test_stiffness_for_overlap_gives_that_overlap(force, speed):
    k = stiffness_for_overlap(force, 2 * RADIUS, 0.01, mass=MASS, speed=speed)
    law = LinearContact(k, 0.0, 0.0, 0.0, 0.0)
    assert law.overlap_under(force, MASS, speed, RADIUS) == pytest.approx(0.01 * 2 * RADIUS, rel=1e-12)
