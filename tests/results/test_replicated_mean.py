"""Mean, interval and drift over replicas: one replica is one number."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import stdtrit

from emclutch.results.replicated_mean import (
    Steadiness,
    drift_in_words,
    drifts_significantly,
    replicated_mean,
    steadiness,
)
from emclutch.results.statistics import Estimate, correlation_samples, steady_mean

PHI, COUNT = 0.8, 400
OWN = 1.0 / ((1.0 - PHI) * np.sqrt(COUNT))  # standard deviation of the mean of such an AR(1) series
TIME = 1e-3 * np.arange(1, COUNT + 1)
WIDTH = np.full(COUNT, 1e-3)


def replicas(rng, count, packing, level=10.0):
    """AR(1) series round a level, each with its own: `packing` in standard deviations of a series' mean."""
    noise = rng.standard_normal((count, COUNT))
    noise[:, 0] /= np.sqrt(1.0 - PHI**2)
    y = lfilter([1.0], [1.0, -PHI], noise)
    levels = level + packing * OWN * rng.standard_normal((count, 1))
    return [(TIME, series, WIDTH) for series in y + levels]


def test_the_error_is_that_of_the_means_of_the_replicas():
    """Student's t with one degree of freedom less than replicas, of their means over one stretch."""
    signals = replicas(np.random.default_rng(1), 5, 3.0)
    found = replicated_mean(signals, average_from=0.2)
    means = np.array([y[200:].mean() for _, y, _ in signals])
    assert found.mean == pytest.approx(means.mean(), rel=1e-12) and found.degrees_of_freedom == 4.0
    assert found.standard_error == pytest.approx(means.std(ddof=1) / np.sqrt(5), rel=1e-12)
    slopes = [np.polyfit(TIME[200:] - 0.5e-3, y[200:], 1)[0] for _, y, _ in signals]
    assert found.drift == pytest.approx(np.mean(slopes), rel=1e-9)
    for looks, level in ((False, 0.975), (True, 0.985)):  # three fifths of 2.5 % where a rule looks several times
        found = replicated_mean(signals, average_from=0.2, several_looks=looks)
        half = np.hypot(stdtrit(4, level) * found.standard_error, 0.5 * found.drift * 0.2)
        assert found.half_width() == pytest.approx(half, rel=1e-9)


@pytest.mark.parametrize("packing", [0.0, 1.0, 6.0])
def test_the_error_of_the_drift_is_honest(packing):
    """A drift of zero is excluded at 90 % in 10 % of cases, whatever the levels: slopes do not know them."""
    rng = np.random.default_rng(2)
    found = [replicated_mean(replicas(rng, 4, packing), average_from=0.0) for _ in range(400)]
    assert all(one.drift_freedom == 11.0 for one in found)
    excluded = np.mean([abs(one.drift) > stdtrit(11, 0.95) * one.drift_error for one in found])
    assert 0.06 <= excluded <= 0.15


def test_intervals_hold_and_are_not_much_too_wide():
    rng = np.random.default_rng(3)
    found = [replicated_mean(replicas(rng, 6, 2.0)) for _ in range(300)]
    assert 0.955 <= np.mean([low <= 10.0 <= high for low, high in (one.interval() for one in found)])
    plain = [stdtrit(5, 0.975) * one.standard_error for one in found]
    assert np.median([one.half_width() / half for one, half in zip(found, plain, strict=True)]) < 1.35


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_an_interval_of_one_look_is_that_of_students_t(count):
    """Of 1500 such runs 0.95 to 0.96 hold; with the 97 % of several looks 0.97 to 0.98, by 15 to 67 % wider."""
    rng = np.random.default_rng(count)
    found = [replicated_mean(replicas(rng, count, 2.0), average_from=0.0, exclude_drift=False) for _ in range(400)]
    assert 0.93 <= np.mean([low <= 10.0 <= high for low, high in (one.interval() for one in found)]) <= 0.97
    assert found[0].half_width() == pytest.approx(stdtrit(count - 1, 0.975) * found[0].standard_error, rel=1e-12)
    looked = replace(found[0], several_looks=True)
    assert looked.half_width() == pytest.approx(stdtrit(count - 1, 0.985) * looked.standard_error, rel=1e-12)


