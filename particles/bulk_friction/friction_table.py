"""Bulk friction mu_bulk(mu_s, mu_r) of a dry powder from a measured table, and the pairs that give one bulk friction.

The table, `measured.csv`, has the result of `tests/benchmarks/steady_shear.py` against sliding friction mu_s and
rolling friction mu_r; `tests/benchmarks/bulk_friction.py` made it. Errors of single runs are too small where seeds
differ by more; all are then enlarged by what the repeated points say together (R. T. Birge, Phys. Rev. 40 (1932) 207).
Means over the seeds grow with rolling friction; where noise has one that does not, neighbours are averaged (isotonic
regression: Barlow, Bartholomew, Bremner & Brunk, Statistical Inference under Order Restrictions, 1972). Between its
points the table is interpolated by monotone cubics (Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238), so that one
rolling friction at most belongs to a sliding friction.

**Ends of a line.** mu_bulk saturates in both directions. Spheres that roll freely reach no more than 0.4, whatever
their sliding friction: they roll instead of slide. From mu_r about 2 mu_s on, grains slide before they roll: the torque
mu_r R_eff F = mu_r R F/2 of a contact exceeds that of its largest tangential force, mu_s F R, and more rolling friction
changes nothing. So one bulk friction is had from (mu_s, 0), if at all, to the smallest mu_s that reaches it with
hindered rolling; beyond the largest mu_s of the table nothing is known.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, isotonic_regression

FILE = Path(__file__).parent / "measured.csv"
SOFTNESS = 0.08
"""By which contacts four times as stiff raise tau/P, relative: 0.537 +- 0.013 to 0.581 +- 0.008 with hindered rolling.

