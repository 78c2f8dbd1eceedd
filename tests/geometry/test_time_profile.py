"""A time profile is linear between its instants, held outside them, and one value where it is constant."""

import numpy as np
import pytest

from geometry.time_profile import TimeProfile

PROFILE = TimeProfile((0.0, 1.0, 3.0), (0.0, 10.0, -14.0))


def test_profile_is_linear_and_held():
    times = np.array([-1.0, 0.5, 2.0, 9.0])
    assert PROFILE.at(times) == pytest.approx([0.0, 5.0, -2.0, -14.0])
    assert [PROFILE(time) for time in times] == PROFILE.at(times).tolist()
    assert PROFILE.largest == 14.0 and not PROFILE.is_constant


def test_a_constant_is_one_value_for_ever():
    constant = TimeProfile.constant(24.0)
    assert constant.is_constant and constant(-1.0) == constant(1e9) == constant.largest == 24.0


def test_a_profile_over_a_number_has_its_values_over_it():
    """As the current V/R of a voltage."""
    assert PROFILE / 2.0 == TimeProfile((0.0, 1.0, 3.0), (0.0, 5.0, -7.0))


def test_a_value_is_passed_between_points():
    crossed = TimeProfile((0.0, 1.0, 3.0), (0.0, 10.0, -10.0))
    assert crossed.crossings(5.0) == [0.5, 1.5] and crossed.crossings(0.0) == [2.0]
    assert crossed.crossings(10.0) == [] and TimeProfile.constant(5.0).crossings(5.0) == []


def test_turning_values_are_the_ends_of_rises_and_falls():
    course = TimeProfile((0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (0.0, 1.0, 5.0, 5.0, 2.0, 1.0, 3.0))
    assert course.turning_values(0.0, 9.0) == [5.0, 1.0]
    assert course.turning_values(0.0, 2.0) == [5.0] and course.turning_values(2.0, 4.9) == []
    assert PROFILE.turning_values(0.0, 9.0) == [10.0] and TimeProfile.constant(1.0).turning_values(-1.0, 1.0) == []


@pytest.mark.parametrize("times, values", [((0.0, 1.0), (1.0,)), ((1.0, 0.0), (0.0, 1.0)), ((), ())])
def test_bad_profile_is_refused(times, values):
    with pytest.raises(ValueError, match="time profile"):
        TimeProfile(times, values)
