"""Runs that are spoiled on purpose, one way for each invariant: a test of hard scenes sees each of them fail.

Each way is what the defect would leave behind that the invariant is there for: a lost grain, energy from nowhere, a
torque that is not booked, a moment of the wrong size.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from math import pi

import numpy as np
from finished_run import FinishedRun
from invariants import energy_through, torque_scale


def spoiled(run: FinishedRun, invariant: str) -> FinishedRun:
    """A copy of the run in which `invariant` is broken."""
    broken = copy.deepcopy(run)
    WAYS[invariant](broken)
    return broken


def _add(run: FinishedRun, column: str, value: float) -> None:
    """To the last window."""
    run.history[column] = run.history[column].astype(float)
    run.history.loc[run.history.index[-1], column] += value


def _a_number_missing(run: FinishedRun) -> None:
    _add(run, "max_speed", np.nan)


def _a_grain_lost(run: FinishedRun) -> None:
    run.ids = run.ids[:-1]


def _a_grain_pressed_in(run: FinishedRun) -> None:
    _add(run, "max_overlap", 1.0)


def _a_grain_thrown(run: FinishedRun) -> None:
    _add(run, "max_speed", 1e4)


def _energy_from_nowhere(run: FinishedRun) -> None:
    _add(run, "kinetic_energy", 10.0 * energy_through(run))


def _work_not_booked(run: FinishedRun) -> None:
    _add(run, "energy_residual", energy_through(run))


def _a_loss_that_gives(run: FinishedRun) -> None:
    _add(run, "dissipated_sliding", -2.0 * energy_through(run))


def _a_torque_not_booked(run: FinishedRun) -> None:
    _add(run, "torque_residual", torque_scale(run))


def _tolerances_missed(run: FinishedRun) -> None:
    for name in ("field_residual", "moment_residual", "feedback_residual"):
        if name in run.history:
            _add(run, name, 2.0)
    if "missed_steps" in run.history:
        run.history["missed_steps"] = run.history["steps"]


def _beyond_saturation(run: FinishedRun) -> None:
    volume = 4.0 / 3.0 * pi * run.radius[0] ** 3
    run.dipole[0] = (0.0, 0.0, 2.0 * run.case.scene.particles.saturation * volume)


def _no_moments(run: FinishedRun) -> None:
    run.moment[:] = 0.0


def _moments_that_stay(run: FinishedRun) -> None:
    _add(run, "flux_linkage", run.history["flux_linkage"].abs().max())


def _a_torque_of_the_field(run: FinishedRun) -> None:
    parts = [name for name in run.history if name.startswith("torque_field_")]
    _add(run, "torque_field", 2.0 * run.history[parts].abs().sum(axis=1).max())


def _a_current_too_large(run: FinishedRun) -> None:
    _add(run, "current", 1e6)


def _a_supply_that_gives_more(run: FinishedRun) -> None:
    run.history["coil_supplied"] += run.history["coil_supplied"].abs().sum() + run.history["field_energy"].max()


def _no_flux(run: FinishedRun) -> None:
    run.history["flux_linkage"] = 0.0


def _flux_that_stays(run: FinishedRun) -> None:
    run.history["flux_linkage"] = run.history["flux_linkage"].iloc[0]


def _sliding_without_friction(run: FinishedRun) -> None:
    _add(run, "dissipated_sliding", run.history["dissipated"].sum())


def _a_shaft_pushed(run: FinishedRun) -> None:
    given = run.history["torque_disc"].abs() * np.diff(run.history["time"], prepend=0.0)
    free = run.case.scene.motion.disc.free
    _add(run, "disc_speed", given.sum() / free.inertia + 1e-9 * abs(free.initial_speed))


def _never_at_rest(run: FinishedRun) -> None:
    _add(run, "kinetic_energy", 1e3 * energy_through(run))


def _half_of_it_lost(run: FinishedRun) -> None:
    run.history["kinetic_energy"] *= np.linspace(1.0, 0.5, run.windows)


def _a_grain_moved(run: FinishedRun) -> None:
    run.position[0] += 2.0 * run.radius[0]


WAYS: dict[str, Callable[[FinishedRun], None]] = {
    "finite": _a_number_missing,
    "grains_kept": _a_grain_lost,
    "overlap": _a_grain_pressed_in,
    "speed": _a_grain_thrown,
    "stored_energy": _energy_from_nowhere,
    "energy_balance": _work_not_booked,
    "losses": _a_loss_that_gives,
    "torque_balance": _a_torque_not_booked,
    "residuals": _tolerances_missed,
    "magnetisation": _beyond_saturation,
    "magnetised": _no_moments,
    "field_gone": _moments_that_stay,
    "field_torque": _a_torque_of_the_field,
    "current": _a_current_too_large,
    "coil_energy": _a_supply_that_gives_more,
    "flux_linkage": _no_flux,
    "odd_in_current": _flux_that_stays,
    "frictionless": _sliding_without_friction,
    "shaft_momentum": _a_shaft_pushed,
    "at_rest": _never_at_rest,
    "kept_energy": _half_of_it_lost,
    "like_its_image": _a_grain_moved,
    "on_axis": _a_grain_moved,
}
