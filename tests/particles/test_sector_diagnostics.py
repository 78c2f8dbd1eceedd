"""What is measured in a sector is what its full ring has."""

import math

import numpy as np
import pytest
from loaded_grains import RING, R, near, scattered

from particles.diagnostics.bins import ring_bins
from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains
from particles.diagnostics.profiles import profile_of, profile_sums
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sector import CyclicSector


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
