"""Moments fed back in 3D: a ring of grains has the moments and forces of all its pairs, and counts no pair twice.

The reference are dense sums over all dipoles of the ring (`fed_back_grains.all_pairs`), of which smear and field know
nothing, and direct sums of the smear's kernel over the copies of a sector.
"""

import numpy as np
import pytest
from fed_back_grains import IRON, A, D, all_pairs, fed_back, random_grains, turned
from sector_grid_3d import sector_grid

from coupling.smear_region import elements_within
from coupling.smeared_grains_3d import smear_3d
from field import PowderLaw
from field.three_d import Problem3D, SectorFold, UniformSource
from particles import Body
from particles.sector import CyclicSector

pytestmark = pytest.mark.physics

N, H0 = 12, 1e5
WIDTH = 2.5 * D


def lines(low, high, step, end):
    """Even from low to high, with growing steps out to the end (or 0)."""
    inner = np.linspace(low, high, round((high - low) / step) + 1)
    outer = high + (end - high) * np.array([0.12, 0.35, 1.0])
    return np.concatenate((inner, outer))


def mesh_of(step, mirrored=False):
    r = np.concatenate((np.linspace(0.0, 14e-3, 4)[:-1], lines(14e-3, 34e-3, step, 70e-3)))
    z = lines(0.0, 10e-3, step, 45e-3)
    angle = np.pi / N if mirrored else 2.0 * np.pi / N
    parts = max(2, round(angle * 24e-3 / step))
    powder = {"powder": (18e-3, 30e-3, -5e-3, 5e-3)}
    return sector_grid(r, parts, np.concatenate((-z[:0:-1], z)), powder, angle=angle, mirrored=mirrored)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_smear_is_the_mean_over_the_symmetry_of_the_mesh(mirrored):
    """K(s) summed over all copies of the ring, for a mirrored mesh with both images."""
    mesh = mesh_of(5e-3, mirrored)
    random = np.random.default_rng(3)
    x = random_grains(N, (20e-3, 28e-3), 8e-3, 0.1, 1)
    amounts = np.column_stack((np.full(len(x), 4.2e-9), random.normal(size=(len(x), 3))))
    share = 2.0 * np.pi / (2.0 * np.pi / N) / mesh.n_sectors
    points = mesh.centroid()
    found = smear_3d(points, x, share * amounts, WIDTH, SectorFold(mesh))
    expected = np.zeros_like(found)
    for mirror in ((np.eye(3), np.diag([1.0, -1.0, 1.0])) if mirrored else (np.eye(3),)):
        places, moments = turned(x @ mirror, N).reshape(-1, 3), turned(amounts[:, 1:] @ mirror, N).reshape(-1, 3)
        volumes = np.tile(amounts[:, 0], N)
        s2 = ((points[:, None] - places) ** 2).sum(axis=2) / WIDTH**2
        K = 105.0 / (32.0 * np.pi * WIDTH**3) * np.maximum(1.0 - s2, 0.0) ** 2 * share
        expected += (K @ np.column_stack((volumes, moments))).T
    assert np.allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


def test_a_ring_of_grains_has_the_moments_and_forces_of_all_its_pairs():
    """Moments within 2.5 %, forces within 4 % of the largest with elements of 0.4 widths; coarser ones are worse."""
    x = random_grains(N, (20e-3, 28e-3), 8e-3, 0.2, 2)
    moment, force = all_pairs(x, A, IRON, np.array([0.0, 0.0, H0]), N)
    errors = []
    for step in (3.4e-3, 2.0e-3):
        mesh = mesh_of(step)
        problem = Problem3D(
            mesh, {}, UniformSource(), powder_law=PowderLaw(IRON), powder_beyond=elements_within(mesh, [], WIDTH)
        )
        found = fed_back(
            problem, IRON, x, A, WIDTH, sector=CyclicSector(2.0 * np.pi / N), ampere_turns=H0, agree=1e-4,
            tolerance=1e-6, carrier=Body("disc"), solves=12,
        )  # fmt: skip
        errors.append(
            (
                np.linalg.norm(found.moment - moment, axis=1).max() / np.linalg.norm(moment, axis=1).mean(),
                np.linalg.norm(found.force - force, axis=1).max() / np.linalg.norm(force, axis=1).max(),
            )
        )
    assert errors[1][0] < 0.025 and errors[1][1] < 0.04
    assert errors[1][0] < errors[0][0] and errors[1][1] < errors[0][1]
