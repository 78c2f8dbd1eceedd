"""Fits to measured torques: a known truth is recovered, intervals hold it, what cannot be told apart is a valley."""

import itertools

import numpy as np
import pytest

from emclutch.studies.torque_fit import MeasuredTorques, ResponseSurface, SimulatedTorques, fit_torque

DRIVES = (0.2, 0.45, 1.0)


def simulated(torque, *levels, noise=0.0):
    """Torques of every combination of values, at three drives."""
    names = ("friction", "rolling", "fill")[: len(levels)]
    points = [(*p, x) for p in itertools.product(*levels) for x in DRIVES]
    p, x = np.array([point[:-1] for point in points]), np.array([point[-1] for point in points])
    T = np.array([torque(one, at) for one, at in zip(p, x, strict=True)])
    return SimulatedTorques(names, p, x, T, noise * T)


def measured(torque, truth, n=8, noise=0.0, seed=1, known=True):
    x = np.geomspace(DRIVES[0], DRIVES[-1], n)
    exact = np.array([torque(truth, at) for at in x])
    T = exact * (1.0 + noise * np.random.default_rng(seed).normal(size=n))
    return MeasuredTorques(x, T, np.full(n, noise) * exact if known else None)


def shapes(p, x):
    """Friction changes the exponent, rolling friction the height: both can be told apart. Quadratic in ln T."""
    return 10.0 * x ** (1.1 + 0.5 * p[0]) * np.exp(1.2 * p[1] - 0.8 * p[1] ** 2 + 0.3 * p[0] * p[1])


def product_of(p, x):
    """Only one combination of both counts."""
    return 10.0 * x**1.3 * np.exp(p[0] + 2.0 * p[1])


def test_a_surface_is_exact_where_it_can_be():
    """ln T of second order in the parameters and a line in ln x is met everywhere, also between the points."""
    surface = ResponseSurface(simulated(shapes, (0.2, 0.45, 0.7), (0.0, 0.25, 0.5)))
    for p in ((0.3, 0.1), (0.61, 0.44)):
        for x in (0.2, 0.3, 0.77, 1.0):
            (found,) = surface.weights(np.array([x])) @ surface.log_torques(np.array(p))
            assert found == pytest.approx(np.log(shapes(p, x)), abs=2e-3 if x not in DRIVES else 1e-12)


def test_a_known_truth_is_recovered():
    fit = fit_torque(simulated(shapes, (0.2, 0.45, 0.7), (0.0, 0.25, 0.5)), measured(shapes, (0.35, 0.2), noise=1e-3))
    for one, truth in zip(fit.parameters, (0.35, 0.2), strict=True):
        assert one.value == pytest.approx(truth, abs=0.02)
        assert one.low < one.value < one.high and one.bounded == (True, True)
    assert not fit.is_poor and fit.scatter < 0.01
    assert (fit.low < fit.torque).all() and (fit.torque < fit.high).all()


def test_intervals_hold_the_truth_as_often_as_they_say():
    """One parameter, measurements with 5 % noise: 95 %, within four standard deviations of the count of 60."""
    points, held = simulated(lambda p, x: 10.0 * x**1.3 * np.exp(2.0 * p[0]), (0.0, 0.5, 1.0)), []
    for known, draws in ((True, 60), (False, 25)):  # an unknown error is found by several fits
        inside = 0
        for seed in range(draws):
            curve = measured(
                lambda p, x: 10.0 * x**1.3 * np.exp(2.0 * p[0]), (0.4,), n=5, noise=0.05, seed=seed, known=known
            )
            (one,) = fit_torque(points, curve).parameters
            inside += one.low <= 0.4 <= one.high
        held.append(inside / draws)
    assert min(held) > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / 60)
    assert held[0] < 1.0  # an interval that always holds it says too little


@pytest.mark.parametrize(("n", "common"), [(4, 0.0), (8, 0.0), (30, 0.0), (100, 0.0), (8, 0.03)])
def test_more_measured_points_do_not_reduce_the_error_of_the_simulated_ones(n, common):
    """Simulated torques with 3 % noise, measured ones with 1 % and a common error: interval and band hold the truth.

    Coverage of the interval for n = 4, 8, 30, 100 (300 draws): 0.95, 0.95, 0.96, 0.94; with a common error of 3 %:
    0.96, 0.97, 0.97, 0.94. Where the error of the surface counts as n independent ones: 0.92, 0.78, 0.45, 0.16.
    """
    rng, draws, truth, inside, within = np.random.default_rng(0), 40, 0.35, 0, []

    def torque(p, x):
        return 10.0 * x**1.3 * np.exp(0.9 * p - 0.3 * p**2)

    p, x = (a.ravel() for a in np.meshgrid([0.2, 0.45, 0.7], DRIVES))
    at = np.geomspace(DRIVES[0], DRIVES[-1], n)
    exact = torque(truth, at)
    for _ in range(draws):
        T = torque(p, x) * (1.0 + 0.03 * rng.standard_normal(9))
        M = exact * (1.0 + 0.01 * rng.standard_normal(n)) * (1.0 + common * rng.standard_normal())
        points = SimulatedTorques(("friction",), p[:, None], x, T, 0.03 * T)
        fit = fit_torque(points, MeasuredTorques(at, M, 0.01 * M, common))
        inside += fit.parameters[0].low <= truth <= fit.parameters[0].high
        within.append(((fit.low <= exact) & (exact <= fit.high)).mean())
    assert min(inside / draws, np.mean(within)) >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / draws)


