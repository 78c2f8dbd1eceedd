"""Saturation at a temperature: that of iron as measured, and laws that scale with it."""

import numpy as np
import pytest

from field import NU_0, FroehlichLaw, LinearLaw, TableLaw, material
from field.laws.pinning import Pinning
from field.laws.table_end import TableEnd
from field.laws.temperature import ScaledLaw, iron_saturation, saturation_ratio


def test_iron_saturates_as_measured():
    """J. Crangle, G. M. Goodman, Proc. R. Soc. A 321 (1971) 477, to 1 %."""
    measured = {293.0: 217.6 / 221.7, 300.0: 0.980, 500.0: 0.943, 700.0: 0.876}
    assert [iron_saturation(T - 273.15) for T in measured] == pytest.approx(list(measured.values()), rel=0.01)
    assert saturation_ratio(20.0) == 1.0 and saturation_ratio(200.0) == pytest.approx(0.9716, abs=1e-4)


def test_a_warm_law_has_the_magnetisation_and_the_energy_of_its_saturation():
    """Froehlich's law is that of m Ms; of a table M(m H) = m M(H), and so are its end and its loop."""
    m, B, cold = saturation_ratio(200.0), np.linspace(0.0, 4.0, 401), material("steel_1010")
    warm, exact = ScaledLaw.of(FroehlichLaw(200.0, 1.3e6), m), FroehlichLaw(200.0, 1.3e6 * m)
    np.testing.assert_allclose(warm.H_of_B(B), exact.H_of_B(B), rtol=1e-10)
    np.testing.assert_allclose(warm.energy_density(B), exact.energy_density(B), rtol=1e-9)
    steel = ScaledLaw.of(cold, m)
    np.testing.assert_allclose(NU_0 * m * B - steel.H_of_B(m * B)[0], m * (NU_0 * B - cold.H_of_B(B)[0]), rtol=1e-12)
    assert ScaledLaw.of(cold, 1.0) is cold and ScaledLaw.of(LinearLaw(50.0), m) == LinearLaw(50.0)
    cells = Pinning.of(cold, 150.0)
    loop = Pinning(cells.stiffness, m * cells.reach)
    assert loop.remanence(steel) == pytest.approx(m * cells.remanence(cold), rel=1e-9)
    table = TableLaw(np.array([0.0, 100.0, 200.0, 400.0]), np.array([0.0, 0.5, 0.8, 1.0]))
    assert TableEnd.of(ScaledLaw.of(table, m)).B == pytest.approx(m)
