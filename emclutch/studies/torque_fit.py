"""Fit of contact parameters to a measured torque curve: response surface, least squares, profile intervals, valley.

The torque T(p, x) of simulated points, p the parameters and x the drive (a current), is interpolated: at each simulated
drive a polynomial of ln T, of second order where a parameter has three values or more and of first order where it has
two, with all products of two parameters; between the drives a natural cubic spline of ln T in ln x. Measured torques
T_i at x_i give the residuals r_i(p) = ln T_i - ln T(p, x_i) and the sum of squares

    S(p) = r^T C(p)^-1 r,    C(p) = diag(s^2) + c^2 1 1^T + W V(p) W^T,    V_jj = scatter^2 t(p)^T (A_j^T A_j)^-1 t(p),

which `scipy.optimize.least_squares` minimises within the range of the simulated points: nothing is extrapolated. s is
the relative standard error of each measured torque, c the one that all of them share. V is the covariance of the
surface at the simulated drives (t the terms of its polynomial, A_j those of the points at drive j), W the matrix of the
spline. Many measured points so do not reduce the error of the few simulated ones. S is the least sum of squares over
the coefficients of the surface too, of the measured and of the simulated torques together. Where no errors of the
measurement are known, one s for all points solves S_min = n - k (R. C. Paule, J. Mandel, J. Res. Natl. Bur. Stand. 87
(1982) 377).

**Intervals** are profiles: for each value of a parameter the others are fitted again, and what lies within

    S <= S_min + b 3.84   or, with unknown errors,   S <= S_min + b F(1, n - k; 95 %)

is the 95 % interval (D. M. Bates, D. G. Watts, Nonlinear Regression Analysis, 1988, chapter 6). The factor b is a
correction of M. S. Bartlett's kind (Proc. R. Soc. A 160 (1937) 268) for the error of the surface's slope, see
`_linearised`. An interval that reaches the end of the range says that the data do not bound the parameter there. The
fitted others along the profile are the valley: parameters that the data cannot tell apart, as friction and rolling
friction, which both make a powder stronger.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2, f

from emclutch.results.errors import OutputError
from emclutch.results.measured_table import TORQUE_CURVE, read_measured

Residual = Callable[[np.ndarray], np.ndarray | float]
PROFILE = 33
"""Values of a parameter that its profile is computed at."""
LEVEL = 0.95
POOR = 0.01
"""Probability of a sum of squares this large, below which no parameters fit."""
WIDEST = 20.0
"""Largest half width of ln T that is reported: linear propagation has no bound where no parameters fit."""
STEP = 1e-3
"""Of a parameter's range, for differences."""
SMALLEST_SCATTER = 1e-3
"""Of ln T at each measured point: a surface through all of its points is not exact between them."""


@dataclass(frozen=True, slots=True)
class SimulatedTorques:
    """Torques of simulated points.

    Attributes
    ----------
    names : tuple of str
        The k parameters.
    parameters : ndarray, shape (n, k)
    drive, torque, error : ndarray, shape (n,)
        Drive [SI], torque [N m] above 0, its standard error [N m].
    """

    names: tuple[str, ...]
    parameters: np.ndarray
    drive: np.ndarray
    torque: np.ndarray
    error: np.ndarray


@dataclass(frozen=True, slots=True)
class MeasuredTorques:
    """A measured curve.

    Attributes
    ----------
    drive, torque : ndarray, shape (n,)
        Drive [SI], torque [N m], above 0.
    error : ndarray, shape (n,), or None
        Standard errors of each point alone [N m]; None: unknown.
    common_error : float
        Relative standard error that all torques share, as that of a calibration: 0.03 for 3 %.
    """

    drive: np.ndarray
    torque: np.ndarray
    error: np.ndarray | None = None
    common_error: float = 0.0


def read_torques(path: str | Path, unit: str) -> tuple[MeasuredTorques, int]:
    """Read a curve, and how many of its points are left out: those with a drive or a torque of 0.

    Parameters
    ----------
    path : of a table as of `read_measured`, with the drive in the first column, one column of torques, and their
        standard errors in one that is named "error [N m]", or no errors. All names have their units.
    unit : of the drive that is returned.

    Raises
    ------
    OutputError
        As `read_measured`; several curves; errors that are not above 0; no point with a drive and a torque above 0.
    """
    curves = read_measured(path, f"drive [{unit}]" if unit else "drive", TORQUE_CURVE[1])
    if len(curves) > 1:
        raise OutputError(
            f"{path} has {len(curves)} columns of torques, {', '.join(curves)}; leave one, and name the "
            "column of standard errors 'error [N m]'"
        )
    (points,) = curves.values()
    used = points[(points[:, :2] > 0.0).all(axis=1)]  # both are fitted by their logarithms
    if not len(used):
        raise OutputError(f"{path} has no point with a drive and a torque above 0")
    if not (used[:, 2:] > 0.0).all():
        raise OutputError(f"{path} has points without an error above 0; give all points one, or leave the column out")
    return MeasuredTorques(*used.T), len(points) - len(used)


