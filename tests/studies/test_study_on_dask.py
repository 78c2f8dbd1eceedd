"""On workers that are killed, stopped or lost every task has one writer, and a study ends with the bits of one process.

A real scheduler with processes as workers. `tests/benchmarks/study_on_dask.py` does the same with real points and
measures it.
"""

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas
import pytest
from counted_steps import count, steps_in
from killed_run import differences, record_of
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.results import lease as leases
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.lease import LeaseLost, leased
from emclutch.results.study_table import StudyTable
from emclutch.scene.errors import SceneError
from emclutch.studies import task_queue
from emclutch.studies.task_process import TaskProcessEnded

distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")

ROOT = Path(__file__).resolve().parents[2]
THESIS = ROOT / "cases" / "thesis"
TOY = {
    "particles.count": 8, "time.window": "2 ms", "output.snapshots": 3, "output.pictures": False,
    "output.formats": ["hdf5"], "accuracy.replicas": 1, "motion.rotor.speed": "500 rpm", "contact.stiffness": "12 MN/m",
}  # fmt: skip
CLOCKS = ["seconds", "figure_of_merit"]
WAIT = 200.0  # s; a test that needs it has failed


class Cluster:
    """A scheduler in this process, and workers in processes of their own."""

    def __init__(self, folder):
        self._local = distributed.LocalCluster(
            n_workers=0,
            processes=False,
            protocol="tcp",
            host="127.0.0.1",
            scheduler_port=0,
            dashboard_address="127.0.0.1:0",
        )
        self.address, self._folder, self.workers = self._local.scheduler_address, folder, []

    def start(self, workers):
        path = os.pathsep.join([str(ROOT), str(ROOT / "tests" / "studies")])
        command = ["-m", "distributed.cli.dask_worker", self.address, "--no-nanny", "--no-dashboard", "--nthreads", "1"]
        for _ in range(workers):
            self.workers.append(
                subprocess.Popen(
                    [sys.executable, *command, "--local-directory", str(self._folder), "--resources", "memory=1e9",
                     "--name", str(len(self.workers))],
                    env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                )
            )  # fmt: skip

    def give_up(self, process):
        """What the scheduler does where it has not heard of a worker for its time to live, five minutes."""
        (number,) = (number for number, worker in enumerate(self.workers) if worker.pid == process)
        scheduler = self._local.scheduler
        (address,) = (one.address for one in scheduler.workers.values() if str(one.name) == str(number))
        self._local.sync(scheduler.remove_worker, address=address, stimulus_id="not heard of")

    def close(self):
        self._local.close()
        for worker in self.workers:
            worker.kill()
            worker.wait()


def until(condition):
    """Wait until a condition holds, and return its value."""
    last = time.monotonic() + WAIT
    while not (value := condition()):
        assert time.monotonic() < last
        time.sleep(0.02)
    return value


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("workers"))
    yield made
    made.close()


def worker_of(child):
    """The process that has begun another one."""
    return int(Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[1])


