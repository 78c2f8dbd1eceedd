"""A study on a dask scheduler with three workers, each of which something happens to: what becomes of its points.

    python tests/benchmarks/study_on_dask.py FOLDER

Needs the extra `dask`; two minutes of processor time. The study (eight shot in a centrifugal clutch) is run in one
process first; then on the workers, where one is killed with -9 in the middle of a point, another one is stopped with
SIGSTOP until the scheduler has given it up and then woken, the scheduler is killed and started again, and one point
always fails. A point's record is compared with that of the one process to the last bit.
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
from killed_run import differences, record_of

import emclutch
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.lease import lease_holder
from emclutch.studies.part_folder import lease_of

TESTS = Path(__file__).resolve().parents[1]
THESIS = TESTS.parent / "cases" / "thesis"
ENDS = ["0.6 s", "0.7 s", "0.8 s", "0.9 s"]
TOY = {
    "particles.count": 8, "time.window": "2 ms", "output.snapshots": 3, "output.pictures": False,
    "output.formats": ["hdf5"], "accuracy.replicas": 1, "contact.stiffness": "12 MN/m",
}  # fmt: skip
TTL = 30.0  # s


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
                env={**os.environ, "PYTHONPATH": str(TESTS.parent),
                     "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{TTL:g} s"},
            )  # fmt: skip

    def start(self) -> None:
        self.scheduler = self._process("dask_scheduler", "--host", "127.0.0.1", "--port", str(self._port),
                                       "--no-dashboard")  # fmt: skip
        time.sleep(5.0)
        for _ in range(3):
            self.workers.append(
                self._process("dask_worker", self.address, "--no-nanny", "--no-dashboard", "--nthreads", "1",
                              "--local-directory", str(self._folder))
            )  # fmt: skip

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def child_of(point: Path) -> int:
    """The process that has the lease of a point, once it has a checkpoint of some windows."""
    while True:
        holder = lease_holder(lease_of(point))
        if holder and (point / "checkpoint.h5").is_file() and (point / "history.csv").stat().st_size > 20_000:
            return int(holder.split()[1])
        time.sleep(0.05)


def worker_of(child: int) -> int:
    return int(Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[1])


def main() -> None:
    """Run all, and print the table."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)
    study = emclutch.read_study(THESIS / "centrifugal_speeds.toml")
    small = study.model_copy(update={"set": TOY, "values": {"time.end": [*ENDS, "1 s"]}})
    small._path = study.path
    failing = study.model_copy(
        update={"set": {**TOY, "time.end": "0.1 s"}, "values": {"contact.stiffness": ["12 MN/m", "2 kN/m"]}}
    )
    failing._path = study.path
    alone, out = emclutch.sweep(small, out=folder / "alone", threads=1), folder / "out"
    cluster = Cluster(folder, 8799)
    notes: list[str] = []

    def disturb() -> None:
        child = child_of(out / "point-000")
        worker = worker_of(child)
        os.kill(worker, signal.SIGKILL)
        began, window = time.monotonic(), read_checkpoint(out / "point-000" / "checkpoint.h5")["window"]
        while (holder := lease_holder(lease_of(out / "point-000"))) is None or holder.split()[1] == str(child):
            time.sleep(0.05)
        took = time.monotonic() - began
        notes.append(f"| worker killed with -9 | from window {window} of 300, elsewhere after {took:.1f} s |")
        child = child_of(out / "point-001")
        worker = worker_of(child)
        for one in (worker, child):
            os.kill(one, signal.SIGSTOP)
        rows = (out / "point-001" / "history.csv").stat().st_size
        time.sleep(2.0 * TTL)
        same = rows == (out / "point-001" / "history.csv").stat().st_size
        for one in (child, worker):
            os.kill(one, signal.SIGCONT)
        words = "no row was written by another" if same else "ANOTHER HAS WRITTEN"
        notes.append(f"| worker stopped for {2 * TTL:g} s, given up after {TTL:g} s, woken | {words} meanwhile |")

    disturber = threading.Thread(target=disturb, daemon=True)
    disturber.start()
    with emclutch.DaskExecutor(cluster.address, timeout=120.0) as executor:
        emclutch.sweep(small, out=out, threads=1, executor=executor)
    disturber.join()
    cluster.close()
    cluster.start()
    again = small.model_copy(update={"values": {"time.end": ENDS[1:3]}})
    again._path = study.path
    with emclutch.DaskExecutor(cluster.address, timeout=120.0) as executor:
        killer = threading.Thread(target=lambda: (child_of(folder / "again" / "point-000"), cluster.scheduler.kill()))
        killer.start()
        try:
            emclutch.sweep(again, out=folder / "again", threads=1, executor=executor)
        except emclutch.RunError as error:
            said = str(error).partition(";")[0]
    killer.join()
    cluster.close()
    cluster.start()
    with emclutch.DaskExecutor(cluster.address, timeout=120.0) as executor:
        window = read_checkpoint(folder / "again" / "point-000" / "checkpoint.h5")["window"]
        emclutch.sweep(again, out=folder / "again", threads=1, executor=executor, resume=True)
        notes.append(f"| scheduler killed and started again, `--resume` | told: {said}; from window {window} of 350 |")
        try:
            emclutch.sweep(failing, out=folder / "failing", threads=1, executor=executor)
        except emclutch.RunError as error:
            reason = str(error).splitlines()[0].partition(": ")[2][:120]
            done = len(list((folder / "failing").glob("point-*/summary.json")))
            notes.append(f"| a point that always fails | told: {reason}; {done} other point is done |")
    cluster.close()
    print("| what happens | what becomes of it |\n|---|---|")
    print("\n".join(notes))
    pairs = [(f"point-{n:03d}", out / f"point-{n:03d}") for n in range(5)]
    pairs += [(f"point-{n + 1:03d}", folder / "again" / f"point-{n:03d}") for n in range(2)]
    for name, moved in pairs:
        whole = record_of(alone / name)
        print(name, len(whole), "records, different:", differences(record_of(moved), whole))


if __name__ == "__main__":
    main()
