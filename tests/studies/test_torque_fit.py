"""Fits to measured torques: a known truth is recovered, intervals hold it, what cannot be told apart is a valley."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from emclutch.studies.torque_fit import MeasuredTorques, TrialTorques, fit_torque

DRIVES = np.array([0.2, 0.35, 0.6, 1.0])
LAW, FORM = 0.07, 0.03
GUESS = np.log(2.0) / 1.96


def trials(torque, *levels, error=LAW, guess=0.0):
    """Torques by a law for all combinations of values, with its errors, which may change with the parameters."""
    points = np.array(list(itertools.product(*levels)))
    T = np.array([[torque(p, x) for x in DRIVES] for p in points])
    e = np.array([[error(p) if callable(error) else error] * len(DRIVES) for p in points])
    shape = (*(len(one) for one in levels), len(DRIVES))
    names = ("friction", "rolling", "fill")[: len(levels)]
    guesses = np.broadcast_to(guess, T.shape)
    return TrialTorques(names, tuple(map(np.array, levels)), DRIVES, T.reshape(shape), e.reshape(shape),
                        guesses.reshape(shape), FORM)  # fmt: skip


def measured(torque, truth, n=8, noise=0.02, known=True, common=0.0, factor=1.0):
    """A curve without scatter, whose errors are said to be `noise`."""
    x = np.geomspace(DRIVES[0], DRIVES[-1], n)
    T = factor * np.array([torque(truth, at) for at in x])
    return MeasuredTorques(x, T, noise * T if known else None, common)


def strength(p, x):
    """One parameter, the strength: ln T rises by 1 with it."""
    return 10.0 * x**1.3 * np.exp(p[0])


def shapes(p, x):
    """The first parameter changes the exponent, the second the height: both can be told apart."""
    return 10.0 * x ** (1.0 + 2.0 * p[0]) * np.exp(p[1])


def product_of(p, x):
    """Only one combination of both counts."""
    return 10.0 * x**1.3 * np.exp(p[0] + 2.0 * p[1])


GRID = np.linspace(-1.0, 1.0, 21)


def test_a_known_truth_is_recovered():
    found = fit_torque(trials(shapes, GRID, GRID), measured(shapes, (0.35, 0.2), noise=1e-3))
    for one, truth in zip(found.parameters, (0.35, 0.2), strict=True):
        assert one.value == pytest.approx(truth, abs=0.01)  # the grid
        assert one.low < one.value < one.high and one.bounded == (True, True)
    assert not found.is_poor and found.scatter < 0.01
    assert np.all((found.measured[:, 1] < found.measured[:, 0]) & (found.measured[:, 0] < found.measured[:, 2]))


def drawn_with_all_errors(rng, curve, error):
    """A curve with an error of the law, which all points share but for that of its form, of each point and of all."""
    n, log_x = len(curve.drive), np.log(curve.drive)
    form = 0.5 * FORM**2 * np.exp(-np.abs(log_x[:, None] - log_x)) + 1e-12 * np.eye(n)
    miss = np.linalg.cholesky(form) @ rng.normal(size=n) + np.hypot(error, np.sqrt(0.5) * FORM) * rng.normal()
    miss += curve.common_error * rng.normal()
    own = 0.02 if curve.error is None else curve.error / curve.torque
    torque = curve.torque * np.exp(miss + own * rng.normal(size=n))
    return replace(curve, torque=torque, error=None if curve.error is None else own * torque)


@pytest.mark.parametrize(
    ("n", "known", "common", "error"),
    [(1, True, 0.0, 0.07), (4, True, 0.03, 0.07), (30, True, 0.0, 0.07), (5, False, 0.0, 0.07), (8, True, 0.0, None)],
)
def test_intervals_hold_the_truth_as_often_as_they_say(n, known, common, error):
    """95 %, within three standard deviations of the count; where the law's error changes with the parameter too.

    The probability of the misfit is below 5 % as often as that.
    """
    rng, draws, inside, small = np.random.default_rng(3), 300, 0, 0

    def error_of(p):
        return 0.07 + 0.05 * p[0] if error is None else error

    law = trials(strength, GRID, error=error_of)
    for _ in range(draws):
        truth = rng.uniform(-0.3, 0.3)
        exact = measured(strength, (truth,), n=n, known=known, common=common)
        found = fit_torque(law, drawn_with_all_errors(rng, exact, error_of((truth,))))
        inside += found.parameters[0].low <= truth <= found.parameters[0].high
        small += found.probability is not None and found.probability < 0.05
        assert (found.probability is None) == (known and n == 1)
    allowed = 3.0 * np.sqrt(0.95 * 0.05 / draws)
    assert abs(inside / draws - 0.95) < allowed
    assert small / draws < 0.05 + allowed


@pytest.mark.parametrize("n", [4, 8, 100])
def test_more_measured_points_do_not_reduce_what_they_share(n):
    """The strength is known no better than the law and the calibration are: sqrt(e^2 + d^2/2 + c^2) at the least."""
    (one,) = fit_torque(trials(strength, GRID), measured(strength, (0.0,), n=n, common=0.05)).parameters
    shared = np.sqrt(LAW**2 + 0.5 * FORM**2 + 0.05**2)
    assert 1.0 < (one.high - one.low) / (2.0 * 1.96 * shared) < 1.1


def test_a_fit_does_not_depend_on_the_unit_and_its_strength_follows_the_measured_torques():
    """Law and curve times one factor: the same; the curve alone times exp(s): the strength rises by s, and no width."""
    law, curve = trials(strength, GRID), measured(strength, (0.1,), common=0.03)
    (first,) = fit_torque(law, curve).parameters
    times = replace(law, torque=1e3 * law.torque), measured(strength, (0.1,), common=0.03, factor=1e3)
    (other,) = fit_torque(*times).parameters
    assert (other.value, other.low, other.high) == pytest.approx((first.value, first.low, first.high), abs=1e-9)
    (shifted,) = fit_torque(law, measured(strength, (0.1,), common=0.03, factor=np.exp(0.2))).parameters
    moved = np.array([shifted.value - first.value, shifted.low - first.low, shifted.high - first.high])
    assert moved == pytest.approx(0.2, abs=1e-6)


def test_parameters_that_go_together_are_a_valley():
    """Where only friction + 2 rolling counts, friction is not bounded, and the valley is that line."""
    levels = np.linspace(0.2, 0.7, 21), np.linspace(0.0, 0.5, 21)
    found = fit_torque(trials(product_of, *levels, error=0.01), measured(product_of, (0.45, 0.25), noise=0.01))
    friction, _ = found.parameters
    assert friction.bounded == (False, False) and (friction.low, friction.high) == (0.2, 0.7)
    assert len(found.valley) > 20
    assert found.valley @ [1.0, 2.0] == pytest.approx(0.95, abs=0.03)
    closed = fit_torque(
        trials(product_of, *levels, error=0.01), measured(product_of, (0.45, 0.25), noise=0.01),
        lambda at: (at[0][:, None] - at[1] - 0.2) / 0.02,
    )  # fmt: skip
    assert all(one.bounded == (True, True) for one in closed.parameters)
    assert [one.value for one in closed.parameters] == pytest.approx([0.45, 0.25], abs=0.01)


def test_three_parameters_are_fitted_together():
    found = fit_torque(
        trials(lambda p, x: shapes(p, x) * np.exp(0.0 * p[2]), *3 * [np.linspace(-1.0, 1.0, 7)]),
        measured(shapes, (0.3, 0.2)),
    )
    assert [one.value for one in found.parameters[:2]] == pytest.approx([0.3, 0.2], abs=0.03)
    assert found.parameters[2].bounded == (False, False) and found.valley.shape[1] == 3


def test_a_curve_of_another_shape_is_not_fitted():
    """Torque that falls with the current: the probability says it, and range and band have bounds."""
    found = fit_torque(trials(product_of, [0.2, 0.4, 0.7], [0.0, 0.5]), measured(lambda p, x: 10.0 / x, (0.0, 0.0)))
    assert found.is_poor and not found.has_shape and np.isfinite(found.measured).all()
    for one, ends in zip(found.parameters, ((0.2, 0.7), (0.0, 0.5)), strict=True):
        assert ends[0] <= one.low <= one.value <= one.high <= ends[1]


@pytest.mark.parametrize("known", [True, False])
def test_a_factor_of_three_is_no_error_of_single_points(known):
    """Beyond what the parameters reach nothing fits; errors that are unknown are no larger than the scatter says."""
    law = trials(strength, np.linspace(-0.2, 0.2, 21))
    found = fit_torque(law, measured(strength, (0.0,), n=5, known=known, factor=3.0))
    assert found.is_poor and found.own_error < 0.03 and found.scatter > 0.8
    assert found.has_shape and found.factor == pytest.approx(3.0 * np.exp(-0.2), rel=0.05)
    assert not fit_torque(law, measured(strength, (0.1,), n=5, known=known)).is_poor
    calibration = replace(measured(strength, (0.0,), n=5, known=known, factor=3.0), common_error=1.0)
    assert not fit_torque(law, calibration).is_poor


def test_a_point_at_which_the_law_is_a_guess_has_little_weight():
    """Beyond the law at the first drive only: a torque there 30 % off moves the strength by less than 1 %."""
    curve = measured(strength, (0.0,), n=4)
    off = replace(curve, torque=curve.torque * [1.3, 1.0, 1.0, 1.0], error=curve.error * [1.3, 1.0, 1.0, 1.0])
    for guess, moves in ((0.0, True), ([GUESS, 0.0, 0.0, 0.0], False)):
        found = fit_torque(trials(strength, GRID, guess=guess), off)
        assert (abs(found.parameters[0].value) > 0.01) == moves
        assert found.guess_at.tolist() == [not moves, False, False, False] and not found.is_guess
        assert found.is_poor == moves and (found.scatter > 0.05) == moves


def test_the_band_has_the_factor_of_a_guess_where_the_law_is_one():
    """As the interval of a map there; beyond the next drives it is that of the parameters."""
    found = fit_torque(trials(strength, GRID, guess=[GUESS, 0.0, 0.0, 0.0]), measured(strength, (0.0,)))
    mean, low, high = found.measured.T
    assert found.guess_at.tolist()[0] and 2.0 < high[0] / mean[0] < 2.2 and 2.0 < mean[0] / low[0] < 2.2
    assert (high[-3:] / mean[-3:] < 1.2).all() and found.curve[0, 3] / found.curve[0, 1] > 2.0


@pytest.mark.parametrize(
    ("torque", "error", "fall"),
    [
        ([1.0, 2.0, 3.0, 2.0], 0.1, (2, 3)), ([1.0, 3.0, 2.9, 2.5], 0.1, (1, 3)), ([1.0, 2.0, 3.0, 2.8], 0.1, ()),
        ([1.0, 2.0, 3.0, 2.8], None, (2, 3)), ([1.0, 2.0, 3.0, 2.9], None, ()), ([1.0, 2.0, 3.0, 4.0], None, ()),
    ],
)  # fmt: skip
def test_a_torque_that_falls_with_the_current_beyond_its_errors_is_found(torque, error, fall):
    curve = MeasuredTorques(DRIVES, np.array(torque), None if error is None else np.full(4, error))
    assert curve.largest_fall() == tuple((DRIVES[k], torque[k]) for k in fall)
    assert not replace(curve, drive=np.ones(4)).largest_fall()  # scatter of one current


def test_where_the_law_is_a_guess_the_strength_is_known_within_its_factor():
    wide = np.linspace(-2.0, 2.0, 21)
    found = fit_torque(trials(strength, wide, guess=GUESS), measured(strength, (0.0,)))
    assert found.is_guess and not found.guess_at.any()
    assert found.parameters[0].high == pytest.approx(np.log(2.0), rel=0.05)
