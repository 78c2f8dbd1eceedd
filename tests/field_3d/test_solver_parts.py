"""The parts of the solid solver, each against a law of its own."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial import Delaunay

from field import MU_0, NU_0, FroehlichLaw, LinearLaw, material
from field.newton import _length_to_level
from field.three_d import FlatCoil, Problem3D, UniformSource
from field.three_d.elements_3d import Elements3D
from field.three_d.inverse_law import InverseLaw
from field.three_d.scalar_potential import _CoEnergy
from field.three_d.tetrahedron_locator import TetrahedronLocator
from geometry.mesh_3d import EDGES, Mesh3D


@pytest.mark.parametrize(
    "law", [FroehlichLaw(999.0, 1.7e6), material("steel_1010"), material("vacofer_s2"), LinearLaw(7)]
)
def test_inverse_law_inverts_and_integrates(law):
    B = np.concatenate((np.linspace(0, 2.5, 301), [5.0, 30.0, 80.0]))
    H, slope = law.H_of_B(B)
    inverse = InverseLaw.of(law)
    found, dB_dH = inverse.B(H), inverse.B(H, 1)
    assert np.allclose(found, B, rtol=2e-7, atol=1e-11)
    assert np.allclose(dB_dH[1:] * slope[1:], 1.0, rtol=1e-4)
    # Legendre: w*(H) = H B - w(B)
    assert np.allclose(inverse.coenergy(H), H * B - law.energy_density(B), rtol=1e-7, atol=1e-12 * NU_0)


def test_coenergy_is_the_integral_of_the_same_spline():
    inverse = InverseLaw.of(material("steel_1010"))
    for H in (100.0, 700.0, 5e4):
        by_parts, _ = quad(inverse.B, 0, H, epsabs=0, epsrel=1e-9, limit=400)
        assert inverse.coenergy(H) == pytest.approx(by_parts, rel=1e-7)


def test_law_that_falls_is_refused():
    class Falling:
        name, source = "falling", "none"

        def H_of_B(self, B):
            return NU_0 * np.sin(B), NU_0 * np.cos(B)

        def energy_density(self, B):
            return NU_0 * (1 - np.cos(B))

    with pytest.raises(ValueError, match="falling"):
        InverseLaw.of(Falling())


COILS = {
    "ring": FlatCoil.ring((20e-3, 30e-3), (-8e-3, 8e-3)),
    "racetrack": FlatCoil(60e-3, 30e-3, 30e-3, 12e-3, (0.0, 20e-3)),
    "rounded rectangle": FlatCoil(50e-3, 40e-3, 25e-3, 10e-3, (-5e-3, 5e-3)),
}


@pytest.mark.parametrize("coil", COILS.values(), ids=COILS)
def test_curl_of_the_plateau_is_the_current(coil):
    """curl T0 = J by differences, |J| the ampere-turns over the section, running anticlockwise."""
    random = np.random.default_rng(0)
    z = random.uniform(*coil.z_range, 4000)
    x = np.column_stack((random.uniform(-0.07, 0.07, (4000, 2)), z))
    d = 1e-7
    T = [(coil.T0(x + d * e)[:, 2] - coil.T0(x - d * e)[:, 2]) / (2 * d) for e in np.eye(3)[:2]]
    J = coil.current_density(x)
    smooth = np.abs(coil.current_density(x + 3 * d) - J).max(axis=1) < 1e-3 * np.abs(J).max()
    assert np.count_nonzero(smooth) > 3900
    assert np.allclose(np.column_stack((T[1], -T[0]))[smooth], J[smooth, :2], atol=1e-3 * np.abs(J).max())
    size = np.linalg.norm(J, axis=1)
    expected = 1 / (coil.width * (coil.z_range[1] - coil.z_range[0]))
    assert np.allclose(size[size > 0], expected)
    assert ((x[:, 0] * J[:, 1] - x[:, 1] * J[:, 0])[size > 0] > 0).all()
    outside = np.column_stack((x[:, :2], np.full(4000, coil.z_range[1] + 1e-3)))
    assert not coil.T0(outside).any() and not coil.current_density(outside).any()


def test_total_current_through_the_winding():
    coil = COILS["racetrack"]
    x = np.linspace(0, 0.08, 20001)
    J = coil.current_density(np.column_stack((x, 0 * x, 0 * x + 10e-3)))[:, 1]
    assert J.sum() * (x[1] - x[0]) * 20e-3 == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("coil", COILS.values(), ids=COILS)
def test_potential_difference_is_the_path_integral(coil):
    """Between points of the bore and beside or above the coil, along a path that does not cross the winding."""
    z1, z2 = coil.z_range
    bore = np.array([1e-3, 2e-3])
    heights = ([z1 - 3e-3, z1 + 1e-3], [z1 + 1e-3, z2 + 2e-3], [z1 + 1e-3, z2 - 1e-3], [z2 + 2e-3, z1 - 1e-3])
    for low, high in heights:
        start, end = np.append(bore, low), np.append(bore + 1e-3, high)
        t = (np.arange(20000) + 0.5) / 20000
        T = coil.T0(start + t[:, None] * (end - start)) @ (end - start)
        assert coil.potential_difference(start[None], end[None])[0] == pytest.approx(T.mean(), rel=1e-3, abs=1e-12)
    above = np.array([[coil.half_length_x - 0.3 * coil.width, 0.0, z2 + 1e-3]])
    beside = np.array([[coil.half_length_x - coil.width - 1e-3, 0.0, z2 - 1e-3]])
    assert coil.potential_difference(beside, above)[0] == pytest.approx(1e-3 / (z2 - z1))


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((10e-3, 10e-3, 20e-3, 2e-3, (0, 1)), "corner_radius"),
        ((10e-3, 10e-3, 5e-3, 20e-3, (0, 1)), "width"),
        ((10e-3, 10e-3, 5e-3, 2e-3, (1, 0)), "z_range"),
    ],
)
def test_impossible_coils_are_explained(numbers, words):
    with pytest.raises(ValueError, match=words):
        FlatCoil(*numbers)


def cube(n=3, bend=0.0):
    """The unit cube in 6 n^3 tetrahedra; with `bend`, quadratic ones of a smoothly bent cube."""
    g = np.arange(n + 1) / n
    points = np.stack(np.meshgrid(g, g, g, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    base = number[:-1, :-1, :-1].ravel()
    step = np.array([(n + 1) ** 2, n + 1, 1])
    tetrahedra = []
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0)):
        tetrahedra.append(
            np.column_stack((base, base + step[i], base + step[i] + step[j], base + step[i] + step[j] + step[k]))
        )
    tetrahedra = np.concatenate(tetrahedra)
    x = points[tetrahedra]
    wrong = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    tetrahedra[wrong] = tetrahedra[wrong][:, [0, 2, 1, 3]]
    second = None
    if bend:
        ends = np.sort(tetrahedra[:, EDGES], axis=2)
        keys, edge = np.unique(ends[..., 0] * len(points) + ends[..., 1], return_inverse=True)
        middle = 0.5 * (points[keys // len(points)] + points[keys % len(points)])
        second = np.concatenate((tetrahedra, len(points) + edge.reshape(-1, 6)), axis=1)
        points = np.concatenate((points, middle))
        points = points + bend * np.sin(2 * points[:, [1, 2, 0]])
    faces = np.concatenate([tetrahedra[:, f] for f in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return Mesh3D(points, tetrahedra, second, {"air": np.arange(len(tetrahedra))}, {"outer": faces[first[count == 1]]})


def test_elements_reproduce_their_polynomials():
    """Gradient of a quadratic on straight elements, of a linear one on bent ones, exact; volume of the cube."""
    elements = Elements3D(cube())
    x = elements.node_points
    found = elements.gradient(x[:, 0] ** 2 - x[:, 1] * x[:, 2])
    q = elements.quadrature_points
    assert np.allclose(found, np.column_stack((2 * q[:, 0], -q[:, 2], -q[:, 1])), atol=1e-12)
    assert elements.weight.sum() == pytest.approx(1.0, rel=1e-13)
    bent = Elements3D(cube(bend=0.05))
    assert bent.curved.all()
    assert np.allclose(bent.gradient(bent.node_points @ [1.0, -2.0, 0.5]), [1.0, -2.0, 0.5], atol=1e-11)


@pytest.mark.parametrize(("careful", "order"), [(False, 2), (True, 5)])
def test_rules_are_positive_and_exact(careful, order):
    """Integral of z^n over the reference tetrahedron is n!/(n + 3)!, up to the order of the rule."""
    corners = np.vstack((np.zeros(3), np.eye(3)))
    mesh = Mesh3D(corners, np.array([[0, 1, 2, 3]]), None, {"air": np.array([0])}, {})
    elements = Elements3D(mesh, careful=np.array([careful]))
    z, n = elements.quadrature_points[:, 2], np.arange(order + 2)
    error = np.abs((elements.weight * z ** n[:, None]).sum(axis=1) * (n + 1) * (n + 2) * (n + 3) - 1.0)
    assert elements.weight.min() > 0 and error[:-1].max() < 1e-13 and error[-1] > 1e-5


@pytest.mark.parametrize("order", [1, 2])
def test_face_rule_integrates_over_the_closed_surface(order):
    """Integral of n is zero, of x . n three times the volume: bent faces, normals outwards."""
    elements = Elements3D(cube(2, bend=0.05), order)
    nodes, points, normal, function = elements.faces("outer")
    assert np.abs(normal.sum(axis=(0, 1))).max() < 1e-14
    assert (points * normal).sum() == pytest.approx(3 * elements.weight.sum(), rel=1e-12)
    assert np.allclose(function.sum(axis=1), 1.0)
    assert np.allclose(np.einsum("qn,kna->kqa", function, elements.node_points[nodes]), points)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("outer", ["open", "flux_wall", "zero"])
def test_tangent_and_residual_are_derivatives_of_the_coenergy(order, outer):
    """By differences, where one half is saturating steel and the other air; the matrix is symmetric."""
    mesh = cube(2, bend=0.05)
    mesh.regions.update(air=np.arange(24), iron=np.arange(24, 48))
    problem = Problem3D(mesh, {"iron": FroehlichLaw(99.0, 1.7e6)}, UniformSource(), order=order, outer=outer)
    energy = _CoEnergy(problem, 3e5)
    random = np.random.default_rng(0)
    x, direction = random.normal(size=(2, problem.n_dofs)) * 1e5
    d = 1e-5
    gradient = energy.gradient(x)
    slope = (energy.value(x + d * direction)[0] - energy.value(x - d * direction)[0]) / (2 * d)
    assert (gradient * direction).sum() == pytest.approx(slope, rel=1e-6)
    K = energy.hessian(x)
    difference = (energy.gradient(x + d * direction) - energy.gradient(x - d * direction)) / (2 * d)
    assert np.allclose(K @ direction, difference, rtol=0, atol=1e-6 * np.abs(difference).max())
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_locator_finds_every_point(bend):
    elements = Elements3D(cube(3, bend))
    locator = TetrahedronLocator(elements, np.arange(len(elements.element_nodes)))
    random = np.random.default_rng(0)
    element = random.integers(len(elements.element_nodes), size=2000)
    local = random.dirichlet(np.ones(4), 2000)[:, 1:]
    points = elements.positions(element, local)
    found, where = locator.find(points)
    assert (found >= 0).all()
    assert np.allclose(elements.positions(found, where), points, atol=1e-10)
    inside = local.min(axis=1) > 0.01
    inside &= 1 - local.sum(axis=1) > 0.01
    assert np.array_equal(found[inside], element[inside])
    assert (locator.find(np.array([[3.0, 0, 0], [0.5, 0.5, -0.2], [np.nan, 0, 0]]))[0] == -1).all()


def test_uniform_field_in_air_is_exact():
    problem = Problem3D(cube(2), {}, UniformSource((0.0, 0.0, 1.0)), outer="zero")
    field = problem.solve(5.0)
    assert np.allclose(field.H_at_quadrature, [0, 0, 5.0], atol=1e-9)
    assert field.energy == pytest.approx(0.5 * MU_0 * 25.0)


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_recovery_preserves_polynomials(bend):
    """A harmonic quartic comes back exactly, with both derivatives, at nodes; degree k + 2 = 4 everywhere."""
    problem = Problem3D(cube(4, bend), {}, UniformSource(), outer="open")
    field = problem.solve(0.0)
    x, y, z = problem.elements.node_points.T
    field.phi = x**4 - 6 * x**2 * y**2 + y**4 + 2 * z
    field.ampere_turns = 3.0
    sampler = field.sampler("air")
    assert set(sampler.recovery.degrees) == {4}
    x, y, _ = sampler.recovery.nodes.T
    H = np.column_stack((-4 * x**3 + 12 * x * y**2, 12 * x**2 * y - 4 * y**3, np.full(x.size, 1.0)))
    assert np.allclose(sampler.nodal[:, :3], H, atol=1e-8)
    assert np.allclose(sampler.nodal[:, 3], -12 * x**2 + 12 * y**2, atol=1e-7)
    assert np.allclose(sampler.nodal[:, 4], 24 * x * y, atol=1e-7)


def test_recovery_does_not_amplify_noise_in_a_thin_layer():
    """Random tetrahedra one or two layers thick carry no quartic: a lower degree must take over, not a wild fit.

    Noise of size 1 in the potential may change H by 200 over the stencil's half thickness at most, by `_MAX_NOISE`.
    """
    random = np.random.default_rng(3)
    thickness = 0.1
    points = random.uniform(0, 1, (150, 3)) * [1.0, 1.0, thickness]
    points[:70, 2], points[70:140, 2] = 0.0, thickness
    points[:4, :2] = points[70:74, :2] = [[0, 0], [0, 1], [1, 0], [1, 1]]
    tetrahedra = Delaunay(points).simplices
    x = points[tetrahedra]
    volume = np.linalg.det(x[:, 1:] - x[:, :1])
    tetrahedra[volume < 0] = tetrahedra[volume < 0][:, [0, 2, 1, 3]]
    tetrahedra = tetrahedra[np.abs(volume) > 1e-6].astype(np.int64)
    mesh = Mesh3D(points, tetrahedra, None, {"air": np.arange(len(tetrahedra))}, {})
    problem = Problem3D(mesh, {}, UniformSource(), outer="flux_wall")
    recovery = problem.recovery("air")
    field = problem.solve(0.0)
    field.phi = random.choice([-1.0, 1.0], problem.elements.n_nodes)
    noise = recovery.nodal(field)[: mesh.n_corners, :3]
    assert np.abs(noise).max() < 200.0 / (0.5 * thickness) * 3**0.5
    field.phi = problem.elements.node_points @ [1.0, -2.0, 0.5]
    assert np.allclose(recovery.nodal(field)[:, :3], [-1.0, 2.0, -0.5], atol=1e-8)


def test_line_search_ends_where_the_slope_is_level():
    """W = sqrt(1 + x^2) from x = -3: Newton's step of 30 overshoots; where it stops |W'| is a fraction of its first."""

    class Bowl:
        def gradient(self, x):
            return x / np.sqrt(1 + x**2)

    x, step = np.array([-3.0]), np.array([30.0])
    slope = float((Bowl().gradient(x) * step).sum())
    length = _length_to_level(Bowl(), x, step, slope, 0.1)
    assert abs(Bowl().gradient(x + length * step)[0]) <= 0.1 * abs(Bowl().gradient(x)[0])
    assert _length_to_level(Bowl(), x, np.array([2.0]), slope / 15, 0.1) == 1.0, "a short step is not lengthened"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"outer": "round"}, "outer"),
        ({"order": 3}, "order"),
        ({"fixed": ["bottom"]}, "no boundary 'bottom'"),
        ({"linear_solver": "magic"}, "method"),
        ({"laws": {"steel": LinearLaw(2)}}, "no such region"),
    ],
)
def test_wrong_input_is_explained(options, words):
    laws = options.pop("laws", {})
    with pytest.raises(ValueError, match=words):
        Problem3D(cube(1), laws, UniformSource(), **options)


def test_wrong_current_and_guess_are_explained():
    problem, other = (Problem3D(cube(1), {}, UniformSource(), outer="zero") for _ in range(2))
    with pytest.raises(ValueError, match="finite"):
        problem.solve(np.nan)
    with pytest.raises(ValueError, match="another problem"):
        problem.solve(1.0, guess=other.solve(1.0))
    with pytest.raises(ValueError, match="no region 'gap'"):
        problem.solve(1.0).sampler("gap")
    with pytest.raises(ValueError, match="no region 'rotor'"):
        problem.solve(1.0).body_force("rotor")
