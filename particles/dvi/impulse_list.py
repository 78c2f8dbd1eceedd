"""Neighbour list of DVI, with the impulses of the last step, for the warm start.

A new list takes the impulses over like the histories of DEM (`particles.neighbours.contact_list`). An impulse is kept
in world axes and acts on the first grain of its pair; where the pair stands the other order in the new list its sign
changes. Triangles count as walls, numbered on after the smooth ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from particles.neighbours.contact_list import ContactMemory, SlotMemory, carry_over, memory_of
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

    def memory(self) -> ContactMemory:
        """The impulses that are not zero; the list itself can be dropped then."""
        return memory_of(self, *(SlotMemory(_loaded(rows), rows) for rows in (self.pair_impulse, self.wall_impulse)))

    def transfer(
        self, memory: ContactMemory, order: np.ndarray, wraps: np.ndarray | None, sector: CyclicSector | None
    ) -> None:
        """Carry ``memory`` over, as `carry_over`."""
        vectors = np.arange(0, self.pair_impulse.shape[1], 3)
        pairs, walls = (SlotMemory(_loaded(rows), rows) for rows in (self.pair_impulse, self.wall_impulse))
        carry_over(memory, order, wraps, sector, vectors, self, pairs, walls)

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs."""
        impulses = {"pair_impulse": self.pair_impulse, "wall_impulse": self.wall_impulse}
        return SlotList.arrays(self) | impulses | {"wall_way": np.array(self.wall_travel)}

    @classmethod
    def from_arrays(cls, state: dict[str, np.ndarray]) -> ImpulseList:
        """The inverse of `arrays`."""
        impulses = (state[f"{kind}_impulse"].copy() for kind in ("pair", "wall"))
        return cls(*slots_of(state), float(state["wall_way"]), *impulses)


def _loaded(impulse: np.ndarray) -> np.ndarray:
    """Which rows of impulses (m, columns) are not zero, uint8."""
    return np.asarray(impulse.any(axis=1), dtype=np.uint8)
