"""Image dipoles in steel walls against the closed form and against an explicit mirror world."""

import numpy as np
import pytest

from coupling.dipoles import add_dipole_forces
from coupling.neighbour_rows import neighbour_rows
from coupling.wall_images import add_image_forces, magnetic_wall_table
from geometry import annulus, cylinder

pytestmark = pytest.mark.physics

MU_0 = 4e-7 * np.pi


def image_forces(position, moment, radius, wall, cutoff, reflection=1.0):
    force = np.zeros_like(position)
    rows = neighbour_rows(position, cutoff, None)
    torque = add_image_forces(position, moment, radius, rows, magnetic_wall_table([wall]), reflection, cutoff, force)
    return force, torque


@pytest.mark.parametrize("reflection", [1.0, 0.8])
def test_pull_of_one_dipole_towards_steel(reflection):
    """3 mu_0 k (m_t^2 + 2 m_n^2)/(64 pi h^4), towards the wall."""
    wall = annulus("floor", "disc", 0.0, 0.0, 1.0, magnetic=True)
    h, m = 0.7e-3, np.array([1e-4, -2e-4, 3e-4])
    force, _ = image_forces(np.array([[0.3, 0.2, h]]), m[None], np.array([0.5e-3]), wall, 3e-3, reflection)
    expected = 3 * MU_0 * reflection * (m[0] ** 2 + m[1] ** 2 + 2 * m[2] ** 2) / (64 * np.pi * h**4)
    assert force[0] == pytest.approx([0, 0, -expected], rel=1e-12, abs=1e-12 * expected)


def test_images_are_a_mirrored_world_of_dipoles():
    """Forces of the images = forces that grains get from an explicit, mirrored copy of all grains."""
    wall = annulus("floor", "disc", 0.0, 0.0, 1.0, magnetic=True)
    rng = np.random.default_rng(1)
    position = np.array([[x, y, z] for x in range(4) for y in range(4) for z in range(2)]) * 1.2e-3
    position += rng.uniform(-0.05e-3, 0.05e-3, position.shape) + np.array([0.1, 0.1, 0.6e-3])
    moment = rng.normal(size=position.shape) * 1e-4
    radius = np.full(len(position), 0.5e-3)
    cutoff = 3e-3
    force, _ = image_forces(position, moment, radius, wall, cutoff)
    mirror = np.array([1.0, 1.0, -1.0])
    both = np.concatenate([position, position * mirror])
    moments = np.concatenate([moment, -moment * mirror])
    together, alone = np.zeros_like(both), np.zeros_like(position)
    add_dipole_forces(both, moments, np.full(len(both), 0.5e-3), neighbour_rows(both, cutoff, None), cutoff, together)
    add_dipole_forces(position, moment, radius, neighbour_rows(position, cutoff, None), cutoff, alone)
    np.testing.assert_allclose(force, together[: len(position)] - alone, rtol=1e-9, atol=1e-10 * np.abs(force).max())
    # flat steel takes no force along its face, whatever the moments
    assert np.abs(force[:, :2].sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


def test_a_cylinder_pulls_from_both_sides_and_only_where_it_faces_the_grain():
    wall = cylinder("bore", "rotor", 45e-3, -5e-3, 5e-3, magnetic=True)
    m = np.array([[1e-4, 0.0, 0.0]])
    a = np.array([0.1e-3])
    inside, _ = image_forces(np.array([[44.8e-3, 0.0, 0.0]]), m, a, wall, 1e-3)
    outside, _ = image_forces(np.array([[45.2e-3, 0.0, 0.0]]), m, a, wall, 1e-3)
    beyond, _ = image_forces(np.array([[44.8e-3, 0.0, 5.1e-3]]), m, a, wall, 1e-3)
    assert inside[0, 0] > 0.0
    assert outside[0, 0] == pytest.approx(-inside[0, 0], rel=1e-9)
    assert not beyond.any()
