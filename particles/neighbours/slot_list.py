"""Slots of possible contacts: what the lists of both engines have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.neighbours.neighbour_list import PairList


@dataclass(slots=True)
class SlotList:
    """Pairs of grains, and walls near grains: p pairs and s (grain, wall) slots for n grains.

    Attributes
    ----------
    pairs : PairList
        Half list.
    wall_start, wall_other : ndarray, shapes (n + 1,), (s,) int32
        Walls near each grain; triangles count on after the smooth walls.
    reference : ndarray, shape (n, 3)
        Positions [m] at which the list was made.
    angles : ndarray, shape (n_bodies,)
        Angles of the bodies [rad] at that time.
    """

    pairs: PairList
    wall_start: np.ndarray
    wall_other: np.ndarray
    reference: np.ndarray
    angles: np.ndarray

    def wall_rows(self) -> np.ndarray:
        """The grain of each wall slot, int64, shape (s,)."""
        return np.repeat(np.arange(len(self.wall_start) - 1), np.diff(self.wall_start))

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs."""
        return {
            "pair_start": self.pairs.start, "pair_other": self.pairs.other, "pair_shift": self.pairs.shift,
            "wall_start": self.wall_start, "wall_other": self.wall_other,
            "reference": self.reference, "angles": self.angles,
        }  # fmt: skip


def slots_of(state: dict[str, np.ndarray]) -> tuple[PairList, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The fields of a `SlotList` from its `arrays`, copied."""
    pairs = PairList(*(state[f"pair_{name}"].copy() for name in ("start", "other", "shift")))
    start, other, reference, angles = (
        state[name].copy() for name in ("wall_start", "wall_other", "reference", "angles")
    )
    return pairs, start, other, reference, angles
