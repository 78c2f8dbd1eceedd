"""Laws of `emclutch.results.fits`: exact data are found exactly, intervals hold as often as they say, scipy agrees."""

import math

import numpy as np
import pytest
from scipy import stats

from emclutch.results.fits import NORMAL, Measured, line, power_law, student

X, ERROR = np.array([-1.0, 0.5, 2.0, 2.0, 7.0]), np.array([0.1, 0.3, 0.2, 0.5, 0.1])


@pytest.mark.parametrize("freedom", [1.0, 2.5, 30.0, math.inf])
def test_intervals_are_those_of_students_t(freedom):
    assert student(freedom, 0.99) == pytest.approx(stats.t.ppf(0.99, freedom))
    for confidence in (0.5, 0.95, 0.999):
        found = Measured(3.0, 0.2, freedom).interval(confidence)
        assert found == pytest.approx(stats.t.interval(confidence, freedom, 3.0, 0.2))
    assert NORMAL == pytest.approx(student(math.inf), abs=1e-4)


def test_a_mean_and_a_difference_have_the_intervals_of_scipy():
    random = np.random.default_rng(3)
    a, b = random.normal(1.0, 0.1, 6), random.normal(0.8, 0.3, 3)
    assert Measured.of(a).interval() == pytest.approx(tuple(stats.ttest_1samp(a, 0.0).confidence_interval(0.95)))
    welch = stats.ttest_ind(a, b, equal_var=False)
    found = Measured.of(a) - Measured.of(b)
    assert found.interval() == pytest.approx(tuple(welch.confidence_interval(0.95)), rel=1e-6)
    assert found.is_significant() == (welch.pvalue < 0.05) and found.is_significant(0.3) == (welch.pvalue < 0.7)
    assert found.scaled(-2.0).interval() == pytest.approx([-2.0 * end for end in reversed(found.interval())])
    exact = Measured(1.0, 0.0) - Measured(0.5, 0.0, 3.0)
    assert exact.interval() == (0.5, 0.5) and exact.text("+") == "+0.500 ± 0.000"


@pytest.mark.parametrize("error", [ERROR, None])
def test_an_exact_line_is_found_exactly(error):
    found = line(X, 3.0 - 2.0 * X, error)
    assert (found.slope.value, found.at(0.0).value) == pytest.approx((-2.0, 3.0), rel=1e-13)
    assert found.zero().value == pytest.approx(1.5) and found.squares == pytest.approx(0.0, abs=1e-20)


def test_several_lines_at_once_are_those_of_each():
    sets = np.random.default_rng(2).standard_normal((3, X.size))
    found, each = line(X, sets, ERROR), [line(X, y, ERROR) for y in sets]
    assert found.at(4.0).value == pytest.approx([one.at(4.0).value for one in each])
    assert found.squares == pytest.approx([one.squares for one in each])
    assert found.at(4.0).error == each[0].at(4.0).error and isinstance(each[0].slope.value, float)


def test_errors_are_those_of_the_covariance():
    """(A^T W A)^-1 with A = [x, 1]; of unknown errors W = 1 times the residuals' variance, and t of n - 2."""
    y = 3.0 - 2.0 * X + ERROR * np.random.default_rng(1).standard_normal(X.size)
    A = np.column_stack([X, np.ones_like(X)])
    for error in (ERROR, None):
        found, weight = line(X, y, error), np.ones_like(X) if error is None else error**-2.0
        covariance = np.linalg.inv(A.T @ (weight[:, None] * A))
        best = covariance @ A.T @ (weight * y)
        assert found.squares == pytest.approx(weight @ (y - A @ best) ** 2)
        if error is None:
            covariance *= found.squares / (X.size - 2)
        assert (found.slope.value, found.slope.error) == pytest.approx((best[0], covariance[0, 0] ** 0.5))
        for x in (-3.0, 0.0, 10.0):
            direction, here = np.array([x, 1.0]), found.at(x)
            assert (here.value, here.error) == pytest.approx(
                (direction @ best, (direction @ covariance @ direction) ** 0.5)
            )
        offset = -best[1] / best[0]
        by = np.array([offset, 1.0]) / best[0]
        assert (found.zero().value, found.zero().error) == pytest.approx((offset, (by @ covariance @ by) ** 0.5))
        assert found.slope.freedom == found.at(0.0).freedom == (math.inf if error is not None else 3.0)
    assert line(X, np.ones_like(X)).zero().error == math.inf


@pytest.mark.parametrize("known", [True, False])
def test_intervals_of_a_line_hold_as_often_as_they_say(known):
    """2000 draws of five points of equal noise: 95 % within three deviations of that share."""
    random, held, draws = np.random.default_rng(5), np.zeros(2), 2000
    for _ in range(draws):
        found = line(X, 3.0 - 2.0 * X + 0.3 * random.standard_normal(X.size), np.full(X.size, 0.3) if known else None)
        ends = found.slope.interval(), found.at(5.0).interval()
        held += [low < true < high for (low, high), true in zip(ends, (-2.0, -7.0), strict=True)]
    assert np.abs(held / draws - 0.95).max() < 3.0 * math.sqrt(0.95 * 0.05 / draws)


def test_a_power_law_is_a_line_of_logarithms_and_scatter_beyond_the_errors_enlarges_them():
    random = np.random.default_rng(1)
    x = np.linspace(20.0, 100.0, 12)
    factor, exponent = power_law(x, 0.05 * x**2)
    assert (factor, exponent.value) == pytest.approx((0.05, 2.0))
    for noise in (0.01, 0.2):
        y = 0.05 * x**2 * np.exp(noise * random.normal(size=12))
        sigma = 0.05 * y * random.uniform(0.5, 2.0, 12)
        fit, covariance = np.polyfit(np.log(x), np.log(y), 1, w=y / sigma, cov="unscaled")
        left = np.log(y) - np.polyval(fit, np.log(x))
        scatter = float(np.sum((y / sigma * left) ** 2)) / 10
        assert (scatter > 1.0) == (noise == 0.2)
        factor, exponent = power_law(x, y, sigma)
        error = math.sqrt(covariance[0, 0] * max(1.0, scatter))
        assert (factor, exponent.value, exponent.error) == pytest.approx((math.exp(fit[1]), fit[0], error), rel=1e-9)
        assert exponent.freedom == (10.0 if scatter > 1.0 else math.inf)
    sigma[3] = np.nan  # one unknown error: all points count alike
    assert power_law(x, y, sigma) == power_law(x, y)
    for few in ([0.0, 10.0, 20.0], [10.0, 10.0, 10.0], []):
        assert power_law(few, np.ones(len(few))) is None
    assert power_law([10.0, 20.0, 30.0], [1.0, -1.0, 2.0]) is None  # two points above zero
