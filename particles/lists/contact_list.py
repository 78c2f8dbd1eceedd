"""Verlet list of the grains and of the walls near them, with the history of each contact beside its slot.

A list made with a skin stays complete until a grain has moved by half the skin. When a new one is made the
grains may have been sorted anew and wrapped through the faces of the sector; the history of every touching
contact finds its new slot by the pair's two ids. Were grains turned by R^w, the pair (i, j, shift) becomes

    (i', j', shift + w_i - w_j)   with xi' = R^w_i xi,

or, where the new list has it the other way round, (j', i', -shift') with xi'' = -R^(-shift') xi'.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from particles.dem.step_kernel import near_walls
from particles.lists.neighbours import PairList, find_pairs
from particles.sector import CyclicSector


@dataclass(slots=True)
class ContactList:
    """Slots of possible contacts: p pairs and s (grain, wall) slots for n grains.

    Attributes
    ----------
    pairs : PairList
        Half list; `incoming_start` (n + 1,) and `incoming_slot` (p,) are its transpose.
    touching, history, reaction : ndarray, shapes (p,) uint8, (p, 3 or 6), (p, 6)
        Whether the pair touches, its tangential spring [m] in the frame of i, and force [N] and torque [N
        m] on j.
    wall_start, wall_other : ndarray, shapes (n + 1,), (s,) int32
        Walls near each grain.
    wall_touching, wall_history, wall_force : ndarray, shapes (s,) uint8, (s, 3 or 6), (s, 3)
        The same for walls; the force [N] is that on the grain.
    reference : ndarray, shape (n, 3)
        Positions [m] at which the list was made.
    """

    pairs: PairList
    wall_start: np.ndarray
    wall_other: np.ndarray
    reference: np.ndarray
    springs: int = 3
    incoming_start: np.ndarray = field(init=False)
    incoming_slot: np.ndarray = field(init=False)
    touching: np.ndarray = field(init=False)
    history: np.ndarray = field(init=False)
    reaction: np.ndarray = field(init=False)
    wall_touching: np.ndarray = field(init=False)
    wall_history: np.ndarray = field(init=False)
    wall_force: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.incoming_start, self.incoming_slot = self.pairs.incoming()
        self.touching = np.zeros(self.pairs.count, dtype=np.uint8)
        self.history = np.zeros((self.pairs.count, self.springs))
        self.reaction = np.zeros((self.pairs.count, 6))
        slots = len(self.wall_other)
        self.wall_touching = np.zeros(slots, dtype=np.uint8)
        self.wall_history = np.zeros((slots, self.springs))
        self.wall_force = np.zeros((slots, 3))

    @classmethod
    def make(
        cls,
        position: np.ndarray,
        radius: np.ndarray,
        skin: float,
        walls: np.ndarray,
        sector: CyclicSector | None,
        springs: int = 3,
    ) -> ContactList:
        """The list at ``position`` (n, 3) [m] with ``skin`` [m]; ``walls``: rows of a `WallTable`.

        ``springs`` is 3 for the tangential spring, 6 with the rolling angle beside it.
        """
        pairs = find_pairs(position, 2.0 * float(radius.max()) + skin, sector, radius + 0.5 * skin)
        start = np.zeros(len(position) + 1, dtype=np.int64)
        other = np.zeros(len(position), dtype=np.int32)
        found = near_walls(position, radius + 0.5 * skin, walls, start, other)
        if found > len(other):
            other = np.zeros(found, dtype=np.int32)
            near_walls(position, radius + 0.5 * skin, walls, start, other)
        return cls(pairs, start, other[:found].copy(), position.copy(), springs)

    def wall_rows(self) -> np.ndarray:
        """The grain of each wall slot, int64, shape (s,)."""
        return np.repeat(np.arange(len(self.wall_start) - 1), np.diff(self.wall_start))

    def take_history(
        self, old: ContactList, order: np.ndarray, wraps: np.ndarray | None, sector: CyclicSector | None
    ) -> None:
        """Carry over from ``old``: grain ``order[k]`` of the old list is grain k here, turned by ``wraps``
        (old order).

        A contact of the last step that has no slot here has parted since, further than the skin: it is
        forgotten.
        """
        n = len(order)
        rank = np.empty(n, dtype=np.int64)
        rank[order] = np.arange(n)
        turned = np.zeros(n, dtype=np.int64) if wraps is None else wraps
        parts = 1 if sector is None else sector.n_sectors
        angle = 0.0 if sector is None else sector.angle
        _carry_pairs(
            rank, turned, parts, angle,
            old.pairs.start, old.pairs.other, old.pairs.shift, old.touching, old.history,
            self.pairs.start, self.pairs.other, self.pairs.shift, self.touching, self.history,
        )  # fmt: skip
        _carry_walls(
            rank, turned, angle, old.wall_start, old.wall_other, old.wall_touching, old.wall_history,
            self.wall_start, self.wall_other, self.wall_touching, self.wall_history,
        )  # fmt: skip

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything that a restart needs; the transpose is made again."""
        return {
            "pair_start": self.pairs.start, "pair_other": self.pairs.other, "pair_shift": self.pairs.shift,
            "pair_touching": self.touching, "pair_history": self.history, "pair_reaction": self.reaction,
            "wall_start": self.wall_start, "wall_other": self.wall_other, "wall_touching": self.wall_touching,
            "wall_history": self.wall_history, "wall_force": self.wall_force, "reference": self.reference,
        }  # fmt: skip

    @classmethod
    def from_arrays(cls, state: dict[str, np.ndarray]) -> ContactList:
        """The inverse of `arrays`."""
        springs = state["pair_history"].shape[1]
        pairs = PairList(*(state[f"pair_{name}"].copy() for name in ("start", "other", "shift")))
        made = cls(pairs, state["wall_start"].copy(), state["wall_other"].copy(), state["reference"].copy(), springs)
        made.touching, made.history = state["pair_touching"].copy(), state["pair_history"].copy()
        made.reaction, made.wall_force = state["pair_reaction"].copy(), state["wall_force"].copy()
        made.wall_touching, made.wall_history = state["wall_touching"].copy(), state["wall_history"].copy()
        return made


