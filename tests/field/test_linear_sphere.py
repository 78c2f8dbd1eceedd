"""A linear sphere in a uniform field: H inside is 3 H0/(mu_r + 2)."""

import numpy as np
import pytest

from field import MU_0, AxisymmetricProblem, LinearLaw
from geometry.section import SectionMesh

pytestmark = pytest.mark.physics


def sphere_section(n_angle, radius, box):
    """Half-disc of `n_angle` cells from pole to pole with shells out to a sphere of radius `box`."""
    inner, outer = np.linspace(0, radius, n_angle // 3 + 1), np.geomspace(radius, box, n_angle)
    shells = np.concatenate((inner, outer[1:]))
    angle = np.linspace(0.0, np.pi, n_angle + 1)
    rho, theta = np.meshgrid(shells[1:], angle, indexing="ij")
    r = rho * np.sin(theta)
    r[:, [0, -1]] = 0.0
    points = np.vstack(([[0.0, 0.0]], np.column_stack((r.ravel(), (rho * np.cos(theta)).ravel()))))
    number = 1 + np.arange(rho.size).reshape(rho.shape)
    core = np.column_stack((np.zeros(n_angle, int), number[0, 1:], number[0, :-1]))
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    triangles = np.concatenate((core, np.column_stack((a, c, b)), np.column_stack((a, d, c))))
    inside = np.linalg.norm(points[triangles].mean(axis=1), axis=1) < radius
    return SectionMesh(
        points,
        triangles.astype(np.int64),
        {"sphere": np.flatnonzero(inside), "air": np.flatnonzero(~inside)},
        {"outer": np.column_stack((number[-1, :-1], number[-1, 1:]))},
    )


@pytest.mark.parametrize("mu_r", [2.0, 10.0, 1000.0])
def test_field_inside_a_sphere(mu_r):
    radius, B0 = 1e-3, 0.01
    problem = AxisymmetricProblem(sphere_section(48, radius, 30e-3), {"sphere": LinearLaw(mu_r, "sphere")})
    field = problem.solve(0.0, boundary_field=B0)
    where = np.array([[0.0, 0.0], [0.3e-3, 0.2e-3], [0.5e-3, -0.4e-3]])
    B = field.flux_density(where)
    expected = 3.0 * mu_r / (mu_r + 2.0) * B0
    assert np.allclose(B[:, 1], expected, rtol=4e-3)
    assert np.abs(B[:, 0]).max() < 4e-3 * expected
    far = field.flux_density(np.array([[20e-3, 0.0]]))
    assert far[0, 1] == pytest.approx(B0, rel=2e-3)


def test_uniform_field_in_air_is_exact():
    problem = AxisymmetricProblem(sphere_section(12, 1e-3, 5e-3), {"sphere": LinearLaw(1.0, "sphere")})
    field = problem.solve(0.0, boundary_field=0.02)
    B = field.flux_density()
    assert np.allclose(B, [0.0, 0.02], atol=1e-12)
    assert np.allclose(field.corner_flux_density(), [0.0, 0.02], atol=1e-11)
    # straight chords: the section's polygon is what is integrated
    mesh = problem.mesh
    volume = sum(mesh.volume(name) for name in mesh.regions)
    assert field.energy == pytest.approx(0.02**2 / (2 * MU_0) * volume, rel=1e-9)
