"""Runs that studies ask for, without the runs."""

import pytest
from stand_in_runs import StandInRuns

from emclutch.studies import point, study, task_process


@pytest.fixture
def runs(monkeypatch, here):
    stand_in = StandInRuns()
    monkeypatch.setattr(point, "run", stand_in)
    return stand_in


@pytest.fixture
def here(monkeypatch):
    """Executors do tasks in this process, where a stand-in is found, and not in child processes."""
    monkeypatch.setattr(study, "perform_call", task_process.answer)
