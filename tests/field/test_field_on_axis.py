"""B on the axis converges with the order that it has elsewhere: lines, points of VTK files, two regions at the axis."""

import numpy as np
import pytest
from closed_forms import rectangular_coil_field
from half_disc import half_disc

from emclutch.results.vtk.field_arrays import field_arrays
from field import MU_0, AxisymmetricProblem, LinearLaw, material
from field.section.eddy_currents import EddyCurrentProblem
from field.section.field_lines import field_along, straight_line

pytestmark = pytest.mark.physics

INCH = 25.4e-3
R_COIL, Z_COIL, NI = (0.5 * INCH, 1.5 * INCH), (-INCH, INCH), 1000.0
SIZES = (2.5e-3, 1.25e-3, 0.625e-3)


def axis_field(z):
    """B_z [T] on the axis of the coil, by integration of the loops over its section."""

    def part(d):
        return d * np.log((R_COIL[1] + np.hypot(R_COIL[1], d)) / (R_COIL[0] + np.hypot(R_COIL[0], d)))

    J = NI / ((R_COIL[1] - R_COIL[0]) * (Z_COIL[1] - Z_COIL[0]))
    return 0.5 * MU_0 * J * (part(Z_COIL[1] - z) - part(Z_COIL[0] - z))


def solved(size, order):
    mesh = half_disc({"coil": (*R_COIL, *Z_COIL)}, 70e-3, size, air_size=1.5 * size)
    return AxisymmetricProblem(mesh, {}, order=order, open_boundary=True).solve(NI)


def relative(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


@pytest.mark.parametrize(("order", "rate"), [(2, 1.8), (3, 2.8)])
def test_axis_field_of_a_coil_converges_with_the_order_of_the_elements(order, rate):
    """Along the axis, at the axis' points of a VTK file, and anywhere in the elements that touch it."""
    errors = []
    for size in SIZES:
        field = solved(size, order)
        along = field_along(field, straight_line((0.0, -30e-3), (0.0, 30e-3)))
        assert not along.B[:, 0].any()
        line = relative(along.B[:, 1], axis_field(along.points[:, 1]))
        arrays = field_arrays(field)
        on_axis = (arrays.points[:, 0] == 0.0) & (np.abs(arrays.points[:, 1]) < 30e-3)
        points = relative(arrays.point_arrays["flux_density"][on_axis, 1], axis_field(arrays.points[on_axis, 1]))
        elements, centroid = field.problem.elements, field.problem.mesh.centroid()
        near = elements.touches_axis & (np.abs(centroid[:, 1]) < 30e-3)
        exact = MU_0 * np.column_stack(rectangular_coil_field(R_COIL, Z_COIL, NI, *centroid[near].T))
        errors.append((line, points, relative(field.flux_density()[near], exact)))
    errors = np.array(errors)
    assert np.all(errors[0] < 5e-3), errors
    assert np.all(np.log2(errors[0] / errors[-1]) / (len(SIZES) - 1) > rate), errors


def test_field_off_the_axis_is_that_of_the_elements():
    field = solved(SIZES[0], 2)
    points = np.column_stack((np.full(5, 9e-3), np.linspace(-20e-3, 20e-3, 5)))
    element, _ = field.problem.locator.find(points)
    gradient = field.problem.elements.gradient_at(field.psi, element, points)
    assert np.array_equal(field.flux_density(points), np.column_stack((-gradient[:, 1], gradient[:, 0])) / 9e-3)


@pytest.mark.parametrize("order", [2, 3])
def test_fields_that_the_fit_holds_are_exact_in_each_region(order):
    """psi = r^2 f/2 - r^2 r^2 f''/16 with f = a + b z + c z^2: B of it at random points, two regions at the axis."""
    mesh = half_disc({"coil": (20e-3, 30e-3, -5e-3, 5e-3), "iron": (0.0, 10e-3, -5e-3, 5e-3)}, 80e-3, 3e-3)
    problem = AxisymmetricProblem(mesh, {"iron": LinearLaw(100.0, "iron")}, order=order)
    elements, random = problem.elements, np.random.default_rng(3)
    inner = np.setdiff1d(elements.element_dofs[mesh.regions["iron"]], elements.element_dofs[mesh.regions["air"]])
    factor = np.ones(elements.n_dofs)
    factor[inner] = 3.0  # psi of air everywhere, and another one inside the iron
    r, z = elements.dof_points.T
    a, b, c = 0.3, 40.0, 2e3
    psi = factor * (0.5 * r**2 * (a + b * z + c * z**2) - 0.125 * c * r**4)
    element = np.intersect1d(np.flatnonzero(elements.touches_axis), mesh.regions["air"])
    share = random.dirichlet((1.0, 1.0, 1.0), element.size)
    points = np.einsum("ec,eci->ei", share, mesh.points[mesh.triangles[element]])
    r, z = points.T
    exact = np.column_stack((-r * (0.5 * b + c * z), a + b * z + c * z**2 - 0.5 * c * r**2))
    assert np.allclose(elements.flux_density_at(psi, element, points), exact, rtol=0, atol=1e-9)


def test_field_on_the_axis_of_a_saturated_core_converges():
    """H alone is free of curl there: fields of air that were fitted to B were wrong by 30 %."""
    found = []
    for size in (2e-3, 1e-3, 0.5e-3):
        parts = {"coil": (12e-3, 24e-3, -8e-3, 8e-3), "core": (0.0, 8e-3, -12e-3, 12e-3)}
        mesh = half_disc(parts, 50e-3, size, air_size=3.0 * size)
        problem = AxisymmetricProblem(mesh, {"core": material("steel_1010")}, open_boundary=True)
        assert "core" not in problem.elements.curl_free and "air" in problem.elements.curl_free
        points = np.column_stack((np.full(41, 0.3e-3), np.linspace(-11.5e-3, 11.5e-3, 41)))
        found.append(problem.solve(20e3).flux_density(points))
    errors = [np.sqrt(np.mean((one - found[-1]) ** 2)) / np.abs(found[-1]).max() for one in found[:-1]]
    assert errors[0] < 0.02 and errors[1] < 0.5 * errors[0], errors


def test_conductors_are_not_free_of_curl():
    mesh = half_disc({"coil": (20e-3, 30e-3, -5e-3, 5e-3), "rod": (0.0, 10e-3, -5e-3, 5e-3)}, 80e-3, 5e-3)
    problem = AxisymmetricProblem(mesh, {"rod": LinearLaw(1.0, "aluminium")})
    assert problem.elements.curl_free == {"air", "rod"}
    EddyCurrentProblem(problem, {"rod": 3e7})
    assert problem.elements.curl_free == {"air"}
