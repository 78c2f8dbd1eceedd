"""Replicas of a run: whole runs with other seeds, beside it; their torques together; an end once it is known."""

import errno
import io
import os
import re
import signal
import threading
from contextlib import suppress
from dataclasses import replace

import made_up_study
import numpy as np
import pytest

import emclutch
from emclutch.results import OutputError, RunFolder, read_history
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import FolderInUse, locked_folder
from emclutch.results.history import last_time
from emclutch.results.steady_torque import SteadyConditions, steady_torque
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.scene.replica_count import automatic_count, replica_seed
from emclutch.scene.torque_target import TorqueTarget
from emclutch.simulation import replicas

CELL = made_up_study.CELL | {
    "time": {"end": "6 ms", "until": "torque 1 N m", "window": "20 us", "average_from": "0.4 ms"},
    "accuracy": {"replicas": 3},
}
CLOCKS = ["wall_field", "wall_magnetic", "wall_contact", "wall_total", "processor_time"]


def rows(path):
    return read_history(path / "history.csv").drop(columns=CLOCKS, errors="ignore")


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A run of three replicas that ended because its torque was known."""
    return emclutch.run(case_from(CELL), out=tmp_path_factory.mktemp("known") / "run")


def test_a_machine_that_starts_no_more_processes_is_an_error_with_a_remedy(tmp_path, monkeypatch):
    def none_can_start(*_, **__):
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(replicas.subprocess, "Popen", none_can_start)
    with pytest.raises(OutputError, match=r"accuracy\.replicas = 1"):
        emclutch.run(case_from(CELL), out=tmp_path / "run")


def test_a_replica_is_the_run_of_another_seed(known, tmp_path):
    """To the last bit, as long as it lasts: nothing passes between replicas but the question whether to continue."""
    seed = replica_seed(3, 1)
    single = {
        "scene.seed": seed,
        "accuracy.replicas": 1,
        "time.until": None,
        "time.end": "0.4 ms",
        "time.average_from": None,
    }
    emclutch.run(case_from(CELL, single), out=tmp_path / "single")
    alone, beside = rows(tmp_path / "single"), rows(known.folder.replica_folders()[0])
    assert len(alone) > 15 and alone.equals(beside[: len(alone)])
    assert not beside[:20].equals(rows(known.folder.path)[:20])


def test_the_torque_is_that_of_all_replicas(known):
    histories = [rows(known.folder.path), *(rows(path) for path in known.folder.replica_folders())]
    plan = known.folder.read_plan()["steady_torque"]
    all_of_them = steady_torque(histories[0], SteadyConditions.from_dict(plan), histories[1:])
    assert known.torque == all_of_them and all_of_them.replicas == 3
    assert known.summary["replicas"]["seeds"] == [replica_seed(3, number) for number in range(3)]
    means = known.summary["replicas"]["means"]
    assert np.mean(means) == pytest.approx(all_of_them.mean, rel=1e-9) and len(set(means)) == 3
    alone = emclutch.load_result(known.folder.replica_folders()[0])
    assert alone.torque.replicas == 1 and "seeds" not in alone.summary


def test_all_replicas_end_at_the_same_window_once_the_torque_is_known(known):
    """At a look, and not at an earlier one: there it was not known yet."""
    histories = [rows(known.folder.path), *(rows(path) for path in known.folder.replica_folders())]
    assert len({len(history) for history in histories}) == 1 and len(histories[0]) < 300
    assert known.summary["until"]["reached"] and known.torque.converged
    assert known.torque.half_width() == known.summary["until"]["half_width"] <= 1.0
    log = known.folder.log.read_text()
    looks = re.findall(r"± (\S+) N m \(95 %; ± (\S+) N m was requested\), 3 replicas to (\S+) ms", log)
    assert float(looks[-1][0]) <= float(looks[-1][1]) and [float(length) for *_, length in looks] == pytest.approx(
        [1.2 * 1.5**k for k in range(len(looks))], rel=0.01
    )
    assert "time.until reached" in log


def test_a_study_scatter_is_pooled_at_the_end_of_the_run_only(known):
    """Not in a run that is cut off: means over a shorter part scatter more."""
    histories = [rows(known.folder.path), *(rows(path) for path in known.folder.replica_folders())]
    of = SteadyConditions.from_dict(known.folder.read_plan()["steady_torque"])
    assert of.several_looks and of.replica_scatter == 0.0
    assert of.replica_scatter_from == pytest.approx(0.99 * 6e-3, rel=1e-2)
    end = histories[0]["time"].iloc[-1]
    pooled = replace(of, replica_scatter=0.5, replica_scatter_freedom=16.0, replica_scatter_from=0.99 * end)
    found = steady_torque(histories[0], pooled, histories[1:])
    assert (found.pooled_scatter, found.pooled_freedom, found.degrees_of_freedom) == (0.5, 16.0, 18.0)
    early = steady_torque(histories[0], replace(pooled, replica_scatter_from=1.01 * end), histories[1:])
    assert early == known.torque


@pytest.mark.stability
def test_more_replicas_are_run_where_the_torque_needs_them(tmp_path, monkeypatch):
    """From two to four, at the same length, and no more than the scene allows."""
    monkeypatch.setattr("emclutch.scene.replica_count.automatic_count", lambda *_: 2)
    few = {"accuracy.replicas": None, "accuracy.max_replicas": 4, "time.until": "torque 0.1 mN m", "time.end": "0.9 ms"}
    found = emclutch.run(case_from(CELL, few), out=tmp_path / "run")
    assert len(found.folder.replica_folders()) == 3 and found.torque.replicas == 4
    assert not found.summary["until"]["reached"] and "requested" in found.summary["until"]["reason"]
    assert len({len(rows(path)) for path in (found.folder.path, *found.folder.replica_folders())}) == 1
    first = last_time(found.folder.history)
    assert first == pytest.approx(rows(found.folder.path)["time"].iloc[-1], rel=1e-12)


def test_stopped_and_resumed_replicas_end_as_undisturbed_ones(known, tmp_path):
    class StopAt:
        def update(self, fraction, text):
            if fraction > 0.1 and not self.done:
                self.done = True
                signal.raise_signal(signal.SIGINT)

        done = False

    with pytest.raises(Interrupted, match="--resume"):
        emclutch.run(case_from(CELL), out=tmp_path / "run", progress=StopAt())
    assert not (tmp_path / "run" / "summary.json").exists()
    again = emclutch.run(case_from(CELL), out=tmp_path / "run", resume=True)
    assert rows(again.folder.path).equals(rows(known.folder.path))
    for mine, theirs in zip(again.folder.replica_folders(), known.folder.replica_folders(), strict=True):
        assert rows(mine).equals(rows(theirs))
    assert again.torque == known.torque


def test_a_replica_that_dies_ends_the_run_with_its_name(tmp_path):
    log = tmp_path / "run" / "run.log"

    class Kill:
        def update(self, fraction, text):
            if fraction > 0.02:
                for number in re.findall(r"replicas/01: process (\d+)", log.read_text()):
                    with suppress(ProcessLookupError):  # killed at an earlier update, and not looked at yet
                        os.kill(int(number), signal.SIGKILL)

    with pytest.raises(RunError, match=r"replicas/01 failed: it was killed"):
        emclutch.run(case_from(CELL), out=tmp_path / "run", progress=Kill())
    assert (tmp_path / "run" / "checkpoint.h5").exists()


def test_a_replica_that_fails_for_its_scene_is_distinguished_from_one_that_was_killed(tmp_path):
    class Ended:
        def poll(self):
            return 1

    folder = RunFolder(tmp_path)
    group = replicas.Replicas(processes={1: replicas.ReplicaProcess(folder, Ended(), io.StringIO("grains overlap"))})
    assert "grains overlap" in group.failure() and not group.failed_for_the_scene()
    folder.write_failure("grains overlap")
    assert group.failed_for_the_scene()


def test_a_replica_of_a_killed_run_is_waited_for(tmp_path, monkeypatch):
    """It ends by itself, after the window that it is in: no reason to refuse the run that continues."""
    former = RunFolder(tmp_path / "01")
    held, let_go = threading.Event(), threading.Event()

    def hold():
        with locked_folder(former.path):
            held.set()
            let_go.wait(20.0)

    holder = threading.Thread(target=hold)
    holder.start()
    assert held.wait(20.0)
    monkeypatch.setattr(replicas, "TIMEOUT", 0.0)
    with pytest.raises(FolderInUse, match=f"in use by process {os.getpid()} "):
        replicas._can_resume(former)
    monkeypatch.setattr(replicas, "TIMEOUT", 20.0)
    threading.Timer(0.3, let_go.set).start()
    assert not replicas._can_resume(former) and let_go.is_set()
    holder.join()


def test_a_run_that_is_killed_at_once_has_as_many_replicas_when_it_goes_on(tmp_path, monkeypatch):
    """They begin later than the run itself, whose first checkpoint may be there before them."""
    folder = RunFolder(tmp_path / "run")
    folder.path.mkdir()

    def dies(own, task, errors):
        raise KeyboardInterrupt

    monkeypatch.setattr(replicas, "_started", dies)
    options = {"threads": 1, "slots": 2, "resume": False}
    with pytest.raises(KeyboardInterrupt), replicas.other_replicas(case_from(CELL), folder, 3, **options) as group:
        group.request(3, 1e-3)
        group.pump(busy=True)
    silent = case_from(CELL, {"accuracy.replicas": None})
    assert replicas.count_of_run(silent, folder, can_resume=True) == 3


def test_replicas_of_grains_that_are_packed_alike_are_refused():
    lattice = {"particles.packing": "lattice", "particles.noise": 0.0, "particles.solid_fraction": 0.2}
    with pytest.raises(SceneError, match=r"accuracy.replicas = 3 asks for several replicas"):
        case_from(CELL, lattice)
    assert automatic_count(case_from(CELL, {**lattice, "accuracy.replicas": None}).scene) == 1


def test_only_steady_torques_have_replicas_by_themselves():
    """Four, whatever the machine: with three degrees of freedom Student's t is of use."""
    cell = {"accuracy.replicas": None}
    assert automatic_count(case_from(CELL, cell).scene) == 4
    table = {"times": ["0 s", "1 s"], "values": ["0 rpm", "100 rpm"]}
    assert automatic_count(case_from(CELL, {**cell, "motion.rotor.speed": table}).scene) == 1
    free = {"motion.disc": {"free": {"inertia": 1e-6}}}
    assert automatic_count(case_from(CELL, {**cell, **free}).scene) == 1


