"""Diagnostics of grains against lattices, counting, and volumes known in closed form."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from emclutch.simulation.summary import structure_of
from particles.diagnostics.coordination import contacts_per_grain, coordination
from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains
from particles.diagnostics.inertial_number import friction_coefficient, inertial_number
from particles.diagnostics.sphere_parts import cap_volume, volume_in_cylinder
from particles.diagnostics.stress import grain_stress
from particles.diagnostics.tensors import principal
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable

D = 1e-3


def table(x, pairs, push, walls=()):
    """Pairs (i, j) of equal grains at ``x`` that push with ``push`` [N]; ``walls``: (grain, direction, force)."""
    i, j = np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T
    n = x[j] - x[i]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    force = -np.broadcast_to(push, len(i))[:, None] * n
    at, out, f = (
        (np.array([w[k] for w in walls]) for k in range(3)) if walls else (np.zeros(0, int), *[np.zeros((0, 3))] * 2)
    )
    point = np.concatenate([0.5 * (x[i] + x[j]), x[at] + 0.5 * D * out])
    count = len(i) + len(at)
    return ContactTable(
        np.concatenate([i, at]), np.concatenate([j, np.full(len(at), -1)]), np.repeat([-1, 0], [len(i), len(at)]),
        np.zeros(count, dtype=np.int64), point, np.concatenate([force, f]), np.zeros(count),
    )  # fmt: skip


def lattice(kind, cells=5):
    """Centres of touching equal spheres, cells^3 cells."""
    basis = {
        "sc": [[0, 0, 0]],
        "bcc": [[0, 0, 0], [0.5, 0.5, 0.5]],
        "fcc": [[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]],
    }[kind]
    side = {"sc": 1.0, "bcc": 2 / math.sqrt(3), "fcc": math.sqrt(2)}[kind] * D
    corner = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return side * (corner[:, None, :] + np.array(basis)).reshape(-1, 3)


def touching(x, reach=1.0 + 1e-9):
    return cKDTree(x).query_pairs(reach * D, output_type="ndarray")


@pytest.mark.parametrize(("kind", "bonds"), [("sc", 6), ("bcc", 8), ("fcc", 12)])
def test_bulk_of_a_cubic_lattice_has_its_coordination_and_an_isotropic_fabric(kind, bonds):
    """Kepler's and simpler lattices: 6, 8, 12 neighbours; second moments of cubic bonds are isotropic."""
    x = lattice(kind)
    pairs = touching(x)
    middle = int(np.argmin(np.linalg.norm(x - x.mean(axis=0), axis=1)))
    assert contacts_per_grain(table(x, pairs, 1.0), len(x))[middle] == bonds
    star = table(x, pairs[np.any(pairs == middle, axis=1)], 1.0)
    found = fabric(Grains.create(x, 0.5 * D, 1000.0), star)
    assert found.contacts == bonds
    np.testing.assert_allclose(found.cartesian, np.eye(3) / 3.0, atol=1e-12)
    assert found.anisotropy == pytest.approx(0.0, abs=1e-12)


def test_fabric_of_a_simple_cubic_box_counts_its_faces():
    """n^3 grains have n^2 (n - 1) bonds along each axis; one layer of n^2 has none along z: diag(1/2, 1/2, 0)."""
    x = lattice("sc", 4)
    whole = fabric(Grains.create(x, 0.5 * D, 1.0), table(x, touching(x), 1.0))
    np.testing.assert_allclose(whole.cartesian, np.eye(3) / 3.0, atol=1e-14)
    assert whole.contacts == 3 * 16 * 3
    layer = x[x[:, 2] == 0.0]
    flat = fabric(Grains.create(layer, 0.5 * D, 1.0), table(layer, touching(layer), 1.0))
    np.testing.assert_allclose(flat.cartesian, np.diag([0.5, 0.5, 0.0]), atol=1e-14)
    assert flat.anisotropy == pytest.approx(0.5)  # sqrt(3/2 (2 (1/6)^2 + (1/3)^2))


