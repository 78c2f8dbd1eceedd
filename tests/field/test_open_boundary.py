"""The open boundary: a loop's exterior energy, the coil in air, uniform fields, independence of the air's size."""

import numpy as np
import pytest
from closed_forms import loop_field, rectangular_coil_field
from half_disc import half_disc, within
from scipy.special import ellipe, ellipkm1
from section_grid import section_grid

from field import MU_0, AxisymmetricProblem, GrainLaw, LinearLaw, PowderLaw, material
from field.section.open_boundary import OpenBoundary
from field.section.section_elements import SectionElements
from geometry import SectionMesh

pytestmark = pytest.mark.physics

R_COIL, Z_COIL, NI = (20e-3, 30e-3), (-8e-3, 8e-3), 800.0
REACH = float(np.hypot(30e-3, 8e-3))


def mutual(R, r, z):
    """psi = M/(2 pi) of one ampere in a loop: M of coaxial loops (Maxwell 1873, art. 701) [H]."""
    outer = (R + r) ** 2 + z**2
    rest = ((R - r) ** 2 + z**2) / outer  # 1 - k^2, without cancellation
    k = np.sqrt(1.0 - rest)
    return MU_0 * np.sqrt(R * r) * ((2.0 / k - k) * ellipkm1(rest) - 2.0 / k * ellipe(1.0 - rest))


def coil_inductance(r_range, z_range, n=30):
    """Flux per turn of one ampere-turn in a rectangular section [H]: mean of M over all pairs of its loops.

    Over the distances u in z and v in r of a pair, with Duffy's triangles and points x^4 towards the
    logarithm at u = v = 0: converged to 1e-13 at n = 30.
    """
    x, g = np.polynomial.legendre.leggauss(n)
    x, g = 0.5 + 0.5 * x, 0.5 * g
    w, h = r_range[1] - r_range[0], z_range[1] - z_range[0]
    long, short = np.meshgrid(x**4, x, indexing="ij")
    short = long * short
    weight = np.outer(4.0 * x**7 * g, g)  # ds = 4 x^3 dx, Jacobian s
    total = 0.0
    for U, V in ((long, short), (short, long)):
        u, v = h * U, w * V
        pairs = weight * 2.0 * (1.0 - U) * 2.0 * (1.0 - V)
        for position, share in zip(x, g, strict=True):
            inner = r_range[0] + (w - v) * position
            total += float((pairs * share * mutual(inner, inner + v, u)).sum())
    return total


def solve_coil(radius, size, order, air_size=None, powder=False):
    parts = {"coil": (*R_COIL, *Z_COIL)}
    if powder:
        parts["powder"] = (33e-3, 35e-3, -10e-3, 10e-3)
    mesh = half_disc(parts, radius, size, air_size=air_size or 2.0 * size)
    return AxisymmetricProblem(mesh, {}, order=order, open_boundary=True).solve(NI)


@pytest.mark.parametrize(("order", "rate"), [(1, 1.9), (2, 3.8), (3, 3.8)])
def test_energy_outside_is_that_of_a_loop(order, rate):
    """Trace of a loop off the centre, on the polygon's nodes; exact: integral of psi H x ds/2 over the polygon.

    The rate is that of interpolating the trace, not the circle's h^2: chords are the boundary itself.
    """
    R, height, radius = 60e-3, 30e-3, 0.1
    errors = []
    for n in (24, 48):
        step = np.pi * radius / n
        mesh = half_disc({"coil": (0.02, 0.05, -0.02, 0.02)}, radius, step, air_size=step)
        elements = SectionElements(mesh, order)
        boundary = OpenBoundary(elements)
        r, z = elements.dof_points[boundary.dofs].T
        psi = np.zeros(elements.n_dofs)
        psi[boundary.dofs] = mutual(R, r, z - height) / (2.0 * np.pi)
        ends = mesh.points[mesh.boundaries["outer"]]
        upwards = ends[:, 0, 0] * ends[:, 1, 1] > ends[:, 1, 0] * ends[:, 0, 1]  # counter-clockwise about 0
        ends[~upwards] = ends[~upwards, ::-1]
        x, w = np.polynomial.legendre.leggauss(12)
        where = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * (0.5 + 0.5 * x[:, None])
        H_r, H_z = loop_field(R, 1.0, where[..., 0], where[..., 1] - height)
        along = (ends[:, 1] - ends[:, 0])[:, None]
        trace = mutual(R, where[..., 0], where[..., 1] - height) / (2.0 * np.pi)
        # (nu/r) grad psi = (H_z, -H_r) and the normal away is (dz, -dr)
        exact = -0.25 * float((trace * (H_z * along[..., 1] + H_r * along[..., 0]) * w).sum())
        errors.append(abs(boundary.energy(psi) / exact - 1.0))
        outside = np.array([[0.12, 0.05], [0.2, -0.1], [0.01, 0.3]])
        H = np.column_stack(loop_field(R, 1.0, outside[:, 0], outside[:, 1] - height))
        missed = np.abs(boundary.flux_density(psi, outside) - MU_0 * H).max()
        assert missed < 10.0 * errors[-1] * MU_0 * np.abs(H).max()
    assert np.log2(errors[0] / errors[1]) > rate and errors[1] < (4e-3, 5e-6, 1e-6)[order - 1], errors


