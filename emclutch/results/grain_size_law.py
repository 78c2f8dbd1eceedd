"""Torque over the size of the grains, extrapolated to the size of the real powder.

**Law.** T(n) = T_inf (1 + a/n^2) with n grains across the gap. Flow of grains is nonlocal: what is sheared sets the
powder next to it in motion over a length of some diameters, and walls that hold it take that away. In the quasi-static
limit the excess of the friction over that of a wide gap is then (pi A d/g)^2 for a gap g and the nonlocal amplitude A
(K. Kamrin, D. L. Henann, Soft Matter 11 (2015) 179-185, from the fluidity's equation of K. Kamrin, G. Koval, Phys. Rev.
Lett. 108 (2012) 178301). Both shipped clutches follow it (docs/explanation/brake.md), and exclude 1/n, which a layer of
a fixed number of diameters at each wall would have. Weighted least squares, each torque by its error.

**Verdict.** As for grids (P. J. Roache, J. Fluids Eng. 116 (1994) 405-413; ASME V&V 20-2009, section 2): from three
sizes on the exponent of T_inf (1 + a/n^p) is fitted too, with its 95 % interval by the profile of chi^2. The sizes are
asymptotic where that interval holds 2 and nothing outside 1 to 4 (half and twice the order, as L. Eca and M. Hoekstra
limit it, J. Comput. Phys. 262 (2014) 104-130), not asymptotic where it excludes 2 or no such law fits, and else
undecided within the noise. The convergence index of the finest size is |T/T_real - 1| of the fit, T_inf where the real
size is not known, with p free where the sizes are not asymptotic, times 1.25 where they are and 3 in all other cases.
Another exponent than 2 may be asked for; the verdict is then on that one.

**Intervals** are those of the torques' errors, which are Student's where they come from few packings
(`TorqueCurve.error`). Of five sizes with known errors they hold the truth in 95 % of simulated studies; with errors
from the scatter of 2 to 6 packings, which weights follow too, T_inf in 93 to 96 % and T near the finest in 91 to 94 %.
Where points scatter more than their errors say (chi^2 at 5 %), their scatter counts, with Student's t of the degrees of
freedom.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from emclutch.results.torque_curves import NORMAL, TorqueCurve

EXPONENT = 2.0  # of the grains across the gap: Kamrin and Henann 2015
SIGNIFICANCE = 0.05  # of a scatter that errors do not explain
ORDERS = np.geomspace(0.1, 10.0, 2001)  # exponents that are tried, 0.23 % apart
BOUNDS = 0.5, 2.0  # of the exponent over that of the law, Eca and Hoekstra 2014
NO_LAW = "no law of the grain size: fewer than two sizes have a torque of known error; run longer, or add sizes"
SAFETY = 1.25, 3.0  # factors of Roache 1994: sizes that are asymptotic, and others


class Convergence(StrEnum):
    """Verdict on whether torques of some grain sizes follow the law that extrapolates them."""

    ASYMPTOTIC = "asymptotic"
    NOT_ASYMPTOTIC = "not asymptotic"
    UNDECIDED = "undecided within the noise"
    NOT_CHECKED = "not checked: two sizes leave nothing to check the law with; add a third"


@dataclass(frozen=True, slots=True)
class Interval:
    """A number with its 95 % interval; an end that the data do not bound is None."""

    value: float
    low: float | None
    high: float | None

    def in_words(self, unit: str = "") -> str:
        """Return the number with its unit and the ends."""
        ends = ("unbounded" if end is None else f"{end:.4g}" for end in (self.low, self.high))
        return f"{self.value:.4g}{unit and ' '}{unit} (95 %: {' to '.join(ends)})"


@dataclass(frozen=True, slots=True)
class GrainSizeLaw:
    """The law T(n) = limit (1 + coefficient/n^exponent) of torques over n grains across the gap.

    Attributes
    ----------
    sizes : how many different n.
    coarsest, finest : smallest and largest n.
    limit : T at n to infinity [N m].
    coefficient, exponent : a and the p that was asked for [-].
    verdict : of the convergence.
    order : exponent p that fits best, with its interval; None with two sizes, or where none from 0.1 to 10 does.
    convergence_index : of the finest size, relative.
    real_across : n of the powder that the grains stand for; None where it is not known.
    real_torque : T there [N m].
    free_limit, free_real_torque : the same two with p free [N m]; None where p is.
    unconverged : how many of the torques are not converged.
    reason : all of it in words.
    """

    sizes: int
    coarsest: float
    finest: float
    limit: Interval
    coefficient: Interval
    exponent: float
    verdict: Convergence
    order: Interval | None
    convergence_index: float
    real_across: float | None
    real_torque: Interval | None
    free_limit: Interval | None
    free_real_torque: Interval | None
    unconverged: int
    _fit: tuple[float, float, float, float, float] = field(repr=False)

    def torque(self, across: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return T(n) and half of its 95 % interval, each (k,) [N m], for `across` (k,), infinity included."""
        mean_x, mean, slope, variance, curvature = self._fit
        off = (1.0 / np.asarray(across, dtype=np.float64)) ** self.exponent - mean_x
        return mean + slope * off, np.sqrt(variance + curvature * off**2)

    @property
    def reason(self) -> str:
        """Law, extrapolation and verdict in words, a line each."""
        power = "n" if self.exponent == 1.0 else f"n^{self.exponent:g}"
        law = f"T(n) = {self.limit.in_words('N m')} times 1 + a/{power}, a = {self.coefficient.in_words()}"
        lines = [f"{self.sizes} grain sizes, {self.coarsest:.3g} to {self.finest:.3g} across the gap: {law}"]
        if self.real_torque is not None:
            free = "" if self.free_real_torque is None else f"; with p free {self.free_real_torque.in_words('N m')}"
            size = f"at the {self.real_across:.3g} across of the real powder"
            lines.append(f"{size}: {self.real_torque.in_words('N m')}{free}")
        order = "" if self.order is None else f"; exponent of 1/n^p: p = {self.order.in_words()}"
        index = f"convergence index of the finest size {100.0 * self.convergence_index:.2g} %"
        lines.append(f"{self.verdict}{order}; {index}")
        if self.unconverged:
            lines.append(f"torques that are not converged, with errors too small: {self.unconverged}; run longer")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        values = asdict(self)
        del values["_fit"]
        return values | {"reason": self.reason}


