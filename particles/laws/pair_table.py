"""Contact parameters by pair of materials: which row of the table serves grains of two species, or a grain and a wall.

Grains have a species 0 .. s-1, walls a material 0 .. w-1. A scene has one kind of law (one compiled spring); its
parameters may differ from pair to pair.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from particles.laws.cohesion import Cohesion
from particles.laws.columns import COHESION_0, COHESION_1, COHESIVE, MU_ROLLING, MU_TWISTING
from particles.laws.contact_law import ContactLaw
from particles.laws.rolling_friction import RollingFriction
from particles.laws.twisting_friction import TwistingFriction

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class PairLaws:
    """The table of a scene's contact laws, built by `of_one` or `of_pairs`.

    Attributes
    ----------
    rows : ndarray, shape (k, N_LAW)
        Parameters (`particles.laws.columns`).
    pair : ndarray of int64, shape (s, s)
        Row of two species; symmetric.
    wall : ndarray of int64, shape (s, w)
        Row of a species and a wall's material.
    laws : tuple of ContactLaw, length k
        The law of each row.
    """

    rows: np.ndarray
    pair: np.ndarray
    wall: np.ndarray
    laws: tuple[ContactLaw, ...]

    @property
    def kernel(self) -> str:
        """Name of the compiled spring."""
        return self.laws[0].kernel

    @classmethod
    def of_one(
        cls,
        law: ContactLaw,
        *,
        at_walls: ContactLaw | None = None,
        n_species: int = 1,
        n_walls: int = 1,
        rolling: RollingFriction | None = None,
        twisting: TwistingFriction | None = None,
        cohesion: Cohesion | None = None,
    ) -> PairLaws:
        """Row 0 between all grains, row 1 at all walls.

        ``at_walls`` is the law there; without it as between grains.
        """
        pair = np.zeros((n_species, n_species), dtype=np.int64)
        wall = np.ones((n_species, n_walls), dtype=np.int64)
        laws = (law, law if at_walls is None else at_walls)
        return _table(laws, pair, wall, rolling, twisting, cohesion)

    @classmethod
    def of_pairs(
        cls,
        species: Sequence[str],
        walls: Sequence[str],
        laws: Mapping[Pair, ContactLaw],
        *,
        rolling: RollingFriction | None = None,
        twisting: TwistingFriction | None = None,
        cohesion: Cohesion | None = None,
    ) -> PairLaws:
        """A law for each pair of names, in either order; ``species`` and ``walls`` name the materials by number.

        Raises
        ------
        ValueError
            If a pair is missing, or two laws are of different kinds.
        """
        distinct: list[ContactLaw] = []
        numbers: dict[tuple[str, ...], int] = {}

        def number(first: str, second: str, *place: str) -> int:
            key = (*sorted((first, second)), *place)
            if key not in numbers:
                law = laws.get((first, second), laws.get((second, first)))
                if law is None:
                    raise ValueError(f"no contact law between '{first}' and '{second}'; give one for this pair")
                numbers[key] = len(distinct)
                distinct.append(law)
            return numbers[key]

        pair = np.array([[number(a, b) for b in species] for a in species], dtype=np.int64)
        wall = np.array([[number(a, b, "wall") for b in walls] for a in species], dtype=np.int64)
        return _table(tuple(distinct), pair, wall.reshape(len(species), len(walls)), rolling, twisting, cohesion)


def _table(
    laws: tuple[ContactLaw, ...],
    pair: np.ndarray,
    wall: np.ndarray,
    rolling: RollingFriction | None,
    twisting: TwistingFriction | None,
    cohesion: Cohesion | None,
) -> PairLaws:
    for law in laws:
        if law.kernel != laws[0].kernel:
            raise ValueError(f"contact laws '{laws[0].kernel}' and '{law.kernel}' stand in one scene; take one of them")
    rows = np.array([law.row() for law in laws])
    at_wall = np.isin(np.arange(len(laws)), wall).astype(int)  # 0: between grains, 1: at a wall
    if rolling is not None:
        rows[:, MU_ROLLING] = rolling.table()[at_wall]
    if twisting is not None:
        rows[:, MU_TWISTING] = twisting.table()[at_wall]
    if cohesion is not None:
        rows[:, [COHESION_0, COHESION_1]] = cohesion.table()[at_wall]
        rows[:, COHESIVE] = 1.0
    return PairLaws(rows, pair, wall, laws)


def species_of(laws: PairLaws, count: int, species: np.ndarray | None) -> np.ndarray | None:
    """Rows of ``laws.pair`` of so many grains, int64 (n,); None where there is one. A ValueError for no such row."""
    if species is None or len(laws.pair) == 1:
        return None
    number = np.array(species, dtype=np.int64)
    if number.shape != (count,) or number.min() < 0 or number.max() >= len(laws.pair):
        raise ValueError(f"species must be {count} numbers from 0 to {len(laws.pair) - 1}")
    return number


def wall_rows(laws: PairLaws, count: int, material: Sequence[int] | None, wall: np.ndarray) -> np.ndarray:
    """Rows of the law for each species and each slot of a list, where slot k is of ``wall[k]`` of so many walls.

    ``material`` are the walls' columns of ``laws.wall``, 0 by default; a ValueError for no such column.
    """
    columns = np.zeros(count, dtype=np.int64) if material is None else np.array(material)
    if len(columns) != count or (count and not 0 <= columns.max() < laws.wall.shape[1]):
        raise ValueError(f"wall_material must be {count} numbers from 0 to {laws.wall.shape[1] - 1}")
    return np.ascontiguousarray(laws.wall[:, columns[wall].astype(np.int64)])
