"""Lanes from tables and back: what eight rows hold is what numpy's indices find."""

import math

import numpy as np
import pytest
from numba import njit

from geometry.kernels.simd import (
    LANES,
    any_lane,
    from_integers,
    mask_of_first,
    maximum,
    movemask,
    reduce_add,
    select,
    splat,
    to_integers,
    to_tuple,
)
from geometry.kernels.simd_math import log, sqrt
from geometry.kernels.simd_tables import (
    gather,
    gather_column,
    gather_columns,
    gather_two_columns,
    load,
    movemask_at_least,
    scatter_add,
    scatter_column,
    scatter_columns,
    scatter_two_columns,
    stack_table,
    store,
)

ROWS = np.array([[5, 0, 9, 2, 7, 1, 8, 3]], dtype=np.int32)


@pytest.fixture
def table():
    return np.random.default_rng(2).uniform(-3.0, 3.0, (10, 12))


def test_columns_and_entries(table):
    @njit
    def kernel(table, picked, real, whole, out):
        rows = load(picked, 0, 0)
        a, b = gather_two_columns(table, rows, 5)
        c = gather_column(table, rows, 11)
        d, e = gather_two_columns(table, rows, gather(whole, rows))
        f, g = gather(real, rows), from_integers(gather(whole, rows))
        every = load(picked, 0, 0)
        scatter_two_columns(out, every, 0, a, b)
        scatter_two_columns(out, every, 2, c, d)
        scatter_two_columns(out, every, 4, e, f)
        scatter_column(out, every, 6, g)

    real, whole, out = np.arange(10) * 0.5, (np.arange(10, dtype=np.uint32) * 7) % 10, np.zeros((10, 7))
    kernel(table, ROWS, real, whole, out)
    r = ROWS[0]
    wanted = [table[r, 5], table[r, 6], table[r, 11], table[r, whole[r]], table[r, whole[r] + 1], real[r], whole[r]]
    assert np.array_equal(out[r].T, wanted)
    assert not out[[4, 6]].any()


def test_blocks_of_eight_neighbours(table):
    @njit
    def kernel(flat, blocks, grains):
        store(blocks, 1, 2, load(flat, 3, 4) + from_integers(load(grains, 1, 2)))
        store(flat, 0, 1, load(blocks, 1, 2) + 1.0)

    flat, blocks, grains = table.copy(), np.zeros((2, 3, 8)), np.arange(48, dtype=np.int32).reshape(2, 3, 8)
    kernel(flat, blocks, grains)
    wanted = table[3, 4:12] + grains[1, 2]
    assert np.array_equal(blocks[1, 2], wanted)
    assert np.array_equal(flat[0, 1:9], wanted + 1.0)
    assert not blocks[0].any() and not blocks[1, :2].any()


@pytest.mark.parametrize("many", [4, 6])
def test_rows_that_are_the_same_are_added_to_one_after_the_other(many):
    @njit
    def kernel(target, other, numbers, added):
        rows, places = load(numbers, 0, 0), load(numbers, 1, 0)
        a, b, c, d = gather_columns(added, load(numbers, 2, 0), 0)
        e, f = gather_two_columns(added, load(numbers, 2, 0), 4)
        if many == 4:
            scatter_add(target, rows, 1, other, places, (a, b, c, d))
            scatter_add(target, rows, 1, None, None, (a, b, c, d))
        else:
            scatter_add(target, rows, 1, other, places, (a, b, c, d, e, f))
            scatter_add(target, rows, 1, None, None, (a, b, c, d, e, f))

    numbers = np.array([[2, 2, 2, 0, 1, 1, 2, 0], [-1, 1, -1, 0, -1, 1, -1, -1], np.arange(8)], dtype=np.int32)
    added = np.random.default_rng(0).normal(size=(8, 6))
    target, other = np.zeros((3, 8)), np.zeros((2, 6))
    kernel(target, other, numbers, added)
    wanted, beside = np.zeros((3, 8)), np.zeros((2, 6))
    for both, only in ((True, False), (False, True)):
        for q in range(LANES):
            row, place = numbers[:2, q]
            if both and place >= 0:
                beside[place, :many] += added[q, :many]
            elif both or only:
                wanted[row, 1 : 1 + many] += added[q, :many]
    assert np.array_equal(target, wanted) and np.array_equal(other, beside)


