"""Stress, torque and profiles: statics as an oracle, prescribed flows, and a sector against its ring."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geometry.walls import AnnularBox, Plane, cylinder
from particles.diagnostics.bins import RingBins, SlabBins, contact_shares, even_edges, ring_bins
from particles.diagnostics.enclosed_space import BoxSpace, enclosed_space
from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains
from particles.diagnostics.profiles import profile_of, profile_sums, torque_through
from particles.diagnostics.stress import contact_stress, grain_stress, kinetic_stress
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sector import CyclicSector

R = 0.5e-3
RING = AnnularBox(0.003, 0.007, 0.0, 0.002)


def scattered(count, space=RING, seed=0, angle=2.0 * math.pi):
    """Grains of two sizes anywhere in a ring; contacts need no overlap to carry a force here."""
    rng = np.random.default_rng(seed)
    r = np.sqrt(rng.uniform((space.r0 + 2 * R) ** 2, (space.r1 - 2 * R) ** 2, count))
    phi = rng.uniform(0.0, angle, count)
    x = np.column_stack([r * np.cos(phi), r * np.sin(phi), rng.uniform(space.z0 + R, space.z1 - R, count)])
    v, w = rng.normal(size=(2, count, 3))
    return Grains.create(x, rng.choice([0.6 * R, R], count), 2000.0, velocity=v, angular_velocity=w)


def near(grains, reach=1.3e-3):
    return cKDTree(grains.position).query_pairs(reach, output_type="ndarray").astype(np.int64)


def contact_points(grains, pairs, walls=()):
    """Contact table with zero forces: pairs, then walls given as (grain, point, index)."""
    i, j = pairs.T
    x, radius = grains.position, grains.radius
    point = x[i] + (x[j] - x[i]) * (radius[i] / (radius[i] + radius[j]))[:, None]
    at = np.array([w[0] for w in walls], dtype=np.int64)
    there = np.array([w[1] for w in walls]).reshape(-1, 3)
    m = len(i) + len(at)
    return ContactTable(
        np.concatenate([i, at]), np.concatenate([j, np.full(len(at), -1)]),
        np.concatenate([np.full(len(i), -1), np.array([w[2] for w in walls], dtype=np.int64)]),
        np.zeros(m, dtype=np.int64), np.concatenate([point, there]), np.zeros((m, 3)), np.zeros(m),
    )  # fmt: skip


def in_equilibrium(grains, contacts, seed):
    """Contact forces under which every grain rests: something random, dragged along by the outer wall, projected on the
    null space of the balances of force and moment."""
    m, n = len(contacts.i), grains.count
    rows = np.zeros((n, 6, m, 3))
    for k in range(m):
        for grain, sign in ((contacts.i[k], 1.0), (contacts.j[k], -1.0)):
            if grain < 0:
                continue
            arm = (contacts.point[k] - grains.position[grain]) / R
            rows[grain, :3, k] = sign * np.eye(3)
            rows[grain, 3:, k] = sign * np.cross(np.eye(3), arm)  # = sign [arm x], the matrix of arm x force
    free = null_space(rows.reshape(6 * n, 3 * m))
    assert free.shape[1] > 0
    x, end = grains.position, np.where((contacts.j >= 0)[:, None], grains.position[contacts.j], contacts.point)
    outward = np.sign(np.hypot(end[:, 0], end[:, 1]) - np.hypot(x[contacts.i, 0], x[contacts.i, 1]))
    wish = np.random.default_rng(seed).normal(size=(m, 3))
    wish += 200.0 * outward[:, None] * np.column_stack([-contacts.point[:, 1], contacts.point[:, 0], np.zeros(m)])
    contacts.force[:] = (free @ (free.T @ wish.ravel())).reshape(m, 3)
    return contacts


@cache
def clamped_ring(count=30, seed=0):
    """Grains in equilibrium between two cylinders that every grain within reach leans on."""
    grains = scattered(count, seed=seed)
    x = grains.position
    r = np.hypot(x[:, 0], x[:, 1])
    e = x * [1.0, 1.0, 0.0] / r[:, None]
    walls = []
    for index, (wall, sign) in enumerate(((RING.r0, -1.0), (RING.r1, 1.0))):
        walls += [(k, x[k] + (wall - r[k]) * e[k], index) for k in np.flatnonzero(sign * (wall - r) < 4.0 * R)]
    return grains, in_equilibrium(grains, contact_points(grains, near(grains, 3.0e-3), walls), seed)


# -- stress


@pytest.mark.parametrize("seed", range(3))
def test_mean_stress_of_grains_at_rest_is_the_moment_of_the_wall_forces(seed):
    """V sigma = -sum_walls f x: Love's identity, from the balance of every grain, to round-off."""
    grains, contacts = clamped_ring(seed=seed)
    volume = RING.volume()
    found = contact_stress(grains, contacts, volume)
    walls = contacts.wall >= 0
    assert 10 < walls.sum() < len(walls)
    outside = -contacts.force[walls].T @ contacts.point[walls] / volume
    scale = np.abs(outside).max()
    np.testing.assert_allclose(found.cartesian, outside, atol=1e-12 * scale)
    np.testing.assert_allclose(found.cartesian, found.cartesian.T, atol=1e-12 * scale)  # no grain spins up
    inside = np.einsum("n,nab->ab", grains.volume, grain_stress(grains, contacts))  # grain by grain, at the points
    np.testing.assert_allclose(inside, volume * found.cartesian, atol=1e-12 * scale * volume)
    assert found.pressure == pytest.approx(np.trace(found.cylindrical) / 3.0, abs=1e-12 * scale)


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
    area, height = 4e-6, n * d
    found = contact_stress(grains, contacts, area * height)
    # body force -weight at each centre, floor force at z = 0: V sigma_zz = sum m g z
    assert found.cartesian[2, 2] == pytest.approx(weight * x[:, 2].sum() / (area * height), rel=1e-12)
    assert found.deviatoric == pytest.approx(found.cartesian[2, 2])
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
    found = contact_stress(grains, contacts, (k * d) ** 3)
    np.testing.assert_allclose(found.cartesian, load / d**2 * np.eye(3), rtol=1e-12, atol=1e-9)
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
    for one, other in (
        (contact_stress(grains, contacts, 1e-7), contact_stress(moved, there, 1e-7)),
        (kinetic_stress(grains, 1e-7), kinetic_stress(moved, 1e-7)),
    ):
        scale = np.abs(one.cartesian).max()
        np.testing.assert_allclose(other.cartesian, turn @ one.cartesian @ turn.T, atol=1e-12 * scale)
        assert other.deviatoric == pytest.approx(one.deviatoric)


