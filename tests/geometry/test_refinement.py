"""Refinement: areas, angles, names, nested children."""

import numpy as np
import pytest

from geometry import Clutch, mesh_clutch
from geometry.refinement import refine


@pytest.fixture(scope="module")
def clutch_mesh():
    return mesh_clutch(Clutch(), gap_layers=3, size_factor=3.0)


def smallest_angle(mesh):
    corners = mesh.points[mesh.triangles]
    along = corners[:, [1, 2, 0]] - corners
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    return np.arccos(-(along * along[:, [2, 0, 1]]).sum(axis=2)).min()


def edge_uses(mesh):
    sides = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    return np.unique(sides, axis=0, return_counts=True)


def random_marks(mesh, fraction=0.1, seed=0):
    return np.flatnonzero(np.random.default_rng(seed).random(len(mesh.triangles)) < fraction)


def test_names_areas_and_boundaries_are_kept(clutch_mesh):
    fine = refine(clutch_mesh, random_marks(clutch_mesh)).mesh
    assert list(fine.regions) == list(clutch_mesh.regions) and list(fine.boundaries) == list(clutch_mesh.boundaries)
    for region in fine.regions:
        assert fine.area(region) == pytest.approx(clutch_mesh.area(region), rel=1e-12)
        assert fine.volume(region) == pytest.approx(clutch_mesh.volume(region), rel=1e-12)
        assert np.all(np.diff(fine.regions[region]) > 0)
    for boundary in fine.boundaries:
        assert fine.boundary_length(boundary) == pytest.approx(clutch_mesh.boundary_length(boundary), rel=1e-12)
    assert np.all(fine.points[np.unique(fine.boundaries["axis"]), 0] == 0.0)
    assert np.array_equal(fine.points[: len(clutch_mesh.points)], clutch_mesh.points)


def test_no_hanging_nodes(clutch_mesh):
    """Every edge belongs to two triangles, or to one and then to a named outer boundary."""
    fine = refine(clutch_mesh, random_marks(clutch_mesh)).mesh
    edges, uses = edge_uses(fine)
    assert uses.max() == 2
    rim = np.sort(np.concatenate((fine.boundaries["axis"], fine.boundaries["outer"])), axis=1)
    assert np.array_equal(edges[uses == 1], np.unique(rim, axis=0))
    # Euler: points - edges + triangles of a disc
    assert len(fine.points) - len(edges) + len(fine.triangles) == 1


def test_marked_are_divided_in_four_and_children_lie_in_their_parents(clutch_mesh):
    marks = random_marks(clutch_mesh)
    refined = refine(clutch_mesh, marks)
    fine, parent = refined.mesh, refined.parent
    assert np.all(np.bincount(parent)[marks] == 4)
    shares = np.bincount(parent, fine.element_area())
    assert np.allclose(shares, clutch_mesh.element_area(), rtol=1e-12)
    corner, second, third = (clutch_mesh.points[clutch_mesh.triangles[parent, i]] for i in range(3))
    matrix = np.stack((second - corner, third - corner), axis=2)
    local = np.linalg.solve(matrix[:, None], (fine.points[fine.triangles] - corner[:, None])[..., None])[..., 0]
    assert local.min() > -1e-9 and local.sum(axis=2).max() < 1.0 + 1e-9
    assert np.array_equal(fine.region_of_element(), clutch_mesh.region_of_element()[parent])


def test_angles_stay_bounded_under_local_refinement(clutch_mesh):
    """Towards one point thirty times: sizes fall by orders of magnitude, angles by no more than a half."""
    mesh, target = clutch_mesh, np.array([Clutch().disc_radius, 0.5 * Clutch().disc_thickness])
    for _ in range(30):
        corner = np.linalg.norm(mesh.points[mesh.triangles] - target, axis=2).min(axis=1)
        mesh = refine(mesh, np.flatnonzero(corner < 1e-12)).mesh
    assert mesh.element_area().min() < 1e-15 * mesh.element_area().max()
    assert smallest_angle(mesh) > 0.5 * smallest_angle(clutch_mesh)
    assert len(mesh.triangles) < 100 * 30 + len(clutch_mesh.triangles), "as many new ones at every level"


def test_all_marked_is_a_halved_mesh(clutch_mesh):
    fine = refine(clutch_mesh, np.ones(len(clutch_mesh.triangles), dtype=bool)).mesh
    assert len(fine.triangles) == 4 * len(clutch_mesh.triangles)
    assert smallest_angle(fine) == pytest.approx(smallest_angle(clutch_mesh), rel=1e-9)


def test_nothing_marked_changes_nothing(clutch_mesh):
    refined = refine(clutch_mesh, np.zeros(0, dtype=np.int64))
    assert np.array_equal(refined.parent, np.arange(len(clutch_mesh.triangles)))
    assert np.array_equal(refined.mesh.points, clutch_mesh.points)


def test_bad_marks_are_explained(clutch_mesh):
    with pytest.raises(ValueError, match="counted from 0"):
        refine(clutch_mesh, np.array([len(clutch_mesh.triangles)]))
    with pytest.raises(ValueError, match="mask"):
        refine(clutch_mesh, np.ones(3, dtype=bool))
