"""Diameters of grains: the distributions by number, their moments, and seeded draws from them.

Every distribution is sampled through the inverse of its cumulative distribution, one uniform random number a grain: the
first n of a longer draw are the draw of n, so that a number of grains and a volume of grains lead to the same sequence.

The unbounded distributions are cut off on both sides (and scaled up to one again): a grain of no size, or one that is
larger than the gap, cannot be simulated. Where no limits are given, normal diameters are cut at three standard
deviations, log-normal ones at three geometric ones; the moments are those of what is left.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri

from geometry.table_file import FileFault, is_unit_of, read_table

_STREAM = 1  # keeps the sizes' random numbers apart from the positions', which are drawn with the bare seed
_CUT = 3.0  # standard deviations
_BLOCK = 4096  # grains sampled at a time until a volume is reached
_BY_MASS = ("mass", "weight", "volume")  # of one density: each is the same fraction
_BETWEEN_PERCENTILES = np.array([0.1, 0.4, 0.4, 0.1])  # of the powder, of 0, 10, 50, 90 and 100 %


class GrainSizes(ABC):
    """A distribution of diameters, by number of grains."""

    @property
    @abstractmethod
    def limits(self) -> tuple[float, float]:
        """Smallest and largest diameter [m]."""

    @abstractmethod
    def moment(self, power: int) -> float:
        """Mean of d^power [m^power] over the grains, power 0 to 4."""

    @abstractmethod
    def at(self, fraction: np.ndarray) -> np.ndarray:
        """Diameters [m] that ``fraction`` of the grains, between 0 and 1, are smaller than."""

    @property
    def mean(self) -> float:
        """Mean diameter [m]."""
        return self.moment(1)

    @property
    def mean_by_volume(self) -> float:
        """Mean diameter [m] over the powder's volume, in which each grain counts by its own."""
        return self.moment(4) / self.moment(3)

    @property
    def deviation(self) -> float:
        """Standard deviation of the diameter [m]."""
        return math.sqrt(max(0.0, self.moment(2) - self.moment(1) ** 2))

    @property
    def mean_volume(self) -> float:
        """Mean volume of a grain [m^3]."""
        return math.pi / 6.0 * self.moment(3)

    def draw(self, count: int, seed: int) -> np.ndarray:
        """Diameters [m] of ``count`` grains, shape (count,); the same for the same seed."""
        return self.at(_generator(seed).random(count))

    def draw_volume(self, volume: float, seed: int) -> np.ndarray:
        """Diameters [m] of as many grains as come nearest to ``volume`` [m^3] together, shape (n,).

        Grains are added until the volume is reached; the last stays where that leaves the sum nearer. The sum is
        therefore off by half a grain at most.
        """
        rng = _generator(seed)
        drawn, total = [np.zeros(0)], 0.0
        while total < volume:
            block = self.at(rng.random(_BLOCK))
            drawn.append(block)
            total += math.pi / 6.0 * float(np.sum(block**3))
        diameter = np.concatenate(drawn)
        filled = np.concatenate([[0.0], math.pi / 6.0 * np.cumsum(diameter**3)])
        return diameter[: int(np.argmin(np.abs(filled - volume)))]


def _generator(seed: int) -> np.random.Generator:
    return np.random.default_rng((seed, _STREAM))


def _require_order(smallest: float, largest: float) -> None:
    if not 0.0 < smallest < largest < math.inf:
        raise ValueError(
            f"diameters from {smallest * 1e3:g} to {largest * 1e3:g} mm; allowed: more than 0, the smallest first and "
            "below the largest"
        )


@dataclass(frozen=True, slots=True)
class EqualSizes(GrainSizes):
    """All grains of one ``diameter`` [m]."""

    diameter: float

    def __post_init__(self) -> None:
        if not 0.0 < self.diameter < math.inf:
            raise ValueError(f"diameter = {self.diameter * 1e3:g} mm; allowed: more than 0")

    @property
    def limits(self) -> tuple[float, float]:
        return self.diameter, self.diameter

    def moment(self, power: int) -> float:
        return self.diameter**power

    def at(self, fraction: np.ndarray) -> np.ndarray:
        return np.full(np.shape(fraction), self.diameter)