def lives(process):
    """True if a process has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def test_what_a_killed_or_stopped_worker_has_begun_goes_on_elsewhere_with_one_writer(cluster, tmp_path):
    """-9 in the middle of one task; a worker stopped, given up by the scheduler and woken, in that of another one."""
    killed, stopped = tmp_path / "killed", tmp_path / "stopped"
    killed.mkdir()
    stopped.mkdir()
    cluster.start(3)
    with emclutch.DaskExecutor(cluster.address, retries=1) as executor:
        futures = [executor.submit(count, folder, 60) for folder in (killed, stopped)]
        until(lambda: len(steps_in(killed)) == len(steps_in(stopped)) == 30)  # where they wait
        child = steps_in(killed)[0][1]
        os.kill(worker_of(child), signal.SIGKILL)
        until(lambda: not lives(child))  # it ends with its worker
        (killed / "go").touch()
        assert futures[0].result(WAIT) == 60
        child = steps_in(stopped)[0][1]
        worker = worker_of(child)
        for one in (worker, child):
            os.kill(one, signal.SIGSTOP)
        try:
            cluster.give_up(worker)
            (stopped / "go").touch()
            time.sleep(1.0)
            assert len(steps_in(stopped)) == 30 and not futures[1].done()
        finally:
            for one in (child, worker):
                os.kill(one, signal.SIGCONT)
        assert futures[1].result(WAIT) == 60
        with pytest.raises(TaskProcessEnded, match="ended without a message"):  # each time that it is tried
            executor.submit(os._exit, 3).result(WAIT)
        with pytest.raises(ZeroDivisionError):
            executor.submit(divmod, 1, 0).result(WAIT)
    for folder in (killed, stopped):
        assert [step for step, _ in steps_in(folder)] == list(range(1, 61))
    assert len({process for _, process in steps_in(killed)}) == 2


def test_memory_is_asked_for_where_workers_offer_it(cluster):
    if not any(worker.poll() is None for worker in cluster.workers):
        cluster.start(1)
    with emclutch.DaskExecutor(cluster.address) as executor:
        until(lambda: executor.workers)
        executor.ask_for(0.5e9)
        assert executor.submit(abs, -1).result(WAIT) == 1
        with pytest.raises(SceneError, match=r"at most 1 GB of the resource memory, and a point needs 2 GB"):
            executor.ask_for(2e9)


class At(StudyTable):
    """Does something once the last point is seen to be on its way."""

    def __init__(self, last, act):
        super().__init__(stream=io.StringIO())
        self.last, self.act = last, act

    def set_fraction(self, number, fraction, text=""):
        if self.act is not None and number == self.last and 0.1 < fraction < 0.9:
            act, self.act = self.act, None
            act()


def stop():
    raise KeyboardInterrupt


@pytest.mark.slow
def test_a_study_goes_from_one_process_to_parts_to_dask_and_back_with_the_same_bits(cluster, tmp_path, monkeypatch):
    """Each of them is ended in the middle of a point; the scheduler is lost for good."""
    monkeypatch.setattr(task_queue, "LOOK_SECONDS", 0.05)
    study = emclutch.read_study(THESIS / "centrifugal_speeds.toml")
    ends = ["20 ms", "24 ms", "60 ms", "0.4 s", "22 ms"]
    small = study.model_copy(update={"set": TOY, "values": {"time.end": ends}})
    small._path = study.path
    alone, out = emclutch.sweep(small, out=tmp_path / "alone", threads=1), tmp_path / "out"
    with pytest.raises(Interrupted):
        emclutch.sweep(small, out=out, threads=1, progress=At(1, stop))
    with pytest.raises(Interrupted):
        emclutch.sweep(small, out=out, threads=1, progress=At(0, stop), part=(3, 5), resume=True)
    if not any(worker.poll() is None for worker in cluster.workers):
        cluster.start(1)
    with emclutch.DaskExecutor(cluster.address) as executor:
        lost = r"connection to the scheduler .* is lost; 3 of 5 points are done; start it again.*--resume --dask tcp:"
        with pytest.raises(RunError, match=lost):
            emclutch.sweep(
                small, out=out, threads=1, executor=executor, jobs=1, progress=At(3, cluster.close), resume=True
            )
    begun = read_checkpoint(out / "point-003" / "checkpoint.h5")["window"]
    emclutch.sweep(small, out=out, threads=1, resume=True)
    assert 0 < begun < 200
    for number in range(5):
        whole, moved = (record_of(folder / f"point-{number:03d}") for folder in (alone, out))
        assert len(whole) > 50 and differences(moved, whole) == []
    tables = [pandas.read_csv(folder / "study.csv").drop(columns=CLOCKS) for folder in (alone, out)]
    assert tables[0].equals(tables[1])


def test_a_lease_that_was_lost_while_its_holder_was_suspended_is_refused(tmp_path, monkeypatch):
    """The holder looks only after a pause in renewing, and neither renews nor removes what is another's."""
    with leased(tmp_path / "a", "a") as lease:
        lease.renew()
        lease.refuse_lost()
        (tmp_path / "a.1.lease").write_text('{"pid": 8, "host": "node8"}')
        os.utime(tmp_path / "a.1.lease", (1e9, 1e9))
        lease.refuse_lost()  # renewed a moment ago
        with monkeypatch.context() as patched, pytest.raises(LeaseLost, match="taken over by another process while"):
            patched.setattr(leases, "EXPIRE_SECONDS", 0.0)
            lease.refuse_lost()
        lease.renew()  # which finds that it is lost
        with pytest.raises(LeaseLost):
            lease.refuse_lost()
    assert (tmp_path / "a.1.lease").stat().st_mtime == 1e9


def test_a_scheduler_or_a_package_that_is_missing_is_told(tmp_path, monkeypatch):
    with pytest.raises(SceneError, match=r"--dask = 127\.0\.0\.1:9 no scheduler answers .*: dask scheduler"):
        emclutch.DaskExecutor("127.0.0.1:9", timeout=0.5)
    ask = CliRunner().invoke
    answer = ask(app, ["sweep", str(THESIS / "centrifugal_speeds.toml"), "--dask", "a:1", "--jobs", "2"])
    assert answer.exit_code == 2 and "--jobs cannot be combined with --dask" in answer.stderr
    monkeypatch.setitem(sys.modules, "distributed", None)
    answer = ask(app, ["sweep", str(THESIS / "centrifugal_speeds.toml"), "--dask", "a:1", "--out", str(tmp_path / "o")])
    assert answer.exit_code == 2 and "pip install 'emclutch[dask]'" in " ".join(answer.stderr.split())
    assert not (tmp_path / "o").exists()