The grains of the table overlap by 1 to 4 %, real ones by far less, so that a bulk friction is had from less rolling
friction by up to this. Spheres that roll freely have not been compared; it is taken for them too.
"""
RESOLUTION = 1e-3  # of the ends of a line, and of a rolling friction that is none


@dataclass(frozen=True, slots=True)
class FrictionPair:
    """Contact parameters that give a bulk friction.

    Attributes
    ----------
    friction, rolling : float
        mu_s and mu_r [-].
    lowest, highest : float
        Of mu_r, for the ends of the interval of the bulk friction, the lower one with `SOFTNESS`; infinite: no mu_r
        reaches the upper end.
    """

    friction: float
    rolling: float
    lowest: float
    highest: float


@dataclass(frozen=True, slots=True)
class FrictionTable:
    """Measured bulk friction.

    Attributes
    ----------
    friction, rolling : ndarray, shapes (n,) and (m,)
        mu_s and mu_r, ascending from 0 [-].
    mean, error : ndarray, shape (n, m)
        tau/P and its standard error [-].
    runs : int
        How many the table was made of.
    """

    friction: np.ndarray
    rolling: np.ndarray
    mean: np.ndarray
    error: np.ndarray
    runs: int

    def bulk_friction(self, friction: float, rolling: float) -> tuple[float, float]:
        """Return tau/P and its standard error; beyond the last mu_r of the table it stays as it is.

        Raises
        ------
        ValueError
            A coefficient below 0, a sliding friction beyond the table.
        """
        if not (0.0 <= friction <= self.friction[-1] and rolling >= 0.0):
            raise ValueError(
                f"friction = {friction:g}, rolling friction = {rolling:g}; allowed: 0 to {self.friction[-1]:g} (the "
                "measured table), and at least 0"
            )
        at = min(rolling, self.rolling[-1])
        return float(self._along(friction, self.mean)(at)), float(self._along(friction, self.error)(at))

    def on_grid(self, friction: np.ndarray, rolling: np.ndarray) -> np.ndarray:
        """Return tau/P of every mu_s (n,) with every mu_r (m,), shape (n, m); all within the table."""
        return PchipInterpolator(self.rolling, PchipInterpolator(self.friction, self.mean)(friction), axis=1)(rolling)

    def _along(self, friction: float, values: np.ndarray) -> PchipInterpolator:
        """Interpolate a table (n, m) to one sliding friction; a function of the rolling friction is left."""
        return PchipInterpolator(self.rolling, PchipInterpolator(self.friction, values)(friction))

    def rolling_for(self, bulk: float, friction: float) -> float | None:
        """Return the mu_r with which mu_s = ``friction`` gives a bulk friction; None where none does."""
        reached, last = self._along(friction, self.mean), float(self.rolling[-1])
        free, hindered = PchipInterpolator(self.friction, self.mean[:, [0, -1]])(friction)
        if not free <= bulk <= hindered:
            return None
        if bulk >= reached(last):  # the end itself, to round-off
            return last
        return float(brentq(lambda mu_r: reached(mu_r) - bulk, 0.0, last))

    def range_of_friction(self, bulk: float) -> tuple[float, float] | None:
        """Return the smallest and the largest mu_s that give a bulk friction, to 0.001; None: none does.

        Within, some need not: where the bulk friction of grains that roll freely has saturated, it goes up and down by
        the table's noise.
        """
        reached = self._frictions_that_reach(bulk)
        return (float(reached[0]), float(reached[-1])) if len(reached) else None

    def nearest_friction(self, bulk: float, friction: float) -> float | None:
        """Return the mu_s nearest to ``friction`` that gives a bulk friction with some mu_r; None: none does."""
        if self.rolling_for(bulk, friction) is not None:
            return friction
        reached = self._frictions_that_reach(bulk)
        return float(reached[np.argmin(np.abs(reached - friction))]) if len(reached) else None

    def _frictions_that_reach(self, bulk: float) -> np.ndarray:
        friction = np.linspace(0.0, float(self.friction[-1]), 1 + round(float(self.friction[-1]) / RESOLUTION))
        free, hindered = PchipInterpolator(self.friction, self.mean[:, [0, -1]])(friction).T
        return friction[(free <= bulk) & (bulk <= hindered)]

    def pair(self, bulk: float, friction: float, spread: float = 0.0) -> FrictionPair | None:
        """Return the pair with mu_s = ``friction``; None where no mu_r gives the bulk friction.

        Parameters
        ----------
        bulk, friction : float
        spread : float
            Of the bulk friction itself [-]; the table's standard error is added in squares, and `SOFTNESS` below.
        """
        rolling = self.rolling_for(bulk, friction)
        if rolling is None:
            return None
        if rolling < RESOLUTION:
            rolling = 0.0
        half = float(np.hypot(spread, self.bulk_friction(friction, rolling)[1]))
        lowest = self.rolling_for((bulk - half) / (1.0 + SOFTNESS), friction)
        highest = self.rolling_for(bulk + half, friction)
        return FrictionPair(
            friction, rolling, 0.0 if lowest is None else lowest, float("inf") if highest is None else highest
        )


@lru_cache(maxsize=1)
def measured_table() -> FrictionTable:
    """Return the table that ships."""
    return read_table(FILE)


def read_table(path: Path) -> FrictionTable:
    """Read a table as `tests/benchmarks/bulk_friction.py` writes it.

    Raises
    ------
    ValueError
        A point of the grid is missing.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    at = np.array([[float(row["friction"]), float(row["rolling"])] for row in rows])
    values = np.array([[float(row["bulk_friction"]), float(row["error"])] for row in rows])
    friction, rolling = (np.unique(column) for column in at.T)
    mean, error = np.zeros((len(friction), len(rolling))), np.zeros((len(friction), len(rolling)))
    squares, repeats = 0.0, 0
    for i, mu_s in enumerate(friction):
        for j, mu_r in enumerate(rolling):
            # without sliding friction nothing makes a grain roll: one point stands for all mu_r
            here = values[(at[:, 0] == mu_s) & ((at[:, 1] == mu_r) | (mu_s == 0.0))]
            if not len(here):
                raise ValueError(f"{path}: no run at friction {mu_s:g} and rolling friction {mu_r:g}")
            weight = here[:, 1] ** -2
            mean[i, j], error[i, j] = np.average(here[:, 0], weights=weight), weight.sum() ** -0.5
            squares += float(weight @ (here[:, 0] - mean[i, j]) ** 2)
            repeats += len(here) - 1
    if repeats:
        error *= max(1.0, np.sqrt(squares / repeats))
    for i in range(len(friction)):  # more rolling friction never makes a powder weaker: what is lower is noise
        mean[i] = isotonic_regression(mean[i], weights=error[i] ** -2).x
    return FrictionTable(friction, rolling, mean, error, len(rows))