def test_a_studys_scatter_is_pooled_by_degrees_of_freedom():
    signals = replicas(np.random.default_rng(1), 4, 3.0)
    alone = replicated_mean(signals, average_from=0.2)
    own, known = alone.standard_error * 2.0, 1.2 * alone.standard_error * 2.0
    found = replicated_mean(signals, average_from=0.2, scatter=known / abs(alone.mean), scatter_freedom=16.0)
    assert found.mean == alone.mean and found.degrees_of_freedom == 19.0
    assert found.standard_error == pytest.approx(np.sqrt((16.0 * known**2 + 3.0 * own**2) / 19.0 / 4.0), rel=1e-12)
    n, s0 = found.replicas, found.pooled_scatter * found.mean  # what is written is enough to see what was pooled
    again = ((found.degrees_of_freedom * n * found.standard_error**2) - found.pooled_freedom * s0**2) / (n - 1)
    assert again == pytest.approx(own**2) and Estimate.from_dict(found.as_dict()) == found
    assert found.half_width() < alone.half_width()


def test_a_scatter_that_is_larger_than_the_studys_counts_alone():
    """Seven tenths of F are 1.36 for 3 and 16 degrees of freedom: a scatter of 1.17 times the study's."""
    signals = replicas(np.random.default_rng(1), 4, 3.0)
    alone = replicated_mean(signals, average_from=0.2)
    own = alone.standard_error * 2.0 / abs(alone.mean)
    less, more = (
        replicated_mean(signals, average_from=0.2, scatter=own / ratio, scatter_freedom=16.0) for ratio in (1.1, 1.2)
    )
    assert less.pooled_freedom == 16.0 and more == alone


@pytest.mark.parametrize("share", [0.9, 0.6, 0.3])
def test_replicas_that_have_not_come_as_far_keep_the_data_of_the_others(share):
    """One of four is shorter: 0.96 of 1500 intervals hold, and none is wider than that of four of full length."""
    rng, size = np.random.default_rng(4), round(share * COUNT)
    halves, right = [], []
    for _ in range(300):
        signals = replicas(rng, 4, 0.0)
        cut = [*signals[:2], tuple(one[:size] for one in signals[2]), signals[3]]
        found = [replicated_mean(one, average_from=0.05, exclude_drift=False) for one in (signals, cut)]
        halves.append([one.half_width() for one in found])
        right.append(abs(found[1].mean - 10.0) <= halves[-1][1])
    whole, own = np.median(halves, axis=0)
    assert 0.93 <= np.mean(right) <= 0.98
    variance = 0.95 / (share - 0.05)  # of the short one over that of the others
    assert own / whole == pytest.approx(np.sqrt((3.0 + variance) / 4.0), rel=0.1)
    assert found[1].end == pytest.approx(0.4)
    shortest = [tuple(one[:size] for one in signal) for signal in signals]
    assert replicated_mean(cut).start == replicated_mean(shortest).start


def test_one_run_alone_promises_too_much_where_packings_differ():
    """What the replicas are for: the same series, each with the error that it finds for itself."""
    rng = np.random.default_rng(6)
    alone = [steady_mean(*replicas(rng, 1, 3.0)[0][:2]) for _ in range(300)]
    assert np.mean([low <= 10.0 <= high for low, high in (one.interval() for one in alone)]) < 0.6
    assert all(one.replicas == 1 and one.drift is None for one in alone)


def test_the_common_start_up_is_left_out():
    rng = np.random.default_rng(9)
    signals = [(t, y - 40.0 * np.exp(-t / 0.03), dt) for t, y, dt in replicas(rng, 4, 0.0)]
    found = replicated_mean(signals)
    assert found.start > 0.13 and abs(found.mean - 10.0) < 4.0 * OWN


