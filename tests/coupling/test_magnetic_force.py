"""Forces and torques on magnetised grains: closed forms and the one law for moment and permeability."""

import numpy as np
import pytest
from closed_forms import loop_field

from coupling import moments
from coupling.effects import body_torque, gradient_force
from field import GrainLaw, RadialField

pytestmark = pytest.mark.physics

MU_0 = 4e-7 * np.pi


def test_force_on_a_small_sphere_on_the_axis_of_a_loop():
    """a = 0.5 mm, mu_r = 1000, loop R = 50 mm, 1000 A-turns, z = 25 mm: F = -2.41829e-6 N (exact dipole limit)."""
    a, R, z, NI = 0.5e-3, 0.05, 0.025, 1000.0
    # on the axis: H_z = N I R^2/(2 (R^2+z^2)^1.5), dH_z/dz and dH_x/dx = -1/2 dH_z/dz from its derivative
    H_z = NI * R**2 / (2 * (R**2 + z**2) ** 1.5)
    slope = -3 * z / (R**2 + z**2) * H_z
    H = np.array([[0.0, 0.0, H_z]])
    grad = np.diag([-0.5 * slope, -0.5 * slope, slope])[None]
    m = moments(GrainLaw(999.0), H, np.array([4 / 3 * np.pi * a**3]))
    assert gradient_force(m, grad)[0, 2] == pytest.approx(-2.41829e-6, rel=1e-5)


def test_loop_gradient_by_differences_gives_the_same_force():
    a, R, z = 0.5e-3, 0.05, 0.025
    step = 1e-5
    up, down = (loop_field(R, 1000.0, 0.0, z + s)[1] for s in (step, -step))
    H_z = float(loop_field(R, 1000.0, 0.0, z)[1])
    m = moments(GrainLaw(999.0), np.array([[0, 0, H_z]]), np.array([4 / 3 * np.pi * a**3]))
    assert MU_0 * m[0, 2] * (up - down) / (2 * step) == pytest.approx(-2.41829e-6, rel=1e-4)


def test_body_torque_is_the_work_of_turning_a_moment():
    """T . n = -dU/dangle about any axis n, with U = -mu_0 m . H, of moments that are not along H."""
    rng = np.random.default_rng(0)
    H, m, axis = rng.normal(size=(3, 50, 3)) * np.array([1e5, 1e-6, 1.0])[:, None, None]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    angle = 1e-4

    def energy(turn):  # Rodrigues
        along = np.sum(m * axis, axis=1)[:, None] * axis
        turned = along + np.cos(turn) * (m - along) + np.sin(turn) * np.cross(axis, m)
        return -MU_0 * np.sum(turned * H, axis=1)

    work = -(energy(angle) - energy(-angle)) / (2.0 * angle)
    np.testing.assert_allclose(np.sum(body_torque(m, H) * axis, axis=1), work, atol=1e-7 * np.abs(work).max())


def test_moments_of_isotropic_grains_solve_their_law_along_the_field():
    """m = V M(H_in) H/|H| with H_in = |H| - M/3, by bisection; so the field turns no grain."""
    chi, Ms, volume = 200.0, 1.3e6, 1e-12
    rng = np.random.default_rng(0)
    H = rng.normal(size=(50, 3)) * 10.0 ** rng.uniform(3.0, 6.5, (50, 1))
    size = np.linalg.norm(H, axis=1)
    low, high = np.zeros(50), np.full(50, Ms)
    for _ in range(60):
        M = 0.5 * (low + high)
        inside = size - M / 3.0
        too_small = M < chi * Ms * inside / (Ms + chi * np.maximum(inside, 0.0))
        low, high = np.where(too_small, M, low), np.where(too_small, high, M)
    m = moments(GrainLaw(chi, Ms), H, np.full(50, volume))
    np.testing.assert_allclose(m, volume * (M / size)[:, None] * H, rtol=1e-9)


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
def test_magnetisation_of_the_grains_and_permeability_of_the_powder_are_one_law(phi, H):
    """phi M = chi_eff H, whatever H: B from the grains equals B of the field's powder law."""
    from field import PowderLaw

    law = GrainLaw(200.0, 1.3e6)
    B = MU_0 * (H + phi * law.magnetisation(H, phi))
    assert PowderLaw(law).H_of_B(np.array([B]), phi)[0] == pytest.approx(H, rel=1e-9)


def test_no_field_no_moment():
    m = moments(GrainLaw(200.0, 1.3e6), np.zeros((3, 3)), np.ones(3))
    assert np.array_equal(m, np.zeros((3, 3)))
