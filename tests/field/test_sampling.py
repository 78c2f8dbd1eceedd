"""Point location, local fits, element kernel, table and the uniform sources against oracles of a few lines."""

from types import SimpleNamespace

import numba
import numpy as np
import pytest
import scipy.sparse as sp

from field import AIR, MU_0, PointOutside, RadialField, RecoveredSampler, UniformField
from field.sampling.locate import TriangleLocator
from field.sampling.patch_fit import PatchFit, _vacuum_polynomials, falling_powers
from field.sampling.potential_table import TableSampler
from field.sampling.recovery import RegionRecovery, lattice
from field.sampling.sampler import field_sampler
from field.sampling.table_grid import NoTable
from field.section.section_elements import SectionElements
from geometry.section import SectionMesh


@pytest.fixture
def random_triangulation():
    """A jiggled grid of 8 x 6 cells: points, triangles, edges."""
    random = np.random.default_rng(3)
    r, z = np.meshgrid(np.linspace(0.03, 0.034, 9), np.linspace(-0.003, 0.003, 7), indexing="ij")
    inner = np.zeros(r.shape)
    inner[1:-1, 1:-1] = 1e-4
    points = np.column_stack(
        ((r + inner * random.uniform(-1, 1, r.shape)).ravel(), (z + inner * random.uniform(-1, 1, r.shape)).ravel())
    )
    number = np.arange(63).reshape(9, 7)
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    triangles = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    return points, triangles, edges


def test_located_element_holds_the_point(random_triangulation):
    points, triangles, _ = random_triangulation
    random = np.random.default_rng(5)
    where = np.column_stack((random.uniform(0.03, 0.034, 3000), random.uniform(-0.003, 0.003, 3000)))
    element, barycentric = TriangleLocator(points, triangles).find(where)
    assert element.min() >= 0 and barycentric.min() > -1e-9
    assert np.allclose(np.einsum("ki,kij->kj", barycentric, points[triangles[element]]), where, atol=1e-15)


def test_point_outside_is_found_out(random_triangulation):
    points, triangles, _ = random_triangulation
    where = np.array([[0.0299, 0.0], [0.0341, 0.0], [0.032, 0.5], [-1.0, 0.0], [np.nan, 0.0], [0.034 + 1e-9, 0.0]])
    element, _ = TriangleLocator(points, triangles).find(where)
    assert np.all(element[:-1] == -1)
    assert element[-1] >= 0, "round-off beyond a wall is not outside"


@pytest.mark.parametrize("degree", [1, 2])
def test_patch_fit_reproduces_polynomials(random_triangulation, degree):
    """Value and derivatives at corners, edges and inside of elements, from samples at the centroids."""
    points, triangles, _ = random_triangulation
    centroids = points[triangles].mean(axis=1)

    def polynomial(where):
        x, y = (where - (0.032, 0.0)).T * 1e3
        d = degree
        value = (1 + x - 0.5 * y) ** d
        first = d * (1 + x - 0.5 * y) ** (d - 1) * 1e3
        second = d * (d - 1) * (1 + x - 0.5 * y) ** max(d - 2, 0) * 1e6
        return np.array([value, first, -0.5 * first, second, -0.5 * second, 0.25 * second])

    fit = PatchFit(points, triangles).fit(sp.identity(len(triangles), format="csr"), centroids, degree)
    weight = np.tile([[1.0, 0.0, 0.0], [0.5, 0.0, 0.5], [0.2, 0.3, 0.5]], (len(triangles), 1))
    vertices = np.repeat(triangles, 3, axis=0)
    where = np.einsum("nk,nki->ni", weight, points[vertices])
    found = fit.derivatives(polynomial(centroids)[0], where, vertices, weight)
    for mine, exact in zip(found, polynomial(where), strict=True):
        assert np.allclose(mine, exact, rtol=1e-8, atol=1e-8 * np.abs(exact).max() + 1e-6)


