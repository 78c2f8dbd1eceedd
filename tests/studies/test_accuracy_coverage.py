"""Intervals of accuracy studies hold the truth: forty made-up devices, each with a study of its own.

What settings are chosen by has noise, and the cheapest of many choices is often one that the noise favours. Coverage of
runs by 200 devices of each kind (``python tests/studies/made_up_devices.py 200``) is 0.96 to 1.00, table in
docs/explanation/accuracy_method.md.
"""

from dataclasses import replace

import numpy as np
import pytest
from made_up_devices import KINDS, Device, Kind, covered

from emclutch.results import setting_errors
from emclutch.studies.accuracy.plan import first_replicas


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    monkeypatch.setattr(setting_errors, "DRAWS", 1024)
    monkeypatch.setattr(setting_errors, "PILOT", 512)


def test_runs_of_forty_devices_hold_the_truth():
    """At the scene's own settings and at those for 10 and 5 %; half widths are a few times the errors, not many."""
    found = [covered(kind, 8, seed) for seed, kind in enumerate(KINDS.values())]
    rows = np.concatenate([rows for one in found for rows in one.values()])
    reached = {target: sum(len(one[target]) for one in found) for target in (0.10, 0.05)}
    assert reached[0.10] >= 30 and reached[0.05] >= 5
    error, half = rows.T
    assert np.mean(error <= half) >= 0.93
    assert np.median(half) <= 6.0 * np.median(error)


def test_orders_that_are_off_are_not_taken_as_exact():
    """True orders half or twice those of theory: the interval at the own settings holds the truth all the same."""
    error, half = covered(Kind(orders=2.0), 12, seed=7)["own"].T
    assert np.mean(error <= half) > 0.9


def test_a_setting_with_a_large_error_is_measured_before_cheaper_ones():
    offers = Device(np.random.default_rng(0)).offers
    room = 90.0
    small = [replace(one, is_large=False) for one in offers]
    assert "grains" not in {name for name, _ in first_replicas(small, 4, room, 1)}
    assert [name for name, _ in first_replicas(offers, 4, room, 1)] == ["grains"]
