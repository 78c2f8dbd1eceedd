"""Two spheres in a uniform field by finite elements: exact linear pairs, saturation, an independent code's numbers."""

import math

import numpy as np
import pytest

from coupling.cluster import magnetised_cluster
from coupling.grain_law_table import grain_table
from field import MU_0, NU_0, AxisymmetricProblem, FroehlichLaw, GrainLaw, LinearLaw
from field.spheres.pair_mesh import pair_mesh
from field.spheres.pair_solver import SpherePair, solve_pair
from field.spheres.pair_table import pair_table
from geometry import SectionMesh

pytestmark = pytest.mark.physics

IRON = FroehlichLaw(999.0, 1.7e6)
# [A/m] and, by gap in radii, force [mu_0 Ms^2 a^2] and mean moment [Ms] of two spheres of IRON: finite elements of
# order 4 by another code, about 0.1 % high
H = np.array([1, 5, 18, 46, 80, 120, 200, 300, 500]) * 1e3
FORCE = {
    0.001: [2.317e-4, 4.529e-3, 0.02441, 0.07324, 0.1351, 0.2067, 0.3372, 0.4658, 0.5823],
    0.03: [1.685e-5, 4.209e-4, 5.443e-3, 0.03515, 0.09246, 0.1626, 0.2928, 0.4225, 0.5421],
    0.1: [6.023e-6, 1.506e-4, 1.950e-3, 0.01271, 0.03834, 0.0856, 0.2053, 0.3349, 0.4599],
    1.0: [4.010e-7, 1.002e-5, 1.299e-4, 8.479e-4, 2.563e-3, 5.762e-3, 0.01597, 0.03576, 0.09106],
}
MOMENT = {
    0.001: [0.003198, 0.01588, 0.05513, 0.1343, 0.2245, 0.3243, 0.5075, 0.7064, 0.9590],
    0.03: [0.002705, 0.01352, 0.04867, 0.1242, 0.2139, 0.3141, 0.4986, 0.7001, 0.9582],
}


def linear_pair(mu_r, gap, *, resolution=1.0, order=3):
    """Force over 4 pi mu_0 h^2 a^2 and mean magnetisation over h of two linear spheres."""
    pair = SpherePair(LinearLaw(mu_r, "spheres"), gap, resolution=resolution, order=order)
    solution = pair.solve(1.0)
    return pair.force(solution) / (4.0 * math.pi * MU_0), pair.magnetisation(solution)


def force_through_plane(pair, solution):
    """mu_0/2 integral of (H_z - h)^2 dA over the whole plane of symmetry [N]."""
    problem, mesh = pair.problem, pair.problem.mesh
    h, edges = NU_0 * solution.boundary_field, mesh.boundaries["mirror"]
    node, weight = np.polynomial.legendre.leggauss(8)
    node, weight = 0.5 * (1.0 + node), 0.5 * weight
    start, end = mesh.points[edges[:, 0], 0], mesh.points[edges[:, 1], 0]
    r = start[:, None] + (end - start)[:, None] * node
    H = NU_0 * solution.flux_density(np.column_stack((r.ravel(), 0.0 * r.ravel())))[:, 1].reshape(r.shape)
    total = (np.abs(end - start)[:, None] * weight * 2.0 * math.pi * r * (H - h) ** 2).sum()
    # beyond the mesh by the multipoles of the open boundary, over reach/r
    reach = max(start.max(), end.max())
    uniform = 0.5 * solution.boundary_field * problem.elements.dof_points[:, 0] ** 2
    H = NU_0 * problem.exterior.flux_density(solution.psi - uniform, np.column_stack((reach / node, 0.0 * node)))[:, 1]
    return 0.5 * MU_0 * (total + (weight * 2.0 * math.pi * reach**2 / node**3 * H**2).sum())


@pytest.mark.parametrize(
    ("gap", "mu_r", "f"),
    [
        *((0.01, 2, 0.03418), (0.01, 5, 0.37095), (0.01, 10, 1.18558), (0.01, 100, 7.02433)),
        *((0.1, 2, 0.02595), (0.1, 5, 0.21274), (0.1, 10, 0.49069), (0.1, 100, 1.24191)),
        *((1, 2, 0.00490), (1, 5, 0.02751), (1, 10, 0.04931), (1, 100, 0.08674)),
    ],
)
def test_linear_spheres_attract_as_the_exact_series_says(gap, mu_r, f):
    """tests/REFERENCE.md section 2: F = 4 pi mu_0 h^2 a^2 f, to half its last digit and 0.03 %."""
    assert abs(linear_pair(mu_r, gap)[0] - f) < 5e-6 + 3e-4 * f


