"""Stress and torque of grains in equilibrium are those of the forces at their walls."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from loaded_grains import RING, R, clamped_ring, contact_points, near, scattered
from scipy.spatial.transform import Rotation

from particles.diagnostics.bins import RingBins, SlabBins, even_edges, ring_bins
from particles.diagnostics.profiles import profile_of, profile_sums
from particles.diagnostics.stress import grain_stress, largest_shear_stress
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable

# -- stress


@pytest.mark.parametrize("seed", range(3))
def test_mean_stress_of_grains_at_rest_is_the_moment_of_the_wall_forces(seed):
    """V sigma = -sum_walls f x: Love's identity, from the balance of every grain, to round-off."""
    grains, contacts = clamped_ring(seed=seed)
    walls = contacts.wall >= 0
    assert 10 < walls.sum() < len(walls)
    outside = -contacts.force[walls].T @ contacts.point[walls]
    scale = np.abs(outside).max()
    inside = np.einsum("n,nab->ab", grains.volume, grain_stress(grains, contacts))  # grain by grain, at the points
    np.testing.assert_allclose(inside, outside, atol=1e-12 * scale)
    np.testing.assert_allclose(inside, inside.T, atol=1e-12 * scale)  # no grain spins up


def test_stack_under_its_weight_presses_what_stands_above():
    """sigma_zz of each grain = (weights above + half its own) d/V_grain; the whole column by sum m g z: closed form."""
    n, g, d = 7, 9.81, 2 * R
    x = np.column_stack([np.zeros(n), np.zeros(n), R + d * np.arange(n)])
    grains = Grains.create(x, R, 5000.0)
    weight = grains.mass[0] * g
    pairs = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    contacts = contact_points(grains, pairs, [(0, np.zeros(3), 0)])
    contacts.force[:-1, 2] = -weight * np.arange(n - 1, 0, -1)  # on the lower one, pressed by all above
    contacts.force[-1, 2] = n * weight
    single = grain_stress(grains, contacts)[:, 2, 2]
    expected = weight * (n - np.arange(n) - 0.5) * d / grains.volume
    np.testing.assert_allclose(single, expected, rtol=1e-12)
    # body force -weight at each centre, floor force at z = 0: V sigma_zz = sum m g z
    assert np.sum(single * grains.volume) == pytest.approx(weight * x[:, 2].sum(), rel=1e-12)
    area = 4e-6
    slabs = SlabBins(2, 0, np.array([0.0, 2 * d, 4 * d]), area)
    profile = profile_of(profile_sums(grains, contacts, slabs), slabs)
    share = weight / area / (2 * d)  # lines R + d + d/2 long at loads n, n - 1, n - 2; then d/2 + d + d/2
    np.testing.assert_allclose(
        profile.normal_stress,
        share * d * np.array([0.5 * n + n - 1 + 0.5 * (n - 2), 0.5 * (n - 2) + n - 3 + 0.5 * (n - 4)]),
    )


