"""A trial finds the number of threads that is fastest, by the clock of windows and nothing else."""

import pytest

from emclutch.simulation.thread_trial import AGAIN_S, AGAIN_WINDOWS, ROUNDS, ThreadTrial

WINDOW = 1e-4  # [s]


class Machine:
    """Windows whose time depends on the threads that are taken; `seconds` says how long each number takes."""

    def __init__(self, seconds: dict[int, float], most: int = 2) -> None:
        self.seconds, self.kernels, self.now, self.clock, self.taken = seconds, 0, 0.0, 0.0, []
        self.told: list[str] = []
        self.trial = ThreadTrial(
            most, self.taken.append, lambda: self.kernels, self.told.append, clock=lambda: self.clock
        )

    def windows(self, count: int) -> None:
        for _ in range(count):
            seconds = self.seconds[self.trial.threads]
            self.now, self.clock = self.now + WINDOW, self.clock + seconds
            self.trial(None, {"time": self.now, "wall_contact": 0.7 * seconds, "wall_magnetic": 0.3 * seconds})


@pytest.mark.parametrize(("seconds", "chosen"), [({1: 1.0, 2: 0.6}, 2), ({1: 1.0, 2: 1.8}, 1), ({1: 1.0, 2: 0.99}, 1)])
def test_what_is_faster_is_taken_and_ties_go_to_fewer(seconds, chosen):
    machine = Machine(seconds)
    machine.windows(1 + 2 * ROUNDS)
    assert machine.trial.threads == machine.taken[-1] == chosen
    assert len(machine.told) == 1 and machine.told[0].startswith(f"threads: {chosen} ")


def test_many_cores_are_tried_by_powers_of_two():
    machine = Machine({1: 1.0, 2: 0.6, 4: 0.4, 6: 0.5}, most=6)
    assert machine.trial.numbers == [1, 2, 4, 6]
    machine.windows(1 + 4 * ROUNDS)
    assert machine.trial.threads == 4


def test_a_core_that_is_taken_later_is_noticed():
    machine = Machine({1: 1.0, 2: 0.6})
    machine.windows(1 + 2 * ROUNDS)
    machine.seconds = {1: 1.0, 2: 2.5}
    machine.windows(int(max(AGAIN_S, AGAIN_WINDOWS)) + 1 + 2 * ROUNDS)
    assert machine.trial.threads == 1 and len(machine.told) == 1


def test_trials_become_rare_where_nothing_changes():
    machine = Machine({1: 1.0, 2: 8.0})
    machine.windows(1000)
    assert machine.trial.threads == 1
    assert machine.taken.count(2) == 5  # a window of each trial: at the start, after 60, 180, 420, 900


def test_a_window_that_compiles_measures_nothing():
    machine = Machine({1: 1.0, 2: 0.6})
    machine.windows(1)
    machine.kernels, machine.seconds = 3, {1: 1e-3, 2: 100.0}
    machine.windows(1)
    machine.seconds = {1: 1.0, 2: 0.6}
    machine.windows(2 * ROUNDS)
    assert machine.trial.threads == 2
