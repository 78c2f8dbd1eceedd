"""A task in a child process of a worker: calls come on standard input, and end with it.

The child is kept for the next task of the worker, as most of a short task's time is that of importing; it ends with the
worker, however that ends, for then its input does. A child that dies takes its task with it: `TaskProcessEnded`.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_idle: list[subprocess.Popen[bytes]] = []
"""Children of this process that have no task. A list's pop and append are one step each: worker threads share it."""


class TaskProcessEnded(RuntimeError):
    """The process of a task ended without a result."""


def perform(call: bytes) -> bytes:
    """Run a call in a child process. The worker reads neither the call nor its answer, and imports nothing for them.

    Parameters
    ----------
    call : `call_of` a function and its arguments.

    Returns
    -------
    bytes
        Its answer, see `result_of`: what it returned or raised.

    Raises
    ------
    TaskProcessEnded
        The child died.
    """
    try:
        child = _idle.pop()
    except IndexError:
        child = _new_child()
    try:
        if child.poll() is not None:  # it died while it had nothing to do
            child = _new_child()
        assert child.stdin is not None and child.stdout is not None
        pickle.dump(call, child.stdin)
        child.stdin.flush()
        answer: bytes = pickle.load(child.stdout)
    except (EOFError, BrokenPipeError, pickle.UnpicklingError):
        child.kill()
        code = child.wait()
        raise TaskProcessEnded(
            f"its process ended without a message ({f'signal {-code}' if code < 0 else f'code {code}'}); it was "
            "killed, most often for want of memory"
        ) from None
    except BaseException:  # the worker's thread was stopped: nobody waits for this child any more
        child.kill()
        child.wait()
        raise
    _idle.append(child)
    return answer


def call_of(fn: Callable[..., Any], *args: Any, **kwargs: Any) -> bytes:
    """Return a call as bytes. All of it must pickle, the function by its module, which the child imports."""
    return pickle.dumps((fn, args, kwargs))


def result_of(answer: bytes) -> Any:
    """Return what a call has returned, or raise what it has raised."""
    is_result, found = pickle.loads(answer)
    if is_result:
        return found
    raise found


def _new_child() -> subprocess.Popen[bytes]:
    # -P: as of `emclutch.simulation.kernel_warm_up`. A session of its own: a terminal's Ctrl-C is the worker's alone.
    path = os.pathsep.join(filter(None, [str(ROOT), *sys.path]))
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "emclutch.studies.task_process"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip


def main() -> None:
    """Entry point of the child."""
    calls: SimpleQueue[bytes] = SimpleQueue()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a task prints is no answer
    source = sys.stdin.buffer

    def read() -> None:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                calls.put(pickle.load(source))
        os._exit(1)  # the worker is gone: whatever runs continues elsewhere, from its checkpoint

    # The thread only reads; calls are imported and run by the main thread, which alone may handle signals.
    threading.Thread(target=read, name="calls", daemon=True).start()
    while True:
        answer = _answer(calls.get())
        with suppress(BrokenPipeError):
            pickle.dump(answer, answers)
            answers.flush()


def _answer(call: bytes) -> bytes:
    """The pickled result of a call, or its error."""
    try:
        fn, args, kwargs = pickle.loads(call)
        return pickle.dumps((True, fn(*args, **kwargs)))
    except BaseException as error:
        with suppress(Exception):
            return pickle.dumps((False, error))
        return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))


if __name__ == "__main__":
    main()
