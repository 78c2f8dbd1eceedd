"""H(B) laws: consistent slope and energy, reference values, faults explained."""

import numpy as np
import pytest

from field import AIR, MU_0, NU_0, LinearLaw, PermeabilityLaw, TableLaw, material, material_names
from field.materials import _STEEL_1010


@pytest.mark.parametrize("name", material_names())
def test_slope_and_energy_belong_to_H(name):
    law = material(name)
    B = np.linspace(0.013, 4.9, 400)
    H, slope = law.H_of_B(B)
    step = 1e-6
    up, down = law.H_of_B(B + step)[0], law.H_of_B(B - step)[0]
    assert np.allclose((up - down) / (2 * step), slope, rtol=2e-3, atol=1e-3 * slope.max())
    energy = (law.energy_density(B + step) - law.energy_density(B - step)) / (2 * step)
    assert np.allclose(energy, H, rtol=1e-5, atol=1e-2)
    assert np.all(slope > 0.0) and np.all(np.diff(H) > 0.0) and law.source
    assert law.H_of_B(np.zeros(1))[0][0] == 0.0 and law.energy_density(np.zeros(1))[0] == 0.0


def test_steel_1010_passes_through_its_table():
    H, B = _STEEL_1010.T
    assert np.allclose(material("steel_1010").H_of_B(B)[0], H, rtol=1e-12)


@pytest.mark.parametrize("name", ["steel_1010", "stainless_430", "vacofer_s2", "team_steel", "dc01", "steel_1008"])
def test_saturated_steel_has_the_slope_of_vacuum(name):
    law = material(name)
    assert np.allclose(law.H_of_B(np.array([8.0, 20.0]))[1], NU_0)
    M = NU_0 * np.array([8.0, 20.0]) - law.H_of_B(np.array([8.0, 20.0]))[0]
    assert M[0] == pytest.approx(M[1]) and 1.2e6 < M[0] < 2.2e6  # the DC01 fit ends at 2.13e6


def test_fitted_permeability_is_the_formula_until_M_is_held():
    law = material("stainless_430")
    B = np.linspace(0.05, 2.2, 50)
    b = B / 1.1
    mu_r = 1 + (274 - 1 + 970 * b) / (1 + 1.2 * b + b**8.3)  # Modelica FluxTubes, X6Cr17
    assert np.allclose(law.H_of_B(B)[0], B / (MU_0 * mu_r), rtol=1e-5)
    assert law.saturation_B() == pytest.approx(2.23, abs=0.01)
    assert material("vacofer_s2").saturation_B() == pytest.approx(1.93, abs=0.01)


def test_air_is_linear():
    H, slope = AIR.H_of_B(np.array([1.0]))
    assert H[0] == pytest.approx(1 / MU_0) and slope[0] == pytest.approx(1 / MU_0)


@pytest.mark.parametrize(
    ("H", "B", "words"),
    [
        ([0, 100, 90, 300], [0, 0.1, 0.2, 0.3], "not monotone: H"),
        ([0, 100, 200, 300], [0, 0.1, 0.1, 0.3], "not monotone: B"),
        ([0, 100, 200, 1e6], [0, 0.1, 0.2, 0.3], "below mu_0"),
        ([0, 100, 200], [0, 0.1, 0.2], "at least 3"),
        ([0, 100, 200, 300], [0, 0.1, 0.2], "one B"),
        ([10, 100, 200, 300], [0, 0.1, 0.2, 0.3], "origin"),
        ([0, 100, np.nan, 300], [0, 0.1, 0.2, 0.3], "finite"),
    ],
)
def test_faulty_table_is_explained(H, B, words):
    with pytest.raises(ValueError, match=words):
        TableLaw(np.array(H), np.array(B), "mine")


def test_other_faults_are_explained():
    with pytest.raises(ValueError, match="at least 1"):
        LinearLaw(0.5)
    with pytest.raises(ValueError, match="steel_1010"):
        material("steel_1011")
    with pytest.raises(ValueError, match="mu_i > 1"):
        PermeabilityLaw(0.5, 1.0, 1.0, 1.0, 8.0)
