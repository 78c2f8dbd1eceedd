"""Executor of `emclutch.sweep` on the workers of a dask scheduler, of the extra ``dask``.

A point whose worker dies, or loses touch with the scheduler, is run by another worker, at most
``distributed.scheduler.allowed-failures`` (3) times. So a point may be begun twice: the second takes it over from the
first (`emclutch.studies.attempt`).
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from emclutch.scene.errors import Fault, SceneError

MEMORY = "memory"
"""Resource of a worker that offers it, in bytes: ``dask worker --resources memory=64e9``."""


@contextmanager
def dask_executor(address: str, memory: float = 0.0, timeout: float = 10.0) -> Iterator[Executor]:
    """Yield an executor on the workers of a scheduler.

    Parameters
    ----------
    address : of the scheduler, e.g. ``"tcp://node1:8786"``.
    memory : that each task needs [bytes]; where workers offer the resource `MEMORY`, they run as many as fit.
    timeout : for the scheduler to answer [s].

    Raises
    ------
    SceneError
        The extra is not installed, no scheduler answers, or no worker offers so much memory.
    """
    try:
        from distributed import Client
    except ImportError as error:
        message = f"needs the package distributed ({error}): pip install 'emclutch[dask]', or take --jobs or --list"
        raise _fault(address, message) from None
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        message = f"no scheduler answers ({error or type(error).__name__}); start one with: dask scheduler"
        raise _fault(address, message) from None
    try:
        workers = client.scheduler_info()["workers"].values()
        offered = [one["resources"][MEMORY] for one in workers if MEMORY in one.get("resources", {})]
        if offered and memory > max(offered):
            message = (
                f"has workers that offer at most {max(offered) / 1e9:.3g} GB of the resource {MEMORY}, and a point "
                f"needs {memory / 1e9:.3g} GB; start a worker with more: dask worker --resources {MEMORY}=..."
            )
            raise _fault(address, message)
        yield client.get_executor(pure=False, resources={MEMORY: memory} if offered else None)
    finally:
        client.close(timeout=5.0)


def _fault(address: str, message: str) -> SceneError:
    return SceneError([Fault("--dask", address, message)], "command line")