class ResponseSurface:
    """ln T of simulated points, between them (see the module).

    Attributes
    ----------
    low, high : ndarray, shape (k,)
        Range of each parameter.
    drives : ndarray, shape (m,)
        Ascending.
    scatter : float
        Standard deviation of ln T of the points from the surface, and of their own errors.

    Raises
    ------
    ValueError
        A parameter with one value only, too few points at a drive, a torque that is not above 0.
    """

    def __init__(self, simulated: SimulatedTorques) -> None:
        p, log_torque = simulated.parameters, np.log(np.where(simulated.torque > 0.0, simulated.torque, np.nan))
        if not np.isfinite(log_torque).all():
            raise ValueError("a simulated point has no torque above 0; leave its drive or its parameters out")
        self.low, self.high = p.min(axis=0), p.max(axis=0)
        for name, low, high in zip(simulated.names, self.low, self.high, strict=True):
            if low == high:
                raise ValueError(f"{name} has one value only, {low:g}; give two or more, or do not fit it")
        self.drives = np.unique(simulated.drive)
        self._curved = np.array([len(np.unique(column)) > 2 for column in p.T])
        terms = np.array([self.terms(one) for one in p])
        coefficients, covariances, rest, free = [], [], 0.0, 0
        for drive in self.drives:
            here = simulated.drive == drive
            if here.sum() < terms.shape[1]:
                raise ValueError(
                    f"{here.sum()} points at a drive of {drive:g} are too few for {terms.shape[1]} terms of the surface"
                )
            inverse = np.linalg.pinv(terms[here])
            coefficients.append(inverse @ log_torque[here])
            covariances.append(inverse @ inverse.T)
            rest += float(np.sum((log_torque[here] - terms[here] @ coefficients[-1]) ** 2))
            free += int(here.sum()) - terms.shape[1]
        own = float(np.mean((simulated.error / simulated.torque) ** 2))
        self.scatter = float(np.sqrt(max(rest / free if free else 0.0, own)))
        self._coefficients, self._covariances = np.array(coefficients), self.scatter**2 * np.array(covariances)

    def terms(self, p: np.ndarray) -> np.ndarray:
        """Return the terms of the polynomial: 1, u_a, u_a^2 of parameters with three values, u_a u_b."""
        u = (p - self.low) / (self.high - self.low)
        return np.array([1.0, *u, *u[self._curved] ** 2, *(a * b for a, b in combinations(u, 2))])

    def log_torques(self, p: np.ndarray) -> np.ndarray:
        """Return ln T (m,) at the simulated drives."""
        return self._coefficients @ self.terms(p)

    def variances(self, terms: np.ndarray) -> np.ndarray:
        """Return the variances (m,) of the coefficients times these terms, at the simulated drives."""
        return np.einsum("a,jab,b->j", terms, self._covariances, terms)

    def weights(self, drive: np.ndarray) -> np.ndarray:
        """Return the matrix (n, m) from values at the simulated drives to those at other drives (n,)."""
        if len(self.drives) == 1:
            return np.ones((len(drive), 1))
        return CubicSpline(np.log(self.drives), np.eye(len(self.drives)), bc_type="natural")(np.log(drive))


