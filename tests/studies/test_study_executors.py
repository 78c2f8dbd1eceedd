"""Points of a study on any executor: what is asked for is what runs, in whatever order, and nothing is lost."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pandas
import pytest
from stand_in_runs import FRICTION, SPEED, study_file

from emclutch.results import OutputError, RunFolder, lease
from emclutch.results.errors import Interrupted, RunError
from emclutch.scene.study import read_study
from emclutch.studies import tasks as study_tasks
from emclutch.studies.sweep import sweep

ROOT = Path(__file__).parents[2]
WAIT = 20.0  # s; a test that needs it has failed


@pytest.fixture
def threads():
    with ThreadPoolExecutor(2) as executor:
        yield executor


def study_of(folder, values, **own):
    return read_study(study_file(folder, values, **own))


def frictions(folder):
    return pandas.read_csv(folder / "study.csv")[FRICTION].tolist()


def test_tables_are_in_the_studys_order_whichever_point_is_done_first(tmp_path, runs, threads):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.2, 0.3]})
    alone = sweep(study, out=tmp_path / "alone")
    last = threading.Event()
    runs.acts = {0.1: lambda _: last.wait(WAIT), 0.3: lambda _: last.set()}
    out = sweep(study, out=tmp_path / "out", executor=threads, threads=3)
    assert last.is_set() and runs.asked[-1].threads == 3
    assert (out / "study.csv").read_bytes() == (alone / "study.csv").read_bytes()


@pytest.mark.parametrize("error", [RunError("the grains are gone"), ZeroDivisionError("the grains are gone")])
@pytest.mark.parametrize("beside", [True, False])
def test_where_a_point_fails_the_others_go_on(tmp_path, runs, threads, error, beside):
    """Of a defect of the program too; the reasons are in a table, and what failed is repeated."""
    study = study_of(tmp_path, {FRICTION: [0.1, 0.2, 0.3, 0.4]})

    def fail(progress):
        raise error

    runs.acts = {0.2: fail, 0.4: fail}
    how = {"executor": threads, "jobs": 2} if beside else {}
    reasons = (
        r"(?s)point-001 \(contact\.friction = 0\.2\): .*the grains are gone.*\npoint-003 .*2 failed; continue.*--resume"
    )
    with pytest.raises(RunError, match=reasons):
        sweep(study, out=tmp_path / "out", **how)
    assert frictions(tmp_path / "out") == [0.1, 0.3]
    failures = pandas.read_csv(tmp_path / "out" / "failures.csv")
    assert failures["point"].tolist() == ["point-001", "point-003"] and failures[FRICTION].tolist() == [0.2, 0.4]
    assert failures["reason"].str.contains("the grains are gone").all()
    before = len(runs.asked)
    runs.acts = {}
    out = sweep(study, out=tmp_path / "out", resume=True, **how)
    assert frictions(out) == [0.1, 0.2, 0.3, 0.4] and not (out / "failures.csv").exists()
    assert sorted(asked.friction for asked in runs.asked[before:]) == [0.2, 0.4]  # what was done stays


def test_points_that_wait_for_one_that_failed_have_failed_too(tmp_path, runs):
    def fail(progress):
        raise RunError("the grains are gone")

    runs.acts = {0.1: fail}
    with pytest.raises(RunError, match=r"begins with the grains of point-000, which has failed"):
        sweep(
            study_of(tmp_path, {SPEED: ["1 rpm", "2 rpm"], FRICTION: [0.1, 0.2]}, warm_start=SPEED), out=tmp_path / "o"
        )


def test_a_point_that_fails_for_its_scene_is_not_only_to_be_resumed(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.2]})

    def fail(progress):
        RunFolder(tmp_path / "out" / "point-000").write_failure("the grains are gone")
        raise RunError("the grains are gone")

    runs.acts = {0.1: fail}
    with pytest.raises(
        RunError,
        match=r"leave points whose scene fails out of the study's values, or change the scene; then continue with",
    ):
        sweep(study, out=tmp_path / "out")


def test_ctrl_c_asks_every_running_point_to_stop(tmp_path, runs, threads):
    both = threading.Barrier(2, timeout=WAIT)

    def run_until_asked(progress):
        if both.wait() == 0:
            os.kill(os.getpid(), signal.SIGINT)
        ended = threading.Event()
        while not progress.stop_asked:
            assert not ended.wait(0.01)
        raise Interrupted("stopped")

    runs.acts = dict.fromkeys([0.1, 0.2], run_until_asked)
    study = study_of(tmp_path, {FRICTION: [0.1, 0.2, 0.3]})
    with pytest.raises(Interrupted, match=r"0 of 3 points done; continue with: emclutch sweep .* --resume --jobs 2"):
        sweep(study, out=tmp_path / "out", executor=threads, jobs=2)
    assert len(runs.asked) == 2 and not (tmp_path / "out" / study_tasks.STOP).exists()


def test_what_a_worker_cannot_pass_on_is_the_points_failure(tmp_path, runs):
    class Refuses(Executor):
        def submit(self, function, /, *given, **named):
            future = Future()
            future.set_exception(TypeError("cannot pickle"))
            return future

    with pytest.raises(RunError, match=r"point-000.*TypeError: cannot pickle"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "out", executor=Refuses())


class Breaks(Executor):
    """Its workers are killed."""

    def submit(self, function, /, *given, **named):
        future = Future()
        future.set_exception(BrokenProcessPool("a process was terminated abruptly"))
        return future


def test_a_worker_that_was_killed_is_explained(tmp_path, runs):
    with pytest.raises(RunError, match=r"(?s)point-000.*killed, most often for want of memory.*fewer --jobs.*--resume"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "out", executor=Breaks())


def test_a_worker_does_not_outlive_its_study(tmp_path):
    """Killed itself, the study cannot end its processes: each would hold its point's folder, and then wait for ever."""
    script = tmp_path / "study.py"
    script.write_text(
        "import os, time\n"
        "from emclutch.studies.workers import worker_pool\n"
        "if __name__ == '__main__':\n"
        "    with worker_pool(1) as pool:\n"
        "        print(pool.submit(os.getpid).result(), flush=True)\n"
        "        pool.submit(time.sleep, 60)\n"
        "        time.sleep(60)\n"
    )
    study = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, cwd=ROOT,
                             env={**os.environ, "PYTHONPATH": str(ROOT)})  # fmt: skip
    worker = int(study.stdout.readline())
    os.kill(worker, 0)
    study.kill()
    study.communicate()
    last = time.monotonic() + WAIT
    while lives(worker) and time.monotonic() < last:
        time.sleep(0.02)
    assert not lives(worker)


