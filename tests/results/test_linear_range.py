"""The linear range of a torque curve: what is exact is found exactly, what is noisy within its errors."""

import numpy as np
import pytest

from emclutch.results.linear_range import linear_range

SLOPE, OFFSET, KNEE = 10.0, 0.2, 1.3
CURRENT = np.linspace(0.0, 2.0, 11)


def torque(current):
    """Parabolic toe up to 0.4 A, a line up to the knee, a fifth of its slope beyond."""
    line = SLOPE * (np.minimum(current, KNEE) - OFFSET) + 0.2 * SLOPE * np.maximum(current - KNEE, 0.0)
    return np.where(current < 0.4, 2.0 * (current / 0.4) ** 2, line)


def test_an_exact_line_between_toe_and_saturation_is_found_whatever_the_order():
    mixed = np.random.default_rng(3).permutation(len(CURRENT))
    found = linear_range(CURRENT[mixed], torque(CURRENT)[mixed], np.full(11, 1e-3))
    assert (found.slope, found.offset) == (pytest.approx(SLOPE), pytest.approx(OFFSET))
    assert found.knee == pytest.approx(KNEE, abs=3.0 * found.knee_error) and found.knee_error < 1e-3
    assert (found.first, found.last, found.points) == (pytest.approx(0.4), pytest.approx(1.2), 5)


def test_a_line_is_the_same_for_negative_currents_and_torques():
    error = np.full(11, 1e-3)
    found = linear_range(-CURRENT, torque(CURRENT), error)
    assert found == linear_range(CURRENT, torque(CURRENT), error)
    turned = linear_range(CURRENT, -torque(CURRENT), error)
    assert turned.slope == pytest.approx(-SLOPE) and turned.knee == pytest.approx(found.knee)
    assert turned.slope_error == pytest.approx(found.slope_error)


@pytest.mark.parametrize("noise", [0.008, 0.016, 0.024, 0.04])
def test_intervals_hold_slope_offset_and_knee_as_often_as_they_promise(noise):
    """1.96 standard errors, noise over the largest torque: 95 % of 40 draws, less three deviations of that share.

    Coverage of the slope in 600 draws: 0.98, 0.96, 0.97, 0.96; of the offset and the knee at least 0.96. Errors of
    least squares of the chosen points alone hold the slope in 0.96, 0.79, 0.79, 0.62.
    """
    rng, error, draws = np.random.default_rng(7), np.full(11, noise * torque(CURRENT).max()), 40
    held, knees = np.zeros(3), 0
    for _ in range(draws):
        found = linear_range(CURRENT, torque(CURRENT) + error * rng.standard_normal(11), error)
        held[0] += abs(found.slope - SLOPE) < 1.96 * found.slope_error
        held[1] += abs(found.offset - OFFSET) < 1.96 * found.offset_error
        if found.knee is not None:
            knees += 1
            held[2] += abs(found.knee - KNEE) < 1.96 * found.knee_error
    assert knees > 0.4 * draws
    assert (held / [draws, draws, knees] > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / draws)).all(), held


def test_a_line_of_few_points_that_all_belong_to_it_keeps_the_error_of_least_squares():
    """Where noise cannot change the range, the whole choice adds nothing: four exact points, error within 30 %."""
    current, error = np.array([1.0, 2.0, 3.0, 4.0]), np.full(4, 1e-3)
    found = linear_range(current, SLOPE * current, error)
    assert found.points == 4 and found.slope_error == pytest.approx(1e-3 / np.sqrt(5.0), rel=0.3)


def test_a_line_without_an_end_has_no_knee():
    found = linear_range(CURRENT, SLOPE * CURRENT, np.full(11, 0.1))
    assert found.knee is None and found.points == 11 and "no knee was reached" in found.reason


def test_one_point_beyond_the_line_bounds_the_knee():
    current = np.array([0.4, 0.6, 0.8, 1.0, 1.2, 1.6])
    found = linear_range(current, torque(current), np.full(6, 0.01))
    assert found.knee == pytest.approx(1.4) and found.knee_error == pytest.approx(0.4 / np.sqrt(12.0))


def test_what_holds_no_line_says_why():
    error = np.full(11, 1e-4)
    assert "torques at 3 currents, 4 needed; add currents" in linear_range([0, 1, 2], [0, 1, 2], [1, 1, 1]).reason
    assert "no three neighbouring torques" in linear_range(CURRENT, CURRENT**1.5, error).reason
    assert "no three neighbouring torques" in linear_range(CURRENT, np.zeros(11), error).reason


def test_torques_of_unknown_error_give_a_line_but_no_range():
    noise = 0.1 * np.random.default_rng(5).standard_normal(11)
    found = linear_range(CURRENT, SLOPE * (CURRENT - OFFSET) + noise, np.full(11, np.nan))
    plain, covariance = np.polyfit(CURRENT, SLOPE * (CURRENT - OFFSET) + noise, 1, cov=True)
    assert found.slope == pytest.approx(plain[0]) and found.slope_error == pytest.approx(covariance[0, 0] ** 0.5)
    assert found.knee is None and "0 of them have an error" in found.reason


def test_a_range_with_torques_that_are_not_converged_is_not_tested():
    converged = np.ones(11, dtype=bool)
    converged[[0, 4, 10]] = False  # the first and the last lie outside the range from 0.4 to 1.2 A
    error = np.full(11, 1e-3)
    found, sure = (
        linear_range(CURRENT, torque(CURRENT), error, converged),
        linear_range(CURRENT, torque(CURRENT), error),
    )
    assert not found.is_tested and found.unconverged == 1 and "1 of these 5 torques" in found.reason
    assert sure.is_tested and sure.unconverged == 0 and (found.slope, found.knee) == (sure.slope, sure.knee)
    backwards = linear_range(CURRENT[::-1], torque(CURRENT)[::-1], error, converged[::-1])
    assert backwards == found
