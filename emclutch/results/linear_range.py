"""The range of currents in which the torque rises along a straight line: slope, offset, and the knee where it ends.

The torque of a powder clutch begins with a power 1.5 to 2.1 of the current, follows a straight line in the middle,
T = slope (I - offset), and saturates. Of measured dry brakes the line begins at 30 to 50 % of the rated current, its
offset is 13 to 30 % of it (docs/explanation/dry_brakes.md).

**Range.** Of all runs of neighbouring points (three at the least) on a straight line, the one in which the torque rises
most. Points are on a line when chi^2 of the residuals is what noise alone leaves, and when neither end is farther from
the line through the others than noise allows. P. R. Bevington, D. K. Robinson, "Data Reduction and Error Analysis for
the Physical Sciences", 3rd ed. 2003, chapters 6 and 11.

**Errors.** The same noise that moves the torques also chooses the range. So the whole choice is repeated with 100 sets
of torques, to which normal noise of their standard errors is added (B. Efron, R. J. Tibshirani, "An Introduction to the
Bootstrap", 1993, chapter 6). The standard error of slope, offset and knee is that of the normal distribution whose
central 90 % are as wide as those of their changes, which single far changes do not move. It is not less than the
error of least squares.

**Knee.** Where the next torque is significantly below the line. It and up to two more make the curve a broken line,
T = slope (I - offset) - bend max(0, I - knee), fitted as a whole. Without a second line the knee is only known to lie
between two points: their middle, with the standard error of a uniform distribution, their distance over sqrt(12).

Valid for independent points with known errors. Of simulated curves of 11 points with a toe at the bottom and a knee,
intervals of 1.96 standard errors hold the true slope in 98, 96, 97 and 96 % of 600 draws with errors of 0.8, 1.6, 2.4
and 4 % of the largest torque, the offset in 97 to 99 %, and the knee, where one is found, in 96 to 99 %. Noise of 4 %
hides toe and knee: the slope is 7 % too small in the mean then, within its interval of 30 %.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import asdict, dataclass, replace
from itertools import combinations, islice
from typing import Any

import numpy as np

from emclutch.results.fits import NORMAL, line

MIN_POINTS = 4  # of a curve: three always leave a line of one degree of freedom and nothing that could end it
SIGNIFICANCE = 0.05  # of both tests: a true line is cut short by a point in one case of ten
CENTRAL = 1.645  # standard errors from the middle of a normal distribution within which 90 % of it lie
KNEE = 3.0  # standard errors by which the next torque must be below the line: 1 in 700 by chance
ABOVE = 3  # points at most above the knee; a curve is no line for long
REDRAWS = 100  # sets of torques with added noise
REDRAWN_KNEES = 20  # of these sets, those with a knee: each is a fit of its own


@dataclass(frozen=True, slots=True)
class LinearRange:
    """A straight line through a part of a torque curve; every undefined number is None.

    Attributes
    ----------
    reason : what was found, or why nothing was, with the remedy.
    slope, slope_error : [N m/A], with its standard error.
    offset, offset_error : current at which the line meets zero torque [A].
    knee, knee_error : current beyond which the torque stays below the line [A]; None where it does not.
    first, last : smallest and largest current of the points in the range [A].
    points : how many these are.
    is_tested : whether the points' errors say where the line holds, and can be trusted: all torques are converged.
    unconverged : how many of the points in the range have a torque that is not converged.
    """

    reason: str
    slope: float | None = None
    slope_error: float | None = None
    offset: float | None = None
    offset_error: float | None = None
    knee: float | None = None
    knee_error: float | None = None
    first: float | None = None
    last: float | None = None
    points: int = 0
    is_tested: bool = False
    unconverged: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def linear_range(current: Any, torque: Any, error: Any, converged: Any = None) -> LinearRange:
    """Return the linear range of a torque curve.

    Parameters
    ----------
    current : (n,) [A], in any order; their magnitudes count.
    torque : (n,) [N m]; nan where a point has none.
    error : (n,) standard errors of the torques [N m]; nan where unknown. Where fewer than four points have one, the
        line goes through all points with equal weights, and nothing says where it holds.
    converged : (n,) whether the torques are; default: all. Errors of those that are not are too small as a rule.
    """
    steady = np.ones(np.size(torque)) if converged is None else converged
    points = np.array([np.abs(current), torque, error, steady], dtype=np.float64)
    points = points[:, np.argsort(points[0], kind="stable")]
    points = points[:, np.isfinite(points[0]) & np.isfinite(points[1])]
    x, y, sigma, steady = points[:, np.isfinite(points[2]) & (points[2] > 0.0)]
    if (count := np.unique(points[0]).size) < MIN_POINTS:
        return LinearRange(f"no linear range: torques at {count} currents, {MIN_POINTS} needed; add currents")
    if np.unique(x).size < MIN_POINTS:
        return _unweighted(points[0], points[1], known=x.size)
    noise = sigma * np.random.default_rng(0).standard_normal((REDRAWS // 2, x.size))
    sets = np.vstack([y, y + noise, y - noise])  # both signs: a curve and its mirror image have the same errors
    best, *parts = _straightest(x, sets, sigma)
    if best is None:
        return LinearRange(
            "no linear range: no three neighbouring torques lie on a rising line within their errors; add currents "
            "between them"
        )
    found = _with_knee(x, y, sigma, best)
    redrawn = [(one, part) for one, part in zip(sets[1:], parts, strict=True) if part is not None]
    lines = [line(x[part], one[part], sigma[part]) for one, part in redrawn]
    knees = (_with_knee(x, one, sigma, part).knee for one, part in redrawn if found.knee is not None)
    some = islice((knee for knee in knees if knee is not None), REDRAWN_KNEES)
    found = _with_errors(
        found, slope=[one.slope.value for one in lines], offset=[one.zero().value for one in lines], knee=list(some)
    )
    unsure = int(np.count_nonzero(steady[best] == 0.0))
    if not unsure:
        return found
    reason = (
        f"{found.reason}; not tested: {unsure} of these {found.points} torques are not converged; run longer, or more "
        "replicas"
    )
    return replace(found, reason=reason, is_tested=False, unconverged=unsure)


def _with_errors(found: LinearRange, **redrawn: list[float]) -> LinearRange:
    """Return a line with the errors of its numbers from those of sets with added noise, and not less than before."""
    errors = {}
    for name, values in redrawn.items():
        if values:
            changes = np.abs(np.array(values) - getattr(found, name))
            error = float(np.quantile(changes, 0.9)) / CENTRAL
            errors[f"{name}_error"] = max(error, getattr(found, f"{name}_error"))
    return replace(found, **errors)


def _unweighted(x: np.ndarray, y: np.ndarray, known: int) -> LinearRange:
    fit = line(x, y)
    slope, offset = fit.slope, fit.zero()
    return LinearRange(
        f"a line through all points, unweighted: {known} of them have an error, {MIN_POINTS} needed to find where it "
        "holds; run longer",
        slope.value, slope.error, offset.value, offset.error, first=float(x[0]), last=float(x[-1]), points=x.size,
    )  # fmt: skip


def _with_knee(x: np.ndarray, y: np.ndarray, sigma: np.ndarray, part: slice) -> LinearRange:
    """Return the line through a part of the points, and the knee at its end."""
    n, end = part.stop - part.start, part.stop
    fit = line(x[part], y[part], sigma[part])
    slope, offset = fit.slope, fit.zero()
    found = LinearRange(
        f"a line through {n} points from {x[part.start]:.3g} to {x[end - 1]:.3g} A",
        slope.value, slope.error, offset.value, offset.error,
        first=float(x[part.start]), last=float(x[end - 1]), points=n, is_tested=True,
    )  # fmt: skip
    if end == x.size:
        return replace(found, reason=f"{found.reason}, the largest current: no knee was reached")
    there = fit.at(x[end])
    if math.copysign(1.0, slope.value) * (there.value - y[end]) < KNEE * math.hypot(there.error, sigma[end]):
        reason = f"the next torque is not below it by {KNEE:g} standard errors: no knee; add currents there"
        return replace(found, reason=f"{found.reason}; {reason}")
    middle, half = 0.5 * float(x[end - 1] + x[end]), float(x[end] - x[end - 1]) / math.sqrt(12.0)
    for last in range(min(x.size, end + ABOVE), end + 1, -1):
        both = slice(part.start, last)
        corner = _corner(x[both], y[both], sigma[both], (slope.value, offset.value, middle, slope.value))
        if corner is not None:
            reason = f"{found.reason}; the knee is its corner with a line through the next {last - end} points"
            return replace(found, reason=reason, knee=corner[0], knee_error=corner[1])
    reason = f"{found.reason}; the knee lies between the last of them and the next one"
    return replace(found, reason=reason, knee=middle, knee_error=half)


def _straightest(x: np.ndarray, sets: np.ndarray, sigma: np.ndarray) -> list[slice | None]:
    """Return of each set of torques (m, n) the points on a line along which the torque rises most; None without one."""
    from scipy.special import chdtrc

    best: list[slice | None] = [None] * len(sets)
    most = np.zeros(len(sets))
    fits = {
        (i, j): line(x[i:j], sets[:, i:j], sigma[i:j]) for i, j in combinations(range(x.size + 1), 2) if x[j - 1] > x[i]
    }
    for (i, j), fit in fits.items():
        if np.unique(x[i:j]).size < 3:
            continue
        straight = chdtrc(j - i - 2.0, fit.squares) >= SIGNIFICANCE
        for end, others in ((i, fits[i + 1, j]), (j - 1, fits[i, j - 1])):
            there = others.at(x[end])
            straight &= np.abs(sets[:, end] - there.value) < NORMAL * math.hypot(there.error, sigma[end])
        rise = np.where(straight, np.abs(fit.slope.value) * (x[j - 1] - x[i]), 0.0)
        for n in np.flatnonzero(rise > most):
            best[n], most[n] = slice(i, j), rise[n]
    return best


def _corner(
    x: np.ndarray, y: np.ndarray, sigma: np.ndarray, start: tuple[float, float, float, float]
) -> tuple[float, float] | None:
    """Return the knee of the nearest broken line with its standard error; None where it does not fit."""
    from scipy.optimize import OptimizeWarning, curve_fit
    from scipy.special import chdtrc

    def torque(current, slope, offset, knee, bend):
        return slope * (current - offset) - bend * np.maximum(0.0, current - knee)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", OptimizeWarning)  # a covariance that could not be found
            found, covariance = curve_fit(torque, x, y, start, sigma=sigma, absolute_sigma=True)
    except (RuntimeError, OptimizeWarning):
        return None
    slope, _, knee, bend = (float(value) for value in found)
    inside = np.count_nonzero(x < knee) >= 2 and np.count_nonzero(x > knee) >= 2
    squares, freedom = np.sum(((y - torque(x, *found)) / sigma) ** 2), x.size - 4.0
    is_noise = freedom <= 0.0 or chdtrc(freedom, squares) >= SIGNIFICANCE
    if not inside or bend * slope <= 0.0 or not is_noise:
        return None
    return knee, math.sqrt(float(covariance[2, 2]))
