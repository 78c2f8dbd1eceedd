"""Neighbour list of DVI, with the impulses of the last step, for the warm start.

A new list takes the impulses over by the sorted keys of its pairs: (smaller id, larger id) of two grains, (id, wall)
at a wall. An impulse is kept in world axes and acts on the first grain of its pair; where the pair stands the other
order in the new list its sign changes. Triangles count as walls, numbered on after the smooth ones.

In a sector the first grain i may meet the image of its partner by the shift s. If the grains are turned by w_i and w_j
when they are wrapped, the impulse on i, as i sees it, becomes R^w_i r, and the one on j, as j sees it, -R^(w_j - s) r.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from particles.neighbours.neighbour_list import find_pairs
from particles.neighbours.slot_list import SlotList, slots_of
from particles.periodicity import Periodicity
from particles.sector import CyclicSector
from particles.walls.device_walls import DeviceWalls


@dataclass(slots=True)
class ImpulseList(SlotList):
    """Slots of possible contacts, with the impulse of the last step at each.

    Attributes
    ----------
    wall_travel : float
        How far triangles may move before the list is rebuilt, the step to come included [m].
    pair_impulse, wall_impulse : ndarray, shapes (p, 3), (s, 3); (p, 6), (s, 6) with torques or pulls, or 9 columns
        Impulse on the (first) grain in the last step [N s]; zero where there was none. Behind it its torque
        over R_eff [N s] (`particles.dvi.contact_torques`), and its pull [N s] (`particles.dvi.adhesion`).
    """

    wall_travel: float
    pair_impulse: np.ndarray
    wall_impulse: np.ndarray

    @classmethod
    def make(
        cls,
        position: np.ndarray,
        reach: np.ndarray,
        cutoff: float,
        walls: DeviceWalls,
        angles: Sequence[float],
        wall_travel: float,
        periodicity: Periodicity | None,
        columns: int,
    ) -> ImpulseList:
        """The list at ``position`` (n, 3) [m] and ``angles`` [rad], with ``columns`` of an impulse.

        Of pairs that are nearer than the sum of their ``reach`` (n,) [m], the largest ``cutoff`` [m].
        """
        pairs = find_pairs(position, cutoff, periodicity, reach)
        start, other = walls.near(position, reach, 2.0 * wall_travel, angles)
        return cls(
            pairs, start, other, position.copy(), np.array(angles, dtype=float), float(wall_travel),
            np.zeros((pairs.count, columns)), np.zeros((len(other), columns)),
        )  # fmt: skip

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

    def take_impulses(
        self,
        old: ImpulseList,
        old_id: np.ndarray,
        particle_id: np.ndarray,
        sector: CyclicSector | None,
        wraps: np.ndarray | None,
    ) -> None:
        """Carry the impulses over from ``old``, whose grains stood in the order ``old_id``.

        In a ``sector`` they were turned by ``wraps`` (n,), in the old order.
        """
        key, sign, wall_key = self.keys(particle_id)
        old_key, old_sign, old_wall_key = old.keys(old_id)
        pair_impulse, wall_impulse = old_sign[:, None] * old.pair_impulse, old.wall_impulse
        if sector is not None and wraps is not None:
            # those on the grains of smaller number, as these see them
            first = old_sign > 0.0
            turns = np.where(first, wraps[old.pairs.rows()], wraps[old.pairs.other] - old.pairs.shift)
            pair_impulse = _turned(sector, pair_impulse, turns)
            wall_impulse = _turned(sector, wall_impulse, wraps[old.wall_rows()])
        pair_impulse = sign[:, None] * _values_at(key, old_key, pair_impulse)
        if sector is not None:
            pair_impulse = _turned(sector, pair_impulse, np.where(sign > 0.0, 0, self.pairs.shift))
        self.pair_impulse[:] = pair_impulse
        self.wall_impulse[:] = _values_at(wall_key, old_wall_key, wall_impulse)

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs."""
        impulses = {"pair_impulse": self.pair_impulse, "wall_impulse": self.wall_impulse}
        return SlotList.arrays(self) | impulses | {"wall_way": np.array(self.wall_travel)}

    @classmethod
    def from_arrays(cls, state: dict[str, np.ndarray]) -> ImpulseList:
        """The inverse of `arrays`."""
        impulses = (state[f"{kind}_impulse"].copy() for kind in ("pair", "wall"))
        return cls(*slots_of(state), float(state["wall_way"]), *impulses)


def _turned(sector: CyclicSector, impulse: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Rows of impulses, torques and pulls, three columns each, turned by so many sectors (m,)."""
    turned = impulse.copy()
    rows = np.flatnonzero((turns != 0) & impulse.any(axis=1))
    for first in range(0, impulse.shape[1], 3):
        turned[rows, first : first + 3] = sector.turn(impulse[rows, first : first + 3], turns[rows])
    return turned


def _values_at(key: np.ndarray, old_key: np.ndarray, value: np.ndarray) -> np.ndarray:
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
