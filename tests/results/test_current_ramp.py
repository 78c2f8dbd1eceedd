"""Torque of a ramp of the current: bins give back the law of either branch, bands hold it as often as said."""

import numpy as np
import pandas as pd
import pytest

from emclutch.results.columns import DISC_SPEED, ROTOR_SPEED, TIME, TORQUE_DISC
from emclutch.results.current_ramp import (
    FALLING,
    HELD,
    RISING,
    Branch,
    CurrentRamp,
    RampBin,
    branches,
    current_ramp,
    in_words,
)
from emclutch.results.fits import Measured
from emclutch.results.pictures import current_ramp_picture
from emclutch.results.steady_torque import SteadyConditions
from geometry.time_profile import TimeProfile

RAMP = TimeProfile((0.0, 0.1, 0.2), (0.0, 2.0, 0.0))
GAP = SteadyConditions(shear_gap=1e-3, shear_radius=10e-3)
LEFT = 0.03  # [N m] at 0 A, falling


def history(currents, end, *, seed=0, noise=0.0, spread=0.0, windows=2000, speed=100.0):
    """T = I^2 rising and (I + 0.1 A)^2 falling, with noise of 8 correlated windows; shear rate 1000/s at 100 rad/s."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, end, windows + 1)[1:]
    begin = time - time[0]  # whose field the window keeps
    current, rising = currents.at(begin), begin < 0.1 - 1e-9
    torque = np.where(rising, current**2, (np.abs(current) + 0.1) ** 2)
    torque[begin > 0.2 - 1e-9] = LEFT
    rough = np.convolve(random.standard_normal(windows + 7), np.full(8, 8**-0.5), mode="valid")
    torque = torque * (1.0 + spread * random.standard_normal()) + noise * rough
    return pd.DataFrame({TIME: time, TORQUE_DISC: torque, ROTOR_SPEED: speed, DISC_SPEED: 0.0})


def test_bins_give_back_both_branches():
    """A mean over a bin of width w is I^2 + w^2/12; differences are (I + 0.1)^2 - I^2."""
    table = current_ramp([history(RAMP, 0.21)], RAMP, GAP).table()
    assert table["course"].tolist() == [RISING] * 20 + [FALLING] * 20 + [HELD]
    assert table["current"].iloc[:20].is_monotonic_increasing and table["current"].iloc[20:40].is_monotonic_decreasing
    x, torque = table["current"].to_numpy(), table["torque"].to_numpy()
    assert x[:20] == pytest.approx(np.arange(0.05, 2.0, 0.1), abs=1e-3)
    assert torque[:20] == pytest.approx(x[:20] ** 2 + 0.1**2 / 12.0, abs=1e-3)
    assert torque[20:40] == pytest.approx((x[20:40] + 0.1) ** 2 + 0.1**2 / 12.0, abs=1e-3)
    assert torque[40] == pytest.approx(LEFT) and x[40] == 0.0


def test_the_loop_has_its_width_area_and_residual_torque():
    found = current_ramp([history(RAMP, 0.21, seed=n) for n in range(3)], RAMP, GAP).summary()
    assert [one["share"] for one in found["loop"]] == [0.2, 0.5, 0.8]
    for one in found["loop"]:
        current = 2.0 * one["share"]
        assert one["width"] == pytest.approx(0.2 * current + 0.01, abs=2e-3)
        assert one["ratio"] == pytest.approx((1.0 + 0.1 / current) ** 2, rel=0.02)
    # integral of 0.2 I + 0.01 from 0 to 2 A, over 2 A times the middle of both branches at 2 A
    assert found["area"]["share"] == pytest.approx(0.42 / (2.0 * 4.2), rel=0.02)
    assert found["residual"]["torque"] == pytest.approx(LEFT)
    assert len(in_words(found)) == 6 and "1.004 N m rising" in in_words(found)[1]


@pytest.mark.parametrize("replicas", [1, 4])
def test_bands_hold_the_torque_as_often_as_said(replicas):
    """95 %: of 40 bins of 30 runs, less than 10 % and more than 1 % lie outside of their band."""
    outside = []
    for run in range(30):
        runs = [history(RAMP, 0.2, seed=replicas * run + n, noise=0.05, spread=0.02 * (replicas > 1))
                for n in range(replicas)]  # fmt: skip
        exact = current_ramp([history(RAMP, 0.2)], RAMP, GAP).table()["torque"]
        table = current_ramp(runs, RAMP, GAP).table()
        outside.append(((table["low"] > exact) | (table["high"] < exact)).mean())
    assert 0.01 < np.mean(outside) < 0.1, outside


def test_the_difference_is_taken_replica_by_replica():
    """Replicas that differ by 10 % in both branches alike have a difference known much better than either."""
    found = current_ramp([history(RAMP, 0.2, seed=n, spread=0.1) for n in range(4)], RAMP, GAP)
    middle = next(one for one in found.bins if one.kind == RISING and one.low >= 1.0)
    loop = found.summary()["loop"][1]
    assert loop["half_width"] < 0.3 * middle.torque.half_width() and loop["half_width"] < 0.3 * loop["width"]


def test_fewer_bins_of_a_faster_ramp_and_none_of_a_switching():
    """A bin has a shear strain of 1 at least; a branch of less than 5 is no ramp."""
    slow = current_ramp([history(RAMP, 0.2, speed=8.2)], RAMP, GAP)
    assert len(slow.table()) == 2 * 8
    assert current_ramp([history(RAMP, 0.2, speed=4.0)], RAMP, GAP) is None
    assert current_ramp([history(RAMP, 0.2)], TimeProfile.constant(1.0), GAP) is None
    assert current_ramp([history(RAMP, 0.2)], RAMP, SteadyConditions(shear_gap=0.0)) is None


def test_branches_are_those_of_the_magnitude():
    """A current that passes zero falls and then rises; what is held is neither."""
    course = TimeProfile((0.0, 1.0, 2.0, 4.0, 5.0), (0.0, 1.0, 1.0, -1.0, -1.5))
    assert branches(course, 6.0) == [
        Branch(RISING, 0.0, 1.0), Branch(HELD, 1.0, 2.0), Branch(FALLING, 2.0, 3.0), Branch(RISING, 3.0, 5.0),
        Branch(HELD, 5.0, 6.0),
    ]  # fmt: skip
    assert branches(course, 0.5) == [Branch(RISING, 0.0, 0.5)]


def test_a_rise_alone_has_no_loop(tmp_path):
    found = current_ramp([history(RAMP, 0.1, noise=0.01)], RAMP, GAP)
    assert found.summary() == {"largest_current": 2.0, "loop": [], "area": None, "residual": None}
    picture = current_ramp_picture(tmp_path / "ramp.png", found.table(), title="A rise")
    assert picture.stat().st_size > 10_000


def of_one_replica(change=lambda branch, k: {}, count=5):
    """Loop of T = I and I + 0.1 up to 1 A; errors of 0.01 N m with 4 degrees of freedom unless `change` says else."""
    bins = []
    for branch, kind in enumerate((RISING, FALLING)):
        for k in range(count):
            at = (k + 0.5) / count
            given = {"error": 0.01, "freedom": 4.0, "correlated": 1.0} | change(branch, k)
            means, correlated = np.array([at + 0.1 * branch]), given.pop("correlated")
            torque = Measured(float(means[0]), **given)
            bins.append(RampBin(branch, kind, k / count, (k + 1) / count, at, means, torque, correlated))
    return CurrentRamp(tuple(bins)).summary()


def test_an_unknown_error_of_a_bin_is_not_zero():
    """It makes unknown what the bin is part of, and nothing else."""
    found = of_one_replica(lambda branch, k: {"error": np.nan} if branch == 0 and k == 0 else {})
    assert [one["half_width"] is None for one in found["loop"]] == [True, False, False]
    assert found["area"]["half_width"] is None and found["area"]["share"] > 0.0
    assert "difference 0.1 N m (error unknown)" in in_words(found)[0]


def test_freedom_is_the_least_of_the_bins_in_a_number():
    """Bins at 0.7 and 0.9 A are in what is said at 80 % of 1 A, and in the area, but not in the rest."""
    usual = of_one_replica()
    less = of_one_replica(lambda branch, k: {"freedom": 2.0} if branch == 1 and k == 4 else {})
    by = [b["half_width"] / a["half_width"] for a, b in zip(usual["loop"], less["loop"], strict=True)]
    wider = 4.302653 / 2.776445  # Student's t at 2 and 4 degrees of freedom
    assert by == pytest.approx([1.0, 1.0, wider], rel=1e-6)
    assert less["area"]["half_width"] == pytest.approx(wider * usual["area"]["half_width"], rel=1e-6)


def test_noise_that_lasts_bins_adds_up_in_the_area():
    """An integral over noise of variance s^2 and correlation time tau has the variance s^2 tau a unit."""
    t = 2.776445
    usual, long = of_one_replica(), of_one_replica(lambda *_: {"correlated": 3.0})
    assert usual["area"]["half_width"] * usual["torque_at_largest_current"] == pytest.approx(t * 0.01 * (2 / 5) ** 0.5)
    assert long["area"]["half_width"] == pytest.approx(3.0**0.5 * usual["area"]["half_width"])
    # halves of two bins in each of two branches: independent 0.01 in all, else that of two alone
    assert usual["loop"][0]["half_width"] == pytest.approx(t * 0.01)
    assert long["loop"][0]["half_width"] == pytest.approx(t * 0.01 * 2**0.5)
    assert long["loop"][1]["half_width"] == pytest.approx(t * 0.01 * 2**0.5)  # one bin


def test_bins_know_how_many_their_noise_lasts():
    """Noise of 8 windows in bins of 6 and of 50 windows."""
    short = [current_ramp([history(RAMP, 0.2, seed=n, noise=0.05, windows=240)], RAMP, GAP) for n in range(20)]
    middle = [one.bins[10].correlated for one in short if np.isfinite(one.bins[10].torque.error)]
    assert len(middle) >= 10 and 1.1 < np.mean(middle) < 1.6
    assert all(one.correlated == 1.0 for one in current_ramp([history(RAMP, 0.2, noise=0.05)], RAMP, GAP).bins)


def test_a_bin_that_a_branch_covers_in_part_is_not_compared():
    """Down to 0.37 A, the bin from 0.3 to 0.4 A has another mean current falling than rising."""
    course = TimeProfile((0.0, 0.1, 0.2), (0.0, 2.0, 0.37))
    found = current_ramp([history(course, 0.2)], course, GAP).summary()
    assert [one["share"] for one in found["loop"]] == [0.5, 0.8]  # 20 % is between 0.35 and 0.45 A
    assert found["loop"][0]["width"] == pytest.approx(0.21, abs=2e-3)


@pytest.mark.parametrize(("end", "settled"), [(0.23, True), (0.204, False)])
def test_torque_without_current_is_without_the_decay_where_it_is_held_long_enough(end, settled):
    """A strain of 1 takes 1 ms; the decay, of 0.5 ms, is over after one of 5, which is left out."""
    one = history(RAMP, end)
    off = one[TIME] > 0.2
    one.loc[off, TORQUE_DISC] += np.exp(-(one.loc[off, TIME] - 0.2) / 0.5e-3)
    found = current_ramp([one], RAMP, GAP).summary()
    assert (found["residual"]["torque"] == pytest.approx(LEFT, rel=2e-3)) == settled
    assert any("decay after the ramp included" in line for line in in_words(found)) != settled
