"""The other replicas of a run: processes beside it, each a whole run of the scene with another packing.

The run itself is the first replica. Each of the others is a process (`emclutch.simulation.replica_process`) with a
folder of its own under the run's. Its standard input is the bond between the two: the run sends the task as one line
and keeps it open; where it ends, because the run was stopped, failed or was killed, the replica writes a checkpoint and
ends too.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from emclutch.results import OutputError, RunFolder, read_history
from emclutch.results.folder_lock import FolderInUse, has_files, locked_folder
from emclutch.results.set_aside import set_aside
from emclutch.scene.replica_count import replica_count, replica_seed
from geometry.kernel_cache import ROOT

if TYPE_CHECKING:
    import pandas

    from emclutch.scene.case import Case

log = logging.getLogger(__name__)
POLL = 0.1  # s, between looks at a process
PATIENCE = 60.0  # s, for a replica of a killed run: it ends, with a checkpoint, after the window that it is in


@dataclass(slots=True)
class ReplicaProcess:
    """One of the other replicas while it runs; `errors` is what it says."""

    folder: RunFolder
    process: subprocess.Popen
    errors: IO[str]

    def failure(self) -> str:
        """Why it ended without a result; empty while it runs, and where it is done."""
        if not self.process.poll():
            return ""
        self.errors.seek(0)
        lines = self.errors.read().strip().splitlines()
        why = lines[-1] if lines else "it was killed, most often for want of memory"
        return f"the replica in {self.folder.path} failed: {why}"

    def release(self) -> None:
        """Ask it to end with a checkpoint."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            self.process.stdin.close()


@dataclass(slots=True)
class Replicas:
    """All replicas of a run, seen from one of them.

    Attributes
    ----------
    histories : list of Path
        history.csv of each, in their order.
    number : int
        Which of them this one is.
    processes : list of ReplicaProcess
        Those that this one has started: the first one all others, the others none.
    """

    histories: list[Path] = field(default_factory=list)
    number: int = 0
    processes: list[ReplicaProcess] = field(default_factory=list)

    def failure(self) -> str:
        """Why one of them ended without a result; empty where none has."""
        return next(filter(None, (one.failure() for one in self.processes)), "")

    def failed_for_the_scene(self) -> bool:
        """Whether one of them failed as it will again when it is resumed."""
        return any(one.failure() and one.folder.read_failure() is not None for one in self.processes)

    def are_running(self) -> bool:
        """Whether one of the processes has not ended."""
        return any(one.process.poll() is None for one in self.processes)

    def other_histories(self) -> list[pandas.DataFrame]:
        """What the others have so far."""
        others = (path for number, path in enumerate(self.histories) if number != self.number)
        found = (read_history(path) for path in others if path.is_file())
        return [history for history in found if len(history)]

    def end(self) -> None:
        """Ask all processes to end with a checkpoint, and wait until they have."""
        for one in self.processes:
            one.release()
        for one in self.processes:
            one.process.wait()

    def wait(self, stopped: Callable[[], bool], tell: Callable[[str], None]) -> str:
        """Wait until all are done, or `stopped()`; returns the first failure, empty where there is none."""
        told = 0.0
        while not stopped() and not self.failure() and self.are_running():
            if time.monotonic() - told > 5.0:
                told = time.monotonic()
                running = sum(one.process.poll() is None for one in self.processes)
                tell(f"waiting for {running} other {'packing' if running == 1 else 'packings'}")
            time.sleep(POLL)
        return self.failure()


def count_of_run(case: Case, folder: RunFolder, goes_on: bool) -> int:
    """How many replicas a run has: what its scene says; where it is silent, a resumed one has what it began with."""
    if case.scene.accuracy.replicas is None and goes_on:
        return 1 + len(folder.replica_folders())
    return replica_count(case.scene)


def case_of_replica(case: Case, number: int) -> Case:
    """The scene of another replica: its own seed, no pictures and nothing for ParaView."""
    quiet = {"output.snapshots": 0, "output.pictures": False, "output.profiles": False, "output.formats": []}
    seed = replica_seed(case.scene.scene.seed, number)
    return case.with_values({**quiet, "scene.seed": seed, "accuracy.replicas": 1, "output.folder": None})


@contextmanager
def other_replicas(
    case: Case,
    folder: RunFolder,
    count: int,
    *,
    threads: int,
    resume: bool,
    threads_are_open: bool = False,
    start: str | Path | None = None,
) -> Iterator[Replicas]:
    """Start replicas 1 to count - 1 of a run beside it; at the end of the block those that still run are ended.

    Where the run begins with the grains of another one, in the folder `start`, each does with those of its replica.
    """
    folders = [folder, *(RunFolder(folder.replicas / f"{number:02d}") for number in range(1, count))]
    group = Replicas([each.history for each in folders])
    with tempfile.TemporaryDirectory(prefix="emclutch-") as scratch:
        try:
            for own in folders[1:]:  # before the first window: how many there are is known from them (`count_of_run`)
                own.path.mkdir(parents=True, exist_ok=True)
            for number, own in enumerate(folders[1:], start=1):
                task = {
                    "case": case_of_replica(case, number).toml(),
                    "folder": str(own.path),
                    "histories": [str(path) for path in group.histories],
                    "number": number,
                    "threads": threads,
                    "threads_are_open": threads_are_open,
                    "resume": _goes_on(own) if resume else False,
                    "trust_scripts": case.trust_scripts,
                    "start": None if start is None else str(RunFolder(start).replicas / own.path.name),
                }
                group.processes.append(_started(own, task, Path(scratch) / f"{number:02d}"))
            yield group
        finally:
            group.end()
            for one in group.processes:
                one.errors.close()


def tell_packing_share(folder: RunFolder, share: float | None) -> None:
    """Write into the summaries of the other replicas what the error of each alone lacks [N m]."""
    for path in folder.replica_folders():
        other = RunFolder(path)
        summary = other.read_summary()
        if "torque" in summary:
            summary["torque"]["packing_share"] = share
            other.write_summary(summary)


def _goes_on(folder: RunFolder) -> bool:
    """Whether a replica has a checkpoint to go on from; what lies there without one is put aside."""
    _wait_for_the_former(folder)
    if folder.checkpoint.is_file():
        return True
    if folder.path.is_dir() and has_files(folder.path):
        aside = set_aside(folder.path)
        log.warning("%s has no checkpoint to go on from: started anew, its files are kept as %s", folder.path, aside)
    return False


def _wait_for_the_former(folder: RunFolder) -> None:
    """Wait until a replica whose run was killed has ended; FolderInUse where it does not."""
    last = time.monotonic() + PATIENCE
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
    said = errors.open("w+", encoding="utf-8")
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=said,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C on the terminal is the run's, which then ends its replicas
        )
    except OSError as error:
        said.close()
        raise OutputError(f"cannot start a replica: {error.strerror}; take accuracy.replicas = 1") from error
    assert process.stdin is not None
    process.stdin.write(json.dumps(task) + "\n")
    process.stdin.flush()
    log.info("replica in %s: process %d", folder.path, process.pid)
    return ReplicaProcess(folder, process, said)
