"""The contacts of the moment as a table, for force chains and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.dem.step_kernel import wall_overlaps
from particles.grains import Grains
from particles.lists.contact_list import ContactList
from particles.sector import CyclicSector


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
        The partner is the image R(shift*angle) x_j.
    point, force : ndarray, shape (m, 3)
        Where they touch [m] and the force on grain i [N] at the last step.
    overlap : ndarray, shape (m,)
        [m]; by the positions of now, one drift after the force.
    """

    i: np.ndarray
    j: np.ndarray
    wall: np.ndarray
    shift: np.ndarray
    point: np.ndarray
    force: np.ndarray
    overlap: np.ndarray


def contact_table(
    grains: Grains, contacts: ContactList, walls: np.ndarray, sector: CyclicSector | None
) -> ContactTable:
    """Collect the touching slots of ``contacts``."""
    x, radius = grains.position, grains.radius
    k = np.flatnonzero(contacts.touching)
    i, j = contacts.pairs.rows()[k], contacts.pairs.other[k].astype(np.int64)
    shift = contacts.pairs.shift[k].astype(np.int64)
    there, force = x[j], -contacts.reaction[k, :3]
    if sector is not None:
        there, force = sector.turn(there, shift), sector.turn(force, shift)
    away = there - x[i]
    distance = np.linalg.norm(away, axis=1)
    reach = radius[i] + radius[j]
    point = x[i] + away * (radius[i] / reach)[:, None]

    w = np.flatnonzero(contacts.wall_touching)
    row, wall = contacts.wall_rows()[w], contacts.wall_other[w].astype(np.int64)
    depth = wall_overlaps(x, radius, walls, row, wall)
    at_wall = x[row] + (radius[row] - depth[:, 0])[:, None] * depth[:, 1:]
    seen = np.isfinite(depth[:, 0])  # an edge may have changed its owner in the last drift
    row, wall, w, at_wall, depth = row[seen], wall[seen], w[seen], at_wall[seen], depth[seen]
    none = np.full(len(row), -1)
    return ContactTable(
        np.concatenate([i, row]), np.concatenate([j, none]), np.concatenate([np.full(len(i), -1), wall]),
        np.concatenate([shift, np.zeros(len(row), dtype=np.int64)]), np.concatenate([point, at_wall]),
        np.concatenate([force, contacts.wall_force[w]]), np.concatenate([reach - distance, depth[:, 0]]),
    )  # fmt: skip


def stored_at_rest(
    grains: Grains, contacts: ContactList, walls: np.ndarray, sector: CyclicSector | None, stiffness_n: float
) -> float:
    """Elastic energy [J] of the overlaps of a state that has no history yet."""
    x, radius = grains.position, grains.radius
    i, j = contacts.pairs.rows(), contacts.pairs.other
    there = x[j] if sector is None else sector.turn(x[j], contacts.pairs.shift)
    pairs = radius[i] + radius[j] - np.linalg.norm(there - x[i], axis=1)
    at_walls = wall_overlaps(x, radius, walls, contacts.wall_rows(), contacts.wall_other.astype(np.int64))[:, 0]
    depth = np.maximum(np.concatenate([pairs, at_walls]), 0.0)
    return 0.5 * stiffness_n * float(depth @ depth)
