"""The contacts of rigid grains as they stand: table of the loaded ones, overlaps at walls, energy of the springs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from particles.bodies import Body
from particles.dvi.impulse_list import ImpulseList
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.periodicity import Periodicity
from particles.walls.device_walls import DeviceWalls
from particles.walls.triangle_kernels import closest_on_triangle
from particles.walls.wall_kernels import wall_overlaps


def loaded_contacts(
    grains: Grains,
    listed: ImpulseList,
    device: DeviceWalls,
    bodies: Sequence[Body],
    periodicity: Periodicity | None,
    pull: int,
    dt: float,
) -> ContactTable:
    """The contacts that had an impulse in the last step of ``dt`` [s]; ``pull``: see `DviCall`."""
    x, radius, c = grains.position, grains.radius, listed
    pair_impulse, wall_impulse = with_pulls(c.pair_impulse, pull), with_pulls(c.wall_impulse, pull)
    k = _loaded(c.pair_impulse, pull)
    i, j, shift = c.pairs.rows()[k], c.pairs.other[k].astype(np.int64), c.pairs.shift[k].astype(np.int64)
    away = _places(x, j, shift, periodicity) - x[i]
    reach = radius[i] + radius[j]
    point = x[i] + away * (radius[i] / reach)[:, None]
    w = _loaded(c.wall_impulse, pull)
    row, wall = c.wall_rows()[w], c.wall_other[w].astype(np.int64)
    depth = wall_depths(grains, device, bodies, row, wall)
    owned = np.isfinite(depth[:, 0])
    row, wall, w, depth = row[owned], wall[owned], w[owned], depth[owned]
    at_wall = x[row] + (radius[row] - depth[:, 0])[:, None] * depth[:, 1:]
    none = np.full(len(row), -1)
    return ContactTable(
        np.concatenate([i, row]), np.concatenate([j, none]),
        np.concatenate([np.full(len(i), -1), device.wall[wall]]),
        np.concatenate([shift, np.zeros(len(row), dtype=np.int64)]), np.concatenate([point, at_wall]),
        np.concatenate([pair_impulse[k], wall_impulse[w]]) / dt,
        np.concatenate([reach - np.linalg.norm(away, axis=1), depth[:, 0]]),
    )  # fmt: skip


def _places(x: np.ndarray, j: np.ndarray, shift: np.ndarray, periodicity: Periodicity | None) -> np.ndarray:
    """Centres [m] of the grains ``j`` of pairs at ``shift``, as their partners see them."""
    return x[j] if periodicity is None else periodicity.place(x[j], shift)


def with_pulls(impulse: np.ndarray, pull: int) -> np.ndarray:
    """Impulses and pulls of slots together [N s], shape (p, 3); ``pull``: see `DviCall`."""
    return impulse[:, :3] + impulse[:, pull : pull + 3] if pull else impulse[:, :3]


def _loaded(impulse: np.ndarray, pull: int) -> np.ndarray:
    """Slots that have an impulse or a pull, (k,)."""
    columns = [0, 1, 2, *range(pull, pull + 3)] if pull else [0, 1, 2]
    return np.flatnonzero(impulse[:, columns].any(axis=1))


def net_impulses(listed: ImpulseList, periodicity: Periodicity | None, pull: int) -> np.ndarray:
    """Sum of the impulses on each grain in the last step [N s], shape (n, 3); ``pull``: see `DviCall`."""
    net, impulse = np.zeros((len(listed.reference), 3)), with_pulls(listed.pair_impulse, pull)
    np.add.at(net, listed.pairs.rows(), impulse)
    reaction = impulse if periodicity is None else periodicity.turn(impulse, -listed.pairs.shift)
    np.subtract.at(net, listed.pairs.other, reaction)
    np.add.at(net, listed.wall_rows(), with_pulls(listed.wall_impulse, pull))
    return net


def wall_depths(
    grains: Grains, device: DeviceWalls, bodies: Sequence[Body], row: np.ndarray, wall: np.ndarray
) -> np.ndarray:
    """Overlap [m] and unit vector towards the wall, (s, 4), of grains ``row`` at walls or triangles ``wall``."""
    x, radius = np.ascontiguousarray(grains.position), np.ascontiguousarray(grains.radius)
    depth = np.zeros((len(row), 4))
    smooth = wall < len(device.rows)
    depth[smooth] = wall_overlaps(x, radius, device.rows, row[smooth], wall[smooth])
    for k in np.flatnonzero(~smooth):
        angle = bodies[device.body[wall[k]]].angle
        cos, sin = np.cos(angle), np.sin(angle)
        to_world = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        centre = x[row[k]] @ to_world
        away = to_world @ (np.array(closest_on_triangle(device.triangles, wall[k], *centre)) - centre)
        distance = float(np.linalg.norm(away))
        depth[k, 0] = radius[row[k]] - distance
        depth[k, 1:] = away / max(distance, np.finfo(float).tiny)
    return depth


def normal_spring_energy(
    stiffness: np.ndarray | None,
    grains: Grains,
    listed: ImpulseList,
    device: DeviceWalls,
    bodies: Sequence[Body],
    periodicity: Periodicity | None,
    cohesion: np.ndarray,
) -> float:
    """Energy [J] of the normal springs at the start, where grains overlap each other or smooth walls.

    ``cohesion`` (2, 2): pull [N] and pull by radius [N/m], between grains and at walls.
    """
    if stiffness is None:
        return 0.0
    g, c = grains, listed
    i, j = c.pairs.rows(), c.pairs.other
    away = _places(g.position, j, c.pairs.shift, periodicity) - g.position[i]
    pairs = g.radius[i] + g.radius[j] - np.linalg.norm(away, axis=1)
    row, wall = c.wall_rows(), c.wall_other.astype(np.int64)
    smooth = wall < len(device.rows)
    walls = wall_depths(grains, device, bodies, row[smooth], wall[smooth])[:, 0]
    radii = g.radius[i] * g.radius[j] / (g.radius[i] + g.radius[j]), g.radius[row[smooth]]
    energy = 0.0
    for k, pull, depth, radius in zip(stiffness[:, 0], cohesion, (pairs, walls), radii, strict=True):
        overlap = np.maximum(depth, 0.0)
        energy += float(np.sum(overlap * (0.5 * k * overlap - pull[0] - pull[1] * radius)))
    return energy