def test_on_a_fine_circle_it_is_the_dirichlet_to_neumann_operator():
    """Eigenvalue n/R of the n-th mode: u^T K u = (nu_0/R) 2 n^2 (n + 1)/(2n + 1) for u = sin(theta) P_n^1."""
    radius = 0.1
    mesh = half_disc({"coil": (0.02, 0.05, -0.02, 0.02)}, radius, 1.5e-3, air_size=1.5e-3)
    elements = SectionElements(mesh, 3)
    boundary = OpenBoundary(elements)
    r, z = elements.dof_points[boundary.dofs].T
    x = z / np.hypot(r, z)
    for n in (1, 2, 5):
        u = np.zeros(elements.n_dofs)
        u[boundary.dofs] = (1.0 - x**2) * np.polynomial.legendre.Legendre.basis(n).deriv()(x)
        expected = 2.0 * n**2 * (n + 1) / ((2 * n + 1) * MU_0 * radius)
        # u is the circle's mode on chords that lie up to h^2/(8 R^2) = 3e-5 inside
        assert 2.0 * boundary.energy(u) == pytest.approx(expected, rel=1e-4 * (n + 1))


def test_operator_is_symmetric_and_positive():
    field = solve_coil(1.5 * REACH, 3e-3, 2)
    matrix = field.problem.exterior.matrix
    assert np.abs(matrix - matrix.T).max() <= 1e-14 * np.abs(matrix).max()
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert eigenvalues[0] > -1e-13 * eigenvalues[-1]


def test_inductance_oracle_against_the_field_of_the_loops():
    """The oracle's own check: a thin coil's flux from H_z over its disc is the mutual inductance."""
    r, w = np.polynomial.legendre.leggauss(60)
    radii = 0.02 * (0.5 + 0.5 * r)
    _, H_z = loop_field(0.05, 1.0, radii, np.full(60, 0.01))
    flux = MU_0 * (0.5 * 0.02 * w * H_z * 2.0 * np.pi * radii).sum()
    assert mutual(0.05, 0.02, 0.01) == pytest.approx(flux, rel=1e-12)
    assert coil_inductance(R_COIL, Z_COIL, 30) == pytest.approx(coil_inductance(R_COIL, Z_COIL, 40), rel=1e-12)


@pytest.mark.parametrize(("order", "rate", "floor"), [(1, 1.6, 6e-3), (2, 3.0, 7e-6), (3, 3.6, 1e-7)])
def test_air_coil_converges_at_the_elements_rate_in_a_tight_box(order, rate, floor):
    """Inductance with air to 1.3 times the coil only: no floor above 1e-7, rate 2 p but for J's jump at corners."""
    exact = coil_inductance(R_COIL, Z_COIL)
    error = [abs(solve_coil(1.3 * REACH, h, order).flux_linkage_per_turn / (NI * exact) - 1.0) for h in (2e-3, 1e-3)]
    assert np.log2(error[0] / error[1]) > rate and error[1] < floor, error


def test_field_at_points_does_not_depend_on_the_air_around():
    """Recovered H at grains in the powder's region, and B at the very edge of the mesh, against the loops."""
    random = np.random.default_rng(0)
    r, z = random.uniform((33.2e-3, -9e-3), (34.8e-3, 9e-3), (300, 2)).T
    exact = np.column_stack(rectangular_coil_field(R_COIL, Z_COIL, NI, r, z))
    found = []
    for factor in (1.3, 2.6):
        field = solve_coil(factor * 36.4e-3, 1e-3, 3, powder=True)
        H, _ = field.sampler().sample(np.column_stack((r, 0.0 * r, z)))
        found.append(H[:, [0, 2]])
        assert np.linalg.norm(found[-1] - exact) < 3e-5 * np.linalg.norm(exact)
        edge = field.problem.elements.dof_points[field.problem.exterior.dofs] * 0.999
        B = field.flux_density(edge)
        H_edge = np.column_stack(rectangular_coil_field(R_COIL, Z_COIL, NI, *edge.T))
        assert np.abs(B - MU_0 * H_edge).max() < 3e-3 * MU_0 * np.abs(H_edge).max()
    assert np.linalg.norm(found[0] - found[1]) < 5e-5 * np.linalg.norm(exact)


