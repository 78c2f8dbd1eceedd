"""An iron sphere in a uniform applied field: the closed form, the order of curved and of flat elements."""

from dataclasses import replace

import numpy as np
import pytest

from field import MU_0, FroehlichLaw, GrainLaw, LinearLaw, PowderLaw, PowderState
from field.three_d import Problem3D, UniformSource
from geometry.mesh_3d import Mesh3D
from geometry.mesher import initialize_gmsh

pytestmark = pytest.mark.physics

A, BOX, MU_R, H0 = 10e-3, 18e-3, 20.0, 1e4


def octant(size, curved=True):
    """The octant x, y, z > 0 of a sphere of iron in a sphere of air, by gmsh."""
    import gmsh

    initialize_gmsh()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        occ = gmsh.model.occ
        balls = [(3, occ.addSphere(0, 0, 0, 1e3 * R, angle1=0.0, angle3=np.pi / 2)) for R in (A, BOX)]
        occ.fragment(balls[:1], balls[1:])
        occ.synchronize()
        volumes = [tag for _, tag in gmsh.model.getEntities(3)]
        volumes.sort(key=lambda tag: gmsh.model.occ.getMass(3, tag))
        assert len(volumes) == 2
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        number[tags.astype(int)] = np.arange(tags.size)
        parts = [gmsh.model.mesh.getElements(3, tag)[2][0].reshape(-1, 10) for tag in volumes]
    finally:
        gmsh.finalize()
    nodes = number[np.concatenate(parts).astype(int)][:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
    corners = np.unique(nodes[:, :4])
    order = np.concatenate((corners, np.setdiff1d(np.unique(nodes), corners)))
    new = np.zeros(tags.size, dtype=np.int64)
    new[order] = np.arange(order.size)
    points, nodes = 1e-3 * xyz.reshape(-1, 3)[order], new[nodes]
    faces = np.concatenate([nodes[:, f] for f in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    outer = (np.linalg.norm(points[faces], axis=2) > BOX * (1 - 1e-6)).all(axis=1)
    bottom = (points[faces, 2] < 1e-9).all(axis=1)
    inside = np.arange(len(parts[0]))
    return Mesh3D(
        points if curved else points[: corners.size],
        nodes[:, :4],
        nodes if curved else None,
        {"iron": inside, "air": np.arange(inside.size, len(nodes))},
        {"outer": faces[outer], "bottom": faces[bottom]},
        None,
        np.pi / 2,
        4,
    )


def exact(x, mu_r=MU_R):
    """H inside, 3 H0/(mu_r + 2), and outside, H0 plus the field of the moment M V."""
    r = np.linalg.norm(x, axis=1)[:, None]
    m = (mu_r - 1) / (mu_r + 2) * A**3 * H0  # moment over 4 pi
    outside = np.array([0, 0, H0]) + m * (3 * x * x[:, 2:] / r**5 - np.array([0, 0, 1]) / r**3)
    return np.where(r < A, np.array([0, 0, 3 * H0 / (mu_r + 2)]), outside)


def energy_error(field):
    """Error of H weighted with mu, relative to what the sphere changes."""
    elements = field.problem.elements
    iron = np.isin(elements.element_of_quadrature, field.problem.mesh.regions["iron"])
    x = elements.quadrature_points
    # the closed form on the side the element belongs to: flat faces do not follow the sphere
    r = np.linalg.norm(x, axis=1)
    x = np.where(iron, np.minimum(r, A * (1 - 1e-9)), np.maximum(r, A * (1 + 1e-9)))[:, None] * x / r[:, None]
    H = exact(x)
    weight = elements.weight * np.where(iron, MU_R, 1.0)
    size = (weight * ((H - np.array([0, 0, H0])) ** 2).sum(axis=1)).sum()
    return np.sqrt((weight * ((field.H_at_quadrature - H) ** 2).sum(axis=1)).sum() / size)


@pytest.fixture(scope="module")
def solved():
    fields = {}
    for curved in (True, False):
        for size in (2.0, 1.1):
            problem = Problem3D(octant(size, curved), {"iron": LinearLaw(MU_R)}, UniformSource(), fixed=["bottom"])
            fields[curved, size] = problem.solve(H0)
    return fields


@pytest.fixture(scope="module")
def points():
    """500 points in the air beside the sphere."""
    random = np.random.default_rng(0)
    x = random.normal(size=(500, 3))
    x *= (random.uniform(1.1 * A, 1.5 * A, 500) / np.linalg.norm(x, axis=1))[:, None]
    x[:, 2] = np.abs(x[:, 2])
    return x


def rate(solved, error, curved=True):
    """Order in the mesh size, by the number of elements: gmsh does not halve them exactly."""
    coarse, fine = solved[curved, 2.0], solved[curved, 1.1]
    ratio = (len(fine.problem.mesh.tetrahedra) / len(coarse.problem.mesh.tetrahedra)) ** (1 / 3)
    return np.log(error(coarse) / error(fine)) / np.log(ratio)


def relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def test_curved_quadratic_elements_are_second_order(solved):
    assert rate(solved, energy_error) > 1.8
    assert energy_error(solved[True, 1.1]) < 2e-3


def test_flat_faces_lose_accuracy(solved):
    """The polyhedron's volume alone is wrong by O(h^2), and H by O(h^1.5) beside its edges."""
    assert rate(solved, energy_error, curved=False) < rate(solved, energy_error) - 0.1
    assert energy_error(solved[False, 1.1]) > 2 * energy_error(solved[True, 1.1])


def test_field_inside_is_that_of_the_closed_form(solved, points):
    """3 H0/(mu_r + 2) along z; the open boundary, 0.8 radii away, is exact for a dipole."""
    inside = np.tile([0, 0, 3 * H0 / (MU_R + 2)], (len(points), 1))

    def error(field):
        return relative(field.field_strength(0.5 * points), inside)

    assert rate(solved, error) > 3.0 and error(solved[True, 1.1]) < 1e-4
    field = solved[True, 1.1]
    H, grad = field.sampler("iron").sample(0.5 * points)
    assert relative(H, inside) < 1e-4
    assert np.abs(grad).max() < 0.01 * inside.max() / A
    assert np.allclose(
        field.flux_density(0.5 * points), MU_0 * MU_R * inside, rtol=0, atol=2e-4 * MU_0 * MU_R * inside.max()
    )


def test_recovered_field_and_gradient_in_air(solved, points):
    """Raw H is second order; recovered H and grad H are better by an order and more."""
    d = 1e-7
    gradient = np.stack([(exact(points + d * e) - exact(points - d * e)) / (2 * d) for e in np.eye(3)], axis=2)

    def raw(field):
        return relative(field.field_strength(points), exact(points))

    def recovered(field):
        return relative(field.sampler("air").sample(points)[0], exact(points))

    def recovered_gradient(field):
        return relative(field.sampler("air").sample(points)[1], gradient)

    assert rate(solved, raw) > 1.8
    assert rate(solved, recovered) > 2.6 and recovered(solved[True, 1.1]) < 0.4 * raw(solved[True, 1.1])
    assert rate(solved, recovered_gradient) > 2.0 and recovered_gradient(solved[True, 1.1]) < 0.02


@pytest.mark.parametrize("outer", ["open", "zero"])
def test_without_iron_the_applied_field_stays(solved, points, outer):
    problem = Problem3D(
        solved[True, 2.0].problem.mesh, {"iron": LinearLaw(1.0)}, UniformSource(), outer=outer, fixed=["bottom"]
    )
    H = problem.solve(H0).field_strength(points)
    assert relative(H, np.tile([0, 0, H0], (len(points), 1))) < 1e-6


def test_saturating_sphere():
    """Froehlich-Kennelly: M = chi Ms H/(Ms + chi H) with H = H0 - M/3, chi = 999, Ms = 1.7e6 A/m.

    Its numbers are of tests/REFERENCE.md section 1.
    """
    problem = Problem3D(octant(5.0), {"iron": FroehlichLaw(999.0, 1.7e6)}, UniformSource(), fixed=["bottom"])
    x = np.array([[2e-3, 1e-3, 3e-3]])
    for strength, M in ((1e4, 29908.576), (5e5, 1467739.04), (2e6, 1697985.04)):
        field = problem.solve(strength)
        found = field.flux_density(x) / MU_0 - field.field_strength(x)
        assert found[0, 2] == pytest.approx(M, rel=5e-3), strength


def test_a_sphere_of_powder_is_a_permeable_sphere_and_a_magnet():
    """H = 3 H0/(3 + chi_eff) in even powder, -M/3 in one of a given M without a field."""
    law = GrainLaw(50.0)
    mesh = octant(2.0)
    mesh = replace(mesh, regions={"powder": mesh.regions["iron"], "air": mesh.regions["air"]})
    problem = Problem3D(mesh, {}, UniformSource(), fixed=["bottom"], powder_law=PowderLaw(law))
    fill = np.full(problem.powder_elements.size, 0.4)
    inside = np.array([[1e-3, 2e-3, 3e-3], [4e-3, 2e-3, 5e-3]])
    chi = float(law.chi_eff(0.4, np.ones(1))[0])
    field = problem.solve(H0, fill)
    assert np.allclose(field.field_strength(inside), [0.0, 0.0, 3.0 * H0 / (3.0 + chi)], rtol=2e-3, atol=2e-3 * H0)
    assert np.allclose(field.flux_density(inside), (1.0 + chi) * MU_0 * field.field_strength(inside), rtol=1e-9)
    M = np.zeros((fill.size, 3, problem.powder_basis.dx.shape[1]))
    M[:, 2] = 1e5
    magnet = problem.solve(0.0, PowderState(0.0 * fill, None, M))
    assert np.allclose(magnet.field_strength(inside), [0.0, 0.0, -1e5 / 3.0], rtol=2e-3, atol=100.0)
    assert np.allclose(magnet.flux_density(inside), [0.0, 0.0, 2.0 / 3.0 * MU_0 * 1e5], rtol=2e-3, atol=1e-4)
