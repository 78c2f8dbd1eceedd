"""Forces and torques on magnetised grains: closed forms and the one law for moment and permeability."""

import numpy as np
import pytest

from coupling import moments
from coupling.effects import body_torque, gradient_force
from field import GrainLaw, RadialField, loop_field

MU_0 = 4e-7 * np.pi


def test_force_on_a_small_sphere_on_the_axis_of_a_loop():
    """a = 0.5 mm, mu_r = 1000, loop R = 50 mm, 1000 A-turns, z = 25 mm: F = -2.41829e-6 N (exact dipole limit)."""
    a, R, z, NI = 0.5e-3, 0.05, 0.025, 1000.0
    # on the axis: H_z = N I R^2/(2 (R^2+z^2)^1.5), dH_z/dz and dH_x/dx = -1/2 dH_z/dz from its derivative
    H_z = NI * R**2 / (2 * (R**2 + z**2) ** 1.5)
    slope = -3 * z / (R**2 + z**2) * H_z
    H = np.array([[0.0, 0.0, H_z]])
    grad = np.diag([-0.5 * slope, -0.5 * slope, slope])[None]
    m = moments(GrainLaw(999.0), H, None, np.array([4 / 3 * np.pi * a**3]))
    assert gradient_force(m, grad)[0, 2] == pytest.approx(-2.41829e-6, rel=1e-5)


def test_loop_gradient_by_differences_gives_the_same_force():
    a, R, z = 0.5e-3, 0.05, 0.025
    step = 1e-5
    up, down = (loop_field(R, 1000.0, 0.0, z + s)[1] for s in (step, -step))
    H_z = float(loop_field(R, 1000.0, 0.0, z)[1])
    m = moments(GrainLaw(999.0), np.array([[0, 0, H_z]]), None, np.array([4 / 3 * np.pi * a**3]))
    assert MU_0 * m[0, 2] * (up - down) / (2 * step) == pytest.approx(-2.41829e-6, rel=1e-4)


def test_isotropic_grains_feel_no_body_torque():
    rng = np.random.default_rng(0)
    H = rng.normal(size=(50, 3)) * 1e5
    m = moments(GrainLaw(200.0, 1.3e6), H, np.full(50, 0.4), np.full(50, 1e-12))
    scale = MU_0 * np.linalg.norm(m, axis=1) * np.linalg.norm(H, axis=1)
    assert np.abs(body_torque(m, H)).max() < 1e-15 * scale.max()


def test_hoop_terms_of_a_moment_across_the_radial_field():
    """F_phi = mu_0 m_phi H_r/r and F_r = mu_0 m_r dH_r/dr at a point off the x axis."""
    r, angle = 0.04, 0.7
    position = np.array([[r * np.cos(angle), r * np.sin(angle), 0.01]])
    e_r = np.array([np.cos(angle), np.sin(angle), 0.0])
    e_phi = np.array([-np.sin(angle), np.cos(angle), 0.0])
    _, grad = RadialField(1e5, 0.04).sample(position)
    force = gradient_force((2e-6 * e_r + 3e-6 * e_phi)[None], grad)[0]
    assert force @ e_phi == pytest.approx(MU_0 * 3e-6 * 1e5 / r, rel=1e-12)
    assert force @ e_r == pytest.approx(-MU_0 * 2e-6 * 1e5 / r, rel=1e-12)


@pytest.mark.parametrize("phi", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("H", [1e3, 1e5, 1e6])
def test_moment_of_the_grains_and_permeability_of_the_powder_are_one_law(phi, H):
    """n m = chi_eff H with n grains a volume, whatever H: B from the grains equals B of the field's powder law."""
    from field import PowderLaw

    law = GrainLaw(200.0, 1.3e6)
    m = moments(law, np.array([[0, 0, H]]), np.array([phi]), np.array([1.0]))[0, 2]
    B = MU_0 * (H + phi * m)
    assert PowderLaw(law).H_of_B(np.array([B]), phi)[0] == pytest.approx(H, rel=1e-9)


def test_no_field_no_moment():
    m = moments(GrainLaw(200.0, 1.3e6), np.zeros((3, 3)), np.full(3, 0.3), np.ones(3))
    assert np.array_equal(m, np.zeros((3, 3)))