@dataclass(frozen=True, slots=True)
class UniformSizes(GrainSizes):
    """Every diameter between ``smallest`` and ``largest`` [m] is as likely."""

    smallest: float
    largest: float

    def __post_init__(self) -> None:
        _require_order(self.smallest, self.largest)

    @property
    def limits(self) -> tuple[float, float]:
        return self.smallest, self.largest

    def moment(self, power: int) -> float:
        """(b^(k+1) - a^(k+1))/((k+1)(b - a)), as a sum that does not cancel."""
        a, b = self.limits
        return sum(a**i * b ** (power - i) for i in range(power + 1)) / (power + 1)

    def at(self, fraction: np.ndarray) -> np.ndarray:
        return self.smallest + (self.largest - self.smallest) * np.asarray(fraction)


@dataclass(frozen=True, slots=True)
class NormalSizes(GrainSizes):
    """Gaussian with ``centre`` and ``spread`` (standard deviation) [m] before it is cut at ``smallest``, ``largest``.

    Raises
    ------
    ValueError
        If the spread is not positive, the limits are no diameters in order, or the centre is not between them.
    """

    centre: float
    spread: float
    smallest: float | None = None
    largest: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.spread < math.inf:
            raise ValueError(f"standard deviation = {self.spread * 1e3:g} mm; allowed: more than 0")
        a, b = self.limits
        if a <= 0.0:
            raise ValueError(
                f"three standard deviations below the mean is {a * 1e3:g} mm, no diameter; lower the deviation, or "
                "give the smallest diameter"
            )
        _require_order(a, b)
        if not a <= self.centre <= b:
            raise ValueError(
                f"mean = {self.centre * 1e3:g} mm is not between the limits {a * 1e3:g} and {b * 1e3:g} mm"
            )

    @property
    def limits(self) -> tuple[float, float]:
        a = self.centre - _CUT * self.spread if self.smallest is None else self.smallest
        b = self.centre + _CUT * self.spread if self.largest is None else self.largest
        return a, b

    def moment(self, power: int) -> float:
        """m_k = (k - 1) s^2 m_(k-2) + c m_(k-1) - s (b^(k-1) f(b) - a^(k-1) f(a)), by parts.

        c is the centre, s the spread, f the standard density over the probability between the limits a and b.
        """
        a, b = self.limits
        below, above = self._standard()
        inside = ndtr(above) - ndtr(below)
        f_a, f_b = (math.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi) / inside for t in (below, above))
        moments = [1.0]
        for k in range(1, power + 1):
            edge = self.spread * (b ** (k - 1) * f_b - a ** (k - 1) * f_a)
            earlier = (k - 1) * self.spread**2 * moments[k - 2] if k > 1 else 0.0
            moments.append(earlier + self.centre * moments[k - 1] - edge)
        return float(moments[power])

    def at(self, fraction: np.ndarray) -> np.ndarray:
        return np.clip(self.centre + self.spread * _cut_normal(fraction, *self._standard()), *self.limits)

    def _standard(self) -> tuple[float, float]:
        a, b = self.limits
        return (a - self.centre) / self.spread, (b - self.centre) / self.spread


@dataclass(frozen=True, slots=True)
class LogNormalSizes(GrainSizes):
    """ln d is Gaussian about the ``median`` [m], with geometric standard deviation ``spread`` (> 1), before it is cut.

    Sieves and image analysis give powders in these two numbers: 68 % of the grains lie between median/spread and
    median*spread. Both are those by number; of a distribution by mass take median exp(-3 ln^2 spread) (Hatch & Choate
    1929), its spread is the same.
    """

    median: float
    spread: float
    smallest: float | None = None
    largest: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.median < math.inf:
            raise ValueError(f"median = {self.median * 1e3:g} mm; allowed: more than 0")
        if not 1.0 < self.spread < math.inf:
            raise ValueError(f"geometric standard deviation = {self.spread:g}; allowed: more than 1 (1.2 is usual)")
        a, b = self.limits
        _require_order(a, b)
        if not a <= self.median <= b:
            raise ValueError(
                f"median = {self.median * 1e3:g} mm is not between the limits {a * 1e3:g} and {b * 1e3:g} mm"
            )

    @property
    def limits(self) -> tuple[float, float]:
        a = self.median / self.spread**_CUT if self.smallest is None else self.smallest
        b = self.median * self.spread**_CUT if self.largest is None else self.largest
        return a, b

    def moment(self, power: int) -> float:
        """median^k exp(k^2 s^2/2) times the part of a Gaussian moved by k s within the limits; s = ln spread."""
        s = math.log(self.spread)
        below, above = self._standard()
        left = (ndtr(above - power * s) - ndtr(below - power * s)) / (ndtr(above) - ndtr(below))
        return float(self.median**power * math.exp(0.5 * (power * s) ** 2) * left)

    def at(self, fraction: np.ndarray) -> np.ndarray:
        return np.clip(self.median * self.spread ** _cut_normal(fraction, *self._standard()), *self.limits)

    def _standard(self) -> tuple[float, float]:
        a, b = self.limits
        return math.log(a / self.median) / math.log(self.spread), math.log(b / self.median) / math.log(self.spread)


