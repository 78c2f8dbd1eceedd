"""Eight numbers side by side: each lane is what numpy says, and tables keep what is not written."""

import inspect

import numpy as np
import pytest
from numba import njit

from geometry.kernel_stamp import kernel_stamp
from geometry.lane_tables import columns, eight_of, put_columns
from geometry.lanes import LANES, lanes_of, largest_lane, root, where

ROWS = np.array([5, 0, 9, 2, 7, 1, 8, 3], dtype=np.int32)


@njit
def _computed(table, picked, plain):
    rows = eight_of(picked, 0, 0)
    a, b, c, d = columns(table, rows, 0)
    put_columns(table, rows, 4, a + b * c, plain - a / d, root(c) * plain, 2.0 + a - (b + plain))
    put_columns(
        table, rows, 8, where(a < b, c, d), where(a >= plain, a, 0.0), where(b > c, 1.0, d), where(plain <= c, b, a)
    )
    return largest_lane(a)


def test_every_lane_is_what_numpy_says():
    table = np.random.default_rng(0).uniform(0.1, 2.0, (10, 13))
    before, x = table.copy(), 0.7
    a, b, c, d = before[ROWS, :4].T
    assert _computed(table, ROWS.reshape(1, 1, LANES), x) == a.max()
    made = [a + b * c, x - a / d, np.sqrt(c) * x, 2.0 + a - (b + x)]
    made += [np.where(a < b, c, d), np.where(a >= x, a, 0.0), np.where(b > c, 1.0, d), np.where(x <= c, b, a)]
    assert table[ROWS, 4:12] == pytest.approx(np.array(made).T, rel=1e-15)
    others = np.setdiff1d(np.arange(len(table)), ROWS)
    assert np.array_equal(table[others], before[others])
    assert np.array_equal(table[:, :4], before[:, :4]) and np.array_equal(table[:, 12], before[:, 12])


def test_plain_numbers_pass_as_well():
    @njit
    def kernel(x, y):
        return where(x < y, root(x), y), largest_lane(lanes_of(x))

    assert kernel(4.0, 5.0) == (2.0, 4.0)
    assert kernel(4.0, 3.0) == (3.0, 4.0)


def test_what_is_not_a_number_takes_the_other_side():
    @njit
    def kernel(x):
        return largest_lane(where(lanes_of(x) > 0.0, 1.0, 2.0))

    assert kernel(np.nan) == 2.0


def test_a_kernels_stamp_follows_the_code_of_its_lanes(monkeypatch):
    def kernel(x):
        return largest_lane(lanes_of(x))

    kernel.__module__ = "particles.of_a_test"
    before = kernel_stamp(kernel)
    assert kernel_stamp(kernel) == before
    monkeypatch.setattr(inspect, "getsource", lambda module: f"another {module.__name__}")
    assert kernel_stamp(kernel) != before
