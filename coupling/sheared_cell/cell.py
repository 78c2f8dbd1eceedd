# mypy: ignore-errors
"""A box that repeats in all three directions and is sheared: images, wrapping, lists of pairs (Lees & Edwards 1972).

Flow along x, gradient along z. The box is [0, Lx) x [0, Ly) x [0, Lz); the copy above it has moved on by the `offset`
strain Lz, and flows faster by rate Lz. An image by the whole numbers s = (s_x, s_y, s_z) of a grain at x, v stands and
moves at

    x + (s_x Lx + s_z offset, s_y Ly, s_z Lz),      v + (s_z rate Lz, 0, 0).

Grains are wrapped only when the lists are made; between, they move on freely and the images of a pair keep their s,
while `offset` grows. So a wrap changes no distance and no relative velocity, and springs of contacts continue as they
are.

Source: A. W. Lees, S. F. Edwards, J. Phys. C 5 (1972) 1921.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coupling.neighbour_rows import NeighbourRows
from particles import find_pairs


@dataclass(frozen=True, slots=True)
class SquareBox:
    """Edges [m] of the box."""

    lengths: tuple[float, float, float]

    @classmethod
    def of_fill(cls, count: int, diameter: float, fill: float) -> SquareBox:
        """The cube in which ``count`` grains of ``diameter`` [m] take the fraction ``fill``."""
        edge = diameter * (count * math.pi / 6.0 / fill) ** (1.0 / 3.0)
        return cls((edge, edge, edge))

    @property
    def volume(self) -> float:
        """[m^3]"""
        return math.prod(self.lengths)

    def wrap(self, position: np.ndarray, velocity: np.ndarray, offset: float, rate: float) -> None:
        """Bring grains (n, 3) [m], [m/s] back into the box, in place, at a wrapped or unwrapped ``offset`` [m]."""
        Lx, Ly, Lz = self.lengths
        crossed = np.floor(position[:, 2] / Lz)
        position[:, 2] -= crossed * Lz
        position[:, 0] -= crossed * offset
        velocity[:, 0] -= crossed * rate * Lz
        position[:, 0] -= Lx * np.floor(position[:, 0] / Lx)
        position[:, 1] -= Ly * np.floor(position[:, 1] / Ly)

    def image_shift(self, image: np.ndarray, offset: float) -> np.ndarray:
        """Return where images (g, 3) by whole numbers stand relative to their grains, (g, 3) [m]."""
        shift = image * np.array(self.lengths)
        shift[:, 0] += image[:, 2] * offset
        return shift

    def ghosts(self, position: np.ndarray, reach: float, offset: float) -> tuple[np.ndarray, np.ndarray]:
        """All images of wrapped grains within ``reach`` [m] of the box: their owners (g,) and whole numbers (g, 3)."""
        edges = np.array(self.lengths)
        owners, images = [], []
        for sz in (-1, 0, 1):
            for sy in (-1, 0, 1):
                for sx in (-2, -1, 0, 1, 2):  # 0 <= offset < Lx adds to it
                    if sx == sy == sz == 0:
                        continue
                    image = np.array([[sx, sy, sz]])
                    x = position + self.image_shift(image.astype(float), offset)
                    near = np.flatnonzero(np.all((x > -reach) & (x < edges + reach), axis=1))
                    owners.append(near)
                    images.append(np.repeat(image, len(near), axis=0))
        return np.concatenate(owners), np.concatenate(images).astype(np.int8)


@dataclass(frozen=True, slots=True, eq=False)
class CellPairs:
    """Pairs of a sheared cell, each once, and the full rows of its grains over grains and ghosts.

    Attributes
    ----------
    first, second : (p,) int32
        Grains of a pair, first < second.
    image : (p, 3) int8
        By which the second is displaced from the first.
    rows : NeighbourRows
        Of grains and ghosts (n + g); those of the ghosts are empty.
    owner, ghost_image : (g,) int64, (g, 3) int8
        The ghosts.
    position : (n, 3) float64
        Wrapped, when the list was made [m].
    strain : float
        Then [-].
    """

    first: np.ndarray
    second: np.ndarray
    image: np.ndarray
    rows: NeighbourRows
    owner: np.ndarray
    ghost_image: np.ndarray
    position: np.ndarray
    strain: float


def cell_pairs(box: SquareBox, position: np.ndarray, reach: float, strain: float) -> CellPairs:
    """Every pair closer than ``reach`` [m] among wrapped grains (n, 3) [m] and their images.

    Raises
    ------
    ValueError
        A box too small: a grain would meet the same neighbour twice.
    """
    if min(box.lengths) < 2.0 * reach:
        raise ValueError(
            f"the cell has edges of {1e3 * min(box.lengths):.3g} mm, pairs reach {1e3 * reach:.3g} mm: a grain would "
            "meet a neighbour twice; take more grains or a shorter reach"
        )
    n = len(position)
    offset = strain * box.lengths[2] % box.lengths[0]
    owner, ghost_image = box.ghosts(position, reach, offset)
    everywhere = np.concatenate([position, position[owner] + box.image_shift(ghost_image.astype(float), offset)])
    found = find_pairs(everywhere, reach)
    i, j = found.rows(), found.other.astype(np.int64)
    keep = i < n  # pairs of two ghosts belong to others
    i, j = i[keep], j[keep]
    inside = j < n
    grain = np.concatenate([np.arange(n), owner])
    image = np.zeros((len(j), 3), dtype=np.int8)
    image[~inside] = ghost_image[j[~inside] - n]
    once = inside | (i < grain[j])  # a pair through a face is found from both sides
    first, second, image_once = i[once], grain[j[once]], image[once]
    order = np.lexsort((second, first))
    # full rows, in the order of the grains' numbers alone
    row, other = np.concatenate([i, j[inside]]), np.concatenate([j, i[inside]])
    by_row = np.lexsort((other, row))
    start = np.zeros(len(everywhere) + 1, dtype=np.int64)
    np.cumsum(np.bincount(row, minlength=len(everywhere)), out=start[1:])
    turn = np.array([1.0, 1.0, 1.0]), np.zeros(3)
    rows = NeighbourRows(
        start, other[by_row].astype(np.int32), np.zeros(len(other), dtype=np.int8), *turn, everywhere, reach
    )
    return CellPairs(
        first[order].astype(np.int32), second[order].astype(np.int32), image_once[order], rows, owner, ghost_image,
        position.copy(), strain,
    )  # fmt: skip