def test_vacuum_polynomials_solve_the_equation_of_psi():
    """r (psi_rr + psi_zz) = psi_r up to the degree minus two, in the scaled coordinates about r_0."""
    degree, ratio = 6, 0.07
    powers = falling_powers(degree)
    basis = _vacuum_polynomials(np.array([ratio]), degree, powers)[0]  # (n_powers, 2 degree + 1)
    assert np.linalg.matrix_rank(basis) == 2 * degree + 1
    residual = np.zeros((degree + 2, degree + 2, basis.shape[1]))
    for (i, j), a in zip(powers, basis, strict=True):
        if i >= 2:
            residual[i - 2, j] += i * (i - 1) * a
            residual[i - 1, j] += ratio * i * (i - 1) * a
        if j >= 2:
            residual[i, j - 2] += j * (j - 1) * a
            residual[i + 1, j - 2] += ratio * j * (j - 1) * a
        if i >= 1:
            residual[i - 1, j] -= ratio * i * a
    low = np.add.outer(np.arange(degree + 2), np.arange(degree + 2)) <= degree - 2
    assert np.abs(residual[low]).max() < 1e-12


def harmonic_field(r, z):
    """H = -grad(z^4 - 3 z^2 r^2 + 3/8 r^4) in units of the gap, its derivatives, and psi = r A_phi."""
    L = 0.032
    r, z = r / L, z / L
    H = np.array([6 * z**2 * r - 1.5 * r**3, -4 * z**3 + 6 * z * r**2])
    dH = np.array([[6 * z**2 - 4.5 * r**2, 12 * z * r], [12 * z * r, -12 * z**2 + 6 * r**2]]) / L
    # B_z = psi_r/r and B_r = -psi_z/r
    psi = MU_0 * L**2 * (-2 * z**3 * r**2 + 1.5 * z * r**4)
    return H, dH, psi


def sampled_field(points, triangles, order, psi_of, law=AIR, coil_region="coil"):
    """What a sampler needs of a solved field, with psi given at its nodes."""
    mesh = SectionMesh(points, triangles, {"powder": np.arange(len(triangles))}, {})
    elements = SectionElements(mesh, order)
    recovery = RegionRecovery(elements, mesh.regions["powder"])
    problem = SimpleNamespace(recovery=lambda region: recovery, law_of=lambda region: law, coil_region=coil_region)
    return SimpleNamespace(problem=problem, psi=psi_of(*elements.dof_points.T), fill=None)


def random_positions(n, seed=7, low=(0.03, -0.003), high=(0.034, 0.003)):
    r, z, angle = np.random.default_rng(seed).uniform((*low, 0.0), (*high, 6.2), (n, 3)).T
    return r, z, np.column_stack((r * np.cos(angle), r * np.sin(angle), z))


def cartesian(position, r, H, dH):
    """Cartesian H (n, 3) and grad H (n, 3, 3) of meridional components."""
    c, s, o = position[:, 0] / r, position[:, 1] / r, np.zeros(r.size)
    turn = np.array([[c, -s, o], [s, c, o], [o, o, o + 1]]).transpose(2, 0, 1)
    local = np.zeros((r.size, 3, 3))
    local[:, 0, 0], local[:, 0, 2], local[:, 2, 0], local[:, 2, 2] = dH[0, 0], dH[0, 1], dH[1, 0], dH[1, 1]
    local[:, 1, 1] = H[0] / r
    return np.column_stack((c * H[0], s * H[0], H[1])), turn @ local @ turn.transpose(0, 2, 1)


@pytest.mark.parametrize(("order", "coil_region", "error"), [(2, "coil", 1e-8), (3, "coil", 1e-8), (3, "powder", 1e-6)])
@pytest.mark.parametrize("make", [RecoveredSampler, lambda *a: TableSampler(RecoveredSampler(*a))])
def test_harmonic_polynomial_is_sampled_exactly(random_triangulation, order, coil_region, error, make):
    """psi of degree 5 is within the fits of psi, H of degree 3 within element cubics and the quartic table.

    In the coil's region the fits may not assume that there is no current, and the corner of so coarse a mesh
    gets a lower degree.
    """
    points, triangles, _ = random_triangulation
    field = sampled_field(points, triangles, order, lambda r, z: harmonic_field(r, z)[2], coil_region=coil_region)
    sampler = make(field, "powder")
    r, z, position = random_positions(2000)
    H, grad = cartesian(position, r, *harmonic_field(r, z)[:2])
    found_H, found_grad = sampler.sample(position)
    assert np.abs(found_H - H).max() < error * np.abs(H).max()
    assert np.abs(found_grad - grad).max() < 100.0 * error * np.abs(grad).max()


