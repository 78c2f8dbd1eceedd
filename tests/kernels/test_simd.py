"""Eight numbers side by side: each lane is what numpy says, and tables keep what is not written."""

import inspect

import numpy as np
import pytest
from numba import njit

from geometry.kernels.simd import LANES, llvm_sqrt, reduce_max, select, splat
from geometry.kernels.simd_tables import gather_columns, load, scatter_columns
from geometry.kernels.stamp import kernel_stamp

ROWS = np.array([5, 0, 9, 2, 7, 1, 8, 3], dtype=np.int32)


@njit
def _computed(table, picked, plain):
    rows = load(picked, 0, 0)
    a, b, c, d = gather_columns(table, rows, 0)
    scatter_columns(table, rows, 4, a + b * c, plain - a / d, llvm_sqrt(c) * plain, 2.0 + a - (b + plain))
    scatter_columns(
        table, rows, 8, select(a < b, c, d), select(a >= plain, a, 0.0), select(b > c, 1.0, d), select(plain <= c, b, a)
    )
    return reduce_max(a)


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
        return select(x < y, llvm_sqrt(x), y), reduce_max(splat(x))

    assert kernel(4.0, 5.0) == (2.0, 4.0)
    assert kernel(4.0, 3.0) == (3.0, 4.0)


def test_what_is_not_a_number_takes_the_other_side():
    @njit
    def kernel(x):
        return reduce_max(select(splat(x) > 0.0, 1.0, 2.0))

    assert kernel(np.nan) == 2.0


def test_a_kernels_stamp_follows_the_code_of_its_lanes(monkeypatch):
    def kernel(x):
        return reduce_max(splat(x))

    kernel.__module__ = "particles.of_a_test"
    before = kernel_stamp(kernel)
    assert kernel_stamp(kernel) == before
    monkeypatch.setattr(inspect, "getsource", lambda module: f"another {module.__name__}")
    assert kernel_stamp(kernel) != before
