"""A trial finds the number of threads that is fastest, by the clock of windows and nothing else."""

from types import SimpleNamespace

import pytest

from coupling.window_row import WallClock
from emclutch.simulation.threads import REST, ROUNDS, ThreadTrial


class Machine:
    """Windows whose time depends on the threads that are taken; `seconds` says how long each number takes."""

    def __init__(self, seconds: dict[int, float], most: int = 2) -> None:
        self.seconds, self.taken = seconds, []
        self.reported: list[str] = []
        self.trial = ThreadTrial(most, self.taken.append, self.reported.append)

    def windows(self, count: int) -> None:
        for _ in range(count):
            seconds = self.seconds[self.trial.threads]
            self.trial(None, SimpleNamespace(seconds=WallClock(None, 0.3 * seconds, 0.7 * seconds, seconds, seconds)))


@pytest.mark.parametrize(("seconds", "chosen"), [({1: 1.0, 2: 0.6}, 2), ({1: 1.0, 2: 1.8}, 1), ({1: 1.0, 2: 0.99}, 1)])
def test_what_is_faster_is_taken_and_ties_go_to_fewer(seconds, chosen):
    machine = Machine(seconds)
    machine.windows(2 * ROUNDS)
    assert machine.trial.threads == machine.taken[-1] == chosen
    assert len(machine.reported) == 1 and machine.reported[0].startswith(f"{chosen} thread")


def test_many_cores_are_tried_by_powers_of_two():
    machine = Machine({1: 1.0, 2: 0.6, 4: 0.4, 6: 0.5}, most=6)
    assert machine.trial.numbers == [1, 2, 4, 6]
    machine.windows(4 * ROUNDS)
    assert machine.trial.threads == 4


def test_a_core_that_is_taken_later_is_noticed_and_one_that_is_free_again_too():
    machine = Machine({1: 1.0, 2: 0.6})
    trial, rest = 2 * ROUNDS, 2 * ROUNDS * REST
    machine.windows(trial)
    for two, chosen in (2.5, 1), (0.6, 2):
        machine.seconds = {1: 1.0, 2: two}
        machine.windows(rest + trial)
        assert machine.trial.threads == chosen
    assert [text[:8] for text in machine.reported] == ["2 thread", "1 thread", "2 thread"]


def test_what_does_not_pay_is_taken_in_one_window_of_forty():
    machine = Machine({1: 1.0, 2: 8.0})
    seen = []
    for _ in range(4 * ROUNDS * (REST + 1)):
        seen.append(machine.trial.threads)
        machine.windows(1)
    assert seen.count(2) == 2 * ROUNDS


def test_one_window_that_is_held_up_decides_nothing():
    """By a kernel that is compiled, or by another program."""
    machine = Machine({1: 1.0, 2: 100.0})
    machine.windows(2)
    machine.seconds = {1: 1.0, 2: 0.6}
    machine.windows(2 * ROUNDS - 2)
    assert machine.trial.threads == 2
