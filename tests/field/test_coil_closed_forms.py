"""Closed forms of coils in air against reference numbers and against each other."""

import numpy as np
import pytest
from closed_forms import loop_field, rectangular_coil_field, solenoid_axis_field


@pytest.mark.parametrize(
    ("r", "z", "H_r", "H_z"),
    [
        (0.0, 0.0, 0.0, 10.0),
        (0.0, 0.025, 0.0, 7.155417528),
        (0.0, 0.05, 0.0, 3.535533906),
        (0.0, 0.1, 0.0, 0.8944271910),
        (0.02, 0.01, 1.4385529216, 10.3855654981),
        (0.04, 0.005, 6.681998494, 18.793637009),
    ],
)
def test_circular_loop(r, z, H_r, H_z):
    assert np.allclose(loop_field(0.05, 1.0, r, z), (H_r, H_z), rtol=1e-9, atol=1e-14)


def test_loop_is_smooth_where_the_general_form_cancels():
    z = 0.02
    H_r = loop_field(0.05, 1.0, np.array([1e-8, 1e-5, 1.3e-4]), z)[0]
    slope = 0.75 * 0.05**2 * z / (0.05**2 + z**2) ** 2.5
    assert np.allclose(H_r, slope * np.array([1e-8, 1e-5, 1.3e-4]), rtol=1e-4)


@pytest.mark.parametrize(("z", "H"), [(0.0, 9284.766909), (0.025, 8735.518745), (0.05, 4902.903378), (0.1, 313.756049)])
def test_current_sheet_solenoid(z, H):
    assert float(solenoid_axis_field(0.02, 0.1, 1000.0, z)) == pytest.approx(H, rel=1e-9)


def test_thin_rectangular_coil_is_the_solenoid():
    z = np.array([0.0, 0.025])
    H_z = rectangular_coil_field((0.02 - 1e-7, 0.02 + 1e-7), (-0.05, 0.05), 1000.0, 0.0, z)[1]
    assert np.allclose(H_z, solenoid_axis_field(0.02, 0.1, 1000.0, z), rtol=1e-6)