def grain_size_law(curve: TorqueCurve, exponent: float = EXPONENT) -> GrainSizeLaw | None:
    """Return the law of a curve over the grains across the gap; None with fewer than two sizes of known error.

    Parameters
    ----------
    curve : over n, in any order; points without torque or error are left out.
    exponent : p of the law, above 0.
    """
    from scipy.special import stdtrit

    real_across = curve.real_across
    known = np.isfinite(curve.torque) & np.isfinite(curve.error) & (curve.error > 0.0) & (curve.x > 0.0)
    n, torque, error = curve.x[known], curve.torque[known], curve.error[known]
    sizes = np.unique(n.round(6)).size
    if sizes < 2:
        return None
    first = _Lines(n, torque, error, np.array([exponent]))
    scatter, freedom = _scatter(float(first.chi2[0]), n.size - 2)
    quantile = NORMAL if scatter == 1.0 else float(stdtrit(freedom, 0.975)) * scatter
    limit, real = (first.at(0.0, quantile), None if real_across is None else first.at(1.0 / real_across, quantile))
    coefficient = float(first.slope[0]) / limit.value
    # derivatives of a = slope/T_inf by slope and by the torque at the mean of n^-p, which are independent
    x = float(first.mean_x[0])
    by_slope, by_mean = (1.0 + coefficient * x) / limit.value, -coefficient / limit.value
    half = quantile * math.hypot(by_slope * float(first.slope_error[0]), by_mean * first.mean_error)
    finest = float(n.max())
    target = limit if real is None else real
    excess = abs(first.at(1.0 / finest, quantile).value / target.value - 1.0)
    found = _Order(Convergence.NOT_CHECKED, None, None, None, excess)
    if sizes > 2:
        found = _free_order(n, torque, error, real_across, exponent)
        if scatter > 1.0:
            found = replace(found, verdict=Convergence.NOT_ASYMPTOTIC)
        if found.verdict is not Convergence.NOT_ASYMPTOTIC or found.order is None:
            found = replace(found, excess=excess)
    return GrainSizeLaw(
        sizes, float(n.min()), finest, limit, Interval(coefficient, coefficient - half, coefficient + half),
        exponent, found.verdict, found.order, SAFETY[found.verdict is not Convergence.ASYMPTOTIC] * found.excess,
        real_across, real, found.limit, found.real, int(np.count_nonzero(~curve.converged[known])),
        (x, first.mean, float(first.slope[0]), (quantile * first.mean_error) ** 2,
         (quantile * float(first.slope_error[0])) ** 2),
    )  # fmt: skip


