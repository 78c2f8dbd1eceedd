"""Speed of this machine relative to the reference one, from one short probe in NumPy: nothing is compiled for it."""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

REFERENCE_S = 6e-3  # processor time of the probe on the reference machine, one core of an AMD EPYC (x86-64, 2026)
PAIRS, GRAINS, REPEATS = 20_000, 2_500, 10


@lru_cache(maxsize=1)
def slowness() -> float:
    """Return the processor time of this machine over that of the reference machine, for the same work.

    Measured once in a process, in some 50 ms; the least of some repetitions counts, so that what disturbs one of them
    does not.
    """
    rng = np.random.default_rng(0)
    x = rng.random((GRAINS, 3))
    i, j = rng.integers(0, GRAINS, (2, PAIRS))
    least = np.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        forces_of_pairs(x, i, j)
        least = min(least, time.process_time() - begin)
    return max(least, 1e-6) / REFERENCE_S


def forces_of_pairs(x: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return the sum of 1/r^3 over a list of pairs (i, j) of points x (n, 3), on each point: what a run's loops do."""
    total = np.zeros(len(x))
    for _ in range(10):
        along = x[i] - x[j]
        r = np.sqrt(np.einsum("ij,ij->i", along, along)) + 1e-3
        total += np.bincount(i, 1.0 / (r * r * r), len(x))
    return total