class _WhitenedCurve:
    """Residuals of a measured curve as independent ones of unit variance, S(p) = |residuals(p)|^2 + rest.

    Rotated by the orthogonal matrix of diag(s)^-1 W = QR, only as many residuals as the surface has drives depend on
    the parameters, and their covariance is 1 + R (V + c^2 1 1^T) R^T. (W 1 = 1: a spline through constants is one.)

    Attributes
    ----------
    surface, weights : of the simulated points; its matrix to the measured drives.
    rest : float
        Sum of squares that does not depend on the parameters.
    """

    def __init__(self, surface: ResponseSurface, measured: MeasuredTorques, own: np.ndarray) -> None:
        self.surface, self.weights = surface, surface.weights(measured.drive)
        own = np.hypot(own, SMALLEST_SCATTER)
        rotation, self._factor = np.linalg.qr(self.weights / own[:, None])
        wanted = np.log(measured.torque) / own
        self._wanted, self._common = rotation.T @ wanted, measured.common_error**2
        self.rest = float(np.sum((wanted - rotation @ self._wanted) ** 2))

    def _whitened(self, p: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return L^-1 of values, where the covariance of the rotated residuals is L L^T."""
        variance = np.diag(self.surface.variances(self.surface.terms(p))) + self._common
        covariance = np.eye(len(self._factor)) + self._factor @ variance @ self._factor.T
        return np.linalg.solve(np.linalg.cholesky(covariance), values)

    def residuals(self, p: np.ndarray) -> np.ndarray:
        return self._whitened(p, self._wanted - self._factor @ self.surface.log_torques(p))

    def gain(self, p: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residuals by ln T at the simulated drives, but for their sign."""
        return self._whitened(p, self._factor)


@dataclass(frozen=True, slots=True)
class FittedParameter:
    """One parameter of a fit.

    Attributes
    ----------
    name : str
    value, low, high : float
        Best value; ends of the 95 % interval, within the range that was simulated.
    bounded : tuple of 2 bool
        Whether the data, and not the range, set each end.
    """

    name: str
    value: float
    low: float
    high: float
    bounded: tuple[bool, bool]


@dataclass(frozen=True, slots=True)
class TorqueFit:
    """A fit.

    Attributes
    ----------
    parameters : tuple of FittedParameter
    valley : ndarray, shape (m, k)
        Best parameters for each value of the first one that the data allow (95 %).
    torque, low, high : ndarray, shape (n,)
        At the measured drives [N m]: of the best parameters, and the 95 % band of the true torque by linear
        propagation of all errors.
    sum_of_squares : float
        S_min; where the errors of the measurement are unknown, at most n - k, as they are chosen so.
    degrees_of_freedom : int
        n - k.
    probability : float or None
        Of an S this large, if the model is right; None where the errors of the measurement are unknown.
    scatter : float
        Standard deviation of ln(T measured/T fitted).
    """

    parameters: tuple[FittedParameter, ...]
    valley: np.ndarray
    torque: np.ndarray
    low: np.ndarray
    high: np.ndarray
    sum_of_squares: float
    degrees_of_freedom: int
    probability: float | None
    scatter: float

    @property
    def is_poor(self) -> bool:
        """True if no parameters within the range fit the measured curve within its errors."""
        return self.probability is not None and self.probability < POOR


def fit_torque(
    simulated: SimulatedTorques, measured: MeasuredTorques, bulk_friction: Residual | None = None
) -> TorqueFit:
    """Fit the parameters of simulated points to a measured curve.

    Parameters
    ----------
    simulated, measured
    bulk_friction : callable, optional
        Takes parameters (k,) and returns one more residual in standard errors, of something else that was measured.

    Raises
    ------
    ValueError
        As of `ResponseSurface`; fewer measured torques than parameters and one; a drive outside of those simulated; a
        common error that is not within 0 to 1.
    """
    surface, k = ResponseSurface(simulated), len(simulated.names)
    if not 0.0 <= measured.common_error < 1.0:
        raise ValueError(f"a common error of {measured.common_error:g} is out of range; allowed: 0 to 1, 0.03 for 3 %")
    first, last = surface.drives[0] * (1.0 - 1e-9), surface.drives[-1] * (1.0 + 1e-9)
    if not ((measured.drive >= first) & (measured.drive <= last)).all():
        raise ValueError(
            f"drives from {measured.drive.min():g} to {measured.drive.max():g} were measured, those from "
            f"{surface.drives[0]:g} to {surface.drives[-1]:g} simulated; nothing is extrapolated"
        )
    n = len(measured.drive) + (bulk_friction is not None)
    if n <= k:
        raise ValueError(f"{n} measured values cannot fix {k} parameters; measure more, or fit fewer")
    free = n - k

    def smallest_with(own: np.ndarray) -> tuple[_WhitenedCurve, Residual, np.ndarray, float]:
        curve = _WhitenedCurve(surface, measured, own)

        def residuals(p: np.ndarray) -> np.ndarray:
            rest = curve.residuals(p)
            return rest if bulk_friction is None else np.append(rest, bulk_friction(p))

        best, smallest = _smallest(residuals, surface.low, surface.high, {})
        return curve, residuals, best, smallest + curve.rest

    if measured.error is None:
        same = np.ones(len(measured.drive))
        own = same * _unknown_error(lambda s: smallest_with(s * same)[3], free)
        threshold = float(f.ppf(LEVEL, 1, free))
    else:
        own, threshold = measured.error / measured.torque, float(chi2.ppf(LEVEL, 1))
    curve, residuals, best, smallest = smallest_with(own)
    errors, factors = _linearised(curve, residuals, best)
    found, valley = [], np.empty((0, k))
    for a, name in enumerate(simulated.names):
        at = np.unique(np.append(np.linspace(surface.low[a], surface.high[a], PROFILE), best[a]))
        profile = [_smallest(residuals, surface.low, surface.high, {a: value}, best) for value in at]
        sums = np.array([one[1] for one in profile]) + curve.rest
        allowed = smallest + factors[a] * threshold
        inside = np.flatnonzero(sums <= allowed)
        if a == 0:
            valley = np.array([profile[i][0] for i in inside])
        low, high = _crossing(at, sums, allowed, inside[0], -1), _crossing(at, sums, allowed, inside[-1], 1)
        bounded = bool(inside[0] > 0), bool(inside[-1] < len(at) - 1)
        found.append(FittedParameter(name, float(best[a]), low, high, bounded))
    fitted = curve.weights @ surface.log_torques(best)
    half = np.minimum(np.sqrt(threshold) * errors, WIDEST)
    return TorqueFit(
        parameters=tuple(found),
        valley=valley,
        torque=np.exp(fitted),
        low=np.exp(fitted - half),
        high=np.exp(fitted + half),
        sum_of_squares=smallest,
        degrees_of_freedom=free,
        probability=None if measured.error is None else float(chi2.sf(smallest, free)),
        scatter=float(np.sqrt(np.sum((np.log(measured.torque) - fitted) ** 2) / free)),
    )


def _unknown_error(smallest: Callable[[float], float], free: int) -> float:
    """Return the relative error of each measured torque with which S_min is its expectation, n - k; 0 if it is less."""
    if smallest(0.0) <= free:
        return 0.0
    high = 0.1
    while smallest(high) > free:
        high *= 4.0
    return float(brentq(lambda s: np.sqrt(free / smallest(s)) - 1.0, 0.0, high, rtol=1e-2))


def _linearised(curve: _WhitenedCurve, residuals: Residual, best: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return standard errors of ln T (n,) of the best parameters, and factors b (k,) of the interval's threshold.

    Both are linear in the parameters; what the data do not fix does not count. With R the derivatives of the residuals
    and P = (R^T R)^-1, dp = -P R^T (residuals) is the error of the parameters, and W (J dp + e) that of the curve, with
    e the errors of the surface, which the residuals contain.

    The derivative g of the residuals by a parameter (the others fitted) has an error of covariance G, from the slope of
    the surface. With M the projection on what is free of the parameters, the derivative of S at the truth has the
    variance 4 [|g|^2 + tr(M G)], while the curvature of S is 2 |g|^2 in the mean, as residuals and their curvature are
    correlated. So S(truth) - S_min has the mean b = 1 + tr(M G)/|g|^2 in place of 1, and P is too small by b^2, since
    the g that is found contains its error.
    """
    surface = curve.surface

    def jacobian(of: Residual) -> np.ndarray:
        steps = STEP * np.diag(surface.high - surface.low)
        return np.array([np.asarray(of(best + one)) - np.asarray(of(best - one)) for one in steps]).T / (2.0 * STEP)

    J, R, slopes = jacobian(surface.log_torques), jacobian(residuals), jacobian(surface.terms)
    P, gain = np.linalg.pinv(R.T @ R, rcond=1e-8, hermitian=True), curve.gain(best)
    inverse, n, V = P @ R.T, len(gain), np.diag(surface.variances(surface.terms(best)))
    M, factors = (np.eye(len(R)) - R @ inverse)[:n, :n], np.ones(len(best))
    for a in np.flatnonzero(np.diag(P) > 0.0):
        spread = gain * surface.variances(slopes @ P[a]) @ gain.T
        factors[a] += float(np.trace(M @ spread)) / P[a, a]
    cross, J = J @ inverse[:, :n] @ gain @ V, J * factors
    covariance = J @ P @ J.T + V + cross + cross.T
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", curve.weights, covariance, curve.weights), 0.0))
    return errors, factors


def _smallest(
    residuals: Residual, low: np.ndarray, high: np.ndarray, fixed: dict[int, float], start: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """Return the parameters of the smallest sum of squares, with some of them fixed, and that sum."""
    free = [a for a in range(len(low)) if a not in fixed]

    def whole(part: np.ndarray) -> np.ndarray:
        p = np.empty(len(low))
        p[free] = part
        for a, value in fixed.items():
            p[a] = value
        return p

    if not free:
        p = whole(np.empty(0))
        return p, float(np.sum(residuals(p) ** 2))
    span = (high - low)[free]
    starts = [low[free] + np.array(u) * span for u in product((0.2, 0.8), repeat=len(free))]
    starts += [] if start is None else [start[free]]
    tries = [
        least_squares(lambda part: residuals(whole(part)), one, bounds=(low[free], high[free]), x_scale=span)
        for one in starts
    ]
    best = min(tries, key=lambda one: one.cost)
    return whole(best.x), 2.0 * float(best.cost)


def _crossing(at: np.ndarray, sums: np.ndarray, allowed: float, i: int, side: int) -> float:
    """Return where the profile crosses what is allowed, beyond its value i; the end of the range where it does not."""
    j = i + side
    if not 0 <= j < len(at):
        return float(at[i])
    return float(at[i] + (at[j] - at[i]) * (allowed - sums[i]) / (sums[j] - sums[i]))
