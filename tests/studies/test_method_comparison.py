"""DEM against DVI: rows from two runs of one scene."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from emclutch.results.steady_torque import SteadyConditions, steady_torque
from emclutch.studies.method_comparison import compare_methods


def _run(torque, disc, *, dt, missed=0, lock_up=None):
    n = len(torque)
    history = pd.DataFrame({
        "time": 0.1 * np.arange(1, n + 1), "torque_disc": torque, "disc_speed": disc, "rotor_speed": np.full(n, 50.0),
        "steps": np.full(n, 10), "missed_steps": np.full(n, missed),
    })  # fmt: skip
    summary = {"dt": dt, "seconds": {"whole_run": 3.0, "processor": 5.0}, "max_overlap": 0.01, "lock_up_time": lock_up}
    torque = steady_torque(history, SteadyConditions(shear_gap=0.0))
    return SimpleNamespace(history=history, summary=summary, torque=torque)


def test_only_points_run_by_both_methods_are_compared():
    rng = np.random.default_rng(0)
    early, n = 80, 320
    dem_torque = np.r_[np.zeros(early), 2.0 + 0.1 * rng.normal(size=n)]
    dvi_torque = np.r_[np.ones(early), 2.1 + 0.1 * rng.normal(size=n)]
    dem = _run(dem_torque, np.linspace(0.0, 20.0, early + n), dt=1e-6, lock_up=0.4)
    dvi = _run(dvi_torque, np.linspace(0.0, 25.0, early + n), dt=1e-5, missed=1)
    rows = compare_methods([
        ({"contact.method": "dem", "particles.count": 200}, dem),
        ({"contact.method": "dem", "particles.count": 500}, dem),
        ({"contact.method": "dvi", "particles.count": 200}, dvi),
    ])  # fmt: skip
    (row,) = rows
    assert row["particles.count"] == 200 and "contact.method" not in row
    assert row["torque_dem"] == pytest.approx(2.0, abs=0.03)  # without the transient
    assert dem.torque.is_steady and not row["torque_converged_dem"] and not row["torque_converged_dvi"]  # one replica
    assert row["torque_error_dem"] == pytest.approx(0.1 / np.sqrt(n), rel=0.6)
    assert row["torque_difference"] == pytest.approx(0.05, abs=0.015)
    assert row["speed_difference"] == pytest.approx(5.0 / 50.0)
    assert row["missed_steps_dvi"] == pytest.approx(0.1)
    spent = row["processor_to_5_percent_dem"]  # that of the run, times the squares of its error over that of ± 5 %
    assert spent == pytest.approx(5.0 * (1.96 * row["torque_error_dem"] / row["torque_dem"] / 0.05) ** 2, rel=1e-3)


def test_runs_of_different_lengths_are_compared_while_both_go():
    dem = _run(np.ones(100), np.linspace(0.0, 10.0, 100), dt=1e-6)
    dvi = _run(np.ones(50), np.linspace(0.0, 10.0, 100)[:50], dt=1e-6)
    (row,) = compare_methods([({"contact.method": "dem"}, dem), ({"contact.method": "dvi"}, dvi)])
    assert row["speed_difference"] == pytest.approx(0.0, abs=1e-12)
    assert row["torque_difference_bars"] is None  # neither changes, so both errors are unknown
