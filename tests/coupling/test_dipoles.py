"""Dipole pairs against closed forms and conservation laws (Jackson §5.7; tests/REFERENCE.md section 2)."""

import numpy as np
import pytest

from coupling.dipoles import add_dipole_forces
from coupling.neighbour_rows import neighbour_rows
from particles import CyclicSector

pytestmark = pytest.mark.physics

MU_0 = 4e-7 * np.pi


def pair_forces(position, moment, radius, cutoff, sector=None):
    rows = neighbour_rows(position, cutoff, sector)
    force = np.zeros_like(position)
    reaction, energy = add_dipole_forces(position, moment, radius, rows, cutoff, force)
    return force, reaction, energy


@pytest.mark.parametrize(("direction", "expected"), [((1.0, 0, 0), 6.0e-3), ((0, 0, 1.0), -3.0e-3)])
def test_two_dipoles_a_tenth_of_a_metre_apart(direction, expected):
    """Coaxial 6 mN attraction, side by side 3 mN repulsion (exact)."""
    position = np.array([[0.0, 0, 0], [0.1, 0, 0]])
    force, _, _ = pair_forces(position, np.array([direction, direction]), np.full(2, 1e-3), 0.5)
    assert force[0] == pytest.approx([expected, 0, 0], rel=1e-12, abs=1e-18)
    assert force[1] == pytest.approx(-force[0], rel=1e-12, abs=1e-18)


def random_cloud(n, seed, size=10.0):
    rng = np.random.default_rng(seed)
    position = rng.uniform(-0.5 * size, 0.5 * size, (n, 3)) * 1e-3
    keep = [0]
    for i in range(1, n):
        if np.linalg.norm(position[keep] - position[i], axis=1).min() > 1e-3:
            keep.append(i)
    position = np.ascontiguousarray(position[keep])
    return position, rng.normal(size=position.shape) * 1e-4, np.full(len(position), 0.5e-3)


def test_forces_are_the_gradient_of_the_energy_also_in_the_switched_shell():
    position, moment, radius = random_cloud(60, 1)
    cutoff = 3e-3
    force, _, energy = pair_forces(position, moment, radius, cutoff)
    assert energy != 0.0
    step = 1e-8
    for i in range(0, len(position), 7):
        for axis in range(3):
            moved = [position.copy(), position.copy()]
            moved[0][i, axis] += step
            moved[1][i, axis] -= step
            slope = (
                pair_forces(moved[0], moment, radius, cutoff)[2] - pair_forces(moved[1], moment, radius, cutoff)[2]
            ) / (2 * step)
            assert force[i, axis] == pytest.approx(-slope, rel=2e-5, abs=1e-6 * np.abs(force).max())


def test_momentum_is_conserved_and_the_torque_of_the_forces_is_minus_m_cross_b():
    """sum F = 0; sum x x F (from forces) = -sum m x B (booked from fields alone)."""
    position, moment, radius = random_cloud(150, 2)
    force, reaction, _ = pair_forces(position, moment, radius, 3e-3)
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * scale
    torque = np.cross(position, force)[:, 2].sum()
    assert abs(torque) > 1e-3 * np.abs(np.cross(position, force)[:, 2]).sum()  # it is not zero by symmetry
    assert reaction == pytest.approx(torque, rel=1e-10)


def test_against_a_dense_sum_and_magpylib():
    magpylib = pytest.importorskip("magpylib")
    position, moment, radius = random_cloud(40, 3)
    sources = [magpylib.misc.Dipole(position=x, moment=m) for x, m in zip(position, moment, strict=True)]
    force, _, _ = pair_forces(position, moment, radius, 1.0)  # everything inside, unswitched
    step = 1e-7
    for i in (0, 5, 11):
        others = magpylib.Collection([s.copy() for k, s in enumerate(sources) if k != i])
        for axis in range(3):
            shift = np.zeros(3)
            shift[axis] = step
            slope = (moment[i] @ others.getB(position[i] + shift) - moment[i] @ others.getB(position[i] - shift)) / (
                2 * step
            )
            assert force[i, axis] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(force[i]).max())


def test_a_sector_with_cyclic_images_equals_the_full_ring():
    n = 12
    sector = CyclicSector(2 * np.pi / n)
    rng = np.random.default_rng(4)
    theta = rng.uniform(0, sector.angle, 40)
    r = rng.uniform(9e-3, 12e-3, 40)
    position = np.column_stack([r * np.cos(theta), r * np.sin(theta), rng.uniform(0, 3e-3, 40)])
    moment = rng.normal(size=(40, 3)) * 1e-4
    ring_position, ring_moment = [], []
    for k in range(n):
        c, s = np.cos(k * sector.angle), np.sin(k * sector.angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        ring_position.append(position @ turn.T)
        ring_moment.append(moment @ turn.T)
    ring_position, ring_moment = np.concatenate(ring_position), np.concatenate(ring_moment)
    radius = np.full(40, 0.1e-3)
    force, reaction, energy = pair_forces(position, moment, radius, 2e-3, sector)
    ring_force, ring_reaction, ring_energy = pair_forces(ring_position, ring_moment, np.full(40 * n, 0.1e-3), 2e-3)
    np.testing.assert_allclose(force, ring_force[:40], rtol=1e-9, atol=1e-12 * np.abs(force).max())
    assert n * reaction == pytest.approx(ring_reaction, rel=1e-9)
    assert n * energy == pytest.approx(ring_energy, rel=1e-9)


def test_overlapping_grains_attract_no_more_than_touching_ones():
    """|r| is clamped at the sum of the radii, so that a pressed-in contact is no singularity."""
    m = np.array([[1e-4, 0, 0], [1e-4, 0, 0]])
    touching, _, _ = pair_forces(np.array([[0.0, 0, 0], [1e-3, 0, 0]]), m, np.full(2, 0.5e-3), 3e-3)
    pressed, _, _ = pair_forces(np.array([[0.0, 0, 0], [0.9e-3, 0, 0]]), m, np.full(2, 0.5e-3), 3e-3)
    assert pressed[0, 0] == pytest.approx(touching[0, 0], rel=1e-12)


def test_saturated_touching_spheres_attract_with_the_exact_force():
    """F = (pi/6) mu_0 Ms^2 a^2 at contact (Edwards 2017)."""
    a, Ms = 0.1e-3, 1.3e6
    m = Ms * 4 / 3 * np.pi * a**3
    force, _, _ = pair_forces(
        np.array([[0.0, 0, 0], [2 * a, 0, 0]]), np.array([[m, 0, 0], [m, 0, 0]]), np.full(2, a), 1e-3
    )
    assert force[0, 0] == pytest.approx(np.pi / 6 * MU_0 * Ms**2 * a**2, rel=1e-12)


def test_result_does_not_depend_on_threads():
    import numba

    position, moment, radius = random_cloud(300, 5, size=14.0)
    forces = []
    threads = numba.get_num_threads()
    try:
        for k in (1, threads):
            numba.set_num_threads(k)
            forces.append(pair_forces(position, moment, radius, 3e-3)[0])
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(forces[0], forces[1])