def test_random_directions_are_isotropic_to_the_sampling_error():
    """Var(n_a n_b) = 4/45 on the diagonal, 1/15 off it, for uniform directions; 5 standard errors allowed."""
    m, rng = 20_000, np.random.default_rng(3)
    n = rng.normal(size=(m, 3))
    x = np.concatenate([np.zeros((m, 3)), n]) + np.array([1.0, 0.0, 0.0])
    found = fabric(Grains.create(x, 0.5 * D, 1.0), table(x, np.arange(2 * m).reshape(2, m).T, rng.random(m)))
    error = np.sqrt(np.where(np.eye(3) > 0.0, 4 / 45, 1 / 15) / m)
    assert np.all(np.abs(found.cartesian - np.eye(3) / 3.0) < 5.0 * error)
    assert np.trace(found.cylindrical) == pytest.approx(1.0)


def test_force_weighted_fabric_follows_the_force():
    """Two bonds, along x with 3 N and along y with 1 N: diag(3/4, 1/4, 0); a pulling one weighs nothing."""
    x = D * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    contacts = table(x, [[0, 1], [0, 2], [0, 3]], np.array([3.0, 1.0, -2.0]))
    found = fabric(Grains.create(x, 0.5 * D, 1.0), contacts, force_weighted=True)
    np.testing.assert_allclose(found.cartesian, np.diag([0.75, 0.25, 0.0]), atol=1e-15)


