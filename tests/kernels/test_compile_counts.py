"""Counts of what a kernel is compiled from, of a kernel that can be counted by hand."""

import numpy as np
from compile_counts import count_in_code, counts
from numba import njit

from geometry.kernels.device_functions import device_function


def test_code_is_counted():
    code = """
define i32 @"f"(double* %".1", {i8*, i64} %".2")
{
  %".4" = call i32 @"g(x, y)"(double* %".1", i64 2, [2 x i64] %".3")
  call void @"nothing"()
}
"""
    assert count_in_code(code) == {"functions": 1, "scalars": 3, "lines": 5}


def test_functions_that_are_linked_are_counted_once_and_arrays_hand_over_more_scalars():
    @device_function()
    def cubed(x):
        return x * x * x

    @device_function()
    def first(x):
        return x[0]

    @njit
    def once(x):
        return cubed(x)

    @njit
    def twice(x):
        return cubed(x) + cubed(1.0 + x)

    @njit
    def of_array(x):
        return cubed(first(x))

    once(1.0), twice(1.0), of_array(np.ones(2))
    one, two, three = (counts(one.overloads[one.signatures[0]].library) for one in (once, twice, of_array))
    assert two["functions"] == one["functions"] and two["scalars"] > one["scalars"]
    assert three["functions"] == one["functions"] + 1 and three["scalars"] >= one["scalars"] + 6


def test_code_from_the_cache_has_no_counts():
    class Library:
        pass

    assert counts(Library()) is None
