"""Torque of a ramp of the current: bins give back the law of either branch, bands hold it as often as said."""

import numpy as np
import pandas as pd
import pytest

from emclutch.results.columns import DISC_SPEED, ROTOR_SPEED, TIME, TORQUE_DISC
from emclutch.results.current_ramp import FALLING, HELD, RISING, Branch, branches, current_ramp, in_words
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
    middle = time - 0.5 * time[0]
    current, rising = currents.at(middle), middle < 0.1
    torque = np.where(rising, current**2, (np.abs(current) + 0.1) ** 2)
    torque[middle > 0.2] = LEFT
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
    assert len(in_words(found)) == 6 and "rising 1.004 N m" in in_words(found)[1]


@pytest.mark.parametrize("packings", [1, 4])
def test_bands_hold_the_torque_as_often_as_said(packings):
    """95 %: of 40 bins of 30 runs, less than 10 % and more than 1 % lie outside of their band."""
    outside = []
    for run in range(30):
        runs = [history(RAMP, 0.2, seed=packings * run + n, noise=0.05, spread=0.02 * (packings > 1))
                for n in range(packings)]  # fmt: skip
        exact = current_ramp([history(RAMP, 0.2)], RAMP, GAP).table()["torque"]
        table = current_ramp(runs, RAMP, GAP).table()
        outside.append(((table["low"] > exact) | (table["high"] < exact)).mean())
    assert 0.01 < np.mean(outside) < 0.1, outside


def test_the_difference_is_taken_packing_by_packing():
    """Packings that differ by 10 % in both branches alike have a difference known much better than either."""
    found = current_ramp([history(RAMP, 0.2, seed=n, spread=0.1) for n in range(4)], RAMP, GAP)
    middle = next(one for one in found.bins if one.kind == RISING and one.low >= 1.0)
    loop = found.summary()["loop"][1]
    assert loop["half_width"] < 0.3 * middle.half_width and loop["half_width"] < 0.3 * loop["width"]


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
