"""How threads of compiled loops wait for one another: asleep, not spinning.

GNU OpenMP's threads spin at a barrier for milliseconds by default. A step of the grains has two barriers and takes some
hundred microseconds, so that with one core taken by another program two spinning threads were 2.8 times *slower* than
one, and a test run with two workers took 2.8 times as long. Passive waiting costs a sixth where the machine is idle.

The policy is read once, when the OpenMP library is loaded (by numba's first parallel loop, or by gmsh): it stands here,
in the package that all others import, and nothing heavy is imported for it. What the user has set wins:
``OMP_WAIT_POLICY=active`` on a machine of one's own.
"""

from __future__ import annotations

import os

if "GOMP_SPINCOUNT" not in os.environ:  # the user's own way to say the same
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def default_threads(available: int) -> int:
    """Threads of the compiled loops where none are asked for: ``OMP_NUM_THREADS`` if it is set, else all.

    Parameters
    ----------
    available : int
        Cores that this process may use; no more are taken.
    """
    asked = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()  # a list has one number a nesting level
    return max(1, min(available, int(asked))) if asked.isdigit() and int(asked) > 0 else available
