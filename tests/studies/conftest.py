"""Runs that studies ask for, without the runs."""

import pytest
from stand_in_runs import StandInRuns

from emclutch.studies import tasks as study_tasks


@pytest.fixture
def runs(monkeypatch):
    stand_in = StandInRuns()
    monkeypatch.setattr(study_tasks, "run", stand_in)
    return stand_in
