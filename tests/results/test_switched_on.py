"""What is said of a run that is switched on: its rise times first, and nothing that a longer run would not give."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from written_run import written_run

from emclutch.results import load_result
from emclutch.results.changing_drive import changing_drive
from emclutch.results.report.report import Mark
from emclutch.results.rise_time import in_words, rise_times
from emclutch.results.steady_torque import SteadyConditions, steady_torque
from emclutch.scene.torque_target import TorqueTarget
from emclutch.simulation.torque_trigger import how_it_ended

TAU = 5e-3
GAP = SteadyConditions(shear_gap=1e-3, shear_radius=10e-3)


def history(end, tau=TAU, windows=400):
    """i = 1 A (1 - exp(-t/tau)), and a torque of 2 N m i that fluctuates by 10 %."""
    time = np.linspace(0.0, end, windows + 1)[1:]
    current = 1.0 - np.exp(-time / tau)
    noise = np.random.default_rng(1).normal(1.0, 0.1, windows)
    return pd.DataFrame({
        "time": time, "current": current, "gap_flux_density": 0.7 * current, "torque_disc": 2.0 * current * noise,
        "rotor_speed": 100.0, "disc_speed": 0.0,
    })  # fmt: skip


def test_the_rise_of_current_and_torque_is_said_with_its_final_values():
    run = history(8.0 * TAU)
    lines = in_words({"final_current": 1.0} | rise_times(run, 1.0, begins_off=True))
    assert lines[0] == "Current: 63 % of its final 1 A at 5 ms, 90 % at 11.5 ms"
    assert lines[1].startswith(("Torque: 63 % of its final 1.9", "Torque: 63 % of its final 2"))
    assert " ms to " in lines[1] and "times as long as the current" in lines[2]
    assert len(lines) == 4 and lines[3].startswith("One replica: the intervals of the torque's rise leave out")
    four = in_words({"final_current": 1.0} | rise_times(run, 1.0, begins_off=True, replicas=[run] * 3))
    assert len(four) == 3
    early = in_words({"final_current": 1.0} | rise_times(history(5.0 * TAU), 1.0, begins_off=True))
    assert early[-1].startswith("The run is too short for the torque to reach its final value: time.end = 3")
    short = in_words({"final_current": 1.0} | rise_times(history(0.5 * TAU), 1.0, begins_off=True))
    assert short[0].endswith("is not over at the end of the run: the current went up to 0.393 A of 1 A; run longer")
    assert in_words({"final_current": 1.0} | rise_times(run.assign(current=1.0), 1.0)) == []


@pytest.mark.parametrize("tau", [TAU, 4.0 * TAU])
def test_no_longer_run_is_advised_where_the_drive_changes(tau):
    """Within 20 ms the current of tau = 5 and 20 ms changes by 12 and 24 % in the second half."""
    run = history(20e-3, tau)
    assert "the current changes by" in changing_drive(run)
    torque = steady_torque(run, GAP)
    assert not torque.converged and torque.missing is None
    assert torque.in_words().startswith("not converged: the current changes by") and not torque.remedy
    ended = how_it_ended(torque, run, TorqueTarget(relative=0.02))
    assert not ended["reached"] and "raise" not in ended["reason"] and "longer" not in ended["reason"]
    steady = steady_torque(run.assign(current=1.0, torque_disc=np.linspace(0.0, 1.0, 400)), GAP)
    assert not changing_drive(run.assign(current=1.0)) and "changes by" not in steady.reason


def test_a_speed_that_changes_is_a_drive_that_changes():
    run = history(8.0 * TAU).assign(current=1.0)
    assert not changing_drive(run)
    assert "speed of the rotor" in changing_drive(run.assign(rotor_speed=np.linspace(0.0, 100.0, 400)))
    assert not changing_drive(run.assign(rotor_speed=np.minimum(np.linspace(0.0, 300.0, 400), 100.0)))


@pytest.mark.parametrize("changes", [False, True], ids=["steady in the end", "still changing"])
def test_the_verdict_begins_with_the_rise_times(tmp_path, changes):
    """A torque of which nothing is known, at a current that has settled and at one that has not."""
    folder = written_run(tmp_path / "run", windows=40)
    table = pd.read_csv(folder.history)
    current = 1.0 - np.exp(-table["time"] / (15e-3 if changes else 1e-3))
    table.assign(current=current).to_csv(folder.history, index=False)
    torque = load_result(folder.path).torque
    torque = replace(torque, start=20e-3, converged=False, steady_alone=False, remedy="run longer")
    rise = {"final_current": 1.0, "current_rise_time": 15e-3, "current_rise_time_90": 34.5e-3, "torque_after_rise": 2.0,
            "torque_rise_time": 20e-3, "torque_rise_time_90": None, "torque_lag": 4.0 / 3.0}  # fmt: skip
    folder.write_summary(folder.read_summary() | rise | {"torque": torque.as_dict()})
    said = load_result(folder.path).verdict
    lines = [one.text for one in said]
    assert said[0].mark is Mark.GOOD and lines[0] == "Current: 63 % of its final 1 A at 15 ms, 90 % at 34.5 ms."
    assert lines[1] == "Torque: 63 % of its final 2 N m at 20 ms, not 90 %."
    advice = any("run longer" in line or "run to" in line for line in lines)
    assert advice != changes, lines
    assert changes == any("No steady torque on the disc: the current changes by" in line for line in lines)