def test_the_band_of_the_curve_is_that_of_a_mean():
    """One parameter that is the height: n measurements with an error s fix it to s/sqrt(n), whatever else is open."""
    heights = simulated(lambda p, x: 10.0 * np.exp(p[0] + p[1]), (0.0, 1.0), (0.0, 1.0))
    for n in (4, 16):
        fit = fit_torque(heights, measured(lambda p, x: 10.0 * np.exp(p[0] + p[1]), (0.5, 0.5), n=n, noise=0.05))
        assert np.log(fit.high / fit.torque) == pytest.approx(1.96 * 0.05 / np.sqrt(n), rel=0.01)


def test_parameters_that_go_together_are_a_valley():
    """Where only friction + 2 rolling counts, neither is bounded, and the valley is that line."""
    fit = fit_torque(
        simulated(product_of, (0.2, 0.45, 0.7), (0.0, 0.25, 0.5)), measured(product_of, (0.45, 0.25), noise=0.01)
    )
    friction, rolling = fit.parameters
    assert friction.bounded == (False, False) and (friction.low, friction.high) == (0.2, 0.7)
    assert len(fit.valley) > 20
    assert fit.valley @ [1.0, 2.0] == pytest.approx(0.95, abs=0.03)
    assert rolling.high - rolling.low == pytest.approx(0.25, abs=0.05)


def test_another_measurement_closes_the_valley():
    """A second quantity of both, as the angle of repose is one, bounds what the curve alone leaves open."""
    fit = fit_torque(
        simulated(product_of, (0.2, 0.45, 0.7), (0.0, 0.25, 0.5)), measured(product_of, (0.45, 0.25), noise=0.01),
        lambda p: (p[0] - p[1] - 0.2) / 0.02,
    )  # fmt: skip
    assert all(one.bounded == (True, True) for one in fit.parameters)
    assert [one.value for one in fit.parameters] == pytest.approx([0.45, 0.25], abs=0.03)


def test_a_curve_of_another_shape_is_not_fitted():
    """Torque that falls with the current: the probability says it, and the range is not left."""
    points = simulated(product_of, (0.2, 0.7), (0.0, 0.5))
    fit = fit_torque(points, measured(lambda p, x: 10.0 / x, (0.0, 0.0), noise=0.02))
    assert fit.is_poor
    for one, ends in zip(fit.parameters, ((0.2, 0.7), (0.0, 0.5)), strict=True):
        assert ends[0] <= one.low <= one.value <= one.high <= ends[1]


@pytest.mark.parametrize(
    ("points", "curve", "says"),
    [
        (simulated(product_of, (0.2, 0.7), (0.1,)), measured(product_of, (0.4, 0.1)), "one value only"),
        (simulated(product_of, (0.2, 0.7), (0.0, 0.5)), measured(product_of, (0.4, 0.1), n=2), "cannot fix"),
        (simulated(lambda p, x: 0.0, (0.2, 0.7)), measured(product_of, (0.4, 0.1)), "no torque"),
        (
            simulated(product_of, (0.2, 0.7), (0.0, 0.5)),
            MeasuredTorques(np.array([0.1, 0.5, 1.0]), np.ones(3)),
            "nothing is extrapolated",
        ),
        (
            simulated(product_of, (0.2, 0.7), (0.0, 0.5)),
            MeasuredTorques(np.array([0.2, 0.5, 1.0]), np.ones(3), None, 3.0),
            "a common error of 3 is out of range",
        ),
    ],
)
def test_what_cannot_be_fitted_is_refused(points, curve, says):
    with pytest.raises(ValueError, match=says):
        fit_torque(points, curve)


@pytest.mark.parametrize("seed", [7, 31])
def test_the_band_of_a_curve_that_nothing_fits_has_a_bound(seed):
    """Measured torques four times too large, with errors of 1 %: the band by linear propagation went up to 1e57 N m."""
    p, x = (one.ravel() for one in np.meshgrid([0.2, 0.45, 0.7], [0.2, 0.45, 1.0]))
    random, at = np.random.default_rng(seed), np.geomspace(0.2, 1.0, 30)

    def truth(p, x):
        return 10.0 * x**1.3 * np.exp(0.9 * p - 0.3 * p**2)

    torque = truth(p, x) * (1.0 + 0.03 * random.standard_normal(9))
    curve = 4.0 * truth(0.35, at) * (1.0 + 0.01 * random.standard_normal(30))
    points = SimulatedTorques(("friction",), p[:, None], x, torque, 0.03 * torque)
    found = fit_torque(points, MeasuredTorques(at, curve, 0.01 * curve))
    assert found.is_poor
    assert (found.high < 1e10 * found.torque).all()