def lives(pid):
    """Whether a process is there that has not ended: nobody may be left to collect one that has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_point_that_cannot_be_written_is_bad_input(tmp_path, runs, threads):
    def fail(progress):
        raise OutputError("no room")

    runs.acts = {0.1: fail}
    with pytest.raises(OutputError, match=r"point-000 .*no room"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "out", executor=threads)
    with pytest.raises(ValueError, match="jobs = 0; allowed: 1 or more"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "out", jobs=0)


def test_grains_are_handed_on_along_one_value_and_chains_run_side_by_side(tmp_path, runs, threads):
    """Two chains of frictions 0.1 and 0.2: neither waits for the other, each point has its own predecessor's grains."""
    both = threading.Barrier(2, timeout=WAIT)
    runs.acts = dict.fromkeys([0.1, 0.2], lambda _: both.wait())
    values = {SPEED: ["1 rpm", "2 rpm", "3 rpm"], FRICTION: [0.1, 0.2]}
    sweep(study_of(tmp_path, values, warm_start=SPEED), out=tmp_path / "out", executor=threads)
    chains = {friction: [asked.start for asked in runs.asked if asked.friction == friction] for friction in (0.1, 0.2)}
    assert chains == {0.1: [None, "point-000", "point-002"], 0.2: [None, "point-001", "point-003"]}


def test_a_point_that_another_process_has_is_waited_for_and_kept(tmp_path, runs, threads, monkeypatch):
    """Its lease is held elsewhere; what that one has finished meanwhile is not run again."""
    monkeypatch.setattr(lease, "WAIT_SECONDS", 0.01)
    study, out = study_of(tmp_path, {FRICTION: [0.1, 0.2]}), tmp_path / "out"
    both = sweep(study, out=tmp_path / "both")
    first, go_on = threading.Event(), threading.Event()

    def other(progress):
        with lease.leased(out / "parts" / "point-001", "point-001"):
            first.set()
            assert go_on.wait(WAIT)
            shutil.copytree(both / "point-001", out / "point-001")

    holder = threading.Thread(target=other, args=(None,))
    holder.start()
    assert first.wait(WAIT)
    runs.asked.clear()
    runs.acts = {0.1: lambda _: go_on.set()}
    sweep(study, out=out, executor=threads, resume=True)  # its folder has the lease
    holder.join()
    assert [asked.friction for asked in runs.asked] == [0.1] and frictions(out) == [0.1, 0.2]


def test_a_point_whose_lease_was_lost_is_taken_in_turn_again(tmp_path, runs, threads, monkeypatch):
    """As when this process was suspended: it leaves the point to the other one, and looks at what that has done."""
    monkeypatch.setattr(lease, "EXPIRE_SECONDS", 0.0)
    study, out = study_of(tmp_path, {FRICTION: [0.1]}), tmp_path / "out"

    def loses(progress):
        runs.acts = {}
        held = out / "parts" / "point-000.1.lease"
        text = held.read_text()
        held.write_text("{}")
        with pytest.raises(lease.LeaseLost):
            _ = progress.stop_asked
        held.write_text(text)
        raise lease.LeaseLost("taken over")

    runs.acts = {0.1: loses}
    sweep(study, out=out, executor=threads)
    assert [asked.friction for asked in runs.asked] == [0.1, 0.1] and frictions(out) == [0.1]