def test_ring_of_grains_touches_along_phi():
    """A closed ring of grains: all normals azimuthal to the chord's angle, F_phiphi = cos^2(pi/n)."""
    n = 24
    phi = 2 * np.pi * np.arange(n) / n
    x = D / (2 * np.sin(np.pi / n)) * np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    contacts = table(x, np.column_stack([np.arange(n), (np.arange(n) + 1) % n]), 1.0)
    found = fabric(Grains.create(x, 0.5 * D, 1.0), contacts)
    np.testing.assert_allclose(found.cylindrical, np.diag([0.0, 1.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(found.cartesian, np.diag([0.5, 0.5, 0.0]), atol=1e-12)
    value, direction = principal(found.cylindrical)
    assert value[0] == pytest.approx(1.0) and abs(direction[0, 1]) == pytest.approx(1.0)
    assert (found.anisotropy, found.ring_anisotropy) == pytest.approx((0.5, 1.0))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_fabric_turns_with_the_bed_and_its_invariants_do_not(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(30, 3))
    turn = Rotation.random(random_state=seed).as_matrix()
    pairs, push = np.column_stack([np.arange(29), np.arange(1, 30)]), rng.random(29)
    a, b = (fabric(Grains.create(y, 0.5 * D, 1.0), table(y, pairs, push), force_weighted=True) for y in (x, x @ turn.T))
    np.testing.assert_allclose(b.cartesian, turn @ a.cartesian @ turn.T, atol=1e-12)
    assert b.anisotropy == pytest.approx(a.anisotropy, abs=1e-12)


def test_grains_with_less_than_two_contacts_are_rattlers():
    """A triangle (two contacts each) with a tail of two and a loose grain."""
    x = np.arange(18.0).reshape(6, 3)
    contacts = table(x, [[0, 1], [1, 2], [0, 2], [2, 3], [3, 4]], 1.0)
    np.testing.assert_array_equal(contacts_per_grain(contacts, 6), [2, 2, 3, 2, 1, 0])
    found = coordination(contacts, 6)
    assert found.mean == pytest.approx(10 / 6)
    assert found.rattlers == pytest.approx(2 / 6)


def test_walls_count_as_partners():
    x = np.array([[0.0, 0.0, 0.0]])
    contacts = table(x, np.zeros((0, 2)), 0.0, [(0, [0, 0, -1.0], [0, 0, 1.0]), (0, [0, 0, 1.0], [0, 0, -1.0])])
    assert contacts_per_grain(contacts, 1).tolist() == [2]


# -- parts of spheres


@settings(max_examples=60, deadline=None)
@given(st.just(0.0) | st.floats(1e-9, 5.0), st.floats(0.05, 5.0), st.floats(-1.2, 1.2), st.floats(0.0, 2.4))
def test_part_in_a_cylinder_by_shells(distance, cylinder, low, height):
    """Against the other order of integration: shells of radius s, their share of the sphere by quadrature over s.

    V = integral of 2 s acos((s^2 + b^2 - c^2)/(2 s b)) over s < rho and over z, by a midpoint rule of 400 x 400.
    """
    high = low + height
    exact = volume_in_cylinder(np.array([distance]), np.array([1.0]), cylinder, low, high)[0]
    n = 400
    a, b = np.clip([low, high], -1.0, 1.0)
    z = a + (b - a) * (np.arange(n) + 0.5) / n
    c = np.sqrt(1.0 - z**2)[:, None]
    inner, outer = np.maximum(distance - c, 0.0), np.minimum(distance + c, cylinder)
    s = inner + np.maximum(outer - inner, 0.0) * (np.arange(n) + 0.5) / n
    full = np.where(c > distance, np.minimum(c - distance, cylinder), 0.0)  # circles that go all round the axis
    s = np.where(full > 0.0, full + np.maximum(outer - full, 0.0) * (np.arange(n) + 0.5) / n, s)
    width = np.maximum(outer - np.where(full > 0.0, full, inner), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.nan_to_num((s**2 + distance**2 - c**2) / (2.0 * s * distance), posinf=1.0, neginf=-1.0)
    arc = np.arccos(np.clip(cosine, -1.0, 1.0))
    ring = np.sum(2.0 * s * arc, axis=1) / n * width[:, 0] + np.pi * full[:, 0] ** 2
    assert exact == pytest.approx((b - a) * np.mean(ring), abs=4e-3)


def test_part_in_a_cylinder_known_volumes():
    """On the axis 4 pi/3 (R^3 - (R^2 - rho^2)^1.5); Viviani's body; a cylinder so wide that it is flat."""
    one = np.array([1.0])
    on_axis = volume_in_cylinder(np.array([0.0]), one, 0.6)[0]
    assert on_axis == pytest.approx(4 * np.pi / 3 * (1.0 - 0.64**1.5), rel=1e-9)
    viviani = volume_in_cylinder(np.array([0.5]), one, 0.5)[0]  # cylinder through the centre: 2 pi/3 - 8/9
    assert viviani == pytest.approx(2 * np.pi / 3 - 8 / 9, rel=1e-8)
    far = 1e6
    flat = volume_in_cylinder(np.array([far - 0.3]), one, far)[0]
    assert flat == pytest.approx(cap_volume(one, np.array([0.3]))[0], rel=1e-5)
    assert volume_in_cylinder(np.array([far - 1.0]), one, far)[0] == pytest.approx(4 * np.pi / 3, rel=1e-5)


# -- force chains


def column(n=10, load=5.0):
    """A straight loaded column between two plates beside a weak one of the same length."""
    z = D * np.arange(n)
    x = np.concatenate([np.column_stack([0 * z, 0 * z, z]), np.column_stack([0 * z + 3 * D, 0 * z, z])])
    pairs = np.array([[k, k + 1] for k in range(n - 1)] + [[n + k, n + k + 1] for k in range(n - 1)])
    push = np.repeat([load, 1.0], n - 1)
    plates = [
        (first + end, [0, 0, sign], [0, 0, -sign * f])
        for first, f in ((0, load), (n, 1.0))
        for end, sign in ((0, -1.0), (n - 1, 1.0))
    ]
    return x, table(x, pairs, push, plates)


def test_loaded_column_is_the_only_chain_and_its_stress_is_known():
    """sigma = F d/V_grain along the column in every grain; mean over the two columns parts strong from weak."""
    x, contacts = column()
    grains = Grains.create(x, 0.5 * D, 1000.0)
    found = force_chains(grains, contacts)
    assert found.lengths.tolist() == [10] and len(found.links) == 9
    np.testing.assert_array_equal(found.chain, np.repeat([0, -1], 10))
    stress = 5.0 * D / grains.volume[0]
    np.testing.assert_allclose(found.major_stress[:10], stress, rtol=1e-12)
    np.testing.assert_allclose(np.abs(found.direction[:, 2]), 1.0, atol=1e-12)
    np.testing.assert_allclose(grain_stress(grains, contacts)[:10, 0, 0], 0.0, atol=1e-9 * stress)


@pytest.mark.parametrize(("degrees", "lengths"), [(29.0, [5, 5]), (31.0, [10])])
def test_chain_ends_where_the_line_bends_too_much(degrees, lengths):
    """Two straight legs at 60 degrees, each under its own load: the link between them is 30 degrees off both."""
    leg = D * np.arange(1, 6)[:, None]
    a, b = np.array([1.0, 0.0, 0.0]), np.array([-math.cos(math.pi / 3), math.sin(math.pi / 3), 0.0])
    x = np.concatenate([leg * a, leg * b, [[0.0, 0.0, 0.1]]])  # one unloaded grain lowers the mean below the others
    pairs = [[k, k + 1] for k in (0, 1, 2, 3, 5, 6, 7, 8)] + [[0, 5]]
    ends = [(k, s * d, -s * d * 9.0) for k, s, d in ((0, -1, a), (4, 1, a), (5, -1, b), (9, 1, b))]
    contacts = table(x, pairs, np.array([9.0] * 8 + [1e-6]), ends)
    found = force_chains(Grains.create(x, 0.5 * D, 1.0), contacts, angle=math.radians(degrees))
    assert found.lengths.tolist() == lengths


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_chains_do_not_depend_on_order_or_orientation(seed):
    rng = np.random.default_rng(seed)
    x = 6.0 * D * rng.random((150, 3))
    pairs = touching(x, 1.2)
    push = rng.exponential(size=len(pairs))
    order = rng.permutation(len(x))
    place = np.argsort(order)
    turn = Rotation.random(random_state=seed).as_matrix()
    first = force_chains(Grains.create(x, 0.5 * D, 1.0), table(x, pairs, push))
    y = (x @ turn.T)[order]
    swapped = place[pairs]
    flip = rng.random(len(pairs)) < 0.5
    swapped[flip] = swapped[flip][:, ::-1]
    second = force_chains(Grains.create(y, 0.5 * D, 1.0), table(y, swapped, push))
    assert sorted(first.lengths) == sorted(second.lengths)
    np.testing.assert_array_equal(first.chain[order] >= 0, second.chain >= 0)
    np.testing.assert_array_equal(first.links, second.links)


@pytest.mark.parametrize("angle", [0.0, 0.5 * math.pi, math.nan])
def test_angle_out_of_range_is_refused(angle):
    x, contacts = column(3)
    with pytest.raises(ValueError, match="between 0 and 90"):
        force_chains(Grains.create(x, 0.5 * D, 1.0), contacts, angle=angle)


# -- numbers


def test_numbers_of_dense_flow():
    """I = 10 1/s x 1 mm x sqrt(2500/100) = 0.05; nothing pressed has neither I nor mu."""
    assert inertial_number(-10.0, 1e-3, 2500.0, 100.0) == pytest.approx(0.05)
    assert friction_coefficient(-30.0, 100.0) == pytest.approx(0.3)
    assert np.isnan(inertial_number(1.0, 1e-3, 2500.0, 0.0)) and np.isnan(friction_coefficient(1.0, -1.0))


@dataclass
class Standing:
    """Grains as they stand at a run's end."""

    grains: Grains
    table: ContactTable
    periodicity: None = None

    def contacts(self):
        return self.table


def test_a_run_says_how_its_grains_stand():
    """Six grains in a row, pressed: four have two neighbours, all contacts are parallel, one chain holds them."""
    x = np.zeros((6, 3))
    x[:, 0], x[:, 2] = 10.0 * D, D * np.arange(6)
    pairs = [(k, k + 1) for k in range(5)]
    found = structure_of(Standing(Grains.create(x, 0.5 * D, 1000.0), table(x, pairs, 1.0)))
    assert found["coordination"] == pytest.approx(10 / 6) and found["rattlers"] == pytest.approx(2 / 6)
    assert found["fabric_anisotropy"] == pytest.approx(1.0) and found["force_anisotropy"] == pytest.approx(1.0)
    alone = structure_of(Standing(Grains.create(x, 0.4 * D, 1000.0), table(x, [], 1.0)))
    assert alone["coordination"] == alone["in_chains"] == 0.0 and alone["fabric_anisotropy"] is None