def test_volume_of_a_stress_must_be_positive():
    grains, contacts = clamped_ring()
    with pytest.raises(ValueError, match="more than 0"):
        contact_stress(grains, contacts, 0.0)


# -- torque


@pytest.mark.parametrize("seed", range(3))
def test_torque_is_the_same_through_every_cylinder_and_that_of_the_walls(seed):
    """Grains at rest pass on what they are given: T(r) = torque on the inner wall = -torque on the outer one."""
    grains, contacts = clamped_ring(seed=seed)
    moment = np.cross(contacts.point, contacts.force)[:, 2]
    inner, outer = (-moment[contacts.wall == k].sum() for k in (0, 1))  # on the walls
    scale = np.abs(moment).max()
    assert abs(inner) > 0.1 * scale
    radii = np.linspace(RING.r0, RING.r1, 23)[1:-1]
    through = torque_through(grains, contacts, radii)
    np.testing.assert_allclose(through, inner, atol=1e-12 * scale)
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
    np.testing.assert_allclose(contact_shares(s[:-1], s[1:], bins.edges).sum(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(contact_shares(s, s, bins.edges).sum(axis=0), 1.0)


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


# -- sector


def wedge_and_ring(parts=5, seed=0):
    """Grains of one sector with forces between them and the images of their neighbours; and the full ring of copies."""
    sector = CyclicSector(2.0 * math.pi / parts)
    rng = np.random.default_rng(seed)
    wedge = scattered(60, seed=seed, angle=sector.angle)
    n = wedge.count
    copies = [sector.rotation(k) for k in range(parts)]
    x, v, w = (
        np.concatenate([a @ turn.T for turn in copies])
        for a in (wedge.position, wedge.velocity, wedge.angular_velocity)
    )
    ring = Grains.create(x, np.tile(wedge.radius, parts), 2000.0, velocity=v, angular_velocity=w)
    image = wedge.position @ copies[1].T
    inside = near(wedge, 2.5e-3)
    a, b = np.nonzero(np.linalg.norm(wedge.position[:, None] - image[None], axis=2) < 2.5e-3)
    assert len(a) > 3
    i, j = np.concatenate([inside[:, 0], a]), np.concatenate([inside[:, 1], b])
    shift = np.repeat([0, 1], [len(inside), len(a)])
    there = np.where((shift == 1)[:, None], image[j], wedge.position[j])
    force = -rng.exponential(size=(len(i), 1)) * (there - wedge.position[i]) / R + 0.1 * rng.normal(size=there.shape)
    point = 0.5 * (wedge.position[i] + there)
    wall = np.arange(0, n, 3)
    k = np.arange(parts)[:, None]
    blank = np.full(len(wall), -1)

    def joined(i, j, wall_rows, shift, point, force):
        m = len(i) + len(wall_rows)
        return ContactTable(
            np.concatenate([i, wall_rows]), np.concatenate([j, np.full(len(wall_rows), -1)]),
            np.repeat([-1, 0], [len(i), len(wall_rows)]), np.concatenate([shift, np.zeros(len(wall_rows), int)]),
            point, force, np.zeros(m),
        )  # fmt: skip

    e = wedge.position[wall] * [1.0, 1.0, 0.0]
    at_wall = e / np.hypot(e[:, 0], e[:, 1])[:, None] * RING.r1 + wedge.position[wall] * [0.0, 0.0, 1.0]
    push = rng.normal(size=(len(wall), 3))
    whole = joined(
        (k * n + i).ravel(), ((k + shift) % parts * n + j).ravel(), (k * n + wall).ravel(),
        np.zeros(parts * len(i), int),
        np.concatenate([p @ t.T for p in (point,) for t in copies] + [at_wall @ t.T for t in copies]),
        np.concatenate([f @ t.T for f in (force,) for t in copies] + [push @ t.T for t in copies]),
    )  # fmt: skip
    # one in two contacts through the face is kept from its other side: partner at R^-1
    swap = (shift == 1) & (rng.random(len(i)) < 0.5)
    back = np.where(swap, -1, 0)
    point, force = sector.turn(point, back), np.where(swap[:, None], -1.0, 1.0) * sector.turn(force, back)
    i, j, shift = np.where(swap, j, i), np.where(swap, i, j), np.where(swap, -1, shift)
    assert {-1, 0, 1} <= set(shift.tolist()) and len(blank) > 3
    part = joined(i, j, wall, shift, np.concatenate([point, at_wall]), np.concatenate([force, push]))
    return sector, wedge, part, ring, whole


@pytest.mark.parametrize("seed", range(3))
def test_sector_and_its_full_ring_agree(seed):
    sector, wedge, part, ring, whole = wedge_and_ring(seed=seed)
    close = {"rtol": 1e-9, "atol": 1e-9}
    for weighted in (False, True):
        a, b = fabric(wedge, part, sector, force_weighted=weighted), fabric(ring, whole, force_weighted=weighted)
        np.testing.assert_allclose(a.cartesian, b.cartesian, **close)
        np.testing.assert_allclose(a.cylindrical, b.cylindrical, **close)
    for a, b in (
        (contact_stress(wedge, part, RING.volume(sector.angle), sector), contact_stress(ring, whole, RING.volume())),
        (kinetic_stress(wedge, RING.volume(sector.angle), sector=sector), kinetic_stress(ring, RING.volume())),
    ):
        np.testing.assert_allclose(a.cartesian, b.cartesian, rtol=1e-9, atol=1e-9 * abs(b.pressure))
        np.testing.assert_allclose(a.cylindrical, b.cylindrical, rtol=1e-9, atol=1e-9 * abs(b.pressure))
        assert a.ring_shear == -a.cylindrical[1, 0]
    radii = np.linspace(RING.r0, RING.r1, 9)[1:-1]
    np.testing.assert_allclose(
        torque_through(wedge, part, radii, sector), torque_through(ring, whole, radii), rtol=1e-9, atol=1e-9
    )
    for along in ("r", "z"):
        small, full = (ring_bins(RING, 1e-3, along=along, angle=angle) for angle in (sector.angle, 2 * math.pi))
        one = profile_of(profile_sums(wedge, part, small, sector), small, {"rotor": 2.0})
        other = profile_of(profile_sums(ring, whole, full), full, {"rotor": 2.0})
        for name in ("position", "solid_fraction", "velocity", "spin", "temperature", "shear_rate", "pressure",
                     "normal_stress", "shear_stress", "mu", "inertial_number", "torque"):  # fmt: skip
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-8, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(one.slip["rotor"], other.slip["rotor"], rtol=1e-8, atol=1e-9)
    chains, all_chains = force_chains(wedge, part, sector), force_chains(ring, whole)
    np.testing.assert_allclose(np.tile(chains.major_stress, sector.n_sectors), all_chains.major_stress, rtol=1e-9)
    np.testing.assert_array_equal(np.tile(chains.chain >= 0, sector.n_sectors), all_chains.chain >= 0)
    assert len(all_chains.lengths) == sector.n_sectors * len(chains.lengths)


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
