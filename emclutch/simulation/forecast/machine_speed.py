"""Speed of this machine relative to the reference one, from short probes in NumPy: nothing is compiled for it."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from functools import lru_cache

import numpy as np

from emclutch.results.atomic_file import replace_json
from emclutch.results.provenance import cpu_model
from field.spheres.table_files import cache_folder

REFERENCE_S = 6e-3  # processor time of the probe on the reference machine, one core of an AMD EPYC (x86-64, 2026)
PAIRS, GRAINS, REPEATS = 20_000, 2_500, 10
FASTER = 0.97  # a probe replaces the kept one below this part of it, so that the times printed rarely change


@lru_cache(maxsize=1)
def slowness() -> float:
    """Return the processor time of this machine over that of the reference machine, for the same work.

    The least of all probes on this processor counts, so that a busy moment does not raise it. It is kept in
    `machine_speed.json` of the cache folder; where that cannot be read or written, the probe of this process counts.
    """
    found, path, known = _probe(), cache_folder() / "machine_speed.json", {}
    machine = f"{cpu_model()}, numpy {np.__version__}"
    with suppress(OSError, ValueError, TypeError, AttributeError):
        known = dict(json.loads(path.read_text(encoding="utf-8")))
        if 0.0 < FASTER * float(known.get(machine, 0.0)) <= found:
            return float(known[machine]) / REFERENCE_S
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_json(path, known | {machine: found})
    return found / REFERENCE_S


def _probe() -> float:
    """Return the processor time of some 5 ms of work [s], the least of `REPEATS`."""
    rng = np.random.default_rng(0)
    x = rng.random((GRAINS, 3))
    i, j = rng.integers(0, GRAINS, (2, PAIRS))
    least = np.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        forces_of_pairs(x, i, j)
        least = min(least, time.process_time() - begin)
    return max(least, 1e-6)


def forces_of_pairs(x: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return the sum of 1/r^3 over a list of pairs (i, j) of points x (n, 3), on each point: what a run's loops do."""
    total = np.zeros(len(x))
    for _ in range(10):
        along = x[i] - x[j]
        r = np.sqrt(np.einsum("ij,ij->i", along, along)) + 1e-3
        total += np.bincount(i, 1.0 / (r * r * r), len(x))
    return total
