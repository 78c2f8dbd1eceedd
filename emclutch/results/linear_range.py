"""The range of currents in which the torque rises along a straight line: slope, offset, and the knee where it ends.

The torque of a powder clutch begins with a power 1.2 to 2 of the current, is roughly linear in the middle and
saturates. In the middle T = slope (I - offset).

**Range.** Of all runs of neighbouring points (three at the least) on a straight line, the one in which the torque rises
most. Points are on a line when the weighted squares of what is left, chi^2, are what noise alone leaves, and when
neither end lies farther from the line through the others than noise allows: the end is where a curve leaves its line,
and a line that goes through it hides that. P. R. Bevington, D. K. Robinson, "Data Reduction and Error Analysis for the
Physical Sciences", 3rd ed. 2003, chapters 6 and 11.

**Errors.** Those of weighted least squares, and with them, as independent ones, how far slope and offset move at most
when the range loses its first or its last point: which points belong to it is not known any better.

**Knee.** Where the next torque lies significantly below the line. It and up to two more make the curve a broken line,
T = slope (I - offset) - bend max(0, I - knee), whose four numbers are fitted together; the knee's standard error is
that of the covariance. Of a curve without a corner it says where lines through both parts meet. Without a second line
the knee is only known to lie between two points: their middle, with the standard error of a number that is equally
likely everywhere there, their distance over sqrt(12).

Valid for independent points with known errors, several of them along the line. What noise hides it cannot find: of
simulated curves of 11 points with a toe at the bottom and a knee, intervals of 1.96 standard errors hold the true slope
in 95 % of 1500 draws with errors of 0.8 % of the largest torque, and in 76 % with 2.4 %.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

MIN_POINTS = 4  # of a curve: three always leave a line of one degree of freedom and nothing that could end it
SIGNIFICANCE = 0.05  # of both tests: a true line is cut short by a point in one case of ten
END = 1.96  # standard errors of the same significance
KNEE = 3.0  # standard errors by which the next torque must lie below the line: 1 in 700 by chance
ABOVE = 3  # points at most above the knee; a curve is no line for long


@dataclass(frozen=True, slots=True)
class LinearRange:
    """A straight line through a part of a torque curve; every undefined number is None.

    Attributes
    ----------
    slope, slope_error : [N m/A], with its standard error.
    offset, offset_error : current at which the line meets zero torque [A].
    knee, knee_error : current beyond which the torque stays below the line [A]; None where it does not.
    first, last : smallest and largest current of the points in the range [A].
    points : how many these are.
    is_tested : whether the points' errors told where the line holds, and can be trusted: all torques are converged.
    reason : what was found, or why nothing was, with the remedy.
    unconverged : how many of the points in the range have a torque that is not converged.
    """

    slope: float | None
    slope_error: float | None
    offset: float | None
    offset_error: float | None
    knee: float | None
    knee_error: float | None
    first: float | None
    last: float | None
    points: int
    is_tested: bool
    reason: str
    unconverged: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


def linear_range(current: Any, torque: Any, error: Any, converged: Any = None) -> LinearRange:
    """The linear range of a torque curve.

    Parameters
    ----------
    current : (n,) [A], in any order; their magnitudes count.
    torque : (n,) [N m]; nan where a point has none.
    error : (n,) standard errors of the torques [N m]; nan where unknown. Where fewer than four points have one, the
        line goes through all points with equal weights, and nothing tells where it holds.
    converged : (n,) whether the torques are; default: all. Errors of those that are not are too small as a rule.
    """
    x, y, sigma = (np.asarray(values, dtype=np.float64) for values in (np.abs(current), torque, error))
    order = np.argsort(x, kind="stable")
    x, y, sigma = x[order], y[order], sigma[order]
    there = np.isfinite(x) & np.isfinite(y)
    if np.unique(x[there]).size < MIN_POINTS:
        return _nothing(
            f"no linear range: torques at {np.unique(x[there]).size} currents, {MIN_POINTS} needed; add currents"
        )
    known = there & np.isfinite(sigma) & (sigma > 0.0)
    if np.unique(x[known]).size < MIN_POINTS:
        return _unweighted(x[there], y[there], int(np.count_nonzero(known)))
    steady = np.ones(x.size, dtype=bool) if converged is None else np.asarray(converged, dtype=bool)[order]
    x, y, sigma, steady = x[known], y[known], sigma[known], steady[known]
    found = _straightest(x, y, sigma)
    if found is None:
        return _nothing(
            "no linear range: no three neighbouring torques lie on a rising line within their errors; "
            "add currents between them"
        )
    line = _with_knee(x, y, sigma, *found)
    unsure = int(np.count_nonzero(~steady[found[0] : found[1] + 1]))
    if not unsure:
        return line
    reason = f"{line.reason}; not tested: {unsure} of these {line.points} torques are not converged; run longer"
    return replace(line, is_tested=False, reason=reason, unconverged=unsure)


def _nothing(reason: str) -> LinearRange:
    return LinearRange(None, None, None, None, None, None, None, None, 0, False, reason)


def _unweighted(x: np.ndarray, y: np.ndarray, known: int) -> LinearRange:
    slope, offset, errors = _line(x, y, np.ones_like(x))
    scatter = math.sqrt(float(np.sum((y - slope * (x - offset)) ** 2)) / (x.size - 2))
    return LinearRange(
        slope, scatter * errors[0], offset, scatter * errors[1], None, None, float(x[0]), float(x[-1]), x.size, False,
        f"a line through all points, unweighted: {known} of them have an error, {MIN_POINTS} needed to tell where it "
        "holds; run longer",
    )  # fmt: skip


def _straightest(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> tuple[int, int] | None:
    """First and last point of the run on a line in which the torque rises most; None where there is none."""
    best, most = None, 0.0
    for first in range(x.size - 2):
        for last in range(first + 2, x.size):
            part = slice(first, last + 1)
            if np.unique(x[part]).size < 3 or not _is_line(x[part], y[part], sigma[part]):
                continue
            rise = abs(_line(x[part], y[part], sigma[part])[0]) * float(x[last] - x[first])
            if rise > most:
                best, most = (first, last), rise
    return best


def _is_line(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> bool:
    slope, offset, _ = _line(x, y, sigma)
    ends = (slice(1, None), 0), (slice(None, -1), -1)
    return _allowed(y - slope * (x - offset), sigma, 2) and all(
        abs(_off_the_line(x[others], y[others], sigma[others], x[end], y[end], sigma[end])) < END
        for others, end in ends
    )


def _off_the_line(x: np.ndarray, y: np.ndarray, sigma: np.ndarray, at: float, torque: float, error: float) -> float:
    """Return how far above the nearest line of some points another one lies, in standard errors of that distance."""
    middle, level, slope, of_level, of_slope = _nearest(x, y, sigma)
    return (torque - level - slope * (at - middle)) / math.hypot(error, of_level, of_slope * (at - middle))


def _with_knee(x: np.ndarray, y: np.ndarray, sigma: np.ndarray, first: int, last: int) -> LinearRange:
    part = slice(first, last + 1)
    slope, offset, errors = _line(x[part], y[part], sigma[part])
    errors = [math.hypot(*pair) for pair in zip(errors, _shifts(x[part], y[part], sigma[part]), strict=True)]
    held = f"a line through {last - first + 1} points from {x[first]:.3g} to {x[last]:.3g} A"
    knee = knee_error = None
    below = 0.0
    if last < x.size - 1:
        below = -_off_the_line(x[part], y[part], sigma[part], x[last + 1], y[last + 1], sigma[last + 1])
        below = math.copysign(1.0, slope) * below
    if last == x.size - 1:
        reason = f"{held}, the largest current: no knee was reached"
    elif below < KNEE:
        reason = f"{held}; the next torque is not below it by {KNEE:g} standard errors: no knee; add currents there"
    else:
        reason = f"{held}; the knee lies between the last of them and the next one"
        knee, knee_error = 0.5 * float(x[last] + x[last + 1]), float(x[last + 1] - x[last]) / math.sqrt(12.0)
        for end in range(min(x.size - 1, last + ABOVE), last + 1, -1):
            both = slice(first, end + 1)
            corner = _corner(x[both], y[both], sigma[both], (slope, offset, knee, slope))
            if corner is not None:
                knee, knee_error = corner
                reason = f"{held}; the knee is its corner with a line through the next {end - last} points"
                break
    return LinearRange(
        slope,
        errors[0],
        offset,
        errors[1],
        knee,
        knee_error,
        float(x[first]),
        float(x[last]),
        last - first + 1,
        True,
        reason,
    )


def _shifts(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Return how far slope and offset move at most when the range loses its first or its last point."""
    slope, offset, _ = _line(x, y, sigma)
    others = [_line(x[part], y[part], sigma[part])[:2] for part in (slice(1, None), slice(None, -1))]
    return max(abs(one - slope) for one, _ in others), max(abs(one - offset) for _, one in others)


