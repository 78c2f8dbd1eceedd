"""Element matrices against their weak forms and finite differences; the factorisation against dense ones."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

from field.factorisation import NotPositiveDefinite, SymmetricSolver, available_backends, describe_backend
from field.laws.materials import material
from field.section import weak_forms
from field.section.section_elements import QUADRATURE_ORDER, SectionElements
from field.sparse_pattern import FixedPattern
from geometry.section import SectionMesh


def jiggled_mesh(n: int = 7, seed: int = 3) -> SectionMesh:
    """A square off the axis, inner nodes moved at random."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0.02, 0.05, n), np.linspace(-0.01, 0.02, n))
    points = mesh.p.T.copy()
    inner = np.setdiff1d(np.arange(len(points)), mesh.boundary_nodes())
    points[inner] += np.random.default_rng(seed).uniform(-1e-3, 1e-3, (inner.size, 2))
    triangles = mesh.t.T.astype(np.int64)
    u, v = points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    clockwise = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
    return SectionMesh(points, triangles, {"air": np.arange(len(triangles))}, {})


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_kernels_assemble_the_weak_forms(order):
    """Force, tangent and load of saturated steel, entry by entry, as scikit-fem assembles their definitions."""
    elements, law = SectionElements(jiggled_mesh(), order), material("steel_1010")
    element = (skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3, skfem.ElementTriP4)[order - 1]()
    basis = skfem.CellBasis(elements.skfem_mesh, element, intorder=QUADRATURE_ORDER[order])
    assert np.allclose(elements.dof_points.T, basis.doflocs, rtol=0.0, atol=1e-15)
    rng = np.random.default_rng(2)
    psi = 1.5 * 0.5 * elements.dof_points[:, 0] ** 2 + 2e-5 * rng.normal(size=elements.n_dofs)
    gradient, B = elements.flux(psi)
    H, slope = law.H_of_B(B)
    force = weak_forms.field_force(law).assemble(basis, psi=psi)
    assert elements.field_force(gradient, H / B) == pytest.approx(force, rel=1e-11, abs=1e-13 * np.abs(force).max())
    expected = weak_forms.field_tangent(law).assemble(basis, psi=psi).toarray()
    everything = np.arange(elements.n_dofs)
    packed = elements.field_tangent(gradient, B, H / B, slope)
    matrix = FixedPattern(elements.element_dofs, everything, elements.n_dofs).assemble(packed)
    assert np.abs(matrix.toarray() - expected).max() < 1e-12 * np.abs(expected).max()
    density = rng.normal(size=len(B))
    J = np.repeat(density[:, None], elements.n_quadrature, axis=1)
    assert np.allclose(elements.load(density), weak_forms.load.assemble(basis, J=J), rtol=1e-11, atol=1e-18)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_tangent_is_the_derivative_of_the_force(order):
    """Central differences along a random direction, saturated steel."""
    elements, law = SectionElements(jiggled_mesh(), order), material("steel_1010")
    rng = np.random.default_rng(2)
    psi = 1.5 * 0.5 * elements.dof_points[:, 0] ** 2 + 2e-5 * rng.normal(size=elements.n_dofs)
    step = 1e-5 * rng.normal(size=elements.n_dofs)

    def force(u):
        gradient, B = elements.flux(u)
        H, slope = law.H_of_B(B)
        return elements.field_force(gradient, H / B), (gradient, B, H / B, slope)

    eps = 1e-4
    difference = (force(psi + eps * step)[0] - force(psi - eps * step)[0]) / (2.0 * eps)
    packed = elements.field_tangent(*force(psi)[1])
    matrix = FixedPattern(elements.element_dofs, np.arange(elements.n_dofs), elements.n_dofs).assemble(packed)
    # the spline's second derivative jumps at its points, so the difference is not quite second order
    assert np.abs(matrix @ step - difference).max() < 1e-5 * np.abs(difference).max()


def test_fixed_unknowns_are_left_out_and_a_dense_block_is_added():
    elements = SectionElements(jiggled_mesh(5), 2)
    constant = np.ones_like(elements.weight)
    gradient, B = elements.flux(np.zeros(elements.n_dofs))
    packed = elements.field_tangent(gradient, B, constant, constant)
    rng = np.random.default_rng(0)
    everything = np.arange(elements.n_dofs)
    free = np.sort(rng.permutation(elements.n_dofs)[: elements.n_dofs - 9])
    clique = rng.permutation(elements.n_dofs)[:12]
    dense = rng.normal(size=(12, 12))
    dense = dense + dense.T
    whole = FixedPattern(elements.element_dofs, everything, elements.n_dofs).assemble(packed).toarray()
    whole[np.ix_(clique, clique)] += dense
    part = FixedPattern(elements.element_dofs, free, elements.n_dofs, clique).assemble(packed, dense)
    assert part.has_sorted_indices
    assert np.allclose(part.toarray(), whole[np.ix_(free, free)], rtol=1e-14, atol=1e-14 * np.abs(whole).max())


@pytest.mark.parametrize("backend", available_backends())
def test_factorisation_solves_matrix_after_matrix(backend):
    elements = SectionElements(jiggled_mesh(9), 2)
    free = np.setdiff1d(np.arange(elements.n_dofs), elements.skfem_mesh.boundary_nodes())
    pattern, solver = FixedPattern(elements.element_dofs, free, elements.n_dofs), SymmetricSolver(backend)
    gradient, B = elements.flux(np.zeros(elements.n_dofs))
    rng = np.random.default_rng(4)
    for _ in range(3):
        nu = rng.uniform(1.0, 1e4, elements.weight.shape)
        matrix = pattern.assemble(elements.field_tangent(gradient, B, nu, nu))
        right = rng.normal(size=(free.size, 3))
        x = solver.solve(matrix, right)
        assert np.allclose(x, np.linalg.solve(matrix.toarray(), right), rtol=1e-9)
        assert np.allclose(solver.solve_again(right[:, 1]), x[:, 1], rtol=1e-12)
    with pytest.raises(NotPositiveDefinite):
        solver.solve(0.0 * matrix, right)


def test_backend_in_use_is_reported():
    assert "SuperLU" in describe_backend("superlu")
    assert describe_backend().startswith("sparse factorisation: ")
    with pytest.raises(ValueError, match="choose one of"):
        SymmetricSolver("cholesky")