def test_far_apart_they_are_lone_spheres_in_each_others_dipole_field():
    for mu_r in (3.0, 1000.0):
        alone = 3.0 * (mu_r - 1.0) / (mu_r + 2.0)
        m = linear_pair(mu_r, 10.0)[1]
        assert m == pytest.approx(alone / (1.0 - 2.0 / 3.0 * alone / 12.0**3), rel=2e-4)


@pytest.mark.parametrize("gap", sorted(FORCE))
def test_the_shipped_table_of_iron_agrees_with_another_code(gap):
    table = pair_table(GrainLaw(999.0, 1.7e6))
    assert np.allclose(table.force_of(gap, H / IRON.Ms), FORCE[gap], rtol=3e-3)
    if gap in MOMENT:
        assert np.allclose(table.moment_of(gap, H / IRON.Ms), MOMENT[gap], rtol=2e-3)


@pytest.mark.parametrize("gap", [0.001, 0.1])
def test_a_direct_solve_agrees_with_another_code(gap):
    pair = solve_pair(IRON, gap, H[::2] / IRON.Ms, resolution=0.8)
    assert np.allclose(pair.force, FORCE[gap][::2], rtol=3e-3)
    if gap in MOMENT:
        assert np.allclose(pair.moment, MOMENT[gap][::2], rtol=2e-3)


def test_the_kernels_grids_hold_between_their_nodes():
    """A pair by the neck's energy between the nodes of its gaps, against a direct solve: force 0.5 %, moment 0.1 %."""
    tables = grain_table(IRON, "near_field")
    h = np.array([1.7e-3, 0.0223, 0.117, 0.371])
    for i in (21, 64, 108):
        g = float(np.exp(tables.gap_start + tables.gap_step * (i + 0.5)))
        direct = solve_pair(IRON, g, h)
        for field, force, moment in zip(h, direct.force, direct.moment, strict=True):
            pair = magnetised_cluster(
                [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 + g]], 1.0, IRON, [0.0, 0.0, field * IRON.Ms], smallest_gap=3e-4
            )
            assert pair.force[0, 2] == pytest.approx(MU_0 * IRON.Ms**2 * force, rel=5e-3), (g, field)
            assert pair.magnetisation[0, 2] == pytest.approx(IRON.Ms * moment, rel=1e-3), (g, field)


@pytest.mark.parametrize("chi", [14.0, 35.0, 140.0, 273.0, 1400.0])
def test_susceptibilities_between_the_shipped_ones(chi):
    """Within 1 % of a direct solve in the neck and out of it, where the field is weak and where it saturates."""
    law = FroehlichLaw(chi, 1e6)
    table, h = pair_table(law), np.array([4e-4, 0.015, 0.1, 0.5])
    for g in (5e-4, 0.05):
        pair = solve_pair(law, g, h, resolution=0.8)
        assert np.allclose(table.force_of(g, h), pair.force, rtol=1e-2)
        assert np.allclose(table.moment_of(g, h), pair.moment, rtol=1e-3)


@pytest.mark.parametrize("gap", [0.001, 0.1, 1.0])
def test_saturated_spheres_are_dipoles(gap):
    """F -> (pi/6) (2/R)^4 (Edwards 2017); what is left falls as 1/h: moments turn into each other's field."""
    pair = solve_pair(IRON, gap, [1.0, 20.0, 40.0])
    left = pair.force / (math.pi / 6.0 * (2.0 / (2.0 + gap)) ** 4) - 1.0
    assert 0.0 < left[1] < 6e-3 and left[2] == pytest.approx(0.5 * left[1], rel=0.03)
    assert pair.moment[2] == pytest.approx(1.0, abs=1e-4)
    assert pair_table(IRON).force_of(gap, 20.0) == pytest.approx(pair.force[1], rel=1e-3)


