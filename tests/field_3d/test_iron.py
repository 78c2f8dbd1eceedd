"""Iron in three dimensions: the axisymmetric answer, Newton's order, energies, forces, linear solvers."""

import numpy as np
import pytest
import sector_grid_3d as grid
from graded_lines import graded_lines
from section_grid import section_grid

from field import AIR, AxisymmetricProblem, ConvergenceError, LinearLaw, material
from field.three_d import FlatCoil, Problem3D
from field.three_d.body_force import shell_weights
from field.three_d.nodal_amg import NodalSolver
from geometry.mesh_3d import Mesh3D

pytestmark = pytest.mark.physics

POT = {
    "iron": (0.0, 28e-3, -18e-3, 18e-3),
    "window": (10e-3, 22e-3, -12e-3, 12e-3),
    "coil": (14e-3, 22e-3, -8e-3, 8e-3),
    "powder": (0.0, 10e-3, -1e-3, 1e-3),
}
COIL = FlatCoil.ring((14e-3, 22e-3), (-8e-3, 8e-3))


def pot_lines(h):
    """A pot core: post, two plates, shell, a gap of 2 mm in the post, the coil in the window; a box of air."""
    r = np.concatenate(
        (
            np.linspace(0, 10e-3, round(5e-3 / h) + 1),
            graded_lines(h, (10e-3, 14e-3), (10e-3, 22e-3)),
            np.linspace(22e-3, 28e-3, max(2, round(3e-3 / h)) + 1),
            graded_lines(3 * h, (28e-3, 31e-3), (28e-3, 80e-3)),
        )
    )
    z = np.concatenate(
        (
            np.linspace(0, 1e-3, 4),
            graded_lines(0.6 * h, (1e-3, 2e-3), (1e-3, 8e-3)),
            np.linspace(8e-3, 12e-3, max(2, round(2e-3 / h)) + 1),
            np.linspace(12e-3, 18e-3, max(2, round(3e-3 / h)) + 1),
            graded_lines(3 * h, (18e-3, 20e-3), (18e-3, 70e-3)),
        )
    )
    z = np.unique(np.round(z, 9))
    return np.unique(np.round(r, 9)), np.concatenate((-z[:0:-1], z))


@pytest.fixture(scope="module")
def pot():
    r, z = pot_lines(2e-3)
    return grid.sector_grid(r, 2, z, POT, angle=np.pi / 8, mirrored=True)


@pytest.fixture(scope="module")
def section():
    return section_grid(*pot_lines(0.7e-3), POT)


def problem(pot, law, **options):
    return Problem3D(pot, {"iron": law, "window": AIR}, COIL, outer="flux_wall", **options)


@pytest.mark.parametrize(
    ("law", "ampere_turns", "energy_tolerance"),
    [
        (LinearLaw(1e5), 500.0, 0.02),
        (LinearLaw(1e3), 500.0, 0.02),
        (material("steel_1010"), 500.0, 0.02),
        (material("steel_1010"), 40e3, 0.005),
    ],
)
def test_pot_core_reduces_to_the_axisymmetric_answer(pot, section, law, ampere_turns, energy_tolerance):
    """B in the middle of the gap within 1 %, from ideal iron to far beyond saturation, with T0 through the core."""
    flat = AxisymmetricProblem(section, {"iron": law, "window": AIR}).solve(ampere_turns)
    solid = problem(pot, law).solve(ampere_turns)
    r, z = np.array([2e-3, 4e-3, 5e-3]), np.array([0.1e-3, 0.0, 0.3e-3])
    B = solid.flux_density(np.column_stack((r * np.cos(0.2), r * np.sin(0.2), z)))
    assert np.allclose(B[:, 2], flat.flux_density(np.column_stack((r, z)))[:, 1], rtol=0.01)
    assert solid.flux_linkage_per_turn == pytest.approx(flat.flux_linkage_per_turn, rel=energy_tolerance)
    assert solid.energy + solid.coenergy == pytest.approx(solid.flux_linkage_per_turn * ampere_turns, rel=1e-7)


def test_recovered_field_in_the_gap_within_the_bore(pot, section):
    """The gap lies in the plateau of T0; H there is the axisymmetric one's, all around the machine."""
    solid = problem(pot, LinearLaw(1e3)).solve(500.0)
    flat = AxisymmetricProblem(section, {"iron": LinearLaw(1e3), "window": AIR}).solve(500.0)
    angle = np.linspace(0, 6, 40)
    x = np.column_stack((5e-3 * np.cos(angle), 5e-3 * np.sin(angle), np.linspace(-0.8e-3, 0.8e-3, 40)))
    H, grad = solid.sampler().sample(x)
    expected = flat.flux_density(np.column_stack((np.full(40, 5e-3), x[:, 2])))[:, 1] / (4e-7 * np.pi)
    assert np.allclose(H[:, 2], expected, rtol=0.02)
    assert np.abs(np.trace(grad, axis1=1, axis2=2)).max() < 0.1 * np.abs(H).max() / 1e-3