@pytest.fixture
def both_samplers(random_triangulation):
    """Element kernel and table of a field that neither represents exactly."""
    points, triangles, _ = random_triangulation
    field = sampled_field(points, triangles, 2, lambda r, z: MU_0 * np.sin(900 * z) * (900 * r) ** 2 * np.exp(200 * r))
    recovered = RecoveredSampler(field, "powder")
    return recovered, TableSampler(recovered)


def test_element_kernel_is_lagrange_interpolation(both_samplers):
    """Against barycentric Lagrange polynomials in numpy, from the nodal values."""
    recovered, _ = both_samplers
    recovery, (r, z, position) = recovered.recovery, random_positions(500)
    element, barycentric = recovery.locator.find(np.column_stack((r, z)))
    q, shape = recovery.order, []
    for index in lattice(q):
        factors = [(q * barycentric[:, c] - k) / (k + 1) for c in range(3) for k in range(index[c])]
        shape.append(np.prod(factors, axis=0))
    values = np.einsum(
        "nk,nkc->kc", np.array(shape), recovered.nodal[recovery.connectivity[element]].transpose(1, 0, 2)
    )
    H, grad = cartesian(position, r, values[:, :2].T, values[:, 2:].T.reshape(2, 2, -1))
    found_H, found_grad = recovered.sample(position)
    assert np.allclose(found_H, H, rtol=1e-11, atol=1e-11 * np.abs(H).max())
    assert np.allclose(found_grad, grad, rtol=1e-11, atol=1e-11 * np.abs(grad).max())


def test_samples_do_not_depend_on_threads_memory_or_buffers(both_samplers):
    _, _, position = random_positions(5000)
    for sampler in both_samplers:
        first = sampler.sample(position, threads=1)
        again = sampler.sample(position)  # with remembered elements
        elsewhere = sampler.sample(position[::-1].copy())  # with wrong ones
        out = np.empty((5000, 3)), np.empty((5000, 3, 3))
        assert sampler.sample(position, out=out, threads=numba.config.NUMBA_NUM_THREADS)[1] is out[1]
        for a, b, c, d in zip(first, again, elsewhere, out, strict=True):
            assert np.array_equal(a, b) and np.array_equal(a, c[::-1]) and np.array_equal(a, d)
    with pytest.raises(ValueError, match="`threads` = 0"):
        both_samplers[0].sample(position, threads=0)


def test_sampling_outside_names_the_points(both_samplers):
    inside = np.array([[0.032, 0.0, 0.001]])
    for sampler in both_samplers:
        for bad in ([0.0, 0.0345, 0.0], [0.0, -0.032, 0.0031], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]):
            where = np.vstack((inside, [bad], inside))
            for _ in range(2):  # the second time with a remembered element
                with pytest.raises(PointOutside) as caught:
                    sampler.sample(where)
                assert caught.value.points.shape == (1, 2)
                assert caught.value.points[0] == pytest.approx([np.hypot(*bad[:2]), bad[2]], nan_ok=True)
            sampler.sample(np.repeat(inside, 3, axis=0))
        # round-off beyond a wall is not outside
        sampler.sample(np.array([[0.034 + 1e-12, 0.0, 0.003 + 1e-12], [0.03 - 1e-12, 0.0, -0.003 - 1e-12]]))


def test_table_gradient_is_the_exact_derivative_of_its_field(both_samplers):
    """Central differences of H: symmetric, and equal to grad H to their own error."""
    _, table = both_samplers
    _, _, position = random_positions(300, low=(0.0301, -0.0029), high=(0.0339, 0.0029))
    grad = table.sample(position)[1]
    assert np.array_equal(grad, grad.transpose(0, 2, 1))
    size = np.abs(grad).max()
    for j in range(3):
        step = np.zeros(3)
        step[j] = 2e-6
        numeric = (table.sample(position + step)[0] - table.sample(position - step)[0]) / 4e-6
        assert np.abs(grad[:, :, j] - numeric).max() < 2e-6 * size


def gridded(r_lines, z_lines, keep):
    """Triangles of the cells of a grid whose centres satisfy keep(r, z)."""
    r, z = np.meshgrid(r_lines, z_lines, indexing="ij")
    number = np.arange(r.size).reshape(r.shape)
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    centre = [(x[:-1, :-1] + x[1:, 1:]).ravel() / 2 for x in (r, z)]
    kept = keep(*centre)
    triangles = np.concatenate((np.column_stack((a, b, c))[kept], np.column_stack((a, c, d))[kept]))
    used, triangles = np.unique(triangles, return_inverse=True)
    return np.column_stack((r.ravel(), z.ravel()))[used], triangles.reshape(-1, 3)