def test_rows_of_lanes_hold_what_is_put_there_and_numbers_become_lanes(table):
    @njit
    def kernel(table, picked, choice, out):
        rows = load(picked, 0, 0)
        kept, x = stack_table(3), 1.5
        kept[0, 0], kept[0, 1], kept[0, 2], _ = gather_columns(table, rows, 0)
        if choice:  # a number on one way, lanes on the other
            x = kept[7, 1]
        kept[0, choice] = kept[0, 0] * x
        scatter_columns(out, rows, 0, kept[0, 0], kept[0, 1], kept[0, 2], splat(0.0))

    r = ROWS[0]
    for choice in (0, 1):
        out, wanted = np.zeros((10, 4)), np.zeros((10, 4))
        kernel(table, ROWS, choice, out)
        wanted[r, :3] = table[r, :3]
        wanted[r, choice] = table[r, 0] * (table[r, 1] if choice else 1.5)
        assert np.array_equal(out, wanted)


def test_functions_of_lanes_are_those_of_numbers(table):
    @njit(error_model="numpy")
    def kernel(table, picked, out):
        rows = load(picked, 0, 0)
        a, b, _, _ = gather_columns(table, rows, 0)
        scatter_columns(out, rows, 0, maximum(a, b), abs(a), sqrt(abs(a)), log(abs(b)))
        scatter_columns(out, rows, 8, abs(a), max(a, 0.25), np.sqrt(a * a), math.sqrt(a**2))
        scatter_columns(out, rows, 12, a**3, a**0 * 2.0 / a, a**-2, b * 2.0)
        scatter_columns(
            out, rows, 4, from_integers(to_integers(a)), select(mask_of_first(3), a, b), -a, maximum(a, 0.25)
        )
        truths = any_lane(a > -9.0), any_lane(a > 9.0), any_lane(to_tuple(a)[0] > -9.0)
        return reduce_add(a), movemask(a > b), to_tuple(a), truths

    out, r = np.zeros((10, 16)), ROWS[0]
    total, bits, numbers, truths = kernel(table, ROWS, out)
    assert truths == (True, False, True)
    a, b = table[r, 0], table[r, 1]
    wanted = [
        np.maximum(a, b), abs(a), np.sqrt(abs(a)), np.log(abs(b)),
        np.trunc(a), np.where(np.arange(8) < 3, a, b), -a, np.maximum(a, 0.25),
        abs(a), np.maximum(a, 0.25), abs(a), abs(a), a**3, 2.0 / a, a**-2.0, 2.0 * b,
    ]  # fmt: skip
    np.testing.assert_allclose(out[r].T, wanted, rtol=1e-15)
    assert total == pytest.approx(a.sum(), rel=1e-14) and np.array_equal(numbers, a)
    assert bits == sum(1 << q for q in range(LANES) if a[q] > b[q])


def test_what_is_not_a_number_is_not_lost_in_the_larger():
    @njit
    def kernel(x):
        return to_tuple(maximum(splat(x), 0.0))[3], maximum(x, 0.0)

    assert np.isnan(kernel(np.nan)).all()


@pytest.mark.parametrize("kind", [np.uint8, np.uint32])
def test_bounds_of_neighbours_as_bits(kind):
    @njit
    def kernel(array, first, bound):
        return movemask_at_least(array, first, bound)

    array = np.random.default_rng(1).integers(0, 200, 40).astype(kind)
    for first in (0, 3, 32):
        for bound in (0, 1, 100, 199):
            wanted = sum(1 << q for q in range(LANES) if array[first + q] >= bound)
            assert kernel(array, first, bound) == wanted
