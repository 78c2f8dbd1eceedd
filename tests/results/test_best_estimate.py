"""The best estimate of a torque: raw torque over 1 + bias, errors in quadrature; an unknown error is infinite."""

import math

import pytest
from written_run import written_run

from emclutch.results import load_result
from emclutch.results.best_estimate import best_estimate
from emclutch.results.statistics import Estimate

TORQUE = Estimate(2.0, 0.05, 20, 1e-3, 1e-3, True, "steady", replicas=4, degrees_of_freedom=1e6, end=1.0,
                  drift=0.01, drift_error=0.01, drift_freedom=3.0)  # fmt: skip
SETTINGS = {"discretisation_error": {"bias": 0.25, "half_width": 0.03}}
COARSE = {"grain_size": {"torque_excess": 0.6, "torque_excess_low": 0.5, "torque_excess_high": 0.7}}
EXACT = {"discretisation_error": {"bias": 0.25, "half_width": 0.0}}


@pytest.mark.parametrize(("summary", "bias", "half"), [
    (SETTINGS, 0.25, 0.03), (COARSE, 0.6, 0.1 / 1.6), (SETTINGS | COARSE, 0.25, 0.03), (EXACT, 0.25, 0.0),
    (COARSE | {"discretisation_error": None}, 0.6, 0.1 / 1.6),
])  # fmt: skip
def test_the_best_estimate_is_the_torque_over_one_plus_bias_with_both_errors(summary, bias, half):
    best = best_estimate(TORQUE, summary)
    assert best.known and best.mean == pytest.approx(2.0 / (1.0 + bias))
    share = math.hypot(TORQUE.half_width() / 2.0, half)
    assert best.interval() == pytest.approx(((1.0 - share) * best.mean, (1.0 + share) * best.mean))


@pytest.mark.parametrize("summary", [{}, {"discretisation_error": None}, {"grain_size": {"across": 3.0}}])
def test_without_a_known_error_of_its_settings_the_raw_torque_is_the_best(summary):
    assert best_estimate(TORQUE, summary) == TORQUE


def test_a_short_run_has_an_infinite_interval_and_no_error(tmp_path):
    result = load_result(written_run(tmp_path, windows=3).path)
    for found in (result.torque, result.best):
        low, high = found.interval()
        assert (low, high) == (-math.inf, math.inf) and not found.known and found.mean == pytest.approx(2.0, rel=0.2)
    unsteady = best_estimate(result.torque, SETTINGS)
    assert unsteady.interval() == (-math.inf, math.inf) and unsteady.mean == pytest.approx(result.torque.mean / 1.25)
    nothing = best_estimate(Estimate(None, None, 0, None, None, False, "no window"), SETTINGS)
    assert nothing.mean is None and nothing.interval() == (-math.inf, math.inf)
