"""Neighbours of rigid grains and the impulses of the last step beside them, for the warm start.

A new list takes the impulses over by the sorted keys of its pairs: (smaller id, larger id) of two grains, (id, wall)
at a wall. An impulse is kept in world axes and acts on the first grain of its pair; where the pair stands the other
way round in the new list its sign turns. Triangles count as walls, numbered on after the smooth ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from particles.neighbours.neighbour_list import PairList, find_pairs
from particles.walls.device_walls import DeviceWalls


@dataclass(slots=True)
class ImpulseList:
    """Slots of possible contacts: p pairs and s (grain, wall) slots for n grains.

    Attributes
    ----------
    pairs : PairList
        Half list.
    pair_impulse, wall_impulse : ndarray, shapes (p, 3), (s, 3); with torques (p, 6), (s, 6)
        Impulse on the (first) grain in the last step [N s]; zero where there was none. Behind it its torque
        over R_eff [N s] (`particles.dvi.contact_torques`).
    wall_start, wall_other : ndarray, shapes (n + 1,), (s,)
        Walls near each grain.
    reference : ndarray, shape (n, 3)
        Positions [m] at which the list was made.
    angles : ndarray, shape (n_bodies,)
        Angles of the bodies [rad] at that time.
    wall_way : float
        How far triangles may move from there before the list is rebuilt, the step to come included [m].
    """

    pairs: PairList
    wall_start: np.ndarray
    wall_other: np.ndarray
    reference: np.ndarray
    angles: np.ndarray
    wall_way: float
    pair_impulse: np.ndarray
    wall_impulse: np.ndarray

    @classmethod
    def make(
        cls,
        position: np.ndarray,
        radius: np.ndarray,
        skin: float,
        walls: DeviceWalls,
        angles: Sequence[float],
        wall_way: float,
        columns: int = 3,
    ) -> ImpulseList:
        """The list at ``position`` (n, 3) [m] and ``angles`` [rad], with ``skin`` [m]; ``columns`` of an impulse."""
        reach = radius + 0.5 * skin
        pairs = find_pairs(position, 2.0 * float(radius.max()) + skin, None, reach)
        start, other = walls.near(position, reach, 2.0 * wall_way, angles)
        return cls(
            pairs, start, other, position.copy(), np.array(angles, dtype=float), float(wall_way),
            np.zeros((pairs.count, columns)), np.zeros((len(other), columns)),
        )  # fmt: skip

    def wall_rows(self) -> np.ndarray:
        """The grain of each wall slot, int64, shape (s,)."""
        return np.repeat(np.arange(len(self.wall_start) - 1), np.diff(self.wall_start))

    def keys(self, particle_id: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Key of each pair, its sign (-1: the first grain has the larger id), and the key of each wall slot."""
        a, b = particle_id[self.pairs.rows()], particle_id[self.pairs.other]
        many = int(particle_id.max()) + 1
        walls = int(self.wall_other.max()) + 1 if len(self.wall_other) else 1
        return (
            np.minimum(a, b) * many + np.maximum(a, b),
            np.where(a < b, 1.0, -1.0),
            particle_id[self.wall_rows()] * max(walls, 1 << 20) + self.wall_other,
        )

    def take_impulses(self, old: ImpulseList, old_id: np.ndarray, particle_id: np.ndarray) -> None:
        """Carry the impulses over from ``old``, whose grains stood in the order ``old_id``."""
        key, sign, wall_key = self.keys(particle_id)
        old_key, old_sign, old_wall_key = old.keys(old_id)
        self.pair_impulse[:] = sign[:, None] * _found(key, old_key, old_sign[:, None] * old.pair_impulse)
        self.wall_impulse[:] = _found(wall_key, old_wall_key, old.wall_impulse)

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs."""
        return {
            "pair_start": self.pairs.start, "pair_other": self.pairs.other, "pair_shift": self.pairs.shift,
            "pair_impulse": self.pair_impulse, "wall_start": self.wall_start, "wall_other": self.wall_other,
            "wall_impulse": self.wall_impulse, "reference": self.reference, "angles": self.angles,
            "wall_way": np.array(self.wall_way),
        }  # fmt: skip

    @classmethod
    def from_arrays(cls, state: dict[str, np.ndarray]) -> ImpulseList:
        """The inverse of `arrays`."""
        pairs = PairList(*(state[f"pair_{name}"].copy() for name in ("start", "other", "shift")))
        start, other, reference, angles, pair_impulse, wall_impulse = (
            state[name].copy()
            for name in ("wall_start", "wall_other", "reference", "angles", "pair_impulse", "wall_impulse")
        )
        return cls(pairs, start, other, reference, angles, float(state["wall_way"]), pair_impulse, wall_impulse)


def _found(key: np.ndarray, old_key: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Rows of ``value`` (m, columns) at the places of ``key`` in ``old_key``; zero where it is not there."""
    result = np.zeros((len(key), value.shape[1]))
    used = np.flatnonzero(value.any(axis=1))
    if len(used) == 0:
        return result
    used = used[np.argsort(old_key[used])]
    ordered = old_key[used]
    place = np.minimum(np.searchsorted(ordered, key), len(ordered) - 1)
    hit = ordered[place] == key
    result[hit] = value[used[place[hit]]]
    return result
