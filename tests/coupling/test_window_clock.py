"""Seconds of a window by part: what compiling takes is none of the field's, nor of the grains'."""

from types import SimpleNamespace

import numpy as np
import pytest

from coupling import window_budget
from coupling.window_budget import WindowBudget


def test_compiling_is_booked_for_no_part(monkeypatch):
    now, compiled = [0.0], [0.0]
    monkeypatch.setattr(window_budget, "compile_seconds", lambda: compiled[0])
    monkeypatch.setattr(window_budget, "perf_counter", lambda: now[0])
    grains = SimpleNamespace(angular_momentum_z=lambda: 0.0, position=np.zeros((1, 3)))
    motion = SimpleNamespace(grains=grains, gravity=None, gravity_now=None, box=None, gap_box=None)
    budget = WindowBudget(SimpleNamespace(motion=motion, effects=(), source=None))
    budget.clock("field")
    now[0], compiled[0] = 50.0, 40.0
    budget.clock("contact")
    now[0] = 52.0
    budget.clock(None)
    assert budget._seconds["field"] == pytest.approx(10.0) and budget._seconds["contact"] == pytest.approx(2.0)