def test_seeds_of_replicas_are_no_seeds_that_people_take():
    seeds = {replica_seed(seed, number) for seed in range(1, 50) for number in range(1, 5)}
    assert len(seeds) == 49 * 4 and min(seeds) > 1e6 and replica_seed(7, 0) == 7


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("torque 2 %", TorqueTarget(0.02, None)),
        ("torque 10 mN m", TorqueTarget(None, 0.01)),
        ("torque 5 % or 0.1 N m", TorqueTarget(0.05, 0.1)),
    ],
)
def test_aims_for_the_torque(text, target):
    case = case_from(CELL, {"time.until": text})
    assert case.scene.time.until == target
    assert case_from(case.resolved()).scene == case.scene


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("2 %", "is not a valid torque target"),
        ("torque 2", "has no unit"),
        ("torque 2 % or 3 %", "two targets of one kind"),
        ("torque 90 %", "out of range; allowed: 0.01 to 50 %;"),
        ("torque 2 mm", "a torque is needed"),
    ],
)
def test_aims_that_are_none_are_explained(text, answer):
    with pytest.raises(SceneError, match=f"(?s)time.until.*{answer}.*torque 2 %"):
        case_from(CELL, {"time.until": text})


def test_a_pool_runs_as_many_at_a_time_as_there_are_cores_for(tmp_path):
    """The others start when one has come to the time that all are to reach; a later time sends them on."""

    class Process:
        def poll(self):
            return None

    class Lines(list):
        closed = False
        write, flush = list.append, lambda self: None

    def started(number, folder, limit):
        process = Process()
        process.stdin = Lines()
        return replicas.ReplicaProcess(folder, process, io.StringIO(), limit)

    def has_come_to(number, time):
        group.folders[number].path.mkdir(parents=True, exist_ok=True)
        group.folders[number].history.write_text(f"time,torque_disc\n1e-4,2.0\n{time!r},1.0\n0.0")  # half a row

    group = replicas.Replicas(folders=[RunFolder(tmp_path)], start=started, slots=2, tolerance=1e-6)
    group.request(4, 1e-3)
    group.pump(busy=True)
    assert list(group.processes) == [1]
    group.pump(busy=True)
    assert list(group.processes) == [1] and group.have_reached() == 0
    has_come_to(1, 1e-3)
    group.pump(busy=True)
    assert list(group.processes) == [1, 2] and group.have_reached() == 1
    group.pump(busy=False)  # this one waits: its core is free
    assert list(group.processes) == [1, 2, 3]
    assert group.share_done(1e-3) == pytest.approx(0.5)
    has_come_to(2, 1e-3)
    has_come_to(3, 1e-3)
    group.request(4, 2e-3)
    group.pump(busy=True)
    sent = [list(group.processes[number].process.stdin) for number in (1, 2, 3)]
    assert sent == [["0.002\n"], [], []]
    assert group.wait(lambda: True) is False


def test_a_replica_waits_at_its_limit_until_it_is_sent_on():
    from types import SimpleNamespace

    from emclutch.simulation.replicas import ReplicaControl

    def at(time):
        return SimpleNamespace(motion=SimpleNamespace(time=time))

    orders = ReplicaControl(1e-3, 5e-6)
    assert not orders(at(0.5e-3)) and not orders(at(0.994e-3))  # however long its own window
    threading.Timer(0.1, orders.receive, ["0.002\n"]).start()
    assert not orders(at(1e-3)) and not orders.reached
    threading.Timer(0.1, orders.receive, ["end\n"]).start()
    assert orders(at(2e-3)) and orders.reached
    stopped = ReplicaControl(1e-3, 5e-6)
    threading.Timer(0.1, stopped.stop).start()
    assert not stopped(at(1e-3)) and stopped.stopped.is_set()
