"""Walls as one table of numbers for the kernel, and the space that they enclose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.walls import Plane, RevolvedWall, Wall
from particles.bodies import Body
from particles.dem.step_kernel import N_WALL


@dataclass(frozen=True, slots=True)
class WallTable:
    """Walls in the kernel's form.

    Attributes
    ----------
    rows : ndarray, shape (n_walls, N_WALL)
        Columns as named in `particles.dem.step_kernel`, lengths in m.
    body : ndarray of int64, shape (n_walls,)
        Index of the body that each wall turns with.
    """

    rows: np.ndarray
    body: np.ndarray


def wall_table(walls: Sequence[Wall], bodies: Sequence[Body]) -> WallTable:
    """Translate ``walls``; ``bodies`` are looked up by name.

    Raises
    ------
    ValueError
        For a body that does not exist or stands twice, or a plane that would have to swing with a turning
        body.
    """
    names = [body.name for body in bodies]
    if len(set(names)) != len(names):
        raise ValueError(f"two bodies have the same name: {sorted(names)}; give each its own")
    index = np.zeros(len(walls), dtype=np.int64)
    for k, wall in enumerate(walls):
        if wall.body not in names:
            raise ValueError(
                f"wall {wall.name!r} belongs to body {wall.body!r}, which does not exist; "
                f"bodies are: {', '.join(names) or 'none'}"
            )
        index[k] = names.index(wall.body)
        if isinstance(wall, Plane) and bodies[index[k]].can_turn and abs(wall.normal[2]) < 1.0 - 1e-12:
            raise ValueError(
                f"plane {wall.name!r} is not normal to the axis but its body {wall.body!r} turns: it would "
                "swing round; put it on a body at rest, or use a wall of revolution"
            )
    return WallTable(wall_rows(walls), index)


def wall_rows(walls: Sequence[Wall]) -> np.ndarray:
    """The geometry alone, shape (n_walls, N_WALL)."""
    rows = np.zeros((len(walls), N_WALL))
    for row, wall in zip(rows, walls, strict=True):
        if isinstance(wall, Plane):
            row[:7] = [1.0, *wall.point, *wall.normal]
            continue
        (r0, z0), (r1, z1) = wall.start, wall.end
        row[1:7] = [r0, z0, r1, z1, (r1 - r0) / wall.length, (z1 - z0) / wall.length]
        if wall.start_neighbour is not None:
            row[7:10] = [1.0, *wall.start_neighbour]
        if wall.end_neighbour is not None:
            row[10:13] = [1.0, *wall.end_neighbour]
    return rows


def outside(position: np.ndarray, walls: Sequence[Wall], margin: float) -> np.ndarray:
    """Which centres are beyond what the walls enclose by more than ``margin`` [m]: bool, shape (n,).

    The walls of revolution together span a radius and a height; a plane bounds a half-space.
    """
    out = np.zeros(len(position), dtype=bool)
    for wall in walls:
        if isinstance(wall, Plane):
            out |= (position - wall.point) @ wall.normal < -margin
    ends = np.array([end for w in walls if isinstance(w, RevolvedWall) for end in (w.start, w.end)])
    if len(ends) and np.all(np.ptp(ends, axis=0) > 0.0):
        out |= np.hypot(position[:, 0], position[:, 1]) > ends[:, 0].max() + margin
        out |= (position[:, 2] < ends[:, 1].min() - margin) | (position[:, 2] > ends[:, 1].max() + margin)
    return out
