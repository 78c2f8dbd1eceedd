"""Profiles: prescribed flows have their shear rate, slip and temperature; bins part grains without loss."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from loaded_grains import RING, R, clamped_ring, contact_points, scattered

from geometry.walls import Plane, cylinder
from particles.diagnostics.bins import RingBins, SlabBins, contact_fractions, even_edges, ring_bins
from particles.diagnostics.enclosed_space import BoxSpace, enclosed_space
from particles.diagnostics.profiles import profile_of, profile_sums
from particles.grains import Grains

# -- flow


@pytest.mark.parametrize("along", ["r", "z"])
def test_rigid_rotation_has_neither_shear_nor_slip_nor_temperature(along):
    grains = scattered(300)
    x, omega = grains.position, 37.0
    grains.velocity[:] = omega * np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]])
    grains.angular_velocity[:] = [0.0, 0.0, omega]
    bins = ring_bins(RING, 1e-3, along=along)
    none = contact_points(grains, np.zeros((0, 2), dtype=np.int64))
    profile = profile_of(profile_sums(grains, none, bins), bins, {"rotor": omega, "disc": 0.0})
    np.testing.assert_allclose(profile.angular_speed, omega, rtol=1e-12)
    np.testing.assert_allclose(profile.spin, omega, rtol=1e-12)
    np.testing.assert_allclose(profile.slip["rotor"], 0.0, atol=1e-12)
    np.testing.assert_allclose(profile.slip["disc"], profile.velocity, rtol=1e-12)
    np.testing.assert_allclose(profile.shear_rate, 0.0, atol=1e-9)
    np.testing.assert_allclose(profile.temperature, 0.0, atol=1e-20)
    np.testing.assert_allclose(profile.pressure, 0.0, atol=1e-15)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_plane_couette_flow_has_its_shear_rate_and_no_temperature(axis):
    flow, rate = (axis + 1) % 3, 12.5
    rng = np.random.default_rng(2)
    grains = Grains.create(0.01 * rng.random((400, 3)), R, 2500.0)
    grains.velocity[:, flow] = 3.0 + rate * grains.position[:, axis]
    bins = SlabBins(axis, flow, even_edges(0.0, 0.01, 1e-3), 1e-4)
    none = contact_points(grains, np.zeros((0, 2), dtype=np.int64))
    profile = profile_of(profile_sums(grains, none, bins), bins)
    np.testing.assert_allclose(profile.shear_rate, rate, rtol=1e-11)
    np.testing.assert_allclose(profile.velocity, 3.0 + rate * profile.position, rtol=1e-12)
    np.testing.assert_allclose(profile.temperature, 0.0, atol=1e-20)


def test_circular_couette_flow_converges_at_second_order():
    """Omega = A + B/r^2 between cylinders shears at -2 B/r^2: halving the bins quarters the error inside."""
    a, b, rng = 5.0, 2e-3, np.random.default_rng(0)
    r, phi = np.sqrt(rng.uniform(0.010**2, 0.014**2, 200_000)), rng.uniform(0, 2 * np.pi, 200_000)
    x = np.column_stack([r * np.cos(phi), r * np.sin(phi), 0 * r])
    v = (a + b / r**2)[:, None] * np.column_stack([-x[:, 1], x[:, 0], 0 * r])
    grains = Grains.create(x, 1e-6, 1.0, velocity=v)
    none = contact_points(grains, np.zeros((0, 2), dtype=np.int64))
    errors = []
    for count in (5, 10, 20):
        bins = RingBins("r", np.linspace(0.010, 0.014, count + 1), -1.0, 1.0)
        profile = profile_of(profile_sums(grains, none, bins), bins)
        errors.append(np.max(np.abs(profile.shear_rate * profile.position**2 / (-2 * b) - 1.0)[1:-1]))
    assert math.log2(errors[0] / errors[1]) > 1.8 and math.log2(errors[1] / errors[2]) > 1.6
    assert errors[2] < 2e-3


def test_temperature_is_that_of_the_velocities_drawn():
    """Normal velocities of variance s^2 on a shear: T = s^2 and kinetic pressure rho phi T, to 3 % of 30 000 grains."""
    rng, s = np.random.default_rng(5), 0.2
    x = 0.1 * rng.random((30_000, 3))
    v = s * rng.normal(size=x.shape)
    v[:, 0] += 40.0 * x[:, 2]
    grains = Grains.create(x, 5e-4, 2500.0, velocity=v)
    bins = SlabBins(2, 0, np.linspace(0.0, 0.1, 6), 0.01)
    profile = profile_of(profile_sums(grains, contact_points(grains, np.zeros((0, 2), dtype=np.int64)), bins), bins)
    np.testing.assert_allclose(profile.temperature, s**2, rtol=0.03)
    np.testing.assert_allclose(profile.pressure, 2500.0 * profile.solid_fraction * profile.temperature, rtol=1e-12)
    np.testing.assert_allclose(profile.shear_rate, 40.0, rtol=0.02)


# -- bins


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["r", "z"]), st.integers(1, 40))
def test_bins_part_grains_and_contacts_without_loss(seed, along, count):
    """Volumes over all bins that cover a grain add up to its own, shares of a contact to 1."""
    grains = scattered(20, seed=seed)
    if along == "r":
        bins = RingBins("r", np.linspace(0.002, 0.008, count + 1), -0.001, 0.003)
    else:
        bins = RingBins("z", np.linspace(-0.001, 0.003, count + 1), 0.002, 0.008)
    parts = bins.grain_volumes(grains)
    np.testing.assert_allclose(parts.sum(axis=0), grains.volume, rtol=1e-9)
    assert parts.data.min() >= 0.0
    s = bins.coordinate(grains.position)
    np.testing.assert_allclose(contact_fractions(s[:-1], s[1:], bins.edges).sum(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(contact_fractions(s, s, bins.edges).sum(axis=0), 1.0)


def test_grain_half_out_of_the_bins_counts_half():
    """Centres on a far limit (there a cylinder is a plane): half of the volume is inside, whichever limit it is."""
    big = 1e3
    x = np.array([[big, 0.0, 0.5], [big + 0.5, 0.0, 0.0], [big + 0.5, 0.0, 1.0]])
    grains = Grains.create(x, 0.2, 1.0)
    shells = RingBins("r", np.array([big, big + 1.0]), 0.0, 1.0)
    discs = RingBins("z", np.array([0.0, 1.0]), big, big + 1.0)
    for bins in (shells, discs):
        np.testing.assert_allclose(bins.grain_volumes(grains).sum(axis=0) / grains.volume, 0.5, rtol=1e-3)


def test_empty_bins_have_no_mean():
    grains = scattered(50)
    bins = RingBins("r", np.array([0.003, 0.005, 0.007, 0.05, 0.06]), 0.0, 0.002)
    none = contact_points(grains, np.zeros((0, 2), dtype=np.int64))
    profile = profile_of(profile_sums(grains, none, bins), bins)
    assert profile.solid_fraction[3] == 0.0 and np.isnan(profile.velocity[3]) and np.isfinite(profile.shear_rate[0])


@pytest.mark.parametrize(
    "make",
    [
        lambda: RingBins("r", np.array([0.0]), 0.0, 1.0),
        lambda: RingBins("r", np.array([-1.0, 1.0]), 0.0, 1.0),
        lambda: RingBins("z", np.array([0.0, 1.0]), 2.0, 1.0),
        lambda: SlabBins(2, 2, np.array([0.0, 1.0]), 1.0),
        lambda: SlabBins(2, 0, np.array([1.0, 0.0]), 1.0),
    ],
)
def test_impossible_bins_are_refused(make):
    with pytest.raises(ValueError, match=r"increase|hold no ring|different"):
        make()


def test_moments_are_averaged_as_sums():
    """Two moments: the mean speed is weighed by mass, the stress and the torque are plain means."""
    bins = ring_bins(RING, 1e-3)
    many, few = clamped_ring(30, seed=0), clamped_ring(25, seed=1)
    sums = [profile_sums(*one, bins) for one in (many, few)]
    both = profile_of(sums[0] + sums[1], bins)
    one, other = (profile_of(s, bins) for s in sums)
    assert both.moments == 2
    np.testing.assert_allclose(both.torque, 0.5 * (one.torque + other.torque))
    np.testing.assert_allclose(both.pressure, 0.5 * (one.pressure + other.pressure))
    lever = [s.lever_mass for s in sums]
    np.testing.assert_allclose(both.angular_speed, np.average([one.angular_speed, other.angular_speed], 0, lever))


# -- space


def test_space_is_what_the_walls_span():
    grains = scattered(10)
    ring = enclosed_space(
        grains, [cylinder("in", "disc", 0.003, 0.0, 0.002), cylinder("out", "rotor", 0.007, 0.0, 0.002)]
    )
    assert ring == RING
    floor = Plane("floor", "housing", [0.0, 0.0, -0.5], [0.0, 0.0, 1.0])
    box = enclosed_space(grains, [floor, Plane("tilted", "housing", [0, 0, 0], [1.0, 0.0, 1.0])])
    assert isinstance(box, BoxSpace) and box.lower[2] == -0.5
    np.testing.assert_allclose(box.upper, (grains.position + grains.radius[:, None]).max(axis=0))
    assert box.volume == pytest.approx(np.prod(box.upper - box.lower))
    tube = enclosed_space(grains, [floor, cylinder("out", "rotor", 0.007, -0.5, 0.5)])
    assert tube.z0 == -0.5 and tube.r0 == pytest.approx(np.min(np.hypot(*grains.position.T[:2]) - grains.radius))


def test_bins_that_hold_the_same_grain_have_no_slope_between_them():
    """A lone grain across an edge: both bins have its place as their mean, and no shear rate follows."""
    grains = Grains.create(np.array([[0.005, 0.0, 0.001]]), np.array([R]), 2000.0, velocity=np.array([[0.0, 1.0, 0.0]]))
    bins = ring_bins(RING, 1e-3)
    profile = profile_of(profile_sums(grains, contact_points(grains, np.zeros((0, 2), dtype=np.int64)), bins), bins)
    held = profile.solid_fraction > 0.0
    assert held.sum() == 2 and np.allclose(profile.velocity[held], 1.0)
    assert np.isnan(profile.shear_rate).all() and np.allclose(profile.temperature[held], 0.0)