def _cut_normal(fraction: np.ndarray, below: float, above: float) -> np.ndarray:
    """Inverse cumulative standard normal distribution between two limits."""
    low, high = ndtr(below), ndtr(above)
    return ndtri(low + np.asarray(fraction) * (high - low))


@dataclass(frozen=True, slots=True)
class PercentileSizes(GrainSizes):
    """The powder of which 10, 50 and 90 % are finer than ``d10``, ``d50``, ``d90`` [m], as makers describe it.

    Between ``smallest``, the three diameters and ``largest`` the cumulative curve is straight over ln d, which is how
    points of a sieve analysis are joined. Of a powder described by mass (or by volume, the same at one density) the
    density by number is that by mass over d^3: with q_i the fraction of section i, in ln d,

        number in ln d ~ q_i/ln(b_i/a_i) d^-3,   a_i < d < b_i.

    Parameters
    ----------
    d10, d50, d90 : float
        [m]
    smallest, largest : float, optional
        [m]; by default as far beyond d10 and d90, in ln d, as these are from d50: d10^2/d50 and d90^2/d50.
    by_mass : bool
        The percentages are of the mass, as sieves and laser diffraction give them; false: of the number of grains.

    Raises
    ------
    ValueError
        If the diameters are not positive and ascending.
    """

    d10: float
    d50: float
    d90: float
    smallest: float | None = None
    largest: float | None = None
    by_mass: bool = True

    def __post_init__(self) -> None:
        edges = self._edges
        if not (0.0 < edges[0] and np.all(np.diff(edges) > 0.0) and edges[-1] < math.inf):
            listed = ", ".join(f"{1e3 * edge:g}" for edge in edges)
            raise ValueError(
                f"smallest, d10, d50, d90, largest = {listed} mm; allowed: more than 0, each above the one before"
            )

    @property
    def limits(self) -> tuple[float, float]:
        smallest = self.d10**2 / self.d50 if self.smallest is None else self.smallest
        return smallest, self.d90**2 / self.d50 if self.largest is None else self.largest

    def moment(self, power: int) -> float:
        """Sum over the sections of q/ln(b/a) int d^(power - 3) d(ln d), over that of power 0; 3 is 0 by number."""
        over = self._sections(power - self._reduction).sum() / self._sections(-self._reduction).sum()
        return float(self.d50**power * over)

    def at(self, fraction: np.ndarray) -> np.ndarray:
        number = self._sections(-self._reduction)
        upper = np.cumsum(number) / number.sum()
        k = np.minimum(np.searchsorted(upper, fraction, side="right"), len(number) - 1)
        t = np.clip((fraction - np.append(0.0, upper)[k]) * number.sum() / number[k], 0.0, 1.0)
        a, b = self._edges[k], self._edges[k + 1]
        if not self.by_mass:
            return a * (b / a) ** t
        return np.clip(a * (1.0 - t * (1.0 - (a / b) ** 3)) ** (-1.0 / 3.0), a, b)

    @property
    def _edges(self) -> np.ndarray:
        return np.array([self.limits[0], self.d10, self.d50, self.d90, self.limits[1]])

    @property
    def _reduction(self) -> int:
        return 3 if self.by_mass else 0

    def _sections(self, power: int) -> np.ndarray:
        """q/ln(b/a) int (d/d50)^power d(ln d) of each section."""
        a, b = self._edges[:-1] / self.d50, self._edges[1:] / self.d50
        part = np.log(b / a)
        return _BETWEEN_PERCENTILES * ((b**power - a**power) / (power * part) if power else 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ListedSizes(GrainSizes):
    """The diameters of a list [m], each with its fraction.

    Parameters
    ----------
    diameter : sequence of float
        [m]
    weight : sequence of float, optional
        Shares, scaled to a sum of one; by default equal.
    by_mass : bool
        The weights are fractions of the mass, as a sieve gives them; false: of the number of grains.

    Raises
    ------
    ValueError
        If a diameter is not positive, a weight is negative, or there are not as many of one as of the other.
    """

    diameter: Sequence[float] | np.ndarray
    weight: Sequence[float] | np.ndarray | None = None
    by_mass: bool = False
    _sorted: np.ndarray = field(init=False, repr=False)
    _share: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        d = np.array(self.diameter, dtype=float).reshape(-1)
        w = np.ones(len(d)) if self.weight is None else np.array(self.weight, dtype=float).reshape(-1)
        if not len(d):
            raise ValueError("the list of diameters is empty; give one at least")
        if len(w) != len(d):
            raise ValueError(f"{len(d)} diameters but {len(w)} weights; give as many of one as of the other")
        for name, value, bad in (
            ("diameter", d, ~(np.isfinite(d) & (d > 0.0))),
            ("weight", w, ~(np.isfinite(w) & (w >= 0.0))),
        ):
            if bad.any():
                k = int(np.flatnonzero(bad)[0])
                raise ValueError(f"{name} {k + 1} of the list is {value[k]:g}; it must be positive and finite")
        if not w.any():
            raise ValueError("every weight of the list is 0; raise one at least")
        if self.by_mass:
            w = w / (d / d.max()) ** 3
        order = np.argsort(d, kind="stable")
        kept = order[w[order] > 0.0]
        object.__setattr__(self, "_sorted", d[kept])
        object.__setattr__(self, "_share", w[kept] / w.sum())

    @property
    def limits(self) -> tuple[float, float]:
        return float(self._sorted[0]), float(self._sorted[-1])

    def moment(self, power: int) -> float:
        return float(self._share @ self._sorted**power)

    def at(self, fraction: np.ndarray) -> np.ndarray:
        edges = np.cumsum(self._share)
        place = np.searchsorted(edges, np.asarray(fraction), side="right")
        return self._sorted[np.minimum(place, len(self._sorted) - 1)]  # the last edge is 1 up to round-off


def read_sizes(path: str | Path) -> ListedSizes:
    """Sizes from a table with a column diameter, and perhaps one of fractions: ``diameter [um], mass [%]``.

    Fractions are by number, or by mass, weight or volume, which are the same for grains of one density. They are given
    in per cent, or as numbers, masses or volumes.

    Raises
    ------
    FileFault
        If the file is no such table, or its fractions look cumulative.
    """
    table = read_table(path, _unit_of_sizes)
    names = [name.lower() for name in table.names]
    if "diameter" not in names:
        raise FileFault(path, "has no column of diameters; write e.g. 'diameter [um]' in its header")
    fractions = [name for name in names if name != "diameter"]
    if len(fractions) > 1:
        raise FileFault(path, f"has fractions by {' and by '.join(fractions)}; keep one of the columns")
    if table.unused and not fractions:
        others = ", ".join(name for name, _ in table.unused)
        raise FileFault(
            path,
            f"has the columns {others} beside the diameter; write number [%], mass [%] or volume [%] over fractions, "
            "and remove other columns",
        )
    table.warn_of_unused()
    weight = table.values[:, names.index(fractions[0])] if fractions else None
    try:
        if weight is not None:
            unit = table.units[names.index(fractions[0])]
            refuse_cumulative(weight, total=100.0 if _unit_of_sizes(1, fractions[0], unit) == "%" else None)
        return ListedSizes(table.values[:, names.index("diameter")], weight, by_mass=fractions[:1] != ["number"])
    except ValueError as error:
        raise FileFault(path, f"{error}") from None


def refuse_cumulative(weight: Sequence[float] | np.ndarray, total: float | None = None) -> None:
    """Raise ValueError where fractions look cumulative, those of all smaller or larger grains.

    They do where they do not add up to a known `total` within 1 %; without one, where three or more ascend to 1 or 100
    or descend from it.
    """
    w = np.asarray(weight, dtype=float)
    sum_of = float(w.sum())
    one_way = len(w) > 2 and (all(np.diff(w) > 0.0) or all(np.diff(w) < 0.0)) and w.max() in (1.0, 100.0)
    if total is not None and abs(sum_of - total) > 0.01 * total:
        raise ValueError(
            f"the fractions add up to {sum_of:g}; are they cumulative, or are rows missing? Write the fraction of each "
            f"size alone, and of all sizes, so that they add up to {total:g} % within 1 %"
        )
    if total is None and one_way:
        raise ValueError(
            f"the fractions {'descend from' if w[0] > w[-1] else 'ascend to'} {w.max():g}; are they cumulative, or "
            "relative to the largest one? Write the fraction of each size alone; of those relative to the largest one, "
            f"divide each by their sum, {sum_of:g}"
        )


def _unit_of_sizes(place: int, name: str, unit: str) -> str | None:
    name = name.lower()
    if name in _BY_MASS:
        return next((goal for goal in ("kg", "m^3") if is_unit_of(unit, goal)), "%")
    return {"diameter": "m", "number": "%" if unit == "%" else ""}.get(name)
