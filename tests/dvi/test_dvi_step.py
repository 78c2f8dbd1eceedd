"""The step of rigid grains: its three rules, and what happens to a longer one."""

import math

import pytest
from scipy.integrate import quad

from coupling import neck_pull, pair_attraction, pair_work
from field import GrainLaw
from particles import choose_dvi_step

IRON = GrainLaw(999.0, 1.3e6)


def test_travel_is_a_tenth_of_a_diameter():
    """At 1000 rpm and 95 mm a ball of 10 mm moves its diameter in 1e-3 s: the rule allows a tenth of that."""
    speed = 1000.0 * 2.0 * math.pi / 60.0 * 0.0955
    step = choose_dvi_step(4e-3, 5e-3, speed=speed)
    assert step.dt == pytest.approx(1e-4, rel=1e-3)
    assert "a tenth of a diameter" in step.reason
    with pytest.raises(ValueError, match=r"at most 0\.0001 s"):
        choose_dvi_step(4e-3, 5e-3, speed=speed, dt=1e-3)
    forced = choose_dvi_step(4e-3, 5e-3, speed=speed, dt=1e-3, allow_long_step=True)
    assert forced.dt == 1e-3
    assert "forced: 10 times" in forced.reason


def test_attraction_is_resolved():
    """The shorter of the two rules counts: h = 0.1 sqrt(m W)/F, with W = F a unless it is given."""
    step = choose_dvi_step(1e-6, 1e-3, speed=1e-3, attraction=1e-3)
    assert step.dt == pytest.approx(0.1 * math.sqrt(1e-6 * 1e-3 / 1e-3))
    near = choose_dvi_step(1e-6, 1e-3, speed=1e-3, attraction=1e-3, work=0.04 * 1e-6, source="necks")
    assert near.dt == pytest.approx(0.2 * step.dt)
    assert "0.001 N from necks, over 0.04 radii, stop grains that part" in near.reason
    # the smallest grain of several, and a step within the rules as asked
    assert choose_dvi_step([1e-6, 2e-6], [1e-3, 2e-3], attraction=1e-3, dt=5e-5).dt == 5e-5


def test_grains_are_given_time_to_rearrange_under_a_pressure():
    """A twentieth of d sqrt(rho/P), of the smallest grain."""
    d, rho, pressure = 1e-4, 7800.0, 500.0
    step = choose_dvi_step(rho * math.pi / 6.0 * d**3, 0.5 * d, speed=1e-3, pressure=pressure)
    assert step.dt == pytest.approx(0.05 * d * math.sqrt(rho / pressure))
    assert "500 Pa move a grain by its diameter" in step.reason


def test_a_step_adds_a_tenth_of_the_speed_that_parts_two_grains():
    """2 h F/m against sqrt(2 W/m_eff), of dipoles and of necks, whose work is the integral of their force."""
    mass, d, M = 6e-8, 250e-6, 9e5
    pulls = {"dipoles": (pair_attraction(M, d), pair_work(M, d)), "necks": neck_pull(IRON, M, d, 3e-3)}
    for force, work in pulls.values():
        dt = choose_dvi_step(mass, 0.5 * d, attraction=force, work=work).dt
        assert 2.0 * dt * force / mass == pytest.approx(0.1 * math.sqrt(2.0 * work / (0.5 * mass)))
    # F r/3 is the work of coaxial dipoles that keep their moments; necks reach less far
    far, nearer = (neck_pull(IRON, M, d, gap) for gap in (4.0, 3e-3))
    assert far[1] == pytest.approx(far[0] * 0.5 * d * 6.0 / 3.0) and nearer[1] < nearer[0] * d / 3.0
    between, _ = quad(lambda gap: neck_pull(IRON, M, d, gap)[0], 3e-3, 1.0, epsrel=1e-6)
    parts = [neck_pull(IRON, M, d, gap)[1] for gap in (3e-3, 1.0)]
    assert parts[0] - parts[1] == pytest.approx(0.5 * d * between, rel=2e-3)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mass": 0.0}, "mass of a grain"),
        ({"radius": -1.0}, "radius of a grain"),
        ({"speed": math.inf}, "expected speed"),
        ({"attraction": -1.0}, "expected attraction"),
        ({"work": 0.0}, "work against the attraction"),
        ({"dt": 0.0}, "dt = 0 s"),
        ({"speed": 0.0}, "nothing moves"),
    ],
)
def test_refusals(wrong, message):
    with pytest.raises(ValueError, match=message):
        choose_dvi_step(**{"mass": 1e-6, "radius": 1e-3, "speed": 1.0} | wrong)
