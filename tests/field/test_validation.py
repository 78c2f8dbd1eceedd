"""Measurements and field solutions of others: Roters' plunger magnet, and the solenoid of the Modelica library.

The data, with their sources: cases/validation. All positions, converged: tests/benchmarks/validation_devices.py.
"""

import numpy as np
import pytest
from validation_devices import columns, drawn_at, largest_flux, pull, switched_on

from field.coil.inductance import apparent_inductance
from field.section.maxwell_force import axial_force

pytestmark = pytest.mark.physics


def test_roters_plunger_is_pulled_as_measured_and_as_femm_says():
    """Near the beginning, at the largest force, and at the end of the stroke; s = 0 is left out: codes differ there."""
    data = columns("roters.csv")
    for s in (0.3, 0.8, 1.2):
        row = np.argmin(np.abs(data["s [in]"] - s))
        force = pull(drawn_at("roters", s, **{"field.size_factor": 2.0}).solve_at_peak(None))
        assert force == pytest.approx(data["FEMM [N]"][row], rel=0.04), s
        assert force == pytest.approx(data["measured [N]"][row], rel=0.12), s


@pytest.fixture(scope="module")
def solenoids():
    """Coil and field at three air gaps [mm]."""
    coils = {x: drawn_at("solenoid", x) for x in (0.5, 2.0, 5.0)}
    return {x: (coil, coil.solve_at_peak(None)) for x, coil in coils.items()}


def test_modelicas_solenoid_has_its_force_flux_and_inductance(solenoids):
    data = columns("solenoid.csv")
    for x, (coil, field) in solenoids.items():
        row = np.argmin(np.abs(data["x [mm]"] - x))
        assert pull(field) == pytest.approx(data["force [N]"][row], rel=0.06), x
        assert 1e6 * largest_flux(field, 5e-3) == pytest.approx(data["flux [uWb]"][row], rel=0.03), x
        assert 1e3 * apparent_inductance(field, coil.turns) == pytest.approx(data["inductance [mH]"][row], rel=0.03), x


def test_a_saturated_armature_is_pulled_by_the_coenergy(solenoids):
    """At 0.5 mm -(I^2/2) dL/dx is half of the force, virtual work all of it."""
    force = axial_force(solenoids[0.5][1], "disc", virtual_work=True)
    assert force.virtual_work == pytest.approx(force.maxwell_stress, rel=1e-3)


def test_its_current_rises_as_the_library_says(solenoids):
    data = columns("solenoid_switch_on.csv")
    currents = switched_on(solenoids[5.0][0], 1e-3 * data["t [ms]"], 10.0, 12.0)
    assert currents == pytest.approx(data["current [A]"], rel=0.01)