def test_nothing_is_averaged_before_the_known_start_up_ends():
    signals = replicas(np.random.default_rng(9), 4, 0.0)
    assert replicated_mean(signals, settled=0.25).start == pytest.approx(0.25)
    short = replicated_mean(signals, settled=0.395)
    assert not short.converged and "too short for its start-up" in short.reason and short.standard_error is None
    assert replicated_mean(signals[:1], settled=0.25).start >= 0.25  # of one packing too
    assert replicated_mean(signals, settled=0.25, average_from=0.1).start == pytest.approx(0.1)  # the scene's word


def test_a_start_up_that_takes_most_of_the_run_is_reported():
    rng = np.random.default_rng(4)
    signals = [(t, y + 60.0 * np.exp(-t / 0.08), dt) for t, y, dt in replicas(rng, 8, 0.0)]
    found = replicated_mean(signals)
    assert found.starts_up and not found.converged
    assert steadiness(found, 100.0) is not Steadiness.STEADY  # however small the drift that is left
    assert not replicated_mean(signals, settled=0.3).starts_up  # known, and left out


def verdict(total, rng, target=0.2, count=6):
    """Verdict on series that drift by `total` over the run."""
    signals = [(t, y + total * t / t[-1], dt) for t, y, dt in replicas(rng, count, 0.0)]
    found = replicated_mean(signals, average_from=0.0, wanted=lambda mean: target)
    return found, steadiness(found, target)


def test_verdicts():
    """Steady: a drift of twice the target is excluded; drifting: zero is; and what is reported says so."""
    rng = np.random.default_rng(5)
    found, steady = verdict(0.0, rng, target=2.0)
    assert steady is Steadiness.STEADY and found.converged and found.status == "steady"
    found, drifting = verdict(4.0, rng, target=0.5)
    assert drifting is Steadiness.DRIFTING and not found.converged and found.status == "drifting"
    assert drifts_significantly(found, 0.5) and "interval is of this part" in found.reason
    found, unknown = verdict(0.0, rng, target=0.02)
    assert unknown is Steadiness.NOT_SETTLED and found.status == "not settled"
    assert not drifts_significantly(found, 0.5)


def test_where_the_start_up_is_known_only_a_drift_that_is_certain_is_refused():
    rng = np.random.default_rng(5)

    def known(total, target):
        signals = [(t, y + total * t / t[-1], dt) for t, y, dt in replicas(rng, 6, 0.0)]
        found = replicated_mean(signals, average_from=0.0, exclude_drift=False, wanted=lambda mean: target)
        plain = replicated_mean(signals, average_from=0.0, wanted=lambda mean: target)
        assert found.half_width() <= plain.half_width()
        return found

    steady, drifting = known(0.0, 0.02), known(4.0, 0.5)
    assert steady.converged and steady.status == "steady"
    assert steadiness(drifting, 0.5) is Steadiness.DRIFTING and not drifting.converged
    assert Estimate.from_dict(steady.as_dict()) == steady


def test_a_drift_of_twice_the_target_is_rarely_called_steady():
    rng = np.random.default_rng(7)
    steady = [verdict(3.0, rng, target=1.5)[1] is Steadiness.STEADY for _ in range(200)]
    assert np.mean(steady) <= 0.05  # 2.5 % at one look
    none = [verdict(0.0, rng, target=1.5)[1] is Steadiness.STEADY for _ in range(100)]
    assert np.mean(none) >= 0.8


def test_the_drift_in_words_has_its_sign():
    signals = [(t, y + 4.0 * t / t[-1], dt) for t, y, dt in replicas(np.random.default_rng(8), 6, 0.0)]
    assert drift_in_words(replicated_mean(signals, average_from=0.0)).startswith(("3", "2"))
    mirrored = [(t, -y, dt) for t, y, dt in signals]
    assert drift_in_words(replicated_mean(mirrored, average_from=0.0)).startswith(("3", "2"))  # it grows


