"""Runs in steel with hysteresis: history goes from time to time, through checkpoints, and flux remains at 0 A."""

from pathlib import Path

import numpy as np
import pytest
from pot_core import pot_core
from sheared_annulus import CELL, same, state

import emclutch
from coupling import CoilField, HysteresisCoilField
from field.section.steel_history import SteelHistory
from geometry.time_profile import TimeProfile

pytestmark = pytest.mark.physics

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
COURSE = TimeProfile((0.0, 1.0, 2.0, 3.0, 4.0), (0.2, 1.0, 0.5, 0.0, -0.5))


@pytest.fixture(scope="module")
def problem():
    return pot_core()


def source(problem, current=COURSE):
    return HysteresisCoilField(problem, 500, current, history=SteelHistory.demagnetised(problem, {"core": 143.0}))


def march(one, times):
    rows = []
    for time in times:
        one.refresh(time)
        rows.append(one.window_part())
    return rows


def test_the_history_goes_on_from_time_to_time(problem):
    """Falling above rising, some flux at 0 A, heat in each step; the same time twice is one step."""
    one = source(problem)
    linkage, rows = [], []
    for time in (0.0, 0.375, 1.0, 2.0, 3.0):
        rows += march(one, [time])
        linkage.append(one.solution.flux_linkage_per_turn)
    assert linkage[3] > 1.002 * linkage[1] and linkage[4] > 1e-3 * linkage[2]
    assert all(row.hysteresis_loss > 0.0 for row in rows)
    again, psi = one.history, one.solution.psi
    one.solved_current = np.inf  # asks for a solve at the same time
    assert one.refresh(3.0) and one.history is again
    assert np.allclose(one.solution.psi, psi, atol=1e-6 * np.abs(psi).max())
    march(one, [3.0001])
    assert one.history is not again and 0.0 < one.window_part().hysteresis_loss < 0.1 * rows[-1].hysteresis_loss


def test_a_first_current_is_that_of_the_curve(problem):
    one, plain = source(problem), CoilField(problem, 500, COURSE)
    one.refresh(0.0)
    plain.refresh(0.0)
    assert np.array_equal(one.solution.psi, plain.solution.psi)


def test_resumed_is_bit_for_bit_what_went_on(problem):
    times = np.linspace(0.0, 4.0, 13)
    whole = source(problem)
    rows = march(whole, times)
    first, second = source(problem), source(problem)
    march(first, times[:8])
    second.restore(first.state())
    assert march(second, times[8:]) == rows[8:]
    assert np.array_equal(second.solution.psi, whole.solution.psi)
    assert source(problem).state() is None


def heat_and_linkage(problem, course, times):
    one = source(problem, course)
    rows = march(one, times)
    return sum(row.hysteresis_loss for row in rows), one.solution.flux_linkage_per_turn


def test_a_pulse_between_two_times_leaves_its_remanence_and_heat(problem):
    """The pulse in one window and one whose steps end at each of its instants: a history has no rate."""
    pulse = TimeProfile((0.0, 0.41, 0.45, 0.49), (0.0, 0.0, 1.0, 0.0))
    heat, linkage = heat_and_linkage(problem, pulse, [0.0, 1.0])
    exact, remanent = heat_and_linkage(problem, pulse, [0.0, 0.45, 1.0])
    assert exact > 0.0 and heat == pytest.approx(exact, rel=1e-6)
    assert remanent > 0.0 and linkage == pytest.approx(remanent, rel=1e-6)


@pytest.mark.parametrize("times", [np.arange(0.0, 2.1, 0.4), [0.0, 0.5, *np.arange(0.981, 1.02, 0.004), 1.5, 2.0]])
def test_the_top_of_a_triangle_is_reached_in_any_window(problem, times):
    """0 to 1 A and back: with the top between two times, and within the tolerance of the last solve before it."""
    triangle = TimeProfile((0.0, 1.0, 2.0), (0.0, 1.0, 0.0))
    heat, linkage = heat_and_linkage(problem, triangle, times)
    exact, remanent = heat_and_linkage(problem, triangle, [0.0, 1.0, 2.0])
    assert heat == pytest.approx(exact, rel=2e-3) and linkage == pytest.approx(remanent, rel=2e-3)


def test_a_turn_after_a_checkpoint_is_not_lost(problem):
    pulse = TimeProfile((0.0, 1.41, 1.45, 1.49), (0.2, 0.2, 1.0, 0.2))
    whole, first, second = (source(problem, pulse) for _ in range(3))
    rows = march(whole, [0.0, 1.0, 2.0])
    march(first, [0.0, 1.0])
    second.restore(first.state())
    assert march(second, [2.0]) == rows[2:] and rows[2].hysteresis_loss > rows[0].hysteresis_loss


@pytest.mark.hard
def test_a_run_with_powder_in_its_field_resumes_and_keeps_a_moment(tmp_path):
    """With back_reaction: switched off, grains keep the moments of the field that remains, bit for bit when resumed."""
    values = {f"output.{key}": value for key, value in CELL["output"].items()} | {
        "effects.hysteresis": {},
        "particles.region": "rim",
        "particles.solid_fraction": 0.03,
        "particles.sector": "6 deg",
        "field.size_factor": 3.0,
        "coil.current": {"times": [0.0, 2e-6, 4e-6], "values": [1.0, 1.0, 0.0]},
        "time.end": "8 us",
    }
    case = emclutch.load_case(QUICKSTART)
    whole = emclutch.run(case.with_values(values), out=tmp_path / "whole").history
    emclutch.run(case.with_values(values | {"time.end": "4 us"}), out=tmp_path / "part")
    emclutch.run(case.with_values(values), out=tmp_path / "part", resume=True)
    saved = state(tmp_path, "whole")
    assert same(saved, state(tmp_path, "part"))
    assert whole["hysteresis_loss"].max() > 0.0 and (whole["hysteresis_loss"] >= 0.0).all()
    assert (whole["feedback_residual"] <= 0.1).all() and np.isfinite(whole["torque_disc"]).all()
    assert np.linalg.norm(saved["magnetic_moment"], axis=1).max() > 0.0
