"""Values with errors, straight lines and power laws: the one place of Student's t and of weighted least squares.

P. R. Bevington, D. K. Robinson, "Data Reduction and Error Analysis for the Physical Sciences", 3rd ed. 2003, chapters 4
and 6, unless a function names another source. An error is a standard error, in the unit of its value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

NORMAL = 1.96  # half of a normal distribution's 95 % interval, in standard errors


def student(freedom: float, probability: float = 0.975) -> float:
    """Return the quantile of Student's t: a value of `freedom` degrees of freedom is below it with this probability.

    The default is half of the 95 % interval, in standard errors. Infinite degrees of freedom: the normal distribution.
    """
    from scipy.special import stdtrit

    return float(stdtrit(freedom, probability))


@dataclass(frozen=True, slots=True)
class Measured:
    """A value with its standard error and the degrees of freedom of that; infinite: the error is known exactly."""

    value: float
    error: float
    freedom: float = math.inf

    @classmethod
    def of(cls, sample: Any) -> Measured:
        """Return the mean of n independent values (n,), two at the least: s/sqrt(n) with n - 1 degrees of freedom."""
        n = len(sample)
        return cls(float(np.mean(sample)), float(np.std(sample, ddof=1)) / math.sqrt(n), n - 1.0)

    def half_width(self, confidence: float = 0.95) -> float:
        """Return half the width of the two-sided confidence interval by Student's t."""
        return student(self.freedom, 0.5 + 0.5 * confidence) * self.error

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the ends of the two-sided confidence interval."""
        half = self.half_width(confidence)
        return self.value - half, self.value + half

    def is_significant(self, confidence: float = 0.95) -> bool:
        """Return whether the interval excludes zero."""
        return abs(self.value) > self.half_width(confidence)

    def scaled(self, factor: float) -> Measured:
        """Return a multiple."""
        return Measured(factor * self.value, abs(factor) * self.error, self.freedom)

    def __sub__(self, other: Measured) -> Measured:
        """Return the difference of two independent values.

        With the squared errors a and b it has (a + b)^2/(a^2/f_a + b^2/f_b) degrees of freedom (B. L. Welch, Biometrika
        34 (1947) 28-35).
        """
        a, b = self.error**2, other.error**2
        rest = a**2 / self.freedom + b**2 / other.freedom
        return Measured(self.value - other.value, math.sqrt(a + b), (a + b) ** 2 / rest if rest else math.inf)

    def text(self, sign: str = "") -> str:
        """Return value and half width with as many decimals as two digits of that have; `sign` "+" shows the sign."""
        half = self.half_width()
        digits = max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 3
        return f"{self.value:{sign}.{digits}f} ± {half:.{digits}f}"


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line y = y_0 + slope (x - x_0) through points, about their weighted mean.

    Attributes
    ----------
    x : float
        x_0: the errors of y_0 and of the slope are independent there.
    y, slope : Measured
        y_0 and the slope, positive where y rises with x.
    squares : float
        Sum of the squared residuals, each over its error: chi^2 of n - 2 degrees of freedom; without errors as it is.
    """

    x: float
    y: Measured
    slope: Measured
    squares: float

    def at(self, x: float) -> Measured:
        """Return the line's y at some x; its variance is that of y_0 plus (x - x_0)^2 times that of the slope."""
        off = x - self.x
        error = math.hypot(self.y.error, off * self.slope.error)
        return Measured(self.y.value + self.slope.value * off, error, self.y.freedom)

    def zero(self) -> Measured:
        """Return the x at which y = 0, its error to first order; 0 with an infinite error where the slope is 0."""
        if self.slope.value == 0.0:
            return Measured(0.0, math.inf, self.slope.freedom)
        x = self.x - self.y.value / self.slope.value
        return Measured(x, self.at(x).error / abs(self.slope.value), self.slope.freedom)


def line(x: Any, y: Any, error: Any = None) -> Line:
    """Return the straight line of least squares.

    Parameters
    ----------
    x : (n,), two different ones at the least.
    y : (n,); with errors also (m, n), for m lines whose values and squares are (m,).
    error : (n,) standard errors of y, above 0. None: all alike, and as large as the residuals show, with n - 2 degrees
        of freedom; of three points at the least.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    weight = np.ones_like(x) if error is None else np.asarray(error, dtype=np.float64) ** -2.0
    total = float(weight.sum())
    at, level = float(weight @ x) / total, y @ weight / total
    dx, dy = x - at, y - level[..., None]
    spread = float(weight @ dx**2)
    slope = dy @ (weight * dx) / spread
    squares = (dy - slope[..., None] * dx) ** 2 @ weight
    level, slope, squares = (one if one.ndim else float(one) for one in (level, slope, squares))
    scatter, freedom = (math.sqrt(squares / (x.size - 2)), x.size - 2.0) if error is None else (1.0, math.inf)
    return Line(
        at, Measured(level, scatter / math.sqrt(total), freedom),
        Measured(slope, scatter / math.sqrt(spread), freedom), squares,
    )  # fmt: skip


def power_law(x: Any, y: Any, error: Any = None) -> tuple[float, Measured] | None:
    """Return factor [unit of y over that of x^p] and exponent p of the law y = factor x^p nearest to some points.

    Least squares in ln y over ln x. Where the points scatter more than their errors say, the exponent has the error of
    that scatter, with n - 2 degrees of freedom (R. T. Birge, Phys. Rev. 40 (1932) 207-227). None with fewer than three
    points above zero, at two different x at the least.

    Parameters
    ----------
    x, y : (n,); points that are not above zero do not count.
    error : (n,) standard errors of y; all alike where it is None, or that of a point is unknown.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    used = (x > 0.0) & (y > 0.0)
    if np.count_nonzero(used) < 3 or not np.ptp(x[used]):
        return None
    x, y, sigma = x[used], y[used], None if error is None else np.asarray(error, dtype=np.float64)[used]
    is_known = sigma is not None and bool(np.all(np.isfinite(sigma) & (sigma > 0.0)))
    found = line(np.log(x), np.log(y), sigma / y if is_known else None)
    slope, excess = found.slope, found.squares / (x.size - 2)
    if is_known and excess > 1.0:
        slope = Measured(slope.value, math.sqrt(excess) * slope.error, x.size - 2.0)
    return math.exp(found.at(0.0).value), slope