def _nearest(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> tuple[float, float, float, float, float]:
    """The nearest line as middle current, torque there, slope; standard errors of the last two, which are independent.

    Of points with the standard errors sigma.
    """
    weight = sigma**-2.0
    middle, level = float(np.average(x, weights=weight)), float(np.average(y, weights=weight))
    spread = float(np.sum(weight * (x - middle) ** 2))
    slope = float(np.sum(weight * (x - middle) * y)) / spread
    return middle, level, slope, float(np.sum(weight)) ** -0.5, spread**-0.5


def _line(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> tuple[float, float, list[float]]:
    """Slope and offset of the nearest line, and their standard errors for points of the standard errors sigma."""
    middle, level, slope, of_level, of_slope = _nearest(x, y, sigma)
    if slope == 0.0:
        return 0.0, 0.0, [of_slope, math.inf]
    return slope, middle - level / slope, [of_slope, math.hypot(of_level / slope, level / slope**2 * of_slope)]


def _corner(
    x: np.ndarray, y: np.ndarray, sigma: np.ndarray, start: tuple[float, float, float, float]
) -> tuple[float, float] | None:
    """The knee of the nearest broken line with its standard error; None where it does not fit."""
    import warnings

    from scipy.optimize import OptimizeWarning, curve_fit

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
    if not inside or bend * slope <= 0.0 or not _allowed(y - torque(x, *found), sigma, 4):
        return None
    return knee, math.sqrt(float(covariance[2, 2]))


def _allowed(rest: np.ndarray, sigma: np.ndarray, numbers: int) -> bool:
    """Return whether chi^2 of what is left beside a fit of so many numbers is one that noise alone would leave."""
    from scipy.special import chdtrc

    square = float(np.sum((rest / sigma) ** 2))
    return rest.size <= numbers or float(chdtrc(rest.size - numbers, square)) >= SIGNIFICANCE
