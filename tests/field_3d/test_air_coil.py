"""A rectangular coil in air in three dimensions against the superposition of loops; open boundary; source; forces."""

from dataclasses import dataclass

import numba
import numpy as np
import pytest
import sector_grid_3d as grid
from closed_forms import rectangular_coil_field
from graded_lines import graded_lines
from section_grid import section_grid

from field import AxisymmetricProblem
from field.three_d import FlatCoil, PointOutside3D, Problem3D

pytestmark = pytest.mark.physics

R_COIL, Z_COIL, NI = (20e-3, 30e-3), (-8e-3, 8e-3), 800.0
COIL = FlatCoil.ring(R_COIL, Z_COIL)
STEPS = (4e-3, 2e-3)


def mesh(step, box=0.06, angle=np.pi / 24, **options):
    r = graded_lines(1.25 * step, (20e-3, 40e-3), (0.0, box))
    z = graded_lines(step, (0.0, 12e-3), (0.0, box))
    n = max(2, round(30e-3 * angle / step))
    regions = {"coil": (*R_COIL, *Z_COIL), "powder": (30e-3, 40e-3, -12e-3, 12e-3)}
    return grid.sector_grid(r, n, np.concatenate((-z[:0:-1], z)), regions, angle=angle, **{"mirrored": True, **options})


def exact(x):
    r = np.hypot(x[:, 0], x[:, 1])
    H_r, H_z = rectangular_coil_field(R_COIL, Z_COIL, NI, r, x[:, 2])
    return np.column_stack((H_r * x[:, 0] / r, H_r * x[:, 1] / r, H_z))


@pytest.fixture(scope="module")
def points():
    """600 points in r 33 to 35 mm, |z| < 10 mm, all around."""
    r, z, angle = np.random.default_rng(1).uniform((33e-3, -10e-3, 0.0), (35e-3, 10e-3, 6.2), (600, 3)).T
    return np.column_stack((r * np.cos(angle), r * np.sin(angle), z))


@pytest.fixture(scope="module")
def solved():
    return {(order, step): Problem3D(mesh(step), {}, COIL, order=order).solve(NI) for order in (1, 2) for step in STEPS}


def relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize(("order", "raw_rate", "rate", "gradient_rate"), [(1, 0.8, 1.4, 1.0), (2, 1.7, 1.7, 0.7)])
def test_field_and_gradient_converge(solved, points, order, raw_rate, rate, gradient_rate):
    d = 2e-6
    gradient = np.stack([(exact(points + d * e) - exact(points - d * e)) / (2 * d) for e in np.eye(3)], axis=2)
    errors = []
    for step in STEPS:
        field = solved[order, step]
        H, grad = field.sampler().sample(points)
        raw = field.field_strength(points)
        errors.append([relative(raw, exact(points)), relative(H, exact(points)), relative(grad, gradient)])
    found = np.log2(np.array(errors[0]) / errors[1])
    assert np.all(found > (raw_rate, rate, gradient_rate)), (found, errors)
    assert errors[1][1] < errors[1][0], "recovery improves H"


def test_quadratic_beats_linear_elements_at_fewer_unknowns(solved, points):
    coarse, fine = solved[2, 4e-3], solved[1, 2e-3]
    assert relative(coarse.field_strength(points), exact(points)) < 0.6 * relative(
        fine.field_strength(points), exact(points)
    )


def test_open_boundary_does_not_see_the_box(points):
    """Doubling the air changes the field by less than 1e-3; with a wall, or phi = 0, by many per cent."""
    change = {}
    for outer in ("open", "flux_wall", "zero"):
        small, large = (
            Problem3D(mesh(4e-3, box), {}, COIL, outer=outer).solve(NI).field_strength(points) for box in (0.06, 0.12)
        )
        change[outer] = relative(small, large)
    assert change["open"] < 1e-3 and change["zero"] > 0.05 and change["flux_wall"] > 0.1, change


def test_energy_linkage_and_ampere_turns(solved):
    """2 W = linkage N I = 2 W' in a linear device, exactly so in the discrete one."""
    for field in solved.values():
        assert 2 * field.energy == pytest.approx(field.flux_linkage_per_turn * NI, rel=1e-8)
        assert field.coenergy == pytest.approx(field.energy, rel=1e-12)


def test_linkage_approaches_the_axisymmetric_one_from_above(solved):
    """Scalar potential: upper bound of the energy; vector potential: lower bound (Hammond and Penman 1976)."""
    r = graded_lines(1e-3, (18e-3, 32e-3), (0.0, 0.8))
    z = graded_lines(1e-3, (0.0, 10e-3), (0.0, 0.8))
    section = section_grid(r, np.concatenate((-z[:0:-1], z)), {"coil": (*R_COIL, *Z_COIL)})
    below = AxisymmetricProblem(section, {}).solve(NI).flux_linkage_per_turn
    excess = [solved[2, step].flux_linkage_per_turn / below - 1 for step in STEPS]
    assert 0.0 < excess[1] < 1e-3 and excess[1] < excess[0]


