"""The error bar of a mean: correct coverage, and refusal where the data do not carry it."""

from dataclasses import replace

import numpy as np
import pytest

from emclutch.results.statistics import Estimate, correlation_samples, more_time, steady_mean

UNKNOWN = (-np.inf, np.inf)


def autoregressive(phi, count, seeds, level=10.0):
    """Stationary AR(1) series (seeds, count) with unit innovations."""
    rng = np.random.default_rng(7)
    y = np.empty((seeds, count))
    y[:, 0] = rng.standard_normal(seeds) / np.sqrt(1.0 - phi**2)
    for i in range(1, count):
        y[:, i] = phi * y[:, i - 1] + rng.standard_normal(seeds)
    return y + level


@pytest.mark.parametrize(("phi", "count"), [(0.0, 300), (0.8, 1000), (0.9, 2000), (0.95, 4000)])
def test_interval_of_95_percent_covers_the_true_mean_of_an_autoregressive_process(phi, count):
    time = 1e-3 * np.arange(1, count + 1)
    estimates = [steady_mean(time, y) for y in autoregressive(phi, count, 250)]
    converged = [e for e in estimates if e.converged]
    assert len(converged) > 0.9 * len(estimates)
    covered = np.mean([lo <= 10.0 <= hi for lo, hi in (e.interval() for e in converged)])
    assert 0.88 <= covered <= 0.99
    # variance of the mean of an AR(1) process for n >> 1: 1/((1 - phi)^2 n)
    known = 1.0 / ((1.0 - phi) * np.sqrt(count))
    assert np.mean([e.standard_error for e in converged]) == pytest.approx(known, rel=0.15)


def test_correlation_time_of_an_autoregressive_process():
    found = np.mean([correlation_samples(y) for y in autoregressive(0.8, 4000, 20)])
    assert found == pytest.approx((1 + 0.8) / (1 - 0.8), rel=0.1)


def test_transient_is_cut_off():
    time = 1e-3 * np.arange(1, 2001)
    signal = autoregressive(0.5, 2000, 1)[0] - 300.0 * np.exp(-time / 0.05)
    estimate = steady_mean(time, signal)
    assert estimate.converged and 0.1 < estimate.start < 0.7
    assert abs(estimate.mean - 10.0) < 5.0 * estimate.standard_error


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_ramp_is_not_converged(noise):
    time = np.arange(1.0, 401.0)
    signal = time / 400.0 + noise * np.random.default_rng(1).standard_normal(400)
    estimate = steady_mean(time, signal)
    assert not estimate.converged and estimate.status == "not converged"


def test_noisy_ramp_after_a_chosen_start_is_not_converged():
    time = np.arange(1.0, 2001.0)
    signal = time / 2000.0 + 3.0 * np.random.default_rng(1).standard_normal(2000)
    estimate = steady_mean(time, signal, average_from=0.0)
    assert not estimate.converged and "drifts" in estimate.reason


@pytest.mark.parametrize("value", [0.1, 0.0])
@pytest.mark.parametrize("transient", [0, 20])
def test_a_signal_that_does_not_change_has_an_unknown_error(value, transient):
    signal = np.full(100, value)
    signal[:transient] += np.random.default_rng(2).standard_normal(transient)
    estimate = steady_mean(np.arange(1.0, 101.0), signal)
    assert (estimate.mean, estimate.standard_error, estimate.converged) == (value, None, False)
    assert estimate.interval() == UNKNOWN and not estimate.known and "the signal is constant" in estimate.reason


@pytest.mark.parametrize("count", [0, 1, 2, 5, 19])
def test_short_series_says_so_without_nan(count):
    estimate = steady_mean(np.arange(1.0, count + 1.0), np.arange(count) % 2)
    assert not estimate.converged and f"{count} samples, 20 needed; run longer" in estimate.in_words()
    assert estimate.standard_error is None and estimate.interval() == UNKNOWN and not estimate.known
    assert (estimate.mean is None) == (count == 0)


def test_too_few_uncorrelated_batches_are_counted():
    y = autoregressive(0.98, 400, 1)[0]
    estimate = steady_mean(np.arange(1.0, 401.0), y, average_from=0.0)
    assert not estimate.converged
    assert f"{estimate.batches} uncorrelated batches, 10 needed; run longer" in estimate.in_words()


def test_a_run_that_goes_on_as_long_as_estimated_reaches_the_precision():
    """Wanted is what 4444 samples have, estimated from 400; their batches alone are there after some 360."""
    series = autoregressive(0.8, 8000, 20, level=100.0)
    time = np.arange(1.0, 8001.0)
    wanted = 0.3 * 2.0 / ((1.0 - 0.8) * np.sqrt(400))
    reached = []
    for y in series:
        short = steady_mean(time[:400], y[:400], average_from=0.0)
        end = 400 + int(more_time(short, 400.0, wanted))
        reached.append(steady_mean(time[:end], y[:end], average_from=0.0).half_width() / wanted)
    assert np.median(reached) == pytest.approx(1.0, abs=0.25)


def test_more_time_holds_the_batches_and_is_not_said_where_none_helps():
    y = autoregressive(0.98, 400, 1, level=1e4)[0]
    few = steady_mean(np.arange(1.0, 401.0), y, average_from=0.0)
    assert few.batches < 10 and more_time(few, 400.0, 1e4) == pytest.approx(40.0 * few.correlation_time - 400.0)
    assert more_time(replace(few, start=None), 400.0, 1.0) is None


def test_unequal_windows_give_the_time_average():
    rng = np.random.default_rng(3)
    fine = autoregressive(0.8, 6000, 1)[0]
    ends = np.unique(rng.choice(np.arange(1, 6000), 4000, replace=False))
    ends = np.append(ends, 6000)
    starts = np.insert(ends[:-1], 0, 0)
    means = np.array([fine[a:b].mean() for a, b in zip(starts, ends, strict=True)])
    uneven = steady_mean(1e-3 * ends, means, average_from=0.0, duration=1e-3 * (ends - starts))
    even = steady_mean(1e-3 * np.arange(1, 6001), fine, average_from=0.0)
    assert uneven.mean == pytest.approx(even.mean, rel=1e-12)
    assert uneven.converged
    assert uneven.standard_error == pytest.approx(even.standard_error, rel=0.15)


def test_windows_before_average_from_do_not_count():
    time = np.arange(1.0, 201.0)
    signal = np.where(time <= 100.0, 1e6, np.random.default_rng(0).standard_normal(200))
    estimate = steady_mean(time, signal, average_from=100.0)
    assert estimate.start == 100.0 and abs(estimate.mean) < 0.5


def test_wrong_series_are_refused():
    with pytest.raises(ValueError, match="not finite"):
        steady_mean(np.arange(3.0), np.array([1.0, np.nan, 2.0]))
    with pytest.raises(ValueError, match="time must increase"):
        steady_mean(np.array([0.0, 2.0, 1.0]), np.ones(3))
    with pytest.raises(ValueError, match="equally long"):
        steady_mean(np.arange(3.0), np.ones(2))


def test_estimate_survives_json():
    estimate = steady_mean(np.arange(1.0, 101.0), np.random.default_rng(0).standard_normal(100))
    several = replace(estimate, replicas=4, several_looks=True, pooled_scatter=0.02, pooled_freedom=16.0)
    assert Estimate.from_dict(several.as_dict()) == several
    alone = estimate.of_one_replica()  # of an earlier version too, whose file calls it converged
    assert estimate.converged and not alone.converged and alone.is_steady
    assert Estimate.from_dict(estimate.as_dict()) == Estimate.from_dict(alone.as_dict()) == alone