@njit(cache=True, error_model="numpy")
def _carry_pairs(
    rank, wraps, parts, angle, start, other, shift, touching, history,
    new_start, new_other, new_shift, new_touching, new_history,
):  # fmt: skip
    for old_i in range(rank.shape[0]):
        for k in range(start[old_i], start[old_i + 1]):
            if touching[k] == 0:
                continue
            i, j = rank[old_i], rank[other[k]]
            across = (wraps[old_i] + shift[k] - wraps[other[k]]) % parts
            slot, sign, turns = -1, 1.0, wraps[old_i]
            for q in range(new_start[i], new_start[i + 1]):
                if new_other[q] == j and (new_shift[q] - across) % parts == 0:
                    slot = q
                    break
            if slot < 0:
                for q in range(new_start[j], new_start[j + 1]):
                    if new_other[q] == i and (new_shift[q] + across) % parts == 0:
                        slot, sign, turns = q, -1.0, wraps[old_i] - across
                        break
            if slot < 0:
                continue
            c, t = np.cos(turns * angle), np.sin(turns * angle)
            new_touching[slot] = 1
            for first in range(0, history.shape[1], 3):
                x, y = history[k, first], history[k, first + 1]
                if turns != 0:
                    x, y = c * x - t * y, t * x + c * y
                new_history[slot, first], new_history[slot, first + 1] = sign * x, sign * y
                new_history[slot, first + 2] = sign * history[k, first + 2]


@njit(cache=True, error_model="numpy")
def _carry_walls(rank, wraps, angle, start, other, touching, history, new_start, new_other, new_touching, new_history):
    for old_i in range(rank.shape[0]):
        for k in range(start[old_i], start[old_i + 1]):
            if touching[k] == 0:
                continue
            i = rank[old_i]
            slot = -1
            for q in range(new_start[i], new_start[i + 1]):
                if new_other[q] == other[k]:
                    slot = q
            if slot < 0:
                continue
            c, t = np.cos(wraps[old_i] * angle), np.sin(wraps[old_i] * angle)
            new_touching[slot] = 1
            for first in range(0, history.shape[1], 3):
                x, y = history[k, first], history[k, first + 1]
                if wraps[old_i] != 0:
                    x, y = c * x - t * y, t * x + c * y
                new_history[slot, first], new_history[slot, first + 1] = x, y
                new_history[slot, first + 2] = history[k, first + 2]