@dataclass(frozen=True)
class Shifted:
    """T0 + grad g of the same coil, g = s exp(-|x - c|^2/w^2): another source of the same current."""

    c: tuple = (25e-3, 8e-3, 12e-3)
    w: float = 15e-3
    s: float = 0.3

    def potential(self, x):
        return self.s * np.exp(-(((x - self.c) / self.w) ** 2).sum(axis=1))

    def T0(self, x):
        return COIL.T0(x) - 2 * self.potential(x)[:, None] * (x - self.c) / self.w**2

    def current_density(self, x):
        return COIL.current_density(x)

    def potential_difference(self, start, end):
        return COIL.potential_difference(start, end) + self.potential(end) - self.potential(start)


def test_field_does_not_depend_on_the_choice_of_source_field(solved, points):
    """H is that of the current: sources that differ by a gradient give the same, to the discretisation's error."""
    plain = {step: solved[2, step].field_strength(points) for step in STEPS}
    moved = {step: Problem3D(mesh(step), {}, Shifted()).solve(NI) for step in STEPS}
    change = [relative(moved[step].field_strength(points), plain[step]) for step in STEPS]
    assert change[1] < 0.01 and np.log2(change[0] / change[1]) > 1.5, change
    # and in the recovered field the gradient drops out patch by patch
    assert relative(moved[2e-3].sampler().sample(points)[0], solved[2, 2e-3].sampler().sample(points)[0]) < 0.01


def test_periodic_mirrored_and_whole_machine_agree(points):
    fields = [
        Problem3D(mesh(4e-3, angle=np.pi / 3, mirrored=mirrored), {}, COIL).solve(NI) for mirrored in (True, False)
    ]
    fields.append(Problem3D(mesh(4e-3, angle=2 * np.pi), {}, COIL).solve(NI))
    for field in fields[1:]:
        assert field.energy == pytest.approx(fields[0].energy, rel=1e-3)
        assert relative(field.sampler().sample(points)[0], fields[0].sampler().sample(points)[0]) < 0.02
        assert relative(field.field_strength(points), fields[0].field_strength(points)) < 0.03


def test_sampled_field_turns_with_the_machine(solved):
    """A point, its copies by turns of the sector and its mirror images: H and grad H turn and mirror along."""
    x = np.array([[34e-3 * np.cos(0.2), 34e-3 * np.sin(0.2), 3e-3]])
    sampler = solved[2, 4e-3].sampler()
    H, grad = sampler.sample(x)
    angle = np.pi / 3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    for move in (turn, turn @ turn, np.diag([1.0, -1.0, 1.0]), turn @ np.diag([1.0, -1.0, 1.0])):
        H_moved, grad_moved = sampler.sample(x @ move.T)
        assert np.allclose(H_moved, H @ move.T, rtol=1e-9, atol=1e-6)
        assert np.allclose(grad_moved, move @ grad @ move.T, rtol=1e-9, atol=1e-3)


@pytest.mark.parametrize("order", [1, 2])
def test_kernel_interpolates_the_nodal_values(solved, points, order):
    """Fold, element, shape functions and turn back, one after the other in numpy: the kernel to round-off."""
    field = solved[order, 4e-3]
    sampler, fold = field.sampler(), field.problem.fold
    inside, matrix = fold.into_mesh(points)
    element, local = sampler.recovery.locator.find(inside)
    nodal = sampler.nodal[sampler.recovery.connectivity[element]]
    values = np.einsum("kn,knc->kc", field.problem.elements.reference(local)[0], nodal)
    expected = fold.out_of_mesh(matrix, values[:, :3], values[:, 3:].reshape(-1, 3, 3))
    out = np.empty((len(points), 3)), np.empty((len(points), 3, 3))
    found = sampler.sample(points, out=out)
    for mine, theirs, given in zip(found, expected, out, strict=True):
        assert mine is given
        assert np.allclose(mine, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())


def test_result_depends_neither_on_memory_nor_on_threads(solved):
    """Grains that stay, move a little or change places with others: bit for bit that of a fresh sampler."""
    random = np.random.default_rng(0)
    r, z, angle = random.uniform((31e-3, -10e-3, -3.2), (39e-3, 10e-3, 3.2), (5000, 3)).T
    x = np.column_stack((r * np.cos(angle), r * np.sin(angle), z))
    field = solved[2, 4e-3]
    sampler = field.sampler()
    for moved in (x, x + random.normal(scale=1e-4, size=x.shape), x[random.permutation(len(x))]):
        expected = field.sampler().sample(moved, threads=1)
        for threads in {1, numba.config.NUMBA_NUM_THREADS}:
            assert all(map(np.array_equal, sampler.sample(moved, threads=threads), expected))


def test_point_outside_is_named(solved):
    field = solved[2, 4e-3]
    with pytest.raises(PointOutside3D, match=r"x = 50\.0000, y = 0\.0000, z = 1\.0000"):
        field.sampler().sample(np.array([[0.05, 0.0, 1e-3]]))
    with pytest.raises(PointOutside3D, match="the mesh"):
        field.field_strength(np.array([[0.5, 0.0, 1e-3]]))
    with pytest.raises(PointOutside3D):
        field.sampler().sample(np.array([[np.nan, 0.0, 1e-3]]))
    with pytest.raises(ValueError, match="carries current"):
        field.sampler("coil")


def test_no_current_no_field(solved):
    field = solved[2, 4e-3].problem.solve(0.0)
    assert field.energy == 0.0 and not field.field_strength().any()