def test_windows_of_other_lengths_are_brought_together():
    """Replicas whose steps differ have other windows; the integral over time is kept."""
    fine = np.sin(np.arange(800) * 0.05) + np.random.default_rng(1).standard_normal(800)
    coarse = (TIME, fine.reshape(400, 2).mean(axis=1), WIDTH)
    both = replicated_mean([coarse, (5e-4 * np.arange(1, 801), fine, np.full(800, 5e-4))], average_from=0.0)
    assert both.mean == pytest.approx(fine.mean(), rel=1e-9) and both.standard_error == pytest.approx(0.0, abs=1e-12)


def test_of_one_replica_it_is_the_mean_of_a_single_run():
    signal = replicas(np.random.default_rng(2), 1, 0.0)
    found, alone = replicated_mean(signal), steady_mean(*signal[0][:2], duration=WIDTH)
    assert alone.converged and found == alone.of_one_replica() != alone
    assert "scatter between replicas" in found.reason and "accuracy.replicas = 4" in found.remedy
    with pytest.raises(ValueError, match="no replica"):
        replicated_mean([])


def test_a_signal_that_does_not_change_has_no_error():
    found = replicated_mean([(TIME, np.full(COUNT, 3.0), WIDTH)] * 4)
    assert found.standard_error is None and not found.converged and "the signal is constant" in found.reason


def test_too_few_windows_are_reported():
    short = [(t[:15], y[:15], dt[:15]) for t, y, dt in replicas(np.random.default_rng(1), 3, 0.0)]
    assert "15 windows, 20 needed" in replicated_mean(short).reason


def test_correlation_of_several_series_is_that_of_their_mean_covariance():
    rng = np.random.default_rng(3)
    series = np.array([y for _, y, _ in replicas(rng, 50, 5.0)])
    assert correlation_samples(series) == pytest.approx((1 + PHI) / (1 - PHI), rel=0.1)


def test_what_a_packing_fluctuates_by_itself_is_found():
    found = replicated_mean(replicas(np.random.default_rng(3), 24, 5.0), average_from=0.0)
    assert found.fluctuation == pytest.approx(OWN, rel=0.2)


def test_an_estimate_survives_json():
    found = replicated_mean(replicas(np.random.default_rng(3), 4, 1.0))
    assert Estimate.from_dict(found.as_dict()) == found


@pytest.mark.parametrize(("drift", "steady"), [(0.0, True), (0.02, True), (-0.08, False), (0.08, False)])
def test_the_drift_of_one_replica_enters_its_verdict(drift, steady):
    """A fall of 8 % over the averaged part is beyond the usual 5 %, whatever the t test at 99.9 % says of it."""
    noise = 1.5 * np.random.default_rng(13).standard_normal(COUNT)  # a drift has an error of 2.6 %
    noise -= np.polyval(np.polyfit(TIME, noise, 1), TIME)  # its own is none
    signal = 10.0 * (1.0 + drift * (TIME / TIME[-1] - 0.5)) + noise
    plain = steady_mean(TIME, signal, average_from=0.0, duration=WIDTH)
    found = replicated_mean([(TIME, signal, WIDTH)], average_from=0.0)
    assert plain.converged and found.is_steady == steady and found.mean == plain.mean
    if not steady:
        assert f"{'falls' if drift < 0.0 else 'rises'} by " in found.reason and "run longer" in found.remedy


def test_noise_alone_is_no_drift_of_a_replica():
    rng = np.random.default_rng(13)
    alone = [replicated_mean([signal], average_from=0.0) for signal in replicas(rng, 300, 0.0)]
    plain = [steady_mean(*signal[:2], average_from=0.0) for signal in replicas(np.random.default_rng(13), 300, 0.0)]
    kept = [one.is_steady for one, other in zip(alone, plain, strict=True) if other.converged]
    assert np.mean(kept) > 0.9  # zero is excluded at 95 %
