"""The machine's speed is measured once a day, and a core that others use is told."""

import json
import time

import pytest

from emclutch.simulation.forecast import machine_speed
from emclutch.simulation.forecast.machine_speed import MachineSpeed, cores_at_hand


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """A cache of its own, and how often a probe was run."""
    monkeypatch.setenv("EMCLUTCH_CACHE", str(tmp_path / "cache"))
    calls = []

    def probe(call, repeats=0):
        calls.append(call)
        call()
        return 2.0 * machine_speed.LOOPS_S

    monkeypatch.setattr(machine_speed, "least_seconds", probe)
    machine_speed._speed_of_today.cache_clear()
    yield calls
    machine_speed._speed_of_today.cache_clear()


def speed_again():
    machine_speed._speed_of_today.cache_clear()  # as a new process
    return machine_speed.machine_speed()


def test_the_speed_is_measured_once_and_kept(fresh):
    assert speed_again().loops == 2.0 and len(fresh) == 2
    assert speed_again().loops == 2.0 and len(fresh) == 2


@pytest.mark.parametrize(
    "change", [{"cpu": "another"}, {"measured": time.time() - 1e6}, {"loops": -1.0}, {"loops": "x"}]
)
def test_another_machine_or_another_day_is_measured_anew(fresh, change):
    speed_again()
    path = machine_speed.speed_file()
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert speed_again().loops == 2.0 and len(fresh) == 4


def test_a_cache_that_cannot_be_written_is_no_error(fresh, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("EMCLUTCH_CACHE", str(tmp_path / "file" / "cache"))
    assert speed_again().loops == 2.0
    assert speed_again().loops == 2.0 and len(fresh) == 4


def test_a_probe_that_works_twice_as_much_takes_longer():
    probe = machine_speed._pairs_probe()
    assert machine_speed.least_seconds(lambda: (probe(), probe(), probe())) > 1.5 * machine_speed.least_seconds(probe)


def test_threads_gain_less_than_their_number_and_only_on_cores_that_are_there():
    machine = MachineSpeed(1.0, 1.0, cores=4, taken=0.0)
    gains = [machine.gain(n) for n in (1, 2, 4, 8)]
    assert gains[0] == 1.0 and gains[1] == pytest.approx(1.4, abs=0.05)
    assert gains[0] < gains[1] < gains[2] < 4.0 and gains[3] == gains[2]


@pytest.mark.parametrize("threads", [1.0, 2.0])
def test_load_of_others_is_what_this_process_has_not_caused(threads, monkeypatch):
    wall, processor = machine_speed._SINCE
    monkeypatch.setattr(machine_speed.time, "perf_counter", lambda: wall + 3600.0)
    monkeypatch.setattr(machine_speed.time, "process_time", lambda: processor + threads * 3600.0)
    monkeypatch.setattr(machine_speed.os, "getloadavg", lambda: (threads + 0.6, 0.0, 0.0))
    monkeypatch.setattr(machine_speed, "_taken_now", lambda moment: float("inf"))
    found = machine_speed.machine_speed()
    assert found.taken == pytest.approx(0.6) and found.cores == cores_at_hand()
    monkeypatch.setattr(machine_speed.os, "getloadavg", lambda: (0.2, 0.0, 0.0))
    assert machine_speed.machine_speed().taken == 0.0


@pytest.mark.parametrize(("busy", "taken"), [(0.0, 0.0), (0.1, 0.5), (10.0, 1.8)])
def test_what_ended_before_is_not_counted(busy, taken, monkeypatch):
    """``busy``: seconds of all cores within the fifth of a second, of which the system's load says 1.8 cores."""
    clock = iter([0.0, busy])
    monkeypatch.setattr(machine_speed, "_busy_seconds", lambda: next(clock))
    monkeypatch.setattr(machine_speed.time, "process_time", lambda: 0.0)
    monkeypatch.setattr(machine_speed, "_own_load", lambda: 0.0)
    monkeypatch.setattr(machine_speed.os, "getloadavg", lambda: (1.8, 0.0, 0.0))
    machine_speed._taken_now.cache_clear()
    assert machine_speed._taken() == pytest.approx(taken, rel=0.2)
    machine_speed._taken_now.cache_clear()
