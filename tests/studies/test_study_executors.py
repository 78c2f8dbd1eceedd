"""Points of a study on any executor: what is asked for is what runs, in whatever order, and nothing is lost."""

import os
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
from stand_in_runs import FRICTION, SPEED, never_ends, number_of, study_file

from emclutch.results import OutputError, RunFolder
from emclutch.results.errors import Interrupted, RunError
from emclutch.scene.study import read_study
from emclutch.studies import study as study_of_tasks
from emclutch.studies.study import STOP, Study, Task, child_processes
from emclutch.studies.sweep import sweep
from emclutch.studies.task_process import TaskProcessEnded, call_of, perform_call, result_of

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
        r"(?s)001_.* \(contact\.friction = 0\.2\): .*the grains are gone.*\n003_.* .*2 failed; continue.*--resume"
    )
    with pytest.raises(RunError, match=reasons):
        sweep(study, out=tmp_path / "out", **how)
    assert frictions(tmp_path / "out") == [0.1, 0.3]
    failures = pandas.read_csv(tmp_path / "out" / "failures.csv")
    assert [*map(number_of, failures["point"])] == [1, 3] and failures[FRICTION].tolist() == [0.2, 0.4]
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
    with pytest.raises(RunError, match=r"begins with the grains of 000_.*, which has failed"):
        sweep(
            study_of(tmp_path, {SPEED: ["1 rpm", "2 rpm"], FRICTION: [0.1, 0.2]}, warm_start=SPEED), out=tmp_path / "o"
        )


def test_a_point_that_fails_for_its_scene_is_not_only_to_be_resumed(tmp_path, runs):
    study = study_of(tmp_path, {FRICTION: [0.1, 0.2]})

    def fail(progress):
        RunFolder(progress._folder).write_failure("the grains are gone")
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
    assert len(runs.asked) == 2 and not (tmp_path / "out" / STOP).exists()


@pytest.mark.parametrize("deaf", [False, True], ids=["hears", "deaf"])
def test_ctrl_c_of_the_study_alone_ends_children_that_look_for_no_file(deaf, tmp_path, monkeypatch):
    """Its signal reaches no child. They are interrupted as by Ctrl-C, and ended where that is no use; nothing fails."""
    monkeypatch.setattr(study_of_tasks, "GRACE", 0.5 if deaf else WAIT)
    task, killer = Task("one", None, never_ends, {"deaf": deaf}, "", "digest", ""), threading.Event()

    def interrupt():
        while not killer.wait(0.05):
            if list(tmp_path.glob("out/attempts/*/begun")):
                killer.set()
                os.kill(os.getpid(), signal.SIGINT)

    with child_processes(2) as executor:
        study = Study(tmp_path / "out", executor, 2)
        threading.Thread(target=interrupt, daemon=True).start()
        with study.opened(resume=False):
            study.run([task])
    assert killer.is_set() and study.stopped and study.rows["one"].state == "stopped"
    assert len(list(tmp_path.glob("out/attempts/*/begun" if deaf else "out/one/begun"))) == 1  # it is continued


def test_what_a_worker_cannot_pass_on_is_the_points_failure(tmp_path, runs):
    class Refuses(Executor):
        def submit(self, function, /, *given, **named):
            future = Future()
            future.set_exception(TypeError("cannot pickle"))
            return future

    with pytest.raises(RunError, match=r"000_.*TypeError: cannot pickle"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "out", executor=Refuses())


class Breaks(Executor):
    """Its workers are killed."""

    def submit(self, function, /, *given, **named):
        future = Future()
        future.set_exception(BrokenProcessPool("a process was terminated abruptly"))
        return future


def test_an_executor_that_breaks_is_told(tmp_path, runs):
    with pytest.raises(RunError, match=r"executor has lost its workers .*terminated abruptly\); 0 tasks .*--resume"):
        sweep(study_of(tmp_path, {FRICTION: [0.1]}), out=tmp_path / "out", executor=Breaks())


def test_children_end_with_their_worker(tmp_path):
    """Killed itself, the study cannot end them: each would hold its point's folder, and then wait for ever."""
    script = tmp_path / "study.py"
    script.write_text(
        "import os, threading, time\n"
        "from emclutch.studies.task_process import call_of, perform_call, result_of\n"
        "print(result_of(perform_call(call_of(os.getpid))), flush=True)\n"
        "perform_call(call_of(time.sleep, 60))\n"
    )
    study = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, cwd=ROOT,
                             env={**os.environ, "PYTHONPATH": str(ROOT)})  # fmt: skip
    child = int(study.stdout.readline())
    os.kill(child, 0)
    study.kill()
    study.communicate()
    last = time.monotonic() + WAIT
    while lives(child) and time.monotonic() < last:
        time.sleep(0.02)
    assert not lives(child)


def test_a_call_whose_child_dies_is_begun_again_three_times_at_most(tmp_path):
    with pytest.raises(TaskProcessEnded, match=r"ended without a message \(code 3\)"):
        perform_call(call_of(os._exit, 3))
    with pytest.raises(ZeroDivisionError):
        result_of(perform_call(call_of(divmod, 1, 0)))


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
    with pytest.raises(OutputError, match=r"000_.* no room"):
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
    assert chains == {0.1: [None, 0, 2], 0.2: [None, 1, 3]}
