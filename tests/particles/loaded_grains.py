"""Grains with contact forces that balance: in a ring between two cylinders, or wherever they are put."""

import math
from functools import cache

import numpy as np
from scipy.linalg import null_space
from scipy.spatial import cKDTree

from geometry.walls import AnnularBox
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable

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
