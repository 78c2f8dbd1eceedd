"""A quantity in time: a shaft's speed, a load, a coil's current or voltage. A constant is one point at 0 s."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np


@dataclass(frozen=True, slots=True)
class TimeProfile:
    """Linear between ``times`` [s], constant before the first and after the last.

    Attributes
    ----------
    times : tuple of float
        Increasing [s].
    values : tuple of float
        As many, in SI units.

    Raises
    ------
    ValueError
        Times that do not increase, are as many as no values, or a number that is not finite.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        times, values = (tuple(float(x) for x in given) for given in (self.times, self.values))
        if not times or len(times) != len(values):
            raise ValueError(f"a time profile has {len(times)} times but {len(values)} values; give as many of each")
        if not all(map(math.isfinite, times + values)) or any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"times of a time profile must be finite and increase, got {times} s")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def constant(cls, value: float) -> Self:
        """One constant value."""
        return cls((0.0,), (value,))

    def at(self, time: np.ndarray) -> np.ndarray:
        """The values at ``time`` (n,) [s]."""
        return np.asarray(np.interp(time, self.times, self.values))

    def __call__(self, time: float) -> float:
        """The value at ``time`` [s]."""
        return float(np.interp(time, self.times, self.values))

    def crossings(self, value: float) -> list[float]:
        """Instants [s] between two points of the profile at which it passes ``value``."""
        return [
            t0 + (t1 - t0) * (value - a) / (b - a)
            for (t0, a), (t1, b) in pairwise(zip(self.times, self.values, strict=True))
            if min(a, b) < value < max(a, b)
        ]

    def __truediv__(self, divisor: float) -> Self:
        """The profile with every value divided by a number, as I = V/R."""
        return type(self)(self.times, tuple(value / divisor for value in self.values))

    def is_constant_after(self, time: float) -> bool:
        """True if the value does not change at once after ``time`` [s]."""
        k = int(np.searchsorted(self.times, time, side="right"))
        return k in (0, len(self.times)) or self.values[k - 1] == self.values[k]

    def turning_values(self, begin: float, end: float) -> list[float]:
        """The values at which a rise becomes a fall, or a fall a rise, after ``begin`` and not after ``end`` [s].

        Where the value stays before it turns, the turn is at the beginning of the stay.
        """
        moves = [k for k, (a, b) in enumerate(pairwise(self.values)) if a != b]
        turns = [
            after
            for before, after in pairwise(moves)
            if (self.values[before + 1] > self.values[before]) != (self.values[after + 1] > self.values[after])
            and begin < self.times[before + 1] <= end
        ]
        return [self.values[k] for k in turns]

    @property
    def is_constant(self) -> bool:
        """True if it is one constant value."""
        return len(self.times) == 1

    @property
    def largest(self) -> float:
        """Largest magnitude of all values."""
        return max(map(abs, self.values))
