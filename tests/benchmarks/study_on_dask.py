"""What becomes of a study on a dask scheduler with three workers when one of these ends: a table.

    python tests/benchmarks/study_on_dask.py FOLDER

Needs the extra `dask`; two minutes of processor time. A study of one point (eight shot in a centrifugal clutch) is run
in one process first; then on the workers for each event: the worker of the point is killed with -9 in the middle of it;
worker and point are stopped with SIGSTOP until the scheduler has given them up, and woken; the scheduler is killed, and
started again. Each point's record is compared with that of the one process to the last bit. At last one of two points
always fails. Nothing else depends on seconds than `TTL`, which is so long that workers of a busy machine answer in it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hard"))
import distributed
from killed_run import differences, record_of

import emclutch
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.lease import lease_holder
from emclutch.scene.study import StudySection
from emclutch.studies.point_index import lease_of

TESTS = Path(__file__).resolve().parents[1]
THESIS = TESTS.parent / "cases" / "thesis"
TOY = {
    "particles.count": 8, "time.window": "2 ms", "output.snapshots": 3, "output.pictures": False,
    "output.formats": ["hdf5"], "accuracy.replicas": 1, "contact.stiffness": "12 MN/m", "time.end": "1 s",
}  # fmt: skip
TTL = 120.0  # s


class Cluster:
    """A scheduler and three workers, all of them processes."""

    def __init__(self, folder: Path, port: int) -> None:
        self.address, self._port, self._folder = f"tcp://127.0.0.1:{port}", port, folder
        self.workers: list[subprocess.Popen] = []
        self.start()

    def _process(self, *command: str) -> subprocess.Popen:
        name = command[0].rpartition("_")[2]
        with (self._folder / f"{name}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{command[0]}", *command[1:]], stdout=log, stderr=log,
                env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS.parent), str(TESTS / "benchmarks")]),
                     "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{TTL:g} s"},
            )  # fmt: skip

    def start(self) -> None:
        self.scheduler = self._process("dask_scheduler", "--host", "127.0.0.1", "--port", str(self._port),
                                       "--no-dashboard")  # fmt: skip
        for _ in range(3):
            self.workers.append(
                self._process("dask_worker", self.address, "--no-nanny", "--no-dashboard", "--nthreads", "1",
                              "--local-directory", str(self._folder))
            )  # fmt: skip

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def child_of(point: Path) -> int | None:
    """The process that runs a point, once it has a checkpoint and some windows; None where it was done before."""
    while not (point / "summary.json").is_file():
        holder = lease_holder(lease_of(point))
        if holder and (point / "checkpoint.h5").is_file() and (point / "history.csv").stat().st_size > 20_000:
            return int(holder.split()[1])
        time.sleep(0.05)
    return None


def worker_of(child: int) -> int:
    """The worker that has begun a point's process."""
    return int(Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[1])


def kill_worker(cluster: Cluster, child: int) -> None:
    os.kill(worker_of(child), signal.SIGKILL)


def stop_worker(cluster: Cluster, child: int) -> None:
    """All of it, until the scheduler has given it up; then wake it."""
    processes = (worker_of(child), child)
    with distributed.Client(cluster.address, timeout=TTL, set_as_default=False) as client:

        def wait_for(workers: int) -> None:
            while len(client.scheduler_info()["workers"]) != workers:
                time.sleep(1.0)

        wait_for(3)
        for one in processes:
            os.kill(one, signal.SIGSTOP)
        wait_for(2)
    for one in reversed(processes):
        os.kill(one, signal.SIGCONT)


def kill_scheduler(cluster: Cluster, child: int) -> None:
    cluster.scheduler.kill()


EVENTS = {
    "a worker is killed with -9": kill_worker,
    f"a worker is stopped, given up after {TTL:g} s, and woken": stop_worker,
    "the scheduler is killed, started again, and the study resumed": kill_scheduler,
}


def study_of(values: dict[str, list[str]]) -> StudySection:
    """The toy study over some values."""
    study = emclutch.read_study(THESIS / "centrifugal_speeds.toml")
    small = study.model_copy(update={"set": TOY, "values": values})
    small._path = study.path
    return small


def main() -> None:
    """Run all, and print the table."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)
    study = study_of({"time.end": ["1 s"]})
    whole = record_of(emclutch.sweep(study, out=folder / "alone", threads=1) / "point-000")
    print("| what happens | message | continued from window | records that differ |\n|---|---|---|---|", flush=True)
    for number, (words, act) in enumerate(EVENTS.items()):
        out, found = folder / f"event-{number}", {"window": 0}
        cluster = Cluster(folder, 8799 + number)

        def disturb(act=act, cluster=cluster, point=out / "point-000", found=found) -> None:
            if (child := child_of(point)) is not None:
                found["window"] = read_checkpoint(point / "checkpoint.h5")["window"]
                act(cluster, child)

        disturber = threading.Thread(target=disturb)
        disturber.start()
        message = ""
        try:
            with emclutch.DaskExecutor(cluster.address, timeout=TTL) as executor:
                emclutch.sweep(study, out=out, threads=1, executor=executor)
        except emclutch.RunError as error:
            message = str(error).partition(";")[0]
            cluster.close()
            cluster = Cluster(folder, 8799 + number)
            with emclutch.DaskExecutor(cluster.address, timeout=TTL) as executor:
                emclutch.sweep(study, out=out, threads=1, executor=executor, resume=True)
        disturber.join()
        cluster.close()
        off = differences(record_of(out / "point-000"), whole)
        print(f"| {words} | {message} | {found['window']} of 500 | {len(off)} of {len(whole)} |", flush=True)
    cluster = Cluster(folder, 8790)
    try:
        with emclutch.DaskExecutor(cluster.address, timeout=TTL) as executor:
            fails = study_of({"contact.stiffness": ["12 MN/m", "2 kN/m"], "time.end": ["0.1 s"]})
            emclutch.sweep(fails, out=folder / "fails", threads=1, executor=executor)
    except emclutch.RunError as error:
        print(f"| one of two points always fails | {str(error).splitlines()[0][:100]} | | |")
    done = len(list((folder / "fails").glob("point-*/summary.json")))
    cluster.close()
    print(f"\n{done} other point is done")


if __name__ == "__main__":
    main()
