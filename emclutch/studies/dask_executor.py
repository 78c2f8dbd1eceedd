"""Tasks on the workers of a dask scheduler: an executor for `emclutch.sweep`, of the extra ``dask``.

A worker runs each task in a child process (`emclutch.studies.task_process`) and waits for it without holding the
interpreter's lock, so that it answers the scheduler whatever the task does. A task whose worker dies, or loses touch
with the scheduler, is run by another worker, at most ``distributed.scheduler.allowed-failures`` (3) times; one whose
child dies alone is repeated `DaskExecutor.retries` times. So a task may be begun twice, and must find out itself
whether another process still does it: points of a study have leases (`emclutch.studies.tasks.run_leased_point`).
"""

from __future__ import annotations

import uuid
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from typing import Any

from emclutch.scene.errors import Fault, SceneError
from emclutch.studies.task_process import call_of, perform, result_of

MEMORY = "memory"
"""Resource of a worker that offers it, in bytes: ``dask worker --resources memory=64e9``."""


class SchedulerLost(BrokenExecutor):
    """The connection to the scheduler broke: what it ran is lost but for checkpoints."""

    def __init__(self, address: str) -> None:
        super().__init__(f"the connection to the scheduler {address} is lost")
        self.address = address


class DaskExecutor(Executor):
    """Executor that runs tasks on the workers of a dask scheduler.

    Parameters
    ----------
    address : of the scheduler, e.g. ``"tcp://node1:8786"``.
    retries : how often a task is repeated whose process ended without a result.
    timeout : for the scheduler to answer [s].

    Raises
    ------
    SceneError
        The extra is not installed, or no scheduler answers.
    """

    def __init__(self, address: str, *, retries: int = 3, timeout: float = 10.0) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            message = f"needs the package distributed ({error}): pip install 'emclutch[dask]', or take --jobs or --part"
            raise _fault(address, message) from None
        self.address, self.retries = address, retries
        try:
            self._client = Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            message = f"no scheduler answers ({error or type(error).__name__}); start one with: dask scheduler"
            raise _fault(address, message) from None
        self._running: dict[Future[Any], Any] = {}
        self._resources: dict[str, float] = {}

    @property
    def workers(self) -> int:
        """Number of workers that the scheduler has now."""
        return len(self._client.scheduler_info()["workers"])

    def ask_for(self, memory: float) -> None:
        """Ask for so much memory [bytes] with every task, as the resource `MEMORY`; nothing where no worker offers it.

        Raises
        ------
        SceneError
            No worker offers so much: the tasks would wait for ever.
        """
        workers = self._client.scheduler_info()["workers"].values()
        offered = [one["resources"][MEMORY] for one in workers if MEMORY in one.get("resources", {})]
        if offered and memory > max(offered):
            message = (
                f"has workers that offer at most {max(offered) / 1e9:.3g} GB of the resource {MEMORY}, and a point "
                f"needs {memory / 1e9:.3g} GB; start a worker with more: dask worker --resources {MEMORY}=..."
            )
            raise _fault(self.address, message)
        self._resources = {MEMORY: memory} if offered else {}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return the future of a call. It cannot be cancelled: what runs elsewhere must be asked to end."""
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        name = f"{getattr(fn, '__name__', 'task')}-{uuid.uuid4().hex}"
        remote = self._client.submit(
            perform, call_of(fn, *args, **kwargs), key=name, pure=False, retries=self.retries,
            resources=self._resources,
        )  # fmt: skip
        self._running[future] = remote  # a task whose future is forgotten is cancelled
        remote.add_done_callback(partial(self._pass_on, future))
        return future

    def _pass_on(self, future: Future[Any], remote: Any) -> None:
        self._running.pop(future, None)
        try:
            if remote.status == "cancelled":
                raise SchedulerLost(self.address)
            future.set_result(result_of(remote.result()))
        except BaseException as error:  # of a worker, perhaps no Exception: it is the future's
            future.set_exception(error)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take leave of the scheduler, which goes on without this client."""
        self._client.close(timeout=5.0)


def _fault(address: str, message: str) -> SceneError:
    return SceneError([Fault("--dask", address, message)], "command line")
