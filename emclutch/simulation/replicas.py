"""The other replicas of a run: processes of their own, each a whole run of the scene with another seed.

The run itself is the first replica. Each of the others is a process (`emclutch.simulation.replica_process`) with a
folder of its own under the run's. They form a pool: as many run at a time as there are cores for, the others start, or
continue, when one has come to the time that all are to reach (`Replicas.request`).

Standard input of a process is the bond between the two. Its first line is the task, each later one a time [s] to
continue to, or ``end``: it then writes its summary and is done. Where the input ends, because the run was stopped,
failed or was killed, the replica writes a checkpoint and ends too.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from emclutch.results import OutputError, RunFolder
from emclutch.results.columns import TIME
from emclutch.results.folder_lock import FolderInUse, has_files, locked_folder
from emclutch.results.history import last_time
from emclutch.scene.replica_count import replica_count, replica_seed
from geometry.kernels.cache import ROOT

if TYPE_CHECKING:
    import pandas

    from coupling import Simulation, WindowRow
    from emclutch.scene.case import Case

log = logging.getLogger(__name__)
POLL = 0.1  # s, between looks at the processes
TIMEOUT = 60.0  # s, for a replica of a killed run: it ends, with a checkpoint, after the window that it is in
END = "end"
"""Line that makes a replica write its summary and end."""


@dataclass(slots=True)
class ReplicaProcess:
    """One of the other replicas.

    Attributes
    ----------
    folder : RunFolder
    process : subprocess.Popen
    errors : text file
        What it says on standard error.
    limit : float
        Time [s] that it was sent to.
    """

    folder: RunFolder
    process: subprocess.Popen
    errors: IO[str]
    limit: float = 0.0

    @property
    def is_done(self) -> bool:
        """True if it has ended with a result."""
        return self.process.poll() == 0

    def failure(self) -> str:
        """Return why it ended without a result; empty while it runs, and where it is done."""
        if not self.process.poll():
            return ""
        self.errors.seek(0)
        lines = self.errors.read().strip().splitlines()
        why = lines[-1] if lines else "it was killed, most often for lack of memory"
        return f"the replica in {self.folder.path} failed: {why}"

    def send(self, line: str) -> None:
        """Write a line to it; nothing where it has ended."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            with suppress(BrokenPipeError):
                self.process.stdin.write(f"{line}\n")
                self.process.stdin.flush()

    def release(self) -> None:
        """Ask it to end with a checkpoint."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            with suppress(BrokenPipeError):
                self.process.stdin.close()


@dataclass(slots=True)
class Replicas:
    """All replicas of a run, seen from one of them.

    Attributes
    ----------
    number : int
        Which of them this one is.
    folders : list of RunFolder
        Of all of them so far, in their order.
    start : callable or None
        Starts the process of a number in a folder that is to go to a time [s]; None: this is one of the others.
    slots : int
        How many run at a time, this one included.
    length : float
        Time [s] that all are to reach.
    tolerance : float
        [s], half a window: a replica that comes so near has reached a time.
    processes : dict
        Those that have been started, by number.
    """

    number: int = 0
    folders: list[RunFolder] = field(default_factory=list)
    start: Callable[[int, RunFolder, float], ReplicaProcess] | None = None
    slots: int = 1
    length: float = 0.0
    tolerance: float = 0.0
    processes: dict[int, ReplicaProcess] = field(default_factory=dict)
    _last_poll: float = 0.0

    @property
    def count(self) -> int:
        """Number of replicas."""
        return max(1, len(self.folders))

    def request(self, count: int, length: float) -> None:
        """Set how many replicas are to reach a time [s]; they start, or continue, with `pump`."""
        home = self.folders[0]
        for number in range(len(self.folders), count):
            own = RunFolder(home.replicas / f"{number:02d}")
            home.replicas.mkdir(exist_ok=True)  # in a folder that was moved none is made
            own.path.mkdir(exist_ok=True)  # at once: how many there are is known from them
            self.folders.append(own)
        self.length = length

    def pump(self, busy: bool) -> None:
        """Start or send on as many replicas as there are cores free for; `busy`: this process is marching itself."""
        if self.start is None:
            return
        running = int(busy)
        waiting = []
        for number in range(1, self.count):
            process = self.processes.get(number)
            if process is None:
                waiting.append(number)
            elif process.process.poll() is None:
                if self._reached(number) < process.limit - self.tolerance:
                    running += 1
                elif process.limit < self.length - self.tolerance:
                    waiting.append(number)
        for number in waiting[: max(0, self.slots - running)]:
            if number not in self.processes:
                self.processes[number] = self.start(number, self.folders[number], self.length)
            else:
                self.processes[number].send(repr(self.length))
            self.processes[number].limit = self.length

    def pump_now_and_then(self) -> None:
        """`pump` while this process marches, at most ten times a second."""
        if self.count > 1 and time.monotonic() - self._last_poll > POLL:
            self._last_poll = time.monotonic()
            self.pump(busy=True)

    def _reached(self, number: int) -> float:
        """Time [s] that the history of a replica reaches."""
        return last_time(self.folders[number].history) or 0.0

    def have_reached(self) -> int:
        """Number of replicas that reached the requested time."""
        return sum(self._has_reached(number) for number in range(1, self.count))

    def _has_reached(self, number: int) -> bool:
        process = self.processes.get(number)
        return process is not None and (process.is_done or self._reached(number) >= self.length - self.tolerance)

    def share_done(self, own: float) -> float:
        """Fraction of the simulated time that is requested and done; `own` is the time of this replica [s]."""
        times = [own, *(self._reached(number) for number in range(1, self.count))]
        return min(1.0, sum(min(each, self.length) for each in times) / (self.count * max(self.length, 1e-300)))

    def wait(self, stopped: Callable[[], bool], tell: Callable[[], None] = lambda: None) -> bool:
        """Wait until all have come to the requested time; False where `stopped()` before, or one has failed."""
        told = time.monotonic()
        while self.have_reached() < self.count - 1:
            if stopped() or self.failure():
                return False
            self.pump(busy=False)
            if time.monotonic() - told > 1.0:
                told = time.monotonic()
                tell()
            time.sleep(POLL)
        return True

    def failure(self) -> str:
        """Return why one of them ended without a result; empty where none has."""
        return next(filter(None, (one.failure() for one in self.processes.values())), "")

    def failed_for_the_scene(self) -> bool:
        """True if one of them failed as it will again when it is resumed."""
        return any(one.failure() and one.folder.read_failure() is not None for one in self.processes.values())

    def are_running(self) -> bool:
        """True if one of the processes has not ended."""
        return any(one.process.poll() is None for one in self.processes.values())

    def histories(self, until: float | None = None) -> list[pandas.DataFrame]:
        """Histories of all so far, in their order; rows up to the first that ends at `until` [s] or later."""
        found = [each.read_history() for each in self.folders if each.history.is_file()]
        if until is not None:
            found = [each.iloc[: int(each[TIME].searchsorted(until - self.tolerance)) + 1] for each in found]
        return [each for each in found if len(each)]

    def finish(self, numbers: list[int] | None = None) -> None:
        """Let the replicas write their summaries and end, without waiting for them; all, or those of `numbers`."""
        for number in self.processes if numbers is None else numbers:
            self.processes[number].send(END)

    def wait_for_results(self, stopped: Callable[[], bool]) -> None:
        """Wait until those that finish have ended, or `stopped()`."""
        while self.are_running() and not stopped():
            time.sleep(POLL)

    def end(self) -> None:
        """Ask all processes to end with a checkpoint, and wait until they have."""
        for one in self.processes.values():
            one.release()
        for one in self.processes.values():
            one.process.wait()


def count_of_run(case: Case, folder: RunFolder, can_resume: bool) -> int:
    """With how many replicas a run begins: what its scene says; a resumed one has no fewer than it had."""
    if case.scene.accuracy.replicas is None and can_resume:
        return max(1 + len(folder.replica_folders()), 1)
    return replica_count(case.scene)


def case_of_replica(case: Case, number: int) -> Case:
    """The scene of another replica: its own seed, no pictures and nothing for ParaView."""
    quiet = {"output.snapshots": 0, "output.pictures": False, "output.profiles": False, "output.formats": []}
    alone = {"accuracy.replicas": 1, "accuracy.replica_scatter": None, "accuracy.replica_scatter_freedom": None}
    seed = replica_seed(case.scene.scene.seed, number)
    return case.with_values({**quiet, **alone, "scene.seed": seed, "output.folder": None})


@contextmanager
def other_replicas(
    case: Case,
    folder: RunFolder,
    count: int,
    *,
    threads: int,
    slots: int,
    resume: bool,
    tune_threads: bool = False,
    start: str | Path | None = None,
) -> Iterator[Replicas]:
    """The replicas of a run, `slots` of them at a time; at the end of the block those that still run are ended.

    Where the run begins with the grains of another one, in the folder `start`, each does with those of its replica.
    """
    with tempfile.TemporaryDirectory(prefix="emclutch-") as scratch:

        def started(number: int, own: RunFolder, limit: float) -> ReplicaProcess:
            task = {
                "case": case_of_replica(case, number).toml(),
                "folder": str(own.path),
                "number": number,
                "threads": threads,
                "tune_threads": tune_threads,
                "resume": _can_resume(own) if resume else False,
                "trust_scripts": case.trust_scripts,
                "start": None if start is None else str(RunFolder(start).replicas / own.path.name),
                "limit": limit,
                "tolerance": group.tolerance,
            }
            return _started(own, task, Path(scratch) / f"{number:02d}")

        group = Replicas(folders=[folder], start=started, slots=slots)
        group.request(count, 0.0)
        try:
            yield group
        finally:
            group.end()
            for one in group.processes.values():
                one.errors.close()


def _can_resume(folder: RunFolder) -> bool:
    """True if a replica has a checkpoint to continue from; what lies there without one is put aside."""
    _wait_for_previous(folder)
    if folder.checkpoint.is_file():
        return True
    if folder.path.is_dir() and has_files(folder.path):
        aside = folder.set_aside()
        log.warning("%s has no checkpoint to continue from: restarted, its files are kept as %s", folder.path, aside)
    return False


def _wait_for_previous(folder: RunFolder) -> None:
    """Wait until a replica whose run was killed has ended; FolderInUse where it does not."""
    last = time.monotonic() + TIMEOUT
    while True:
        try:
            with locked_folder(folder.path):
                return
        except FolderInUse:
            if time.monotonic() > last:
                raise
            time.sleep(POLL)


def _started(folder: RunFolder, task: dict[str, Any], errors: Path) -> ReplicaProcess:
    # -P: the folder that the user stands in may hold files with the names of modules, from elsewhere even
    command = [sys.executable, "-P", "-m", "emclutch.simulation.replica_process"]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    stderr = errors.open("w+", encoding="utf-8")
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C on the terminal is the run's, which then ends its replicas
        )
    except OSError as error:
        stderr.close()
        raise OutputError(f"cannot start a replica: {error.strerror}; take accuracy.replicas = 1") from error
    replica = ReplicaProcess(folder, process, stderr, task["limit"])
    replica.send(json.dumps(task))
    log.info("replica in %s: process %d", folder.path, process.pid)
    return replica


class ReplicaControl:
    """Callback of the loop that waits at a time limit until another one is set; used from two threads.

    Parameters
    ----------
    limit : float
        Time [s] to march to first.
    tolerance : float
        [s]; a replica that comes so near has reached a time. It is that of the run which waits for it, whose windows
        may be shorter.

    Attributes
    ----------
    stopped : threading.Event
        Set where the replica is to end with a checkpoint.
    reached : bool
        Whether it has ended at its limit, with a result.
    """

    def __init__(self, limit: float, tolerance: float) -> None:
        self.stopped = threading.Event()
        self.reached = False
        self._limit, self._tolerance = limit, tolerance
        self._ended = False
        self._changed = threading.Condition()

    def receive(self, line: str) -> None:
        """Take a line of the run: a time [s], or the order to end."""
        with self._changed:
            if line.strip() == END:
                self._ended = True
            else:
                self._limit = float(line)
            self._changed.notify_all()

    def stop(self) -> None:
        """End with a checkpoint."""
        with self._changed:
            self.stopped.set()
            self._changed.notify_all()

    def __call__(self, simulation: Simulation, row: WindowRow | None = None) -> bool:
        now = simulation.motion.time + self._tolerance
        with self._changed:
            self._changed.wait_for(lambda: self._limit > now or self._ended or self.stopped.is_set())
            self.reached = self._ended and self._limit <= now
        return self.reached
