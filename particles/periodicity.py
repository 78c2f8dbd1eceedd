"""Space that repeats: grains live in one copy of it, and meet the images of one another beyond its faces.

An image by the shift s of what stands at x, moves with v and carries the vector a stands at R x + d, moves with
R v + du e_x and carries R a, with R a turn about z, d a translation and du a jump of the velocity along x. The shift
of a pair (i, j, s) says which image of j the grain i meets; seen from j it is -s. `CyclicSector` turns, `ShearedBox`
moves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

COS, SIN, DX, DY, DZ, DU, N_IMAGE = range(7)
"""Columns of the table of images."""


class Images(NamedTuple):
    """Images near a copy's faces, g in all.

    Attributes
    ----------
    grain, shift : ndarray of int64, shape (g,)
        Whose they are, and by which shift.
    position : ndarray, shape (g, 3)
        [m].
    beside_face : ndarray of bool, shape (n,)
        Which grains stand near enough to a face to meet any of them.
    """

    grain: np.ndarray
    shift: np.ndarray
    position: np.ndarray
    beside_face: np.ndarray


class Periodicity(ABC):
    """What lists, steps and fields need to know of the copies of space."""

    __slots__ = ()

    @property
    @abstractmethod
    def images(self) -> np.ndarray:
        """The table (2 m + 1, 6) of the images at the present time; row s + m holds those of the shift s.

        Its columns are cosine and sine of R, d [m] (3) and du [m/s].
        """

    @abstractmethod
    def wraps(self, position: np.ndarray) -> np.ndarray:
        """The shift, a row a grain, that brings each position (n, 3) [m] back into the copy; mostly 0."""

    @abstractmethod
    def turn(self, vectors: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Vectors (n, 3) as the images by ``shift`` (n,) carry them: R a."""

    @abstractmethod
    def place(self, position: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Positions (n, 3) [m] of the images by ``shift`` (n,): R x + d."""

    @abstractmethod
    def sweep(self, velocity: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Velocities (n, 3) [m/s] of the images by ``shift`` (n,): R v + du e_x."""

    @abstractmethod
    def images_near(self, position: np.ndarray, margin: float) -> Images:
        """The images of ``position`` (n, 3) [m] that stand within ``margin`` [m] of the copy."""

    @property
    def strain(self) -> float:
        """By how much the copies have been sheared past one another so far [-]; 0 where they are not."""
        return 0.0

    @property
    def height(self) -> float:
        """Height [m] of a box that may be stretched along z; 1 where nothing is."""
        return 1.0

    def approach(
        self, position: np.ndarray, before: np.ndarray, strain: float, height: float, reach: float
    ) -> float:
        """By how much [m] two grains within ``reach`` [m] may have come nearer at most.

        Since they stood at ``before`` (n, 3) [m], in the same order and on the same sides of the faces, and `strain`
        and `height` were ``strain`` and ``height``.
        """
        moved = position - before
        return 2.0 * float(np.sqrt(np.einsum("ij,ij->i", moved, moved).max(initial=0.0)))

    @abstractmethod
    def widest_cutoff(self, position: np.ndarray) -> float:
        """Largest cut-off [m] that `require_width` accepts at positions (n, 3) [m]."""

    @abstractmethod
    def require_width(self, position: np.ndarray, cutoff: float) -> None:
        """Raise a ValueError where a grain could meet its own image or two of one partner within ``cutoff`` [m]."""

    @abstractmethod
    def begin_list(self) -> None:
        """Hear that grains are about to be wrapped and their neighbours listed."""

    def at_strain(self, strain: float) -> Periodicity:
        """The copies as they stood at an earlier shear strain, numbered as they are now; unsheared ones do not move."""
        return self

    @abstractmethod
    def state(self) -> dict[str, np.ndarray]:
        """What changes while grains move, for a checkpoint."""

    @abstractmethod
    def restore(self, state: dict[str, np.ndarray]) -> None:
        """The inverse of `state`."""


def images_of(periodicity: Periodicity | None) -> np.ndarray:
    """Table of images by the shift of a pair, see `Periodicity.images`; None: one row, that of the grain itself."""
    return np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]) if periodicity is None else periodicity.images
