"""One law for the moment of a grain and the permeability of the powder."""

import numpy as np
import pytest
from scipy.integrate import quad

from field import MU_0, GrainLaw, PowderLaw, ThesisLaw

PHI = [0.0, 0.3, 0.45, 0.6, 0.9]
LAWS = [GrainLaw(999.0, 1.7e6), GrainLaw(99.0), GrainLaw(5.0, 4e5), ThesisLaw(0.3), ThesisLaw(3.0, 1e6)]


@pytest.mark.parametrize(("phi", "mu"), [(0.3, 2.232), (0.45, 3.326), (0.6, 5.183)])
def test_linear_grains_are_maxwell_garnett(phi, mu):
    chi_eff = float(GrainLaw(99.0).chi_eff(phi, np.array(1e4)))
    beta = 99.0 / 102.0
    assert 1 + chi_eff == pytest.approx(1 + 3 * phi * beta / (1 - phi * beta), rel=1e-12)
    assert 1 + chi_eff == pytest.approx(mu, abs=6e-4)  # tests/REFERENCE.md section 3, mu_i = 100
    # a saturable grain at weak field is the same
    assert float(GrainLaw(99.0, 1.7e6).chi_eff(phi, np.array(1e-3))) == pytest.approx(chi_eff, rel=1e-6)


@pytest.mark.parametrize(("H0", "M"), [(1e4, 29908.576), (1e5, 298910.868), (5e5, 1467739.04), (2e6, 1697985.04)])
def test_single_saturating_sphere(H0, M):
    assert float(GrainLaw(999.0, 1.7e6).magnetisation(np.array(H0), 0.0)) == pytest.approx(M, rel=1e-8)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("phi", PHI)
def test_same_magnetisation_from_H_and_from_B(law, phi):
    H = np.logspace(-2, 8, 41)
    M = law.magnetisation(H, phi)
    assert np.allclose(law.from_flux(MU_0 * (H + phi * M), phi)[0], M, rtol=1e-10)
    assert np.allclose(PowderLaw(law).H_of_B(MU_0 * (H + phi * M), phi)[0], H, rtol=1e-8)
    assert np.allclose(phi * M, law.chi_eff(phi, H) * H, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("phi", PHI)
def test_derivatives(law, phi):
    B = np.logspace(-4, 1, 31)
    powder, step = PowderLaw(law), 1e-5 * B
    H, slope = powder.H_of_B(B, phi)
    numeric = (powder.H_of_B(B + step, phi)[0] - powder.H_of_B(B - step, phi)[0]) / (2 * step)
    assert np.allclose(slope, numeric, rtol=1e-6) and np.all(slope > 0.0) and np.all(H > 0.0)
    numeric = (powder.H_of_B(B, phi + 1e-6)[0] - powder.H_of_B(B, phi - 1e-6)[0]) / 2e-6
    assert np.allclose(powder.dH_dphi(B, phi), numeric, rtol=1e-5)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("B", [1e-4, 0.3, 2.0])
def test_energy_density_is_the_integral_of_H(law, B):
    powder = PowderLaw(law)
    integral, _ = quad(lambda b: float(powder.H_of_B(np.array(b), 0.45)[0]), 0.0, B, epsrel=1e-11)
    assert float(powder.energy_density(np.array(B), 0.45)) == pytest.approx(integral, rel=1e-8)


def test_no_powder_is_air():
    H, slope = PowderLaw(GrainLaw(999.0, 1.7e6)).H_of_B(np.array([0.0, 1.0]), 0.0)
    assert np.allclose(H, [0.0, 1.0 / MU_0]) and np.allclose(slope, 1.0 / MU_0)


def test_thesis_law_has_no_demagnetisation():
    assert float(ThesisLaw(0.3).magnetisation(np.array(1e5), 0.45)) == pytest.approx(3e4)


@pytest.mark.parametrize(("chi", "Ms", "word"), [(0.0, None, "chi"), (-1.0, 1e6, "chi"), (100.0, 0.0, "Ms")])
def test_impossible_grains_are_refused(chi, Ms, word):
    with pytest.raises(ValueError, match=word):
        GrainLaw(chi, Ms)
