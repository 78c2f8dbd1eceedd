"""The rise time of a current does not depend on when the run ends."""

import numpy as np
import pandas as pd
import pytest

from emclutch.results.rise_time import rise_times

TAU = 5e-3


def history(end, *, lag=0.0, field_tau=TAU):
    """A coil of 0.9 A in the end and a gap's field of 0.7 T, in 400 windows to `end` [s]."""
    time = np.linspace(0.0, end, 401)[1:]
    field = 0.7 * (1.0 - np.exp(-np.maximum(time - lag, 0.0) / field_tau))
    return pd.DataFrame({"time": time, "current": 0.9 * (1.0 - np.exp(-time / TAU)), "gap_flux_density": field})


@pytest.mark.parametrize("lengths", [1.2, 2.0, 8.0])
def test_current_rises_in_a_time_constant_whenever_the_run_ends(lengths):
    found = rise_times(history(lengths * TAU), 0.9)
    assert found["current_rise_time"] == pytest.approx(TAU, rel=1e-3) and "current_rise_time_note" not in found


def test_a_run_that_ends_before_the_current_has_risen_says_so():
    found = rise_times(history(0.5 * TAU), 0.9)
    assert found["current_rise_time"] is None and found["gap_flux_density_rise_time"] is None
    assert "0.354 A of 0.9 A: run longer than 0.0025 s" in found["current_rise_time_note"]


def test_the_field_has_a_rise_time_once_the_current_is_there():
    early = rise_times(history(2.0 * TAU), 0.9)
    assert early["gap_flux_density_rise_time"] is None
    assert "0.778 A at the end and goes to 0.9 A" in early["gap_flux_density_rise_time_note"]
    late = rise_times(history(8.0 * TAU, lag=1e-3), 0.9)
    assert late["gap_flux_density_rise_time"] == pytest.approx(1e-3 + TAU, rel=1e-3)
    slow = rise_times(history(4.0 * TAU, field_tau=10.0 * TAU), 0.9)  # as behind eddy currents
    assert slow["gap_flux_density_rise_time"] is None
    assert "field of the gap still changes" in slow["gap_flux_density_rise_time_note"]


def test_values_that_are_held_rise_when_they_were_solved_for():
    """Behind eddy currents rows repeat the last step of the field, here for four windows, which costs no accuracy."""
    smooth, names = history(8.0 * TAU), ("current", "gap_flux_density")
    held = smooth.assign(**{name: np.repeat(smooth[name].to_numpy()[::4], 4) for name in names})
    exact, found = rise_times(smooth, 0.9), rise_times(held, 0.9)
    for name in ("current_rise_time", "current_rise_time_90", "gap_flux_density_rise_time"):
        assert found[name] == pytest.approx(exact[name], rel=2e-3)


def test_a_first_window_of_a_time_constant_hides_no_rise():
    """At time 0 there is no row, but the coil is known to begin without current."""
    coarse = history(8.0 * TAU).iloc[49::50]  # each time constant
    assert rise_times(coarse, 0.9)["current_rise_time"] is None
    found = rise_times(coarse, 0.9, begins_off=True)
    assert found["current_rise_time"] == pytest.approx(TAU, rel=0.01)


def test_a_jump_after_a_plateau_is_no_value_that_was_held():
    time = np.linspace(0.01, 1.0, 100)
    table = pd.DataFrame({"time": time, "current": np.where(time < 0.5, 0.1, 1.0), "gap_flux_density": 0.0})
    assert 0.48 < rise_times(table, 1.0)["current_rise_time"] <= 0.5


@pytest.mark.parametrize("final", [0.0, 0.9, -0.9])
def test_a_current_that_is_not_switched_on_has_no_rise(final):
    constant = history(TAU).assign(current=final, gap_flux_density=abs(final))
    found = rise_times(constant.assign(torque_disc=1.0), final)
    assert len(found) == 4 and set(found.values()) == {None}


def test_the_torque_rises_after_the_current():
    """T goes with i^1.3 a millisecond later, and fluctuates by 10 %: its times are those of the law within 5 %."""
    noise = np.random.default_rng(0).normal(1.0, 0.1, 400)
    lagged = history(10.0 * TAU)
    current = np.interp(lagged["time"] - 1e-3, lagged["time"], lagged["current"], left=0.0)
    found = rise_times(lagged.assign(torque_disc=12.0 * noise * (current / 0.9) ** 1.3), 0.9)
    for name, share in (("torque_rise_time", 1.0 - np.exp(-1.0)), ("torque_rise_time_90", 0.9)):
        expected = 1e-3 - TAU * np.log(1.0 - share ** (1.0 / 1.3))
        assert found[name] == pytest.approx(expected, rel=0.05)
    assert found["torque_lag"] == pytest.approx(found["torque_rise_time"] / TAU, rel=1e-3)
    assert found["current_rise_time_90"] == pytest.approx(TAU * np.log(10.0), rel=1e-3)
    early = rise_times(history(2.5 * TAU).assign(torque_disc=np.linspace(0.0, 1.0, 400)), 0.9)
    assert early["torque_rise_time"] is None and "torque still changes" in early["torque_rise_time_note"]
