"""The step of rigid grains: its two rules, and what happens to a longer one."""

import math

import pytest

from particles import choose_dvi_step


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
    """The shorter of the two rules counts: h = 0.1 sqrt(m a/F)."""
    step = choose_dvi_step(1e-6, 1e-3, speed=1e-3, attraction=1e-3)
    assert step.dt == pytest.approx(0.1 * math.sqrt(1e-6 * 1e-3 / 1e-3))
    assert "close a gap" in step.reason
    # the smallest grain of several, and a step within the rules as asked
    assert choose_dvi_step([1e-6, 2e-6], [1e-3, 2e-3], attraction=1e-3, dt=5e-5).dt == 5e-5


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mass": 0.0}, "mass of a grain"),
        ({"radius": -1.0}, "radius of a grain"),
        ({"speed": math.inf}, "expected speed"),
        ({"attraction": -1.0}, "expected attraction"),
        ({"dt": 0.0}, "dt = 0 s"),
        ({"speed": 0.0}, "nothing moves"),
    ],
)
def test_refusals(wrong, message):
    with pytest.raises(ValueError, match=message):
        choose_dvi_step(**{"mass": 1e-6, "radius": 1e-3, "speed": 1.0} | wrong)