def test_the_shell_and_the_plane_of_symmetry_carry_one_force():
    for law, h in ((LinearLaw(2.0, "soft"), 1.0), (IRON, 2e5)):
        pair = SpherePair(law, 0.1)
        solution = pair.solve(h)
        assert force_through_plane(pair, solution) == pytest.approx(pair.force(solution), rel=1e-4)


def test_force_and_moment_converge_with_the_fourth_power_of_the_element_size():
    """The rate of straight edges that carry the sphere's volume; without that it would be two."""
    finest = linear_pair(100.0, 0.1, resolution=3.0)
    errors = [np.abs(np.divide(linear_pair(100.0, 0.1, resolution=n), finest) - 1.0) for n in (0.7, 1.5)]
    rate = np.log(errors[0] / errors[1]) / np.log(1.5 / 0.7)
    assert np.all(rate > 3.0) and np.all(errors[1] < 1e-4), (rate, errors)
    # so the order of the elements does not matter above 2
    assert linear_pair(100.0, 0.1, order=4) == pytest.approx(linear_pair(100.0, 0.1), rel=1e-4)


def test_half_of_the_pair_is_the_pair():
    """The mesh and its mirror image, without the plane of symmetry and with the whole open boundary."""
    pair = SpherePair(IRON, 0.1, resolution=0.8)
    mesh, half = pair.problem.mesh, pair.solve(1e5)
    n = len(mesh.points)
    on_plane = np.unique(mesh.boundaries["mirror"])
    number = np.arange(n, 2 * n)
    number[on_plane] = on_plane
    kept, place = np.unique(np.concatenate((np.arange(n), number)), return_inverse=True)
    points = np.concatenate((mesh.points, mesh.points * (1.0, -1.0)))[kept]
    upper, lower = place[:n], place[n:]
    whole = SectionMesh(
        points,
        np.concatenate((upper[mesh.triangles], lower[mesh.triangles[:, [0, 2, 1]]])),
        {name: np.concatenate((one, one + len(mesh.triangles))) for name, one in mesh.regions.items()},
        {"outer": np.concatenate((upper[mesh.boundaries["outer"]], lower[mesh.boundaries["outer"]]))},
    )
    problem = AxisymmetricProblem(whole, {"sphere": IRON}, order=3, open_boundary=True)
    full = problem.solve(0.0, boundary_field=MU_0 * 1e5)
    where = np.array([[0.2, 1.0], [0.5, 0.02], [1.2, 2.0], [0.3, 0.6]])
    expected = half.flux_density(where)
    assert np.allclose(full.flux_density(where), expected, atol=1e-6 * np.abs(expected).max())
    far = np.array([[4.0, 1.0], [0.0, 5.0]])
    outside = [one.problem.exterior.flux_density(one.psi, far) for one in (half, full)]
    assert np.allclose(*outside, atol=1e-6 * np.abs(outside[1]).max())


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="gap"):
        SpherePair(IRON, 1e-6)
    with pytest.raises(ValueError, match="grow"):
        solve_pair(IRON, 0.1, [0.1, 0.1])
    mesh = pair_mesh(0.3, 0.5)
    astray = SectionMesh(
        mesh.points, mesh.triangles, mesh.regions, mesh.boundaries | {"mirror": mesh.boundaries["axis"]}
    )
    with pytest.raises(ValueError, match="from the plane 'mirror' to the axis"):
        AxisymmetricProblem(astray, {"sphere": IRON}, open_boundary=True)
    with pytest.raises(ValueError, match="no saturation"):
        solve_pair(LinearLaw(10.0, "linear"), 0.1, [0.1])


def test_units():
    """F of spheres of radius 1 m is mu_0 Ms^2 times the force that is returned: the same at every Ms."""
    one, other = (solve_pair(FroehlichLaw(50.0, Ms), 0.3, [0.1], resolution=0.7) for Ms in (1e6, 4e5))
    assert one.force[0] == pytest.approx(other.force[0], rel=1e-6)
    pair = SpherePair(FroehlichLaw(50.0, 1e6), 0.3, resolution=0.7)
    solution = pair.solve(1e5)
    assert pair.force(solution) * NU_0 / 1e12 == pytest.approx(one.force[0], rel=1e-6)
