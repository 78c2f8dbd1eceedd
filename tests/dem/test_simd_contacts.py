"""SIMD contacts: the forces of vectors are those of the contacts one by one, whatever fills a batch."""

import math

import numpy as np
import pytest
from numba import njit

from geometry import Box
from geometry.kernels.simd_math import log, sqrt
from particles import DEM, Body, Grains, LinearContact
from particles.dem.contact_kernel import ContactKinematics, contact_force
from particles.dem.pair_search import ROOM
from particles.dem.stored_energy import scene_law_table
from particles.laws.elastic import Elastic
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.pair_table import PairLaws

DT = 1e-7
LINEAR = LinearContact.from_restitution(1e4, 0.5, 0.3)
HERTZIAN = HertzMindlin.from_restitution(Elastic(1e8, 0.3), 0.5, 0.3)


def crowd(n, spread, seed=3):
    """Overlapping grains that move and spin, in a box far away, and their radii."""
    rng = np.random.default_rng(seed)
    radius = 0.5e-3 * (1.0 + spread * rng.random(n))
    side = (n * 6e-10) ** (1.0 / 3.0)
    return Grains.create(
        0.01 + rng.random((n, 3)) * side, radius, 7850.0,
        velocity=rng.normal(size=(n, 3)), angular_velocity=1e3 * rng.normal(size=(n, 3)),
    )  # fmt: skip


def far_away(grains, law, species=None):
    return DEM(
        grains, Box((1.0, 1.0, 1.0)).walls(), [Body("housing")], law, dt=DT, overlap_limit=2.0, species=species
    )  # fmt: skip


def one_by_one(dem, law_of):
    """Forces (p, 3) of the present contacts, each by a call of its own."""
    table, grains, found = dem.contacts(), dem.grains, []
    for i, j in zip(table.i, table.j, strict=True):
        x, r, m = grains.position, grains.radius, grains.mass
        away = x[j] - x[i]
        d = np.linalg.norm(away)
        n = away / d
        li = d * r[i] / (r[i] + r[j])
        spin = grains.angular_velocity
        u = grains.velocity[i] - grains.velocity[j] + np.cross(li * spin[i] + (d - li) * spin[j], n)
        turn = -(grains.velocity[i] - grains.velocity[j]) * DT / d
        turn = (turn - (turn @ n) * n) * (1.0 + turn @ n)
        mean_spin = float(0.5 * (spin[i] + spin[j]) @ n)
        kinematics = ContactKinematics(r[i] + r[j] - d, tuple(n), tuple(u), tuple(turn), mean_spin)
        m_eff, r_eff = m[i] * m[j] / (m[i] + m[j]), r[i] * r[j] / (r[i] + r[j])
        law, kind = law_of(i, j)
        found.append(contact_force(law, kind, None, m_eff, r_eff, DT, kinematics, np.zeros((1, 8)), 0)[:3])
    return table.force, np.array(found)


@pytest.mark.parametrize("law, spread", [(LINEAR, 0.0), (LINEAR, 0.4), (HERTZIAN, 0.4)])
def test_forces_of_lanes_are_those_of_single_contacts(law, spread):
    dem = far_away(crowd(400, spread), law)
    table = scene_law_table(dem.laws, dem.grains, one_species=True)
    lanes, single = one_by_one(dem, lambda i, j: (table, 0))
    assert len(lanes) > 3 * ROOM
    np.testing.assert_allclose(lanes, single, rtol=1e-9, atol=1e-12 * np.abs(single).max())


def test_each_lane_has_the_law_of_its_pair_of_materials():
    soft, hard = LINEAR, LinearContact.from_restitution(4e4, 0.9, 0.1)
    rows = np.array([soft.row(), hard.row()])
    laws = PairLaws(rows, np.array([[0, 1], [1, 0]]), np.array([[0], [1]]), (soft, hard))
    grains = crowd(400, 0.0)
    species = np.arange(400) % 2
    dem = far_away(grains, laws, species)
    of_now = dem._species
    table = scene_law_table(dem.laws, dem.grains, one_species=False)
    lanes, single = one_by_one(dem, lambda i, j: (table, int(laws.pair[of_now[i], of_now[j]])))
    np.testing.assert_allclose(lanes, single, rtol=1e-9, atol=1e-12 * np.abs(single).max())


def test_a_grain_with_more_contacts_than_a_batch_has_room_for():
    """A large sphere among small ones that touch it alone: forces are radial and in balance."""
    small, n = 0.1e-3, 600
    k = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * k / n, math.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - z * z)
    out = np.column_stack([across * np.cos(angle), across * np.sin(angle), z])
    depth = 1e-6
    where = np.vstack([np.zeros(3), out * (2e-3 + small - depth)]) + 0.01
    grains = Grains.create(where, np.r_[2e-3, np.full(n, small)], 7850.0)
    dem = far_away(grains, LINEAR)
    table = dem.contacts()
    assert len(table.force) == n > 3 * ROOM
    np.testing.assert_allclose(np.linalg.norm(table.force, axis=1), LINEAR.stiffness_n * depth, rtol=1e-9)
    dem.run(1)
    momentum = dem.grains.mass @ dem.grains.velocity
    assert np.abs(momentum).max() < 1e-12 * n * LINEAR.stiffness_n * depth * DT


@njit(error_model="numpy", fastmath={"contract"})
def _by_kernel(x):
    roots, logs = np.empty_like(x), np.empty_like(x)
    for k in range(x.shape[0]):
        roots[k], logs[k] = sqrt(x[k]), log(x[k])
    return roots, logs


def test_root_and_logarithm_are_those_of_the_library():
    rng = np.random.default_rng(5)
    x = np.concatenate([np.exp(rng.uniform(-600.0, 600.0, 5000)), rng.uniform(0.5, 2.0, 5000), [1.0, 2.0, 0.5]])
    roots, logs = _by_kernel(x)
    assert np.array_equal(roots, np.sqrt(x))
    np.testing.assert_allclose(logs, np.log(x), rtol=1e-15, atol=1e-300)
    assert np.isnan(_by_kernel(np.array([-1.0]))[0]).all()
    assert sqrt(2.0) == math.sqrt(2.0) and log(2.0) == math.log(2.0)
