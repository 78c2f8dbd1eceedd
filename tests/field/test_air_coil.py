"""A rectangular coil in air, finite elements against the superposition of loops; rates under refinement."""

import numpy as np
import pytest
from closed_forms import rectangular_coil_field, solenoid_axis_field
from graded_lines import graded_lines
from section_grid import section_grid

from field import MU_0, AxisymmetricProblem, PointOutside

pytestmark = pytest.mark.physics

R_COIL, Z_COIL, NI = (20e-3, 30e-3), (-8e-3, 8e-3), 800.0
BOX = 1.2  # so large that the flux wall's error, (size/BOX)^3, stays below 1e-5


def exact(r, z):
    """H (2, n) and its derivatives (2, 2, n) by central differences, good to 1e-9."""
    H = np.array(rectangular_coil_field(R_COIL, Z_COIL, NI, r, z))
    d = 2e-6
    along_r = (
        np.array(rectangular_coil_field(R_COIL, Z_COIL, NI, r + d, z))
        - rectangular_coil_field(R_COIL, Z_COIL, NI, r - d, z)
    ) / (2 * d)
    along_z = (
        np.array(rectangular_coil_field(R_COIL, Z_COIL, NI, r, z + d))
        - rectangular_coil_field(R_COIL, Z_COIL, NI, r, z - d)
    ) / (2 * d)
    return H, np.stack((along_r, along_z), axis=1)


@pytest.fixture(scope="module")
def solved():
    """Fields on meshes of 2, 1 and 0.5 mm."""
    fields = {}
    for step in (2e-3, 1e-3, 0.5e-3):
        r = graded_lines(step, (18e-3, 40e-3), (0.0, BOX))
        z = graded_lines(step, (0.0, 12e-3), (0.0, BOX))
        mesh = section_grid(
            r,
            np.concatenate((-z, z)),
            {"coil": (*R_COIL, *Z_COIL), "powder": (32e-3, 36e-3, -12e-3, 12e-3)},
            jiggle=0.15,
        )
        fields[step] = AxisymmetricProblem(mesh, {}).solve(NI)
    return fields


@pytest.fixture(scope="module")
def points():
    """1500 points in r 33 to 35 mm, |z| < 10 mm, in all directions: r, z, Cartesian."""
    random = np.random.default_rng(1)
    r, z, angle = random.uniform((33e-3, -10e-3, 0.0), (35e-3, 10e-3, 6.0), (1500, 3)).T
    return r, z, np.column_stack((r * np.cos(angle), r * np.sin(angle), z))


def errors(field, points):
    """Relative RMS error of H and of grad H, Cartesian."""
    r, z, position = points
    (H_r, H_z), dH = exact(r, z)
    c, s, o = position[:, 0] / r, position[:, 1] / r, np.zeros(r.size)
    turn = np.array([[c, -s, o], [s, c, o], [o, o, o + 1]]).transpose(2, 0, 1)
    local = np.zeros((r.size, 3, 3))
    local[:, 0, 0], local[:, 0, 2], local[:, 2, 0], local[:, 2, 2] = dH[0, 0], dH[0, 1], dH[1, 0], dH[1, 1]
    local[:, 1, 1] = H_r / r  # the hoop term
    H_exact = np.column_stack((c * H_r, s * H_r, H_z))
    grad_exact = turn @ local @ turn.transpose(0, 2, 1)
    H, grad = field.sampler().sample(position)
    return (
        np.linalg.norm(H - H_exact) / np.linalg.norm(H_exact),
        np.linalg.norm(grad - grad_exact) / np.linalg.norm(grad_exact),
    )


def test_recovered_H_and_gradient_converge(solved, points):
    found = np.array([errors(field, points) for field in solved.values()])
    rate = np.log2(found[:-1] / found[1:])
    assert np.all(rate.mean(axis=0) > 1.9), f"rates {rate}, errors {found}"
    assert found[-1, 0] < 1e-4 and found[-1, 1] < 1e-3, found


def test_gradient_is_that_of_the_sampled_field(solved, points):
    """Trace zero (div B) and symmetric (curl H), to the discretisation's error."""
    _, grad = solved[0.5e-3].sampler().sample(points[2])
    size = np.linalg.norm(grad)
    assert np.linalg.norm(np.trace(grad, axis1=1, axis2=2)) < 1e-3 * size
    assert np.linalg.norm(grad - grad.transpose(0, 2, 1)) < 2e-3 * size


def test_energy_is_half_linkage_times_current(solved):
    for field in solved.values():
        assert 2 * field.energy == pytest.approx(field.flux_linkage_per_turn * NI, rel=1e-10)
        assert field.coenergy == pytest.approx(field.energy, rel=1e-12)


def test_flux_linkage_converges(solved):
    """The energy's error is the square of the field's: fourth order, spoiled somewhat by the graded air."""
    linkage = np.array([field.flux_linkage_per_turn for field in solved.values()])
    assert abs(linkage[1] - linkage[2]) < 0.15 * abs(linkage[0] - linkage[1])


def test_field_on_the_axis(solved):
    # the cells at the axis are 5 mm wide here, and B_z = (dpsi/dr)/r in them is only second order
    z = np.array([0.0, 4e-3, 9e-3])
    B = solved[0.5e-3].B_along(np.column_stack((np.zeros(3), z)))
    _, H_z = rectangular_coil_field(R_COIL, Z_COIL, NI, np.zeros(3), z)
    assert np.allclose(B[:, 1], MU_0 * H_z, rtol=1e-2)
    assert not B[:, 0].any()


def test_current_sheet_solenoid():
    r = np.unique(np.concatenate((graded_lines(1e-3, (0.0, 20e-3), (0.0, 0.6)), [20.1e-3])))
    z = graded_lines(2e-3, (0.0, 110e-3), (0.0, 0.6))
    mesh = section_grid(r, np.concatenate((-z, z)), {"coil": (20e-3, 20.1e-3, -50e-3, 50e-3)})
    field = AxisymmetricProblem(mesh, {}).solve(1000.0)
    z = np.array([0.0, 0.025, 0.1])
    B = field.B_along(np.column_stack((np.full(3, 1e-4), z)))[:, 1]
    # B on the axis is only second order in the cells there
    assert np.allclose(B / MU_0, solenoid_axis_field(20.05e-3, 0.1, 1000.0, z), rtol=5e-3)


def test_sampling_outside_the_region_names_the_point(solved):
    with pytest.raises(PointOutside, match=r"r = 50\.0000, z = 0\.0000"):
        solved[2e-3].sampler().sample(np.array([[0.05, 0.0, 0.0]]))


def test_sampler_is_cheap_to_renew(solved):
    field = solved[0.5e-3]
    assert field.sampler().recovery is field.sampler().recovery
