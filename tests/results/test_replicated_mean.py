"""The error of a mean out of replicas: what one run cannot know about itself is in it."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import stdtrit

from emclutch.results.replicated_mean import replicated_mean
from emclutch.results.statistics import Estimate, correlation_samples, steady_mean
from emclutch.scene.torque_target import TorqueTarget
from emclutch.simulation.torque_known import asked_at, how_it_ended, is_known

PHI, COUNT = 0.8, 400
OWN = 1.0 / ((1.0 - PHI) * np.sqrt(COUNT))  # standard deviation of the mean of such an AR(1) series
TIME = 1e-3 * np.arange(1, COUNT + 1)
WIDTH = np.full(COUNT, 1e-3)


def replicas(rng, count, packing):
    """AR(1) series round 10, each with a level of its own: `packing` in standard deviations of a series' mean."""
    noise = rng.standard_normal((count, COUNT))
    noise[:, 0] /= np.sqrt(1.0 - PHI**2)
    y = lfilter([1.0], [1.0, -PHI], noise)
    level = 10.0 + packing * OWN * rng.standard_normal((count, 1))
    return [(TIME, series, WIDTH) for series in y + level]


def apart(a: Estimate, b: Estimate) -> bool:
    """Whether two means differ by more than the 95 % interval of their difference (Welch)."""
    parts = np.array([a.standard_error, b.standard_error]) ** 2
    freedom = parts.sum() ** 2 / (parts**2 / [a.degrees_of_freedom, b.degrees_of_freedom]).sum()
    return abs(a.mean - b.mean) > stdtrit(freedom, 0.975) * np.sqrt(parts.sum())


@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize("packing", [0.0, 1.0, 3.0])
def test_two_means_lie_within_the_interval_of_their_difference(count, packing):
    rng = np.random.default_rng(5)
    found = [replicated_mean(replicas(rng, count, packing)) for _ in range(400)]
    covered = 1.0 - np.mean([apart(a, b) for a, b in zip(found[::2], found[1::2], strict=True)])
    assert 0.90 <= covered <= 0.99
    assert np.mean([one.converged for one in found]) > 0.95


def test_one_run_alone_promises_too_much_where_packings_differ():
    """What the replicas are for: the same series, each with the error that it finds for itself."""
    rng = np.random.default_rng(6)
    alone = [steady_mean(*replicas(rng, 1, 3.0)[0][:2]) for _ in range(300)]
    assert np.mean([low <= 10.0 <= high for low, high in (one.interval() for one in alone)]) < 0.6
    assert all(one.replicas == 1 and one.packing_share is None for one in alone)


def test_the_share_of_the_packings_is_found():
    rng = np.random.default_rng(7)
    shares = [replicated_mean(replicas(rng, 4, 3.0)).packing_share for _ in range(300)]
    assert np.sqrt(np.mean(np.square(shares))) == pytest.approx(3.0 * OWN, rel=0.1)


def test_replicas_that_do_not_differ_are_one_longer_run():
    """Error and degrees of freedom tend to those of all batches together."""
    rng = np.random.default_rng(8)
    found = [replicated_mean(replicas(rng, 8, 0.0)) for _ in range(100)]
    assert np.mean([one.standard_error for one in found]) == pytest.approx(OWN / np.sqrt(8), rel=0.15)
    assert np.median([one.degrees_of_freedom for one in found]) > 20


def test_the_common_transient_is_cut_off():
    rng = np.random.default_rng(9)
    signals = [(t, y - 40.0 * np.exp(-t / 0.03), dt) for t, y, dt in replicas(rng, 3, 0.0)]
    assert replicated_mean(signals).start > 0.06
    assert abs(replicated_mean(signals).mean - 10.0) < 4.0 * OWN


def test_a_common_drift_is_seen_though_levels_differ():
    rng = np.random.default_rng(10)
    signals = [(t, y + 3.0 * t / t[-1], dt) for t, y, dt in replicas(rng, 3, 3.0)]
    found = replicated_mean(signals, average_from=0.0)
    assert not found.converged and "drifts" in found.reason


def test_windows_of_other_lengths_are_brought_together():
    """Replicas whose steps differ have other windows; the integral over time is kept."""
    fine = np.sin(np.arange(800) * 0.05) + np.random.default_rng(1).standard_normal(800)
    coarse = (TIME, fine.reshape(400, 2).mean(axis=1), WIDTH)
    both = replicated_mean([coarse, (5e-4 * np.arange(1, 801), fine, np.full(800, 5e-4))], average_from=0.0)
    assert both.mean == pytest.approx(fine.mean(), rel=1e-9) and both.packing_share == 0.0


def test_of_one_replica_it_is_the_mean_of_a_single_run():
    signal = replicas(np.random.default_rng(2), 1, 0.0)
    assert replicated_mean(signal) == steady_mean(*signal[0][:2], duration=WIDTH)
    with pytest.raises(ValueError, match="no replica"):
        replicated_mean([])


def test_correlation_of_several_series_is_that_of_their_mean_covariance():
    rng = np.random.default_rng(3)
    series = np.array([y for _, y, _ in replicas(rng, 50, 5.0)])
    assert correlation_samples(series) == pytest.approx((1 + PHI) / (1 - PHI), rel=0.1)


def estimate(mean, error, **other):
    values = {"converged": True, "reason": "converged", "replicas": 2, "degrees_of_freedom": 30.0} | other
    return Estimate(mean, error, 20, 1e-3, 0.0, values.pop("converged"), values.pop("reason"), **values)


def test_a_torque_is_known_by_half_its_interval():
    """2.04 standard errors at 30 degrees of freedom."""
    assert is_known(estimate(10.0, 0.095), TorqueTarget(0.02)) and not is_known(estimate(10.0, 0.1), TorqueTarget(0.02))
    assert is_known(estimate(-10.0, 0.095), TorqueTarget(0.02))
    assert is_known(estimate(10.0, 0.1), TorqueTarget(0.02, 0.3)) and is_known(
        estimate(0.0, 0.1), TorqueTarget(None, 0.3)
    )
    assert not is_known(estimate(10.0, 0.01, converged=False), TorqueTarget(0.02))


@pytest.mark.parametrize(
    ("torque", "words"),
    [
        (estimate(1e-6, 1e-5), "no torque that differs from 0.*or 0.01 N m"),
        (estimate(1.0, 0.1), r"estimate: .* s will do, or more accuracy.replicas"),
        (estimate(1.0, 0.1, degrees_of_freedom=1.2, packing_share=0.2), "packings differ by 0.2 N m.*raise"),
        (estimate(1.0, 0.1, converged=False, reason="the gap was sheared by 2 only"), "sheared by 2 only"),
    ],
)
def test_an_end_without_a_known_torque_says_why(torque, words):
    import re

    import pandas

    told = how_it_ended(torque, TorqueTarget(0.02), pandas.DataFrame({"time": [0.5, 1.0]}))
    assert not told["reached"] and re.search(words, told["reason"])


def test_questions_are_few_and_before_the_end():
    assert len(asked_at(1.0)) < 25 and asked_at(1.0)[-1] < 1.0 <= 1.25 * asked_at(1.0)[-1]
    np.testing.assert_allclose(asked_at(3.0), 3.0 * np.array(asked_at(1.0)))
