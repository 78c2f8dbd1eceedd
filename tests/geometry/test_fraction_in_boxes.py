"""Volumes of triangles inside boxes: against Monte Carlo, and whole sections that add up whatever the mesh."""

import numpy as np
import pytest

from geometry import AnnularBox, Clutch, SectionMesh, mesh_clutch


def fraction_in_boxes(corners, boxes):
    """Shares of triangles (k, 3, 2) that make up a region; turned counter-clockwise where they are not."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    points = np.where(clockwise[:, None, None], corners[:, ::-1], corners).reshape(-1, 2)
    triangles = np.arange(len(points)).reshape(-1, 3)
    return SectionMesh(points, triangles, {"powder": np.arange(len(corners))}, {}).fraction_in_boxes("powder", boxes)


@pytest.mark.parametrize("seed", range(8))
def test_share_of_a_triangle_is_that_of_random_points(seed):
    random = np.random.default_rng(seed)
    corners = random.uniform(0.5, 2.0, (1, 3, 2))
    box = AnnularBox(0.9, 1.5, 0.8, 1.6)
    share = random.dirichlet(np.ones(3), 200_000) @ corners[0]
    inside = (share[:, 0] > box.r0) & (share[:, 0] < box.r1) & (share[:, 1] > box.z0) & (share[:, 1] < box.z1)
    expected = (share[:, 0] * inside).sum() / share[:, 0].sum()
    assert fraction_in_boxes(corners, [box])[0] == pytest.approx(expected, abs=4e-3)


def test_triangles_inside_outside_and_touching():
    corners = np.array([[[1.0, 0.0], [2.0, 0.0], [1.0, 1.0]], [[5.0, 0.0], [6.0, 0.0], [5.0, 1.0]]])
    assert np.array_equal(fraction_in_boxes(corners, [AnnularBox(1.0, 2.0, 0.0, 1.0)]), [1.0, 0.0])
    assert np.array_equal(fraction_in_boxes(corners, [AnnularBox(2.0, 5.0, 0.0, 1.0)]), [0.0, 0.0])
    halves = [AnnularBox(1.0, 1.4, 0.0, 1.0), AnnularBox(1.4, 2.0, 0.0, 1.0)]
    assert fraction_in_boxes(corners, halves)[0] == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("size_factor", [2.0, 1.0])
def test_volume_of_the_boxes_does_not_depend_on_the_mesh(size_factor):
    """The rim's box ends between the mesh's lines."""
    clutch = Clutch()
    mesh = mesh_clutch(clutch, size_factor=size_factor)
    elements = mesh.regions["powder"]
    box = clutch.fill_boxes()["rim"]
    corners = mesh.points[mesh.triangles[elements]]
    volume = 2.0 * np.pi * mesh.element_area()[elements] * corners[:, :, 0].mean(axis=1)
    assert (volume * mesh.fraction_in_boxes("powder", [box])).sum() == pytest.approx(box.volume(), rel=1e-9)
