"""A box that repeats in all three directions and is sheared: flow along x, gradient along z (Lees & Edwards 1972).

The box is [0, Lx) x [0, Ly) x [0, Lz); the copy above it has moved on along x by the `offset`, which grows by rate Lz
in a second, and flows faster by rate Lz. The image by the whole numbers (s_x, s_y, s_z) of a grain at x, v stands and
moves at

    x + (s_x Lx + s_z offset, s_y Ly, s_z Lz),      v + (s_z rate Lz, 0, 0).

The shift of a pair holds them in one number, s_x + 5 s_y + 15 s_z with s_x from -2 to 2 and s_y, s_z from -1 to 1.

Grains are wrapped, and whole boxes taken out of the offset, only where their neighbours are listed. Between, they move
on freely and the images of a pair keep their numbers while the offset grows. So a wrap changes no distance and no
relative velocity, and springs of contacts continue as they are.

**What a list may miss.** Peculiar displacements u_i, of the midpoint rule u_x = dx - gamma (z + dz/2) with gamma
the strain since the list was made, change a distance r by at most u_i + u_j, and the flow by gamma |r_z|. A list with a
skin s beyond the largest interaction c holds every pair as long as 2 max u + gamma (c + s/2) < s.

Source: A. W. Lees, S. F. Edwards, J. Phys. C 5 (1972) 1921.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from particles.periodicity import COS, DU, DX, DZ, N_IMAGE, Images, Periodicity

MOST_X, MOST_Y, MOST_Z = 2, 1, 1
_ROW, _LAYER = 2 * MOST_X + 1, (2 * MOST_X + 1) * (2 * MOST_Y + 1)
MOST = MOST_X + _ROW * MOST_Y + _LAYER * MOST_Z
"""The largest shift, m of the table of images."""


def whole_numbers(shift: np.ndarray) -> np.ndarray:
    """The numbers (s_x, s_y, s_z) of shifts (n,): int64, (n, 3)."""
    code = np.asarray(shift, dtype=np.int64)
    z = (code + _LAYER // 2) // _LAYER
    rest = code - _LAYER * z
    y = (rest + _ROW // 2) // _ROW
    return np.stack([rest - _ROW * y, y, z], axis=-1)


NUMBERS = whole_numbers(np.arange(-MOST, MOST + 1))
"""Those of the rows of the table of images."""


@dataclass(slots=True, eq=False)
class ShearedBox(Periodicity):
    """The box and how far it is sheared.

    Parameters
    ----------
    lengths : sequence of 3 floats
        Edges [m].
    rate : float
        Shear rate dv_x/dz [1/s]; 0: a box that only repeats.

    Attributes
    ----------
    strain : float
        rate integrated over the time [-].
    offset : float
        Of the copy above [m]; whole boxes are taken out where neighbours are listed.
    list_strain : float
        The strain when the present list was made [-].
    stretched : float
        Sum of |ln(Lz after/Lz before)| since then [-], see `stretch`.
    """

    layers: ClassVar[int] = MOST_Z
    lengths: np.ndarray
    rate: float = 0.0
    strain: float = field(default=0.0, init=False)
    offset: float = field(default=0.0, init=False)
    list_strain: float = field(default=0.0, init=False)
    stretched: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self.lengths, self.rate = np.array(self.lengths, dtype=float).reshape(3), float(self.rate)
        if not (np.isfinite(self.lengths).all() and self.lengths.min() > 0.0 and np.isfinite(self.rate)):
            raise ValueError(
                f"edges of {self.lengths.tolist()} m sheared by {self.rate} 1/s; allowed: edges above 0, finite numbers"
            )

    @classmethod
    def of_fill(cls, count: int, diameter: float, fill: float, rate: float = 0.0) -> ShearedBox:
        """The cube in which ``count`` grains of ``diameter`` [m] take the fraction ``fill``."""
        edge = diameter * (count * math.pi / 6.0 / fill) ** (1.0 / 3.0)
        return cls(np.full(3, edge), rate)

    @property
    def _repeated(self) -> np.ndarray:
        """Edges along which it repeats [m]."""
        return self.lengths

    @property
    def volume(self) -> float:
        """[m^3]"""
        return float(np.prod(self.lengths))

    @property
    def images(self) -> np.ndarray:
        """See `Periodicity`: translations and jumps of the velocity, (45, 6)."""
        table = np.zeros((2 * MOST + 1, N_IMAGE))
        table[:, COS] = 1.0
        table[:, DX : DZ + 1] = NUMBERS * self.lengths
        table[:, DX] += NUMBERS[:, 2] * self.offset
        table[:, DU] = NUMBERS[:, 2] * (self.rate * self.lengths[2])
        return table

    def flow(self, z: np.ndarray) -> np.ndarray:
        """Velocity of the flow (n, 3) [m/s] at heights (n,) [m]."""
        velocity = np.zeros((len(z), 3))
        velocity[:, 0] = self.rate * z
        return velocity

    def wraps(self, position: np.ndarray) -> np.ndarray:
        """See `Periodicity`: the whole numbers themselves, int64 (n, 3), however far a grain has gone."""
        Lx, Ly, Lz = self.lengths
        z = -np.floor(position[:, 2] / Lz)
        x = -np.floor((position[:, 0] + z * self.offset) / Lx)
        return np.stack([x, -np.floor(position[:, 1] / Ly), z], axis=1).astype(np.int64)

    def turn(self, vectors: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """See `Periodicity`: as they are."""
        return np.array(vectors)

    def place(self, position: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """See `Periodicity`; ``shift`` may be whole numbers (n, 3)."""
        numbers = _numbers(shift)
        moved = position + numbers * self.lengths
        moved[:, 0] += numbers[:, 2] * self.offset
        return moved

    def sweep(self, velocity: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """See `Periodicity`; ``shift`` may be whole numbers (n, 3)."""
        swept = np.array(velocity)
        swept[:, 0] += _numbers(shift)[:, 2] * (self.rate * self.lengths[2])
        return swept

    def images_near(self, position: np.ndarray, margin: float) -> Images:
        """See `Periodicity`. Grains that have left the box widen it, and their images stand as far inside of it."""
        below = np.minimum(position.min(axis=0, initial=0.0), 0.0)
        above = np.maximum(position.max(axis=0, initial=0.0) - self.lengths, 0.0)
        low, high = below - margin, self.lengths + above + margin
        grain, numbers, x = np.arange(len(position)), np.zeros((len(position), 3), dtype=np.int64), position
        # x last: layers above and below are offset along it
        for axis, most in ((1, MOST_Y), (2, self.layers), (0, MOST_X)):
            parts = []
            for s in range(-most, most + 1):
                step = np.zeros(3, dtype=np.int64)
                step[axis] = s
                at = x + step * self.lengths
                if axis == 2:
                    at[:, 0] += s * self.offset
                near = np.flatnonzero((at[:, axis] > low[axis]) & (at[:, axis] < high[axis]))
                parts.append((grain[near], numbers[near] + step, at[near]))
            grain, numbers, x = (np.concatenate(part) for part in zip(*parts, strict=True))
        images = numbers.any(axis=1)
        inside = (position > above + margin) & (position < self.lengths + below - margin)
        shift = numbers[images] @ np.array([1, _ROW, _LAYER])
        return Images(grain[images], shift, x[images], ~inside.all(axis=1))

    def widest_cutoff(self, position: np.ndarray) -> float:
        """Half of the shortest edge [m]."""
        return 0.5 * float(self._repeated.min())

    def require_width(self, position: np.ndarray, cutoff: float) -> None:
        """See `Periodicity`."""
        shortest = float(self._repeated.min())
        if shortest < 2.0 * cutoff * (1.0 - 1e-12):
            raise ValueError(
                f"the box has edges of {1e3 * shortest:.4g} mm, pairs reach {1e3 * cutoff:.4g} mm: a grain would meet "
                "a neighbour twice; take more grains or a shorter reach"
            )

    @property
    def height(self) -> float:
        """See `Periodicity`: Lz [m]."""
        return float(self.lengths[2])

    def approach(
        self, position: np.ndarray, before: np.ndarray, strain: float, height: float, reach: float
    ) -> float:
        """See `Periodicity`: 2 max u + (gamma + |ln(Lz/height)|) reach, with displacements u less flow and stretch.

        The images of a stretched box move with it: a grain that stands still in it comes nearer to those above.
        """
        factor, sheared = self.height / height, self.strain - strain
        moved = position - before * [1.0, 1.0, factor]
        moved[:, 0] -= sheared * (0.5 * (1.0 + factor) * before[:, 2] + 0.5 * moved[:, 2])
        farthest = math.sqrt(np.einsum("ij,ij->i", moved, moved).max(initial=0.0))
        return 2.0 * farthest + (abs(sheared) + abs(math.log(factor))) * reach

    def stretch(self, factor: float) -> None:
        """Make the box higher by ``factor``; what is in it is moved by `particles.DEM.stretch`."""
        self.lengths[2] *= factor
        self.stretched += abs(math.log(factor))

    def begin_list(self) -> None:
        """Take whole boxes out of the offset; the strain since the list is 0 now."""
        self.offset -= self.lengths[0] * math.floor(self.offset / self.lengths[0])
        self.list_strain, self.stretched = self.strain, 0.0

    def at_strain(self, strain: float) -> ShearedBox:
        """See `Periodicity`: of this height."""
        box = ShearedBox(self.lengths, self.rate)
        box.strain, box.offset = strain, self.offset - (self.strain - strain) * self.lengths[2]
        return box

    def state(self) -> dict[str, np.ndarray]:
        """See `Periodicity`."""
        return {"box": np.array([*self.lengths, self.rate, self.strain, self.offset, self.list_strain, self.stretched])}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """See `Periodicity`."""
        self.lengths = state["box"][:3].copy()
        self.rate, self.strain, self.offset, self.list_strain, self.stretched = (float(v) for v in state["box"][3:])


@dataclass(slots=True, eq=False)
class GapBox(ShearedBox):
    """A gap between two walls across z, that repeats along x and y and is sheared by its walls at ``rate``.

    No image of it moves: neither offset nor strain is advanced.

    Parameters
    ----------
    corner : sequence of 3 floats
        Where it begins [m], with z = 0.
    """

    layers: ClassVar[int] = 0
    corner: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def _repeated(self) -> np.ndarray:
        return self.lengths[:2]

    def wraps(self, position: np.ndarray) -> np.ndarray:
        """See `Periodicity`."""
        numbers = ShearedBox.wraps(self, position - self.corner)
        numbers[:, 2] = 0
        return numbers

    def images_near(self, position: np.ndarray, margin: float) -> Images:
        """See `Periodicity`."""
        images = ShearedBox.images_near(self, position - self.corner, margin)
        return images._replace(position=images.position + self.corner)

    def at_strain(self, strain: float) -> GapBox:
        """See `Periodicity`: it does not move."""
        return self

    def state(self) -> dict[str, np.ndarray]:
        """See `Periodicity`: nothing changes."""
        return {}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """See `Periodicity`."""


def _numbers(shift: np.ndarray) -> np.ndarray:
    return shift if np.ndim(shift) == 2 else whole_numbers(shift)
