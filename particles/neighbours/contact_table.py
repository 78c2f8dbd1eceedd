"""The contacts of the moment as a table, for force chains and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from particles.grains import Grains
from particles.neighbours.contact_list import ContactList
from particles.periodicity import Periodicity
from particles.walls.device_walls import DeviceWalls


@dataclass(frozen=True, slots=True)
class ContactTable:
    """One row a contact, m in all; pairs first, walls after them.

    Attributes
    ----------
    i, j : ndarray of int64, shape (m,)
        Grains (their places in the arrays); j = -1 at a wall.
    wall : ndarray of int64, shape (m,)
        Index of the wall, -1 between grains.
    shift : ndarray of int64, shape (m,)
        Which image the partner is (`particles.periodicity`).
    point, force : ndarray, shape (m, 3)
        Where they touch [m] and the force on grain i [N].
    overlap : ndarray, shape (m,)
        [m]
    """

    i: np.ndarray
    j: np.ndarray
    wall: np.ndarray
    shift: np.ndarray
    point: np.ndarray
    force: np.ndarray
    overlap: np.ndarray


def contact_table(
    grains: Grains,
    contacts: ContactList,
    wall_of: np.ndarray,
    periodicity: Periodicity | None,
    touching: np.ndarray,
    wall_touching: np.ndarray,
    pair_force: np.ndarray,
    at_walls: np.ndarray,
) -> ContactTable:
    """Collect the slots that ``touching`` (p,) and ``wall_touching`` (s,) name.

    ``pair_force`` (p, 3) [N]; ``at_walls`` (s, 7): force [N], overlap [m] and unit vector towards the wall, as the step
    saw them; ``wall_of``: index of the wall of each smooth wall and triangle.
    """
    x, radius = np.array(grains.position), np.array(grains.radius)
    k = np.flatnonzero(touching)
    i, j = contacts.pairs.rows()[k], contacts.pairs.other[k].astype(np.int64)
    shift = contacts.pairs.shift[k].astype(np.int64)
    partner = x[j] if periodicity is None else periodicity.place(x[j], shift)
    away = partner - x[i]
    distance = np.linalg.norm(away, axis=1)
    reach = radius[i] + radius[j]
    point = x[i] + away * (radius[i] / reach)[:, None]

    w = np.flatnonzero(wall_touching)
    row, number = contacts.wall_rows()[w], contacts.wall_other[w].astype(np.int64)
    force, depth, towards = at_walls[w, :3], at_walls[w, 3], at_walls[w, 4:]
    none = np.full(len(row), -1)
    return ContactTable(
        np.concatenate([i, row]), np.concatenate([j, none]), np.concatenate([np.full(len(i), -1), wall_of[number]]),
        np.concatenate([shift, np.zeros(len(row), dtype=np.int64)]),
        np.concatenate([point, x[row] + (radius[row] - depth)[:, None] * towards]),
        np.concatenate([pair_force[k], force]), np.concatenate([reach - distance, depth]),
    )  # fmt: skip


def geometric_overlaps(
    grains: Grains, contacts: ContactList, walls: DeviceWalls, angles: Sequence[float], periodicity: Periodicity | None
) -> tuple[np.ndarray, np.ndarray]:
    """Overlap [m] of each pair (p,) and each wall slot (s,) of the list, negative or -inf where nothing touches."""
    x, radius = np.array(grains.position), np.array(grains.radius)
    i, j = contacts.pairs.rows(), contacts.pairs.other
    partner = x[j] if periodicity is None else periodicity.place(x[j], contacts.pairs.shift)
    pairs = radius[i] + radius[j] - np.linalg.norm(partner - x[i], axis=1)
    return pairs, walls.overlaps(x, radius, contacts.wall_start, contacts.wall_other, angles)[:, 0]
