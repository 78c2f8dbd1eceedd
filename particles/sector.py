"""Cyclic sector: a wedge of the machine whose two faces are one and the same under a turn about the axis.

With R the rotation by ``angle`` about z, every grain at x stands for its n images R^k x. A grain that
leaves through one face comes back through the other; whatever vector it carries (velocity, spin, moment,
force, contact history) turns with it. A pair across the faces is kept as (i, j, shift): the partner of i is
at R^shift x_j.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from particles.periodicity import COS, N_IMAGE, SIN, Images, Periodicity


@dataclass(frozen=True, slots=True)
class CyclicSector(Periodicity):
    """Grains live in 0 <= theta < ``angle`` [rad] about z; ``angle`` divides the full turn in two or more."""

    angle: float

    def __post_init__(self) -> None:
        if not 0.0 < self.angle <= math.pi * (1.0 + 1e-9):
            raise ValueError(
                f"sector angle = {math.degrees(self.angle):g} degrees; allowed: 360/n with n = 2, 3, ...; "
                "leave the sector out for the full ring"
            )
        parts = 2.0 * math.pi / self.angle
        if abs(parts - round(parts)) > 1e-6 * parts:
            nearest = 360.0 / round(parts)
            raise ValueError(
                f"sector angle = {math.degrees(self.angle):g} degrees does not divide 360 degrees into equal "
                f"parts; the nearest that does is {nearest:g} degrees"
            )
        object.__setattr__(self, "angle", 2.0 * math.pi / round(parts))

    @property
    def n_sectors(self) -> int:
        """Number of sectors make the full ring."""
        return round(2.0 * math.pi / self.angle)

    def rotation(self, shift: int | np.ndarray) -> np.ndarray:
        """Matrices R^shift of the turn by shift*angle about z, shape (..., 3, 3)."""
        turn = np.asarray(shift, dtype=float) * self.angle
        c, s, o, e = np.cos(turn), np.sin(turn), np.zeros_like(turn), np.ones_like(turn)
        return np.stack([np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, e], -1)], -2)

    @property
    def images(self) -> np.ndarray:
        """See `Periodicity`: turns by -angle, 0 and angle, (3, 6)."""
        turn, table = self.angle * np.array([-1.0, 0.0, 1.0]), np.zeros((3, N_IMAGE))
        table[:, COS], table[:, SIN] = np.cos(turn), np.sin(turn)
        return table

    def turn(self, vectors: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """R^shift applied row by row; ``vectors`` shape (n, 3), ``shift`` shape (n,)."""
        return np.einsum("nij,nj->ni", self.rotation(shift), vectors)

    def place(self, position: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """As `turn`."""
        return self.turn(position, shift)

    def sweep(self, velocity: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """As `turn`."""
        return self.turn(velocity, shift)

    def images_near(self, position: np.ndarray, margin: float) -> Images:
        """See `Periodicity`: beyond either face those of the grains beside the other one."""
        x, y = position[:, 0], position[:, 1]
        c, s = np.cos(self.angle), np.sin(self.angle)
        low = (y < margin) & (x > 0.0)
        high = (c * y - s * x > -margin) & (c * x + s * y > 0.0)
        grain = np.concatenate([np.flatnonzero(low), np.flatnonzero(high)])
        shift = np.repeat([1, -1], [np.count_nonzero(low), np.count_nonzero(high)])
        return Images(grain, shift, self.turn(position[grain], shift), low | high)

    def wraps(self, position: np.ndarray) -> np.ndarray:
        """Turns, in sectors, that bring each position back into the wedge: int64, shape (n,), mostly 0."""
        theta = np.arctan2(position[:, 1], position[:, 0])
        theta = np.where(theta < 0.0, theta + 2.0 * np.pi, theta)
        # a tiny negative theta becomes 2 pi after rounding, which is sector 0 and not sector n
        return -(np.floor(theta / self.angle).astype(np.int64) % self.n_sectors)

    def widest_cutoff(self, position: np.ndarray) -> float:
        """Half the chord [m] of the wedge at the innermost of the positions (n, 3) [m]: see `require_width`."""
        inner = float(np.min(np.hypot(position[:, 0], position[:, 1])))
        return inner * math.sin(0.5 * self.angle)

    def require_width(self, position: np.ndarray, cutoff: float) -> None:
        """Refuse a wedge in which a grain could see its own image, or one partner through both faces.

        Raises
        ------
        ValueError
            If the chord of the wedge at the smallest radius of ``position`` [m] is below two cut-offs [m].
        """
        inner = float(np.min(np.hypot(position[:, 0], position[:, 1])))
        chord = 2.0 * inner * math.sin(0.5 * self.angle)
        if chord < 2.0 * cutoff * (1.0 - 1e-12):
            raise ValueError(
                f"the sector of {math.degrees(self.angle):g} degrees is {chord * 1e3:.4g} mm wide at the "
                f"innermost grain (r = {inner * 1e3:.4g} mm); allowed: at least two cut-offs = "
                f"{2e3 * cutoff:.4g} mm; use a wider sector, smaller grains, or a shorter cut-off"
            )

    def begin_list(self) -> None:
        """See `Periodicity`: nothing to do."""

    def state(self) -> dict[str, np.ndarray]:
        """See `Periodicity`: nothing changes."""
        return {}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """See `Periodicity`."""
