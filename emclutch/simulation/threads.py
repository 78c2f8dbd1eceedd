"""Number of threads of the compiled kernels, and the threading layer."""

from __future__ import annotations

from geometry.kernels.threads import default_threads, requested_threads


def use_threads(threads: int | None, replicas: int = 1) -> int:
    """Set the number of threads of the compiled kernels, and return it; None: all, shared out among the replicas.

    ValueError outside 1 .. the machine's cores.
    """
    import numba

    available: int = getattr(numba.config, "NUMBA_NUM_THREADS")  # noqa: B009 (numba's stubs hide it)
    if threads is not None and not 1 <= threads <= available:
        raise ValueError(f"threads = {threads}; allowed: 1 to {available}, the cores of this machine")
    chosen = threads or max(1, default_threads(available) // replicas)
    numba.set_num_threads(chosen)
    return chosen


def may_tune_threads(threads: int | None) -> bool:
    """True if neither the caller nor ``OMP_NUM_THREADS`` says how many, so that a run may find out what pays."""
    return threads is None and requested_threads() is None


def threads_in_use() -> int:
    import numba

    return numba.get_num_threads()


def threading_layer() -> str:
    """The layer that numba will use or uses, e.g. "omp"."""
    import numba

    try:
        return numba.threading_layer()
    except ValueError:  # no parallel kernel has run yet: the first choice that this machine can load
        return str(getattr(numba.config, "THREADING_LAYER_PRIORITY")[0])  # noqa: B009
