"""Number of threads among which a compiled loop over points is shared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba

# Starting a parallel loop costs some microseconds, a point 40 to 80 ns.
WORTH_SHARING = 2000  # points


@contextmanager
def limit_threads(threads: int | None, count: int) -> Iterator[None]:
    """Set numba's threads for the block: one where there are few points.

    Parameters
    ----------
    threads : int or None
        None: as many as numba is set to.
    count : int
        Number of points.

    Raises
    ------
    ValueError
        More threads than numba was started with, or fewer than one.
    """
    available: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    before = numba.get_num_threads()
    requested = before if threads is None else threads
    if not 1 <= requested <= available:
        raise ValueError(f"`threads` = {threads}: allowed are 1 to {available} (NUMBA_NUM_THREADS)")
    number = requested if count >= WORTH_SHARING else 1
    if number == before:
        yield
        return
    numba.set_num_threads(number)
    try:
        yield
    finally:
        numba.set_num_threads(before)
