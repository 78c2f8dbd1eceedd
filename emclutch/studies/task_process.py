"""A task in a child process of a worker: calls come on standard input, and end with it.

The child is kept for the next task of the worker, as most of a short task's time is that of importing; it ends with the
worker, however that ends, for then its input does. The worker itself imports nothing of a task, and so answers its
scheduler whatever the task does.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
TRIES = 3
"""Times that a call is begun whose child dies: the next child continues, unless the call kills each of them."""


class TaskProcessEnded(RuntimeError):
    """The process of a task ended without a result."""


class Children:
    """Child processes of this one; a list's pop, append and remove are one step each: threads share them."""

    def __init__(self) -> None:
        self._idle: list[subprocess.Popen[bytes]] = []
        self._busy: list[subprocess.Popen[bytes]] = []
        self._has_ended = False
        self._writing = threading.Lock()

    def perform(self, call: bytes) -> bytes:
        """Run a call in a child process, see `perform_call`."""
        for tried in range(1, TRIES + 1):
            try:
                return self._performed(call)
            except TaskProcessEnded:
                if tried == TRIES or self._has_ended:
                    raise
        raise AssertionError("it is tried at least once")

    def interrupt(self) -> None:
        """Interrupt what the children do, as Ctrl-C does: a run ends with its window, a compilation with its pass."""
        for child in [*self._busy]:
            with suppress(OSError, ValueError):  # it has just ended
                self._send(child, None)

    def _send(self, child: subprocess.Popen[bytes], call: bytes | None) -> None:
        assert child.stdin is not None
        with self._writing:
            pickle.dump(call, child.stdin)
            child.stdin.flush()

    def end(self) -> None:
        """End all children; what they do is lost but for checkpoints."""
        self._has_ended = True
        for child in [*self._busy]:
            child.kill()
        while self._idle:
            _discarded(self._idle.pop())

    def _performed(self, call: bytes) -> bytes:
        try:
            child = self._idle.pop()
        except IndexError:
            child = _new_child()
        if child.poll() is not None:  # it died while it had nothing to do
            _discarded(child)
            child = _new_child()
        self._busy.append(child)
        if self._has_ended:
            child.kill()
        try:
            assert child.stdout is not None
            self._send(child, call)
            answer: bytes = pickle.load(child.stdout)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            code = _discarded(child)
            raise TaskProcessEnded(
                f"its process ended without a message ({f'signal {-code}' if code < 0 else f'code {code}'}); it was "
                "killed, most often for lack of memory"
            ) from None
        except BaseException:  # the worker's thread was stopped: nobody waits for this child any more
            _discarded(child)
            raise
        finally:
            self._busy.remove(child)
        self._idle.append(child)
        return answer


class ChildProcesses(ThreadPoolExecutor):
    """Executor that runs `perform_call`, so many at a time, in children of its own."""

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs, thread_name_prefix="task")
        self.children = Children()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """See `concurrent.futures.Executor.submit`."""
        return super().submit(self.children.perform if fn is perform_call else fn, *args, **kwargs)


_children = Children()
"""Those of a worker of any other executor."""


def perform_call(call: bytes) -> bytes:
    """Run a call in a child process; where that dies, in another one, `TRIES` times at most.

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
        The children died.
    """
    return _children.perform(call)


def _discarded(child: subprocess.Popen[bytes]) -> int:
    """End a child, and return its code."""
    child.kill()
    for pipe in (child.stdin, child.stdout):
        assert pipe is not None
        with suppress(OSError):  # a call that was not read
            pipe.close()
    return child.wait()


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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a run has a handler of its own
    calls: SimpleQueue[bytes] = SimpleQueue()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a task prints is no answer
    source, main_thread = sys.stdin.buffer, threading.get_ident()

    def read() -> None:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                if (call := pickle.load(source)) is None:
                    signal.pthread_kill(main_thread, signal.SIGINT)
                else:
                    calls.put(call)
        os._exit(1)  # the worker is gone: whatever runs continues elsewhere, from its checkpoint

    # The thread only reads; calls are imported and run by the main thread, which alone may handle signals.
    threading.Thread(target=read, name="calls", daemon=True).start()
    while True:
        found = answer(calls.get())
        with suppress(BrokenPipeError):
            pickle.dump(found, answers)
            answers.flush()


def answer(call: bytes) -> bytes:
    """Run a call in this process, and return the pickled result or error."""
    try:
        fn, args, kwargs = pickle.loads(call)
        return pickle.dumps((True, fn(*args, **kwargs)))
    except BaseException as error:
        with suppress(Exception):
            return pickle.dumps((False, error))
        return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))


if __name__ == "__main__":
    main()