def test_energy_counts_the_air_outside():
    field = solve_coil(1.3 * REACH, 3e-3, 2)
    assert 2.0 * field.energy == pytest.approx(field.flux_linkage_per_turn * NI, rel=1e-10)
    assert field.problem.exterior.energy(field.psi) > 1e-2 * field.energy / (2.0 * np.pi)


@pytest.mark.parametrize("half_length", [36e-3, 90e-3])
def test_rectangular_outline_is_as_good(half_length):
    exact = coil_inductance(R_COIL, Z_COIL)
    z = np.arange(0.0, half_length + 1e-9, 2e-3)
    mesh = section_grid(np.arange(0.0, 40e-3 + 1e-9, 2e-3), np.r_[-z, z], {"coil": (*R_COIL, *Z_COIL)})
    field = AxisymmetricProblem(mesh, {}, order=3, open_boundary=True).solve(NI)
    assert field.flux_linkage_per_turn == pytest.approx(NI * exact, rel=2e-6)


@pytest.fixture(scope="module")
def clutches():
    """A saturable disc and housing with a powder gap, in air to 1.3 and to 2.6 times the device."""
    parts = {
        "disc": (0.0, 20e-3, -8e-3, 8e-3),
        "powder": (20e-3, 21e-3, -8e-3, 8e-3),
        "coil": (23e-3, 29e-3, -3e-3, 3e-3),
        "housing": [(21e-3, 33e-3, -8e-3, -4e-3), (21e-3, 33e-3, 4e-3, 8e-3), (29e-3, 33e-3, -4e-3, 4e-3)],
    }
    laws = dict.fromkeys(("disc", "housing"), material("steel_1010"))
    powder = PowderLaw(GrainLaw(273.0, 1.5e6))
    large = half_disc(parts, 2.6 * 34e-3, 0.7e-3, air_size=4e-3, shell=1.3 * 34e-3)
    problems = {}
    for factor, mesh in ((1.3, within(large, 1.3 * 34e-3)), (2.6, large)):
        for open_boundary in (True, False):
            problems[open_boundary, factor] = AxisymmetricProblem(
                mesh, laws, powder_law=powder, order=2, open_boundary=open_boundary
            )
    return problems


@pytest.mark.parametrize("ampere_turns", [300.0, 3000.0])
def test_nonlinear_device_does_not_feel_the_size_of_the_air(clutches, ampere_turns):
    """Twice the air changes linkage and gap field by less than 1e-6; with the flux wall linkage by over 1e-3.

    The mesh inside is the same, so that nothing but the boundary differs.
    """
    gap = np.column_stack((np.full(15, 20.5e-3), np.linspace(-7e-3, 7e-3, 15)))
    change = {}
    for open_boundary in (True, False):
        fields = [
            clutches[open_boundary, factor].solve(
                ampere_turns, np.full(clutches[open_boundary, factor].powder_elements.size, 0.4)
            )
            for factor in (1.3, 2.6)
        ]
        assert all(len(field.newton) <= 13 for field in fields), "at most 12 steps, cold, the cheap ones counted"
        linkage = [field.flux_linkage_per_turn for field in fields]
        H = [field.sampler().sample(np.insert(gap, 1, 0.0, axis=1))[0] for field in fields]
        change[open_boundary] = (
            abs(linkage[0] / linkage[1] - 1.0),
            np.linalg.norm(H[0] - H[1]) / np.linalg.norm(H[1]),
        )
    assert max(change[True]) < 1e-6, change
    assert change[False][0] > 1e-3, "otherwise the test says nothing"


def test_uniform_field_passes_through_air_unchanged():
    mesh = half_disc({"sphere": (0.0, 4e-3, -3e-3, 3e-3)}, 8e-3, 2e-3, z0=0.7e-3)
    for order in (2, 3):
        problem = AxisymmetricProblem(mesh, {"sphere": LinearLaw(1.0)}, order=order, open_boundary=True)
        field = problem.solve(0.0, boundary_field=0.02)
        r = problem.elements.dof_points[:, 0]
        assert np.allclose(field.psi, 0.01 * r**2, rtol=0, atol=1e-12 * 0.01 * 64e-6)