def test_newton_is_quadratic(pot, monkeypatch):
    """Without the secant steps, which are cheaper and not quadratic."""
    monkeypatch.setattr(NodalSolver, "again_is_cheap", False)
    field = problem(pot, material("steel_1010"), linear_solver="direct").solve(500.0, tolerance=1e-11)
    residual = np.array([r for r, _ in field.newton])
    order = [
        np.log(c / b) / np.log(b / a)
        for a, b, c in zip(residual, residual[1:], residual[2:], strict=False)
        if 1e-11 < c and b < 0.3
    ]
    assert max(order) > 1.7 and len(residual) < 10, residual


@pytest.mark.parametrize(("steel", "ampere_turns"), [("steel_1010", 1e5), ("steel_1010", 10.0), ("dc01", 4e3)])
def test_cold_start_converges_up_to_full_saturation(pot, steel, ampere_turns):
    assert problem(pot, material(steel)).solve(ampere_turns).newton[-1][0] <= 1e-8


@pytest.mark.parametrize("steel", ["steel_1010", "steel_1008", "dc01"])
def test_cold_start_at_forty_thousand_ampere_turns_takes_ten_factorisations(pot, steel):
    case = problem(pot, material(steel), linear_solver="direct")
    case.solve(4e4)
    assert case._solver._direct.factorisations <= 11


def test_coenergy_grows_by_linkage_times_current_and_warm_starts_are_short(pot):
    """dW'/d(N I) = linkage per turn, where the steel saturates."""
    case = problem(pot, material("steel_1010"))
    middle = case.solve(2000.0)
    up, down = case.solve(2010.0, guess=middle), case.solve(1990.0, guess=middle)
    assert (up.coenergy - down.coenergy) / 20.0 == pytest.approx(middle.flux_linkage_per_turn, rel=1e-5)
    assert middle.coenergy > middle.energy
    assert len(up.newton) < len(middle.newton)
    assert len(case.solve(2000.0, guess=middle).newton) == 1, "a solution is recognised at once"


def test_multigrid_solves_what_the_factorisation_solves(pot):
    direct, iterative = (
        problem(pot, material("steel_1010"), linear_solver=method).solve(2000.0) for method in ("direct", "multigrid")
    )
    assert iterative.energy == pytest.approx(direct.energy, rel=1e-9)
    size = np.abs(direct.phi).max()
    assert np.allclose(iterative.phi, direct.phi, atol=1e-6 * size)
    assert "conjugate gradients" in iterative.problem.linear_solver and iterative.problem.linear_iterations
    assert "factorisation" in direct.problem.linear_solver


def test_without_multigrid_package(pot, monkeypatch):
    """pyamg is optional: the coarse matrix is then factorised, and one line says so."""
    import field.three_d.nodal_amg as nodal_amg

    expected = problem(pot, LinearLaw(1e3)).solve(500.0)
    monkeypatch.setattr(nodal_amg.importlib.util, "find_spec", lambda name: None)
    case = problem(pot, LinearLaw(1e3), linear_solver="multigrid")
    assert "install pyamg" in case.linear_solver
    assert case.solve(500.0).energy == pytest.approx(expected.energy, rel=1e-9)
    monkeypatch.setattr(nodal_amg, "DIRECT_CORNERS", 10)
    case = problem(pot, LinearLaw(1e3), linear_solver="multigrid")
    assert "Gauss-Seidel only" in case.linear_solver


def test_failed_solve_says_so(pot):
    with pytest.raises(ConvergenceError, match="max_iterations"):
        problem(pot, material("steel_1010")).solve(5000.0, max_iterations=2)


RING_COIL = FlatCoil.ring((20e-3, 30e-3), (-6e-3, 6e-3))


def ring_above_coil(h, law, **options):
    """An iron ring above a coil, in air."""
    r = graded_lines(h, (15e-3, 30e-3), (0.0, 50e-3))
    z = graded_lines(h, (-6e-3, 21e-3), (-50e-3, 65e-3))
    regions = {"coil": (20e-3, 30e-3, -6e-3, 6e-3), "iron": (15e-3, 30e-3, 15e-3, 21e-3)}
    mesh = grid.sector_grid(r, max(2, round(9e-3 / h)), z, regions, angle=np.pi / 6, **options)
    return Problem3D(mesh, {"iron": law}, RING_COIL)