def law_in_words(curve: TorqueCurve, law: GrainSizeLaw | None) -> str:
    """Return the law of a curve in lines for people, or why there is none."""
    reason = NO_LAW if law is None else law.reason
    return f"{curve.label}: {reason}" if curve.label else reason


class _Lines:
    """Weighted lines of torque over n^-p, one for each of several exponents (k,)."""

    def __init__(self, n: np.ndarray, torque: np.ndarray, error: np.ndarray, orders: np.ndarray) -> None:
        self.x = n ** -orders[:, None]
        self.orders, weight = orders, error**-2
        total = weight.sum()
        self.mean = float(weight @ torque) / total
        self.mean_error = 1.0 / math.sqrt(total)
        self.mean_x = self.x @ weight / total
        off = self.x - self.mean_x[:, None]
        spread = off**2 @ weight
        self.slope = off @ (weight * (torque - self.mean)) / spread
        self.slope_error = spread**-0.5
        self.chi2 = (torque - self.mean - self.slope[:, None] * off) ** 2 @ weight

    def torques(self, inverse: float) -> tuple[np.ndarray, np.ndarray]:
        """Return torques at 1/n and their standard errors, each (k,)."""
        off = inverse**self.orders - self.mean_x
        return self.mean + self.slope * off, np.hypot(self.mean_error, self.slope_error * off)

    def at(self, inverse: float, quantile: float) -> Interval:
        """Return the torque of the only line at 1/n."""
        (value,), (error,) = self.torques(inverse)
        return Interval(float(value), float(value - quantile * error), float(value + quantile * error))


def _scatter(chi2: float, freedom: int) -> tuple[float, int]:
    """Return by how much points scatter more than their errors say, 1 where noise may do it; and the freedom."""
    from scipy.special import chdtrc

    if freedom < 1 or float(chdtrc(freedom, chi2)) >= SIGNIFICANCE:
        return 1.0, freedom
    return math.sqrt(chi2 / freedom), freedom


@dataclass(frozen=True, slots=True)
class _Order:
    """Fit with the exponent free: verdict, exponent, T at n to infinity and at the real size, and the relative distance
    of T at the finest size from the latter."""

    verdict: Convergence
    order: Interval | None
    limit: Interval | None
    real: Interval | None
    excess: float


def _free_order(
    n: np.ndarray, torque: np.ndarray, error: np.ndarray, real_across: float | None, exponent: float
) -> _Order:
    """Return the fit of T_inf (1 + a/n^p); intervals by the profile of chi^2 over exponent and torque.

    An end of an interval is where chi^2, smallest for a given exponent or torque, has risen by the quantile squared.
    """
    from scipy.special import stdtrit

    lines = _Lines(n, torque, error, ORDERS)
    best, last = int(np.argmin(lines.chi2)), ORDERS.size - 1
    scatter, freedom = _scatter(float(lines.chi2[best]), n.size - 3)
    quantile = NORMAL if scatter == 1.0 else float(stdtrit(freedom, 0.975)) * scatter
    left = quantile**2 - (lines.chi2 - lines.chi2[best])
    inside = np.flatnonzero(left >= 0.0)
    low = None if inside[0] == 0 else float(ORDERS[inside[0]])
    high = None if inside[-1] == last else float(ORDERS[inside[-1]])

    def torque_at(inverse: float) -> Interval:
        value, of_one = lines.torques(inverse)
        half = np.sqrt(np.maximum(left, 0.0)) * of_one
        if inverse == 0.0 and low is None:  # the torque of a logarithm of n has no limit
            return Interval(float(value[best]), None, None)
        return Interval(float(value[best]), float((value - half)[inside].min()), float((value + half)[inside].max()))

    excluded = scatter > 1.0 or (low is not None and low > exponent) or (high is not None and high < exponent)
    least, most = (exponent * bound for bound in BOUNDS)
    bounded = low is not None and high is not None and least <= low and high <= most
    verdict = Convergence.ASYMPTOTIC if bounded else Convergence.UNDECIDED
    if best in (0, last):
        return _Order(Convergence.NOT_ASYMPTOTIC if excluded else verdict, None, None, None, 0.0)
    limit, finest = torque_at(0.0), torque_at(1.0 / float(n.max()))
    real = None if real_across is None else torque_at(1.0 / real_across)
    return _Order(
        Convergence.NOT_ASYMPTOTIC if excluded else verdict, Interval(float(ORDERS[best]), low, high), limit,
        real, abs(finest.value / (limit if real is None else real).value - 1.0),
    )  # fmt: skip
