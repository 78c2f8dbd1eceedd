"""Number of threads of a compiled step, and the threading layer.

OpenMP first: a parallel loop costs about a microsecond; tbb was slower than a single thread on rows of this size. Below
a few hundred grains one thread is faster still. The result is the same, bit for bit, with any number.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba

WORTH_SHARING = 500  # grains


@contextmanager
def threads_for(count: int) -> Iterator[None]:
    """One thread inside, when there are too few grains to share."""
    with at_most(numba.get_num_threads() if count >= WORTH_SHARING else 1):
        yield


@contextmanager
def at_most(threads: int) -> Iterator[None]:
    """No more than ``threads`` threads inside."""
    before = numba.get_num_threads()
    if before <= threads:
        yield
        return
    numba.set_num_threads(threads)
    try:
        yield
    finally:
        numba.set_num_threads(before)
