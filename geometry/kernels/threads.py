"""Waiting of the threads of compiled loops: they spin for half a millisecond, then sleep.

A call of the step is one parallel loop, whose threads wait for one another by themselves (`particles.dem.step_kernel`);
rigid contacts and lists have many short ones. Measured with two loops a step of 1 000 grains, on two idle cores of a
virtual machine: 2.7 million particle steps a second with threads that sleep at each, 5.0 with one thread, 8 to 10 with
two that spin. Threads that spin while another program has their core hold up the others instead (1.8 where one thread
does 4.9, less the longer they spin). So they spin, but not for long, and a run finds out how many threads pay
(`emclutch.simulation.threads`).

The count is read once, when the OpenMP library is loaded (by numba's first parallel loop, or by gmsh): it stands here,
in the package that all others import, and nothing heavy is imported for it. What the user has set wins:
``OMP_WAIT_POLICY=passive`` with a number of threads of one's own on a machine that is shared.
"""

from __future__ import annotations

import os

SPIN = 10_000  # turns of a waiting loop before a thread sleeps: about 0.5 ms

if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", str(SPIN))


def requested_threads() -> int | None:
    """Value of ``OMP_NUM_THREADS``; None where it is not set to a number."""
    setting = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()  # a list has one number a nesting level
    return int(setting) if setting.isdigit() and int(setting) > 0 else None


def default_threads(available: int) -> int:
    """Threads of the compiled loops by default: ``OMP_NUM_THREADS`` if it is set, else all.

    Parameters
    ----------
    available : int
        Cores that this process may use, the largest number.
    """
    return min(available, requested_threads() or available)