def test_table_of_a_union_of_rectangles():
    """A gap around the rim of a disc and along both its faces: continuous round the corners, outside is outside."""
    lines = np.linspace(0.03, 0.034, 17), np.linspace(-0.003, 0.003, 25)
    points, triangles = gridded(*lines, lambda r, z: (r > 0.033) | (abs(z) > 0.002))
    field = sampled_field(points, triangles, 2, lambda r, z: harmonic_field(r, z)[2])
    sampler = field_sampler(field, "powder")
    assert isinstance(sampler, TableSampler)
    r, z, position = random_positions(3000)
    gap = (r > 0.033) | (abs(z) > 0.002)
    H, grad = cartesian(position, r, *harmonic_field(r, z)[:2])
    found = sampler.sample(position[gap])
    assert np.abs(found[0] - H[gap]).max() < 1e-8 * np.abs(H).max()
    assert np.abs(found[1] - grad[gap]).max() < 1e-6 * np.abs(grad).max()
    with pytest.raises(PointOutside) as caught:
        sampler.sample(position)
    assert len(caught.value.points) == np.count_nonzero(~gap)


def test_table_is_refused_where_it_does_not_fit():
    lines = np.linspace(0.03, 0.034, 13), np.linspace(-0.003, 0.003, 17)
    points, triangles = gridded(*lines, lambda r, z: r > 0.0)

    def harmonic(r, z):
        return harmonic_field(r, z)[2]

    field = sampled_field(points, triangles, 2, harmonic)
    assert isinstance(field_sampler(field, "powder"), TableSampler)
    assert isinstance(field_sampler(field, "powder", table_tolerance=0.0), RecoveredSampler)
    # a slanted wall
    slanted = points + np.column_stack((0.1 * points[:, 1], np.zeros(len(points))))
    field = sampled_field(slanted, triangles, 2, harmonic)
    assert isinstance(field_sampler(field, "powder"), RecoveredSampler)
    with pytest.raises(NoTable, match="rectangles"):
        TableSampler(RecoveredSampler(field, "powder"))
    # a current in the region: H_z = -J r has a curl, and there is no potential
    field = sampled_field(points, triangles, 2, lambda r, z: -MU_0 * r**3, coil_region="powder")
    table = TableSampler(RecoveredSampler(field, "powder"))
    assert table.difference[1] > 0.1
    assert isinstance(field_sampler(field, "powder"), RecoveredSampler)
    # no field at all is smooth
    field = sampled_field(points, triangles, 2, lambda r, z: 0.0 * r)
    assert not field_sampler(field, "powder").sample(random_positions(50)[2])[1].any()


def test_radial_field_by_finite_differences():
    field = RadialField(2e5, 0.045)
    position = np.random.default_rng(0).uniform(0.02, 0.05, (20, 3))
    H, grad = field.sample(position)
    assert np.allclose(np.linalg.norm(H, axis=1), 2e5 * 0.045 / np.hypot(*position[:, :2].T))
    for j in range(3):
        step = np.zeros(3)
        step[j] = 1e-7
        numeric = (field.sample(position + step)[0] - field.sample(position - step)[0]) / 2e-7
        assert np.allclose(grad[:, :, j], numeric, rtol=1e-6, atol=1.0)
    with pytest.raises(PointOutside):
        field.sample(np.zeros((1, 3)))


def test_uniform_field_has_no_gradient():
    H, grad = UniformField((1.0, 2.0, 3.0)).sample(np.zeros((4, 3)))
    assert np.array_equal(H, np.tile([1.0, 2.0, 3.0], (4, 1))) and not grad.any()


@pytest.mark.parametrize("wrong", [np.empty((5, 3)), np.empty((500, 3), dtype=np.float32), np.empty((3, 500)).T])
def test_results_are_not_written_beyond_the_callers_arrays(wrong):
    position = np.column_stack((np.full(500, 1e-3), np.zeros((500, 2))))
    for field in (UniformField((1.0, 0.0, 0.0)), RadialField(1.0, 1.0)):
        with pytest.raises(ValueError, match="must be a C-contiguous float64 array"):
            field.sample(position, out=(wrong, np.empty((500, 3, 3))))
