"""Point location, local fits and the two uniform sources against oracles of a few lines."""

import numpy as np
import pytest
import scipy.sparse as sp

from field import PointOutside, RadialField, UniformField
from field.locate import TriangleLocator
from field.patch_fit import PatchFit


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


def test_patch_fit_reproduces_polynomials(random_triangulation):
    points, triangles, edges = random_triangulation
    centroids = points[triangles].mean(axis=1)
    x, y = (centroids - (0.032, 0.0)).T * 1e3
    fit = PatchFit(points, triangles, edges)
    derivatives = ((0, 0), (1, 0), (0, 2))
    values = 1 + 2 * x - y + 0.3 * x * y + 0.5 * y**2
    out = fit.operator(sp.identity(len(triangles), format="csr"), centroids, 2, derivatives) @ values
    nodes = (np.concatenate((points, points[edges].mean(axis=1))) - (0.032, 0.0)).T * 1e3
    exact = [
        1 + 2 * nodes[0] - nodes[1] + 0.3 * nodes[0] * nodes[1] + 0.5 * nodes[1] ** 2,
        (2 + 0.3 * nodes[1]) * 1e3,
        np.full(nodes.shape[1], 1.0) * 1e6,
    ]
    for found, wanted in zip(out.reshape(3, -1), exact, strict=True):
        assert np.allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


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
