"""Functions that only kernels call have no machine code, and kernels that took them in do what they say."""

import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, prange
from numba.core.errors import NumbaError

from geometry.kernels.cache import ROOT
from geometry.kernels.device_functions import device_function, njit_without_refcounts

PROGRAM = """
import numpy as np
from numba import njit, prange
from numba.core.codegen import JITCPUCodegen
from geometry.kernels.device_functions import device_function

with_code = []
add = JITCPUCodegen._add_module

def counted(self, module):
    with_code.append(any(not function.is_declaration for function in module.functions))
    add(self, module)

JITCPUCodegen._add_module = counted
def of(decorate):
    with_code.clear()

    @decorate()
    def cubed(x):
        return x * x * x

    @decorate()
    def sixth(x):
        return cubed(x) * cubed(x)

    @njit
    def kernel(x):
        return sixth(x) + cubed(x)

    assert kernel(2.0) == 72.0
    return sum(with_code)

def of_loop():
    with_code.clear()

    @njit(parallel=True)
    def kernel(x):
        for i in prange(x.shape[0]):
            x[i] = x[i] * x[i]

    x = np.arange(3.0)
    kernel(x)
    assert x.tolist() == [0.0, 1.0, 4.0]
    return sum(with_code)

of(njit), of_loop()  # numba's own are compiled once
print(of(device_function), of(njit), of_loop())
"""


def test_only_the_kernel_becomes_machine_code():
    """Neither do the functions that it calls nor the body of its loop, with numba's wrappers of one."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, cwd=ROOT, check=True)
    inner_ones, all_of_them, of_a_loop = map(int, done.stdout.split())
    assert inner_ones == all_of_them - 2
    assert of_a_loop == 1


def test_an_error_raised_inside_reaches_python():
    @device_function()
    def checked(x):
        if x < 0.0:
            raise ValueError("below zero", x)
        return x**0.5

    @device_function()
    def deeper(x):
        return 2.0 * checked(x)

    @njit
    def kernel(x):
        return deeper(x)

    assert kernel(9.0) == 6.0
    with pytest.raises(ValueError, match="below zero") as caught:
        kernel(-1.0)
    assert caught.value.args == ("below zero", -1.0)


def test_in_a_parallel_loop_and_for_two_types():
    @device_function()
    def doubled(x):
        return x + x

    @njit(parallel=True)
    def kernel(x):
        total = 0.0
        for i in prange(10):
            total += doubled(x) + doubled(i)
        return total

    assert kernel(1.5) == 120.0


class Arrays(NamedTuple):
    first: np.ndarray
    second: np.ndarray


def test_who_borrows_leaves_the_count_of_references_as_it_was():
    @njit_without_refcounts()
    def product(arrays):
        total, first = 0.0, arrays.first
        for i in range(first.shape[0]):
            total += first[i] * arrays.second[i]
        return total

    @njit
    def kernel(arrays):
        return product(arrays) + product(Arrays(arrays.second, arrays.second))

    arrays = Arrays(np.arange(3.0), np.ones(3))
    before = [sys.getrefcount(array) for array in arrays]
    assert (product(arrays), kernel(arrays)) == (3.0, 6.0)
    assert [sys.getrefcount(array) for array in arrays] == before


def test_who_borrows_can_allocate_nothing():
    @njit_without_refcounts()
    def sums(n):
        return np.zeros(n).sum()

    with pytest.raises(NumbaError, match="returning of array"):
        sums(3)