def test_simple_cubic_block_under_hydrostatic_load_has_the_pressure_of_its_walls():
    """Every bond and wall carries F: each face of k^2 grains presses k^2 F on (k d)^2, so sigma = F/d^2 everywhere."""
    k, d, load = 4, 2 * R, 0.3
    x = R + d * np.stack(np.meshgrid(*[np.arange(k)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grains = Grains.create(x, R, 1000.0)
    walls = []
    for axis in range(3):
        for index, side in enumerate((0.0, k * d)):
            for grain in np.flatnonzero(np.abs(x[:, axis] - side) < 1.1 * R):
                point = x[grain].copy()
                point[axis] = side
                walls.append((grain, point, 2 * axis + index))
    contacts = contact_points(grains, near(grains, 1.01 * d), walls)
    contacts.force[:] = load * (x[contacts.i] - contacts.point) / R
    found = np.einsum("n,nab->ab", grains.volume, grain_stress(grains, contacts)) / (k * d) ** 3
    np.testing.assert_allclose(found, load / d**2 * np.eye(3), rtol=1e-12, atol=1e-9)
    slabs = SlabBins(2, 0, even_edges(0.0, k * d, 0.7 * d), (k * d) ** 2)
    profile = profile_of(profile_sums(grains, contacts, slabs), slabs)
    np.testing.assert_allclose(profile.normal_stress, load / d**2, rtol=1e-12)
    np.testing.assert_allclose(profile.mu, 0.0, atol=1e-12)
    # volume of the slabs' grains: pi/6 of the cube in all
    assert np.sum(profile.solid_fraction * profile.volume) == pytest.approx(np.pi / 6 * (k * d) ** 3)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_stress_turns_with_the_bed(seed):
    grains = scattered(30, seed=seed % 1000)
    contacts = contact_points(grains, near(grains, 3e-3))
    contacts.force[:] = np.random.default_rng(seed).normal(size=contacts.force.shape)
    turn = Rotation.random(random_state=seed).as_matrix()
    moved = Grains.create(grains.position @ turn.T, grains.radius, 2000.0, velocity=grains.velocity @ turn.T)
    there = ContactTable(
        contacts.i, contacts.j, contacts.wall, contacts.shift, contacts.point @ turn.T, contacts.force @ turn.T,
        contacts.overlap,
    )  # fmt: skip
    one, other = grain_stress(grains, contacts), grain_stress(moved, there)
    np.testing.assert_allclose(other, turn @ one @ turn.T, atol=1e-12 * np.abs(one).max())


# -- torque


@pytest.mark.parametrize("seed", range(3))
def test_torque_is_the_same_through_every_cylinder_and_that_of_the_walls(seed):
    """Grains at rest pass on what they are given: T(r) = torque on the inner wall = -torque on the outer one."""
    grains, contacts = clamped_ring(seed=seed)
    moment = np.cross(contacts.point, contacts.force)[:, 2]
    inner, outer = (-moment[contacts.wall == k].sum() for k in (0, 1))  # on the walls
    scale = np.abs(moment).max()
    assert abs(inner) > 0.1 * scale
    assert outer == pytest.approx(-inner, abs=1e-12 * scale)
    bins = ring_bins(RING, 0.5e-3)
    profile = profile_of(profile_sums(grains, contacts, bins), bins)
    flat = contacts.point[:, 2]
    assert flat.min() >= bins.low and flat.max() <= bins.high
    np.testing.assert_allclose(profile.torque, inner, atol=1e-11 * scale)


def test_shear_stress_of_a_thin_gap_is_its_torque():
    """T = 2 pi r^2 h tau for spokes of grains that drag each other; the branch's tilt against e_r costs (d/r)^2."""
    n, layers, d = 200, 4, 2 * R
    radius = 0.1
    r = radius + R + d * np.arange(layers)
    phi = 2 * np.pi * np.arange(n) / n
    x = np.stack([np.outer(np.cos(phi), r), np.outer(np.sin(phi), r), np.zeros((n, layers))], -1).reshape(-1, 3)
    grains = Grains.create(x, R, 1000.0)
    k = np.arange(n * layers).reshape(n, layers)
    pairs = np.stack([k[:, :-1], k[:, 1:]], -1).reshape(-1, 2)
    contacts = contact_points(grains, pairs)
    rc = np.hypot(contacts.point[:, 0], contacts.point[:, 1])
    e = np.column_stack([-contacts.point[:, 1], contacts.point[:, 0], 0 * rc]) / rc[:, None]
    contacts.force[:] = (0.2 / rc)[:, None] * e  # 0.2 N m a spoke
    bins = RingBins("r", np.array([r[0], r[1], r[2], r[3]]), -R, R)
    profile = profile_of(profile_sums(grains, contacts, bins), bins)
    np.testing.assert_allclose(profile.torque, 0.2 * n, rtol=1e-12)
    middle = 0.5 * (bins.edges[:-1] + bins.edges[1:])
    np.testing.assert_allclose(profile.shear_stress, 0.2 * n / (2 * np.pi * middle**2 * 2 * R), rtol=(d / radius) ** 2)


def test_largest_shear_stress_is_that_of_mohrs_circle():
    """Pure shear tau: tau; a uniaxial pressure p: p/2; a hydrostatic one: none."""
    stress = np.zeros((3, 3, 3))
    stress[0, 0, 1] = stress[0, 1, 0] = 3.0
    stress[1, 2, 2] = 4.0
    stress[2] = 5.0 * np.eye(3)
    assert largest_shear_stress(stress) == pytest.approx([3.0, 2.0, 0.0], abs=1e-14)