@pytest.mark.parametrize("mu_r", [10.0, 1000.0])
def test_sphere_in_a_uniform_field(mu_r):
    """B inside is 3 mu_r/(mu_r + 2) B0, outside a dipole's is added; air to 1.5 radii only."""
    radius, B0, n = 1e-3, 0.01, 64
    angle = np.linspace(0.0, np.pi, n + 1)
    shells = np.concatenate((np.linspace(0.0, 1.0, n // 3 + 1)[1:], np.geomspace(1.0, 1.5, 10)[1:])) * radius
    rho, theta = np.meshgrid(shells, angle, indexing="ij")
    r = rho * np.sin(theta)
    r[:, [0, -1]] = 0.0
    number = 1 + np.arange(rho.size).reshape(rho.shape)
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    core = np.column_stack((np.zeros(n, int), number[0, 1:], number[0, :-1]))
    triangles = np.concatenate((core, np.column_stack((a, c, b)), np.column_stack((a, d, c))))
    points = np.vstack(([[0.0, 0.0]], np.column_stack((r.ravel(), (rho * np.cos(theta)).ravel()))))
    inside = np.linalg.norm(points[triangles].mean(axis=1), axis=1) < radius
    mesh = SectionMesh(
        points,
        triangles.astype(np.int64),
        {"sphere": np.flatnonzero(inside), "air": np.flatnonzero(~inside)},
        {"outer": np.column_stack((number[-1, :-1], number[-1, 1:]))},
    )
    problem = AxisymmetricProblem(mesh, {"sphere": LinearLaw(mu_r, "sphere")}, open_boundary=True)
    field = problem.solve(0.0, boundary_field=B0)
    B = field.flux_density(np.array([[0.3e-3, 0.2e-3], [0.5e-3, -0.4e-3]]))
    # the polygon's volume lacks (step^2)/4 = 6e-4 of the sphere's
    assert np.allclose(B, [0.0, 3.0 * mu_r / (mu_r + 2.0) * B0], rtol=2e-3, atol=2e-3 * B0)
    scattered = field.psi - 0.5 * B0 * problem.elements.dof_points[:, 0] ** 2
    moment = (mu_r - 1.0) / (mu_r + 2.0) * radius**3 * B0  # B of the dipole: moment (3 z z/rho^5 - 1/rho^3)
    far = np.array([[0.0011e-3 + 4e-3, 0.0], [1e-6, 5e-3]])
    dipole = np.array([[0.0, -moment / far[0, 0] ** 3], [0.0, 2.0 * moment / far[1, 1] ** 3]])
    assert np.allclose(
        problem.exterior.flux_density(scattered, far), dipole, rtol=2e-3, atol=2e-3 * np.abs(dipole).max()
    )


def test_outlines_that_do_not_fit_are_explained():
    lines = np.linspace(0.0, 0.04, 9)
    hollow = section_grid(lines + 0.01, np.r_[-lines, lines], {"coil": (0.02, 0.03, -0.01, 0.01)})
    with pytest.raises(ValueError, match="from the axis to the axis"):
        AxisymmetricProblem(hollow, {}, open_boundary=True)
    close = section_grid(lines, np.r_[-lines, lines], {"coil": (0.02, 0.04, -0.01, 0.01)})
    with pytest.raises(ValueError, match=r"region 'coil' reaches 41\.23 mm"):
        AxisymmetricProblem(close, {}, open_boundary=True)
    with pytest.raises(ValueError, match="no boundary 'outer'"):
        AxisymmetricProblem(SectionMesh(close.points, close.triangles, close.regions, {}), {}, open_boundary=True)
    # an outline that turns back on itself as seen from the middle
    bent = close.points.copy()
    corner = np.flatnonzero((close.points[:, 0] == 0.04) & (close.points[:, 1] == 0.03))
    bent[corner] = (0.04, 0.0251)
    below = np.flatnonzero((close.points[:, 0] == 0.04) & (np.abs(close.points[:, 1] - 0.025) < 1e-9))
    bent[below, 0] = 0.0385
    folded = SectionMesh(bent, close.triangles, close.regions, close.boundaries)
    with pytest.raises(ValueError, match="meets once"):
        AxisymmetricProblem(folded, {}, open_boundary=True)