def toothed_discs(rotor, n_angles=6):
    """Two rings of six teeth above a coil, the rotor's teeth turned against the stator's; one sector of 60 degrees."""
    r = graded_lines(3e-3, (15e-3, 30e-3), (0.0, 60e-3))
    z = np.concatenate(
        (graded_lines(3e-3, (-6e-3, 12e-3), (-50e-3, 12e-3)), graded_lines(1.5e-3, (13.5e-3, 21e-3), (13.5e-3, 65e-3)))
    )
    step = np.pi / 3 / n_angles
    ring = (15e-3, 30e-3)
    regions = {
        "coil": (20e-3, 30e-3, -6e-3, 6e-3),
        "stator": (*ring, 9e-3, 12e-3, 0.0, 3 * step),
        "rotor": (*ring, 16.5e-3, 21e-3, rotor * step, (3 + rotor) * step),
    }
    mesh = grid.sector_grid(r, n_angles, z, regions, angle=np.pi / 3, curved=False)
    steel = material("steel_1010")
    return Problem3D(mesh, {"stator": steel, "rotor": steel}, RING_COIL)


def test_coil_force_and_iron_force_cancel():
    """J x B over the coil, Maxwell's stress around the iron: opposite, to an error that falls with the mesh."""
    error = []
    for h in (3e-3, 1.5e-3):
        field = ring_above_coil(h, material("steel_1010"), mirrored=True).solve(2000.0)
        on_iron, (on_coil, _) = field.body_force("iron"), field.current_force()
        assert on_iron.force[2] < 0.0, "iron is pulled towards the coil"
        error.append(abs(on_iron.force[2] + on_coil[2]) / on_coil[2])
        # virtual work agrees to its error estimate, which is of the size of the true error
        assert on_iron.force_error < 0.01 * on_coil[2]
    assert error[1] < 0.4 * error[0] and error[1] < 0.005, error


def test_torque_between_toothed_rings():
    """None where the teeth face each other or the gaps; else away from each other, magnetised alike side by side."""
    torque = {k: toothed_discs(k).solve(2000.0).body_force("rotor") for k in (0, 1, 3)}
    scale = torque[1].torque[2]
    assert scale > 0.0
    assert abs(torque[0].torque[2]) < 0.15 * scale and abs(torque[3].torque[2]) < 0.15 * scale
    assert abs(torque[0].virtual_torque[2]) < 0.08 * scale and abs(torque[3].virtual_torque[2]) < 0.08 * scale
    assert torque[1].torque_error < 0.15 * scale


def moved(problem, gamma, lift=0.0, turn=0.0):
    """The same device with its corners moved by gamma times a lift along z or a turn about it."""
    mesh = problem.mesh
    weight, x = gamma[: mesh.n_corners], mesh.points
    c, s = np.cos(turn * weight), np.sin(turn * weight)
    points = np.column_stack((c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1], x[:, 2] + lift * weight))
    # the sector's sides are bent with the turn: pairs of nodes stay a sector apart
    other = Mesh3D(
        points, mesh.tetrahedra, None, mesh.regions, mesh.boundaries, mesh.periodic, mesh.sector_angle, mesh.n_sectors
    )
    return Problem3D(other, problem.laws, RING_COIL)


def test_force_and_torque_are_derivatives_of_the_coenergy():
    """Virtual work's force equals (W'(+d) - W'(-d))/2d of the discrete device, moved with the same weight.

    The layer around the rotor is free of T0, which does not move with the mesh.  The torque's arm is taken at the
    quadrature points, the mesh turns at its nodes: equal to the discretisation's error only.
    """
    base = toothed_discs(1)
    found = base.solve(2000.0).body_force("rotor")
    near, _ = shell_weights(base, "rotor")

    def coenergy(**move):
        return moved(base, near, **move).solve(2000.0, tolerance=1e-10).coenergy

    d = 2e-6
    assert (coenergy(lift=d) - coenergy(lift=-d)) / (2 * d) == pytest.approx(found.virtual_force[2], rel=1e-5)
    d = 1e-4
    assert (coenergy(turn=d) - coenergy(turn=-d)) / (2 * d) == pytest.approx(found.virtual_torque[2], rel=0.02)


def test_body_that_touches_another_has_no_shell(pot):
    with pytest.raises(ValueError, match="touches coil"):
        problem(pot, LinearLaw(1e3)).solve(500.0).body_force("iron")
